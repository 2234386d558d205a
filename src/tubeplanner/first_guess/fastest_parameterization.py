"""Time-optimal parameterization of a path: rows in s'' and s'^2, controllable sets.

Inertial efforts are linear in s'' and s'^2; gravity and Coulomb friction depend on neither, as the
direction of friction is the path's. Viscous friction and torque-speed lines depend on s', the
square root of s'^2, and what a contact or the tool's acceleration leaves is a cone: tangents
replace both.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import (
    CoulombFriction,
    PathSamples,
    SpeedLimit,
    directed_friction,
)
from tubeplanner.limits.rates import ToolAcceleration, ToolSpeed
from tubeplanner.limits.speed_limits import largest_speeds, speed_limits
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import monotone_intervals

# ---- Limits on the speed along a given path q(s): linear in s'' and s'^2, but for one term.

_MIN_SQUARE = 1e-8  # fraction of the largest s'^2: the tangent of a root is upright at zero
# Share of a cone's nominal by which half spaces are inside of it, and a run may be outside of them.
_OUTSIDE = 1e-4
# Directions of half spaces around a cone, the corners and middles of a cube's sides and edges.
_AROUND = np.array([each for each in np.ndindex(3, 3, 3) if each != (1, 1, 1)]) - 1.0
_AROUND = (_AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True))[None, None]


@dataclass(frozen=True, eq=False)
class PathRows:
    """I limits at N points of a path: a s'' + b s'^2 + d s' <= g, coefficients of shape (N, I)."""

    acceleration: FloatArray  # a
    square: FloatArray  # b
    speed: FloatArray  # d
    allowed: FloatArray  # g
    # J cones |x| <= t beside them: (x, t) by s'', by s'^2 and at rest, shape (3, N, J, 4)
    cones: FloatArray

    def inside_cones(self) -> "PathRows":
        """Return the limits and half spaces all around the cones, a single one of a flat cone."""
        is_round = np.asarray(self.cones[..., :3].any(axis=(0, 1, 3)))
        flat = self.with_planes(np.zeros((1, 1, 1, 3)), ~is_round)
        return flat.with_planes(_AROUND, is_round)

    def with_planes(self, direction: FloatArray, chosen: BoolArray) -> "PathRows":
        """Return the limits and half spaces d . x <= t of chosen cones (J,), a little inside.

        They have P directions d for each cone, shape (N or 1, J or 1, P, 3).
        """
        normal = np.concatenate([direction, -np.ones_like(direction[..., :1])], axis=-1)
        cones = self.cones[:, :, chosen]
        planes = (cones[:, :, :, None] * normal).sum(axis=-1)
        acceleration, square, still = planes.reshape(3, len(self.square), -1)
        allowed = np.maximum(-still - _OUTSIDE, np.minimum(-still, 0.0))
        return replace(
            self,
            acceleration=np.hstack([self.acceleration, acceleration]),
            square=np.hstack([self.square, square]),
            speed=np.hstack([self.speed, np.zeros_like(square)]),
            allowed=np.hstack([self.allowed, allowed]),
        )

    def at_cones(self, acceleration: FloatArray, square: FloatArray) -> tuple["PathRows", float]:
        """Return the limits and tangents of the cones that points (N,), (N,) of s'' and s'^2 leave.

        And how far they leave them, at most.
        """
        run = np.stack([acceleration, square, np.ones_like(square)])
        vectors = np.einsum("kn,knjl->njl", run, self.cones)
        size = np.linalg.norm(vectors[..., :3], axis=2, keepdims=True)
        outside = size[..., 0] - vectors[..., 3]
        chosen = (outside > _OUTSIDE).any(axis=0)
        direction = vectors[..., :3] / np.maximum(size, np.finfo(float).tiny)
        rows = self.with_planes(direction[:, chosen, None], chosen)
        return rows, float(outside.max(initial=0.0))

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
    parts, round_or_flat = [], []
    for limit in limits:
        if isinstance(limit, ToolAcceleration):
            allowed = limit.limit[_loosest(steady, limit.limit)][:, None]
            ball = [limit.vectors(at)[0] / allowed for at in (steady, speeding_up)]
            ball = [ball[1] - ball[0], ball[0], np.zeros_like(ball[0])]
            round_or_flat.append(np.stack([np.pad(x, ((0, 0), (0, 1))) for x in ball])[:, :, None])
            round_or_flat[-1][2, :, :, 3] = 1.0
            continue
        used = limit.used(steady)
        if (used.largest_speed(limit.signs) == 0).any():
            raise limit.refusal(steady)
        if isinstance(limit, HoldingLimit):
            still, square = limit.parts(steady).vectors
            round_or_flat.append(
                np.stack([limit.parts(speeding_up).vectors[1] - square, square, still])
            )
            continue
        none = np.zeros(used.shape)
        still, speed, square = (used.terms.get(power, none) for power in range(3))
        acceleration = limit.used(speeding_up).terms[2] - square
        for sign in limit.signs:
            terms = (sign * acceleration, sign * square, sign * speed, 1 - sign * still)
            parts.append(np.stack(terms))
    no_row, no_cone = np.zeros((4, len(arc_length), 0)), np.zeros((3, len(arc_length), 0, 4))
    acceleration, square, speed, allowed = np.concatenate([no_row, *parts], axis=2)
    cones = np.concatenate([no_cone, *round_or_flat], axis=2)
    return PathRows(acceleration, square, speed, allowed, cones)


# ---- The fastest run of a path by motors that switch instantly: bang-bang control.
#
# By reachability, as in TOPP-RA (Pham & Pham, "A new approach to time-optimal path parameterization
# based on reachability analysis", IEEE T-RO 34(3), 2018); first by Bobrow et al. and Shin & McKay
# (1985).
#
# A path is stored as the trajectory that runs it at unit speed: its times are the arc length in
# joint space.

# The note on answers under limits that depend on s'.
NOT_PROVED = (
    "the fastest that was found: with viscous friction or torque-speed lines nothing proves it the "
    "least"
)
_INSIDE = 1e-4  # [m]: how far outside a capsule a point of the path still counts as in it
# Tolerances are absolute: for squared rates of about 100, these are small, and digits are not lost
# yet. In place of a missing limit on the rate, _AMPLE units.
_UNIT_FRACTION, _AMPLE = 0.1, 1e3
_ROUNDING, _NO_TERM = 1e-12, 1e-14  # of squared rates; of the limit: terms that are none
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
    by_toppra: bool = False,
) -> JointTrajectory | None:
    """Return a path's fastest time parameterization: arc length over time, from rest to rest.

    It keeps the limits of velocities, acceleration, effort, motors and the tool at points of the
    path and may exceed them in between; jerk is unlimited, so it is not smooth. Where the tool is
    in several segments, the loosest of their limits on its speed and acceleration counts.

    Limits with viscous friction and torque-speed lines depend on the root of the squared rate that
    is solved for. Tangents of that root replace it, each at the last solution, until the time
    settles. The result is faster than its neighbours; nothing proves that it is the fastest.
    Tangents of cones join wherever a solution leaves them.

    Args:
        problem: The planning problem.
        path: Over the arc length, in the robot's group order.
        arc_length: Points at which the limits hold, increasing from the path's start to its end,
            shape (N,); reversals of joints are added if any has Coulomb friction.
        at_both_ends: Whether every step keeps the limits at its end too, not only at its begin. The
            time parameterization is up to 1 % slower then, but exceeds limits in between by less
            than 0.1 % of the time, rather than by up to 19 % (two links round an arc).
        by_toppra: Whether the library toppra solves, of the extra `compare`; cones it cannot take.

    Returns:
        The arc length over time, one parabola per step; None if the solver finds none.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    if problem.robot.motors.has_coulomb_friction:
        arc_length = with_reversals(path, arc_length, _APART * float(np.diff(arc_length).mean()))
    limits = tuple(each for each in speed_limits(problem) if each.order == _ACCELERATIONS)
    rows = list(path_rows(problem, path, arc_length, limits)[: 1 + at_both_ends])
    most = _largest_rates(problem, path, arc_length)
    has_speed, has_cones = rows[0].speed.any(), rows[0].cones.size > 0
    solve = _by_toppra if by_toppra else _fastest_rates
    if by_toppra and has_cones:
        return None
    rows = [each.inside_cones() for each in rows]

    def solved(rate: FloatArray | None) -> FloatArray | None:
        if rate is None:
            return None
        squares = (rate[:-1] ** 2, rate[1:] ** 2)
        tangents = [each.tangent(x) for each, x in zip(rows, squares, strict=False)]
        return solve(arc_length, tangents, most)

    rate = solve(arc_length, [each.without_speed() for each in rows], most)
    if rate is not None and has_speed:
        # Tangents at high rates cost effort at low rates too, perhaps more than there is.
        loose = rate
        starts = (solved(fraction * loose) for fraction in _STARTS)
        rate = next((start for start in starts if start is not None), None)
    has_settled = not has_speed
    for _ in range(_ROUNDS):
        if rate is None:
            return None
        square = rate**2
        acceleration = np.diff(square) / (2 * np.diff(arc_length))
        ends = zip(rows, (square[:-1], square[1:]), strict=False)
        cut = [each.at_cones(acceleration, x) for each, x in ends]
        rows = [each for each, _ in cut]
        if has_settled and max(outside for _, outside in cut) <= _OUTSIDE:
            break
        following = solved(rate)
        if following is None:
            break
        before, after = (_step_times(arc_length, run).sum() for run in (rate, following))
        rate, has_settled = following, bool(abs(after - before) < _SETTLED * after)
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
    q, slope = path.position(arc_length), path.velocity(arc_length)
    state = np.stack([q, slope, np.zeros_like(q)])
    at = PathSamples(problem, state, lambda: _loosest(at, in_segment))
    return largest_speeds(at, limits)


