"""Explain: reason of an infeasibility, remedies or headroom, in words."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isinf
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import given_options, require_between, require_executor
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import (
    ContradictionError,
    Place,
    PlanningClock,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.change_trials import Trials
from tubeplanner.studies.changes import Change, Question, in_order
from tubeplanner.studies.geometry_changes import cell_changes, tube_changes
from tubeplanner.studies.joint_changes import end_changes, limit_changes
from tubeplanner.studies.problem_spec import PosedProblem
from tubeplanner.studies.remedies import Remedy, RemedySearch, Room, RoomSearch, worsening_changes
from tubeplanner.task.endpoints import Seed, configuration_of
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_reader import solids_of
from tubeplanner.text import short_repr

# ---- A problem that cannot be posed: why, and what can be drawn of it.

# What is left out of a tube that contradicts itself, one after the other, until it can be drawn.
_LEFT_OUT = (
    (),
    ("joint_signs",),
    ("orientations", "rotation_tolerance"),
    ("tool_radius", "tool_speed", "pass_through_points"),
)


@dataclass(frozen=True, eq=False)
class Unposed:
    """Why a problem cannot be posed, and what can be drawn of it.

    Attributes:
        message: Why, in one sentence.
        place: Where.
        proved: Whether it is proved that there is no motion; None: it is bad input alone.
        configuration: Of the arm at the place, shape (n,) [rad or m]; None: there is none.
        drawn: A problem of the same arm, tube and solids; None if the tube cannot be drawn.
    """

    message: str
    place: Place
    proved: bool | None
    configuration: FloatArray | None
    drawn: PlanningProblem | None

    __repr__ = short_repr

    @classmethod
    def of(cls, question: Question, error: ProblemError) -> "Unposed":
        """Return what is known of a problem whose loading raised an error.

        Raises:
            ProblemError: Its solids cannot be built.
        """
        drawn = _drawn(question)
        message = str(error).removeprefix(f"{question.posed.name}: ")
        if isinstance(error, ContradictionError):
            return cls(message, error.place, error.proved, error.configuration, drawn)
        return cls(message, Place(), None, None, drawn)


def _drawn(question: Question) -> PlanningProblem | None:
    """Return the problem without what may contradict it: only tube, solids and a start are left."""
    fields, robot, folder = question.fields, question.robot, question.posed.folder
    solids = solids_of(fields, robot, folder)
    for tube in _tubes(question):
        with suppress(ProblemError):
            start = Seed(robot.limits.clip(_given_start(question)))
            return PlanningProblem(robot, tube, start, name=question.posed.name, **solids)
    return None


def _tubes(question: Question) -> Iterator[Tube]:
    assert question.fields.tube is not None
    with suppress(ProblemError):
        given: dict[str, Any] = {**question.fields.tube.model_dump(), **question.given_tube}
        for names in _LEFT_OUT:
            for name in names:
                given.pop(name, None)
            with suppress(ProblemError):
                yield Tube(**given)


def _given_start(question: Question) -> FloatArray:
    """Return the joints (n,) that are given for the start, or for its inverse kinematics."""
    start = question.fields.start
    for given in (start.joints, start.seed):
        if given is not None:
            with suppress(ProblemError):  # it names a joint that is not there
                return configuration_of(question.robot, "start", given)
    return np.zeros(question.robot.joint_count)


# ---- What was found out about a problem: how its plan ended, and what single changes do to it.


@dataclass(frozen=True, eq=False)
class Explanation:
    """What was found out about a problem.

    Attributes:
        name: Of the problem.
        problem: The problem; None if it cannot be posed.
        result: Of planning it; None if it cannot be posed.
        unposed: Why it cannot be posed, and what can be drawn of it; None if it can.
        remedies: Single changes with which it was planned, the smallest for its scale first; empty
            if the problem itself was.
        in_vain: Paths of what was changed, as far as makes sense, and helps nothing.
        rooms: How much worse single quantities may become; empty unless the problem was planned.
        tried: How many changes were planned with.
        stopped_by: "time_limit" or "interrupt" if that ended the search early; None: all was tried.
    """

    name: str
    problem: PlanningProblem | None
    result: PlanResult | None
    unposed: Unposed | None
    remedies: tuple[Remedy, ...] = ()
    in_vain: tuple[str, ...] = ()
    rooms: tuple[Room, ...] = ()
    tried: int = 0
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether the problem can be solved, as it is or by some change."""
        return self.is_possible or bool(self.remedies)

    @property
    def is_possible(self) -> bool:
        """Whether the problem was planned as it is."""
        return self.result is not None and self.result.succeeded

    @property
    def status(self) -> PlanStatus:
        """How planning it ended; bad_input where it cannot be posed."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def message(self) -> str:
        """How planning it ended, or why it cannot be posed, in one sentence."""
        known = self.result or self.unposed
        return "" if known is None else known.message

    @property
    def place(self) -> Place:
        """Where, if there is no answer."""
        known = self.result or self.unposed
        return Place() if known is None else known.place

    @property
    def configuration(self) -> FloatArray | None:
        """Of the arm there, shape (n,) [rad or m]; None if it is not known."""
        known = self.result or self.unposed
        return None if known is None else known.configuration

    @property
    def drawn(self) -> PlanningProblem | None:
        """The problem as it can be drawn, or what is left of one that cannot be posed."""
        return self.problem if self.unposed is None else self.unposed.drawn

    def as_dict(self) -> dict[str, Any]:
        """Return what was found out as JSON values, beside the fields of the plan's own JSON."""
        planned = {} if self.result is None else self.result.as_dict()
        proved = {} if self.unposed is None else {"proved": self.unposed.proved}
        return {
            **planned,
            **proved,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "stopped_by": self.stopped_by,
            "remedies": [remedy.as_dict() for remedy in self.remedies],
            "in_vain": list(self.in_vain),
            "room": [room.as_dict() for room in self.rooms],
            "tried": self.tried,
        }


