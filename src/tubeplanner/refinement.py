"""Phase 2: path and speed optimised together, from coarse to fine knots.

The paper's phase 2 moves its knots along discretised gradients and doubles them (Suh & Bishop
1988). Here, a spline over phases, one per tube segment, is shortened by sequential linear programs:
first on few knots, then on three times as many, and so on. On the finest, samples are added where
limits or tube are broken between them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem
from tubeplanner.reference_branch import ReferenceBranch
from tubeplanner.sequential_program import INNER_MARGIN, Iterate, SequentialProgram
from tubeplanner.spline_start import refitted, starting_spline
from tubeplanner.trajectory import JointTrajectory, from_spline

_FIRST_TRUST, _LATER_TRUST, _LAST_TRUST = 0.2, 0.1, 0.02  # [rad or m]
_COARSE_GAIN, _FINE_GAIN, _LAST_GAIN = 1e-2, 5e-4, 1e-4
_POLISH_TRUST, _POLISH_GAIN, _POLISH_STEPS = 0.01, 1e-7, 20
_MOST_STEPS, _STEPS_PER_ROUND, _MOST_ROUNDS = 60, 3, 8
# The exchange of samples ends when this is all that lies between them, a share of T^2.
_BETWEEN_SAMPLES = 0.003
_USABLE_MARGIN = 0.8 * INNER_MARGIN


@dataclass(frozen=True, eq=False)
class RefinedMotion:
    """What refinement found.

    Attributes:
        trajectory: The motion; its duration is one second, scaling it to the limits is left.
    """

    trajectory: JointTrajectory
    _program: SequentialProgram
    _found: Iterate

    def elasticities(self) -> dict[tuple[str, int], float]:
        """Return d ln T / d ln p for every limit p, as `SequentialProgram.elasticities`."""
        polished = self._program.improved(
            self._program.iterate(self._found.motion), _POLISH_TRUST, _POLISH_GAIN, _POLISH_STEPS
        )
        return self._program.elasticities(polished)


def refine(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    intervals: tuple[int, ...],
    *,
    tube_share: float = 1.0,
    checkpoint: Callable[[float], None] = lambda duration: None,
) -> RefinedMotion:
    """Return the shortest motion that is found near a branch.

    Args:
        problem: What is asked; segments are visited in order.
        branch: The arm along the reference path.
        intervals: Numbers of knot intervals, from coarse to fine.
        tube_share: Which share of the radii may be used.
        checkpoint: Called with the duration [s] after every step; it may raise to end the work.

    Raises:
        Infeasible: Status no_trajectory: no motion inside the tube was found.
    """
    motion = starting_spline(problem, branch, intervals[0])
    trust = _FIRST_TRUST
    for finer in intervals[1:]:
        program = SequentialProgram(problem, motion, tube_share, checkpoint)
        found = program.improved(_finite(program.iterate(motion)), trust, _COARSE_GAIN, _MOST_STEPS)
        motion, trust = refitted(found.motion, finer), _LATER_TRUST
    program = SequentialProgram(problem, motion, tube_share, checkpoint)
    found = program.improved(_finite(program.iterate(motion)), trust, _FINE_GAIN, _MOST_STEPS)
    best = _with_exchange(program, found)
    trajectory = from_spline(problem.robot.joint_names, best.motion.spline())
    return RefinedMotion(trajectory, program.without_checkpoint(), best)


def _with_exchange(program: SequentialProgram, found: Iterate) -> Iterate:
    """Return the best motion between samples too, adding samples where they are missing."""
    best = None
    for _ in range(_MOST_ROUNDS):
        dense, has_more = program.densely(found)
        inside = dense.excess <= _USABLE_MARGIN
        if inside and (best is None or dense.squared_duration < best.squared_duration):
            best = dense
        near = dense.squared_duration < (1 + _BETWEEN_SAMPLES) * found.squared_duration
        if not has_more or (inside and near):
            break
        again = program.iterate(found.motion)
        found = program.improved(again, _LAST_TRUST, _LAST_GAIN, _STEPS_PER_ROUND)
    if best is None:
        raise Infeasible(
            PlanStatus.NO_TRAJECTORY, "refinement found no motion inside the tube", Place()
        )
    return best


def _finite(iterate: Iterate) -> Iterate:
    """Return an iterate that the motors can hold; else there is nothing to start from."""
    if not np.isfinite(iterate.squared_duration):
        raise Infeasible(
            PlanStatus.NO_TRAJECTORY, "refinement has no motion to start from", Place()
        )
    return iterate
