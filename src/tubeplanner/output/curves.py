"""Curves of a motion: quantities, use of limits, segments; time line of a cycle."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.binding_limits import (
    ClosestPairs,
    LimitUses,
    Span,
    binding_rows,
    bound_fraction,
    clearance_use,
    closest_pairs,
    limit_uses,
    samples_per_piece,
)
from tubeplanner.limits.holding_limit import HoldingUse, holding_of_section, holding_uses
from tubeplanner.limits.path_samples import JointSpeedLimit, PathSamples
from tubeplanner.limits.peaks import motor_effort
from tubeplanner.limits.rates import PointSpeedLimit, ToolSpeed
from tubeplanner.limits.speed_limits import scaling_factor, speed_limits
from tubeplanner.limits.tube_membership import current_segments, tube_use
from tubeplanner.output.drawing import segment_color
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.legs import step_text
from tubeplanner.task.motion import CycleMotion, Motion, MotionSection
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Move
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

# ---- A motion under one problem: the whole motion, or a leg of a cycle.

MAX_LABELS = 8  # of segments or of their groups
_MAX_MARKED = 24  # segments that are marked singly; more are marked in groups with a label each


@dataclass(frozen=True, eq=False)
class LimitedSection(MotionSection):
    """A section of a motion with its use of limits and its closest pairs."""

    @cached_property
    def uses(self) -> LimitUses:
        """Use of its limits, from time zero."""
        return limit_uses(self.problem, self.trajectory)

    @cached_property
    def closest(self) -> list[ClosestPairs]:
        """Closest pairs at the times of `uses`."""
        return closest_pairs(self.problem, self.trajectory, self.uses.samples.time)

    def nearest(self, time: FloatArray) -> IntArray:
        """Return the samples of `uses` nearest to times (K,) from the section's begin [s]."""
        own = self.uses.samples.time
        later = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
        return later - (time - own[later - 1] < own[later] - time)


def limited_sections(motion: Motion) -> tuple[LimitedSection, ...]:
    """Return the sections of a motion with their use of limits."""
    return tuple(LimitedSection(**vars(section)) for section in motion.sections)


def held_contacts(sections: Sequence[MotionSection], time: FloatArray) -> list[HoldingUse]:
    """Return the use of every contact at times (K,) of a motion [s]; NaN while it holds no part."""
    contacts: dict[str, HoldingUse] = {}
    for section in sections:
        rows = section.inside(time)
        local = np.minimum(time[rows] - section.begin, section.trajectory.duration)
        for use in holding_of_section(section, section.trajectory.at(local)) if len(rows) else ():
            nothing = np.full((8, len(time)), np.nan)
            cone = np.zeros(len(time), dtype=np.int64)
            absent = HoldingUse(use.holding, nothing[0], cone, nothing[1], nothing[2:].T)
            whole = contacts.setdefault(repr(use.holding), absent)
            for name in ("share", "cone", "share_at_rest", "wrench"):
                getattr(whole, name)[rows] = getattr(use, name)
    return list(contacts.values())


