"""CycleMotion: one trajectory with marks, planned or read from a file."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.steps import Attach, Detach, Event, Move, Step
from tubeplanner.trajectory.joint_trajectory import MIN_DURATION, JointTrajectory
from tubeplanner.trajectory.parts import ATTACH, DETACH, EVENT, MOVE, Mark, joined, part_of, resting
from tubeplanner.trajectory.reader import TrajectoryFile, read_trajectory_file

# ---- The motion of a whole cycle: one trajectory, and marks where its steps begin.

_KINDS = {Move: MOVE, Event: EVENT, Attach: ATTACH, Detach: DETACH}


@dataclass(frozen=True, eq=False)
class LegMotion:
    """The motion of one leg.

    Attributes:
        trajectory: Of the leg alone, from time zero.
        passed: When its moves after the first begin [s].
    """

    trajectory: JointTrajectory
    passed: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class CycleMotion:
    """A trajectory of all legs and rests of a cycle.

    Attributes:
        cycle: What it is a motion of.
        trajectory: The whole.
        marks: One for each step, in order.

    Raises:
        TrajectoryError: On construction, if the marks are not those of the cycle's steps, their
            times are not in order, or a move takes no time; or joints are others than the cycle's.
    """

    cycle: Cycle
    trajectory: JointTrajectory
    marks: tuple[Mark, ...]

    def __post_init__(self) -> None:
        reordered = self.trajectory.reordered(self.cycle.robot.joint_names)
        object.__setattr__(self, "trajectory", reordered)
        wanted = [(_KINDS[type(step)], step.name, _setting(step)) for step in self.cycle.steps]
        found = [(mark.kind, mark.name, mark.setting) for mark in self.marks]
        if found != wanted:
            raise TrajectoryError(f"marks are {_listed(found)}; the cycle has {_listed(wanted)}")
        for mark, (begin, end) in zip(self.marks, self.step_times, strict=True):
            if not 0 <= begin <= end or (mark.kind == MOVE and begin == end):
                raise TrajectoryError(
                    f"marks: {mark.kind} '{mark.name}' is from {begin:g} to {end:g} s of a "
                    f"trajectory of {self.trajectory.duration:g} s; give times in order, from "
                    "zero, and every move some"
                )

    def __repr__(self) -> str:
        return (
            f"<CycleMotion of {self.cycle.name}: {self.trajectory.duration:.4f} s, "
            f"{len(self.cycle.legs)} legs, {len(self.marks)} marks>"
        )

    @property
    def step_times(self) -> list[tuple[float, float]]:
        """When each step of the cycle begins, and when the next one does [s]."""
        return list(pairwise([*(mark.time for mark in self.marks), self.trajectory.duration]))

    @cached_property
    def leg_times(self) -> list[tuple[float, float]]:
        """When each leg begins and ends [s]."""
        found, k = [], 0
        times = [*(mark.time for mark in self.marks), self.trajectory.duration]
        for leg in self.cycle.legs:
            k += len(leg.before.steps)
            begin, k = times[k], k + len(leg.moves)
            found.append((begin, times[k]))
        return found

    @property
    def move_times(self) -> dict[str, tuple[float, float]]:
        """When each move begins and ends [s], by its name."""
        spans = zip(self.marks, self.step_times, strict=True)
        return {mark.name: span for mark, span in spans if mark.kind == MOVE}

    @cached_property
    def seams(self) -> list[FloatArray]:
        """Configurations (n,) where legs begin, and where the last one ends."""
        times = self.leg_times
        instants = [*(begin for begin, _ in times), times[-1][1]]
        return [self.trajectory.position(time) for time in instants]

    @cached_property
    def legs(self) -> list[JointTrajectory]:
        """The motion of each leg, from time zero."""
        return [part_of(self.trajectory, *times) for times in self.leg_times]

    def leg_at(self, time: float) -> int:
        """Return which leg runs at a time [s], or did last; the first one before it."""
        begun = [k for k, (begin, _) in enumerate(self.leg_times) if begin <= time]
        return begun[-1] if begun else 0


def cycle_motion(cycle: Cycle, legs: Sequence[LegMotion]) -> CycleMotion:
    """Return the motion that runs all legs, at rest between them as long as events take.

    Args:
        cycle: The cycle.
        legs: The motion of each leg.
    """
    builder = _Builder(cycle)
    for leg, motion in zip(cycle.legs, legs, strict=True):
        builder.rest(leg.before.steps, motion.trajectory.position(0.0))
        builder.run(leg.moves, motion)
    last = legs[-1].trajectory
    builder.rest(cycle.after.steps, last.position(last.duration))
    names = cycle.robot.joint_names
    return CycleMotion(cycle, joined(names, builder.parts), tuple(builder.marks))


class _Builder:
    """Puts legs and rests one after the other."""

    def __init__(self, cycle: Cycle) -> None:
        self._names = cycle.robot.joint_names
        self._time = 0.0
        self.parts: list[JointTrajectory] = []
        self.marks: list[Mark] = []

    def rest(self, steps: Sequence[Step], q: FloatArray) -> None:
        """Stay in a configuration (n,) while steps happen."""
        for step in steps:
            self._mark(step, self._time)
            if isinstance(step, Event) and step.dwell >= MIN_DURATION:
                self._add(resting(self._names, q, step.dwell))

    def run(self, moves: Sequence[Move], motion: LegMotion) -> None:
        """Run the moves of a leg."""
        begins = (0.0, *motion.passed)
        for move, begin in zip(moves, begins, strict=True):
            self._mark(move, self._time + begin)
        self._add(motion.trajectory)

    def _add(self, part: JointTrajectory) -> None:
        self.parts.append(part)
        self._time = float(self._time + part.breakpoints[-1])

    def _mark(self, step: Step, time: float) -> None:
        self.marks.append(Mark(time, _KINDS[type(step)], step.name, _setting(step)))


def _setting(step: Step) -> Any:
    return step.setting if isinstance(step, Event) else None


def _listed(steps: Sequence[tuple[str, str, Any]]) -> str:
    known = [[str(part) for part in step if part is not None] for step in steps]
    return ", ".join(" ".join(step) for step in known) or "none"


def move_rows(motion: CycleMotion) -> list[dict[str, Any]]:
    """Return name, begin, end and duration [s] of every move."""
    return [
        {"name": name, "begin": begin, "end": end, "duration": end - begin}
        for name, (begin, end) in motion.move_times.items()
    ]


# ---- The motion of a cycle from a trajectory file.


def read_cycle_motion(path: str | Path, cycle: Cycle) -> CycleMotion:
    """Read the motion of a cycle from a trajectory file that has marks.

    Args:
        path: The file, JSON as `write_cycle_motion` or `plan -o` writes it.
        cycle: What it is a motion of.

    Raises:
        TrajectoryError: It cannot be read; or as `motion_of_file`.
    """
    Cycle.require(cycle)
    file = read_trajectory_file(path, cycle.robot.joint_names)
    return motion_of_file(cycle, Path(path), file)


def motion_of_file(cycle: Cycle, path: Path, file: TrajectoryFile) -> CycleMotion:
    """Return the motion that a file holds.

    Args:
        cycle: The cycle.
        path: The file; messages name it.
        file: What it holds.

    Raises:
        TrajectoryError: It has no marks, or others than the cycle's steps, or other joints.
    """
    if not file.marks:
        raise TrajectoryError(
            f"{path} has no marks, which say when the moves of a cycle begin and what the tool "
            "takes and lets go; CSV and ROS files have none: give the JSON that plan -o writes"
        )
    try:
        return CycleMotion(cycle, file.trajectory, file.marks)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from None
