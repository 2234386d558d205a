"""The rows of a sweep: one for every value, wherever it is planned."""

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from typing import Any, TypeVar

from tubeplanner.arguments import require_executor
from tubeplanner.many.run_many import run_many
from tubeplanner.progress import StoppedBy, require_callback

_Row = TypeVar("_Row")


def swept_rows(
    work: Callable[..., _Row],
    items: Iterable[Any],
    called: Callable[[int], str],
    executor: Executor | None,
    progress: Callable[[object], None] | None,
) -> tuple[list[_Row], StoppedBy | None]:
    """Make a row of every item.

    Args:
        work: Makes one; in this process it is given `progress`, by that name, for its stages.
        items: What of.
        called: What messages call the item of a number, from 1.
        executor: What calls it; None: this process, item by item.
        progress: Told of the stages in this process, or else how far all have come; None: nobody.

    Returns:
        The rows in the order of the items, and "interrupt" if Ctrl-C kept others from being made.

    Raises:
        OptionError: Executor or progress is none.
        KeyboardInterrupt: Ctrl-C before the first row.
        Exception: Whatever work raised.
    """
    require_callback(progress)
    require_executor(executor)
    rows: dict[int, _Row] = {}
    tell = progress or _silent

    def work_here(item: Any) -> _Row:
        name = called(len(rows) + 1)
        return work(item, progress=lambda what: tell(f"{name}: {what}"))

    try:
        for done in run_many(work_here if executor is None else work, items, executor):
            if done.error is not None:
                raise done.error
            assert done.value is not None
            rows[done.index] = done.value
            if executor is not None:
                tell(f"{called(len(rows))}: done")
    except KeyboardInterrupt:
        if not rows:
            raise
        return _in_order(rows), "interrupt"
    return _in_order(rows), None


def _in_order(rows: dict[int, _Row]) -> list[_Row]:
    return [rows[index] for index in sorted(rows)]


def _silent(_: object) -> None:
    return None
