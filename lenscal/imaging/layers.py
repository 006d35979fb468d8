"""Blur of a scene with depth: every sample by its own depth, near surfaces over far ones.

Light is gathered in layers between two neighbouring rungs of `lenscal.imaging.ladder`, and a layer
is blurred by both rungs in proportion to the squared diameter, as flat targets are. Layers through
which one surface runs add up. Surfaces that are apart in depth are laid over each other from far to
near; what a nearer one hides is taken to go on as it looks at the border of what hides it.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, IntArray
from lenscal.imaging.aperture import Aperture, blur_kernel, convolved
from lenscal.imaging.ladder import level_diameter_px, level_of, mean_pitch_mm, share_of_level
from lenscal.imaging.texture import Float32Image

#: A pixel of which less than this is left when nearer surfaces are peeled off counts as hidden.
_HIDDEN: Final = 0.02
#: A surface runs on where blur changes by less than so many rungs to the neighbouring pixels.
_SMOOTH_RUNGS: Final = 0.5
#: Stands for the rung of a pixel that shows background.
_NO_RUNG: Final = 1e6


class BlurLayers:
    """An image taken apart by blur, and put together again.

    Parameters
    ----------
    height, width
        Size of the image in px.
    sample_pitch_mm
        (2,) spacing of samples along x and y.
    """

    def __init__(self, height: int, width: int, sample_pitch_mm: FloatArray) -> None:
        self._shape = height, width
        self._pitch_mm = sample_pitch_mm
        #: Rung at the far end of a layer to (coverage and light) × (far end and near end).
        self._layers: dict[int, npt.NDArray[np.float32]] = {}
        self._lowest_rung = np.full((height, width), _NO_RUNG, np.float32)
        self._highest_rung = np.full((height, width), _NO_RUNG, np.float32)

    def add(
        self, block: tuple[slice, slice], light: Float32Image, diameter_mm: Float32Image
    ) -> None:
        """Take samples in.

        Parameters
        ----------
        block
            Rows and columns of the pixels that they belong to.
        light
            (rows, columns, N) irradiance of N samples of each pixel.
        diameter_mm
            (rows, columns, N) diameter of their blur, negative nearer than the sharp plane, NaN for
            the background.
        """
        diameter_px = diameter_mm / np.float32(mean_pitch_mm(self._pitch_mm))
        rung = level_of(diameter_px)
        in_depth = np.where(np.isnan(rung), _NO_RUNG, rung)
        self._lowest_rung[block] = in_depth.min(axis=-1)
        self._highest_rung[block] = in_depth.max(axis=-1)
        layer = np.ceil(rung)
        for far in np.unique(layer[np.isfinite(layer)]).astype(int):
            here = layer == far
            size = np.where(here, np.abs(diameter_px), np.float32(0))
            store = self._layers.setdefault(int(far), np.zeros((2, 2, *self._shape), np.float32))
            for end, k in enumerate((far, far - 1)):
                share = np.where(here, share_of_level(abs(int(k)), size), np.float32(0))
                store[0, end][block] += share.mean(axis=-1)
                store[1, end][block] += (share * light).mean(axis=-1)

    def composed(self, background: float, aperture: Aperture) -> Float32Image:
        """Blur every surface and lay it over those behind it.

        Parameters
        ----------
        background
            Irradiance of what lies behind everything.
        aperture
            Shape of the blur.

        Returns
        -------
        Float32Image
            (height, width) irradiance.
        """
        image = np.full(self._shape, background, np.float32)
        surface_of = self._surfaces()
        hidden = np.zeros(self._shape, np.float32)
        for layer in self._layers.values():
            hidden += layer[0].sum(axis=0)
        for surface in self._far_to_near(surface_of):
            parts = {
                far: layer * (surface_of[far] == surface)
                for far, layer in self._layers.items()
                if (surface_of[far] == surface).any()
            }
            for part in parts.values():
                hidden -= part[0].sum(axis=0)
            # Peel off what is nearer, and let the rest go on where nothing is left.
            seen = hidden < 1 - _HIDDEN
            left, nearest = np.where(seen, 1 - hidden, np.float32(1)), _nearest(seen)
            peeled = {
                far: (part / left).reshape(2, 2, -1)[..., nearest] for far, part in parts.items()
            }
            coverage, light = self._blurred(peeled, aperture)
            image = image * (1 - coverage) + light
        return image

    def _blurred(
        self, parts: dict[int, npt.NDArray[np.float32]], aperture: Aperture
    ) -> tuple[Float32Image, Float32Image]:
        """Blur the parts of one surface by what each of them is, and add them up."""
        whole = np.zeros(self._shape, np.float32)
        for part in parts.values():
            whole += part[0].sum(axis=0)
        own = _nearest(whole > _HIDDEN)
        weight, light, coverage = (np.zeros(self._shape, np.float32) for _ in range(3))
        for far, part in parts.items():
            for end, rung in enumerate((far, far - 1)):
                if not part[0, end].any():
                    continue
                kernel = self._kernel(rung, aperture)
                weight += convolved(part[0, end], kernel, cv2.BORDER_REPLICATE)
                light += convolved(part[1, end], kernel, cv2.BORDER_REPLICATE)
                share = (part[0, end] / np.maximum(whole, _HIDDEN)).ravel()[own]
                coverage += share * convolved(whole, kernel, cv2.BORDER_REPLICATE)
        # Where the blur changes along the surface, the parts do not quite add up to its coverage.
        enough = weight > _HIDDEN
        coverage = np.where(enough, np.clip(coverage, 0, 1), weight)
        light *= np.where(enough, coverage / np.where(enough, weight, 1), 1).astype(np.float32)
        return coverage.astype(np.float32), light

    def _surfaces(self) -> dict[int, IntArray]:
        """Number the surfaces: for every layer, to which one its light in each pixel belongs."""
        middle = (self._lowest_rung + self._highest_rung) / 2
        smooth = self._smooth()
        # Background and things before it are apart by far.
        _, component = cv2.connectedComponents(smooth.astype(np.uint8), connectivity=4)
        surfaces = {}
        for far in self._layers:
            # Pixels across a border show two surfaces: their light is that of the nearest pixel
            # that shows one of them alone.
            alone = smooth & (np.abs(middle - (far - 0.5)) <= 1.5)
            number = (
                component.ravel()[_nearest(alone)] if alone.any() else np.full(middle.shape, -1)
            )
            surfaces[far] = np.asarray(number, dtype=np.int64)
        return surfaces

    def _smooth(self) -> BoolArray:
        """Tell where a pixel and its neighbours show one surface."""
        shown = self._highest_rung < _NO_RUNG
        rungs = [
            np.abs(r[shown]).min(initial=_NO_RUNG) for r in (self._lowest_rung, self._highest_rung)
        ]
        # The floor parts the rungs before and behind the sharp plane, but not the surface.
        least = min(rungs)
        low, high = (
            np.sign(r) * np.maximum(np.abs(r) - least, 0)
            for r in (self._lowest_rung, self._highest_rung)
        )
        square = np.ones((3, 3), np.uint8)
        change = cv2.dilate(high, square) - cv2.erode(low, square)
        return np.asarray((change < _SMOOTH_RUNGS) & shown)

    def _far_to_near(self, surface_of: dict[int, IntArray]) -> list[int]:
        """Order the surfaces by their mean rung."""
        weight: dict[int, float] = {}
        moment: dict[int, float] = {}
        for far, numbers in surface_of.items():
            covered = self._layers[far][0].sum(axis=0)
            for number in np.unique(numbers[covered > 0]):
                amount = float(covered[numbers == number].sum())
                weight[number] = weight.get(number, 0.0) + amount
                moment[number] = moment.get(number, 0.0) + amount * far
        return sorted(weight, key=lambda number: -moment[number] / weight[number])

    def _kernel(self, rung: int, aperture: Aperture) -> Float32Image:
        diameter_mm = level_diameter_px(abs(rung)) * mean_pitch_mm(self._pitch_mm)
        shape = aperture.turned if rung < 0 else aperture
        return blur_kernel(diameter_mm, float(self._pitch_mm[0]), float(self._pitch_mm[1]), shape)


def _nearest(valid: BoolArray) -> IntArray:
    """Give the flat index of the nearest valid pixel, for every pixel."""
    own = np.arange(valid.size).reshape(valid.shape)
    if valid.all() or not valid.any():
        return own
    _, label = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index_of_label: IntArray = np.zeros(int(label.max()) + 1, np.int64)
    index_of_label[label[valid]] = own[valid]
    return np.asarray(index_of_label[label])
