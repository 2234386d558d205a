"""Speed bands that joints cannot hold: where, why, what helps; the motion nearest to them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.tube.bands import BEST, gates
from tubeplanner.limits.binding_limits import ROTATION, TUBE, limit_uses
from tubeplanner.limits.held_speeds import (
    Bend,
    HeldSpeed,
    held_speed,
    largest_speed,
    sharpest_bends,
)
from tubeplanner.limits.tube_membership import judged_segments
from tubeplanner.optimizer.tube_phases import tube_chains
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, until_stopped
from tubeplanner.planning.options import REFINEMENT
from tubeplanner.planning.refined_plan import continued_plan
from tubeplanner.planning.result import PlanResult, certified_result
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- The speeds of a motion along the stretches of a tube.

_PER_PIECE = 10  # samples of a polynomial piece
_ROUNDING = 1e-6  # relative


def with_floors(
    problem: PlanningProblem, floor: FloatArray, *, is_required: bool
) -> PlanningProblem:
    """Return a problem with other least speeds, (m,) [m/s], required or not."""
    tube = problem.tube
    process = replace(tube.process, steady="required" if is_required else "best")
    other = replace(tube, least_tool_speed=floor, process=process)
    vars(other).update(parts=tube.parts, part_points=tube.part_points)
    return replace(problem, tube=other)


def without_floors(problem: PlanningProblem) -> PlanningProblem:
    """Return a problem whose bands have their upper ends alone."""
    floor = problem.tube.least_tool_speed
    assert floor is not None
    return with_floors(problem, floor, is_required=False)


@dataclass(frozen=True, eq=False)
class StretchSpeeds:
    """The tool's speed along the stretches of a tube, at samples of a motion."""

    problem: PlanningProblem  # its segments joined
    trajectory: JointTrajectory

    @cached_property
    def floor(self) -> FloatArray:
        """The least speeds of segments, infinite where there is none, shape (m,) [m/s]."""
        floor = self.problem.tube.least_tool_speed
        assert floor is not None
        return floor

    @cached_property
    def time(self) -> FloatArray:
        """Times of the N samples [s]."""
        return self.trajectory.per_piece(_PER_PIECE).time

    @cached_property
    def q(self) -> FloatArray:
        """Configurations, shape (N, n)."""
        return self.trajectory.position(self.time)

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities of the tool, shape (N, 3) [m/s]."""
        return self.problem.robot.tool_velocity(self.q, self.trajectory.velocity(self.time))[0]

    @cached_property
    def speed(self) -> FloatArray:
        """Their norms, shape (N,) [m/s]."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    @cached_property
    def tool(self) -> FloatArray:
        """Positions of the tool, shape (N, 3) [m]."""
        return self.problem.robot.tool_position(self.q)

    @cached_property
    def segment(self) -> IntArray:
        """The samples' segments, shape (N,)."""
        return judged_segments(self.problem, self.trajectory, self.time)

    @cached_property
    def is_inside(self) -> BoolArray:
        """True between the planes through the ends of a stretch, shape (N,)."""
        tube, is_banded = self.problem.tube, np.isfinite(self.floor)
        inside: BoolArray = is_banded[self.segment]
        for gate in gates(tube.points, tube.stretches):
            own = gate.point if is_banded[gate.point] else gate.point - 1
            inside &= (self.segment != own) | (gate.margin(self.tool) <= 0)
        return inside

    @cached_property
    def share(self) -> FloatArray:
        """The speeds as shares of their floors, infinite outside the stretches, shape (N,)."""
        floor = self.floor[self.segment]
        return np.where(self.is_inside, self.speed / np.where(self.is_inside, floor, 1.0), np.inf)

    @property
    def share_of_way(self) -> float:
        """Share of the way along stretches at a speed in the band."""
        step = np.gradient(self.time) * self.speed * self.is_inside
        return float(step[self.share >= 1 - _ROUNDING].sum() / max(step.sum(), 1e-12))

    def passage(self, point: int) -> int:
        """Return the sample of the tool nearest to an inner point where it passes on there."""
        beside = np.isin(self.segment, (point - 1, point))
        away = np.linalg.norm(self.tool - self.problem.tube.points[point], axis=1)
        return int(np.where(beside, away, np.inf).argmin())

    def held(self) -> "Iterator[HeldBend]":
        """Yield what can be held in the bends inside stretches."""
        is_banded = np.isfinite(self.floor)
        for bend in sharpest_bends(self.problem.tube):
            if is_banded[bend.point - 1 : bend.point + 1].all() and np.isfinite(bend.arc):
                q = self.q[self.passage(bend.point)]
                asked = float(self.floor[bend.point - 1 : bend.point + 1].max())
                yield HeldBend(bend, held_speed(self.problem, bend, q), asked, q)


