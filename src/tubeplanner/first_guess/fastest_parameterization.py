"""Time-optimal parameterization of a path: rows in s'' and s'^2, TOPP-RA.

Inertial efforts are linear in s'' and s'^2; gravity and Coulomb friction depend on neither, as the
direction of friction is the path's. Viscous friction and torque-speed lines depend on s', the
square root of s'^2, for which TOPP-RA does not solve.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.path_samples import (
    CoulombFriction,
    PathSamples,
    SpeedLimit,
    directed_friction,
)
from tubeplanner.limits.rates import ToolSpeed
from tubeplanner.limits.speed_limits import largest_speeds, speed_limits
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import monotone_intervals

# ---- Limits on the speed along a given path q(s): linear in s'' and s'^2, but for one term.

_MIN_SQUARE = 1e-8  # fraction of the largest s'^2: the tangent of a root is upright at zero


@dataclass(frozen=True, eq=False)
class PathRows:
    """I limits at N points of a path: a s'' + b s'^2 + d s' <= g, coefficients of shape (N, I)."""

    acceleration: FloatArray  # a
    square: FloatArray  # b
    speed: FloatArray  # d
    allowed: FloatArray  # g

    def without_speed(self) -> "PathRows":
        """Return the limits without their terms in s'."""
        return replace(self, speed=np.zeros_like(self.speed))

    def tangent(self, square: FloatArray) -> "PathRows":
        """Return limits without s', tangent to these where s'^2 has the values (N,).

        Where d > 0, they are nowhere looser: a root lies below its tangents.
        """
        least = _MIN_SQUARE * max(float(square.max(initial=0.0)), _MIN_SQUARE)
        root = np.sqrt(np.maximum(square, least))[:, None]
        square_too, less = self.speed / (2 * root), self.speed * root / 2
        return replace(
            self.without_speed(), square=self.square + square_too, allowed=self.allowed - less
        )


def with_reversals(path: JointTrajectory, arc_length: FloatArray, apart: float) -> FloatArray:
    """Return arc lengths, and reversals of joints that are more than `apart` away from all."""
    intervals = monotone_intervals(path)
    reversals = path.breakpoints[intervals.piece] + intervals.start * path.widths[intervals.piece]
    reversals = np.unique(reversals)
    away = abs(reversals[:, None] - arc_length).min(axis=1)
    return np.union1d(arc_length, reversals[away > apart])


