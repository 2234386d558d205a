"""Variables of a step: free control points, their bounds, columns shared by legs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.limits.rates import approachable_range
from tubeplanner.optimizer.phased_spline import DEGREE, KnotGrid, SampledSpline
from tubeplanner.optimizer.rows import INNER_MARGIN
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.polynomials import REST_POINTS

# ---- The control points that may move, and their bounds.
#
# The control points at rest at both ends are fixed. If the goal is open, its control points move as
# one, and the tool keeps its position there, or stays in the goal's ball. If the start is the end
# of another motion, its control points move as one too.

FIXED = -1
# Directions in which the joints at the goal move the tool by less than this [m/rad] are left free.
_MIN_GAIN = 1e-6
_TOOL_TOLERANCE = 3e-7  # [m], near where the arm loses a direction too
_SAMPLES, _SEED = 5, 0  # configurations in the test for redundant joints


class ControlVariables:
    """F variables, each a configuration: the control points that may move.

    Attributes:
        column: The variable of every control point, -1 where it is fixed, shape (K,).
        lower: Bounds of the variables, shape (F, n) [rad or m].
        upper: Bounds of the variables, shape (F, n) [rad or m].
        goal_moves: Whether the goal is open and has a tolerance or redundant joints.
    """

    def __init__(
        self, problem: PlanningProblem, grid: KnotGrid, *, start_moves: bool = False
    ) -> None:
        """Take a problem, the knots of its splines, and whether its start moves.

        The conditions on a start that moves are those of the motion that ends there.
        """
        self._problem, self._grid = problem, grid
        self._goal = problem.open_goal
        self.goal_moves = self._goal is not None and (
            self._goal.tolerance > 0 or _is_redundant(problem)
        )
        self.column = np.arange(grid.control_point_count) - REST_POINTS + start_moves
        self.column[:REST_POINTS] = 0 if start_moves else FIXED
        last = self.column[-REST_POINTS - 1] + 1 if self.goal_moves else FIXED
        self.column[-REST_POINTS:] = last
        # Control points that move, their variables, and the first point of each variable.
        self._moving = moving = np.flatnonzero(self.column != FIXED)
        self._own = self.column[moving]
        self._first = moving[np.unique(self._own, return_index=True)[1]]
        count = int(self.column.max()) + 1
        # Joint bounds of the control points, (K, n), by all phases that they belong to: a spline
        # lies in the hull of its control points, so the bounds hold for all t.
        shape = (grid.control_point_count, problem.robot.joint_count)
        lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
        # Where joints may hardly move, rows lead to no better trajectory.
        joint_lower, joint_upper = (
            np.clip(bound, problem.joint_lower, problem.joint_upper)
            for bound in approachable_range(problem)
        )
        first = 0
        for fractions, run in zip(grid.fractions, grid.runs, strict=True):
            counting = slice(first, first + len(fractions) - 1 + DEGREE)
            segments = slice(run.start, run.stop)
            lower[counting] = np.maximum(lower[counting], joint_lower[segments].max(axis=0))
            upper[counting] = np.minimum(upper[counting], joint_upper[segments].min(axis=0))
            first += len(fractions) - 1
        self._fraction_of_goal = _minimum_jerk(grid.control_point_count)
        self.lower, self.upper = np.full((2, count, lower.shape[1]), np.inf)
        self.lower *= -1
        np.maximum.at(self.lower, self._own, lower[moving])
        np.minimum.at(self.upper, self._own, upper[moving])

    def of(self, control_points: FloatArray) -> FloatArray:
        """Return the variables of control points (K, n), shape (F, n)."""
        return control_points[self._first]

    def before(self, intervals: IntArray) -> IntArray:
        """Return the number of variables before the ends of knot intervals (S,), shape (S,)."""
        so_far = np.maximum.accumulate(self.column + 1)
        before: IntArray = so_far[intervals + DEGREE // 2]
        return before

    def change(self, step: FloatArray) -> FloatArray:
        """Return the change of control points, (K, n), by a step of the variables (F, n)."""
        change = np.zeros((len(self.column), step.shape[1]))
        change[self._moving] = step[self._own]
        return change

    def collected(self, by_point: FloatArray) -> FloatArray:
        """Return derivatives by variables, (F, n), from derivatives by control points (K, n)."""
        by_variable = np.zeros_like(self.lower)
        np.add.at(by_variable, self._own, by_point[self._moving])
        return by_variable

    def within_bounds(self, control_points: FloatArray) -> FloatArray:
        """Return control points (K, n), clipped to their bounds where they may move."""
        inside = self.of(control_points).clip(self.lower, self.upper)
        points = control_points.copy()
        points[self._moving] = inside[self._own]
        return points

    def tie(self, following: "ControlVariables") -> None:
        """Give the goal, and the start of a motion that begins there, the same bounds."""
        self.lower[-1] = following.lower[0] = np.maximum(self.lower[-1], following.lower[0])
        self.upper[-1] = following.upper[0] = np.minimum(self.upper[-1], following.upper[0])

    def moved(
        self, control_points: FloatArray, step: FloatArray, start: FloatArray | None = None
    ) -> FloatArray | None:
        """Return control points (K, n) after a step (F, n), the tool still at an open goal.

        A start that moves is then at `start`, shape (n,). None if the tool cannot be kept there.
        """
        points = control_points + self.change(step)
        if start is not None:
            points = self._corrected(points, slice(REST_POINTS), start, 1 - self._fraction_of_goal)
        if self.goal_moves:
            goal = self.goal_after(control_points, step)
            if goal is None:
                return None
            last = slice(-REST_POINTS, None)
            points = self._corrected(points, last, goal, self._fraction_of_goal)
        return points

    def _corrected(
        self, points: FloatArray, rest: slice, end: FloatArray, fraction: FloatArray
    ) -> FloatArray:
        """Return control points (K, n) within bounds, those at rest at an end (n,).

        The correction is spread over the whole motion by a fraction (K,) at each point: at an end
        alone, on its short knot intervals, it would be a jump of the jerk. Of a joint that it would
        lead out of its bounds, it begins behind the last such point: a clipped point alone would be
        a dent, and in a short phase a jump of the acceleration.
        """
        points = self.within_bounds(points)
        shift = end - points[rest][0]
        shifted = points + fraction[:, None] * shift
        shifted[rest] = end
        is_outside = shifted != self.within_bounds(shifted)
        begin = (is_outside * fraction[:, None]).max(axis=0)
        for joint in np.flatnonzero(begin):
            x = np.clip((fraction - begin[joint]) / (1 - begin[joint]), 0.0, 1.0)
            shifted[:, joint] = points[:, joint] + x**2 * (3 - 2 * x) * shift[joint]
        shifted[rest] = end
        return self.within_bounds(shifted)

    def goal_after(self, control_points: FloatArray, step: FloatArray) -> FloatArray | None:
        """Return the configuration (n,) at a goal that moves, after a step; arguments as `moved`.

        Returns:
            None if the tool cannot be kept there.
        """
        assert self._goal is not None
        robot, near = self._problem.robot, control_points[-1] + step[-1]
        target = self._goal.nearest(robot.tool_position(near[None])[0], 1 - INNER_MARGIN)
        goal = solve_position(robot, target, near, self.lower[-1], self.upper[-1])
        if goal.error > _TOOL_TOLERANCE:
            return None
        q: FloatArray = np.clip(goal.q, self.lower[-1], self.upper[-1])
        return q

    def move(self, at: SampledSpline) -> BoolArray:
        """Return True for samples of a spline whose position a step can change, shape (N,)."""
        free = self.column[at.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        by_control: BoolArray = (free & (at.basis[0] != 0)).any(axis=1)
        return by_control | at.by_switching[:, 0].any(axis=(0, 2))

    def held(self, control_points: FloatArray) -> FloatArray:
        """Return the joint directions (r, n) that move the tool off a goal; r = 0 in a ball."""
        joints = control_points.shape[1]
        if not self.goal_moves or self._goal is None or self._goal.tolerance > 0:
            return np.zeros((0, joints))
        _, jacobian = self._problem.robot.tool_jacobian(control_points[-1:])
        _, gain, directions = np.linalg.svd(jacobian[0, :3], full_matrices=False)
        return directions[gain > _MIN_GAIN]


def _minimum_jerk(count: int) -> FloatArray:
    """Return the values of a minimum-jerk course from 0 to 1 at K control points, shape (K,).

    Their times are about those of the knots, clustered at both ends.
    """
    even = (np.arange(count) - (REST_POINTS - 1)) / (count - 2 * REST_POINTS + 1)
    x = (1 - np.cos(np.pi * np.clip(even, 0.0, 1.0))) / 2
    return x**3 * (10 - 15 * x + 6 * x**2)


def _is_redundant(problem: PlanningProblem) -> bool:
    """Return True if joints can move with the tool's position fixed, nearly everywhere."""
    joints = problem.robot.joint_count
    q = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_SAMPLES, joints))
    _, jacobian = problem.robot.tool_jacobian(q)
    return int(np.linalg.matrix_rank(jacobian[:, :3], tol=_MIN_GAIN).max()) < joints


