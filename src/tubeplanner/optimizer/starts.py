"""First splines of a refinement: reference branch, coarser knots, last motion, period grid."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import ReferenceBranch, end_configuration
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.segment_walk import wanted_at
from tubeplanner.geometry.tube.bands import REQUIRED
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.limits.tube_membership import membership_margin, tube_use
from tubeplanner.optimizer.link_constraints import CAUTIOUS_PER_INTERVAL, LinkConstraints
from tubeplanner.optimizer.phased_spline import DEGREE, KnotGrid, PhasedSpline, sampled
from tubeplanner.optimizer.rows import MERIT_TOLERANCE
from tubeplanner.optimizer.tube_phases import (
    OrderedSegments,
    has_speed_limit,
    smoother_problem,
    tube_chains,
    turns_at_speed,
)
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import REST_POINTS, fitted_control_points, times_between

# ---- First splines along the reference branch, and splines on other knots.

# Fewest knot intervals of several phases: _MIN_IN_ALL in sum, at most _FEWEST in each phase.
_MIN_IN_ALL, _FEWEST = 12, 3
_FIT_POINTS_PER_INTERVAL = 5
# Numbers of intervals for chains, in turn, until the tool is fewer radii outside than _ENOUGH.
_INTERVALS, _ENOUGH = (12, 16, 24, 32, 48, 64, 96, 128), 0.5
_FREE_INTERVALS = (8, 12, 16, 24, 32, 48)  # for free branches, in turn
_FIT_SAMPLES = np.arange(3) / 3
# Control points that the fit does not determine are pulled to the joint line by this weight.
_DRAW = 1e-8
# Joints may move while the tool hardly does: a joint unit counts as so much of the arm's length.
_TRAVEL_OF_JOINTS = 0.042
# Knot intervals are divided into fewer parts where they are shorter than the average divided by
# this, as angles of Chebyshev points.
_SHORT = 1.5
# Where the goal is at the last corner, the arm stands still in the last phase. A phase of less
# width than the first value gets the second: its knots must not coincide.
_STILL, _STILL_WIDTH = 1e-6, 1e-3
# Knots of a turn of more than 20 degrees, and the turn between two knots of a smaller one [rad].
_KNOTS_PER_TURN, _TURN, _ANGLE = 8.0, np.radians(20), np.pi / 16
_TURN_SAMPLES, _LITTLE = 65, 0.25
_VISIT_SAMPLES = 2001  # of a trajectory, to find the segments that it visits


def sufficient_start(
    problem: PlanningProblem, start_of: Callable[[int], PhasedSpline], intervals: int
) -> PhasedSpline:
    """Return the spline of a number of knot intervals with as many knots as its chains need.

    In a chain no switching time moves knots to bends of the path, and coarse knots would lead the
    tool past whole segments. It has at least about `intervals` knot intervals.
    """
    spline = start_of(intervals)
    for more in _INTERVALS:
        if _excess_in_chains(problem, spline) < _ENOUGH:
            break
        if more > intervals:
            spline = start_of(more)
    return spline


def free_start(problem: PlanningProblem, branch: ReferenceBranch) -> PhasedSpline:
    """Return the spline along a free branch with as few knots as keep links out of obstacles."""
    for intervals in _FREE_INTERVALS:
        spline = starting_spline(problem, branch, intervals)
        links = LinkConstraints(problem, per_interval=CAUTIOUS_PER_INTERVAL)
        links.add_samples(spline)
        if links.at(spline).excess.max(initial=0.0) <= MERIT_TOLERANCE:
            break
    return spline


def starting_spline(
    problem: PlanningProblem, branch: ReferenceBranch, intervals: int
) -> PhasedSpline:
    """Return a spline along the branch, with a minimum-jerk time course over all corners.

    Its phases are the tube's chains. It has about `intervals` knot intervals.
    """
    q, robot = np.concatenate(branch.segments), problem.robot
    tool = robot.tool_position(q)
    steps = np.linalg.norm(np.diff(q, axis=0) / robot.joint_units, axis=1)
    steps *= _TRAVEL_OF_JOINTS * robot.arm_length
    steps += np.linalg.norm(np.diff(tool, axis=0), axis=1)
    travel = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    corners = travel[np.cumsum([len(segment) for segment in branch.segments]) - 1]
    x = np.linspace(0, 1, 2001)
    covered = x**3 * (10 - 15 * x + 6 * x**2)
    runs = tube_chains(problem)
    ends = [run.stop - 1 for run in runs[:-1]]
    inner = np.interp(corners[ends], covered, x)
    switching_times = _with_width(np.concatenate([[0.0], inner, [1.0]]))
    # At a limited speed the tool follows its tube; one interval per phase would lead it out.
    fewest = _FEWEST if has_speed_limit(problem) else 1
    grid = knot_grid(switching_times, intervals, runs, fewest)
    apart = np.concatenate([[True], np.diff(travel) > 0])
    times = times_between(grid.breakpoints(switching_times), _FIT_POINTS_PER_INTERVAL)
    course = np.interp(times, x, covered)
    path = np.array([np.interp(course, travel[apart], column[apart]) for column in q.T]).T
    return _fitted(grid, switching_times, times, path, (branch.start, branch.goal))


def visited_phases(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> tuple[tuple[range, ...], FloatArray]:
    """Return the segments of P phases that a trajectory visits, and the phases' ends, (P+1,).

    Segments are visited in any order, as few as there may be; but at compulsory points, the segment
    before passes on to the segment after the point. Ends are from 0 to 1.
    """
    tube, x = problem.tube, np.linspace(0, 1, _VISIT_SAMPLES)
    q = trajectory.position(x * trajectory.duration)
    tool, margin = problem.robot.tool_position(q), membership_margin(problem, q)
    is_outside = margin < np.minimum(margin.max(axis=1, keepdims=True), 0.0)
    # The first and the last sample of the stay in each segment, by a sample of the stay, (N, m).
    sample = np.arange(len(x))[:, None]
    first = np.maximum.accumulate(np.where(is_outside, sample + 1, 0))
    last = np.minimum.accumulate(np.where(is_outside, sample - 1, len(x) - 1)[::-1])[::-1]
    points = tube.compulsory_points.tolist()
    away = np.linalg.norm(tool[:, None] - tube.points[points], axis=2)
    passages = sorted(zip(away.argmin(axis=0).tolist(), points, strict=True))
    # Segments, and the first and the last sample at which the tool may pass on to them.
    visits: list[tuple[int, int, int]] = []
    here = 0  # the last sample in the latest segment
    for instant, point in [*passages, (len(x) - 1, None)]:
        until = instant if point is None else min(int(first[instant, point - 1]), instant)
        while here < until or not visits:
            here += int(visits != [] and last[here].max() == here)
            segment = int(last[here].argmax())
            visits.append((segment, int(first[here, segment]), here))
            here = int(last[here, segment])
        if point is not None:
            at = min(here, instant)
            visits += [(point - 1, int(first[at, point - 1]), at), (point, instant, instant)]
            here = max(int(last[instant, point]), instant)
    chain_of = {segment: chain for chain in tube_chains(problem) for segment in chain}
    runs, ends = [range(visits[0][0], visits[0][0] + 1)], [0]
    for segment, earliest, latest in visits[1:]:
        run = runs[-1]
        if segment == run[-1]:
            continue
        if segment == run.stop and run.start in chain_of[segment]:
            runs[-1] = range(run.start, segment + 1)
            continue
        # There the tool is deepest in both segments.
        both = slice(min(max(ends[-1], earliest), latest), latest + 1)
        depth = np.minimum(margin[both, run[-1]], margin[both, segment])
        ends.append(both.start + int(depth.argmax()))
        runs.append(range(segment, segment + 1))
    return tuple(runs), x[[*ends, -1]]


def spline_along(
    trajectory: JointTrajectory, runs: tuple[range, ...], ends: FloatArray, intervals: int
) -> PhasedSpline:
    """Return a spline along a trajectory, with phases of given segments that end at times (P+1,).

    Times are from 0 to 1. The spline has about `intervals` knot intervals.
    """
    switching_times = _with_width(ends)
    grid = knot_grid(switching_times, intervals, runs)
    times = times_between(grid.breakpoints(switching_times), _FIT_POINTS_PER_INTERVAL)
    path, rest = (trajectory.position(x * trajectory.duration) for x in (times, ends[[0, -1]]))
    return _fitted(grid, switching_times, times, path, (rest[0], rest[1]))


def subdivided(spline: PhasedSpline, parts: int) -> PhasedSpline:
    """Return the same spline, exactly, with knot intervals divided into several, `parts` at most.

    Fewer in phases whose intervals are shorter than the average: accelerations and jerks, which
    grow as control points move by fractions of an interval, would leave steps no room there.
    """
    switching_times, fractions = spline.switching_times, []
    average = np.pi / spline.grid.interval_count
    for k, fraction in enumerate(spline.grid.fractions):
        width = switching_times[k + 1] - switching_times[k]
        angle = np.arccos(1 - 2 * np.clip(switching_times[k] + width * fraction, 0.0, 1.0))
        interval = (angle[-1] - angle[0]) / (len(angle) - 1)
        share = int(np.clip(np.ceil(_SHORT * parts * interval / average), 1, parts))
        steps = np.arange(len(angle) * share - share + 1) / share
        x = (1 - np.cos(np.interp(steps, np.arange(len(angle)), angle))) / 2
        finer = (x - switching_times[k]) / width
        finer[::share] = fraction
        fractions.append(finer)
    return on_knots(spline, KnotGrid(tuple(fractions), spline.grid.runs), switching_times)


def with_turn_knots(
    problem: PlanningProblem, spline: PhasedSpline, duration: float
) -> PhasedSpline:
    """Return the same spline, exactly, with more knots where the tool turns at a limited speed.

    A tool that keeps its speed turns a corner in less time than usual knots are apart, and would
    slow down there for their sake. (Turns in 43 ms between knots 25 ms apart: by up to 51 %.) Times
    inside chains are by arc length. The spline is run in a duration [s].
    """
    points, angle, half = turns_at_speed(problem)
    if len(points) == 0:
        return spline
    grid, ends, along = spline.grid, spline.switching_times, arc_lengths(problem.tube.points)
    corners = along[[run.start for run in grid.runs] + [grid.runs[-1].stop]]
    middle, half = np.interp(along[points], corners, ends), half / duration
    knots = np.where(angle > _TURN, np.maximum(_KNOTS_PER_TURN, angle / _ANGLE), angle / _ANGLE)
    fractions: list[FloatArray] = []
    for k, fraction in enumerate(grid.fractions):
        width, refined = ends[k + 1] - ends[k], [fraction[:1]]
        for low, high in pairwise(fraction):
            x = np.linspace(low, high, _TURN_SAMPLES)
            times = ends[k] + width * x[:, None]
            away = (times - middle) / half
            beyond = 2 * np.sign(away) - 1 / np.where(abs(away) > 1, away, 1.0)
            passed = np.where(abs(away) > 1, beyond, away) @ (knots / 2)
            level = passed - passed[0] + np.linspace(0, 1, len(x))
            count = max(int(np.ceil(level[-1] - _LITTLE)), 1)
            refined.append(np.interp(np.arange(1, count) * level[-1] / count, level, x))
            refined.append(np.array([high]))
        fractions.append(np.concatenate(refined))
    finer = KnotGrid(tuple(fractions), grid.runs, usual_count=grid.interval_count)
    return on_knots(spline, finer, ends)


def on_knots(spline: PhasedSpline, grid: KnotGrid, switching_times: FloatArray) -> PhasedSpline:
    """Return the spline on other knots that is nearest to a spline."""
    times = times_between(grid.breakpoints(switching_times), _FIT_POINTS_PER_INTERVAL)
    ends = (spline.control_points[0], spline.control_points[-1])
    return _fitted(grid, switching_times, times, spline.bspline()(times), ends)


def knot_grid(
    switching_times: FloatArray,
    intervals: int,
    runs: tuple[range, ...] = (),
    least: int = 1,
) -> KnotGrid:
    """Return knots clustered at both ends of the spline, as Chebyshev points are.

    There the arm starts from rest or stops, and its acceleration needs the finest steps. Switching
    times are the ends of the phases, from 0 to 1, shape (P+1,); `runs` are the segments of every
    phase, one each if not given. Of several phases, each has at least `least` intervals.
    """
    angle = np.arccos(1 - 2 * switching_times)
    fractions, phases = [], len(switching_times) - 1
    fewest = 1 if phases == 1 else min(max(_MIN_IN_ALL // phases, least), _FEWEST)
    for k in range(phases):
        count = max(fewest, round(intervals * (angle[k + 1] - angle[k]) / np.pi))
        x = (1 - np.cos(np.linspace(angle[k], angle[k + 1], count + 1))) / 2
        fraction = (x - switching_times[k]) / (switching_times[k + 1] - switching_times[k])
        fraction[0], fraction[-1] = 0.0, 1.0
        fractions.append(fraction)
    return KnotGrid(tuple(fractions), runs)


def _with_width(switching_times: FloatArray) -> FloatArray:
    """Return switching times (P+1,) from 0 to 1 with no phase of zero width."""
    widths = np.diff(switching_times)
    is_still = widths < _STILL
    if not is_still.any():
        return switching_times
    widths[is_still] = _STILL_WIDTH
    times = np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])
    times[-1] = 1.0
    return times


def _excess_in_chains(problem: PlanningProblem, spline: PhasedSpline) -> float:
    """Return the largest distance of the tool outside its segments in chains, in radii."""
    if all(len(run) == 1 for run in spline.grid.runs):
        return 0.0
    tube, samples = problem.tube, spline.grid.samples(_FIT_SAMPLES)
    segments = OrderedSegments(tube.points, tube.effective_radius, spline.grid.runs, samples)
    tool = problem.robot.tool_position(sampled(spline, samples).position)
    excess = tube_use(problem, tool, segments.at(tool)) - 1
    return float(excess[segments.in_run].max(initial=0.0))


def _fitted(
    grid: KnotGrid,
    switching_times: FloatArray,
    times: FloatArray,
    path: FloatArray,
    ends: tuple[FloatArray, FloatArray],
) -> PhasedSpline:
    """Return the least-squares spline through configurations (N, n), at rest at both ends (n,)."""
    knots = grid.knots(switching_times)
    points = fitted_control_points(knots, DEGREE, times, path, ends, _DRAW)
    return PhasedSpline(grid, switching_times, points)


# ---- The last refined motion as the start of a changed problem.


@dataclass(frozen=True, eq=False)
class RefinedMotion:
    """The result of a refinement."""

    problem: PlanningProblem  # the planning problem, or a smoother one inside its tube
    is_smoother: bool  # whether `problem` is the smoother one
    spline: PhasedSpline  # the motion, without its duration

    def suited(self, changed: PlanningProblem) -> PlanningProblem | None:
        """Return the changed problem (or its smoother variant) if the motion suits the problem.

        The motion suits a problem with the same joints, phases of the same segments, and the same
        compulsory points; else None.
        """
        if changed.robot.joint_names != self.problem.robot.joint_names:
            return None
        inner = smoother_problem(changed) if self.is_smoother else changed
        if inner is None or tube_chains(inner) != tube_chains(self.problem):
            return None
        is_alike = np.array_equal(inner.tube.compulsory_points, self.problem.tube.compulsory_points)
        return inner if is_alike else None

    def shifted(self, changed: PlanningProblem) -> PhasedSpline:
        """Return the motion from a changed problem's start to its goal, on the same knots.

        At switching times the tool is shifted by as much as the reference points; between them,
        joints are shifted by a smooth blend.

        Raises:
            Infeasible: Status unreachable: the arm does not reach a point from the old one.
        """
        q = self.spline.bspline()(self.spline.switching_times)
        target = q.copy()
        start, goal = changed.endpoints
        target[0] = end_configuration(changed, start, 0)
        points = [run.stop for run in self.spline.grid.runs]
        for k, point in enumerate(points, start=1):
            is_last = k == len(points)
            shift = changed.tube.points[point] - self.problem.tube.points[point]
            tool = changed.robot.tool_position(q[k : k + 1])[0]
            if is_last and goal.region is not None:
                target[k] = _reached(changed, point, goal.region.nearest(tool), q[k])
            elif is_last:
                target[k] = end_configuration(changed, goal, -1)
            elif shift.any():
                target[k] = _reached(changed, point, tool + shift, q[k])
        control_points = self.spline.control_points + self._blend(target - q)
        return PhasedSpline(self.spline.grid, self.spline.switching_times, control_points)

    def _blend(self, shift: FloatArray) -> FloatArray:
        """Return the shift of control points (K, n) by that of the ends of the phases, (P+1, n)."""
        grid, ends = self.spline.grid, self.spline.switching_times
        knots, count = grid.knots(ends), grid.control_point_count
        times = np.mean([knots[k : k + count] for k in range(1, DEGREE + 1)], axis=0)
        times[:REST_POINTS], times[-REST_POINTS:] = 0.0, 1.0
        phase = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, len(ends) - 2)
        x = (times - ends[phase]) / np.diff(ends)[phase]
        fraction = (x**3 * (10 - 15 * x + 6 * x**2))[:, None]
        blend: FloatArray = (1 - fraction) * shift[phase] + fraction * shift[phase + 1]
        return blend


def _reached(
    problem: PlanningProblem, point: int, target: FloatArray, near: FloatArray
) -> FloatArray:
    """Return a configuration (n,) near another with the tool at a target, its rotation kept."""
    segment = point - 1
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    rotation = wanted_at(problem, target, segment, near)
    result = solve_position(problem.robot, target, near, lower, upper, rotation=rotation)
    if result.error > MARGIN_TOLERANCE / 2:
        message = f"the last motion does not lead to reference point {problem.tube.numbers[point]}"
        raise Infeasible(PlanStatus.UNREACHABLE, message, Location().at(target))
    return result.q


# ---- A longer motion whose stretches at constant speed take as long as before.


def slowed_beside_bands(
    problem: PlanningProblem, spline: PhasedSpline, longer: float
) -> PhasedSpline:
    """Return nearly the same path on the same knots, slowed where the tool's speed has no band.

    Run uniformly slower, the tool would leave the bands. Here time passes more slowly beside the
    stretches alone, as before at their ends: by 1 + 3 a u^2, u being 1 where the arm rests and 0 at
    a stretch, or by 1 + 30 a u^2 (1 - u)^2 between two stretches.

    Args:
        problem: The planning problem.
        spline: Its motion.
        longer: The duration, as a multiple of the present one.
    """
    stretches = problem.tube.stretches
    if not stretches or problem.tube.process.steady != REQUIRED or longer <= 1:
        return spline
    ends, runs = spline.switching_times, spline.grid.runs
    firsts = [run.start for run in runs]
    places = [0.0]
    for first, last in stretches:
        begin, end = firsts.index(first), max(k for k, k0 in enumerate(firsts) if k0 <= last)
        places += [float(ends[begin]), float(ends[end + 1])]
    places.append(1.0)
    free = np.array(places).reshape(-1, 2)
    a = (longer - 1) / np.diff(free).sum()
    x = times_between(spline.grid.breakpoints(ends), _FIT_POINTS_PER_INTERVAL)
    grown = x.copy()
    for k, (begin, end) in enumerate(free.tolist()):
        u = np.clip((x - begin) / (end - begin), 0.0, 1.0)
        if k == 0:
            passed = 1 - (1 - u) ** 3
        elif k == len(free) - 1:
            passed = u**3
        else:
            passed = u**3 * (10 - 15 * u + 6 * u**2)
        grown += a * (end - begin) * passed
    switching_times = np.interp(ends, x, grown) / longer
    switching_times[[0, -1]] = 0.0, 1.0
    grid = replace(spline.grid, is_fixed=False)
    times = times_between(grid.breakpoints(switching_times), _FIT_POINTS_PER_INTERVAL)
    path = spline.bspline()(np.interp(times, grown / longer, x))
    rest = (spline.control_points[0], spline.control_points[-1])
    return _fitted(grid, switching_times, times, path, rest)


# ---- Knots at multiples of a controller's period, so that its samples are the motion itself.


def on_periodic_knots(spline: PhasedSpline, periods: int) -> PhasedSpline:
    """Return nearly the same spline, all knots at multiples of a period.

    Its duration is a number of periods, at least its number of phases.
    """
    count = len(spline.switching_times)
    ends = np.round(spline.switching_times * periods).astype(int)
    for k in range(1, count):
        ends[k] = max(ends[k], ends[k - 1] + 1)
    ends = np.minimum(ends, periods - np.arange(count)[::-1])
    breakpoints = np.round(spline.grid.breakpoints(spline.switching_times) * periods).astype(int)
    breakpoints = np.union1d(breakpoints, ends)
    # Knots closer than a period coincide after rounding: the widest intervals are halved instead.
    while len(breakpoints) - 1 < spline.grid.interval_count:
        widths = np.diff(breakpoints)
        widest = int(widths.argmax())
        if widths[widest] == 1:
            break
        breakpoints = np.insert(breakpoints, widest + 1, breakpoints[widest] + widths[widest] // 2)
    fractions = []
    for begin, end in pairwise(ends):
        inner = breakpoints[(breakpoints > begin) & (breakpoints < end)]
        positions = np.unique(np.concatenate([[begin], inner, [end]]))
        fractions.append((positions - begin) / (end - begin))
    grid = KnotGrid(tuple(fractions), spline.grid.runs, is_fixed=True)
    return on_knots(spline, grid, ends / periods)
