"""Why a target is hidden from everywhere: which body is to blame."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from planning.scene import Scene
from planning.target import Target
from planning.visibility.exact_test import FaceSearch, in_front

#: So many bodies, those that were met most often, are tried on their own.
_SUSPECTS: Final = 8
#: So many are named, if they hide the target from this share of the viewpoints.
_NAMED: Final = 3
_WORTH_NAMING: Final = 0.01


def why_hidden(scene: Scene, target: Target, viewpoints_mm: FloatArray) -> str:
    """Say which bodies hide a target that is seen whole from nowhere.

    Parameters
    ----------
    scene
        The bodies.
    target
        The target.
    viewpoints_mm
        (N, 3) viewpoints to try, in mm.

    Returns
    -------
    str
        A sentence without a full stop.
    """
    reason = "every viewpoint in the workspace has material between it and some point of the target"
    points = viewpoints_mm[in_front(viewpoints_mm, target)]
    if len(scene.bodies) == 1 or not len(points):
        return reason
    first_face = np.cumsum([0, *(len(body.faces) for body in scene.bodies)])
    face = FaceSearch(scene.triangles_mm).blockers(points, target)
    met = np.searchsorted(first_face, face[face >= 0], side="right") - 1
    suspects = np.argsort(-np.bincount(met, minlength=len(scene.bodies)), kind="stable")
    shares: dict[str, float] = {}
    for body in suspects[:_SUSPECTS]:
        alone = FaceSearch(scene.bodies[body].triangles_mm).blockers(points, target)
        shares[scene.names[body]] = float((alone >= 0).mean())
    worst = sorted(shares, key=lambda name: -shares[name])
    if shares[worst[0]] == 1.0:
        return f"{reason}; {worst[0]} alone hides it from all {len(points)} that were tried"
    named = ", ".join(
        f"{name} from {shares[name]:.0%}"
        for name in worst[:_NAMED]
        if shares[name] >= _WORTH_NAMING
    )
    return f"{reason}; of {len(points)} that were tried, it is hidden by {named}, each taken alone"
