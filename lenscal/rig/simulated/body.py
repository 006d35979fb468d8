"""The outside of a simulated lens, for those who must not bump into things."""

from __future__ import annotations

from dataclasses import dataclass

from lenscal.arrays import positive


@dataclass(frozen=True, slots=True)
class LensBody:
    """Front glass and barrel, in the frame of the camera at the reference setting.

    The barrel is a cylinder about the optical axis. It does not move with zoom or focus.

    Parameters
    ----------
    front_mm
        How far the vertex of the front glass stands before the reference projection centre: the
        largest z of the lens. Subtract it from a standoff for the way that is free.
    glass_radius_mm
        Of the front glass.
    barrel_radius_mm
        Of the barrel.
    barrel_length_mm
        From the front glass back to the mount.
    """

    front_mm: float
    glass_radius_mm: float
    barrel_radius_mm: float
    barrel_length_mm: float

    def __post_init__(self) -> None:
        for name in ("front_mm", "glass_radius_mm", "barrel_radius_mm", "barrel_length_mm"):
            positive(name, getattr(self, name), "mm")
