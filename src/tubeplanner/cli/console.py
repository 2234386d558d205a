"""Common parts of commands: options, exit status, progress, output, files of an answer, workers.

Modules that load NumPy are imported inside functions, as the group of commands imports this module.
"""

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from tubeplanner import __version__
from tubeplanner.cli.interrupts import hold_interrupts, interrupts_remembered, raise_unheld
from tubeplanner.errors import OptionError, OutputError, TubePlannerError, on_one_line
from tubeplanner.outcome import Location
from tubeplanner.writing import require_ending, require_writable, write_files

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from tubeplanner.task.motion import Task
    from tubeplanner.task.problem import PlanningProblem

_Loaded = TypeVar("_Loaded")

# ---- Options and their checks; exit status.

SUCCESS, INFEASIBLE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

PATH = click.Path(path_type=Path, dir_okay=False)
PAGE_ENDINGS = ".html", ".htm"
INPUT = click.Path(path_type=Path)  # the reader of the file reports faults, in one line
FOLDER = click.Path(path_type=Path, file_okay=False)
SLACK = click.option(
    "--slack",
    type=float,
    help="Allowed excess over the shortest duration, as a fraction; 0: the shortest motion.",
)
TOOL_FRAME = click.option(
    "--tool-frame", help="Link of the tool [default: the end of the longest chain]."
)
PACKAGE_DIR = click.option(
    "--package-dir",
    "package_dirs",
    multiple=True,
    help="Further folder with the packages of package:// names; repeatable.",
)


def _arguments(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> Any:
    """Return the values of --xacro-arg by name."""
    arguments: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise OptionError(f"--xacro-arg {text}: give NAME=VALUE")
        if name in arguments:
            raise OptionError(f"--xacro-arg {name} is given twice; give it once")
        arguments[name] = value
    return arguments


XACRO_ARG = click.option(
    "--xacro-arg",
    "xacro_args",
    metavar="NAME=VALUE",
    multiple=True,
    callback=_arguments,
    help="Value of an <xacro:arg>, for a URDF that ends in .xacro; repeatable.",
)


def _changes(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> Any:
    """Return the values of --set by field path."""
    if not texts:
        return {}
    from tubeplanner.task.field_changes import parse_change

    changes: dict[str, Any] = {}
    for text in texts:
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
    help="Change a field of the problem, such as tube.radius=x0.5; repeatable.",
)
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


def _say_version(context: click.Context, option: click.Parameter, requested: bool) -> Any:
    if not requested or context.resilient_parsing:
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
    help="Print the version, and `native` or `pure Python` with the reason.",
)


def processes_option(default: str) -> Callable[[Any], Any]:
    """Return the option --processes; `default` describes the behaviour without the option."""
    return click.option(
        "--processes",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Number of processes [default: {default}].",
    )


def require_used(changes: Iterable[str], slack: float | None) -> None:
    """Raise OptionError if --set changes an objective that the shortest motions ignore."""
    from tubeplanner.task.field_changes import is_of_objective

    for path in changes:
        if is_of_objective(path) and slack is None:
            raise OptionError(f"--set {path}: without --slack the shortest motions are planned")


# ---- Loading and progress.


def load_timed(
    name: str,
    enter: Callable[[object], None],
    changes: Mapping[str, Any],
    *,
    reads_tube: bool = True,
) -> "tuple[PlanningProblem, float]":
    """Return a problem with changes by field path, and the loading time [s]."""
    from tubeplanner.task.problem_reader import load_problem

    load = partial(load_problem, name, reads_tube=reads_tube, changes=changes)
    return _timed(load, enter)


def load_task_timed(
    name: str,
    enter: Callable[[object], None],
    changes: Mapping[str, Any],
    *,
    reads_tube: bool | None = True,
) -> "tuple[Task, float]":
    """Return the problem or cycle of a file, changed by field path, and the loading time [s]."""
    from tubeplanner.task.cycle_file import load_problem_or_cycle

    load = partial(load_problem_or_cycle, name, reads_tube=reads_tube, changes=changes)
    return _timed(load, enter)


def _timed(load: Callable[[], _Loaded], enter: Callable[[object], None]) -> tuple[_Loaded, float]:
    begin = time.perf_counter()
    enter("loading robot and collision geometry")
    return load(), time.perf_counter() - begin


@contextmanager
def shown_progress() -> Iterator[Callable[[object], None]]:
    """Yield a function that shows the stage and the time so far on a terminal's standard error.

    The function also raises a Ctrl-C that a library swallowed, as trimesh does when imported.
    """
    with interrupts_remembered() as raise_pending:
        if not sys.stderr.isatty():
            yield lambda progress: raise_pending()
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        # Without markup: brackets in names are no tags.
        stage_column = TextColumn("{task.fields[stage]}", markup=False)
        columns = (SpinnerColumn(), TimeElapsedColumn(), stage_column)
        with Progress(*columns, console=Console(stderr=True), transient=True) as display:
            task = display.add_task("", total=None, stage="")

            def enter(progress: object) -> None:
                raise_pending()
                display.update(task, stage=f"{progress} ...")

            yield enter