# ---- The program's variables of each leg: tied ends have common variables.
#
# In the order of time, as the solver likes it: the configurations of all legs, and between them the
# switching times between short phases, which count only near there. Then, as they count everywhere,
# the configuration in which a cycle closes, the other switching times, every leg's eta and its
# elastic variable.

# A row of a cubic couples this number of configurations, without a switching time between them.
_CONFIGURATIONS = 4
# Else the configurations of its own phase and this number more; and the switching times nearer
# than this number of intervals on either side.
_BESIDE, _NEAR = 2, 3


class LegShape(NamedTuple):
    """Numbers of a leg's variables."""

    configurations: int  # number F of variable configurations
    joints: int  # number n of joints
    switches: int  # number S of switching times
    # of the phases beside each switching time, the number of knot intervals of the longer one,
    # shape (S,); None: every switching time counts everywhere
    intervals: IntArray | None = None
    # number of configurations before each switching time, shape (S,); None likewise
    behind: IntArray | None = None

    @property
    def is_among(self) -> BoolArray:
        """True for switching times that stand among the configurations, shape (S,)."""
        if self.intervals is None:
            return np.zeros(self.switches, dtype=bool)
        longest = min([0, *np.unique(self.intervals).tolist()], key=self._reach)
        return self.intervals <= longest

    def _reach(self, longest: int) -> int:
        """Return the number of variables that a variable is coupled with: time goes as its square.

        Switching times beside phases of at most `longest` intervals stand among the configurations.
        """
        assert self.intervals is not None
        others = int((self.intervals > longest).sum())
        if longest == 0:
            return _CONFIGURATIONS * self.joints + others
        return (max(longest, _NEAR) + _BESIDE) * self.joints + 2 * _NEAR + others


