"""Read-only float64 arrays of a stated shape: what every record is made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lenscal.errors import InputError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

Shape = tuple[int | str, ...]


def frozen_array(
    name: str, value: npt.ArrayLike, shape: Shape, *, finite: bool = True
) -> FloatArray:
    """Copy a value into a read-only float64 array and check it once.

    Parameters
    ----------
    name
        What the caller calls the value; it opens the error message.
    value
        Anything that numpy turns into numbers.
    shape
        The shape wanted. A number is an exact length, a word such as ``"N"`` any length, and a
        leading ``"..."`` any number of axes.
    finite
        Whether NaN and infinity are refused.

    Returns
    -------
    FloatArray
        A copy that nobody can write to.

    Raises
    ------
    InputError
        When the value is not numeric, has another shape, or is not finite.
    """
    try:
        # What is frozen already, and is no window on something that is not, needs no copy.
        frozen = isinstance(value, np.ndarray) and value.base is None and not value.flags.writeable
        array = (np.asarray if frozen else np.array)(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name} must be an array of numbers of shape {_shown(shape)}; given is {value!r:.60}"
        ) from error
    if not _fits(array.shape, shape):
        raise InputError(
            f"{name} must have shape {_shown(shape)}, but has shape {_shown(array.shape)}"
        )
    if finite and not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))
        raise InputError(
            f"{name} must be finite, but {len(bad)} of {array.size} values are NaN or infinite, "
            f"the first at index {tuple(int(i) for i in bad[0])}"
        )
    array.setflags(write=False)
    return array


def positive(name: str, value: float, unit: str = "") -> float:
    """Check that a number is finite and greater than zero.

    Parameters
    ----------
    name
        What the caller calls the number.
    value
        The number.
    unit
        Its unit, for the message.

    Returns
    -------
    float
        The number.

    Raises
    ------
    InputError
        When it is zero, negative, NaN or infinite.
    """
    number = float(value)
    if not (np.isfinite(number) and number > 0):
        raise InputError(
            f"{name} must be a positive number, but is {value}{' ' * bool(unit)}{unit}"
        )
    return number


def _fits(actual: tuple[int, ...], wanted: Shape) -> bool:
    if wanted and wanted[0] == "...":
        wanted = wanted[1:]
        if len(actual) < len(wanted):
            return False
        actual = actual[len(actual) - len(wanted) :]
    return len(actual) == len(wanted) and all(
        isinstance(w, str) or a == w for a, w in zip(actual, wanted, strict=True)
    )


def _shown(shape: Shape) -> str:
    return f"({', '.join(str(s) for s in shape)}{',' if len(shape) == 1 else ''})"
