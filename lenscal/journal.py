"""An append-only journal that survives a crash at any moment.

One entry a line: a checksum, then JSON with a running number. Every entry is on the disk before
the next thing happens. A last line that a crash has torn is left out when reading; a line before it
that is not as it was written is an error.
"""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from lenscal.document import Json, reason
from lenscal.errors import FileError


class JournalWriter:
    """The one writer of a journal; use it in a ``with`` statement.

    Parameters
    ----------
    path
        The file. Its folder must exist.
    resume
        False: the file must not exist yet. True: go on with one that does; a last line that a crash
        has torn is cut off.

    Raises
    ------
    FileError
        When the file exists or cannot be made; or, to go on with it, when it is missing, was
        altered, or another program writes to it.
    """

    def __init__(self, path: Path, *, resume: bool = False) -> None:
        verb = "go on with" if resume else "begin"
        try:
            self._file = open(path, "r+b" if resume else "xb")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._file.close()
            raise FileError(
                f"cannot {verb} the journal {path}: another program is writing to it"
            ) from error
        except OSError as error:
            raise FileError(f"cannot {verb} the journal {path}: {reason(error)}") from error
        self._number = 0
        if resume:
            self._number = sum(1 for _ in read_journal(path))
            content = self._file.read()
            self._file.seek(content.rfind(b"\n") + 1)
            self._file.truncate()

    def append(self, entry: Json) -> None:
        """Write an entry and wait until it is on the disk.

        Parameters
        ----------
        entry
            What JSON can hold.
        """
        self._file.write(journal_line(self._number, entry).encode())
        self._file.flush()
        os.fsync(self._file.fileno())
        self._number += 1

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()


def journal_line(number: int, entry: Json) -> str:
    """Seal one entry.

    Parameters
    ----------
    number
        Its running number from 0.
    entry
        What JSON can hold; NaN and infinity are refused by the encoder.

    Returns
    -------
    str
        One line: checksum, number and entry.
    """
    text = json.dumps({"number": number, **entry}, allow_nan=False, separators=(",", ":"))
    return f"{zlib.crc32(text.encode()):08x} {text}\n"


def read_journal(path: Path) -> Iterator[Json]:
    """Read a journal entry by entry.

    Parameters
    ----------
    path
        The file.

    Yields
    ------
    dict
        One entry; a last one that a crash has torn is left out.

    Raises
    ------
    FileError
        When the file cannot be read, or a line before the last one is not as it was written.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise FileError(
            f"cannot read {path}: {reason(error)}; give the folder that a session was recorded to"
        ) from error
    # A whole journal ends with a line end, so that the last piece is empty; a torn one is dropped.
    for number, line in enumerate(lines[:-1]):
        checksum, _, text = line.partition(b" ")
        entry = json.loads(text) if checksum == b"%08x" % zlib.crc32(text) else None
        if not isinstance(entry, dict) or entry.get("number") != number:
            raise FileError(
                f"{path} was altered: line {number + 1} is not as it was written; "
                "restore it from a copy"
            )
        yield entry