def _loosest(at: PathSamples, in_segment: FloatArray) -> IntArray:
    """Return the segment with the largest of limits (m,) of those that a sample is in, (N,)."""
    inside = at.problem.tube.margin(at.tool_pose[1])
    counts = inside >= np.minimum(-_INSIDE, inside.max(axis=1, keepdims=True))
    return np.where(counts, in_segment, -np.inf).argmax(axis=1)


def _unit(arc_length: FloatArray, limits: Sequence[PathRows]) -> float:
    """Return the unit of rates, a fraction of the rate after speeding up over the path [1/s]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        strongest = (limits[0].allowed / abs(limits[0].acceleration)).min(axis=1)
    usual = float(np.median(strongest))
    unit = 1.0
    if 0 < usual < np.inf:
        unit = _UNIT_FRACTION * float(np.sqrt(usual * np.ptp(arc_length)))
    return unit


def _step_rows(
    arc_length: FloatArray, limits: Sequence[PathRows], unit: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the limits of steps as a u + b x <= g, (N-1, I) each, rates in a unit.

    u is s'' and x is s'^2 at a step's begin; at its end, a step h later, s'^2 is x + 2 h u.
    """
    twice = 2 * np.diff(arc_length)[:, None]
    rows = [
        (each.acceleration + ahead * each.square, each.square, each.allowed)
        for each, ahead in zip(limits, (np.zeros_like(twice), twice), strict=False)
    ]
    acceleration, square, allowed = (np.hstack(part) for part in zip(*rows, strict=True))
    return unit**2 * acceleration, unit**2 * square, allowed


