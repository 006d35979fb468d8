"""The task: what is to be seen, how well, and from where the camera may look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from lenscal.document import digest
from lenscal.errors import PlanningError
from planning.requirements.magnification import image_axis
from planning.requirements.margin import Requirement
from planning.solid import Solid
from planning.target import Target

#: How far, as a share of its size, the feature's midpoint may lie off the target.
_ON_TARGET = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One target to be inspected.

    Parameters
    ----------
    target
        The face that is to be seen whole.
    feature
        The segment or face that is to be resolved and contained; None for the target itself.
    requirements
        What the image of the feature must satisfy.
    workspace
        Where the projection centre may be, a closed solid in the part's frame.
    name
        What people call the task.
    views
        "orthogonal": the camera looks at the middle of the feature, perpendicular to it, as in the
        paper; "general": from anywhere in any direction.
    confidence
        With which probability all requirements shall hold together, given how well lens map and
        robot are known; None to ask for positive margins only.

    Raises
    ------
    PlanningError
        When there is no requirement, two of them want the feature along different axes, the
        feature leaves the plane of the target, or views or confidence are none that exist.
    """

    target: Target
    feature: Target | None
    requirements: Sequence[Requirement]
    workspace: Solid
    name: str = ""
    views: Literal["orthogonal", "general"] = "orthogonal"
    confidence: float | None = None

    def __post_init__(self) -> None:
        requirements = tuple(self.requirements)
        if not requirements:
            raise PlanningError(
                "a task needs at least one requirement, such as Resolution(3, 0.254) or "
                "FieldOfView(25.4)"
            )
        image_axis(requirements)
        if self.views not in ("orthogonal", "general"):
            raise PlanningError(f"views must be 'orthogonal' or 'general', but is {self.views!r}")
        if self.confidence is not None and not 0 < self.confidence < 1:
            raise PlanningError(
                f"confidence must be a probability between 0 and 1, but is {self.confidence:g}; "
                "99 % is 0.99"
            )
        feature = self.target if self.feature is None else self.feature
        if not self.target.is_segment:
            off = np.abs((feature.vertices_mm - self.target.centroid_mm) @ self.target.normal).max()
            if off > _ON_TARGET * max(self.target.size_mm, feature.size_mm):
                raise PlanningError(
                    f"the feature leaves the plane of the target by {off:.3g} mm; a feature "
                    "lies on the target"
                )
        object.__setattr__(self, "requirements", requirements)
        object.__setattr__(self, "feature", feature)

    @property
    def seen_feature(self) -> Target:
        """The feature, which is the target itself when none was given."""
        return self.target if self.feature is None else self.feature

    def to_dict(self) -> dict[str, Any]:
        """Give the task as JSON can hold it.

        Returns
        -------
        dict
            Target and feature by their vertices, the workspace by its bounds and digest.
        """
        return {
            "name": self.name,
            "views": self.views,
            "confidence": self.confidence,
            "target_mm": self.target.vertices_mm.tolist(),
            "feature_mm": self.seen_feature.vertices_mm.tolist(),
            "requirements": [
                {"kind": r.name, **{f: _plain(getattr(r, f)) for f in getattr(r, "__slots__", ())}}
                for r in self.requirements
            ],
            "workspace": {
                "bounds_mm": self.workspace.bounds_mm.tolist(),
                "volume_mm3": self.workspace.volume_mm3,
                "digest": self.workspace.digest,
            },
        }

    @property
    def digest(self) -> str:
        """SHA-256 of all that the task says, in hexadecimal."""
        return digest(self.to_dict())


def _plain(value: Any) -> Any:
    """Give a parameter of a requirement as JSON can hold it."""
    return value.to_dict() if hasattr(value, "to_dict") else value
