"""Flat pictures that lie on things: a ruler, a label, a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.errors import InputError
from lenscal.imaging.raycast import Hits
from lenscal.imaging.texture import Float32Image, TargetSurface
from lenscal.pose import Pose

#: A decal covers what lies less than this far before or behind it: what it is glued to.
_THICKNESS_MM: Final = 0.05
#: Texels per mm in which targets are drawn.
_TEXELS_PER_MM: Final = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Decal:
    """A rectangle with a picture, seen from one side.

    Parameters
    ----------
    scene_from_decal
        Its place: origin in its middle, x right and y down as seen, z away from the viewer.
    reflectance
        (rows, columns) picture, white paper 1.
    size_mm
        Width and height.

    Raises
    ------
    InputError
        When the picture is no array of two axes or a value is not between 0 and 1, or a side is not
        positive.
    """

    scene_from_decal: Pose
    reflectance: FloatArray
    size_mm: tuple[float, float]

    def __post_init__(self) -> None:
        picture = frozen_array("reflectance", self.reflectance, ("rows", "columns"))
        if not (picture.size and picture.min() >= 0 and picture.max() <= 1):
            raise InputError(
                "the picture of a decal must hold reflectances between 0 and 1 (white); divide "
                "grey values by their white"
            )
        width, height = (positive("size_mm", side, "mm") for side in self.size_mm)
        object.__setattr__(self, "reflectance", picture)
        object.__setattr__(self, "size_mm", (width, height))

    @classmethod
    def of_target(
        cls,
        scene_from_target: Pose,
        surface: TargetSurface,
        texels_per_mm: float = _TEXELS_PER_MM,
    ) -> Decal:
        """Print a target.

        Parameters
        ----------
        scene_from_target
            Where it is.
        surface
            The target and its ink.
        texels_per_mm
            Resolution of the print; no finer detail will be seen.

        Returns
        -------
        Decal
            The printed sheet.
        """
        share = surface.target.artwork(texels_per_mm) / 255
        rows, columns = share.shape
        size_mm = columns / texels_per_mm, rows / texels_per_mm
        return cls(scene_from_target, surface.ink + (1 - surface.ink) * share, size_mm)

    def reduced(self, texel_mm: float) -> Float32Image:
        """Average the picture to texels of about a stated size, or leave it where it is coarser.

        Parameters
        ----------
        texel_mm
            Size of a texel.

        Returns
        -------
        Float32Image
            (rows, columns) reflectance.
        """
        rows, columns = self.reflectance.shape
        size = tuple(
            min(count, max(1, round(side / texel_mm)))
            for count, side in zip((columns, rows), self.size_mm, strict=True)
        )
        picture = self.reflectance.astype(np.float32)
        if size != (columns, rows):
            picture = np.asarray(
                cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32
            )
        return picture

    def cover(
        self, hits: Hits, rays: FloatArray, camera_from_scene: Pose, picture: Float32Image
    ) -> None:
        """Lay the picture over what rays have met, where it is not hidden.

        Parameters
        ----------
        hits
            What they met; changed where they meet the decal.
        rays
            (N, 3) directions with z = 1 in the camera frame.
        camera_from_scene
            Where the scene is.
        picture
            What `reduced` gave.
        """
        place = camera_from_scene @ self.scene_from_decal
        away = place.rotation[:, 2]
        towards, distance = rays @ away, float(away @ place.translation_mm)
        if distance <= 0:
            return
        depth = np.where(towards > 0, distance / np.where(towards > 0, towards, 1.0), np.inf)
        visible = np.flatnonzero(depth < hits.depth_mm + _THICKNESS_MM)
        points = place.inverse().transform(depth[visible, None] * rays[visible])[:, :2]
        inside = (np.abs(points) <= np.array(self.size_mm) / 2).all(axis=-1)
        visible, points = visible[inside], points[inside]
        if not len(visible):
            return
        texels_per_mm = np.array(picture.shape[::-1]) / self.size_mm
        at = ((points + np.array(self.size_mm) / 2) * texels_per_mm - 0.5).astype(np.float32)
        hits.reflectance[visible] = _interpolated(picture, at)
        hits.depth_mm[visible] = depth[visible]
        hits.normal[visible] = -away


def _interpolated(picture: Float32Image, at: Float32Image) -> Float32Image:
    """Look (N, 2) places up; OpenCV wants images whose sides fit 16 bits."""
    width = 4096
    padded = np.zeros((-(-len(at) // width) * width, 2), np.float32)
    padded[: len(at)] = at
    values = cv2.remap(  # type: ignore[call-overload]  # OpenCV takes one map, its types do not
        picture,
        padded.reshape(-1, width, 2),
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(values.ravel()[: len(at)], dtype=np.float32)