@dataclass(frozen=True, eq=False)
class TrajectoryCurves:
    """Curves of a trajectory at N samples, on both sides of every breakpoint."""

    problem: PlanningProblem  # the planning problem
    samples: TrajectorySamples  # times, positions, velocities, accelerations
    jerk: FloatArray  # shape (N, n) [rad/s^3 or m/s^3]
    effort: FloatArray  # shape (N, n) [N m or N]
    # used fractions of the joints' limits by kind, shape (N, n); nan where a joint has no limit
    fractions: Mapping[str, FloatArray]
    tool: FloatArray  # shape (N, 3) [m]
    speed: FloatArray  # of the tool, shape (N,) [m/s]
    speed_limit: FloatArray  # limit of the segment, shape (N,) [m/s]; inf without a limit
    points: FloatArray  # speeds of points as fractions of their limits, shape (N, P)
    segment: IntArray  # the tube segment of each sample, shape (N,)
    # the tool's distance from the segment over its radius or its box's half side, shape (N,)
    tube_use: FloatArray
    # rotation error as a fraction of the rotation tolerance, shape (N,); None without a tolerance
    rotation_use: FloatArray | None
    holding: tuple[HoldingUse, ...] = ()  # of every contact that holds a part

    @property
    def visits(self) -> list[tuple[int, float, float]]:
        """Visits of groups of segments in turn: group, begin and end [s].

        A group is `segments_per_group` segments: hundreds of segments could not be told apart.
        """
        time, group = self.samples.time, self.segment // self.segments_per_group
        ends = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(time) - 1]
        return [(int(group[a]), float(time[a]), float(time[b])) for a, b in pairwise(ends)]

    @cached_property
    def factor(self) -> FloatArray:
        """Factor by which each sample could be run faster, jerk left out, shape (N,)."""
        at = self.samples
        q, v, a = at.position, at.velocity, at.acceleration
        return scaling_factor(self.problem, q, v, a, segment=self.segment)

    @property
    def segments_per_group(self) -> int:
        """Number of successive segments that are marked as a group."""
        return segments_per_group(self.problem.tube.segment_count)


