"""The requirements of a task as people write them: every length, angle and blur has its unit."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from lenscal.arrays import FloatArray
from lenscal.handwritten import Handwritten, LengthMm, PositiveLengthMm
from lenscal.sensor import Axis
from planning.camera_body import CameraBody
from planning.cylinder import Cylinder
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.scene import Scene

PointMm = tuple[LengthMm, LengthMm, LengthMm]

_NUMBER: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def _with_unit(*units: str) -> Callable[[Any], float]:
    """Read a number that must have one of the units behind it; the first is what it is given in."""

    def read(value: Any) -> float:
        found = _NUMBER.fullmatch(value) if isinstance(value, str) else None
        if found is None or found[2] not in units:
            raise ValueError(
                f"{value!r} needs its unit, {' or '.join(units)}, such as '1.5 {units[0]}'"
            )
        number = float(found[1])
        return float(np.degrees(number)) if found[2] == "rad" else number

    return read


_angle_deg = _with_unit("deg", "rad")
_percent = _with_unit("%")


def percent(value: Any) -> float:
    """Read a probability that is written in percent.

    Parameters
    ----------
    value
        Such as ``"99 %"``.

    Returns
    -------
    float
        Such as 0.99.

    Raises
    ------
    ValueError
        When it is written otherwise, or is none between 0 and 100 %.
    """
    share = _percent(value) / 100.0
    if not 0.0 < share < 1.0:
        raise ValueError(
            f"{value!r} is no probability that can be asked for: it must be more than 0 % and less "
            "than 100 %, such as '99 %'"
        )
    return share


class ResolutionSpec(Handwritten):
    """A `Resolution` as it is written.

    Parameters
    ----------
    kind
        ``"resolution"``.
    pixels
        How many samples.
    length
        The length that they must cover.
    axis
        The image axis.
    """

    kind: Literal["resolution"]
    pixels: float = Field(gt=0)
    length: PositiveLengthMm
    axis: Axis = "any"


class FieldOfViewSpec(Handwritten):
    """A `FieldOfView` as it is written.

    Parameters
    ----------
    kind
        ``"field_of_view"``.
    length
        The length that must fit.
    axis
        The image axis.
    """

    kind: Literal["field_of_view"]
    length: PositiveLengthMm
    axis: Axis = "any"


class DepthOfFieldSpec(Handwritten):
    """A `DepthOfField` as it is written.

    Parameters
    ----------
    kind
        ``"depth_of_field"``.
    depth
        The depth of the feature; 0 mm for a flat one.
    blur
        The permitted diameter of the circle of confusion in px.
    wavelength
        Wavelength in nm, where diffraction is to count.
    """

    kind: Literal["depth_of_field"]
    depth: Annotated[LengthMm, Field(ge=0)]
    blur: Annotated[float, BeforeValidator(_with_unit("px"))] = Field(gt=0)
    wavelength: Annotated[float, BeforeValidator(_with_unit("nm"))] | None = None


class IncidenceSpec(Handwritten):
    """An `Incidence` as it is written.

    Parameters
    ----------
    kind
        ``"incidence"``.
    max_angle
        The largest angle, with its unit: deg or rad.
    """

    kind: Literal["incidence"]
    max_angle: Annotated[float, BeforeValidator(_angle_deg)] = Field(gt=0, le=90)


class CylinderSpec(Handwritten):
    """A cylinder of lens or camera, in the frame of the reference camera.

    Parameters
    ----------
    start, end
        Middles of its end faces: points, or z alone for one about the optical axis.
    radius
        Its radius.
    """

    start: PointMm | LengthMm
    end: PointMm | LengthMm
    radius: PositiveLengthMm


class MeshSpec(Handwritten):
    """A closed mesh of lens or camera, in the frame of the reference camera.

    Parameters
    ----------
    file
        Its file, beside the task file.
    unit
        Unit of the numbers in it.
    """

    file: Path
    unit: str


class ClearanceSpec(Handwritten):
    """A `Clearance` as it is written.

    Parameters
    ----------
    kind
        ``"clearance"``.
    distance
        How far the body must stay away.
    cylinders, meshes
        What the body is made of.
    """

    kind: Literal["clearance"]
    distance: PositiveLengthMm
    cylinders: tuple[CylinderSpec, ...] = ()
    meshes: tuple[MeshSpec, ...] = ()


class UnvignettedSpec(Handwritten):
    """An `Unvignetted` as it is written.

    Parameters
    ----------
    kind
        ``"unvignetted"``.
    """

    kind: Literal["unvignetted"]


class VisibilitySpec(Handwritten):
    """A `Visibility` as it is written.

    Parameters
    ----------
    kind
        ``"visibility"``.
    distance
        How far inside of its region the projection centre must stay.
    """

    kind: Literal["visibility"]
    distance: Annotated[LengthMm, Field(ge=0)] = 0.0


RequirementSpec = Annotated[
    ResolutionSpec
    | FieldOfViewSpec
    | DepthOfFieldSpec
    | IncidenceSpec
    | ClearanceSpec
    | UnvignettedSpec
    | VisibilitySpec,
    Field(discriminator="kind"),
]


def requirement(spec: RequirementSpec, folder: Path) -> Requirement:
    """Make a requirement of what was written.

    Parameters
    ----------
    spec
        What was written.
    folder
        Where the files that it names are.

    Returns
    -------
    Requirement
        The requirement in mm, px and degrees.
    """
    match spec:
        case ResolutionSpec():
            return Resolution(spec.pixels, spec.length, spec.axis)
        case FieldOfViewSpec():
            return FieldOfView(spec.length, spec.axis)
        case DepthOfFieldSpec():
            return DepthOfField(spec.depth, spec.blur, spec.wavelength)
        case IncidenceSpec():
            return Incidence(spec.max_angle)
        case ClearanceSpec():
            return Clearance(_body(spec, folder), spec.distance)
        case UnvignettedSpec():
            return Unvignetted()
        case VisibilitySpec():
            return Visibility(spec.distance)


def _body(spec: ClearanceSpec, folder: Path) -> CameraBody:
    cylinders = [Cylinder(_on_axis(c.start), _on_axis(c.end), c.radius) for c in spec.cylinders]
    meshes = [
        solid for mesh in spec.meshes for solid in Scene.load(folder / mesh.file, mesh.unit).bodies
    ]
    return CameraBody(cylinders, meshes)


def _on_axis(point: PointMm | float) -> FloatArray:
    return np.array(point if isinstance(point, tuple) else (0.0, 0.0, point))
