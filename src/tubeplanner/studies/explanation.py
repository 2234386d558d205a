"""Explain: reason of an infeasibility, remedies or headroom, in words."""

import json
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isinf
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_options, require_between, require_executor
from tubeplanner.errors import FormerName, ProblemError
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import (
    ContradictionError,
    Location,
    PlanningClock,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.change_kinds import (
    band_changes,
    cell_changes,
    end_changes,
    limit_changes,
    tube_changes,
)
from tubeplanner.studies.changes import Change, Question, in_order, rounded
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.remedies import (
    Headroom,
    HeadroomSearch,
    Remedy,
    RemedySearch,
    Trials,
    worsening_changes,
)
from tubeplanner.task.endpoints import Seed, configuration_of
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_reader import solids_of
from tubeplanner.text import short_repr

# ---- Invalid problems: the reason, and the parts that can be drawn.

# Fields left out of a tube that contradicts itself, one group after the other, until it can be
# drawn.
_LEFT_OUT = (
    (),
    ("joint_signs",),
    ("orientations", "rotation_tolerance"),
    ("tool_radius", "tool_speed", "process", "events", "tool_acceleration", "pass_through_points"),
)


@dataclass(frozen=True, eq=False)
class InvalidProblem:
    """The reason for which a problem is invalid, and its parts that can be drawn."""

    message: str  # the reason, in one sentence
    location: Location  # location of the reason
    proved: bool | None  # True if it is proved that there is no motion; None: the input is bad
    configuration: FloatArray | None  # at the place, shape (n,) [rad or m]; None: there is none
    # problem of the same arm, tube and solids; None if the tube cannot be drawn
    drawn: PlanningProblem | None

    __repr__ = short_repr

    @classmethod
    def of(cls, question: Question, error: ProblemError) -> "InvalidProblem":
        """Return the reason and the parts of a problem whose loading raised an error.

        Raises:
            ProblemError: Its solids cannot be built.
        """
        drawn = _drawn(question)
        message = str(error).removeprefix(f"{question.spec.name}: ")
        if isinstance(error, ContradictionError):
            return cls(message, error.location, error.proved, error.configuration, drawn)
        return cls(message, Location(), None, None, drawn)


def _drawn(question: Question) -> PlanningProblem | None:
    """Return a problem of the tube, the solids and a start alone; None without a valid tube."""
    fields, robot, folder = question.fields, question.robot, question.spec.folder
    solids = solids_of(fields, robot, folder)
    assert fields.tube is not None
    q = np.zeros(robot.joint_count)
    for joints in (fields.start.seed, fields.start.joints):
        if joints is not None:
            with suppress(ProblemError):  # it names an unknown joint
                q = configuration_of(robot, "start", joints)
    with suppress(ProblemError):
        values: dict[str, Any] = {**fields.tube.model_dump(), **question.tube_fields}
        for names in _LEFT_OUT:
            for name in names:
                values.pop(name, None)
            with suppress(ProblemError):
                tube = Tube(**values)
                start = Seed(robot.limits.clip(q))
                return PlanningProblem(robot, tube, start, name=question.spec.name, **solids)
    return None


@dataclass(frozen=True, eq=False)
class Explanation:
    """The plan of a problem, and the effect of single changes on it.

    Attributes:
        name: Name of the problem.
        problem: The problem; None if it is invalid.
        result: Result of planning; None if the problem is invalid.
        invalid: The reason for which it is invalid, and its parts that can be drawn; None if valid.
        remedies: Single changes with which it was planned, the smallest for its scale first; empty
            if the problem itself was planned.
        ineffective: Paths of changes that do not help up to their largest sensible size.
        headrooms: Headroom of single quantities; empty unless the problem was planned.
        tried: Number of plans with changes.
        stopped_by: "time_limit" or "interrupt" if that ended the search early; None: it is
            complete.
    """

    name: str
    problem: PlanningProblem | None
    result: PlanResult | None
    invalid: InvalidProblem | None
    remedies: tuple[Remedy, ...] = ()
    ineffective: tuple[str, ...] = ()
    headrooms: tuple[Headroom, ...] = ()
    tried: int = 0
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    in_vain = FormerName("ineffective")
    place = FormerName("location")
    rooms = FormerName("headrooms")
    unposed = FormerName("invalid")

    @property
    def succeeded(self) -> bool:
        """True if the problem can be solved, unchanged or by some change."""
        return self.is_possible or bool(self.remedies)

    @property
    def is_possible(self) -> bool:
        """True if the unchanged problem was planned."""
        return self.result is not None and self.result.succeeded

    @property
    def status(self) -> PlanStatus:
        """Status of the plan; bad_input if the problem is invalid."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def message(self) -> str:
        """The answer of the plan, or the reason for invalidity, as a sentence."""
        outcome = self.result or self.invalid
        return "" if outcome is None else outcome.message

    @property
    def location(self) -> Location:
        """Location of the failure; empty without one."""
        outcome = self.result or self.invalid
        return Location() if outcome is None else outcome.location

    @property
    def configuration(self) -> FloatArray | None:
        """Configuration at the place, shape (n,) [rad or m]; None if not known."""
        outcome = self.result or self.invalid
        return None if outcome is None else outcome.configuration

    @property
    def drawn(self) -> PlanningProblem | None:
        """The problem, or the drawable parts of an invalid problem."""
        return self.problem if self.invalid is None else self.invalid.drawn

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as JSON values, beside the fields of the plan's own JSON."""
        planned = {} if self.result is None else self.result.as_dict()
        proved = {} if self.invalid is None else {"proved": self.invalid.proved}
        return {
            **planned,
            **proved,
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "stopped_by": self.stopped_by,
            "remedies": [remedy.as_dict() for remedy in self.remedies],
            "in_vain": list(self.ineffective),
            "room": [headroom.as_dict() for headroom in self.headrooms],
            "tried": self.tried,
        }


TIME_LIMIT = 60.0  # [s]
_FIRST_PLAN = 0.5  # fraction of the time for the plan of the problem itself, at most


def explain(
    problem: str | Path,
    *,
    changes: Mapping[str, Any] | None = None,
    options: PlanOptions | None = None,
    time_limit: float = TIME_LIMIT,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> Explanation:
    """Return the remedies of an impossible problem, or the headroom of a possible problem.

    The remedies of a problem that cannot be solved are single changes that make it possible: wider
    tolerances, slower speed bands, other joint signs, more effort, wider ranges of joints, a
    lighter payload, moved obstacles, reference points, starts and goals, smaller clearances. Each
    is planned with and narrowed down to 5 %. Of a problem that can be solved, single quantities are
    made worse until no motion results any more.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        changes: Values of fields of the problem, by path, as for `load_problem`; set first.
        options: Planning options; changes are planned with for the shortest motion, quality "fast".
        time_limit: Time after which the search ends with its results so far [s].
        executor: Processes of this machine that try changes side by side, such as
            `WorkerProcesses`; None: this process, one after the other. Answers are the same.
        progress: Called with the current change.

    Returns:
        The results; after Ctrl-C, those so far. Unless the time limit passes they depend on no
        clock but for plans that take a tenth of that time: these count as failed.

    Raises:
        ProblemError: The file cannot be read or contradicts its format, or has no tube.
        RobotError: The robot cannot be planned with.
        OptionError: An option is outside its range.
        KeyboardInterrupt: Ctrl-C before the plan of the problem itself had an answer.
    """
    options = replace(checked_options(options, PlanOptions), time_limit=time_limit)
    require_between(options, 0, None, "time_limit", unit="s")
    require_executor(executor)
    first = replace(options, time_limit=_FIRST_PLAN * time_limit)
    clock = PlanningClock(time_limit, progress)
    spec = ProblemSpec.read(problem).changed(changes)
    question = Question.of(spec)
    try:
        loaded = question.load()
    except ProblemError as error:
        outcome = Explanation(spec.name, None, None, InvalidProblem.of(question, error))
    else:
        outcome = Explanation(spec.name, loaded, plan(loaded, first, progress), None)
    if outcome.result is not None and outcome.result.stopped_by == "interrupt":
        return replace(outcome, stopped_by="interrupt")
    trials = Trials(question, options, clock, executor)
    if outcome.is_possible:
        headrooms = HeadroomSearch(trials, worsening_changes(question))
        _, stopped_by = until_stopped(headrooms.run)
        return replace(
            outcome, headrooms=headrooms.headrooms, tried=trials.count, stopped_by=stopped_by
        )
    location = outcome.location
    if location.position is not None and location.segment is None:
        location = replace(location, segment=question.segment_near(np.array(location.position)))
    shortest = None if outcome.result is None else outcome.result.shortest_duration
    candidates: list[Change] = []
    for kind in (band_changes, tube_changes, limit_changes, cell_changes, end_changes):
        for change in kind(question):
            candidates.append(change)
            if change.kind == "duration" and shortest is not None and shortest > change.before:
                size = shortest - change.before
                estimate = size if rounded(size) >= size else 1.006 * size
                candidates[-1] = replace(change, estimate=estimate)
    search = RemedySearch(trials, in_order(candidates, outcome.status, location))
    _, stopped_by = until_stopped(search.run)
    return replace(
        outcome,
        remedies=search.remedies,
        ineffective=search.ineffective,
        tried=trials.count,
        stopped_by=stopped_by,
    )


# ---- Texts: values as in a problem file, and the changes that do not help.


def setting_text(changes: Mapping[str, Any]) -> str:
    """Return the options --set of values by field path, quoted for a shell."""
    pairs = (f"{path}={_yaml_text(value)}" for path, value in changes.items())
    return " ".join(f"--set {quote(pair)}" for pair in pairs)


def _yaml_text(value: Any) -> str:
    """Return the value of a field in the syntax of a problem file, without line breaks."""
    if isinstance(value, float) and isinf(value):
        return ".inf" if value > 0 else "-.inf"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_yaml_text, value))}]"
    if isinstance(value, dict):
        pairs = (f"{_yaml_text(key)}: {_yaml_text(each)}" for key, each in value.items())
        return f"{{{', '.join(pairs)}}}"
    return json.dumps(value)