def trajectory_curves(problem: PlanningProblem, trajectory: JointTrajectory) -> TrajectoryCurves:
    """Return the curves of a trajectory of the problem's joints, in their order."""
    robot, tube = problem.robot, problem.tube
    count = samples_per_piece(trajectory)
    samples = trajectory.per_piece(count)
    q, v, a = samples.position, samples.velocity, samples.acceleration
    rotation, tool, jacobian = robot.tool_pose_jacobian(q)
    segment = current_segments(problem, trajectory, samples)
    rotation_use = None
    if tube.rotation is not None:
        error = tube.rotation.error(rotation, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        rotation_use = (np.hstack([abs(error), angle]) / tube.rotation.bounds[segment]).max(axis=1)
    jerk = trajectory.jerk_per_piece(count)
    path = PathSamples(problem, np.stack([q, v, a, jerk]), lambda: segment)
    return TrajectoryCurves(
        problem,
        samples,
        jerk,
        motor_effort(robot, trajectory, samples),
        _joint_fractions(path),
        tool,
        np.linalg.norm(np.einsum("nij,nj->ni", jacobian[:, :3], v), axis=1),
        ToolSpeed(problem).limit[segment],
        PointSpeedLimit(robot.limits.point_speed).used(path).at(1.0),
        segment,
        tube_use(problem, tool, segment),
        rotation_use,
        tuple(holding_uses(path)),
    )


def _joint_fractions(path: PathSamples) -> dict[str, FloatArray]:
    """Return the used fractions of limits with a joint for each quantity, by kind, (N, n)."""
    fractions = {}
    for limit in speed_limits(path.problem):
        if isinstance(limit, JointSpeedLimit) and len(limit.keys) == len(limit.joints):
            fractions[limit.kind] = np.full(path.position.shape, np.nan)
            fractions[limit.kind][:, limit.joints] = limit.used(path).at(1.0)
    return fractions


def segments_per_group(count: int) -> int:
    """Return the number of segments that are marked as a group: a round number, 1 if few."""
    if count <= _MAX_MARKED:
        return 1
    steps = (digit * 10**power for power in range(9) for digit in (1, 2, 5))
    return next(step for step in steps if -(-count // step) <= MAX_LABELS)


def size_of(tube: Tube, k: int) -> str:
    """Return the text of the effective size of a segment: its radius, or its box's sides."""
    if tube.is_anywhere:
        return "free"
    if tube.cross_section is None or not tube.is_box[k]:
        return f"{1000 * tube.effective_radius[k]:.3g} mm"
    width, height = 1000 * (tube.cross_section[k, :2] - 2 * tube.tool_radius)
    return f"{width:.3g} x {height:.3g} mm"


# ---- Binding limits of successive motions.


@dataclass(frozen=True)
class BindingStrip:
    """Binding limits over time."""

    # spans of binding limits, by the names of joints, "tool" and "links"
    rows: Mapping[str, Sequence[Span]]
    # by kind of limit, the fraction of the time in which it binds anywhere; if > 0
    fractions: Mapping[str, float]
    speed_fraction: float  # fraction of the time in which any limit on the speed binds
    duration: float  # of all motions [s]
    joint_count: int  # number of rows of joints; they come first


def binding_strip(sections: Sequence[LimitedSection], duration: float) -> BindingStrip:
    """Return the binding limits of the sections of a motion; between sections, none.

    Args:
        sections: Of the same joints.
        duration: From the beginning of the first section to the end [s].
    """
    names = sections[0].problem.robot.joint_names
    rows: dict[str, list[Span]] = {}
    fractions: dict[str, float] = {}
    speed_fraction = 0.0
    for section in sections:
        weight = section.trajectory.duration / duration
        for row in binding_rows(names, section.uses, section.closest):
            shifted = [
                Span(span.kind, section.begin + span.begin, section.begin + span.end)
                for span in row.spans
            ]
            rows.setdefault(row.name, []).extend(shifted)
        uses = [*section.uses.uses, *map(clearance_use, section.closest)]
        for kind in dict.fromkeys(use.kind for use in uses):
            own = bound_fraction(section.uses, [use for use in uses if use.kind == kind])
            fractions[kind] = fractions.get(kind, 0.0) + weight * own
        speed_fraction += weight * bound_fraction(section.uses)
    binding = {kind: fraction for kind, fraction in fractions.items() if fraction > 0}
    ordered = {name: rows[name] for name in (*names, *rows) if name in rows}
    joint_count = int(np.isin(list(ordered), names).sum())
    return BindingStrip(ordered, binding, speed_fraction, duration, joint_count)


# ---- Curves of a motion: of every section and of every rest, in turn.


def motion_curves(motion: Motion) -> list[TrajectoryCurves]:
    """Return the curves of sections and rests in order, in times of the whole motion.

    The arm of each carries the parts of that section or rest.
    """
    sections = []
    for section in motion.sections:
        curves = trajectory_curves(section.problem, section.trajectory)
        later = replace(curves.samples, time=curves.samples.time + section.begin)
        sections.append(replace(curves, samples=later))
    result: list[TrajectoryCurves] = []
    for k, curves in enumerate(sections):
        result += [*_stop_curves(motion, k, curves, 0), curves]
    return [*result, *_stop_curves(motion, len(sections), sections[-1], -1)]


def _stop_curves(
    motion: Motion, junction: int, beside: TrajectoryCurves, sample: int
) -> Iterator[TrajectoryCurves]:
    """Yield the curves of steps that take time at a junction.

    Args:
        motion: The motion.
        junction: Index of the junction.
        beside: Curves of the section after the junction, or before it.
        sample: Index of the sample at the junction.
    """
    before = zip(motion.stops, motion.sections[:junction], strict=False)
    first = sum(len(stop.steps) + len(section.names) for stop, section in before)
    stop = motion.stops[junction]
    times = [mark.time for mark in motion.marks[first : first + len(stop.steps) + 1]]
    if junction == len(motion.sections):
        times.append(motion.trajectory.duration)
    for (begin, end), arm in zip(pairwise(times), stop.arms[1:], strict=True):
        if end > begin:
            yield _held_curves(beside, sample, arm, (begin, end))


def _held_curves(
    beside: TrajectoryCurves, sample: int, arm: RobotModel, span: tuple[float, float]
) -> TrajectoryCurves:
    """Return the curves at a sample at rest for a span of time [s]: motors hold the arm."""
    rows = np.arange(len(beside.segment))[[sample, sample]]
    samples = beside.samples
    still = np.zeros_like(samples.velocity[rows])
    return replace(
        beside,
        samples=replace(
            samples,
            time=np.array(span),
            position=samples.position[rows],
            velocity=still,
            acceleration=still,
        ),
        jerk=still,
        effort=arm.gravity_effort(samples.position[rows]),
        fractions={kind: 0 * used[rows] for kind, used in beside.fractions.items()},
        tool=beside.tool[rows],
        speed=np.zeros(2),
        speed_limit=beside.speed_limit[rows],
        points=np.zeros_like(beside.points[rows]),
        segment=beside.segment[rows],
        tube_use=beside.tube_use[rows],
        rotation_use=None if beside.rotation_use is None else beside.rotation_use[rows],
        holding=(),  # steps of a rest may take the part or let it go
    )


# ---- The time line of a cycle: moves as bands, steps at rest as ticks.

# A text nearer to an end of the line than this fraction of it extends to that end.
_EDGE = 0.1


@dataclass(frozen=True)
class Band:
    """A move on a time line."""

    name: str  # of the move
    begin: float  # [s]
    end: float  # [s]
    color: str  # of its tube
    tube: str  # name of its surface


@dataclass(frozen=True)
class Stop:
    """A rest on a time line."""

    begin: float  # [s]
    end: float  # [s]; equal to begin if no step takes time
    ticks: tuple[tuple[float, str], ...]  # begin [s] and text of each step

    @property
    def text(self) -> str:
        """Texts of all steps, on a single line."""
        return ", ".join(text for _, text in self.ticks)


@dataclass(frozen=True)
class Timeline:
    """Moves and rests over time."""

    bands: tuple[Band, ...]  # moves
    stops: tuple[Stop, ...]  # rests with steps

    def as_dict(self, duration: float) -> dict[str, Any]:
        """Return the time line as JSON values, with the space for the text of each rest.

        Args:
            duration: Of the whole line [s].
        """
        spaces = _text_spaces([(stop.begin + stop.end) / 2 for stop in self.stops], duration)
        return {
            "bands": [vars(band) for band in self.bands],
            "rests": [
                {**vars(stop), "text": stop.text, "room": space}
                for stop, space in zip(self.stops, spaces, strict=True)
            ],
        }


def cycle_timeline(motion: CycleMotion) -> Timeline:
    """Return the time line of a motion."""
    spans = motion.move_times.items()
    bands = [
        Band(name, *times, segment_color(k), tube_name(k)) for k, (name, times) in enumerate(spans)
    ]
    return Timeline(tuple(bands), tuple(_stops(motion)))


def tube_name(move: int) -> str:
    """Return the name of the surface of a move's tube in the scene."""
    return f"move_{move}"


def _stops(motion: CycleMotion) -> list[Stop]:
    steps = zip(motion.cycle.steps, motion.marks, strict=True)
    runs = [list(run) for _, run in groupby(steps, lambda each: isinstance(each[0], Move))]
    ends = [run[0][1].time for run in runs[1:]] + [motion.trajectory.duration]
    return [
        Stop(
            run[0][1].time,
            end,
            tuple((mark.time, step_text(step)) for step, mark in run if not isinstance(step, Move)),
        )
        for run, end in zip(runs, ends, strict=True)
        if not isinstance(run[0][0], Move)
    ]


def _text_spaces(middles: Sequence[float], duration: float) -> list[dict[str, Any]]:
    """Return the spaces of texts around times [s], so that no text is drawn over another.

    A space reaches at most half way to the next text, and as far on both sides; the first and the
    last text, if at an end of the line, have the whole space to that end.
    """
    borders = [0.0, *(sum(pair) / 2 for pair in pairwise(middles)), duration]
    spaces = []
    # Without a text there is one pair of borders, and no space.
    for k, (middle, (low, high)) in enumerate(zip(middles, pairwise(borders), strict=False)):
        even = min(middle - low, high - middle)
        space = {"begin": middle - even, "end": middle + even, "align": "center"}
        if k == 0 and middle < _EDGE * duration:
            space = {"begin": low, "end": high, "align": "left"}
        elif k == len(middles) - 1 and middle > (1 - _EDGE) * duration:
            space = {"begin": low, "end": high, "align": "right"}
        spaces.append(space)
    return spaces
