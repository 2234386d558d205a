"""Motion of a problem or a cycle: a trajectory, its sections and marks, planned or read."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, overload

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.errors import FormerName, ProblemError, TrajectoryError
from tubeplanner.outcome import Location
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.legs import Leg, Stop
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach, Detach, Event, Move, Step
from tubeplanner.trajectory.joint_trajectory import MIN_DURATION, JointTrajectory, concatenate
from tubeplanner.trajectory.parts import ATTACH, DETACH, EVENT, MOVE, Mark, part_of, resting

if TYPE_CHECKING:
    from tubeplanner.trajectory.reader import TrajectoryFile

_KINDS = {Move: MOVE, Event: EVENT, Attach: ATTACH, Detach: DETACH}


@dataclass(frozen=True, eq=False)
class MotionSection:
    """A section of a motion under one problem: the motion of a problem, or a leg of a cycle."""

    problem: PlanningProblem
    trajectory: JointTrajectory  # of the problem's joints, in their order, from time zero
    begin: float = 0.0  # in the whole motion [s]
    leg: Leg | None = None  # the leg of the cycle; None: the problem is the whole task

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the moves, or of the problem."""
        return (self.problem.name,) if self.leg is None else self.leg.names

    def inside(self, time: FloatArray) -> IntArray:
        """Return the indices of the times (K,) [s] of the whole motion that are in the section."""
        late = time > self.begin + self.trajectory.duration * (1 + 1e-12)
        return np.flatnonzero((time >= self.begin) & ~late)

    def in_motion(self, where: Location) -> Location:
        """Return a place in the section as a place in the whole motion, with its move."""
        return where if self.leg is None else self.leg.in_cycle(where, self.begin)


@dataclass(frozen=True, eq=False)
class ProblemMotion:
    """Motion of a problem: one section, no steps."""

    task: PlanningProblem
    trajectory: JointTrajectory  # of the problem's joints, in any order; kept in the problem's
    marks: ClassVar[tuple[Mark, ...]] = ()

    def __post_init__(self) -> None:
        reordered = self.trajectory.reordered(self.task.robot.joint_names)
        object.__setattr__(self, "trajectory", reordered)

    @cached_property
    def sections(self) -> tuple[MotionSection, ...]:
        """The whole motion."""
        return (MotionSection(self.task, self.trajectory),)

    @property
    def ended_sections(self) -> tuple[MotionSection, ...]:
        """The whole motion."""
        return self.sections

    @property
    def junctions(self) -> list[FloatArray]:
        """Configurations (n,) at the start and at the end."""
        return [self.trajectory.position(time) for time in (0.0, self.trajectory.duration)]

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The rests before and after the motion, without steps."""
        return (Stop((), (self.task.robot,), (tuple(self.task.holding),)),) * 2


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Motion of one leg."""

    trajectory: JointTrajectory  # of the leg alone, from time zero
    passed: tuple[float, ...] = ()  # begin times of its moves after the first [s]


