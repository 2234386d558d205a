"""Rows of sweeps: in order, wherever they are made."""

from concurrent.futures import Future

import pytest

from studied import Here
from tubeplanner.many.run_many import run_many
from tubeplanner.studies.swept_rows import swept_rows


def doubled(item, progress=None):
    if progress is not None:
        progress("begun")
    if isinstance(item, BaseException):
        raise item
    return 2 * item


def swept(items, executor=None, told=None):
    called = f"item {{}} of {len(items)}".format
    return swept_rows(doubled, items, called, executor, None if told is None else told.append)


def test_stages_are_told_here_and_what_is_done_of_others():
    told = []
    assert swept([1, 2], told=told) == ([2, 4], None)
    assert told == ["item 1 of 2: begun", "item 2 of 2: begun"]
    told.clear()
    executor = Here()
    assert swept([1, 2], executor, told) == ([2, 4], None)
    assert executor.calls == 2
    assert told == ["item 1 of 2: done", "item 2 of 2: done"]


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
    assert swept([1, 2, 3], Backwards()) == ([2, 4, 6], None)


def test_an_error_goes_through():
    with pytest.raises(ZeroDivisionError):
        swept([1, ZeroDivisionError()])
    with pytest.raises(ZeroDivisionError):
        swept([1, ZeroDivisionError()], Here())


def test_ctrl_c_keeps_the_rows_that_are_done():
    assert swept([1, 2, KeyboardInterrupt()]) == ([2, 4], "interrupt")
    with pytest.raises(KeyboardInterrupt):
        swept([KeyboardInterrupt(), 1])
