"""Ctrl-C: neither lost to a library that swallows it, nor let into the writing of an answer."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def interrupts_remembered() -> Iterator[Callable[[], None]]:
    """Yield a function that raises KeyboardInterrupt if Ctrl-C was pressed since."""
    pressed: list[int] = []

    def interrupt(number: int, _: object) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    def raise_pending() -> None:
        if pressed:
            raise KeyboardInterrupt

    with _handled_interrupts(interrupt):
        yield raise_pending


@contextmanager
def interrupts_held() -> Iterator[list[int]]:
    """Keep Ctrl-C waiting while a certified answer is written; yield a list of what came."""
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
