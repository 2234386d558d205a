"""What tests have worker processes do: functions that other processes can import.

This module imports nothing slow: every new process does it again.
"""

import os
import signal
import threading
import time
from pathlib import Path


def process_id(_=None):
    return os.getpid()


def printed(text):
    print(text)
    return text


def variable(name):
    return os.environ.get(name)


def noted(path, seconds=0.0):
    """Append one line with the process and when it began and ended; return the process."""
    begin = time.monotonic()
    time.sleep(seconds)
    with Path(path).open("a") as stream:
        stream.write(f"{os.getpid()} {begin} {time.monotonic()}\n")
    return os.getpid()


def deadly(path=None):
    """Kill the process, after a line in a file."""
    if path is not None:
        noted(path)
    os.kill(os.getpid(), signal.SIGKILL)


def deadly_once(path):
    """Kill the process if the file is not there yet."""
    if not Path(path).exists():
        deadly(path)
    return "alive"


def squared_or_deadly(item):
    """Return a number squared; kill the process for a negative one."""
    if item < 0:
        deadly()
    return item**2


def ended(status):
    os._exit(status)


class Unpicklable(Exception):
    """Its constructor takes two arguments, but it hands on one."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


class Turned(Exception):
    """Comes out of pickle as another kind."""

    def __reduce__(self):
        return ValueError, self.args


def raised(kind, *arguments):
    raise kind(*arguments)


def raised_with_lock():
    error = ValueError("holds a lock")
    error.lock = threading.Lock()
    raise error


def returned_lock():
    return threading.Lock()
