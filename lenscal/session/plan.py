"""A session as data: what is visited and seen, frozen and countable before a motor moves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import Field, field_validator, model_validator

from lenscal.handwritten import Handwritten, LengthMm, PositiveLengthMm, load_toml
from lenscal.pose import Pose
from lenscal.session.autofocus import REPEATABILITY_MM
from lenscal.session.sharpness import Measure
from lenscal.setting import ApproachSide, LensSetting

#: Beyond this tilt a printed target is seen too obliquely to be found.
_STEEPEST_TILT_DEG: Final = 60.0
#: Steps that are missing by rounding only are not missing.
_ROUNDING: Final = 1e-9


class AutofocusPlan(Handwritten):
    """Where and how finely to look for the sharpest standoff.

    Parameters
    ----------
    nearest, farthest
        Ends of the search, as standoff of the reference projection centre, with unit.
    step
        Distance between pictures of the coarse search at its nearest end, with unit. Farther away
        the depth of field is longer, and steps grow with the square of the standoff.
    iris
        Iris to focus at: wide open, so that the peak is narrow.
    measure
        What sharpness is measured by.
    extensions
        How many times the search may be made longer, by half its length, when the peak lies at its
        end. It can then go nearer than `nearest`; 0 forbids it.
    repeatability
        Standard deviation with which the positioner comes back to a standoff, with unit.
    """

    nearest: PositiveLengthMm
    farthest: PositiveLengthMm
    step: PositiveLengthMm
    iris: float
    measure: Measure = Measure.EDGE_WIDTH
    extensions: Annotated[int, Field(ge=0)] = 2
    repeatability: Annotated[LengthMm, Field(ge=0)] = REPEATABILITY_MM

    @model_validator(mode="after")
    def _in_order(self) -> AutofocusPlan:
        if self.farthest <= self.nearest or self._steps() < 4 - _ROUNDING:
            raise ValueError(
                f"the search from {self.nearest:g} to {self.farthest:g} mm needs at least four "
                f"steps, but one is {self.step:g} mm"
            )
        return self

    def standoffs_mm(self) -> list[float]:
        """List the standoffs of the coarse search.

        Returns
        -------
        list of float
            From the nearest to the farthest in mm, both visited, evenly spaced in one over the
            standoff, as the blur is; the first step is the longest that is not above `step`.
        """
        count = int(np.ceil(self._steps() - _ROUNDING)) + 1
        standoffs_mm = 1 / np.linspace(1 / self.nearest, 1 / self.farthest, count)
        return [self.nearest, *(float(s) for s in standoffs_mm[1:-1]), self.farthest]

    def _steps(self) -> float:
        """Length of the search in steps of 1/standoff, each worth `step` at the nearest end."""
        vergence_step = 1 / self.nearest - 1 / (self.nearest + self.step)
        return (1 / self.nearest - 1 / self.farthest) / vergence_step


@dataclass(frozen=True, slots=True, eq=False)
class ViewPlacement:
    """Where the camera stands for one view, relative to the sharpest standoff.

    Parameters
    ----------
    displacement_mm
        How much farther from the target, along the optical axis.
    turn
        Rotation of the target frame as the camera sees it, about the point that it looks at.
    """

    displacement_mm: float
    turn: Pose


class ViewsPlan(Handwritten):
    """The pictures that each setting is calibrated from.

    Parameters
    ----------
    displacements
        Untilted views with the camera moved by so much along its axis from the sharpest standoff,
        each with unit; positive is farther from the target.
    tilted
        How many tilted views, besides the untilted focus view.
    tilt_deg
        Their angle from the target's normal.
    first_azimuth_deg
        Direction of the first tilt axis in the image plane; the others are spread evenly.
    iris
        Iris to take them at: stopped down, for depth of field.
    """

    displacements: tuple[LengthMm, ...] = ()
    tilted: Annotated[int, Field(ge=2)] = 5
    tilt_deg: Annotated[float, Field(gt=0, le=_STEEPEST_TILT_DEG)] = 25.0
    first_azimuth_deg: float = 20.0
    iris: float

    @field_validator("displacements")
    @classmethod
    def _move_the_camera(cls, displacements: tuple[float, ...]) -> tuple[float, ...]:
        listed = ", ".join(f"{d:g} mm" for d in displacements)
        if 0 in displacements:
            raise ValueError(
                f"a displacement of zero repeats the focus view, which is taken anyway: {listed}"
            )
        if len(set(displacements)) < len(displacements):
            raise ValueError(f"a displacement stands twice: {listed}")
        return displacements

    def placements(self) -> list[ViewPlacement]:
        """List where the camera stands for each view, in the order of taking.

        Returns
        -------
        list of ViewPlacement
            The focus view, the displaced views as listed, the tilted views.
        """
        focus, *tilted = self.tilts()
        return [
            ViewPlacement(0.0, focus),
            *(ViewPlacement(displacement, focus) for displacement in self.displacements),
            *(ViewPlacement(0.0, turn) for turn in tilted),
        ]

    def tilts(self) -> list[Pose]:
        """List the turns of the camera about the point that it looks at.

        Returns
        -------
        list of Pose
            The identity first, for the focus view; then one rotation per tilted view, each about an
            axis perpendicular to the optical axis.
        """
        azimuths = np.deg2rad(self.first_azimuth_deg) + 2 * np.pi / self.tilted * np.arange(
            self.tilted
        )
        tilt = np.deg2rad(self.tilt_deg)
        axes = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(self.tilted)], axis=-1)
        return [Pose.identity(), *(Pose.from_rotation_vector(tilt * axis) for axis in axes)]


class SessionPlan(Handwritten):
    """All that a session will do; a file that people write, as TOML.

    Parameters
    ----------
    zoom, focus
        Settings to visit: every zoom with every focus.
    autofocus
        How to find the sharpest standoff.
    views
        The pictures of each setting.
    approach
        Side from which every motor ends its move.
    keep_frames
        Whether pictures are kept as PNG.
    """

    zoom: Annotated[tuple[float, ...], Field(min_length=1)]
    focus: Annotated[tuple[float, ...], Field(min_length=1)]
    autofocus: AutofocusPlan
    views: ViewsPlan
    approach: ApproachSide = ApproachSide.FROM_BELOW
    keep_frames: bool = True

    @model_validator(mode="after")
    def _no_repeats(self) -> SessionPlan:
        for name in ("zoom", "focus"):
            values = getattr(self, name)
            if len(set(values)) < len(values):
                listed = ", ".join(f"{v:g}" for v in values)
                raise ValueError(f"{name} names a setting twice: {listed}")
        return self

    @model_validator(mode="after")
    def _before_the_target(self) -> SessionPlan:
        # The sharpest standoff may be the nearest one.
        nearest = self.autofocus.nearest
        for displacement in self.views.displacements:
            if displacement <= -nearest:
                raise ValueError(
                    f"a displacement of {displacement:g} mm from the nearest standoff of the "
                    f"search, {nearest:g} mm, brings the camera to the target or behind it; "
                    "displace it by less"
                )
        return self

    def settings(self) -> list[LensSetting]:
        """List the settings in the order of the visit.

        Returns
        -------
        list of LensSetting
            Zoom by zoom, focus running fastest; the iris is left open.
        """
        return [LensSetting(zoom, focus) for zoom in self.zoom for focus in self.focus]

    @classmethod
    def load(cls, path: Path | str) -> SessionPlan:
        """Read a plan that somebody wrote.

        Parameters
        ----------
        path
            A TOML file.

        Returns
        -------
        SessionPlan
            The plan.

        Raises
        ------
        FileError
            When the file cannot be read or is no TOML.
        InputError
            When a key is unknown or missing, or a value cannot be used.
        """
        return load_toml(path, cls, "plan")