def path_rows(
    problem: PlanningProblem,
    path: JointTrajectory,
    arc_length: FloatArray,
    limits: tuple[SpeedLimit, ...],
) -> tuple[PathRows, PathRows]:
    """Return the rows of limits at the begins and at the ends of N steps along a path.

    Each step has the Coulomb friction of its own directions at both ends. The begins and ends have
    arc lengths (N+1,).

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    inner, middle = path.breakpoints[1:-1], (arc_length[:-1] + arc_length[1:]) / 2
    piece = np.searchsorted(inner, middle)
    fraction = (middle - path.breakpoints[piece]) / path.widths[piece]
    direction = monotone_intervals(path).at(piece, fraction)
    friction = partial(directed_friction, problem.robot.motors, direction)
    begins, ends = arc_length[:-1], arc_length[1:]
    after, before = np.searchsorted(inner, begins, "right"), np.searchsorted(inner, ends)
    return (
        _rows(problem, path, begins, after, limits, friction),
        _rows(problem, path, ends, before, limits, friction),
    )


def _rows(
    problem: PlanningProblem,
    path: JointTrajectory,
    arc_length: FloatArray,
    piece: IntArray,
    limits: tuple[SpeedLimit, ...],
    friction: Callable[[], CoulombFriction],
) -> PathRows:
    """Return the rows of limits at arc lengths (N,) on pieces (N,) of a path, with a friction."""
    local = arc_length - path.breakpoints[piece]
    q, slope, bend = (path.within(piece, local, order) for order in range(3))
    steady = PathSamples(problem, np.stack([q, slope, bend]), friction=friction)
    speeding_up = PathSamples(problem, np.stack([q, slope, bend + slope]), friction=friction)
    parts = []
    for limit in limits:
        used = limit.used(steady)
        if (used.largest_speed(limit.signs) == 0).any():
            raise limit.refusal(steady)
        none = np.zeros(used.shape)
        still, speed, square = (used.terms.get(power, none) for power in range(3))
        acceleration = limit.used(speeding_up).terms[2] - square
        for sign in limit.signs:
            terms = (sign * acceleration, sign * square, sign * speed, 1 - sign * still)
            parts.append(np.stack(terms))
    empty = np.zeros((4, len(arc_length), 0))
    return PathRows(*np.concatenate([empty, *parts], axis=2))


# ---- The fastest run of a path by motors that switch instantly: bang-bang control.
#
# Solved by TOPP-RA (Pham & Pham, "A new approach to time-optimal path parameterization based on
# reachability analysis", IEEE T-RO 34(3), 2018); first by Bobrow et al. and Shin & McKay (1985).
#
# A path is stored as the trajectory that runs it at unit speed: its times are the arc length in
# joint space.

# The note on answers under limits that depend on s'.
NOT_PROVED = (
    "the fastest that was found: with viscous friction or torque-speed lines nothing proves it the "
    "least"
)
_INSIDE = 1e-4  # [m]: how far outside a capsule a point of the path still counts as in it
# TOPP-RA's tolerances are absolute: for squared rates of about 100, these are small, and digits are
# not lost yet. In place of a missing limit on the rate, _AMPLE units.
_UNIT_FRACTION, _AMPLE = 0.1, 1e3
_SPEEDS, _ACCELERATIONS = 1, 2  # the highest derivative that limits depend on; jerk is unlimited
_APART = 1e-3  # of a mean step: nearer to points of the path, reversals are no points of their own
_ROUNDS, _SETTLED = 20, 1e-6  # of tangents; relative change of the time at which they end
_STARTS = (0.5, 0.1, 0.02, 0.004)  # of tangents, as fractions of the rates of ideal motors


def fastest_parameterization(
    problem: PlanningProblem,
    path: JointTrajectory,
    arc_length: FloatArray,
    *,
    at_both_ends: bool = True,
) -> JointTrajectory | None:
    """Return a path's fastest time parameterization: arc length over time, from rest to rest.

    It keeps the limits of velocities, acceleration, effort, motors and tool speed at points of the
    path and may exceed them in between; jerk is unlimited, so it is not smooth. Where the tool is
    in several segments, the loosest of their limits on its speed counts.

    Limits with viscous friction and torque-speed lines depend on the root of TOPP-RA's variable.
    Tangents of that root replace it, each at the last solution, until the time settles. The result
    is faster than its neighbours; nothing proves that it is the fastest.

    Args:
        problem: The planning problem.
        path: Over the arc length, in the robot's group order.
        arc_length: Points at which the limits hold, increasing from the path's start to its end,
            shape (N,); reversals of joints are added if any has Coulomb friction.
        at_both_ends: Whether every step keeps the limits at its end too, not only at its begin. The
            time parameterization is up to 1 % slower then, but exceeds limits in between by less
            than 0.1 % of the time, rather than by up to 19 % (two links round an arc).

    Returns:
        The arc length over time, one parabola per step; None if the solver finds none.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    if problem.robot.motors.has_coulomb_friction:
        arc_length = with_reversals(path, arc_length, _APART * float(np.diff(arc_length).mean()))
    limits = tuple(each for each in speed_limits(problem) if each.order == _ACCELERATIONS)
    rows = path_rows(problem, path, arc_length, limits)
    most = _largest_rates(problem, path, arc_length)

    def solved(rate: FloatArray) -> FloatArray | None:
        squares = (rate[:-1] ** 2, rate[1:] ** 2)
        tangents = [each.tangent(x) for each, x in zip(rows, squares, strict=True)]
        return _solved(arc_length, tangents[: 1 + at_both_ends], most)

    free = [each.without_speed() for each in rows]
    rate = _solved(arc_length, free[: 1 + at_both_ends], most)
    if rate is not None and rows[0].speed.any():
        # Tangents at high rates cost effort at low rates too, perhaps more than there is.
        loose = rate
        starts = (solved(fraction * loose) for fraction in _STARTS)
        rate = next((start for start in starts if start is not None), None)
        for _ in range(_ROUNDS):
            following = None if rate is None else solved(rate)
            if rate is None or following is None:
                break
            before, after = (_step_times(arc_length, run).sum() for run in (rate, following))
            rate = following
            if abs(after - before) < _SETTLED * after:
                break
    if rate is None:
        return None
    durations = _step_times(arc_length, rate)
    parabolas = np.array([np.diff(rate) / (2 * durations), rate[:-1], arc_length[:-1]])
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return JointTrajectory(("arc_length",), times, parabolas[:, :, None])