def tried_text(value: str, is_close: bool) -> str:
    """Return the nearest value tried on the other side, with a remark if not narrowed.

    Args:
        value: The value in words; empty: none was tried.
        is_close: True if it is near enough.
    """
    return value if is_close else f"{value} (not narrowed)".lstrip()


_NAMED = 3  # at most; of more names the number is given

# Beginning and end of a path, its quantity in words, that of several paths, and the range of the
# change. Between beginning and end is a number or a name.
_KINDS = (
    ("tube.radius", "", "radius of the tube as a whole", "", "up to eleven times"),
    ("tube.radius.", "", "radius of segment", "radius of segments", "up to eleven times"),
    ("tube.cross_section.", ".box", "box of segment", "boxes of segments", "up to eleven times"),
    (
        *("tube.rotation_tolerance.", "", "rotation tolerance of segment"),
        *("rotation tolerance of segments", "up to 3 rad more"),
    ),
    ("tube.tool_radius", "", "tool_radius", "", "down to 0"),
    ("tube.points.", "", "reference point", "reference points", "moved by up to 1 m"),
    ("tube.points", "", "several reference points together", "", "moved by up to 1 m"),
    ("tube.joint_signs.", "", "sign of", "signs of joints", "any other"),
    ("tube.pass_through_points", "", "pass_through_points", "", "none"),
    ("tube.tool_speed", "", "tube.tool_speed", "", "up to eleven times, bands down to a tenth"),
    ("tube.process.steady", "", "process.steady", "", "best"),
    ("robot.limits.effort.", "", "effort of", "effort of joints", "up to eleven times"),
    (
        *("robot.limits.position.", "", "position limits of", "position limits of joints"),
        "by up to a turn",
    ),
    (
        *("robot.limits.position_margin.", "", "position_margin of", "position_margin of joints"),
        "down to nothing",
    ),
    *(
        (begin, "", one, several, "up to eleven times")
        for name in ("tool_speed", "tool_acceleration")
        for begin, one, several in (
            (f"robot.limits.{name}", f"robot.limits.{name}", ""),
            (f"tube.{name}", f"tube.{name}", ""),
            (f"tube.{name}.", f"{name} of segment", f"{name} of segments"),
        )
    ),
    ("robot.payload.mass", "", "payload", "", "down to nothing"),
    (
        *("holding.", "", "holding:", "holding: values"),
        "up to eleven times, masses down to nothing",
    ),
    ("robot.attached.", ".position", "attached solid", "attached solids", "moved by up to 1 m"),
    ("obstacles.", ".position", "obstacle", "obstacles", "moved by up to 1 m"),
    ("clearance", "", "clearance", "", "down to 0"),
    ("clearance.default", "", "clearance", "", "down to 0"),
    ("clearance.pairs.", ".clearance", "clearance of pair", "clearance of pairs", "down to 0"),
    (*("clearance.segments.", "", "clearance of segment", "clearance of segments"), "down to 0"),
    ("start", "", "start", "", "joints, or left to inverse kinematics"),
    ("goal", "", "goal", "", "left out"),
    ("start.joints", "", "start", "", "each joint by up to 1 rad or m"),
    ("goal.joints", "", "goal", "", "each joint by up to 1 rad or m"),
    ("goal.tolerance", "", "goal.tolerance", "", "up to 1 m more"),
    ("start.joints, goal.tolerance", "", "start by joints with goal.tolerance", "", "up to 1 m"),
    ("objective.duration", "", "objective.duration", "", "up to a hundred times more"),
)


