"""What a worker process does: call by call, as `worker_processes` sends them, until it is left."""

import os
import pickle
import traceback
from multiprocessing.connection import Connection

_STANDARD_OUTPUT, _STANDARD_ERROR = 1, 2


def serve(descriptor: int) -> None:
    """Answer calls until nobody is left at the other end.

    Args:
        descriptor: Of the connection that calls come from.
    """
    # What libraries print is not to come between the lines of what the parent prints.
    os.dup2(_STANDARD_ERROR, _STANDARD_OUTPUT)
    with Connection(descriptor) as connection:
        while True:
            try:
                call = connection.recv_bytes()
                connection.send_bytes(_answer(call))
            except (EOFError, ConnectionError):
                return


def _answer(call: bytes) -> bytes:
    """Return whether a pickled call returned, and what it returned or raised, pickled."""
    try:
        work, arguments, named = pickle.loads(call)
        return pickle.dumps((True, work(*arguments, **named)))
    except Exception as error:
        return pickle.dumps((False, _travelling(error)))


def _travelling(error: Exception) -> Exception:
    """Return an exception that can be pickled, with the place that it comes from as a note."""
    error.add_note("".join(traceback.format_tb(error.__traceback__)))
    try:
        return _same_kind(pickle.loads(pickle.dumps(error)), error)
    except Exception:  # its constructor takes other arguments, or it holds what cannot be pickled
        return RuntimeError(f"{type(error).__name__}: {error}")


def _same_kind(copy: object, error: Exception) -> Exception:
    if type(copy) is not type(error):
        raise TypeError(f"{type(error).__name__} becomes {type(copy).__name__}")
    return error
