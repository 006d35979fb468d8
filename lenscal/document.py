"""Files that lenscal writes and reads again: JSON with its kind, its version and a checksum.

One place refuses what must not be used: a file that is missing, cut short, altered by hand, of
another kind, or written by a newer version. A document is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import tempfile
from pathlib import Path
from typing import Any

from lenscal.errors import FileError

Json = dict[str, Any]


def write_document(path: Path | str, kind: str, version: int, body: Json) -> Path:
    """Write a document, replacing an older one only when the new one is complete.

    Parameters
    ----------
    path
        The file.
    kind
        What it is, such as ``"lens-map"``.
    version
        Version of the form of its body.
    body
        What JSON can hold; NaN and infinity are refused by the encoder.

    Returns
    -------
    Path
        The file.
    """
    checked = {"lenscal": kind, "version": version, "sha256": digest(body), **body}
    return write_whole(Path(path), json.dumps(checked, indent=1, allow_nan=False) + "\n")


def read_document(path: Path | str, kind: str, newest_version: int) -> Json:
    """Read a document and make sure that it is what was written.

    Parameters
    ----------
    path
        The file.
    kind
        What it has to be.
    newest_version
        The newest version of the form that the caller understands.

    Returns
    -------
    dict
        The body, with its ``"version"``.

    Raises
    ------
    FileError
        When the file is missing, no JSON, of another kind, newer, or altered.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read {path}: {reason(error)}") from error
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise FileError(
            f"{path} is cut short or no JSON (line {error.lineno}: {error.msg}); "
            "take it from where it was made, or make it again"
        ) from error
    found = content.get("lenscal") if isinstance(content, dict) else None
    if found != kind:
        raise FileError(
            f"{path} is {f'a {found}' if found else 'no lenscal document'}, not a {kind}"
        )
    version = content.pop("version", None)
    if not isinstance(version, int) or version > newest_version:
        raise FileError(
            f"{path} has version {version} of the {kind} form; this lenscal reads up to "
            f"{newest_version}: install a newer one"
        )
    stated = content.pop("sha256", None)
    del content["lenscal"]
    if stated != digest(content):
        raise FileError(
            f"{path} was altered after it was written (its checksum does not match); "
            "take it from where it was made, or make it again"
        )
    return {**content, "version": version}


def write_whole(path: Path, text: str) -> Path:
    """Write a text file so that a crash leaves the old one or the new one, never a part.

    Parameters
    ----------
    path
        The file; its folder is made when it is missing.
    text
        Its content.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileError
        When the folder cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=path.parent, prefix=f".{path.name}.", delete=False, encoding="utf-8"
        ) as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        try:
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except OSError:
            os.unlink(file.name)
            raise
    except OSError as error:
        raise FileError(f"cannot write {path}: {reason(error)}") from error
    return path


def digest(body: Json) -> str:
    """Hash a body, independent of the order of its keys and of white space.

    Parameters
    ----------
    body
        What JSON can hold.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    canonical = json.dumps(body, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def versions(*packages: str) -> dict[str, str]:
    """Give the versions of packages that something was made with, for its evidence.

    Parameters
    ----------
    *packages
        Their names, as installed.

    Returns
    -------
    dict
        Version of each.
    """
    return {name: importlib.metadata.version(name) for name in packages}


def reason(error: Exception) -> str:
    """Say in a few words why the operating system refused.

    Parameters
    ----------
    error
        What was raised.

    Returns
    -------
    str
        Such as "No such file or directory".
    """
    return getattr(error, "strerror", None) or str(error)