def ineffective_text(paths: Iterable[str]) -> str:
    """Return the changes that do not help in words, by the paths of their fields."""
    groups: dict[int | str, list[str]] = {}
    for path in paths:
        for k, (begin, end, _, several, _) in enumerate(_KINDS):
            if path == begin if not several else path.startswith(begin) and path.endswith(end):
                groups.setdefault(k, []).append(path.removeprefix(begin).removesuffix(end))
                break
        else:
            groups[path] = []
    return "; ".join(_words(kind, names) for kind, names in groups.items())


def _words(kind: int | str, names: Sequence[str]) -> str:
    if isinstance(kind, str):  # a path by itself
        return kind
    *_, one, several, how_far = _KINDS[kind]
    if not several:
        return f"{one} ({how_far})"
    if len(names) == 1:
        return f"{one} {names[0]} ({how_far})"
    if all(name.isdecimal() for name in names):
        runs: list[list[int]] = []  # of neighbours: "0-3, 5"
        for number in sorted(map(int, names)):
            if runs and number == runs[-1][-1] + 1:
                runs[-1].append(number)
            else:
                runs.append([number])
        texts = (f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
        return f"{several} {', '.join(texts)} ({how_far})"
    if len(names) > _NAMED:
        *words, noun = several.split()
        return f"{' '.join([*words, str(len(names)), noun])} ({how_far})"
    return f"{several} {', '.join(names)} ({how_far})"
