"""Ctrl-C and SIGTERM, kept waiting while something is done that has no half."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def signals_held() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the end, where they are raised again.

    Outside the main thread nothing is held: Python raises no KeyboardInterrupt there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, lambda which, _: came.append(which))
        yield
    finally:
        # SIGINT last: the moment it is let through, nothing is left to be put back.
        for number, handler in reversed(before.items()):
            # None: whoever embeds Python handles it, and Python cannot hand it back.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for which in came:
            signal.raise_signal(which)
