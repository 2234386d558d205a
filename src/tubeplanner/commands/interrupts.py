"""Ctrl-C: neither lost to a library that swallows it, nor let into the writing of an answer."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def interrupts_remembered() -> Iterator[Callable[[], None]]:
    """Yield a function that raises KeyboardInterrupt if Ctrl-C was pressed since.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; also instead of an exception that followed it.
    """
    pressed: list[int] = []

    def interrupt(number: int, _: object) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    def raise_pending() -> None:
        if pressed:
            raise KeyboardInterrupt

    with _handled_interrupts(interrupt):
        try:
            yield raise_pending
        except Exception:
            # An exception from a library that was interrupted during its import is not an error.
            raise_pending()
            raise


@contextmanager
def interrupts_held() -> Iterator[list[int]]:
    """Delay Ctrl-C while a certified answer is written; yield the list of signals received."""
    held: list[int] = []
    with _handled_interrupts(lambda number, _: held.append(number)):
        yield held


@contextmanager
def _handled_interrupts(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Let a handler take Ctrl-C for a while; outside the main thread signals do not come anyway."""
    try:
        previous = signal.signal(signal.SIGINT, handler)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
