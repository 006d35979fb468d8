"""Foreign text files and their fields, refused with the file, the field and what was wanted."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import yaml

from lenscal.arrays import FloatArray
from lenscal.document import reason
from lenscal.errors import FileError, InputError

_Kind = TypeVar("_Kind", dict[str, Any], list[Any], str)
#: Larger counts are no sizes in px.
_LARGEST: Final = 10**6


def read_text(path: Path) -> str:
    """Read a text file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    FileError
        When it cannot be read, or is no UTF-8 text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read {path}: {reason(error)}") from error


def parse_json(path: Path, text: str, first_line: int = 1) -> Any:
    """Parse JSON.

    Parameters
    ----------
    path
        The file, for the message.
    text
        The text.
    first_line
        Number of its first line in the file.

    Returns
    -------
    object
        What it holds.

    Raises
    ------
    FileError
        When it is no JSON.
    """
    try:
        return json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        line = getattr(error, "lineno", 1) + first_line - 1
        raise FileError(
            f"{path}, line {line}: no JSON ({getattr(error, 'msg', 'nested too deeply')}); was the "
            "file cut short?"
        ) from error


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, which also reads the matrices of OpenCV as the mappings they are."""


def _matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def parse_yaml(path: Path, text: str) -> dict[str, Any]:
    """Parse YAML, of OpenCV or of ROS, as data alone.

    Parameters
    ----------
    path
        The file, for the message.
    text
        The text; OpenCV's own first line ``%YAML:1.0`` is understood.

    Returns
    -------
    dict
        What it holds.

    Raises
    ------
    FileError
        When it is no YAML, or no mapping of names to values.
    """
    try:
        content = yaml.load(re.sub(r"\A%YAML[^\n]*", "", text), Loader=_Loader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error)
        raise FileError(f"{path}{line}: no YAML ({problem}); was the file cut short?") from error
    if not isinstance(content, dict):
        raise FileError(f"{path} holds no names and values; wanted is a YAML mapping")
    return content


def field(path: Path, content: Any, *names: str | int) -> Any:
    """Look up a field within nested ones.

    Parameters
    ----------
    path
        The file, for the message.
    content
        Mappings and lists.
    *names
        The way down.

    Returns
    -------
    object
        What stands there.

    Raises
    ------
    FileError
        When a field is missing.
    """
    value = content
    for i, name in enumerate(names):
        try:
            value = value[name]
        except (KeyError, IndexError, TypeError) as error:
            way = dotted(*names[: i + 1])
            there = f"; there are {', '.join(map(str, value))}" if isinstance(value, dict) else ""
            raise FileError(
                f"{path} lacks the field {way}{there:.200}; was the file cut short, or is it of "
                "another kind?"
            ) from error
    return value


def optional(path: Path, content: dict[str, Any], name: str, kind: type[_Kind]) -> _Kind:
    """Look up a mapping or a list that may be left out.

    Parameters
    ----------
    path
        The file, for the message.
    content
        A mapping.
    name
        The field.
    kind
        What it has to be: a mapping or a list.

    Returns
    -------
    dict or list
        What stands there, or an empty one.

    Raises
    ------
    FileError
        When something else stands there.
    """
    return kind() if name not in content else checked(path, content[name], name, kind)


def checked(path: Path, value: Any, name: str, kind: type[_Kind]) -> _Kind:
    """Check that a field is a mapping or a list.

    Parameters
    ----------
    path
        The file, for the message.
    value
        What stands in the field.
    name
        Name of the field, for the message.
    kind
        What it has to be: a mapping, a list or text.

    Returns
    -------
    dict or list
        The value.

    Raises
    ------
    FileError
        When it is something else.
    """
    if not isinstance(value, kind):
        wanted = {dict: "names with values", list: "a list"}.get(kind, "text")
        raise FileError(f"{path}: {name} must be {wanted}, but is {value!r:.60}")
    return value


def number(path: Path, value: Any, name: str, *, positive: bool = False) -> float:
    """Check that a field is a finite number.

    Parameters
    ----------
    path
        The file, for the message.
    value
        What stands in the field.
    name
        Name of the field, for the message.
    positive
        Whether it has to be greater than zero.

    Returns
    -------
    float
        The number.

    Raises
    ------
    FileError
        When it is none.
    """
    try:
        result = np.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = np.nan
    if not np.isfinite(result) or (positive and result <= 0):
        wanted = "a positive number" if positive else "a finite number"
        raise FileError(f"{path}: {name} must be {wanted}, but is {value!r:.60}")
    return result


def numbers(path: Path, value: Any, name: str, counts: Sequence[int] | None = None) -> FloatArray:
    """Check that a field is a list of finite numbers.

    Parameters
    ----------
    path
        The file, for the message.
    value
        What stands in the field.
    name
        Name of the field, for the message.
    counts
        How many there may be; None for any number.

    Returns
    -------
    FloatArray
        (N,) the numbers.

    Raises
    ------
    FileError
        When it is no list, of another length, or not of numbers.
    """
    allowed = "" if counts is None else f"{' or '.join(map(str, counts))} "
    if not isinstance(value, (list, tuple)) or (counts is not None and len(value) not in counts):
        found = f"{len(value)}" if isinstance(value, (list, tuple)) else f"{value!r:.60}"
        raise FileError(
            f"{path}: {name} must be a list of {allowed}numbers, but found is {found}; was the "
            "file cut short?"
        )
    return np.array([number(path, item, f"{name}[{i}]") for i, item in enumerate(value)])


def whole(path: Path, value: Any, name: str) -> int:
    """Check that a field is a positive whole number, such as a size in px.

    Parameters
    ----------
    path
        The file, for the message.
    value
        What stands in the field.
    name
        Name of the field, for the message.

    Returns
    -------
    int
        The number.

    Raises
    ------
    FileError
        When it is none.
    """
    result = number(path, value, name, positive=True)
    if result != int(result) or result > _LARGEST:
        raise FileError(
            f"{path}: {name} must be a whole number up to {_LARGEST}, but is {value!r:.60}"
        )
    return int(result)


def dotted(*names: str | int) -> str:
    """Name a nested field.

    Parameters
    ----------
    *names
        The way down.

    Returns
    -------
    str
        Such as ``lens.distortion[0]``.
    """
    parts = (f"[{name}]" if isinstance(name, int) else f".{name}" for name in names)
    return "".join(parts).lstrip(".")


@contextmanager
def blamed_on(path: Path) -> Iterator[None]:
    """Turn an `InputError` about the values of a file into a `FileError` that names the file.

    Parameters
    ----------
    path
        The file.

    Yields
    ------
    None
        While its values are used.

    Raises
    ------
    FileError
        In place of an `InputError`.
    """
    try:
        yield
    except InputError as error:
        raise FileError(f"{path}: {error}") from error