@dataclass(frozen=True, eq=False)
class CycleMotion:
    """Motion of a cycle: one trajectory, with a mark at the begin of every step.

    Attributes:
        cycle: The cycle.
        trajectory: Of all legs and rests.
        marks: One per step, in order.

    Raises:
        TrajectoryError: On construction, if the marks are not those of the cycle's steps, their
            times are not in order, a move from stop to stop takes no time, or the joints are not
            the cycle's.
    """

    cycle: Cycle
    trajectory: JointTrajectory
    marks: tuple[Mark, ...]

    seams = FormerName("junctions")

    def __post_init__(self) -> None:
        reordered = self.trajectory.reordered(self.cycle.robot.joint_names)
        object.__setattr__(self, "trajectory", reordered)
        steps = [(_KINDS[type(step)], step.name, _setting(step)) for step in self.cycle.steps]
        marks = [(mark.kind, mark.name, mark.setting) for mark in self.marks]
        if marks != steps:
            raise TrajectoryError(f"marks are {_listed(marks)}; the cycle has {_listed(steps)}")
        # Of moves without a stop between them one may take no time: where the tubes before and
        # after it overlap, the hand-overs share an instant.
        legs = zip(self.cycle.legs, self.leg_times, strict=True)
        still = {leg.moves[0].name for leg, (begin, end) in legs if begin == end}
        for mark, (begin, end) in zip(self.marks, self.step_times, strict=True):
            if not 0 <= begin <= end or (mark.kind == MOVE and mark.name in still):
                raise TrajectoryError(
                    f"marks: {mark.kind} '{mark.name}' is from {begin:g} to {end:g} s of a "
                    f"trajectory of {self.trajectory.duration:g} s; give times in order, from "
                    "zero, and every move from stop to stop some"
                )

    def __repr__(self) -> str:
        return (
            f"<CycleMotion of {self.cycle.name}: {self.trajectory.duration:.4f} s, "
            f"{len(self.cycle.legs)} legs, {len(self.marks)} marks>"
        )

    @property
    def step_times(self) -> list[tuple[float, float]]:
        """Begin of each step of the cycle, and begin of the next step or end [s]."""
        return list(pairwise([*(mark.time for mark in self.marks), self.trajectory.duration]))

    @cached_property
    def leg_times(self) -> list[tuple[float, float]]:
        """Begin and end of each leg [s]."""
        spans, k = [], 0
        times = [*(mark.time for mark in self.marks), self.trajectory.duration]
        for leg in self.cycle.legs:
            k += len(leg.before.steps)
            begin, k = times[k], k + len(leg.moves)
            spans.append((begin, times[k]))
        return spans

    @property
    def move_times(self) -> dict[str, tuple[float, float]]:
        """Begin and end of each move [s], by its name."""
        spans = zip(self.marks, self.step_times, strict=True)
        return {mark.name: span for mark, span in spans if mark.kind == MOVE}

    @cached_property
    def junctions(self) -> list[FloatArray]:
        """Configurations (n,) at the start of each leg and at the end of the last leg."""
        times = [*(begin for begin, _ in self.leg_times), self.leg_times[-1][1]]
        return [self.trajectory.position(time) for time in times]

    @cached_property
    def legs(self) -> list[JointTrajectory]:
        """Trajectories of the legs, each from time zero."""
        return [part_of(self.trajectory, *times) for times in self.leg_times]

    @property
    def task(self) -> Cycle:
        """The cycle."""
        return self.cycle

    @cached_property
    def sections(self) -> tuple[MotionSection, ...]:
        """The legs, each under its problem."""
        # Problems are those under the judge, by which the segment at each time is decided.
        sections = []
        for k, (leg, trajectory) in enumerate(zip(self.cycle.legs, self.legs, strict=True)):
            try:
                problem = self.cycle.problem(k, self.junctions[: k + 1])
            except ProblemError:  # the leg begins where there is no solution: it fails, but counts
                problem = self.cycle.problem_from_anywhere(k)
            sections.append(MotionSection(problem, trajectory, self.leg_times[k][0], leg))
        return tuple(sections)

    @cached_property
    def ended_sections(self) -> tuple[MotionSection, ...]:
        """The legs, each under its problem from junction to junction.

        Raises:
            ProblemError: A leg begins or ends where its problem does not allow it.
        """
        problems = self.cycle.problems(self.junctions)
        begins = [begin for begin, _ in self.leg_times]
        rows = zip(problems, self.legs, begins, self.cycle.legs, strict=True)
        return tuple(MotionSection(*row) for row in rows)

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The rest before each leg, and the rest after the last leg."""
        return (*(leg.before for leg in self.cycle.legs), self.cycle.after)


# What is planned, and its motion: with `trajectory`, `sections`, `marks` and `task`.
Task: TypeAlias = PlanningProblem | Cycle
Motion: TypeAlias = ProblemMotion | CycleMotion


def cycle_motion(cycle: Cycle, legs: Sequence[LegMotion]) -> CycleMotion:
    """Return the motion of all legs, in order, with rests for the dwells of events."""
    parts: list[JointTrajectory] = []
    marks: list[Mark] = []
    time = 0.0

    def mark(step: Step, begin: float) -> None:
        marks.append(Mark(begin, _KINDS[type(step)], step.name, _setting(step)))

    def add(part: JointTrajectory) -> None:
        nonlocal time
        parts.append(part)
        time = float(time + part.breakpoints[-1])

    last = legs[-1].trajectory
    junctions = [*(leg.trajectory.position(0.0) for leg in legs), last.position(last.duration)]
    for k, q in enumerate(junctions):
        for step in cycle.stop_at(k).steps:
            mark(step, time)
            if isinstance(step, Event) and step.dwell >= MIN_DURATION:
                add(resting(cycle.robot.joint_names, q, step.dwell))
        if k < len(legs):
            for move, begin in zip(cycle.legs[k].moves, (0.0, *legs[k].passed), strict=True):
                mark(move, time + begin)
            add(legs[k].trajectory)
    return CycleMotion(cycle, concatenate(parts), tuple(marks))


def _setting(step: Step) -> Any:
    return step.setting if isinstance(step, Event) else None


def _listed(steps: Sequence[tuple[str, str, Any]]) -> str:
    words = [[str(part) for part in step if part is not None] for step in steps]
    return ", ".join(" ".join(step) for step in words) or "none"


def move_rows(motion: CycleMotion) -> list[dict[str, Any]]:
    """Return name, begin, end and duration [s] of every move."""
    return [
        {"name": name, "begin": begin, "end": end, "duration": end - begin}
        for name, (begin, end) in motion.move_times.items()
    ]


def read_cycle_motion(path: str | Path, cycle: Cycle) -> CycleMotion:
    """Read the motion of a cycle from a trajectory file with marks.

    Args:
        path: The file, JSON of `write_cycle_motion` or `plan -o`.
        cycle: The cycle.

    Raises:
        TrajectoryError: The file cannot be read; or as `motion_of_file`.
    """
    from tubeplanner.trajectory.reader import read_trajectory_file

    Cycle.require(cycle)
    file = read_trajectory_file(path, cycle.robot.joint_names)
    return motion_of_file(cycle, Path(path), file)


@overload
def motion_of_file(task: PlanningProblem, path: Path, file: "TrajectoryFile") -> ProblemMotion: ...


@overload
def motion_of_file(task: Cycle, path: Path, file: "TrajectoryFile") -> CycleMotion: ...


def motion_of_file(task: Task, path: Path, file: "TrajectoryFile") -> Motion:
    """Return the motion of a problem or a cycle from the content of a trajectory file.

    Args:
        task: The problem or the cycle.
        path: The file; messages name it.
        file: Content of the file.

    Raises:
        TrajectoryError: The file has other joints; of a cycle, no marks, or those of other steps.
    """
    if isinstance(task, PlanningProblem):
        return ProblemMotion(task, file.trajectory)
    steps = tuple(mark for mark in file.marks if mark.is_of_step)
    if not steps:
        raise TrajectoryError(
            f"{path} has no marks, which say when the moves of a cycle begin and what the tool "
            "takes and lets go; CSV and ROS files have none: give the JSON that plan -o writes"
        )
    try:
        return CycleMotion(task, file.trajectory, steps)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from None
