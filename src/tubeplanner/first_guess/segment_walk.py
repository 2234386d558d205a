"""The arm through one segment by inverse kinematics, and the tool's target orientation there.

At inner reference points the tool has the reference orientation; a given start or goal may deviate
from it within the tolerance. In between, the rotation vector goes from one to the other in
proportion to the arc length. Components that the segment leaves free follow from the joints, unless
the next segment bounds them: they then enter their bounds by the switching time.
"""

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.first_guess.inverse_kinematics import (
    PositionSolution,
    WantedRotation,
    solve_position,
)
from tubeplanner.geometry.tube.rotation import RotationalTube
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem

# ---- The target orientation of the tool along one tube segment.

# Where the arm cannot reach the target orientation, it must keep this fraction of the distance to
# the bound, so that the planner has some freedom to start with.
_KEPT_MARGIN_FRACTION = 0.1
_THERE = 1e-9  # [m or rad]: errors of a solution at its target


class ReferenceRotation:
    """The target rotation at every fraction of a segment, and the test of deviations from it."""

    def __init__(
        self,
        problem: PlanningProblem,
        tube: RotationalTube,
        segment: int,
        begin: FloatArray,
        goal: FloatArray | None,
    ) -> None:
        """Prepare for a segment.

        The goal is the configuration at the segment's end, if given.
        """
        self._robot, self._tube, self._segment = problem.robot, tube, segment
        self._following = min(segment + 1, len(tube.bounds) - 1)
        components = bounded_components(tube, segment)
        self._components = components | bounded_components(tube, self._following)
        self._begin = self._vector(begin)
        open_goal = problem.open_goal
        if goal is not None:
            self._end = self._vector(goal)
        elif open_goal is None or self._following < problem.tube.segment_count:
            self._end = np.zeros(3)
        else:
            tool = open_goal.position[None]
            reference = self._tube.reference(tool, self._following)
            self._end = self._tube.error(reference, tool, segment)[0] * self._components
        ends = np.array([self._begin, self._end])
        self._keeps_bounds = bool(self._tube.margin_of(ends, segment).min() >= 0)

    def target(self, fraction: float, point: FloatArray) -> WantedRotation:
        """Return the tool's target orientation at a point (3,), after a fraction of the segment."""
        reference = self._tube.reference(point[None], self._segment)[0]
        return WantedRotation(reference, self._vector_after(fraction), self._components)

    def off_segment(self, solution: PositionSolution, fraction: float) -> int | None:
        """Return the segment whose rotation tolerance a solution violates, if any."""
        is_there = max(solution.error, solution.rotation_error) < _THERE
        if is_there and fraction < 1.0 and self._keeps_bounds:
            return None  # its rotation lies between two that keep the bounds
        rotation, tool = self._robot.tool_pose(solution.q[None])
        for segment in {self._segment, self._following if fraction == 1.0 else self._segment}:
            target = float(self._tube.margin_of(self._vector_after(fraction)[None], segment)[0])
            margin = float(self._tube.margin(rotation, tool, segment)[0])
            if margin < _KEPT_MARGIN_FRACTION * target - MARGIN_TOLERANCE:
                return segment
        return None

    def _vector_after(self, fraction: float) -> FloatArray:
        return (1 - fraction) * self._begin + fraction * self._end

    def _vector(self, q: FloatArray) -> FloatArray:
        """Return the rotation vector (3,) of a configuration (n,), free components zero."""
        rotation, tool = self._robot.tool_pose(q[None])
        return self._tube.error(rotation, tool, self._segment)[0] * self._components


def bounded_components(tube: RotationalTube, segment: int) -> BoolArray:
    """Return a mask of the components of the rotation vector that a segment bounds, (3,)."""
    return np.isfinite(tube.bounds[segment, :3]) | np.isfinite(tube.bounds[segment, 3])


def wanted_at(
    problem: PlanningProblem, point: FloatArray, segment: int, near: FloatArray | None = None
) -> WantedRotation | None:
    """Return the tool's target orientation at a point (3,) [m]; None if no rotation is bounded.

    It has the rotation vector of the configuration `near` (n,); None: the reference. After the last
    segment, it is the goal's.
    """
    tube = problem.rotation
    if tube is None:
        return None
    vector = np.zeros(3)
    if near is not None:
        rotation, tool = problem.robot.tool_pose(near[None])
        vector = tube.error(rotation, tool, segment)[0]
    reference = tube.reference(point[None], segment)[0]
    return WantedRotation(reference, vector, bounded_components(tube, segment))