@dataclass(frozen=True, eq=False)
class HeldBend:
    """A bend inside a stretch, and what can be held there."""

    bend: Bend
    held: HeldSpeed
    asked: float  # the larger least speed of the segments beside the point [m/s]
    q: FloatArray  # configuration there, shape (n,)

    @property
    def share(self) -> float:
        """What can be held as a share of what is asked."""
        return self.held.speed / self.asked


# ---- The refusal of bands that joints cannot hold.

_BINDS = 0.9  # from this fraction on a limit may explain a dip beside it
_SINGULAR = 0.05  # the least singular value of the tool's Jacobian, as a share of the largest


def bend_refusal(motion: StretchSpeeds, starts: int = 0, enough: float = 1.0) -> Infeasible | None:
    """Return the refusal of the bend in which least of the asked speed can be held, if any.

    Args:
        motion: A motion with the bands' upper ends alone.
        starts: Number of starts from which no motion in the bands was found.
        enough: The share of the asked speed that counts as enough.
    """
    worst = min(motion.held(), key=lambda each: each.share, default=None)
    if worst is None or worst.share >= enough:
        return None
    tube, bend, held, asked = motion.problem.tube, worst.bend, worst.held, worst.asked
    number = int(tube.numbers[bend.point])
    helps = []
    if np.isfinite(held.acceleration) and held.acceleration > 0 and held.kind != "velocity":
        radius = bend.radius_for(asked, held.acceleration)
        helps.append(f"a radius of {_up(1000 * radius):.3g} mm there")
    turn = f"{np.degrees(bend.angle):.0f} degrees"
    if bend.length > 0:
        turn += f" over {1000 * bend.length:.3g} mm"
    return Infeasible(
        PlanStatus.NO_TRAJECTORY,
        f"tool_speed: point {number} ({turn}, {1000 * bend.radius:.3g} mm): about {held.speed:.3f} "
        f"m/s can be held ({held.kind} of {held.name}), {asked:.4g} is asked; "
        f"{_listed([*helps, *_slower(motion, bend.point, worst.share)])} helps",
        Location(
            joint=held.joint,
            segment=tube.segment_number(bend.point, tube.points[bend.point]),
            point=number,
        ).at(tube.points[bend.point]),
        starts=starts,
        configuration=worst.q,
    )


def dip_refusal(
    motion: StretchSpeeds, starts: int = 0, enough: float = 1 - _ROUNDING
) -> Infeasible | None:
    """Return the refusal of the sample of a motion that is slowest in its band, if it is outside.

    Arguments as of `bend_refusal`.
    """
    problem, sample = motion.problem, int(motion.share.argmin())
    share = float(motion.share[sample])
    if share >= enough:
        return None
    uses = limit_uses(problem, motion.trajectory, _PER_PIECE)
    shape = (TUBE, ROTATION, "tool_speed", "position")
    binding = max(
        (each for each in uses.uses if each.kind not in shape),
        key=lambda each: float(each.fraction[sample]),
    )
    segment, q = int(motion.segment[sample]), motion.q[sample]
    values = np.linalg.svd(problem.robot.tool_jacobian(q[None])[1][0], compute_uv=False)
    near = " near a singularity" if values[-1] < _SINGULAR * values[0] else ""
    joint, why = None, "no limit of joints binds"
    if binding.fraction[sample] >= _BINDS:
        joint = None if binding.joint is None else binding.name
        why = f"{binding.kind} of {binding.name}"
    location = Location(
        joint=joint, segment=problem.tube.segment_number(segment, motion.tool[sample])
    ).at(motion.tool[sample])
    tolerance = ""
    if near and problem.tube.rotation is not None:
        tolerance = f"a wider tube.rotation_tolerance[{location.segment}], "
    return Infeasible(
        PlanStatus.NO_TRAJECTORY,
        f"tool_speed: segment {location.segment}: the fastest motion slows to "
        f"{motion.speed[sample]:.3f} m/s there{near} ({why}), "
        f"{motion.floor[segment]:.4g} is asked; {tolerance}"
        f"{_listed(_slower(motion, segment, share))} helps",
        location,
        starts=starts,
        configuration=q,
    )


