"""The journal of a study: a line of JSON for every point that is done, on the disk at once."""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from tubeplanner.errors import OutputError
from tubeplanner.studies.json_values import json_value

_BEGIN = b'{"key": "'  # of every line


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
        try:
            # Appending: what is written goes to the end, wherever was read before.
            self._file = path.open("a+b")
        except OSError as error:
            raise OutputError(f"journal {path} cannot be opened: {error.strerror}") from error
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
            raise OutputError(
                f"journal {self._path} cannot be written: {error.strerror}; what it has is kept"
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
        for number, line in enumerate(self._file, start=1):
            if not line.endswith(b"\n") and _BEGIN.startswith(line[: len(_BEGIN)]):
                self._file.truncate(place)
                break
            self._places[self._key(number, line)] = place
            place += len(line)

    def _key(self, number: int, line: bytes) -> str:
        try:
            fields = json.loads(line)
            key, row = fields["key"], fields["row"]
            if not isinstance(key, str) or row["status"] is None:
                raise TypeError
        except (ValueError, KeyError, TypeError):
            raise OutputError(
                f"{self._path}: line {number} is none of a study's journal; the file stays as it "
                "is: name another table, or move the file away"
            ) from None
        return key
