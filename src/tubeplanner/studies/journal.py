"""Journal: one line of JSON per finished point, durable, checked on reading."""

import fcntl
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from pydantic import TypeAdapter

from tubeplanner.documents import parse_json
from tubeplanner.errors import OutputError, shown
from tubeplanner.text import json_value

# ---- The types of what journals hold, checked before it is used: a journal may have been edited.


def require_fields(kind: type, values: Mapping[str, Any]) -> None:
    """Raise unless JSON values, by name, may be the fields of a dataclass.

    Args:
        kind: The dataclass.
        values: As `json.loads` returns them.

    Raises:
        ValueError: A name is unknown, a field that it needs is missing, a type is another one, or a
            number is not finite.
    """
    known = {each.name for each in fields(kind)}
    unknown = [name for name in values if name not in known]
    if unknown:
        raise ValueError(f"it has {unknown[0]!r}")
    TypeAdapter(kind).validate_json(json.dumps(values, allow_nan=False), strict=True)


# ---- The journal of a study: a line of JSON for every point that is done, on the disk at once.

_T = TypeVar("_T")
_BEGIN = b'{"key": "'  # of every line
_MAX_LINE = 10_000_000  # [bytes]
_MAX_REASON = 200  # [characters]


class Journal:
    """A file to which answers are added by key, and in which those of former runs are found.

    To be used in a `with` statement. It survives the end of the process at any instant: a last line
    that was not written to its end is dropped when the journal is opened again.
    """

    def __init__(self, path: Path) -> None:
        """Open a journal, or make one.

        Args:
            path: Of the file.

        Raises:
            OutputError: It cannot be opened, another process has it open, or the file is something
                else, which stays as it is.
        """
        self._path = path
        self._places: dict[str, int] = {}  # of lines in the file [bytes], by key
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise OutputError(f"journal {path} is no regular file; name one")
        try:
            # Appending: what is written goes to the end, wherever was read before.
            self._file = path.open("a+b")
        except OSError as error:
            raise OutputError(
                f"journal {path} cannot be opened: {error.strerror}; name another table"
            ) from error
        try:
            self._lock()
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def __getitem__(self, key: str) -> dict[str, Any]:
        """Return the answer that a key has, as JSON values."""
        self._file.seek(self._places[key])
        answer: dict[str, Any] = json.loads(self._file.readline())["row"]
        return answer

    def made(self, key: str, make: Callable[[Mapping[str, Any]], _T]) -> _T:
        """Return what is made of the answer that a key has.

        Args:
            key: The key.
            make: Makes it; raises KeyError, TypeError, ValueError or AttributeError of what is no
                such answer.

        Raises:
            OutputError: It is none.
        """
        try:
            return make(self[key])
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            reason = shown(" ".join(str(error).split()), _MAX_REASON)
            raise OutputError(
                f"{self._path}: the line of key {shown(key)} holds no answer that this study can "
                f"have ({reason}); delete the line, or name another table"
            ) from None

    def add(self, key: str, values: Mapping[str, Any], answer: Mapping[str, Any]) -> None:
        """Write an answer, and wait until it is on the disk.

        Args:
            key: Of what was planned.
            values: By field path: for readers alone.
            answer: As JSON values.

        Raises:
            OutputError: It cannot be written.
        """
        fields = {"key": key, "values": json_value(values), "row": answer}
        line = json.dumps(fields, allow_nan=False).encode() + b"\n"
        try:
            place = self._file.seek(0, os.SEEK_END)
            self._file.write(line)
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            # Closed beneath its buffer: else closing it later tried to write the rest once more.
            self._file.raw.close()
            raise OutputError(
                f"journal {self._path} cannot be written: {error.strerror}; make room, or name a "
                "table on another disk; what it has is kept"
            ) from error
        self._places[key] = place

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"journal {self._path} is in use by another process; wait for it, end it, or name "
                "another table"
            ) from None
        except OSError as error:
            raise OutputError(
                f"journal {self._path} cannot be locked: {error.strerror}; name a table on another "
                "disk"
            ) from error

    def _read(self) -> None:
        """Note where every line begins, and drop a torn one at the end."""
        place = self._file.seek(0)
        lines = iter(lambda: self._file.readline(_MAX_LINE), b"")
        for number, line in enumerate(lines, start=1):
            is_torn = not line.endswith(b"\n") and len(line) < _MAX_LINE
            if is_torn and _BEGIN.startswith(line[: len(_BEGIN)]):
                self._file.truncate(place)
                break
            self._places[self._key(number, line)] = place
            place += len(line)

    def _key(self, number: int, line: bytes) -> str:
        try:
            fields: Any = parse_json(line.decode())
            key, row = fields["key"], fields["row"]
            if not isinstance(key, str) or not isinstance(row, dict) or row["status"] is None:
                raise TypeError
        except (ValueError, KeyError, TypeError):
            raise OutputError(
                f"{self._path}: line {number} is none of a study's journal; the file stays as it "
                "is: name another table, or move the file away"
            ) from None
        return key
