"""Where the projection centre lies at a setting, in the frame of the reference camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: The lateral wander of the projection centre, as the calibration table calls it.
LATERAL: Final = ("nodal_x_mm", "nodal_y_mm")


@dataclass(frozen=True, slots=True, eq=False)
class NodalPoint:
    """The projection centre of a setting, and the standoff of its sharp plane.

    Parameters
    ----------
    lateral_mm
        (2,) x and y in the frame of the reference camera: the axis of a zoom lens wanders.
    sigma_lateral_mm
        (2,) σ of these.
    offset_mm
        How far it lies behind that of the reference setting.
    sigma_offset_mm
        Its σ, nearly that of D.
    standoff_mm
        From the reference projection centre to the sharp plane.
    sigma_standoff_mm
        Its σ, nearly that of the autofocus.
    notes
        What was assumed, in words.
    """

    lateral_mm: FloatArray
    sigma_lateral_mm: FloatArray
    offset_mm: float
    sigma_offset_mm: float
    standoff_mm: float
    sigma_standoff_mm: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("lateral_mm", "sigma_lateral_mm"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (2,)))

    @property
    def centre_mm(self) -> FloatArray:
        """(3,) the projection centre in the frame of the reference camera."""
        return np.array([*self.lateral_mm, -self.offset_mm])

    @property
    def sharp_point_mm(self) -> FloatArray:
        """(3,) where the axis meets the sharp plane, in the frame of the reference camera."""
        return np.array([*self.lateral_mm, self.standoff_mm])


def nodal_point(lens: LensMap, zoom: float, focus: float) -> NodalPoint:
    """Ask a map for the projection centre at a setting.

    Parameters
    ----------
    lens
        The map, with standoffs.
    zoom, focus
        The setting.

    Returns
    -------
    NodalPoint
        Where the map has no lateral wander it is taken as zero, a note says so, and its size among
        the samples, as far as they tell it, is the σ.
    """
    lateral = np.zeros(2)
    notes: tuple[str, ...] = ()
    if set(LATERAL) <= set(lens.quantities):
        lateral = np.array([float(lens.value(name, zoom, focus)) for name in LATERAL])
        sigma = np.array([float(lens.sigma(name, zoom, focus)) for name in LATERAL])
    else:
        sigma = np.array([_size_among_samples(lens, name) for name in LATERAL])
        said = f"σ {sigma[0]:.2g} and {sigma[1]:.2g} mm, its size among the samples"
        notes = (
            "the lens map does not map the lateral wander of the projection centre; it is taken "
            f"as zero ({said if sigma.any() else 'the samples do not tell it either'})",
        )
    return NodalPoint(
        lateral,
        sigma,
        float(lens.nodal_offset_mm(zoom, focus)),
        float(lens.sigma("nodal_offset_mm", zoom, focus)),
        float(lens.standoff_mm(zoom, focus)),
        float(lens.sigma("standoff_mm", zoom, focus)),
        notes,
    )


def _size_among_samples(lens: LensMap, name: str) -> float:
    if name not in lens.samples or lens.samples[name].isna().all():
        return 0.0
    return float(np.sqrt((lens.samples[name].dropna() ** 2).mean()))
