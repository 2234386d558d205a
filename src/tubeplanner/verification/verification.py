"""The independent judge: does a trajectory solve the problem?

It uses robot, tube, collision geometry and the trajectory's polynomials, and nothing of the code
that made the trajectory.
"""

from functools import cached_property
from itertools import groupby

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.trajectory.bernstein import Extrema, maxima, peak_magnitudes
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.certificate import (
    FOR_ALL_TIMES,
    RELATIVE,
    Certificate,
    JudgedCondition,
    Tolerance,
)
from tubeplanner.verification.closest_approach import closest_approach
from tubeplanner.verification.enclosure import (
    EnclosedPose,
    Enclosure,
    enclosed_efforts,
    enclosed_pose,
    enclosed_tool,
)
from tubeplanner.verification.rotation_visits import least_rotation_margin
from tubeplanner.verification.tube_visits import Visit, least_margin, passages, tube_visits

_STILL_SHARE = 1e-6  # a joint slower than this share of the fastest counts as standing still
# How closely efforts [share of their limits] and tool [m] are enclosed: tighter than the
# certificate's tolerance, so that the planner may use most of it.
_EFFORT_ENCLOSURE = 1e-8
_TOOL_ENCLOSURE = 1e-7
# Where the rotation is judged too: an error of the tool is one of its reference orientation.
_POSE_ENCLOSURE, _ROTATION_ENCLOSURE = 1e-8, 1e-9
# Bounds farther apart than this, absolute [m] and as a share of the margin, are left undecided.
_UNDECIDED_LENGTH, _UNDECIDED_SHARE = 1e-6, 0.05


def verify(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tolerance: Tolerance | None = None,
) -> Certificate:
    """Judge a trajectory.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        tolerance: How far below zero margins may lie; default: 1e-6 m, rad and relative.

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: The trajectory is none, or moves other joints than the problem's.
    """
    PlanningProblem.require(problem)
    if not isinstance(trajectory, JointTrajectory):
        raise TrajectoryError(
            f"the trajectory is {shown(trajectory)}; give a JointTrajectory, as plan returns"
        )
    tolerance = tolerance or Tolerance()
    problem = problem.joined
    judge = _Judge(problem, trajectory.reordered(problem.robot.joint_names), tolerance)
    conditions = {
        "position": judge.position(),
        "velocity": judge.derivative(1, problem.robot.limits.velocity),
        "acceleration": judge.derivative(2, problem.robot.limits.acceleration),
        "jerk": judge.derivative(3, problem.robot.limits.jerk),
        "effort": judge.effort(),
        "tube": judge.tube(),
        "joint_signs": judge.joint_signs(),
        "rotation": judge.rotation(),
        "points": judge.points(),
        "start": judge.endpoint(0),
        "goal": judge.endpoint(-1),
        "rest": judge.rest(),
        "continuity": judge.continuity(),
        "obstacles": judge.obstacles(),
        "self_collision": judge.self_collision(),
    }
    return Certificate(conditions, tolerance, problem.collision.left_out)


def judged_visits(problem: PlanningProblem, trajectory: JointTrajectory) -> list[Visit]:
    """Return when a trajectory is in which segment, as `verify` judges it.

    Args:
        problem: The planning problem; the segments are those of `PlanningProblem.joined`.
        trajectory: Of the problem's joints, in any order.
    """
    joined = problem.joined
    return _Judge(joined, trajectory.reordered(joined.robot.joint_names), Tolerance()).visits


