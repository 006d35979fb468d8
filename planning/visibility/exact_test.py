"""An independent exact test of "sees the whole target", on a scene that is prepared once.

A viewpoint v sees all of a convex T when no face of the scene reaches into the pyramid hull(v, T).
The faces are taken as they are: nothing is merged, cut or left out, no shadow is built, so that a
fault there cannot hide here. A ray may propose the face that hides; separating axes in double
precision decide it, and a tree of boxes makes sure that no face is forgotten.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from planning.box_tree import BoxTree
from planning.first_hit import FirstHit
from planning.target import Target
from planning.visibility.pyramid import Pyramids

#: Contact, not penetration: what rounding does, as a share of the distance from viewpoint to
#: target. No more: a wall of height h on an edge of the target is missed within contact / h of its
#: plane.
_CONTACT: Final = 1e-14
#: The same for coordinates that are large because all is far from the origin.
_FAR_OFF: Final = 8 * float(np.finfo(np.float64).eps)
#: Rounds of rays that propose what hides, and the share they must find for another round.
_ROUNDS: Final = 12
_WORTHWHILE: Final = 0.02
#: Rays are worth their preparation for this many viewpoints, and for each face.
_FEW: Final = 64
_FEW_PER_FACE: Final = 0.5


class Occluders(Protocol):
    """What can hide a target: a scene, or a sheet without thickness."""

    @property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) corners of all faces in mm."""

    def inside_material(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside of bodies."""


class ExactTest:
    """A scene, ready to be asked from where targets are seen whole.

    Preparing it is most of the work for a few viewpoints, so keep it for all targets of a scene.

    Parameters
    ----------
    scene
        All bodies, the part that the targets belong to among them.
    """

    def __init__(self, scene: Occluders) -> None:
        self._scene = scene
        self._faces = FaceSearch(scene.triangles_mm)

    def sees(self, viewpoints_mm: npt.ArrayLike, target: Target) -> BoolArray:
        """Decide exactly which viewpoints see all of a target.

        Parameters
        ----------
        viewpoints_mm
            (..., 3) projection centres in mm, in the part's frame.
        target
            The target, convex or not.

        Returns
        -------
        BoolArray
            (...). A viewpoint in the plane of a polygon or behind it sees nothing; nor does one
            inside of a body. To touch is not to hide.
        """
        given = frozen_array("viewpoints_mm", viewpoints_mm, ("...", 3))
        points = given.reshape(-1, 3)
        sees = in_front(points, target)
        front = np.flatnonzero(sees)
        sees[front] = self._faces.blockers(points[front], target) < 0
        if target.is_segment:
            # Of a polygon, the faces of the body hide the front from what is inside.
            left = np.flatnonzero(sees)
            sees[left] = ~self._scene.inside_material(points[left])
        return sees.reshape(given.shape[:-1])


class FaceSearch:
    """Faces that hide, ready to be asked which of them stands in the way.

    Parameters
    ----------
    triangles_mm
        (F, 3, 3) corners in mm; at least one face.
    """

    def __init__(self, triangles_mm: FloatArray) -> None:
        self._triangles = triangles_mm
        self._middles: FloatArray = np.ascontiguousarray(
            (triangles_mm[:, 0] + triangles_mm[:, 1] + triangles_mm[:, 2]).T / 3
        )
        self._tree = BoxTree.about(triangles_mm)

    def blockers(self, points_mm: FloatArray, target: Target) -> IntArray:
        """Find a face that hides some of a target.

        Parameters
        ----------
        points_mm
            (N, 3) viewpoints in mm, in front of a polygon.
        target
            The target.

        Returns
        -------
        IntArray
            (N,) index of one such face, −1 where there is none.
        """
        blocker = np.full(len(points_mm), -1, dtype=np.int64)
        origin = target.centroid_mm
        largest = float(np.abs(target.vertices_mm).max())
        least = max(4 * target.flatness_mm, _FAR_OFF * largest)
        for base in _bases(target):
            left = np.flatnonzero(blocker < 0)
            local = points_mm[left] - origin
            reach = np.linalg.norm(local[:, None] - base, axis=-1).max(axis=1, initial=0.0)
            contact = np.maximum(_CONTACT * reach, least)
            blocker[left] = self._of_piece(Pyramids.over(base, local, contact), origin)
        return blocker

    @cached_property
    def _rays(self) -> FirstHit:
        return FirstHit(self._triangles)

    def _of_piece(self, pyramids: Pyramids, origin: FloatArray) -> IntArray:
        blocker = np.full(len(pyramids.apexes), -1, dtype=np.int64)
        few = max(_FEW, _FEW_PER_FACE * len(self._triangles))
        if "_rays" in self.__dict__ or len(blocker) >= few:
            self._shoot(pyramids, origin, blocker)

        def meets(
            which: IntArray, centres: FloatArray, halves: FloatArray, some: IntArray
        ) -> BoolArray:
            met = blocker[which] < 0
            left = np.flatnonzero(met)
            asked, faces = which[left], some[left]
            met[left], hidden = pyramids.reach_boxes(
                asked,
                centres[:, left] - origin[:, None],
                halves[:, left],
                self._middles.take(faces, 1) - origin[:, None],
            )
            blocker[asked[hidden]] = faces[hidden]
            return met & (blocker[which] < 0)

        for which, triangle in self._tree.pairs(np.flatnonzero(blocker < 0), meets):
            met = pyramids.met_by(which, self._triangles.take(triangle, 0) - origin)
            blocker[which[met]] = triangle[met]
        return blocker

    def _shoot(self, pyramids: Pyramids, origin: FloatArray, blocker: IntArray) -> None:
        """Let rays propose what hides, round by round, while that finds enough."""
        open_ = np.arange(len(blocker))
        for aim in _aims(pyramids.base):
            start = pyramids.apexes[open_] + origin
            triangle = self._rays.faces(start, aim + origin - start)
            hit = triangle >= 0
            asked, triangle = open_[hit], triangle[hit]
            proposed = self._triangles.take(triangle, 0) - origin
            proved = pyramids.pierced_by(asked, aim, proposed)
            blocker[asked[proved]] = triangle[proved]
            left = open_[blocker[open_] < 0]
            if len(left) > (1 - _WORTHWHILE) * len(open_) or not len(left):
                return
            open_ = left


def in_front(points_mm: FloatArray, target: Target) -> BoolArray:
    """Tell which viewpoints lie in front of a target; a segment has its front everywhere.

    Parameters
    ----------
    points_mm
        (N, 3) viewpoints in mm.
    target
        The target.

    Returns
    -------
    BoolArray
        (N,) False in the plane of a polygon and behind it.
    """
    if target.is_segment:
        return np.ones(len(points_mm), dtype=bool)
    front: BoolArray = (points_mm - target.centroid_mm) @ target.normal > target.flatness_mm
    return front


def _bases(target: Target) -> list[FloatArray]:
    """Corners of the convex pieces about the centroid, exactly in one plane."""
    corners = target.vertices_mm - target.centroid_mm
    if not target.is_segment:
        corners = corners - np.outer(corners @ target.normal, target.normal)
    return [corners[piece] for piece in target.pieces]


def _aims(base: FloatArray) -> FloatArray:
    """Points of the target that rays aim at: near the corners, the centre, then in between."""
    centre = base.mean(axis=0)
    corners = centre + 0.98 * (base - centre)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    inner = centre + 0.5 * (base - centre)
    return np.concatenate([corners, centre[None], middles, inner])[:_ROUNDS]