# ---- Why a problem cannot be solved, and which single changes help; or how much room there is.

TIME_LIMIT = 60.0  # [s]
_FIRST_PLAN = 0.5  # the share of the time that the plan of the problem itself may take


def explain(
    problem: str | Path,
    *,
    changes: Mapping[str, Any] | None = None,
    options: PlanOptions | None = None,
    time_limit: float = TIME_LIMIT,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> Explanation:
    """Find out what makes a problem impossible, or how far it is from being so.

    Of a problem that cannot be solved, single changes that make it possible are looked for: wider
    tolerances, other joint signs, more effort, wider ranges of joints, a lighter payload, moved
    obstacles, reference points, starts and goals, smaller clearances. Each is planned with and
    narrowed down to 5 %. Of a problem that can be solved, single quantities are made worse until
    nothing is found any more.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        changes: Of fields of the problem, by path, as for `load_problem`; made first.
        options: How to plan; changes are planned with for the shortest motion, quality "fast".
        time_limit: After how long the search ends with what it has [s].
        executor: Processes of this machine that try changes side by side, such as
            `WorkerProcesses`; None: this process, one after the other. Answers are the same.
        progress: Called with what is tried.

    Returns:
        What was found. After Ctrl-C, what was found until then. Without the time limit's passing it
        depends on no clock but for plans that take a tenth of that time: they count as failed.

    Raises:
        ProblemError: The file cannot be read or contradicts its format, or has no tube.
        RobotError: The robot cannot be planned with.
        OptionError: An option is outside its range.
        KeyboardInterrupt: Ctrl-C before anything was known of the problem.
    """
    options = replace(given_options(options, PlanOptions), time_limit=time_limit)
    require_between(options, 0, None, "time_limit", unit="s")
    require_executor(executor)
    first = replace(options, time_limit=_FIRST_PLAN * time_limit)
    clock = PlanningClock(time_limit, progress)
    posed = PosedProblem.read(problem).changed(changes)
    question = Question.of(posed)
    try:
        loaded = question.load()
    except ProblemError as error:
        known = Explanation(posed.name, None, None, Unposed.of(question, error))
    else:
        known = Explanation(posed.name, loaded, plan(loaded, first, progress), None)
    if known.result is not None and known.result.stopped_by == "interrupt":
        return replace(known, stopped_by="interrupt")
    trials = Trials(question, options, clock, executor)
    return (_with_room if known.is_possible else _with_remedies)(known, question, trials)


def _with_remedies(known: Explanation, question: Question, trials: Trials) -> Explanation:
    tiers = in_order(_changes(question), known.status, _with_segment(known.place, question))
    search = RemedySearch(trials, tiers)
    stopped_by = _run(search)
    return replace(
        known,
        remedies=search.remedies,
        in_vain=search.in_vain,
        tried=trials.count,
        stopped_by=stopped_by,
    )


def _with_segment(place: Place, question: Question) -> Place:
    """Return a place with the segment that the tool is nearest to, if it is known where that is."""
    if place.position is None or place.segment is not None:
        return place
    return replace(place, segment=question.segment_near(np.array(place.position)))


def _with_room(known: Explanation, question: Question, trials: Trials) -> Explanation:
    search = RoomSearch(trials, worsening_changes(question))
    stopped_by = _run(search)
    return replace(known, rooms=search.rooms, tried=trials.count, stopped_by=stopped_by)


def _run(search: RemedySearch | RoomSearch) -> StoppedBy | None:
    """Search until it is done, the time has passed or Ctrl-C; return what stopped it."""
    return until_stopped(search.run)[1]


def _changes(question: Question) -> Iterator[Change]:
    yield from tube_changes(question)
    yield from limit_changes(question)
    yield from cell_changes(question)
    yield from end_changes(question)


# ---- Values of fields as they are written in a problem file and given to a command.


def setting_text(changes: Mapping[str, Any]) -> str:
    """Return how values by field path are given to a command, quoted for a shell."""
    pairs = (f"{path}={value_text(value)}" for path, value in changes.items())
    return " ".join(f"--set {quote(pair)}" for pair in pairs)


def value_text(value: Any) -> str:
    """Return a value of a field as a problem file may have it, on one line."""
    if isinstance(value, float) and isinf(value):
        return ".inf" if value > 0 else "-.inf"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, dict):
        pairs = (f"{value_text(key)}: {value_text(each)}" for key, each in value.items())
        return f"{{{', '.join(pairs)}}}"
    return json.dumps(value)


