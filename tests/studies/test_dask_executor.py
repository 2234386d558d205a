"""A Dask cluster as an executor, with a retry of each lost call alone."""

import os
import signal
import sys
import time
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager

import pytest
import worker_calls as calls
from distributed import Client, LocalCluster
from worker_problems import FAST, LINE, DeadlyProblem, SlowProblem, bits, planned_alone

from tubeplanner import OptionError, PlanStatus, ProblemSpec, dask_executor, plan_many
from tubeplanner.studies import dask_executor as module
from tubeplanner.studies.dask_executor import RetriedAlone
from tubeplanner.studies.rows import run_many


class Lost(Exception):
    """The workers of a call died."""


class Scripted(Executor):
    """An executor whose calls end when a test says so."""

    def __init__(self):
        self.sent = []

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.sent.append((future, fn, args, kwargs))
        return future

    def end(self, number):
        """Answer a call, counted from 0 in the order in which they were sent."""
        future, fn, args, kwargs = self.sent[number]
        future.set_result(fn(*args, **kwargs))

    def lose(self, number):
        """Lose the workers of a call."""
        self.sent[number][0].set_exception(Lost(f"call {number}"))

    def arguments(self):
        return [args for _, _, args, _ in self.sent]


@pytest.fixture
def scripted():
    return Scripted()


@pytest.fixture
def executor(scripted):
    return RetriedAlone(scripted, Lost)


def test_answers_and_errors_are_passed_on(scripted, executor):
    good, bad = executor.submit(int, "7", base=8), executor.submit(int, "x")
    scripted.end(0)
    scripted.sent[1][0].set_exception(ValueError("x"))
    assert good.result(0) == 7
    with pytest.raises(ValueError, match="x"):
        bad.result(0)
    assert len(scripted.sent) == 2


def test_who_died_is_made_again_once_nothing_else_is_made(scripted, executor):
    futures = [executor.submit(abs, -k) for k in range(4)]
    scripted.lose(1)
    scripted.lose(2)
    scripted.end(0)
    assert len(scripted.sent) == 4
    scripted.end(3)
    assert scripted.arguments()[4:] == [(-1,)]  # alone
    scripted.end(4)
    assert scripted.arguments()[5:] == [(-2,)]
    scripted.lose(5)
    assert [future.result(0) for future in futures[:2]] == [0, 1]
    with pytest.raises(Lost, match="call 5"):
        futures[2].result(0)
    assert len(scripted.sent) == 6


def test_calls_that_come_meanwhile_wait(scripted, executor):
    first = executor.submit(abs, -1)
    scripted.lose(0)
    later = [executor.submit(abs, -2), executor.submit(abs, -3)]
    assert scripted.arguments() == [(-1,), (-1,)]
    scripted.end(1)
    assert scripted.arguments()[2:] == [(-2,), (-3,)]
    scripted.end(3)
    scripted.lose(2)
    scripted.end(4)
    assert [future.result(0) for future in (first, *later)] == [1, 2, 3]


def test_a_call_that_is_dropped_is_dropped_below_and_not_made_again(scripted, executor):
    kept, dropped = executor.submit(abs, -1), executor.submit(abs, -2)
    assert dropped.cancel()
    assert scripted.sent[1][0].cancelled()
    scripted.end(0)
    assert kept.result(0) == 1
    assert len(scripted.sent) == 2
    future = executor.submit(abs, -1)  # and what the executor drops is dropped
    assert scripted.sent[2][0].cancel()
    scripted.sent[2][0].set_running_or_notify_cancel()
    with pytest.raises(CancelledError):
        future.result(0)


def test_an_executor_that_refuses_is_heard(scripted, executor):
    def broken(*_):
        raise RuntimeError("closed")

    future = executor.submit(abs, -1)
    scripted.submit = broken
    scripted.lose(0)
    with pytest.raises(RuntimeError, match="closed"):
        future.result(0)
    with pytest.raises(RuntimeError, match="closed"):
        executor.submit(abs, -1)


def test_every_item_comes_of_many(executor, scripted):
    def items():
        yield from (-1, -2)
        scripted.lose(0)
        scripted.end(1)
        scripted.end(2)

    found = run_many(abs, items(), executor)
    assert sorted((done.index, done.value) for done in found) == [(0, 1), (1, 2)]


@contextmanager
def cluster(workers=2, threads=1, **more):
    """Yield a cluster of processes of this machine, seen by nobody else."""
    options = {"dashboard_address": "127.0.0.1:0", "host": "127.0.0.1", "silence_logs": 60}
    with LocalCluster(n_workers=workers, threads_per_worker=threads, **options, **more) as made:
        yield made


@pytest.fixture(scope="module")
def small():
    with cluster() as made:
        yield made


def kill_a_worker(address):
    """Kill the process of one of the cluster's workers."""
    with Client(address) as client:
        os.kill(min(client.run(os.getpid).values()), signal.SIGKILL)