# ---- The arm through one tube segment: a continuous chain of inverse kinematics solutions.

# The longest step, as a fraction of a segment; among many short ones, as a fraction of the route.
_MAX_STEP, _MAX_ROUTE_STEP = 1 / 40, 1 / 400
_EXTRAPOLATED_POINTS = 5
_REACHED = 1e-9  # [m]
_MIN_STEP = 1e-5  # of a segment
_MAX_JOINT_STEP = 0.1  # [joint units] between neighbouring configurations
_MAX_PULL = 0.05  # [joint units] on redundant joints from one configuration to the next
_MAX_SETTLING_STEPS = 500
_SETTLED = 1e-9  # [joint units]
# Where the centre line cannot be reached, the tool may leave it by this fraction of the radius.
_ALLOWED_RADIUS_FRACTION = 0.5
# Distance from an open goal without a tolerance [m]; with a tolerance, the tool may end within this
# fraction of the tolerance, if it gets no nearer.
_OPEN_GOAL_TOLERANCE = MARGIN_TOLERANCE / 2
_GOAL_FRACTION = 0.9


class SegmentWalk:
    """Follows a straight line of the tool from a configuration, in small joint steps.

    Every step moves redundant joints a little towards their targets, and narrows joint bounds
    towards the bounds at the switching time to the next segment. Where that is not enough, the
    joints move on at the segment's end, while the tool stands still.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        segment: int,
        ends: FloatArray,
        begin: FloatArray,
        target: FloatArray | None,
        goal: FloatArray | None,
        *,
        with_rotation: bool = True,
    ) -> None:
        """Prepare a walk.

        The tool goes from end to end (2, 3) [m]. Redundant joints go to targets at the start and at
        the end (2, n), or move as little as possible. The walk settles in the goal, or where the
        next segment allows it.
        """
        self._problem, self._segment = problem, segment
        self._ends, self._begin = ends, begin
        self._wanted, self._goal = target, goal
        self._lower, self._upper = problem.joint_lower[segment], problem.joint_upper[segment]
        following = min(segment + 1, problem.tube.segment_count - 1)
        self._end_lower = np.maximum(self._lower, problem.joint_lower[following])
        self._end_upper = np.minimum(self._upper, problem.joint_upper[following])
        # Excess of the first configuration over the end's bounds: bounds begin wider by as much.
        self._below = np.maximum(self._end_lower - begin, 0.0)
        self._above = np.maximum(begin - self._end_upper, 0.0)
        self._narrows = bool(self._below.any() or self._above.any())
        # The largest distances of the tool from the line and from its end [m].
        radius = problem.tube.effective_radius
        self._allowed = _ALLOWED_RADIUS_FRACTION * float(radius[segment])
        if segment + 1 == len(radius):
            end = problem.open_goal
            at_end = np.inf if end is None else _GOAL_FRACTION * end.tolerance
            self._allowed_at_end = max(min(self._allowed, at_end), _OPEN_GOAL_TOLERANCE)
        else:
            following_radius = float(radius[segment + 1])
            self._allowed_at_end = min(self._allowed, _ALLOWED_RADIUS_FRACTION * following_radius)
        length = np.linalg.norm(np.diff(problem.tube.points, axis=0), axis=1)
        self._max_step = float(
            np.clip(_MAX_ROUTE_STEP * length.sum() / length[segment], _MAX_STEP, 1.0)
        )
        tube, self._rotation = problem.rotation, None
        if tube is not None and with_rotation:
            self._rotation = ReferenceRotation(problem, tube, segment, begin, goal)

    def to_the_end(self) -> FloatArray:
        """Return the configurations (P, n) from the segment's start to its end.

        Raises:
            Infeasible: Status unreachable: the message says where the walk ends and why.
        """
        walk, fractions, step, reached = [self._begin], [0.0], self._max_step, 1
        while fractions[-1] < 1.0:
            fraction = min(1.0, fractions[-1] + step)
            count = min(max(reached, 2), _EXTRAPOLATED_POINTS)
            seed = _extrapolated(fraction, fractions[-count:], walk[-count:])
            solution = self._solve(fraction, seed, walk[-1])
            joint_step = self._joint_step(walk[-1], solution.q)
            if self._is_off(solution, fraction) or joint_step > _MAX_JOINT_STEP:
                step /= 2
                if step < _MIN_STEP:
                    self._give_up(fraction, walk[-1], solution)
                continue
            walk.append(solution.q)
            fractions.append(fraction)
            # Beside a target out of reach configurations jitter: a line alone extrapolates them.
            reached = reached + 1 if solution.error < _REACHED else 0
            if joint_step < _MAX_JOINT_STEP / 3:
                step = min(2 * step, self._max_step)
        return np.array(self._confirmed(walk))

    def _confirmed(self, walk: list[FloatArray]) -> list[FloatArray]:
        """Move redundant joints to the bounds or goal at the segment's end, the tool still."""
        for _ in range(_MAX_SETTLING_STEPS):
            q = walk[-1]
            target = np.clip(q, self._end_lower, self._end_upper)
            target = target if self._goal is None else self._goal
            if self._joint_step(q, target) <= _SETTLED:
                break
            preferred = q + self._pull(target - q)
            solution = self._solve_with(1.0, q, preferred)
            if self._is_off(solution, 1.0) or self._joint_step(q, solution.q) <= _SETTLED:
                break
            walk.append(solution.q)
        q = walk[-1]
        outside = np.maximum(self._end_lower - q, q - self._end_upper)
        worst = int(outside.argmax())
        if not outside[worst] <= 10 * _SETTLED:
            joint = self._problem.robot.joint_names[worst]
            number = self._problem.tube.segment_number(self._segment, self._ends[1])
            location = Location(joint=joint, segment=number).at(self._ends[1])
            raise Infeasible(
                PlanStatus.UNREACHABLE,
                f"at the end of segment {number} '{joint}' is at {q[worst]:.4f} rad, but the joint "
                f"signs on both sides of the switching time ask for [{self._end_lower[worst]:g}, "
                f"{self._end_upper[worst]:g}]; move the reference point or change the signs",
                location,
                configuration=q,
            )
        walk[-1] = np.clip(walk[-1], self._end_lower, self._end_upper)
        return walk

    def _solve(self, fraction: float, seed: FloatArray, last: FloatArray) -> PositionSolution:
        target = last
        if self._wanted is not None:
            target = (1 - fraction) * self._wanted[0] + fraction * self._wanted[1]
        lower, upper = self._end_lower, self._end_upper
        if self._narrows:
            lower = lower - (1 - fraction) * self._below
            upper = upper + (1 - fraction) * self._above
        target = np.minimum(np.maximum(target, lower), upper)
        solution = self._solve_with(fraction, seed, target)
        if self._joint_step(last, solution.q) <= _MAX_JOINT_STEP:
            return solution
        # Too far for one step, however short: redundant joints go there gradually.
        return self._solve_with(fraction, seed, last + self._pull(target - last))

    def _joint_step(self, q: FloatArray, other: FloatArray) -> float:
        """Return the farthest joint's travel between two configurations [joint units]."""
        return float((abs(other - q) / self._problem.robot.joint_units).max())

    def _pull(self, travel: FloatArray) -> FloatArray:
        """Return the part of a travel (n,) on which joints are pulled at once [rad or m]."""
        most = _MAX_PULL * self._problem.robot.joint_units
        return np.clip(travel, -most, most)

    def _solve_with(
        self, fraction: float, seed: FloatArray, preferred: FloatArray
    ) -> PositionSolution:
        robot, point = self._problem.robot, self._point(fraction)
        rotation = None if self._rotation is None else self._rotation.target(fraction, point)
        return solve_position(robot, point, seed, self._lower, self._upper, preferred, rotation)

    def _point(self, fraction: float) -> FloatArray:
        return (1 - fraction) * self._ends[0] + fraction * self._ends[1]

    def _is_off(self, solution: PositionSolution, fraction: float) -> bool:
        rotation = self._rotation
        turns = rotation is not None and rotation.off_segment(solution, fraction) is not None
        return turns or self._is_away(solution, fraction)

    def _is_away(self, solution: PositionSolution, fraction: float) -> bool:
        return solution.error > (self._allowed_at_end if fraction == 1.0 else self._allowed)

    def _give_up(self, fraction: float, q: FloatArray, solution: PositionSolution) -> None:
        point = self._point(fraction)
        number = self._problem.tube.segment_number(self._segment, point)
        location = Location(segment=number).at(point)
        where = f"{100 * fraction:.1f} % along {location}"
        jump = abs(solution.q - q)
        joint = self._problem.robot.joint_names[int(jump.argmax())]
        jumps = f"'{joint}' would have to jump by {jump.max():.3f} rad"
        rotation = self._rotation
        if rotation is not None:
            free = solve_position(self._problem.robot, point, q, self._lower, self._upper)
            if self._joint_step(q, free.q) > _MAX_JOINT_STEP or self._is_away(free, fraction):
                rotation = None
        if rotation is not None:  # the tool could go on with another orientation
            off = rotation.off_segment(solution, fraction)
            why = jumps if off is None else rotation_text(solution)
            reason = explain_rotation(self._problem, self._segment if off is None else off, why)
        elif self._is_off(solution, fraction):
            reason = explain_error(self._problem, point, q, self._segment, solution)
        else:
            reason = (
                f"no continuous branch: {jumps}; move the reference points or free the joint signs"
            )
        message = f"{where}: {reason}"
        raise Infeasible(PlanStatus.UNREACHABLE, message, location, configuration=q)


