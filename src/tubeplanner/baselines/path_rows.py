"""What limits ask of how an arm runs a given path q(s): linear in s'' and s'^2, but for one term.

Inertia asks for s'' and s'^2, gravity and Coulomb friction for nothing of both: its direction is
the path's. Viscous friction and torque-speed lines ask for s', the square root of s'^2: no limit of
the kind that TOPP-RA solves.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.coulomb_friction import CoulombFriction, directed_friction
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import SpeedLimit
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.directed_stretches import directed_stretches
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_LEAST_SQUARE = 1e-8  # share of the largest s'^2: the tangent of a root is upright at zero


@dataclass(frozen=True, eq=False)
class PathRows:
    """I limits at N places of a path: a s'' + b s'^2 + d s' <= g, coefficients of shape (N, I).

    Attributes:
        acceleration: a.
        square: b.
        speed: d.
        allowed: g.
    """

    acceleration: FloatArray
    square: FloatArray
    speed: FloatArray
    allowed: FloatArray

    def without_speed(self) -> "PathRows":
        """Return limits in which s' costs nothing and helps nothing."""
        return replace(self, speed=np.zeros_like(self.speed))

    def tangent(self, square: FloatArray) -> "PathRows":
        """Return limits without s' that are the same where s'^2 has given values (N,).

        Where s' costs, they are nowhere looser: a root lies below its tangents.
        """
        least = _LEAST_SQUARE * max(float(square.max(initial=0.0)), _LEAST_SQUARE)
        root = np.sqrt(np.maximum(square, least))[:, None]
        square_too, less = self.speed / (2 * root), self.speed * root / 2
        return replace(
            self.without_speed(), square=self.square + square_too, allowed=self.allowed - less
        )


def with_reversals(path: JointTrajectory, arc_length: FloatArray, apart: float) -> FloatArray:
    """Return arc lengths, and those where joints reverse that are some way from all of them."""
    stretches = directed_stretches(path)
    place = path.breakpoints[stretches.piece] + stretches.start * path.widths[stretches.piece]
    place = np.unique(place)
    away = abs(place[:, None] - arc_length).min(axis=1)
    return np.union1d(arc_length, place[away > apart])


def path_rows(
    problem: PlanningProblem,
    path: JointTrajectory,
    arc_length: FloatArray,
    limits: tuple[SpeedLimit, ...],
) -> tuple[PathRows, PathRows]:
    """Return what limits ask where steps along a path begin, and where they end.

    Each step has the Coulomb friction of its own directions at both ends.

    Args:
        problem: The planning problem.
        path: Over the arc length.
        arc_length: Where steps begin and end, shape (N+1,).
        limits: Of accelerations and efforts.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    inner, middle = path.breakpoints[1:-1], (arc_length[:-1] + arc_length[1:]) / 2
    piece = np.searchsorted(inner, middle)
    share = (middle - path.breakpoints[piece]) / path.widths[piece]
    direction = directed_stretches(path).at(piece, share)
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
    place: FloatArray,
    piece: IntArray,
    limits: tuple[SpeedLimit, ...],
    friction: Callable[[], CoulombFriction],
) -> PathRows:
    """Return what limits ask at places (N,) on pieces (N,) of a path, with a given friction."""
    local = place - path.breakpoints[piece]
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
    nothing = np.zeros((4, len(place), 0))
    return PathRows(*np.concatenate([nothing, *parts], axis=2))