def _fastest_rates(
    arc_length: FloatArray, limits: Sequence[PathRows], most: FloatArray
) -> FloatArray | None:
    """Return the largest rates (N,) [1/s] under limits at steps' begins, and perhaps ends.

    The squared rates x at the begin and y at the end of a step are in a polygon. Those from which
    the goal can be reached are an interval at every point: backwards from the goal, the x of all
    (x, y) in the polygon with y in the interval of the step's end. Forwards from the start, every
    step then takes the largest y.

    Returns:
        None where no run keeps the limits.
    """
    unit = _unit(arc_length, limits)
    acceleration, square, allowed = _step_rows(arc_length, limits, unit)
    y_by = acceleration / (2 * np.diff(arc_length)[:, None])
    x_by = square - y_by
    largest = np.minimum(most / unit, _AMPLE) ** 2
    of_x, of_y = largest[:-1], largest[1:]
    x_by[abs(x_by) * of_x[:, None] < _NO_TERM] = 0.0
    y_by[abs(y_by) * of_y[:, None] < _NO_TERM] = 0.0
    none = np.zeros_like(of_x)
    right, left = _bounds(x_by, y_by, allowed, of_x), _bounds(-x_by, y_by, allowed, none)
    up, down = _bounds(y_by, x_by, allowed, of_y), _bounds(-y_by, x_by, allowed, none)
    flat = np.hstack([y_by == 0, np.ones((len(y_by), 1), dtype=bool)])
    corners: list[list[list[float]]] = []
    for side, bounds in ((1.0, right), (-1.0, left)):
        alone = np.where(flat, bounds[0], np.inf).min(axis=1)
        corner = _corners(side * alone, side, up, down)
        if corner is None:
            return None
        corners.append(corner.tolist())
    low, high = [0.0], [0.0]  # from the goal backwards
    for k in range(len(of_x) - 1, -1, -1):
        ends = []
        for (x, y), bounds, side in ((corners[0][k], right, 1.0), (corners[1][k], left, -1.0)):
            within = min(max(y, low[-1]), high[-1])
            if within != y:
                x = side * float((bounds[0, k] - bounds[1, k] * within).min())
            ends.append(x)
        high.append(ends[0])
        low.append(max(ends[1], 0.0))
        if low[-1] > high[-1] + _ROUNDING:
            return None
    if low[-1] > 0:
        return None
    squares = [0.0]
    for k, (least, most_there) in enumerate(zip(low[-2::-1], high[-2::-1], strict=True)):
        y = float((up[0, k] - up[1, k] * squares[-1]).min())
        squares.append(max(min(y, most_there), least))
    rate = unit * np.sqrt(squares)
    return None if (rate[1:] + rate[:-1] == 0).any() else rate


