"""Ctrl-C: remembered while the program starts, held while an answer is written.

SIGTERM, by which schedulers and containers end a program, is treated as Ctrl-C.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass
class _Interrupts:
    """The signals of the current run."""

    pressed: list[int] = field(default_factory=list)  # numbers of the signals before the answer
    # numbers of the signals since the answer was begun; None: it is not begun
    held: list[int] | None = None
    depth: int = 0  # number of enclosing `interrupts_remembered`


_run = _Interrupts()


def interrupts_noted() -> None:
    """Remember Ctrl-C from here on, for the next `interrupts_remembered`, without an exception."""
    _set_handlers(lambda number, _: _run.pressed.append(number))


@contextmanager
def interrupts_remembered() -> Iterator[Callable[[], None]]:
    """Yield a function that raises KeyboardInterrupt if Ctrl-C was pressed in this run.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; also instead of an exception that followed it.
    """

    def interrupt(number: int, _: object) -> None:
        _run.pressed.append(number)
        raise KeyboardInterrupt

    previous: dict[signal.Signals, Any] = {}
    _run.depth += 1
    try:
        if _run.held is None:
            previous = _set_handlers(interrupt)
        yield _raise_pending
    except Exception:
        # A library that was interrupted during its import may raise anything: that is no error.
        _raise_pending()
        raise
    finally:
        _run.depth -= 1
        if _run.held is None or _run.depth == 0:
            for number, handler in previous.items():
                signal.signal(number, handler)
        if _run.depth == 0:
            _run.pressed.clear()
            _run.held = None


def hold_interrupts() -> list[int]:
    """Hold Ctrl-C from here to the end of the run, so that the answer is complete.

    Returns:
        Numbers of the signals since the first call; the list grows with each signal.
    """
    if _run.held is None:
        held: list[int] = []
        if _run.depth > 0:
            _run.held = held
            _set_handlers(lambda number, _: held.append(number))
        return held
    return _run.held


def raise_unheld() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed in this run and is not held yet."""
    if _run.held is None:
        _raise_pending()


def _raise_pending() -> None:
    if _run.pressed:
        raise KeyboardInterrupt


def _set_handlers(handler: Any) -> dict[signal.Signals, Any]:
    """Set the handler of Ctrl-C; return the former handlers.

    Outside the main thread, where signals do not arrive, nothing is set and returned.
    """
    try:
        return {number: signal.signal(number, handler) for number in SIGNALS}
    except ValueError:
        return {}
