"""The visibility region: all viewpoints in a workspace from which a whole target is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray
from planning.boolean import from_manifold, intersect, to_manifold
from planning.solid import Solid
from planning.visibility.audit import Audit


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A solid of viewpoints, with the evidence that it is right.

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
    """

    solid: Solid
    workspace: Solid
    audit: Audit
    why_empty: str = ""

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
        return self.solid.contains(points)

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

    def intersect(self, other: Region) -> Region:
        """Keep the viewpoints that two regions share, such as those that see two targets.

        Parameters
        ----------
        other
            A region in the same frame.

        Returns
        -------
        Region
            What both share. Its audit adds up theirs: no viewpoint is tried again.
        """
        centre, scale = _centre_and_scale(self.workspace)
        common, imbalance = intersect(
            _local("the region", self.solid, centre, scale),
            _local("the other region", other.solid, centre, scale),
        )
        vertices, faces = from_manifold(common)
        solid = Solid(vertices * scale + centre, faces)
        first, second = self.audit, other.audit
        audit = Audit(
            first.viewpoints + second.viewpoints,
            first.disagreements + second.disagreements,
            first.near_boundary + second.near_boundary,
            max(first.tolerance_mm, second.tolerance_mm),
            first.visible + second.visible,
            max(first.imbalance, second.imbalance, imbalance),
            first.repairs + second.repairs,
        )
        why = self.why_empty or other.why_empty or "the two regions share no viewpoint"
        return Region(solid, self.workspace, audit, why if solid.is_empty else "")


def _centre_and_scale(workspace: Solid) -> tuple[FloatArray, float]:
    low, high = workspace.bounds_mm
    centre: FloatArray = (low + high) / 2
    return centre, float(np.linalg.norm(high - low)) / 2


def _local(name: str, solid: Solid, centre: FloatArray, scale: float) -> Manifold:
    if solid.is_empty:
        return Manifold()
    return to_manifold(name, (solid.vertices_mm - centre) / scale, solid.faces)