def _extrapolated(fraction: float, fractions: list[float], q: list[FloatArray]) -> FloatArray:
    """Return the value (n,) of the polynomial through configurations at fractions of a segment."""
    weights = np.ones(len(fractions))
    for i, node in enumerate(fractions):
        for other in fractions:
            if other != node:
                weights[i] *= (fraction - other) / (node - other)
    value: FloatArray = weights.dot(q)
    return value


def explain_error(
    problem: PlanningProblem,
    point: FloatArray,
    seed: FloatArray,
    segment: int,
    solution: PositionSolution,
) -> str:
    """Return the condition that keeps the tool from a point, by dropping conditions in turn."""
    robot, limits = problem.robot, problem.robot.limits
    short = f"the tool stops {solution.error:.4g} m short"
    free = np.full(robot.joint_count, np.inf)
    without_limits = solve_position(robot, point, seed, -free, free)
    if without_limits.error > 1e-6:
        return (
            f"the tool stops {without_limits.error:.4g} m short even without joint limits; move "
            "the point nearer"
        )
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    at_bound = (solution.q <= lower) | (solution.q >= upper)
    joints = [name for name, is_bound in zip(robot.joint_names, at_bound, strict=True) if is_bound]
    if not joints:
        return f"{short} without a jump of the joints: a singular configuration is in the way"
    bounds = f"(at their bounds: {', '.join(joints)})"
    without_signs = solve_position(robot, point, seed, limits.lower_position, limits.upper_position)
    if without_signs.error > 1e-6:
        return f"{short}: position limits are in the way {bounds}"
    number = problem.tube.segment_number(segment, point)
    return f"{short} with the joint signs of segment {number} {bounds}"


def explain_rotation(problem: PlanningProblem, segment: int, why: str) -> str:
    """Return the message that only the rotation tolerance keeps the tool from a point."""
    rotation = problem.rotation
    bounds = [np.inf] if rotation is None else rotation.bounds[segment].tolist()
    tolerance = f"{bounds[-1]:.3g}"
    if bounds[-1] == np.inf:
        tolerance = f"[{', '.join(f'{bound:.3g}' for bound in bounds[:3])}]"
    if segment == problem.tube.segment_count:
        whose, widened = "the goal", "goal.rotation_tolerance"
    else:
        number = problem.tube.segment_number(segment)
        whose, widened = f"segment {number}", f"tube.rotation_tolerance[{number}]"
    return (
        f"the rotation tolerance of {whose}, {tolerance} rad, is in the way: {why}; widen "
        f"{widened}, change tube.orientations or move the reference points"
    )


def rotation_text(solution: PositionSolution) -> str:
    """Return the message on the tool's least angle to its reference orientation [rad]."""
    return (
        f"the tool stays {solution.rotation_error:.3g} rad or more from its reference orientation; "
        "planning keeps a tenth of the tolerance in reserve"
    )
