"""Calls of lost workers: which one it was is found out by making each of them alone."""

import threading
from concurrent.futures import CancelledError, Executor, Future

import pytest

from tubeplanner.many.retried_alone import RetriedAlone
from tubeplanner.many.run_many import run_many


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
    assert good.result(0) == 7
    scripted.sent[1][0].set_exception(ValueError("x"))
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


def test_what_the_executor_drops_is_dropped(scripted, executor):
    future = executor.submit(abs, -1)
    assert scripted.sent[0][0].cancel()
    scripted.sent[0][0].set_running_or_notify_cancel()
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
    def lose_and_end():
        scripted.lose(0)
        scripted.end(1)
        scripted.end(2)

    threading.Timer(0.1, lose_and_end).start()
    found = run_many(abs, [-1, -2], executor)
    assert sorted((done.index, done.value) for done in found) == [(0, 1), (1, 2)]