# ---- Output: JSON, lines, files. From the first line on, Ctrl-C no longer ends the run.

OTHERS_NOT_TRIED = "; interrupted, the others were not tried"
_MAX_MESSAGE = 5000  # [characters]


def fail(status: str, message: str, as_json: bool, code: int, **fields: Any) -> int:
    """Report the reason of a run without an answer, with more fields if JSON; return exit code."""
    message = printable(message)
    if as_json:
        print_json({**empty_report(status, message), **fields})
    else:
        hold_interrupts()
        print(f"tubeplanner: {message}", file=sys.stderr)
    return code


def printable(message: str) -> str:
    """Return a message as a single printable line, shortened if very long."""
    text = on_one_line(message[:_MAX_MESSAGE])
    return text if len(message) <= _MAX_MESSAGE else text + " ..."


def say(*values: object, sep: str = " ", end: str = "\n") -> None:
    """Print the answer of a run, and hold Ctrl-C from here on.

    Control characters, which names may contain, are printed as codes.
    """
    hold_interrupts()
    lines = sep.join(map(str, values)).split("\n")
    print("\n".join(map(on_one_line, lines)), end=end)


def say_unwritten(*options: str) -> None:
    """Print a line with the options that would have written the answer, unless they failed to."""
    if not answer_files().failures:
        say(f"nothing written; to keep the answer, give {' or '.join(options)}")


def say_files(requested: Sequence[Path], *options: str) -> None:
    """Print the written files in lines; without files, print the options that write files."""
    if requested:
        paths = [path for path in requested if path not in answer_files().failures]
        say(*paths, sep="\n", end="\n" if paths else "")
    else:
        say_unwritten(*options)


