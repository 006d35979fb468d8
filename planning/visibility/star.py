"""Star-shaped solids: one ray from the centre answers whether a point lies inside.

Of all that sees a convex piece of a target, every point sees every point of the piece, so the solid
is star-shaped about each of them: a ray from there leaves it once. The face through which it leaves
is proposed in single precision and confirmed in double precision, by the three planes through the
centre and its edges. As there is only one such face, that is a proof; points for which it fails are
asked of the whole surface.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from planning.first_hit import FirstHit
from planning.membership import Membership
from planning.vectors import cross, dot

#: Points that are worked on at once, so that they stay in the cache.
_AT_ONCE: Final = 8_192
#: How far beyond an edge, as the sine of an angle, a direction still belongs to a face.
_ROUNDING: Final = 4e-16
#: How far the centre may seem to lie on the outer side of a face, as a share of the size.
_KERNEL: Final = 1e-12
#: A face that is turned away is rounding, and no fold of the surface, if its cone is this narrow.
_NARROW: Final = 1e-11
#: A face that the centre sees at a smaller sine than this is no way out: the ray runs along it.
_EDGE_ON: Final = 1e-9


class StarShaped:
    """A solid that is star-shaped about a point, ready to be asked what lies inside.

    If it turns out not to be (because it was shrunk by a margin, say), all points are asked of the
    whole surface: slower, but right.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of each face, counter-clockwise seen from outside; there may be none.
    centre
        (3,) the point, inside or on the surface.
    """

    def __init__(self, triangles: FloatArray, centre: FloatArray) -> None:
        self._centre = centre
        self._triangles = triangles
        corners = triangles - centre
        a, b, c = np.moveaxis(corners, 1, 0)
        normals = cross(b - a, c - a)
        height = dot(normals, a)
        area = np.linalg.norm(normals, axis=-1)
        size = float(np.abs(corners).max(initial=0.0))
        # Planes through the centre and each edge, inwards; then the plane of the face itself.
        sides = np.stack([cross(p, q - p) for p, q in ((a, b), (b, c), (c, a))], axis=1)
        lengths = np.linalg.norm(sides, axis=-1)
        reach = np.linalg.norm(corners, axis=-1)
        # How wide the cone of a face is at its narrowest, as a sine.
        with np.errstate(divide="ignore", invalid="ignore"):
            width = np.abs(height)[:, None] / (lengths * np.roll(reach, 1, axis=1))
        turned_away = (height < -_KERNEL * size * area) & (width.min(axis=1) > _NARROW)
        self.is_star_shaped = not bool(turned_away.any())
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
        seen = (lengths > _EDGE_ON * reach * edges).all(axis=1)
        seen &= height > _EDGE_ON * area * reach.max(axis=1)
        # Drawn to the unit sphere, faces keep their directions and are compact: rays are faster.
        self._rays = FirstHit(corners[seen] / reach[seen, :, None], np.zeros(3))
        # One row per face, so that a point fetches what it needs at once.
        self._planes: FloatArray = np.concatenate(
            [
                (sides[seen] / lengths[seen, :, None]).reshape(-1, 9),
                normals[seen] / height[seen, None],
            ],
            axis=1,
        )

    def contains(self, points: FloatArray) -> BoolArray:
        """Tell which points lie inside.

        Parameters
        ----------
        points
            (N, 3) points.

        Returns
        -------
        BoolArray
            (N,). On the surface itself either answer may come.
        """
        inside = np.zeros(len(points), dtype=bool)
        if not len(self._triangles):
            return inside
        unsure = [np.zeros(0, dtype=np.int64)]
        for start in range(0, len(points), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            inside[part], sure = self._by_ray(points[part] - self._centre)
            unsure.append(start + np.flatnonzero(~sure))
        again = np.concatenate(unsure)
        if len(again):
            inside[again] = self._surface.contains(points[again])
        return inside

    @cached_property
    def _surface(self) -> Membership:
        return Membership(self._triangles)

    def _by_ray(self, rays: FloatArray) -> tuple[BoolArray, BoolArray]:
        """(N,) whether the ends of rays from the centre lie inside, and whether that is proved."""
        if not self.is_star_shaped:
            return np.zeros(len(rays), dtype=bool), np.zeros(len(rays), dtype=bool)
        face = self._rays.faces(np.zeros(3), rays)
        planes = self._planes.take(face, 0, mode="clip").reshape(-1, 4, 3)
        height = np.matmul(planes, rays[..., None])[..., 0]
        least = np.minimum(np.minimum(height[:, 0], height[:, 1]), height[:, 2])
        sure = (least >= -_ROUNDING * np.sqrt(dot(rays, rays))) & (face >= 0)
        return height[:, 3] < 1.0, sure