def _bounds(by: FloatArray, other: FloatArray, allowed: FloatArray, box: FloatArray) -> FloatArray:
    """Return bounds on z, rows by z + other w <= allowed (M, I) and z <= box (M,).

    Returns:
        z <= c - d w: c and d, shape (2, M, I+1); c is infinite for rows that bound z from below.
    """
    result = np.zeros((2, len(by), by.shape[1] + 1))
    result[0] = np.inf
    result[0, :, -1] = box
    for part, values in zip(result, (allowed, other), strict=True):
        np.divide(values, by, out=part[:, :-1], where=by > 0)
    return result


def _corners(x: FloatArray, side: float, up: FloatArray, down: FloatArray) -> FloatArray | None:
    """Return the points (x, y) of polygons farthest to a side of x, from outside of them, (M, 2).

    The width in y is concave over x: Newton's method comes to its root from outside, in as many
    steps as the polygon has edges at most. None: a polygon is empty.
    """
    x, y, rows = x.copy(), np.zeros_like(x), np.arange(len(x))
    while len(rows):
        bounds = [c[rows] - d[rows] * x[rows, None] for c, d in (up, down)]
        each = np.arange(len(rows))
        edges = [bound.argmin(axis=1) for bound in bounds]
        most, least = (bound[each, edge] for bound, edge in zip(bounds, edges, strict=True))
        y[rows] = -least
        slope = -(up[1, rows, edges[0]] + down[1, rows, edges[1]])
        width = most + least
        outside = width < -_ROUNDING * (1 + abs(most))
        if (slope[outside] * side >= 0).any():
            return None
        step = width[outside] / slope[outside]
        rows = rows[outside]
        # Where large terms cancel, the width never comes to zero: then x stands still.
        moves = abs(step) > _ROUNDING * abs(x[rows])
        x[rows] -= step
        rows = rows[moves]
    return np.column_stack([x, y])


def _by_toppra(
    arc_length: FloatArray, limits: Sequence[PathRows], most: FloatArray
) -> FloatArray | None:
    """Return the rates of `_fastest_rates` by the library toppra."""
    from toppra import algorithm  # takes a second

    unit = _unit(arc_length, limits)
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
        self, arc_length: FloatArray, limits: Sequence[PathRows], most: FloatArray, unit: float
    ) -> None:
        """Take limits at the begins of steps, and perhaps at their ends; rates in a unit."""
        self.path_interval = arc_length[[0, -1]]
        # No step begins at the last point; it has the limits of the last step.
        a, b, g = (np.vstack([part, part[-1:]]) for part in _step_rows(arc_length, limits, unit))
        count = a.shape[1]
        each_alone = np.broadcast_to(np.eye(count), (len(a), count, count))
        squares = np.column_stack([np.zeros_like(most), (most / unit) ** 2])
        self._parameters = (a, b, np.zeros_like(a), each_alone, g, None, squares)

    def get_constraint_type(self) -> Any:
        from toppra.constraint import ConstraintType

        return ConstraintType.CanonicalLinear

    def get_no_extra_vars(self) -> int:
        return 0

    def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
        return self._parameters
