"""The independent judge: does a trajectory do what the problem asks?

It uses robot, tube, collision geometry and the trajectory's polynomials, and nothing of the code
that made the trajectory.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar

from tubeplanner.arrays import FloatArray
from tubeplanner.bernstein import maxima
from tubeplanner.certificate import FOR_ALL_TIMES, RELATIVE, Certificate, Condition, Tolerance
from tubeplanner.closest_approach import closest_approach
from tubeplanner.hand_overs import best_hand_overs
from tubeplanner.outcome import Place
from tubeplanner.peaks import refined_maximum
from tubeplanner.problem import PlanningProblem, Seed
from tubeplanner.trajectory import JointTrajectory, TrajectorySamples

_LEAST_SAMPLES = 2000
_LEAST_SAMPLES_PER_PIECE = 20
_PEAK_BAND = 0.02  # peaks this near the highest sample are refined: share of effort, of radius
_HAND_OVER_TOLERANCE = 1e-10  # [s]
_STILL_SHARE = 1e-6  # a joint slower than this share of the fastest counts as standing still


def verify(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tolerance: Tolerance | None = None,
) -> Certificate:
    """Judge a trajectory.

    Args:
        problem: What was asked.
        trajectory: Of the problem's joints, in any order.
        tolerance: How far below zero margins may lie; default: 1e-6 m, rad and relative.

    Raises:
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    tolerance = tolerance or Tolerance()
    judge = _Judge(problem, trajectory.reordered(problem.robot.joint_names), tolerance)
    conditions = {
        "position": judge.position(),
        "velocity": judge.derivative(1, problem.robot.limits.velocity),
        "acceleration": judge.derivative(2, problem.robot.limits.acceleration),
        "jerk": judge.derivative(3, problem.robot.limits.jerk),
        "effort": judge.effort(),
        "tube": judge.tube(),
        "joint_signs": judge.joint_signs(),
        "rotation": Condition(None, "rad", Place(), "the hand's orientation is free"),
        "start": judge.endpoint(0),
        "goal": judge.endpoint(-1),
        "rest": judge.rest(),
        "continuity": judge.continuity(),
        "obstacles": judge.obstacles(),
        "self_collision": judge.self_collision(),
    }
    return Certificate(conditions, tolerance)


@dataclass(frozen=True, eq=False)
class _Visit:
    """One tube segment's share of the trajectory: its samples, times and tube margins."""

    segment: int
    begin: float
    end: float
    time: FloatArray
    margin: FloatArray


