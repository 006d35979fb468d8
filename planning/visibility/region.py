"""The visibility region: all viewpoints in a workspace from which a whole target is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh
from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from planning.boolean import from_manifold, intersect, to_manifold
from planning.solid import Solid
from planning.visibility.audit import Audit
from planning.visibility.factor import PlacedFactor

#: Points that are asked at once, so that what is left of them stays in the cache.
_AT_ONCE: Final = 65_536


@dataclass(frozen=True, eq=False)
class Region:
    """A solid of viewpoints, with the evidence that it is right.

    It is kept in two ways: as one solid, and as what was intersected to make it. The factors, one
    for each convex piece of the target, are star-shaped, so they tell quickly what lies inside.

    Parameters
    ----------
    solid
        The region in mm, in the part's frame.
    workspace
        Where the camera may be.
    audit
        What the independent test found.
    why_empty
        A sentence, empty when the region is not.
    factors
        What sees each convex piece of the target, before any cut. None at all when the region was
        not made of such; then the solid itself is asked.
    limits
        Other solids that it was intersected with.
    excluded
        Solids that were cut out of it.
    evidence
        What it was made of and how, as JSON can hold it.
    """

    solid: Solid
    workspace: Solid
    audit: Audit
    why_empty: str = ""
    factors: tuple[PlacedFactor, ...] = ()
    limits: tuple[Solid, ...] = ()
    excluded: tuple[Solid, ...] = ()
    evidence: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Whether no viewpoint sees the whole target."""
        return self.solid.is_empty

    @property
    def volume_mm3(self) -> float:
        """Volume in mm³."""
        return self.solid.volume_mm3

    def contains(self, points: npt.ArrayLike) -> BoolArray:
        """Tell from which points the whole target is seen.

        Parameters
        ----------
        points
            (..., 3) projection centres in mm, in the part's frame.

        Returns
        -------
        BoolArray
            (...). On the boundary itself either answer may come.
        """
        given = frozen_array("points", points, ("...", 3))
        flat = given.reshape(-1, 3)
        inside = np.zeros(len(flat), dtype=bool)
        if not self.is_empty:
            for start in range(0, len(flat), _AT_ONCE):
                part = slice(start, start + _AT_ONCE)
                inside[part] = self._contains(flat[part])
        return inside.reshape(given.shape[:-1])

    def distance_to_boundary(self, points: npt.ArrayLike) -> FloatArray:
        """Measure how far points are from the boundary, that with the workspace included.

        Parameters
        ----------
        points
            (..., 3) points in mm.

        Returns
        -------
        FloatArray
            (...) mm, positive inside, negative outside; minus infinity when the region is empty.
        """
        distance = self.solid.distance_to_surface_mm(points)
        signed: FloatArray = np.where(self.contains(points), distance, -distance)
        return signed

    def to_mesh(self) -> trimesh.Trimesh:
        """Hand the region over to trimesh.

        Returns
        -------
        trimesh.Trimesh
            A closed mesh in mm; it may have several components.
        """
        return self.solid.to_mesh()

    def to_dict(self) -> dict[str, Any]:
        """Give the record that goes with whatever the region is saved as.

        Returns
        -------
        dict
            Volume, reason why it is empty, audit, digests of what it was made of, versions of what
            made it; as JSON can hold it.
        """
        return {
            "volume_mm3": self.volume_mm3,
            "workspace_volume_mm3": self.workspace.volume_mm3,
            "why_empty": self.why_empty,
            "audit": self.audit.to_dict(),
            "solid_digest": self.solid.digest,
            "workspace_digest": self.workspace.digest,
            **self.evidence,
        }

    def intersect(self, other: Region) -> Region:
        """Keep the viewpoints that two regions share, such as those that see two targets.

        Parameters
        ----------
        other
            A region in the same frame.

        Returns
        -------
        Region
            What both share, in the workspace of the first. Its audit adds up theirs: no viewpoint
            is tried again.
        """
        centre, scale = _centre_and_scale(self.workspace)
        common, imbalance = intersect(
            _local("the region", self.solid, centre, scale),
            _local("the other region", other.solid, centre, scale),
        )
        whole = self.workspace.volume_mm3 / scale**3
        vertices, faces = from_manifold(common)
        solid = Solid(vertices * scale + centre, faces)
        why = self.why_empty or other.why_empty or "the two regions share no viewpoint"
        limits = {id(limit): limit for limit in (*self._bounds(), *other._bounds())}
        return Region(
            solid,
            self.workspace,
            self.audit.combined(other.audit, imbalance / whole),
            why if solid.is_empty else "",
            self.factors + other.factors,
            tuple(limit for limit in limits.values() if limit is not self.workspace),
            self.excluded + other.excluded,
            {"intersection_of": [self.to_dict(), other.to_dict()]},
        )

    def _contains(self, points: FloatArray) -> BoolArray:
        """Ask what is quick first, and the rest only of what is left."""
        inside: BoolArray = self.workspace.contains(points)
        parts: tuple[Solid | PlacedFactor, ...] = (*self._bounds()[1:], *self.factors)
        for part in parts:
            left = np.flatnonzero(inside)
            # Most often all are left: then nothing need be copied.
            asked = points if len(left) == len(points) else points[left]
            inside[left] = part.contains(asked)
        for solid in self.excluded:
            left = np.flatnonzero(inside)
            inside[left] = ~solid.contains(points[left])
        return inside

    def _bounds(self) -> tuple[Solid, ...]:
        """All solids that it lies in, the workspace first."""
        return (self.workspace, *self.limits, *(() if self.factors else (self.solid,)))


def _centre_and_scale(workspace: Solid) -> tuple[FloatArray, float]:
    low, high = workspace.bounds_mm
    centre: FloatArray = (low + high) / 2
    return centre, float(np.linalg.norm(high - low)) / 2


def _local(name: str, solid: Solid, centre: FloatArray, scale: float) -> Manifold:
    if solid.is_empty:
        return Manifold()
    return to_manifold(name, (solid.vertices_mm - centre) / scale, solid.faces)
