"""Viewing regions: from where a convex target is seen through a convex hole.

They are bounded by the limiting planes of the paper (section 1.2.1.3) that go through an edge of
the hole and a corner of the target, with both on the same side.
"""

from __future__ import annotations

import numpy as np

from lenscal.arrays import BoolArray, FloatArray


def viewing_planes(
    hole: FloatArray,
    beyond: BoolArray,
    normal: FloatArray,
    offset: float,
    target: FloatArray,
    tolerance: float,
) -> FloatArray | None:
    """Find the planes that bound what sees a target through a convex hole.

    There is one for each edge, through that corner of the target which binds.

    Parameters
    ----------
    hole
        (H, 3) corners in order.
    beyond
        (H,) which edges, from a corner to the next, bind nothing.
    normal, offset
        The plane of the hole; the viewpoint is on the side that the normal points to.
    target
        (M, 3) corners of a convex target, none on the viewpoint's side of that plane.
    tolerance
        How far a corner may be off the plane and still lie in it.

    Returns
    -------
    FloatArray or None
        (K, 4) planes (n, c) with n · v ≥ c for those viewpoints; None when there are none because
        the target lies in the plane of the hole next to the hole.
    """
    depth = offset - target @ normal
    depth[depth <= tolerance] = 0.0
    middle = hole.mean(axis=0)
    planes = []
    for here, there, skip in zip(hole, np.roll(hole, -1, axis=0), beyond, strict=True):
        if skip:
            continue
        inward = np.cross(normal, there - here)
        inward *= np.sign((middle - here) @ inward) / np.linalg.norm(inward)
        across = (target - here) @ inward
        if ((depth == 0) & (across < -tolerance)).any():
            return None
        below = np.flatnonzero(depth > 0)
        binding = target[below[np.argmin(across[below] / depth[below])]]
        # The nearer end of the edge as base keeps the most digits of the direction to the corner.
        base = min(here, there, key=lambda end: float(np.linalg.norm(binding - end)))
        plane = np.cross(there - here, binding - base)
        plane *= np.sign((middle - here) @ plane) / np.linalg.norm(plane)
        planes.append([*plane, plane @ base])
    return np.array(planes).reshape(-1, 4)
