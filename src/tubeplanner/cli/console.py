"""Common to commands: options, exit status, progress, output, written answers, workers.

What loads NumPy is imported when it is called, as `cli` imports this module.
"""

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click

from tubeplanner import __version__
from tubeplanner.cli.interrupts import hold_interrupts, interrupts_remembered
from tubeplanner.errors import OptionError, on_one_line
from tubeplanner.outcome import Place
from tubeplanner.writing import write_files

if TYPE_CHECKING:
    from tubeplanner.task.cycle import Cycle
    from tubeplanner.task.problem import PlanningProblem

# ---- What commands share: options, exit status, progress on a terminal, JSON on standard output.

SUCCESS, INFEASIBLE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

_MAX_MESSAGE = 5000  # [characters]
PATH = click.Path(path_type=Path, dir_okay=False)
INPUT = click.Path(path_type=Path)  # whoever reads it says what is wrong, in one line
FOLDER = click.Path(path_type=Path, file_okay=False)
SLACK = click.option(
    "--slack",
    type=float,
    help="Share of the shortest duration that the motion may take more; 0: the shortest.",
)
TOOL_FRAME = click.option(
    "--tool-frame", help="Link that carries the tool [the end of the longest chain]."
)
PACKAGE_DIR = click.option(
    "--package-dir",
    "package_dirs",
    multiple=True,
    help="Further folder that holds packages of package:// names; repeatable.",
)


def _changes(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> Any:
    """Return the values of an option's uses by their field paths."""
    if not given:
        return {}
    from tubeplanner.task.field_changes import parse_change

    changes: dict[str, Any] = {}
    for text in given:
        path, value = parse_change("--set", text)
        if path in changes:
            raise OptionError(f"--set {path} is given twice; give it once")
        changes[path] = value
    return changes


SET = click.option(
    "--set",
    "changes",
    metavar="FIELD.PATH=VALUE",
    multiple=True,
    callback=_changes,
    help="Change the problem before it is checked, such as tube.radius=x0.5; repeatable.",
)
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


def require_ending(path: Path | None, option: str, endings: tuple[str, ...]) -> None:
    """Check that the name of an output file, if there is one, ends as an option needs.

    Raises:
        OptionError: It does not.
    """
    if path is not None and path.suffix.lower() not in endings:
        raise OptionError(f"{option} {path}: name a file that ends in {' or '.join(endings)}")


def require_page(path: Path | None) -> None:
    """Check that the name of a page ends like one.

    Raises:
        OptionError: It is not.
    """
    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"--html {path}: a page is written; name a file that ends in .html")


def load_timed(
    name: str,
    enter: Callable[[object], None],
    changes: Mapping[str, Any],
    *,
    reads_tube: bool = True,
) -> "tuple[PlanningProblem, float]":
    """Return a problem, changed at some field paths, and the time [s] that reading it took."""
    begin = time.perf_counter()
    enter("loading robot and collision geometry")
    from tubeplanner.task.problem_reader import load_problem

    problem = load_problem(name, reads_tube=reads_tube, changes=changes)
    return problem, time.perf_counter() - begin


def load_either_timed(
    name: str, enter: Callable[[object], None], changes: Mapping[str, Any]
) -> "tuple[PlanningProblem | Cycle, float]":
    """Return a problem or a cycle as `load_timed` does, whichever the file is."""
    begin = time.perf_counter()
    enter("loading robot and collision geometry")
    from tubeplanner.task.cycle_file import load_problem_or_cycle

    loaded = load_problem_or_cycle(name, changes=changes)
    return loaded, time.perf_counter() - begin


@contextmanager
def shown_progress() -> Iterator[Callable[[object], None]]:
    """Yield a function that shows the stage and the time so far on a terminal's standard error.

    Entering a stage also raises a Ctrl-C that a library swallowed, as trimesh does when imported.
    """
    with interrupts_remembered() as raise_pending:
        if not sys.stderr.isatty():
            yield lambda progress: raise_pending()
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        # As it is: brackets in names are no markup.
        columns = (
            SpinnerColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[stage]}", markup=False),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
            whole = shown.add_task("", total=None, stage="")

            def enter(progress: object) -> None:
                raise_pending()
                shown.update(whole, stage=f"{progress} ...")

            yield enter