def tried_text(value: str, is_close: bool) -> str:
    """Return the nearest value on the other side; whether it is not as near as is asked.

    Args:
        value: In words; empty: none was tried.
        is_close: Whether it is as near as is asked.
    """
    return value if is_close else f"{value} (not narrowed)".lstrip()


# ---- What helps nothing, in few words: changes of one kind together, with how far they went.

_NAMED = 3  # at most, else how many there are

# How a path begins and ends, what it is in words, of several with what these are at the end, and
# how far it was changed. What stands between is a number or a name.
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
    ("tube.joint_signs.", "", "sign of", "signs of joints", "any other"),
    ("tube.pass_through_points", "", "pass_through_points", "", "none"),
    ("robot.limits.effort.", "", "effort of", "effort of joints", "up to eleven times"),
    (
        *("robot.limits.position.", "", "position limits of", "position limits of joints"),
        "by up to a turn",
    ),
    ("robot.payload.mass", "", "payload", "", "down to nothing"),
    ("robot.attached.", ".position", "attached solid", "attached solids", "moved by up to 1 m"),
    ("obstacles.", ".position", "obstacle", "obstacles", "moved by up to 1 m"),
    ("clearance", "", "clearance", "", "down to 0"),
    ("clearance.default", "", "clearance", "", "down to 0"),
    ("clearance.pairs.", ".clearance", "clearance of pair", "clearance of pairs", "down to 0"),
    (
        *("clearance.segments.", "", "clearance of segment", "clearance of segments"),
        "down to 0",
    ),
    ("start", "", "start", "", "left to inverse kinematics"),
    ("goal", "", "goal", "", "left out"),
    ("start.joints", "", "start", "", "each joint by up to 1 rad or m"),
    ("goal.joints", "", "goal", "", "each joint by up to 1 rad or m"),
    ("goal.tolerance", "", "goal.tolerance", "", "up to 1 m more"),
    ("objective.duration", "", "objective.duration", "", "up to a hundred times more"),
)


def in_vain_text(paths: Iterable[str]) -> str:
    """Return what was changed in vain, by the paths of its fields."""
    groups: dict[int | str, list[str]] = {}
    for path in paths:
        kind = _kind_of(path)
        if kind is None:
            groups[path] = []
        else:
            groups.setdefault(kind, []).append(_between(path, kind))
    return "; ".join(_words(kind, names) for kind, names in groups.items())


def _kind_of(path: str) -> int | None:
    """Return which of the kinds a path is of."""
    for k, (begin, end, _, several, _) in enumerate(_KINDS):
        if path == begin if not several else path.startswith(begin) and path.endswith(end):
            return k
    return None


def _between(path: str, kind: int) -> str:
    begin, end = _KINDS[kind][:2]
    return path.removeprefix(begin).removesuffix(end)


def _words(kind: int | str, names: Sequence[str]) -> str:
    if isinstance(kind, str):  # a path by itself
        return kind
    *_, one, several, how_far = _KINDS[kind]
    if not several:
        return f"{one} ({how_far})"
    if len(names) == 1:
        return f"{one} {names[0]} ({how_far})"
    if all(name.isdecimal() for name in names):
        return f"{several} {_ranges(sorted(map(int, names)))} ({how_far})"
    if len(names) > _NAMED:
        *words, noun = several.split()
        return f"{' '.join([*words, str(len(names)), noun])} ({how_far})"
    return f"{several} {', '.join(names)} ({how_far})"


def _ranges(numbers: Sequence[int]) -> str:
    """Return whole numbers in order as "0-3, 5"."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{one[0]}-{one[-1]}" if len(one) > 1 else f"{one[0]}" for one in parts)