class _Judge:
    """Computes each condition of one trajectory."""

    def __init__(
        self, problem: PlanningProblem, trajectory: JointTrajectory, tolerance: Tolerance
    ) -> None:
        self._problem, self._trajectory, self._tolerance = problem, trajectory, tolerance
        self._robot, self._tube = problem.robot, problem.tube

    def position(self) -> JudgedCondition:
        """Position limits, exactly."""
        limits = self._robot.limits
        margin, place = self._range_margin(
            self._trajectory, limits.lower_position, limits.upper_position
        )
        if margin is None:
            return JudgedCondition(None, "rad", Place(), "no joint has position limits")
        return JudgedCondition(margin, self._unit_at(place), place, FOR_ALL_TIMES)

    def derivative(self, order: int, limit: FloatArray) -> JudgedCondition:
        """A limit on velocity, acceleration or jerk, exactly."""
        bounded = np.flatnonzero(np.isfinite(limit))
        if len(bounded) == 0:
            return JudgedCondition(None, RELATIVE, Place(), "no joint has this limit")
        used = self._trajectory.derivative_coefficients(order)[:, :, bounded] / limit[bounded]
        peaks = peak_magnitudes(used, self._trajectory.widths)
        peak, time, column = _highest(peaks, self._trajectory)
        joint = self._robot.joint_names[bounded[column]]
        return JudgedCondition(1 - peak, RELATIVE, Place(time=time, joint=joint), FOR_ALL_TIMES)

    def effort(self) -> JudgedCondition:
        """Effort limits, by polynomials that enclose the efforts."""
        limit = self._robot.limits.effort
        bounded = np.flatnonzero(np.isfinite(limit))
        if len(bounded) == 0:
            return JudgedCondition(None, RELATIVE, Place(), "no joint has this limit")
        efforts = enclosed_efforts(self._robot, self._trajectory, _EFFORT_ENCLOSURE * limit)
        used = efforts.coefficients[:, :, bounded] / limit[bounded]
        error = efforts.error[:, bounded].max(axis=0) / limit[bounded]
        peaks = peak_magnitudes(used, np.ones_like(efforts.width))
        above = peaks.value + error
        worst = int(above.argmax())
        interval = peaks.piece[worst]
        time = efforts.start[interval] + peaks.local_time[worst] * efforts.width[interval]
        coverage = FOR_ALL_TIMES
        if error[worst] > _EFFORT_ENCLOSURE:
            coverage = _undecided(1 - float(peaks.value[worst]), RELATIVE)
        place = Place(time=float(time), joint=self._robot.joint_names[bounded[worst]])
        return JudgedCondition(1 - float(above[worst]), RELATIVE, place, coverage)

    def tube(self) -> JudgedCondition:
        """The tool in the tube, segment by segment or in their union."""
        least = least_margin(self._tube, self._tool, self.visits)
        place = Place(time=least.time, segment=self._number(least.segment, least.time))
        return JudgedCondition(
            least.lower_bound, "m", place, _bracketed(least.lower_bound, least.attained, "m")
        )

    def rotation(self) -> JudgedCondition:
        """The tool's orientation against the reference, segment by segment."""
        if self._tube.rotation is None or self._pose is None:
            return JudgedCondition(None, "rad", Place(), "the tool's orientation is free")
        least = least_rotation_margin(self._tube.rotation, self._pose, self.visits)
        if least is None:
            return JudgedCondition(None, "rad", Place(), "free in every segment visited")
        place = Place(time=least.time, segment=self._number(least.segment, least.time))
        coverage = _bracketed(least.lower_bound, least.attained, "rad")
        return JudgedCondition(least.lower_bound, "rad", place, coverage)

    def joint_signs(self) -> JudgedCondition:
        """Joint ranges of the segments, exactly between the switching times."""
        lower, upper = self._tube.ranges_of(self._robot.joint_names)
        found = []
        for visits in self._visits_by_range():
            segment, begin = visits[0].segment, visits[0].begin
            part = self._trajectory.between(begin, visits[-1].end)
            margin, place = self._range_margin(part, lower[segment], upper[segment])
            if margin is not None:
                time = begin + (place.time or 0.0)
                segment = next((v.segment for v in visits if time <= v.end), visits[-1].segment)
                number = self._number(segment, time)
                found.append((margin, Place(time, place.joint, number)))
        if not found:
            return JudgedCondition(None, "rad", Place(), "no segment has joint signs")
        margin, place = min(found, key=lambda item: item[0])
        return JudgedCondition(margin, self._unit_at(place), place, FOR_ALL_TIMES)

    def points(self) -> JudgedCondition:
        """Compulsory points, each at an instant when one of its two segments is the current one."""
        rotation = None if self._pose is None else self._pose.rotation
        found = passages(self._problem, self._trajectory, self._tool, self.visits, rotation)
        if not found:
            return JudgedCondition(None, "m", Place(), "no point is to be passed")
        worst = min(found, key=lambda passage: passage.margin)
        place = Place(time=worst.time, point=int(self._tube.numbers[worst.point]))
        return JudgedCondition(worst.margin, "m", place, "at the instant that is nearest")

    def _number(self, segment: int, time: float) -> int:
        """Return what messages call a segment; where parts are joined, the one at a time [s]."""
        tool = self._robot.tool_position(self._trajectory.position(time)[None])[0]
        return self._tube.segment_number(segment, tool)

    def endpoint(self, index: int) -> JudgedCondition:
        """Start (0) or goal (-1): the given configuration, or else the reference point."""
        given = self._problem.start if index == 0 else self._problem.goal
        time = 0.0 if index == 0 else self._trajectory.duration
        q = self._trajectory.position(time)
        if given is None or isinstance(given, Seed):
            tool = self._robot.tool_position(q[None])[0]
            error = float(np.linalg.norm(tool - self._tube.points[index]))
            return JudgedCondition(
                0.0 - error, "m", Place(time=time), "tool at the reference point"
            )
        joint = int(abs(q - given).argmax())
        place = Place(time=time, joint=self._robot.joint_names[joint])
        return JudgedCondition(
            0.0 - float(abs(q - given).max()), self._unit(joint), place, FOR_ALL_TIMES
        )

    def rest(self) -> JudgedCondition:
        """Velocity and acceleration at both ends, relative to their largest values."""
        worst, place = 0.0, Place()
        for order in (1, 2):
            values = self._piece_ends(order)
            ends = np.array([values[0, 0], values[1, -1]])
            share = abs(ends) / self._largest[order]
            if share.max() > worst:
                end, joint = np.unravel_index(int(share.argmax()), share.shape)
                time = float(self._trajectory.breakpoints[-end])
                worst = float(share.max())
                place = Place(time=time, joint=self._robot.joint_names[joint])
        return JudgedCondition(0.0 - worst, RELATIVE, place, FOR_ALL_TIMES)

    def continuity(self) -> JudgedCondition:
        """Jumps of position, or of velocity and acceleration relative to their largest values.

        All jumps of a joint add up: many small ones would otherwise let it skip any part of its
        path. The worst sum is reported, each measured by its own tolerance, at its largest jump.
        """
        found = [JudgedCondition(0.0, RELATIVE, Place(), FOR_ALL_TIMES)]
        for order in range(3):
            values = self._piece_ends(order)
            jumps = abs(values[0, 1:] - values[1, :-1])
            if jumps.size == 0:
                continue
            if order > 0:
                jumps = jumps / self._largest[order]
            total = jumps.sum(axis=0)
            joint = int(total.argmax())
            time = float(self._trajectory.breakpoints[jumps[:, joint].argmax() + 1])
            place = Place(time=time, joint=self._robot.joint_names[joint])
            unit = self._unit(joint) if order == 0 else RELATIVE
            found.append(JudgedCondition(0.0 - float(total[joint]), unit, place, FOR_ALL_TIMES))
        return min(found, key=self._in_tolerances)

    def _in_tolerances(self, condition: JudgedCondition) -> float:
        """Return a margin as a multiple of the tolerance that it is judged by."""
        return (condition.margin or 0.0) / max(self._tolerance.of(condition.unit), 1e-300)

    def _unit_at(self, place: Place) -> str:
        """Return the unit of the position of the joint that a place names."""
        return self._unit(self._robot.joint_names.index(place.joint or ""))

    def _unit(self, joint: int) -> str:
        """Return the unit of a joint's position."""
        return "rad" if self._robot.revolute[joint] else "m"

    def obstacles(self) -> JudgedCondition:
        """Links against obstacles, for all t."""
        pairs = self._problem.collision.obstacle_pairs
        return self._clearance(pairs, self._problem.clearance, "no link can meet an obstacle")

    def self_collision(self) -> JudgedCondition:
        """Links against links, for all t."""
        pairs = self._problem.collision.link_pairs
        return self._clearance(pairs, 0.0, "no pair of links is checked")

    def _clearance(self, pairs: np.ndarray, required: float, not_asked: str) -> JudgedCondition:
        checker = self._problem.collision
        nearest = closest_approach(checker, self._trajectory, pairs, required)
        if nearest is None:
            if not checker.has_link_geometry:
                not_asked = "the robot has no collision geometry: nothing could be checked"
            return JudgedCondition(None, "m", Place(), not_asked)
        links, obstacle = checker.owners(nearest.pair)
        place = Place(time=nearest.time, links=links, obstacle=obstacle)
        margin, attained = nearest.lower_bound - required, nearest.distance - required
        return JudgedCondition(margin, "m", place, _bracketed(margin, attained, "m"))

    @cached_property
    def _pose(self) -> EnclosedPose | None:
        """The tool's path and, if the tube bounds it, orientation."""
        if self._tube.rotation is None:
            return None
        return enclosed_pose(self._robot, self._trajectory, _POSE_ENCLOSURE, _ROTATION_ENCLOSURE)

    @cached_property
    def _tool(self) -> Enclosure:
        """The tool's path."""
        if self._pose is not None:
            return self._pose.tool
        return enclosed_tool(self._robot, self._trajectory, _TOOL_ENCLOSURE)

    def _visits_by_range(self) -> list[list[Visit]]:
        """Return the visits, neighbours together whose segments have the same joint ranges."""
        ranges = np.hstack(self._tube.ranges_of(self._robot.joint_names))
        found = groupby(self.visits, key=lambda visit: ranges[visit.segment].tobytes())
        return [list(visits) for _, visits in found]

    @cached_property
    def visits(self) -> list[Visit]:
        """The trajectory's share of each segment that it visits."""
        rotation = None if self._pose is None else self._pose.rotation
        return tube_visits(self._problem, self._trajectory, self._tool, rotation)

    def _range_margin(
        self, trajectory: JointTrajectory, lower: FloatArray, upper: FloatArray
    ) -> tuple[float | None, Place]:
        """Return the least margin between joints and a range over a trajectory, exactly."""
        used, joints = [], []
        for sign, bound in ((1.0, upper), (-1.0, -lower)):
            bounded = np.flatnonzero(np.isfinite(bound))
            over = sign * trajectory.coefficients[:, :, bounded]
            over[-1] -= bound[bounded]
            used.append(over)
            joints += bounded.tolist()
        if not joints:
            return None, Place()
        highest = maxima(np.concatenate(used, axis=2), trajectory.widths)
        peak, time, column = _highest(highest, trajectory)
        return -peak, Place(time=time, joint=self._robot.joint_names[joints[column]])

    def _piece_ends(self, order: int) -> FloatArray:
        """Return a derivative at the start and the end of every piece, shape (2, pieces, n)."""
        coefficients = self._trajectory.derivative_coefficients(order)
        powers = np.arange(len(coefficients) - 1, -1, -1)
        widths = self._trajectory.widths[None, :] ** powers[:, None]
        return np.array([coefficients[-1], np.einsum("kpn,kp->pn", coefficients, widths)])

    @cached_property
    def _largest(self) -> list[FloatArray]:
        """The largest magnitudes of position, velocity and acceleration per joint, each (n,).

        A joint that all but stands still is measured by the others: its own rounding errors are not
        jumps.
        """
        found = []
        for order in range(3):
            coefficients = self._trajectory.derivative_coefficients(order)
            largest = peak_magnitudes(coefficients, self._trajectory.widths).value
            overall = float(largest.max())
            found.append(np.maximum(largest, _STILL_SHARE * overall if overall > 0 else 1.0))
        return found


def _highest(extrema: Extrema, trajectory: JointTrajectory) -> tuple[float, float, int]:
    """Return the largest of several extrema, its time [s] and which one it is."""
    column = int(extrema.value.argmax())
    start = trajectory.breakpoints[extrema.piece[column]]
    return float(extrema.value[column]), float(start + extrema.local_time[column]), column


def _bracketed(lower: float, attained: float, unit: str) -> str:
    """Return the coverage of a margin: for all t, undecided if its bounds are far apart."""
    allowed = max(_UNDECIDED_LENGTH, _UNDECIDED_SHARE * abs(attained))
    return FOR_ALL_TIMES if lower >= attained - allowed else _undecided(attained, unit)


def _undecided(attained: float, unit: str) -> str:
    return f"for all t, undecided: the margin found is {attained:.3g} {unit}"
