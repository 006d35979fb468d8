"""A projective map under which the lines of sight to a target are nearly parallel.

Shadows are long and lie along the lines of sight, in all directions. What manifold3d has to do for
two solids grows with the pairs of their triangles whose boxes along the axes overlap, and the boxes
of long slanting triangles all do. Planes remain planes under a projective map, so that solids can
be cut in its image as well; with a point just behind the target moved to infinity, shadows stand
side by side in the direction of the third axis, and their boxes are thin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray
from planning.boolean import from_manifold

#: How far behind the plane of a target the point lies that is moved to infinity, in units of the
#: frame.
_BEHIND: Final = 0.02


@dataclass(frozen=True, slots=True)
class Perspective:
    """(x, y, z) ↦ (x, y, z/c) · c / (z + c): the plane z = 0 stays, z = −c goes to infinity.

    Parameters
    ----------
    behind
        c in units of the frame; None for no map at all.
    """

    behind: float | None

    @classmethod
    def of(cls, target: FloatArray) -> Perspective:
        """Choose the map for a target.

        Parameters
        ----------
        target
            (M, 3) corners in the frame. A segment is seen from all around, there is no map for it.

        Returns
        -------
        Perspective
            The map.
        """
        return cls(_BEHIND if len(target) > 2 else None)

    def forward(self, points: FloatArray) -> FloatArray:
        """Map points of the frame.

        Parameters
        ----------
        points
            (..., 3) points with z > −c.

        Returns
        -------
        FloatArray
            (..., 3) their images.
        """
        if self.behind is None:
            return points
        image = points / (points[..., 2:] + self.behind)
        image[..., :2] *= self.behind
        return image

    def back(self, images: FloatArray) -> FloatArray:
        """Map points back to the frame.

        Parameters
        ----------
        images
            (..., 3) images.

        Returns
        -------
        FloatArray
            (..., 3) points.
        """
        if self.behind is None:
            return images
        points = images / (1.0 - images[..., 2:])
        points[..., 2] *= self.behind
        return points

    def image(self, solid: Manifold) -> Manifold:
        """Map a solid of the frame.

        Parameters
        ----------
        solid
            The solid.

        Returns
        -------
        Manifold
            Its image.
        """
        return solid if self.behind is None else solid.warp_batch(self.forward)

    def original(self, image: Manifold) -> Manifold:
        """Map a solid back to the frame.

        Parameters
        ----------
        image
            The image.

        Returns
        -------
        Manifold
            The solid.
        """
        return image if self.behind is None else image.warp_batch(self.back)

    def triangles(self, image: Manifold) -> FloatArray:
        """Give the surface of a solid in the frame.

        Parameters
        ----------
        image
            The image of the solid.

        Returns
        -------
        FloatArray
            (F, 3, 3) triangles.
        """
        vertices, faces = from_manifold(image)
        surface: FloatArray = self.back(vertices)[faces]
        return surface

    def volume(self, image: Manifold) -> float:
        """Measure a solid in the frame.

        Parameters
        ----------
        image
            The image of the solid.

        Returns
        -------
        float
            Volume of the solid itself in cubic units.
        """
        if self.behind is None:
            return float(image.volume())
        a, b, c = np.moveaxis(self.triangles(image), 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