@pytest.mark.slow  # starts a cluster
def test_calls_are_made_by_the_workers_the_same_one_twice(small, tmp_path, monkeypatch):
    path = tmp_path / "calls"
    with dask_executor(small.scheduler_address) as executor:
        made_by = {executor.submit(calls.process_id, k).result() for k in range(4)}
        for future in [executor.submit(calls.noted, path) for _ in range(3)]:
            future.result()
    assert os.getpid() not in made_by
    assert len(path.read_text().splitlines()) == 3
    # An error of the user stays what it is.
    with pytest.raises(OptionError, match=r"^mine$"), dask_executor(small.scheduler_address):
        raise OptionError("mine")
    monkeypatch.setattr(module, "package_hash", lambda: "ours")
    with (
        pytest.raises(OptionError, match=r"2 of 2 workers .* one at tcp://\S+ has other sources"),
        dask_executor(small.scheduler_address),
    ):
        pass


@pytest.mark.slow  # plans on a cluster, and alone
def test_a_worker_that_dies_loses_nothing(small, tmp_path):
    fractions = [round(1 - 0.05 * k, 2) for k in range(6)]
    line, path = ProblemSpec.read(LINE), tmp_path / "calls"

    def spec(fraction):
        changed = line.changed({"tube.radius": f"x{fraction}"})
        return SlowProblem(changed.document, changed.folder, changed.name, str(path))

    with dask_executor(small.scheduler_address) as executor:
        items = plan_many(map(spec, fractions), FAST, executor)
        found = [next(items), next(items)]
        kill_a_worker(small.scheduler_address)
        found += items
    assert sorted(item.index for item in found) == list(range(len(fractions)))
    found.sort(key=lambda item: item.index)
    assert [bits(item.result) for item in found] == planned_alone(LINE, fractions)
    assert len(path.read_text().splitlines()) >= len(fractions)  # some were begun twice


@pytest.mark.slow  # plans on a cluster
def test_what_kills_every_worker_costs_its_item_alone(small):
    line = ProblemSpec.read(LINE)
    deadly = DeadlyProblem(line.document, line.folder, line.name)
    with dask_executor(small.scheduler_address) as executor:
        # So many that others are on the workers that it kills, and are blamed with it at first.
        spec = [line, line, deadly, *[line] * 6]
        items = list(plan_many(spec, FAST, executor))
    found = {item.index: item for item in items}
    assert len(items) == len(found) == len(spec)
    crashed = found.pop(2)
    assert crashed.status == PlanStatus.CRASHED
    assert "KilledWorker" in crashed.message
    assert {item.status for item in found.values()} == {PlanStatus.SUCCESS}


@pytest.mark.slow  # starts a cluster
def test_a_cluster_without_workers_and_a_scheduler_that_is_lost_are_told():
    none = pytest.raises(OptionError, match=r"has no workers after 0.5 s; start some.*--nthreads 1")
    with cluster(workers=0) as made:
        with none, dask_executor(made.scheduler_address, timeout=0.5):
            pass
        made.scale(1)
        lost = pytest.raises(OptionError, match=r"was lost.*begin again with what is left")
        with lost, dask_executor(made.scheduler_address) as executor:
            done = run_many(time.sleep, [0.2] * 40, executor)
            next(done)
            made.close()
            list(done)


def require_no_scheduler(address, reason):
    message = f"no Dask scheduler at {address} .*{reason}.*such as tcp"
    with pytest.raises(OptionError, match=message), dask_executor(address, timeout=0.5):
        pass


@pytest.mark.dear("waits for a scheduler with Dask's event loop")
def test_an_address_without_a_scheduler_is_named():
    """The one client that fails in this process: after it Dask may not start another."""
    require_no_scheduler("nonsense", "missing port number")


@pytest.mark.parametrize("error", [OSError("Timed out"), ValueError("unknown address scheme")])
def test_whatever_a_client_says_of_an_address_is_told(error, monkeypatch):
    def refuse(address, timeout):
        raise error

    monkeypatch.setattr("distributed.Client", refuse)
    require_no_scheduler("foo://127.0.0.1:1", str(error))


@pytest.mark.parametrize(
    ("worker", "threads", "reason"),
    [
        (ModuleNotFoundError("No module named 'a'"), 1, "cannot load tubeplanner (No module na"),
        (("other", "1"), 1, "has other sources of tubeplanner; install there"),
        (("ours", "1"), 2, "has 2 threads, whose plans hold each other up"),
        (("ours", "4"), 1, "has 4 threads for linear algebra, whose answers differ"),
        (("ours", None), 1, "has any number of threads for linear algebra"),
    ],
)
def test_what_is_wrong_with_workers_is_said(worker, threads, reason, monkeypatch):
    monkeypatch.setattr(module, "package_hash", lambda: "ours")
    assert module._fault(worker, threads).startswith(reason)
    assert module._fault(("ours", "1"), 1) == ""


def test_without_dask_the_command_that_installs_it_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    missing = pytest.raises(OptionError, match=r"scheduler tcp://a:1 takes Dask.*\[dask\]")
    with missing, dask_executor("tcp://a:1"):
        pass