def empty_report(status: str, message: str, where: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the JSON object of a run without its numbers; by default, its place is empty."""
    numbers = (
        "duration",
        "bound",
        "phase1_duration",
        "planning_time",
        "certificate_time",
        "loading_time",
    )
    return {
        "status": status,
        "message": message,
        "where": Location().as_dict() if where is None else where,
        "proved": None,
        "starts_tried": None,
        **dict.fromkeys(numbers),
        "stopped_by": None,
        "certificate": None,
    }


def print_json(fields: dict[str, Any], indent: int | None = None) -> None:
    """Print the JSON object of a run; an unwritten file makes the status `bad_input`."""
    files = answer_files()
    if files.failures:
        message = "; ".join(filter(None, [fields["message"], files.message]))
        fields = {**fields, "status": "bad_input", "message": message, **files.as_dict()}
    say(json.dumps(fields, allow_nan=False, indent=indent))


# ---- Files of an answer, in the order of their worth: what fails costs nothing that goes before.


class Output(NamedTuple):
    """An output file."""

    kind: str  # noun for it
    path: Path | None  # where it goes; None: it is not requested
    content: Callable[[Path], bytes]  # function from the path to the content


@dataclass
class AnswerFiles:
    """The output files of a run."""

    written: dict[Path, str] = field(default_factory=dict)  # kinds of written files, by path
    failures: dict[Path, str] = field(default_factory=dict)  # sentences on the others, by path

    @property
    def saved(self) -> str:
        """The end of a message with the written files; empty without written files."""
        listed = ", ".join(f"{kind} {path}" for path, kind in self.written.items())
        return listed and f"; saved: {listed}"

    @property
    def message(self) -> str:
        """Unwritten files with the reasons, and written files."""
        return "; ".join(dict.fromkeys(self.failures.values())) + self.saved

    def as_dict(self) -> dict[str, Any]:
        """Return the paths and reasons as JSON values."""
        failures = {str(path): reason for path, reason in self.failures.items()}
        return {"written": list(map(str, self.written)), "not_written": failures}


def answer_files() -> AnswerFiles:
    """Return the output files of the current run, which `main` made."""
    context = click.get_current_context(silent=True)
    return (context and context.find_object(AnswerFiles)) or AnswerFiles()


def write_answer(*outputs: Output, folder: Path | None = None) -> None:
    """Write the requested files in turn; hold Ctrl-C from the first file on.

    A file that cannot be made or written is a failure of the run's `AnswerFiles`, and the others
    are written nevertheless: `main` reports it. A command whose work takes long holds Ctrl-C
    before. A command that only draws enters a stage when a picture is made: this raises a Ctrl-C
    that a library swallowed, which may have spoiled the picture.

    Args:
        outputs: The most valuable first: trajectories, tables, figures, pages.
        folder: As for `write_files`, of the files in it.
    """
    files = answer_files()
    for kind, path, content in outputs:
        if path is None:
            continue
        try:
            data = content(path)
            hold_interrupts()
            write_files({path: data}, folder if path.parent == folder else None)
        except OutputError as error:
            files.failures[path] = str(error)
        except Exception as error:
            raise_unheld()  # a library that was interrupted may raise anything
            own = isinstance(error, TubePlannerError)
            reason = str(error) if own else internal_error(error)
            files.failures[path] = f"output {path} could not be made: {reason}"
        else:
            files.written[path] = kind


def internal_error(error: Exception) -> str:
    """Return the message for an error of this package itself."""
    kind = type(error).__name__
    report = "please report it with the problem file and what `tubeplanner info` prints"
    return f"internal error, {report}: {kind}: {error}"


def unless_failed(path: Path | None) -> Path | None:
    """Return the path of a requested file, or None if writing failed."""
    return None if path in answer_files().failures else path


class Request(NamedTuple):
    """An output file that an option may request."""

    kind: str  # noun for it
    path: Path | None  # where it goes; None: it is not requested
    # the option, perhaps with an example of a value; empty: not named where nothing is written
    option: str = ""
    endings: tuple[str, ...] = ()  # allowed endings of its name; none: any


class OutputFiles:
    """The output files that a command's options request, the most valuable first.

    Attributes:
        paths: Of the requested files, by kind.
        written: Of the written files, by kind.

    Raises:
        OptionError: On construction, if a name has another ending than its option allows.
        OutputError: On construction, if a file cannot be written, or is one of the inputs.
    """

    def __init__(self, *requests: Request, inputs: Iterable[str | Path] = ()) -> None:
        for each in requests:
            require_ending(each.path, each.option.partition(" ")[0], each.endings)
        self.paths = {each.kind: each.path for each in requests if each.path is not None}
        self._options = [each.option for each in requests if each.option]
        self.written: dict[str, Path] = {}
        self.spare(inputs)

    def spare(self, inputs: Iterable[str | Path]) -> None:
        """Raise OutputError if a file cannot be written, or is one of the inputs."""
        require_writable(list(self.paths.values()), list(map(Path, inputs)))

    def write(
        self,
        contents: Mapping[str, Callable[[Path], bytes]],
        *,
        is_held: bool = True,
    ) -> None:
        """Write the requested files from functions by kind; hold Ctrl-C before, unless told not."""
        if is_held:
            hold_interrupts()
        kinds = [kind for kind in self.paths if kind in contents]
        write_answer(*(Output(kind, self.paths[kind], contents[kind]) for kind in kinds))
        self.written = {
            kind: path for kind, path in self.paths.items() if kind in kinds and unless_failed(path)
        }

    def path_text(self, kind: str) -> str | None:
        """Return the path of a written file for JSON; None: it is not written."""
        return str(self.written[kind]) if kind in self.written else None

    def say(self) -> None:
        """Print the written files; without files, print the options that would write files."""
        for kind, path in self.written.items():
            say(f"{kind}: {path}")
        if not self.written:
            say_unwritten(*self._options)


class TableFiles(OutputFiles):
    """Table and figure of several plans, as the options -o and --plot request.

    Attributes:
        more: Paths of further files, which are written with the table.
    """

    def __init__(
        self, table: Path | None, figure: Path | None, input_: str, journal: Path | None = None
    ) -> None:
        from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS

        super().__init__(
            Request("table", table, "-o TABLE.csv", (".csv", ".json")),
            Request("journal", journal),
            Request("figure", figure, "--plot", FIGURE_ENDINGS),
            inputs=[input_],
        )
        self.more: list[Path] = []

    def write_result(
        self, result: Any, plot: Callable[[Any], Any], *more: Output, folder: Path | None = None
    ) -> None:
        """Write the files, more files first; `folder` as for `write_answer`."""
        from tubeplanner.output.figures.figure_files import figure_file

        def table(path: Path) -> bytes:
            if path.suffix.lower() == ".csv":
                return bytes(result.csv().encode())
            return (json.dumps(result.as_dict(), allow_nan=False) + "\n").encode()

        hold_interrupts()
        self.more = [each.path for each in more if each.path is not None]
        write_answer(
            *more,
            Output("table", self.paths.get("table"), table),
            Output(
                "figure", self.paths.get("figure"), lambda path: figure_file(plot(result), path)
            ),
            folder=folder,
        )

    def answer(
        self,
        result: Any,
        message: str,
        loading_time: float | None,
        text: Callable[[], str] | None,
        *options: str,
    ) -> int:
        """Print the result: as text, or as JSON if there is none; return the exit status."""
        if text is None:
            status = "success" if result.succeeded else "no_trajectory"
            report = {**empty_report(status, message), "loading_time": loading_time}
            print_json({**report, **result.as_dict()})
        else:
            say(text(), message, sep="\n")
            paths = [*self.paths.values(), *self.more]
            say_files(paths, "-o TABLE.csv", "--plot", *options)
        return SUCCESS if result.succeeded else INFEASIBLE


@contextmanager
def workers_of(processes: int | None, scheduler: str | None = None) -> Iterator["Executor"]:
    """Yield the executor of plans: processes of this machine, or workers of a Dask scheduler.

    Processes are killed in the end, whatever they work on; the workers of a scheduler are not. A
    single process is not this one either: answers are the same bits for any number of processes,
    each with one thread for linear algebra.

    Args:
        processes: Their number; None: one per processor.
        scheduler: Address of a Dask scheduler, if any.

    Raises:
        OptionError: Both arguments are given.
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
