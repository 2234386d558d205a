"""Processes of which one that dies costs one call."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import wait
from pathlib import Path

import pytest
import worker_calls as calls

from tubeplanner import OptionError, WorkerDied, WorkerProcesses
from tubeplanner.studies.worker_processes import processors

PATIENCE = 60.0  # [s]


def lines(path):
    """Return what calls noted: their processes, and when they began and ended."""
    found = [line.split() for line in Path(path).read_text().splitlines()]
    return [(int(process), float(begin), float(end)) for process, begin, end in found]


def require_gone(processes):
    end = time.monotonic() + PATIENCE
    while any(Path(f"/proc/{process}").exists() for process in processes):
        assert time.monotonic() < end, "a process lives on"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def two():
    """Two processes that are started once; who wants them to end takes others."""
    with WorkerProcesses(2) as workers:
        yield workers


@pytest.mark.dear("starts a process")
def test_calls_are_answered_by_other_processes_and_a_process_answers_many(capfd, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    with WorkerProcesses(1) as workers:
        found = [workers.submit(calls.process_id) for _ in range(3)]
        assert len({each.result() for each in found}) == 1
        assert found[0].result() != os.getpid()
        assert workers.submit(divmod, 7, 2).result() == (3, 1)
        assert workers.submit(sorted, [1, 2], reverse=True).result() == [2, 1]
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            assert workers.submit(calls.variable, name).result() == "1"  # linear algebra's
        workers.submit(calls.printed, "a remark").result()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "4"
    assert "a remark" not in capfd.readouterr().out
    require_gone([found[0].result()])
    with pytest.raises(RuntimeError, match="shut down"):
        workers.submit(pow, 2, 2)


def test_as_many_as_asked_for_work_at_once(two, tmp_path):
    path = tmp_path / "calls"
    wait([two.submit(calls.noted, path, 0.3) for _ in range(6)])
    assert len({process for process, *_ in lines(path)}) == 2


def test_by_default_there_is_one_for_each_processor():
    assert WorkerProcesses().count == processors() == len(os.sched_getaffinity(0))
    assert repr(WorkerProcesses(3)) == "<WorkerProcesses: 3>"
    for count in (0, -1, 1.5, "2"):
        with pytest.raises(OptionError, match="whole number >= 1"):
            WorkerProcesses(count)


@pytest.mark.dear("starts processes again that die")
def test_one_that_dies_twice_is_given_up_and_loses_no_other(two, tmp_path):
    deaths = tmp_path / "deaths"
    before = [two.submit(pow, each, 2) for each in range(8)]
    once = two.submit(calls.deadly_once, tmp_path / "calls")
    deadly = two.submit(calls.deadly, deaths)
    after = [two.submit(pow, each, 3) for each in range(8)]
    with pytest.raises(WorkerDied, match="was ended by SIGKILL"):
        deadly.result()
    assert once.result() == "alive"  # it is made again
    assert [each.result() for each in before] == [each**2 for each in range(8)]
    assert [each.result() for each in after] == [each**3 for each in range(8)]
    assert len(lines(deaths)) == 2


@pytest.mark.slow  # starts five processes
def test_the_second_time_it_is_alone(tmp_path):
    deaths, others = [tmp_path / "first", tmp_path / "second"], tmp_path / "others"
    with WorkerProcesses(3) as workers:
        futures = [workers.submit(calls.noted, others, 0.2) for _ in range(6)]
        futures += [workers.submit(calls.deadly, each) for each in deaths]
        futures += [workers.submit(calls.noted, others, 0.2) for _ in range(6)]
        wait(futures)
    assert len(lines(others)) == 12
    for each in deaths:
        begins = {}
        for process, begin, _ in lines(each):
            begins.setdefault(process, begin)
        _, alone = sorted(begins.values())
        assert not any(begin < alone < end for _, begin, end in lines(others))


@pytest.mark.dear("starts processes again that end")
def test_a_process_that_ends_by_itself_is_told_by_its_status(two):
    with pytest.raises(WorkerDied, match="ended with status 7"):
        two.submit(calls.ended, 7).result()


def test_a_process_that_cannot_be_started_is_told(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    with (
        WorkerProcesses(1) as workers,
        pytest.raises(WorkerDied, match=r"could not be started: .*/no/such/python"),
    ):
        workers.submit(calls.process_id).result()


def test_what_is_raised_there_is_raised_here_with_its_place(two):
    with pytest.raises(KeyError, match="no such") as caught:
        two.submit(calls.raised, KeyError, "no such").result()
    assert any("worker_calls.py" in note for note in caught.value.__notes__)
    for work in (calls.raised_with_lock, calls.returned_lock):
        with pytest.raises((RuntimeError, TypeError), match="lock"):
            two.submit(work).result()
    for arguments, message in (
        ((calls.Unpicklable, "this", "that"), "Unpicklable: this and that"),
        ((calls.Turned, "round"), "Turned: round"),
    ):
        with pytest.raises(RuntimeError, match=message):
            two.submit(calls.raised, *arguments).result()
    with pytest.raises(Exception, match="pickle"):
        two.submit(lambda: 1).result()  # it cannot be sent, and costs itself alone
    assert two.submit(pow, 2, 2).result() == 4


@pytest.mark.dear("starts a process")
def test_arguments_that_calls_share_are_not_copied_for_those_that_wait(tmp_path):
    class Counted:
        pickled = 0

        def __reduce__(self):
            Counted.pickled += 1
            return int, ()

    counted = Counted()
    with WorkerProcesses(1) as workers:
        first = workers.submit(calls.noted, tmp_path / "calls", 1.0)
        rest = [workers.submit(str, counted) for _ in range(5)]
        assert not first.done()
        assert Counted.pickled == 0
        assert [each.result() for each in rest] == ["0"] * 5


@pytest.mark.dear("starts processes")
def test_the_end_waits_for_calls_unless_they_are_dropped(tmp_path):
    path = tmp_path / "calls"
    workers = WorkerProcesses(1)
    futures = [workers.submit(calls.noted, path, 0.3) for _ in range(4)]
    futures[0].result()
    workers.shutdown(cancel_futures=True)
    done = [each for each in futures if not each.cancelled()]
    assert 1 <= len(done) == len(lines(path)) <= 2
    patient = WorkerProcesses(1)
    futures = [patient.submit(pow, each, 2) for each in range(4)]
    patient.shutdown()
    assert [each.result(0) for each in futures] == [0, 1, 4, 9]


@pytest.mark.dear("starts two processes")
def test_an_exception_in_the_with_statement_ends_all_processes(tmp_path):
    path = tmp_path / "calls"
    with pytest.raises(KeyboardInterrupt), WorkerProcesses(2) as workers:
        wait([workers.submit(calls.noted, path) for _ in range(4)])
        stuck = [workers.submit(time.sleep, 600.0) for _ in range(4)]
        while sum(each.running() for each in stuck) < 2:
            time.sleep(0.01)
        raise KeyboardInterrupt
    require_gone({process for process, *_ in lines(path)})
    assert all(each.done() for each in stuck)
    with pytest.raises(WorkerDied, match=r"ended with all others|SIGKILL"):
        next(each for each in stuck if not each.cancelled()).result()


def test_an_interrupt_while_a_thread_begins_is_not_lost(monkeypatch):
    def start(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), WorkerProcesses(1) as workers:
        monkeypatch.setattr(threading.Thread, "start", start)
        workers.submit(pow, 2, 2)


@pytest.mark.timeout(PATIENCE)
def test_all_processes_may_be_ended_twice_whatever_they_do():
    with pytest.raises(KeyboardInterrupt), WorkerProcesses(2) as workers:
        stuck = [workers.submit(time.sleep, 600.0) for _ in range(4)]
        workers.kill()
        raise KeyboardInterrupt
    assert all(each.done() for each in stuck)


SCRIPT = """
from tubeplanner import WorkerProcesses
with WorkerProcesses(2) as workers:
    print(*[workers.submit(pow, each, 2).result() for each in range(3)])
"""


@pytest.mark.slow  # starts scripts that start processes
@pytest.mark.parametrize("way", ["standard input", "file", "argument"])
def test_a_script_needs_no_guard(way, tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    arguments = {"standard input": [], "file": [str(path)], "argument": ["-c", SCRIPT]}[way]
    done = subprocess.run(
        [sys.executable, *arguments],
        input=SCRIPT if way == "standard input" else None,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.stderr == ""
    assert done.stdout == "0 1 4\n"
