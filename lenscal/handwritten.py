"""Files that people write: TOML, checked against a model that says what is wrong, and where.

Unknown keys are refused, and so is every length without a unit.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
)

from lenscal.document import reason
from lenscal.errors import FileError, InputError
from lenscal.units import parse_length_mm


class Handwritten(BaseModel):
    """What a file may say: frozen, and without room for keys that nobody reads."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def _length_mm(value: Any) -> float:
    if isinstance(value, str):
        return parse_length_mm(value)
    raise ValueError(f"a length needs its unit, such as '{value} mm'")


#: A length in mm; in a file it stands with its unit, and gets one when it is written back.
LengthMm = Annotated[
    float,
    BeforeValidator(_length_mm),
    PlainSerializer(lambda mm: f"{mm!r} mm", when_used="json"),
]
#: A length greater than zero.
PositiveLengthMm = Annotated[LengthMm, Field(gt=0)]

#: A point or a shift along the axes of a frame.
PointMm = tuple[LengthMm, LengthMm, LengthMm]


class PoseSpec(Handwritten):
    """A pose as it is written: an axis times an angle in degrees, and lengths with their unit.

    Parameters
    ----------
    rotation_vector_deg
        Axis times angle in degrees.
    translation
        Where the origin of the second frame lies in the first.
    """

    rotation_vector_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation: PointMm

    @property
    def rotation_vector_rad(self) -> tuple[float, float, float]:
        """Axis times angle in radians."""
        x, y, z = (math.radians(v) for v in self.rotation_vector_deg)
        return x, y, z


Model = TypeVar("Model", bound=Handwritten)


def load_toml(path: Path | str, model: type[Model], kind: str) -> Model:
    """Read a file that somebody wrote.

    Parameters
    ----------
    path
        The TOML file.
    model
        What it may say.
    kind
        What people call such a file, for the message.

    Returns
    -------
    Model
        What it says.

    Raises
    ------
    FileError
        When the file cannot be read or is no TOML.
    InputError
        When a key is unknown or missing, or a value cannot be used; all of them are named.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read the {kind} {path}: {reason(error)}") from error
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"the {kind} {path} is no TOML: {error}") from error
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(map(str, e['loc'])) or kind}: {e['msg'].removeprefix('Value error, ')}"
            for e in error.errors(include_url=False)
        )
        raise InputError(f"the {kind} {path} cannot be used: {problems}") from error