def shared_columns(legs: Sequence[LegShape], is_tied: Sequence[bool]) -> tuple[IntArray, ...]:
    """Return the program's variables of every leg, shape (V,) each.

    Each in the leg's own order: configurations, switching times, eta, elastic variable. The last
    configuration of a tied leg is the first of the next leg; the first leg is next to the last.
    """
    numbers, count = _numbers(legs, is_tied)
    joints = legs[0].joints
    positions = []  # the configuration after each switching time; `count`: behind all others
    for leg, own in zip(legs, numbers, strict=True):
        position = np.full(leg.switches, count)
        if leg.behind is not None and leg.configurations:
            following = np.append(own, own[-1] + 1)
            position[leg.is_among] = following[leg.behind[leg.is_among]]
        positions.append(position)
    before = np.concatenate(positions)
    sequence = np.argsort(before, kind="stable")
    switching = before * joints
    switching[sequence] += np.arange(len(sequence))
    by_leg = np.split(switching, np.cumsum([leg.switches for leg in legs])[:-1])
    others = count * joints + len(switching)
    columns = []
    for k, (own, switches) in enumerate(zip(numbers, by_leg, strict=True)):
        begin = own * joints + np.searchsorted(before[sequence], own, side="right")
        controls = np.add.outer(begin, np.arange(joints)).ravel()
        ends = [others + k, others + len(legs) + k]
        columns.append(np.concatenate([controls, switches, ends]))
    return tuple(columns)


def _numbers(legs: Sequence[LegShape], is_tied: Sequence[bool]) -> tuple[list[IntArray], int]:
    """Return the numbers of every leg's configurations among all, and their count."""
    count, numbers = 0, []
    for k, leg in enumerate(legs):
        is_behind = k > 0 and is_tied[k - 1]
        numbers.append(np.arange(leg.configurations) + count - is_behind)
        count = int(numbers[-1][-1]) + 1 if leg.configurations else count
    if not is_tied[-1]:
        return numbers, count
    # The configuration in which a cycle closes, the first and the last, is behind all others.
    numbers = [own - 1 for own in numbers]
    numbers[0][0] = numbers[-1][-1]
    return numbers, count - 1
