"""Journal: one line of JSON per finished point, durable, checked on reading."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from tubeplanner.documents import parse_json
from tubeplanner.errors import OutputError, shown
from tubeplanner.text import json_value
from tubeplanner.writing import lock

_T = TypeVar("_T")
_BEGIN = b'{"key": "'  # of every line
_MAX_LINE = 10_000_000  # [bytes]
_MAX_REASON = 200  # [characters]


class Journal:
    """A file of answers by key, for use in a `with` statement.

    It survives the end of the process at any instant: each line is on the disk before `add`
    returns, and an incomplete last line is dropped when the journal is opened again.
    """

    def __init__(self, path: Path) -> None:
        """Open or make a journal.

        Raises:
            OutputError: It cannot be opened, another process has it open, or the file is no
                journal; then it stays as it is.
        """
        self._path = path
        self._offsets: dict[str, int] = {}  # of lines in the file [bytes], by key
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise OutputError(f"journal {path} is no regular file; name one")
        try:
            # Appending: writes go to the end, wherever was read before.
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

    def __exit__(self, *exception: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._offsets)

    def __contains__(self, key: str) -> bool:
        return key in self._offsets

    def __getitem__(self, key: str) -> dict[str, Any]:
        """Return the answer of a key, as JSON values."""
        self._file.seek(self._offsets[key])
        answer: dict[str, Any] = json.loads(self._file.readline())["row"]
        return answer

    def made(self, key: str, make: Callable[[Mapping[str, Any]], _T]) -> _T:
        """Return the object made of the answer of a key.

        Args:
            key: The key.
            make: Makes it; raises KeyError, TypeError, ValueError or AttributeError for an invalid
                answer.

        Raises:
            OutputError: The answer is invalid.
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
        """Write an answer to the disk.

        Args:
            key: Key of the planned problem.
            values: Varied values by field path, for readers alone.
            answer: The answer, as JSON values.

        Raises:
            OutputError: It cannot be written.
        """
        fields = {"key": key, "values": json_value(values), "row": answer}
        line = json.dumps(fields, allow_nan=False).encode() + b"\n"
        try:
            offset = self._file.seek(0, os.SEEK_END)
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
        self._offsets[key] = offset

    def _lock(self) -> None:
        try:
            is_locked = lock(self._file.fileno())
        except OSError as error:
            raise OutputError(
                f"journal {self._path} cannot be locked: {error.strerror}; name a table on another "
                "disk"
            ) from error
        if not is_locked:
            raise OutputError(
                f"journal {self._path} is in use by another process; wait for it, end it, or name "
                "another table"
            )

    def _read(self) -> None:
        """Record the position of every line, and drop an incomplete last line."""
        offset = self._file.seek(0)
        lines = iter(lambda: self._file.readline(_MAX_LINE), b"")
        for number, line in enumerate(lines, start=1):
            is_torn = not line.endswith(b"\n") and len(line) < _MAX_LINE
            if is_torn and _BEGIN.startswith(line[: len(_BEGIN)]):
                self._file.truncate(offset)
                break
            try:
                fields: Any = parse_json(line.decode())
                key, row = fields["key"], fields["row"]
                if not isinstance(key, str) or not isinstance(row, dict) or row["status"] is None:
                    raise TypeError
            except (ValueError, KeyError, TypeError):
                raise OutputError(
                    f"{self._path}: line {number} is none of a study's journal; the file stays as "
                    "it is: name another table, or move the file away"
                ) from None
            self._offsets[key] = offset
            offset += len(line)


def require_fields(kind: type, values: Mapping[str, Any]) -> None:
    """Raise unless JSON values fit the fields of a dataclass: a journal may have been edited.

    Args:
        kind: The dataclass.
        values: The values by name, as `json.loads` returns them.

    Raises:
        ValueError: A name is unknown, a required field is missing, a type differs, or a number is
            not finite.
    """
    names = {each.name for each in fields(kind)}
    unknown = [name for name in values if name not in names]
    if unknown:
        raise ValueError(f"it has {unknown[0]!r}")
    TypeAdapter(kind).validate_json(json.dumps(values, allow_nan=False), strict=True)
