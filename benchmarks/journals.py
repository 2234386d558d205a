"""Journals of benchmarks: a line of JSON per task, gone on with, made by one or more processes."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from tubeplanner import WorkerProcesses
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.rows import run_many

Fields: TypeAlias = dict[str, Any]
_Task = TypeVar("_Task", int, str)


def journalled(
    keys: Mapping[_Task, str],
    work: Callable[[_Task], Fields],
    path: Path | None,
    processes: int = 1,
    named: str = "seed",
) -> Iterator[tuple[Fields, bool]]:
    """Yield the line of every task, and whether it is new: first those that a journal has.

    Args:
        keys: Hashes of all that the line of a task depends on, by task.
        work: Makes the line of a task; the line has the task in the field `named`.
        path: The journal, to which new lines are added; None: none.
        processes: How many work; more than one: a task whose process dies costs its line alone.
        named: Field of a line that has its task.
    """
    with nullcontext() if path is None else Journal(path) as journal:
        known = {task: journal[key] for task, key in keys.items() if journal and key in journal}
        yield from ((line, False) for line in known.values())
        tasks = [task for task in keys if task not in known]
        with nullcontext() if processes == 1 else WorkerProcesses(processes) as workers:
            for done in run_many(work, tasks, workers):
                message = f"{type(done.error).__name__}: {done.error}"
                crashed = {named: tasks[done.index], "status": "crash", "message": message}
                line = crashed if done.value is None else done.value
                if journal is not None:
                    journal.add(keys[line[named]], {named: line[named]}, line)
                yield line, True


def recorded(path: Path, named: str = "seed") -> list[Fields]:
    """Return the lines of a journal, whatever sources made them; of a task the last one."""
    rows = path.read_text().splitlines(keepends=True)
    whole = [row for row in rows if row.endswith("\n")]  # another one is being written
    done = [json.loads(row)["row"] for row in whole]
    return list({line[named]: line for line in done}.values())
