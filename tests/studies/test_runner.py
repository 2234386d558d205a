"""run_many: one function over many items on any executor; rows in order."""

from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from itertools import islice
from multiprocessing import get_context
from threading import Event

import pytest
import worker_calls as calls
from studied import Here

from tubeplanner import OptionError
from tubeplanner.studies import rows as run_many_module
from tubeplanner.studies.rows import Done, RowRun, Variant, run_many


def inverse(number):
    return 1 / number


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor(2)], ids=["none", "threads"])
def test_every_item_is_done_once_and_an_error_is_its_own(executor):
    found = run_many(inverse, [2.0, 0.0, 4.0], executor)
    first, failed, last = sorted(found, key=lambda done: done.index)
    assert (first, last) == (Done(0, 0.5), Done(2, 0.25))
    assert failed.value is None
    assert isinstance(failed.error, ZeroDivisionError)


def test_without_an_executor_items_are_taken_one_by_one():
    taken = []
    done = run_many(inverse, (taken.append(each) or each for each in (1, 2, 3)))
    assert next(done) == Done(0, 1.0)
    assert taken == [1]


class ByHand:
    """An executor whose calls are done when a test says so."""

    def __init__(self):
        self.futures = []

    def submit(self, work, item):
        self.futures.append(Future())
        return self.futures[-1]


def test_results_come_in_the_order_in_which_they_are_done_while_items_are_sent():
    executor = ByHand()

    def items():
        yield from range(3)
        executor.futures[2].set_result("last")
        executor.futures[0].set_result("first")
        yield from range(3, 1000)

    found = run_many(inverse, items(), executor)
    assert next(found) == Done(2, "last")
    assert next(found) == Done(0, "first")
    assert len(executor.futures) < 10
    executor.futures[3].set_result("more")
    assert next(found) == Done(3, "more")


def test_of_many_items_only_some_are_taken_ahead(monkeypatch):
    monkeypatch.setattr(run_many_module, "_SUBMITTED", 5)
    event, taken = Event(), []

    def items():
        while True:
            taken.append(event)
            if len(taken) == 5:
                event.set()
            yield event

    with ThreadPoolExecutor(1) as threads:
        found = run_many(Event.wait, items(), threads)
        assert next(found).value
        assert len(taken) == 5
        found.close()


def test_what_has_not_begun_is_dropped_when_nobody_wants_more():
    executor = ByHand()

    def items():
        yield from range(3)
        executor.futures[1].set_result("one")
        yield 3

    found = run_many(inverse, items(), executor)
    assert next(found).index == 1
    found.close()
    del executor.futures[1]
    assert all(each.cancelled() for each in executor.futures)


@pytest.mark.slow  # starts processes of another kind
def test_a_pool_that_a_dead_process_breaks_is_told():
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    with pool:
        with pytest.raises(OptionError, match=r"BrokenProcessPool.*WorkerProcesses goes on"):
            list(run_many(calls.squared_or_deadly, [1, -1, 2, 3], pool))
        with pytest.raises(OptionError, match="BrokenProcessPool"):  # it was broken before
            next(run_many(calls.squared_or_deadly, [1], pool))


def test_an_executor_that_drops_calls_is_told():
    executor = ByHand()

    def items():
        yield from range(2)
        executor.futures[0].cancel()

    with pytest.raises(OptionError, match="CancelledError"):
        list(islice(run_many(inverse, items(), executor), 3))
    assert executor.futures[1].cancelled()


def doubled(item):
    if isinstance(item, BaseException):
        raise item
    return 2 * item


def run_of(items, executor=None, progress=None, keys=None):
    """Return the answers of a run over items, named from 0, and what ended it."""
    run = RowRun("items", executor, progress, is_here=True)
    with run:
        variants = (Variant(k, each, keys and keys[k]) for k, each in enumerate(items))
        run.run(doubled, variants, len(items))
    return list(run.rows.values()), run.stopped_by


@pytest.mark.parametrize("executor", [None, Here()])
def test_what_is_done_is_counted(executor):
    told = []
    assert run_of([1, 2], executor, told.append) == ([2, 4], None)
    assert [(each.done, each.count, each.planned) for each in told] == [
        *((0, 2, 0), (1, 2, 1), (2, 2, 2)),
    ]
    assert str(told[0]) == "0 of 2 items"


def test_rows_are_in_the_order_of_items_whichever_is_done_first():
    class Backwards(Here):
        """Ends its first call when there is a third."""

        def submit(self, fn, /, *args, **kwargs):
            if self.calls == 0:
                self.calls, self.first, self.answer = 1, Future(), fn(*args)
                return self.first
            if self.calls == 2:
                self.first.set_result(self.answer)
            return super().submit(fn, *args, **kwargs)

    executor = Backwards()
    came = [done.value for done in run_many(doubled, [1, 2, 3], executor)]
    assert came == [4, 2, 6]
    assert run_of([1, 2, 3], Backwards()) == ([2, 4, 6], None)


def test_equal_keys_are_worked_out_once():
    executor = Here()
    assert run_of([1, 2, 5], executor, keys=["a", "b", "a"]) == ([2, 4, 2], None)
    assert executor.calls == 2


@pytest.mark.parametrize("executor", [None, Here()])
def test_an_error_goes_through(executor):
    with pytest.raises(ZeroDivisionError):
        run_of([1, ZeroDivisionError()], executor)


def test_ctrl_c_keeps_the_rows_that_are_done():
    assert run_of([1, 2, KeyboardInterrupt()]) == ([2, 4], "interrupt")
    with pytest.raises(KeyboardInterrupt):
        run_of([KeyboardInterrupt(), 1])