def fail(status: str, message: str, as_json: bool, code: int, **known: Any) -> int:
    """Report why a run ends without an answer, with other fields of JSON; return exit status."""
    message = printable(message)
    if as_json:
        print_json({**empty_report(status, message, nowhere()), **known})
    else:
        hold_interrupts()
        print(f"tubeplanner: {message}", file=sys.stderr)
    return code


def printable(message: str) -> str:
    """Return a message on one line that a terminal shows as it is, cut where it is very long."""
    text = on_one_line(message[:_MAX_MESSAGE])
    return text if len(message) <= _MAX_MESSAGE else text + " ..."


def say(*values: object, sep: str = " ", end: str = "\n") -> None:
    """Print what a run answers; from here on, Ctrl-C no longer makes it look interrupted.

    Characters that a terminal would obey, as names may hold them, are printed as their codes.
    """
    hold_interrupts()
    lines = sep.join(map(str, values)).split("\n")
    print("\n".join(map(on_one_line, lines)), end=end)


def say_unwritten(*options: str) -> None:
    """Print one line that says which options would have written an answer."""
    say(f"nothing written; to keep the answer, give {' or '.join(options)}")


def empty_report(status: str, message: str, where: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON object of a run, numbers still absent."""
    numbers = ("duration", "phase1_duration", "planning_time", "certificate_time", "loading_time")
    return {
        "status": status,
        "message": message,
        "where": where,
        "proved": None,
        "starts_tried": None,
        **dict.fromkeys(numbers),
        "stopped_by": None,
        "certificate": None,
    }


def nowhere() -> dict[str, Any]:
    """Return the place of a run without one, as JSON values."""
    return Place().as_dict()


def print_json(fields: dict[str, Any], indent: int | None = None) -> None:
    """Print the one JSON object of a run."""
    say(json.dumps(fields, allow_nan=False, indent=indent))


# ---- The files of an answer, written by a command.
#
# Commands hold Ctrl-C back before they draw an answer that took its time. Those whose work is to
# draw enter a stage before they write: it raises a Ctrl-C that a library swallowed, and that may
# have spoiled what it drew.

OTHERS_NOT_TRIED = "; interrupted, the others were not tried"


def write_answer(contents: Mapping[Path, bytes], folder: Path | None = None) -> None:
    """Write the files of an answer; from here on, Ctrl-C no longer makes it look interrupted.

    Args:
        contents: As for `write_files`: all are written, or none.
        folder: Likewise.

    Raises:
        OutputError: They could not be written.
    """
    hold_interrupts()
    write_files(contents, folder)


def say_files(written: list[Path], *options: str) -> None:
    """Print the files that were written, each on its line, or which options write some."""
    if written:
        say(*written, sep="\n")
    else:
        say_unwritten(*options)


def require_used(changes: Iterable[str], slack: float | None) -> None:
    """Raise if an objective is set that counts for nothing, as marks are the shortest durations."""
    from tubeplanner.task.field_changes import is_of_objective

    for path in changes:
        if is_of_objective(path) and slack is None:
            raise OptionError(f"--set {path}: without --slack the shortest motions are planned")


class _Table(Protocol):
    """A result of several plans, such as that of a sweep or of a study."""

    def csv(self) -> str: ...

    def as_dict(self) -> dict[str, Any]: ...


def table_bytes(result: _Table, path: Path) -> bytes:
    """Return a table as its file holds it: CSV or JSON, by the ending."""
    if path.suffix.lower() == ".csv":
        return result.csv().encode()
    return (json.dumps(result.as_dict(), allow_nan=False) + "\n").encode()


# ---- What plans many problems for a command: processes of this machine, or a Dask cluster.


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
    from tubeplanner.studies.dask_executor import dask_executor
    from tubeplanner.studies.worker_processes import WorkerProcesses

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


# ---- The option `--version`: which version runs, and which build of it.


def _say_version(context: click.Context, option: click.Parameter, asked: bool) -> Any:
    if not asked or context.resilient_parsing:
        return
    from tubeplanner.native.library import LIBRARY

    say(f"tubeplanner {__version__}, {LIBRARY.build}")
    context.exit()


VERSION = click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_say_version,
    help="Print the version, whether it runs natively, and why not.",
)
