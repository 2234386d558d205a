"""A trajectory through knots at equal times, run as fast as the limits allow (Suh & Bishop 1988).

Knots are the paper's word for the waypoints that phase 2 moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor
from tubeplanner.constraints.tube_membership import worst_membership
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.bernstein import maxima
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.waypoint_search.link_clearance import LinkClearance

# The polynomials through knots (K, n), linear in them: sequential quartics or the quartic spline.
Construction: TypeAlias = Callable[[Sequence[str], FloatArray], JointTrajectory]

# Half of what the certificate allows: valleys between samples are estimated [m or rad].
_TOLERANCE = MARGIN_TOLERANCE / 2
_COLLISION_SAMPLES = 9  # per piece
_LIMIT_SAMPLES = 13  # per piece, before the search for peaks


@dataclass(frozen=True, eq=False)
class KnotTrajectory:
    """A trajectory through knots.

    Attributes:
        knots: Shape (K, n) [rad or m], the first is the start, the last the goal.
        construction: How the polynomials between them follow from the knots.
        trajectory: At the limits.
    """

    knots: FloatArray
    construction: Construction
    trajectory: JointTrajectory

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration

    def at_equal_times(self, count: int) -> FloatArray:
        """Return configurations at equal times, the first and the last knot among them: (K, n)."""
        return self.trajectory.position(np.linspace(0.0, self.duration, count))


def feasible_trajectory(
    problem: PlanningProblem,
    knots: FloatArray,
    construction: Construction,
    clearance: LinkClearance,
    upper_bound: float = np.inf,
) -> KnotTrajectory | None:
    """Return the trajectory through knots, unless a test refuses it.

    Position limits are judged for all t, the tube at 65 samples per piece with the valleys between
    them, collisions at 9. The certificate judges more strictly.

    Args:
        problem: The planning problem.
        knots: Shape (K, n).
        construction: How the polynomials follow from the knots.
        clearance: Around K configurations near the knots.
        upper_bound: Only a faster trajectory is of interest [s].
    """
    shape = construction(problem.robot.joint_names, knots)
    if _least_duration(problem, shape) >= upper_bound:
        return None
    try:
        trajectory = scaled_to_limits(problem, shape)
    except Infeasible:  # gravity is too strong somewhere
        return None
    if trajectory.duration >= upper_bound or not _within_position_limits(problem, shape):
        return None
    if worst_membership(problem, shape) < -_TOLERANCE or not _is_free(shape, clearance):
        return None
    return KnotTrajectory(knots, construction, trajectory)


def _least_duration(problem: PlanningProblem, shape: JointTrajectory) -> float:
    """Return how long the limits make a shape at its samples [s]; inf where it stands still."""
    samples = shape.per_piece(_LIMIT_SAMPLES)
    known = (samples.position, samples.velocity, samples.acceleration)
    factor = scaling_factor(problem, *known).min()
    return shape.duration / float(factor) if 0 < factor < np.inf else np.inf


def _within_position_limits(problem: PlanningProblem, shape: JointTrajectory) -> bool:
    limits = problem.robot.limits
    both = np.concatenate([shape.coefficients, -shape.coefficients], axis=2)
    highest = maxima(both, shape.widths).value
    limit = np.append(limits.upper_position, -limits.lower_position)
    return bool((highest <= limit + _TOLERANCE).all())


def _is_free(shape: JointTrajectory, clearance: LinkClearance) -> bool:
    """Return whether samples are clear of collisions, as seen from the knots next to them."""
    samples = shape.per_piece(_COLLISION_SAMPLES)
    nearest = np.rint(samples.time).astype(np.int64)  # a piece lasts one second
    return bool(clearance.is_free(samples.position, nearest).all())
