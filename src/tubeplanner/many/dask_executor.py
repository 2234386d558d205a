"""The workers of a Dask cluster as an executor."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from tubeplanner.errors import OptionError
from tubeplanner.extras import not_installed
from tubeplanner.many.content_hash import package_hash
from tubeplanner.many.retried_alone import RetriedAlone

_PATIENCE = 10.0  # [s]


@contextmanager
def dask_executor(address: str, timeout: float = _PATIENCE) -> Iterator[Executor]:
    """Connect to a Dask cluster, for `plan_many` and `study`.

    All workers must have the sources of tubeplanner that this process has, and one thread each,
    for plans and for linear algebra. Those that join later are not looked at. A call that Dask
    gives up, as too many workers died with it, is made once more, alone.

    Args:
        address: Of its scheduler, such as tcp://10.0.0.1:8786.
        timeout: How long to wait for scheduler and workers [s].

    Yields:
        An executor, open for the `with` statement.

    Raises:
        OptionError: Dask is not installed, the scheduler or its workers are not there, workers
            have other sources or other numbers of threads, or the scheduler is lost.
    """
    client = _connected(address, timeout)
    try:
        _check_workers(client, address, timeout)
        yield _executor_of(client)
    except OptionError as error:
        if client.status != "running":
            raise OptionError(
                f"the Dask scheduler at {address} was lost; what is not done yet will not be: "
                "start a scheduler with workers, and begin again with what is left"
            ) from error
        raise
    finally:
        client.close(timeout)


def _connected(address: str, timeout: float) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise OptionError(not_installed("dask", f"scheduler {address}", "Dask")) from None
    try:
        return Client(address, timeout=timeout)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"there is no Dask scheduler at {address} ({error}); give the address that "
            "`dask scheduler` prints, such as tcp://10.0.0.1:8786"
        ) from error


def _executor_of(client: Any) -> Executor:
    from distributed import KilledWorker

    return RetriedAlone(client.get_executor(pure=False), KilledWorker)


def _check_workers(client: Any, address: str, timeout: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout)
    except TimeoutError:
        raise OptionError(
            f"the Dask scheduler at {address} has no workers after {timeout:g} s; start some with "
            f"`dask worker {address} --nworkers auto --nthreads 1`"
        ) from None
    threads = client.nthreads()
    found = client.run(_package_and_threads, on_error="return").items()
    wrong = {worker: said for worker, has in found if (said := _wrong(has, threads.get(worker, 1)))}
    if wrong:
        worker, said = min(wrong.items())
        raise OptionError(
            f"{len(wrong)} of {len(found)} workers of the Dask scheduler at {address} cannot be "
            f"used; the one at {worker} {said}"
        )


def _package_and_threads() -> tuple[str, str | None]:
    """Return, on a worker, what sources it has, and how many threads linear algebra has there."""
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS")
    return package_hash(), threads


def _wrong(has: tuple[str, str | None] | Exception, threads: int) -> str:
    """Return what is wrong with a worker, and what to do; empty if nothing is."""
    if isinstance(has, Exception):
        return f"cannot load tubeplanner ({has}); install there what is installed here"
    sources, linear_algebra = has
    if sources != package_hash():
        return "has other sources of tubeplanner; install there what is installed here"
    if linear_algebra != "1":
        return (
            f"has {linear_algebra or 'any number of'} threads for linear algebra, whose answers "
            "differ in their last bits; set OPENBLAS_NUM_THREADS=1 there, as Dask's nanny does"
        )
    if threads > 1:
        return f"has {threads} threads, whose plans hold each other up; give it `--nthreads 1`"
    return ""