def _slower(motion: StretchSpeeds, segment: int, share: float) -> list[str]:
    """Return the remedies of a slower stretch in words."""
    upper = motion.problem.tube.tool_speed
    assert upper is not None
    largest = float(upper[segment])
    slower = [] if share < 0.01 else [f"tool_speed {_down(share * largest):.3g}"]
    return [*slower, "process.steady: best"]


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])}, or {names[-1]}"


def _up(value: float) -> float:
    digits = 1 - int(np.floor(np.log10(value)))
    return float(np.ceil(value * 10.0**digits) / 10.0**digits)


def _down(value: float) -> float:
    digits = 2 - int(np.floor(np.log10(value)))
    return float(np.floor(value * 10.0**digits) / 10.0**digits)


# ---- The motion nearest to bands that are not required.
#
# The motion with the upper ends alone is planned first. Then floors are raised where it is slower
# than its band: to what can be held there by formula, and by bisection from there.

_RAISES = 4
_MOST = 1.1  # of what can be held by formula


def steadiest_plan(
    problem: PlanningProblem, fastest: PlanResult, clock: PlanningClock
) -> PlanResult:
    """Return the certified motion that loses least of the bands of a problem with steady: best.

    Args:
        problem: The planning problem, its segments joined.
        fastest: The certified motion with the bands' upper ends alone.
        clock: The clock of planning.

    Returns:
        That motion, whose floors hold for what follows; the given one where it cannot be better.
    """
    if fastest.motion is None or fastest.trajectory is None:
        return fastest
    result, speeds = fastest, StretchSpeeds(problem, fastest.trajectory)
    runs = [run for run in tube_chains(problem) if np.isfinite(speeds.floor[run.start])]
    share = {run: float(speeds.share[np.isin(speeds.segment, run)].min()) for run in runs}
    low = {run: least for run, least in share.items() if least < 1 - _ROUNDING}
    if not low:
        return fastest
    held = dict.fromkeys(low, 1.0)
    for each in speeds.held():
        for run in low:
            if each.bend.point in (*run, run.stop):
                held[run] = min(held[run], each.share)
    for run in low:  # without a bend, what the velocities allow where it is slowest
        sample = int(np.where(np.isin(speeds.segment, run), speeds.share, np.inf).argmin())
        segment = int(speeds.segment[sample])
        there = largest_speed(problem, segment, speeds.velocity[sample], speeds.q[sample])
        held[run] = max(min(held[run], there.speed / float(speeds.floor[segment])), low[run])
    below, above, factor = min(low[run] / held[run] for run in low), _MOST, 1.0
    for _ in range(_RAISES):
        floor = speeds.floor.copy()
        for run in low:
            raised = min(1.0, max(low[run], factor * held[run]))
            floor[run.start : run.stop] *= raised * (1 - _ROUNDING)
        motion = result.motion
        assert motion is not None
        higher = with_floors(problem, floor, is_required=True)
        raised_plan, stopped_by = until_stopped(partial(continued_plan, higher, motion, clock))
        if raised_plan is not None and raised_plan.succeeded and raised_plan.trajectory is not None:
            below = factor
            answer = certified_result(problem, raised_plan.trajectory, REFINEMENT, clock)
            if answer.succeeded:
                prices = raised_plan.sensitivities
                result = replace(answer, motion=raised_plan.motion, sensitivities=prices)
            if all(factor * held[run] >= 1 for run in low):
                break
        else:
            above = factor
        if raised_plan is not None:
            stopped_by = raised_plan.stopped_by
        if stopped_by is not None:
            return replace(result, stopped_by=stopped_by)
        factor = (below + above) / 2
    return result


def steadiness_note(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return the note on what a motion loses of bands that are not required."""
    tube = problem.tube
    if not tube.stretches or tube.process.steady != BEST:
        return ()
    speeds = StretchSpeeds(problem, trajectory)
    sample = int(speeds.share.argmin())
    note = f"steady: best: {speeds.share_of_way:.1%} of the bead is in its band"
    if speeds.share[sample] >= 1 - _ROUNDING:
        return (note,)
    segment, upper = int(speeds.segment[sample]), tube.tool_speed
    assert upper is not None
    least = float(speeds.speed[sample])
    away = np.linalg.norm(tube.points - speeds.tool[sample], axis=1)
    off = least / float(upper[segment]) - 1
    return (
        f"{note}; down to {least:.3f} m/s ({off:+.0%}) about point "
        f"{int(tube.numbers[int(away.argmin())])}",
    )
