"""What plans many problems for a command: processes of this machine, or a Dask cluster."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import click

from tubeplanner.errors import OptionError


def processes_option(default: str) -> Callable[[Any], Any]:
    """Return the option --processes; `default` says in words what holds without it."""
    return click.option(
        "--processes",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Plan in so many processes [{default}].",
    )


@contextmanager
def workers_of(processes: int | None, scheduler: str | None = None) -> Iterator[Executor]:
    """Yield what plans: so many processes of this machine; None: one per processor.

    Or the workers of a Dask scheduler, which go on when they are not needed any more.

    In the end they are ended, whatever they work on. One process is not this one either: answers
    are the same bits for any number of processes, each with one thread for linear algebra.
    """
    from tubeplanner.many.dask_executor import dask_executor
    from tubeplanner.many.worker_processes import WorkerProcesses

    if scheduler is not None:
        if processes is not None:
            raise OptionError(
                "--processes is for this machine, --scheduler for a cluster; give one"
            )
        with dask_executor(scheduler) as executor:
            yield executor
        return
    with WorkerProcesses(processes) as workers:
        try:
            yield workers
        finally:
            workers.kill()
