"""Begin and end of the program: streams, Ctrl-C during import.

Nothing is imported here before Ctrl-C is taken care of; what the system does before, such as
starting Python itself, is not in our hands.
"""

import signal
import sys

from tubeplanner.cli.interrupts import SIGNALS, interrupts_noted


def run() -> None:
    """Run the command line on the process's arguments."""
    interrupts_noted()
    from tubeplanner.cli.main import main

    _prepare_streams()
    _silence_libraries()
    _silence_callbacks()
    status = main(sys.argv[1:])
    # All is written: from here on, Ctrl-C has nothing to end.
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _prepare_streams() -> None:
    import os

    # A reader that stops reading ends the process as it ends every other one in a pipe.
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        # A name that the stream's encoding lacks must not undo a success.
        getattr(sys, name).reconfigure(errors="backslashreplace")


def _silence_libraries() -> None:
    """Leave out what the libraries warn of: it means nothing to a user of the commands."""
    import logging
    import os
    import warnings

    warnings.simplefilter("ignore")
    os.environ["PYTHONWARNINGS"] = "ignore"  # worker processes inherit it
    for name in ("matplotlib", "toppra", "trimesh", "yourdfpy"):
        logging.getLogger(name).setLevel(logging.ERROR)


def _silence_callbacks() -> None:
    """Print nothing of a Ctrl-C that met what Python calls by itself, such as a finalizer.

    Its exception ends there; that it was pressed is remembered.
    """
    report = sys.unraisablehook

    def report_others(unraisable: "sys.UnraisableHookArgs") -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            report(unraisable)

    sys.unraisablehook = report_others
