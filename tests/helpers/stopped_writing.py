"""What happens at the k-th line of the code that writes files, so that it can happen at each."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from tubeplanner import writing as held_signals
from tubeplanner import writing as output_files
from tubeplanner import writing as staged_file

_FILES = {module.__file__ for module in (held_signals, staged_file, output_files)}


@contextmanager
def at_line(which: int | None, act: Callable[[], object]) -> Iterator[list[int]]:
    """Call a function before the k-th line, from 0, of the code that writes files; None: never.

    Yields:
        What has one number for each line that was run.
    """
    lines: list[int] = []

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if frame.f_code.co_filename not in _FILES:
            return None
        if event == "line":
            lines.append(frame.f_lineno)
            if len(lines) - 1 == which:
                act()
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield lines
    finally:
        sys.settrace(before)