class _Judge:
    """Computes each condition of one trajectory."""

    def __init__(
        self, problem: PlanningProblem, trajectory: JointTrajectory, tolerance: Tolerance
    ) -> None:
        self._problem, self._trajectory, self._tolerance = problem, trajectory, tolerance
        self._robot, self._tube = problem.robot, problem.tube

    def position(self) -> Condition:
        """Position limits, exactly."""
        limits = self._robot.limits
        margin, place = self._range_margin(
            self._trajectory, limits.lower_position, limits.upper_position
        )
        if margin is None:
            return Condition(None, "rad", Place(), "no joint has position limits")
        return Condition(margin, self._unit_at(place), place, FOR_ALL_TIMES)

    def derivative(self, order: int, limit: FloatArray) -> Condition:
        """A limit on velocity, acceleration or jerk, exactly."""
        bounded = np.flatnonzero(np.isfinite(limit))
        if len(bounded) == 0:
            return Condition(None, RELATIVE, Place(), "no joint has this limit")
        used = self._trajectory.derivative_coefficients(order)[:, :, bounded] / limit[bounded]
        peak, time, column = _highest(np.concatenate([used, -used], axis=2), self._trajectory)
        joint = self._robot.joint_names[bounded[column % len(bounded)]]
        return Condition(1 - peak, RELATIVE, Place(time=time, joint=joint), FOR_ALL_TIMES)

    def effort(self) -> Condition:
        """Effort limits, at samples."""
        limit = self._robot.limits.effort
        if not np.isfinite(limit).any():
            return Condition(None, RELATIVE, Place(), "no joint has this limit")
        peak, time = refined_maximum(
            lambda t: self._effort_share(self._trajectory.at(t)).max(axis=1),
            self._samples.time,
            self._effort_share(self._samples).max(axis=1),
            band=_PEAK_BAND,
        )
        joint = int(self._effort_share(self._trajectory.at(np.array([time])))[0].argmax())
        place = Place(time=time, joint=self._robot.joint_names[joint])
        return Condition(1 - peak, RELATIVE, place, self._coverage)

    def tube(self) -> Condition:
        """The hand in the tube, segment by segment or in their union, at samples."""
        peaks = [(*self._farthest(visit), visit.segment) for visit in self._visits]
        outside, time, segment = max(peaks, key=lambda peak: peak[0])
        return Condition(-outside, "m", Place(time=time, segment=segment), self._coverage)

    def joint_signs(self) -> Condition:
        """Joint ranges of the segments, exactly between the hand-overs."""
        lower, upper = self._tube.ranges_of(self._robot.joint_names)
        found = []
        for visit in self._visits:
            part = self._trajectory.between(visit.begin, visit.end)
            margin, place = self._range_margin(part, lower[visit.segment], upper[visit.segment])
            if margin is not None:
                time = visit.begin + (place.time or 0.0)
                found.append((margin, Place(time, place.joint, visit.segment)))
        if not found:
            return Condition(None, "rad", Place(), "no segment has joint signs")
        margin, place = min(found, key=lambda item: item[0])
        coverage = FOR_ALL_TIMES if self._tube.visit == "ordered" else self._coverage
        return Condition(margin, self._unit_at(place), place, coverage)

    def endpoint(self, index: int) -> Condition:
        """Start (0) or goal (-1): the given configuration, or else the reference point."""
        given = self._problem.start if index == 0 else self._problem.goal
        time = 0.0 if index == 0 else self._trajectory.duration
        q = self._trajectory.position(time)
        if given is None or isinstance(given, Seed):
            hand = self._robot.tool_position(q[None])[0]
            error = float(np.linalg.norm(hand - self._tube.points[index]))
            return Condition(0.0 - error, "m", Place(time=time), "hand at the reference point")
        joint = int(abs(q - given).argmax())
        place = Place(time=time, joint=self._robot.joint_names[joint])
        return Condition(0.0 - float(abs(q - given).max()), self._unit(joint), place, FOR_ALL_TIMES)

    def rest(self) -> Condition:
        """Velocity and acceleration at both ends, relative to their largest values."""
        worst, place = 0.0, Place()
        for order in (1, 2):
            values = self._piece_ends(order)
            ends = np.array([values[0, 0], values[1, -1]])
            share = abs(ends) / self._largest(order)
            if share.max() > worst:
                end, joint = np.unravel_index(int(share.argmax()), share.shape)
                time = float(self._trajectory.breakpoints[-end])
                worst = float(share.max())
                place = Place(time=time, joint=self._robot.joint_names[joint])
        return Condition(0.0 - worst, RELATIVE, place, FOR_ALL_TIMES)

    def continuity(self) -> Condition:
        """Jumps of position, or of velocity and acceleration relative to their largest values.

        The one reported is the worst, each measured by its own tolerance.
        """
        found = [Condition(0.0, RELATIVE, Place(), FOR_ALL_TIMES)]
        for order in range(3):
            values = self._piece_ends(order)
            jumps = abs(values[0, 1:] - values[1, :-1])
            if jumps.size == 0:
                continue
            if order > 0:
                jumps = jumps / self._largest(order)
            at, joint = np.unravel_index(int(jumps.argmax()), jumps.shape)
            time = float(self._trajectory.breakpoints[at + 1])
            place = Place(time=time, joint=self._robot.joint_names[joint])
            unit = self._unit(int(joint)) if order == 0 else RELATIVE
            found.append(Condition(0.0 - float(jumps.max()), unit, place, FOR_ALL_TIMES))
        return min(found, key=self._in_tolerances)

    def _in_tolerances(self, condition: Condition) -> float:
        """Return a margin as a multiple of the tolerance that it is judged by."""
        return (condition.margin or 0.0) / max(self._tolerance.of(condition.unit), 1e-300)

    def _unit_at(self, place: Place) -> str:
        """Return the unit of the position of the joint that a place names."""
        return self._unit(self._robot.joint_names.index(place.joint or ""))

    def _unit(self, joint: int) -> str:
        """Return the unit of a joint's position."""
        return "rad" if self._robot.revolute[joint] else "m"

    def obstacles(self) -> Condition:
        """Links against obstacles, for all t."""
        pairs = self._problem.collision.obstacle_pairs
        return self._clearance(pairs, self._problem.clearance, "no link can meet an obstacle")

    def self_collision(self) -> Condition:
        """Links against links, for all t."""
        pairs = self._problem.collision.link_pairs
        return self._clearance(pairs, 0.0, "no pair of links is checked")

    def _clearance(self, pairs: np.ndarray, required: float, not_asked: str) -> Condition:
        checker = self._problem.collision
        nearest = closest_approach(checker, self._trajectory, pairs, required)
        if nearest is None:
            if not checker.has_link_geometry:
                not_asked = "the robot has no collision geometry: nothing could be checked"
            return Condition(None, "m", Place(), not_asked)
        links, obstacle = checker.owners(nearest.pair)
        place = Place(time=nearest.time, links=links, obstacle=obstacle)
        return Condition(nearest.lower_bound - required, "m", place, FOR_ALL_TIMES)

    @cached_property
    def _samples(self) -> TrajectorySamples:
        pieces = len(self._trajectory.widths)
        count = max(_LEAST_SAMPLES_PER_PIECE, -(-_LEAST_SAMPLES // pieces))
        return self._trajectory.per_piece(count)

    @property
    def _coverage(self) -> str:
        count = len(self._samples.time)
        spacing = np.diff(self._samples.time).max()
        return f"at {count} samples, at most {1000 * spacing:.3g} ms apart, peaks refined"

    def _effort_share(self, samples: TrajectorySamples) -> FloatArray:
        """Return the share of each motor's effort that samples use, shape (N, n)."""
        tau = self._robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
        return abs(tau) / self._robot.limits.effort

    def _farthest(self, visit: _Visit) -> tuple[float, float]:
        """Return how far outside its capsule a visit gets [m] and when; negative inside."""
        capsule = slice(visit.segment, visit.segment + 1)

        def outside(time: FloatArray) -> FloatArray:
            hand = self._robot.tool_position(self._trajectory.position(time))
            return -self._tube.margin(hand, capsule)[:, 0]

        band = _PEAK_BAND * float(self._tube.effective_radius[visit.segment])
        return refined_maximum(outside, visit.time, -visit.margin, band=band)

    @cached_property
    def _visits(self) -> list[_Visit]:
        """The trajectory's share of each segment it visits."""
        margin = self._tube.margin(self._robot.tool_position(self._samples.position))
        fit = np.minimum(margin, self._sign_margin(self._samples.position))
        if self._tube.visit == "any":
            return self._visits_in_any_order(margin, fit)
        indices = best_hand_overs(fit)
        times = [self._refined_hand_over(k, int(index)) for k, index in enumerate(indices)]
        bounds = np.concatenate([[0.0], np.maximum.accumulate([0.0, *times])[1:]])
        bounds = np.append(bounds, self._trajectory.duration)
        return [
            self._visit(k, begin, end, margin[:, k])
            for k, (begin, end) in enumerate(pairwise(bounds))
        ]

    def _visit(self, segment: int, begin: float, end: float, margin: FloatArray) -> _Visit:
        """Return a segment's share between two times, its ends included."""
        time = self._samples.time
        inside = (begin <= time) & (time <= end)
        ends = np.array([begin, end])
        hand = self._robot.tool_position(self._trajectory.position(ends))
        at_ends = self._tube.margin(hand, slice(segment, segment + 1))[:, 0]
        return _Visit(
            segment,
            begin,
            end,
            np.concatenate([[begin], time[inside], [end]]),
            np.concatenate([at_ends[:1], margin[inside], at_ends[1:]]),
        )

    def _visits_in_any_order(self, margin: FloatArray, fit: FloatArray) -> list[_Visit]:
        """Return a visit per run of samples that fit the same segment best."""
        best = fit.argmax(axis=1)
        time = self._samples.time
        edges = np.flatnonzero(np.diff(best)) + 1
        runs = np.split(np.arange(len(best)), edges)
        return [
            _Visit(
                int(best[run[0]]), time[run[0]], time[run[-1]], time[run], margin[run, best[run[0]]]
            )
            for run in runs
        ]

    def _refined_hand_over(self, k: int, index: int) -> float:
        """Return the hand-over from segment k to k+1, refined between the samples around it."""
        time = self._samples.time
        low, high = time[max(index - 1, 0)], time[min(index + 1, len(time) - 1)]

        def lost(t: float) -> float:
            q = self._trajectory.position(np.array([t]))
            both = slice(k, k + 2)
            margin = self._tube.margin(self._robot.tool_position(q), both)
            return -float(min(margin.min(), self._sign_margin(q)[0, both].min()))

        if high <= low:
            return float(time[index])
        options = {"xatol": _HAND_OVER_TOLERANCE}
        result = minimize_scalar(lost, bounds=(low, high), method="bounded", options=options)
        return float(result.x if result.fun < lost(float(time[index])) else time[index])

    def _sign_margin(self, q: FloatArray) -> FloatArray:
        """Return how well configurations (N, n) keep each segment's joint ranges, (N, m)."""
        lower, upper = self._tube.ranges_of(self._robot.joint_names)
        room = np.minimum(q[:, None] - lower, upper - q[:, None])
        return room.min(axis=2)

    def _range_margin(
        self, trajectory: JointTrajectory, lower: FloatArray, upper: FloatArray
    ) -> tuple[float | None, Place]:
        """Return the least room between joints and a range over a trajectory, exactly."""
        used, joints = [], []
        for sign, bound in ((1.0, upper), (-1.0, -lower)):
            bounded = np.flatnonzero(np.isfinite(bound))
            over = sign * trajectory.coefficients[:, :, bounded]
            over[-1] -= bound[bounded]
            used.append(over)
            joints += bounded.tolist()
        if not joints:
            return None, Place()
        peak, time, column = _highest(np.concatenate(used, axis=2), trajectory)
        return -peak, Place(time=time, joint=self._robot.joint_names[joints[column]])

    def _piece_ends(self, order: int) -> FloatArray:
        """Return a derivative at the start and the end of every piece, shape (2, pieces, n)."""
        coefficients = self._trajectory.derivative_coefficients(order)
        powers = np.arange(len(coefficients) - 1, -1, -1)
        widths = self._trajectory.widths[None, :] ** powers[:, None]
        return np.array([coefficients[-1], np.einsum("kpn,kp->pn", coefficients, widths)])

    def _largest(self, order: int) -> FloatArray:
        """Return the largest magnitude of a derivative per joint, shape (n,).

        A joint that all but stands still is measured by the others: its own rounding errors are
        no motion that could jump.
        """
        coefficients = self._trajectory.derivative_coefficients(order)
        both = np.concatenate([coefficients, -coefficients], axis=2)
        largest = maxima(both, self._trajectory.widths).value.reshape(2, -1).max(axis=0)
        overall = float(largest.max())
        return np.maximum(largest, _STILL_SHARE * overall if overall > 0 else 1.0)


def _highest(coefficients: FloatArray, trajectory: JointTrajectory) -> tuple[float, float, int]:
    """Return the largest value of several polynomials, its time [s] and which one has it."""
    extrema = maxima(coefficients, trajectory.widths)
    column = int(extrema.value.argmax())
    start = trajectory.breakpoints[extrema.piece[column]]
    return float(extrema.value[column]), float(start + extrema.local_time[column]), column
