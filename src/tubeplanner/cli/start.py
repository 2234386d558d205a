"""Begin and end of the program: streams, Ctrl-C during import.

Nothing is imported here before Ctrl-C is handled. A Ctrl-C while Python itself starts cannot be.
"""

import gc
import signal
import sys

from tubeplanner.cli.interrupts import SIGNALS, interrupts_noted


def run() -> None:
    """Run the command line on the process's arguments."""
    interrupts_noted()
    _prepare_start()
    from tubeplanner.cli.main import main

    _prepare_streams()
    _silence_libraries()
    _silence_callbacks()
    status = main(sys.argv[1:])
    # The answer is written: from here on, Ctrl-C has nothing to end.
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # else the end of the process searches all objects for unreachable ones
    sys.exit(status)


def _prepare_start() -> None:
    """Leave out work of Python and of pydantic that takes a tenth of the start."""
    import os

    # Nearly all objects of a short process live to its end: few searches for others are enough.
    gc.set_threshold(100_000, 50, 50)
    # A search of all installed distributions for plugins; no reader of files has any.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def _prepare_streams() -> None:
    import os

    # A reader that stops reading ends this process like any other process of a pipe.
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        # A name that the stream's encoding lacks must not undo a success.
        getattr(sys, name).reconfigure(errors="backslashreplace")


def _silence_libraries() -> None:
    """Suppress the warnings of libraries, which mean nothing to a user of the commands."""
    import logging
    import os
    import warnings

    warnings.simplefilter("ignore")
    os.environ["PYTHONWARNINGS"] = "ignore"  # worker processes inherit it
    for name in ("matplotlib", "toppra", "trimesh"):
        logging.getLogger(name).setLevel(logging.ERROR)


def _silence_callbacks() -> None:
    """Suppress the report of a Ctrl-C in a callback of Python itself, such as a finalizer.

    The exception ends there; the signal is remembered.
    """
    report = sys.unraisablehook

    def report_others(unraisable: "sys.UnraisableHookArgs") -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            report(unraisable)

    sys.unraisablehook = report_others