def _largest_rates(
    problem: PlanningProblem, path: JointTrajectory, arc_length: FloatArray
) -> FloatArray:
    """Return the largest rates of the arc length under limits of velocities, (N,) [1/s]."""
    limits = tuple(limit for limit in speed_limits(problem) if limit.order == _SPEEDS)
    in_segment = ToolSpeed(problem).limit

    def loosest() -> IntArray:
        inside = problem.tube.margin(at.tool_pose[1])
        counts = inside >= np.minimum(-_INSIDE, inside.max(axis=1, keepdims=True))
        return np.where(counts, in_segment, -np.inf).argmax(axis=1)

    q, slope = path.position(arc_length), path.velocity(arc_length)
    at = PathSamples(problem, np.stack([q, slope, np.zeros_like(q)]), loosest)
    return largest_speeds(at, limits)


def _solved(arc_length: FloatArray, limits: list[PathRows], most: FloatArray) -> FloatArray | None:
    """Return the largest rates (N,) [1/s] under limits at steps' begins, and perhaps ends."""
    from toppra import algorithm  # takes a second

    # The unit of rates is a fraction of the rate after speeding up over the path.
    with np.errstate(divide="ignore", invalid="ignore"):
        strongest = (limits[0].allowed / abs(limits[0].acceleration)).min(axis=1)
    usual, unit = float(np.median(strongest)), 1.0
    if 0 < usual < np.inf:
        unit = _UNIT_FRACTION * float(np.sqrt(usual * np.ptp(arc_length)))
    rows = _Limits(arc_length, limits, np.minimum(most, _AMPLE * unit), unit)
    solver = algorithm.TOPPRA([rows], rows, gridpoints=arc_length, solver_wrapper="seidel")
    _, rate, _ = solver.compute_parameterization(0.0, 0.0)
    if rate is None or not np.isfinite(rate).all() or (rate[1:] + rate[:-1] == 0).any():
        return None
    return unit * np.asarray(rate)


def _step_times(arc_length: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the durations of steps [s]: at constant acceleration, length over mean rate."""
    return 2 * np.diff(arc_length) / (rate[1:] + rate[:-1])


class _Limits:
    """Limits of steps, with the interfaces of a path and of its constraint that TOPP-RA requires.

    The variables of a step of length h are u = s'' and x = s'^2 at its begin; at its end, s'^2 is
    x + 2 h u.
    """

    waypoints, dof, identical = None, 1, False

    def __init__(
        self, arc_length: FloatArray, limits: list[PathRows], most: FloatArray, unit: float
    ) -> None:
        """Take limits at the begins of steps, and perhaps at their ends; rates in a unit."""
        self.path_interval = arc_length[[0, -1]]
        twice = 2 * np.diff(arc_length)[:, None]
        ends = [np.zeros_like(twice), twice][: len(limits)]
        a, b, g = (
            np.concatenate(parts, axis=1)
            for parts in zip(
                *(
                    (each.acceleration + ahead * each.square, each.square, each.allowed)
                    for each, ahead in zip(limits, ends, strict=True)
                ),
                strict=True,
            )
        )
        # No step begins at the last point; it has the limits of the last step.
        a, b, g = (np.vstack([part, part[-1:]]) for part in (a, b, g))
        count = a.shape[1]
        each_alone = np.broadcast_to(np.eye(count), (len(a), count, count))
        squares = np.column_stack([np.zeros_like(most), (most / unit) ** 2])
        scaled = (unit**2 * a, unit**2 * b, np.zeros_like(a))
        self._parameters = (*scaled, each_alone, g, None, squares)

    def get_constraint_type(self) -> Any:
        from toppra.constraint import ConstraintType

        return ConstraintType.CanonicalLinear

    def get_no_extra_vars(self) -> int:
        return 0

    def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
        return self._parameters
