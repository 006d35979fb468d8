"""From light to grey values: photo-electrons, noise, saturation, black level, digital steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import positive
from lenscal.errors import InputError

#: Mean counts below this are drawn from the Poisson distribution itself.
_FEW_ELECTRONS: Final = 50.0

GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class Detector:
    """The pixels of a camera as a radiometrist sees them.

    Parameters
    ----------
    full_well_e
        Electrons at which a pixel is full; together with the black level they span the grey values.
    read_noise_e
        Standard deviation of the read noise in electrons.
    black_level_dn
        Grey value without light.
    bit_depth
        8 to 16 bits.
    electrons_per_second
        Electrons per second in a pixel that sees white paper at a working f-number of 1.

    Raises
    ------
    InputError
        When the bit depth is not 8 to 16, or a number has the wrong sign.
    """

    full_well_e: float
    read_noise_e: float
    black_level_dn: float
    bit_depth: int
    electrons_per_second: float

    def __post_init__(self) -> None:
        positive("full_well_e", self.full_well_e)
        positive("electrons_per_second", self.electrons_per_second)
        if self.bit_depth not in range(8, 17):
            raise InputError(f"bit_depth must be 8 to 16 bits, but is {self.bit_depth}")
        if not (self.read_noise_e >= 0 and 0 <= self.black_level_dn < self.saturation_dn):
            raise InputError(
                f"read_noise_e and black_level_dn must not be negative, and black must lie below "
                f"saturation at {self.saturation_dn}; given {self.read_noise_e:g} e and "
                f"{self.black_level_dn:g} grey values"
            )

    @property
    def saturation_dn(self) -> int:
        """The grey value of a full pixel."""
        return int(2**self.bit_depth) - 1

    @property
    def electrons_per_dn(self) -> float:
        """Conversion gain: electrons per grey value."""
        return self.full_well_e / (self.saturation_dn - self.black_level_dn)

    def electrons(
        self, irradiance: npt.ArrayLike, exposure_s: float, f_number: float
    ) -> npt.NDArray[np.float32]:
        """Give the mean count of photo-electrons.

        Parameters
        ----------
        irradiance
            (...) relative to white paper.
        exposure_s
            Exposure time.
        f_number
            Working f-number d/a: the light on the sensor goes with 1/N².

        Returns
        -------
        npt.NDArray[np.float32]
            (...) electrons, beyond the full well too.
        """
        per_white = self.electrons_per_second * exposure_s / f_number**2
        # Interpolation may overshoot a black edge by a hair; there is no negative light.
        mean: npt.NDArray[np.float32] = np.maximum(np.asarray(irradiance, np.float32), 0)
        return mean * np.float32(per_white)

    def read(
        self, mean_electrons: npt.NDArray[np.float32], rng: np.random.Generator | None
    ) -> GreyImage:
        """Expose and digitise once.

        Parameters
        ----------
        mean_electrons
            (...) mean count of photo-electrons.
        rng
            Source of the shot noise (Poisson) and of the read noise (normal); None for none.

        Returns
        -------
        GreyImage
            (...) grey values, 8 bits wide where they fit, otherwise 16.
        """
        collected = mean_electrons
        if rng is not None:
            # Far beyond the full well the noise shows no more.
            counts = _poisson(np.minimum(mean_electrons, 1e3 * self.full_well_e), rng)
            collected = np.minimum(counts, np.float32(self.full_well_e))
            noise = rng.standard_normal(np.shape(collected), dtype=np.float32)
            noise *= np.float32(self.read_noise_e)
            collected += noise
        grey = collected * np.float32(1 / self.electrons_per_dn)
        grey += np.float32(self.black_level_dn)
        np.rint(grey, out=grey)
        np.clip(grey, 0, self.saturation_dn, out=grey)
        return grey.astype(np.uint8) if self.bit_depth == 8 else grey.astype(np.uint16)


def _poisson(mean: npt.NDArray[np.float32], rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Draw Poisson counts; large ones from a normal distribution with their first three moments.

    Cornish and Fisher's expansion m + √m z + (z² − 1)/6 has the mean, the variance and the skewness
    of a Poisson distribution, up to 1/(18 m) of the variance.
    """
    deviation = np.sqrt(mean)
    z = rng.standard_normal(np.shape(mean), dtype=np.float32)
    counts = z * (deviation + z * np.float32(1 / 6))
    counts += mean
    counts -= np.float32(1 / 6)
    few = mean < _FEW_ELECTRONS
    if few.any():
        counts[few] = rng.poisson(mean[few])
    return np.asarray(counts, dtype=np.float32)
