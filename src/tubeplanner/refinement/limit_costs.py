"""What each limit costs, by the multipliers of a leg's linear program.

They hold for the least change. Where the steps that a limit bars from all hardly use it, as next to
a start on a tolerance, others bar them at once: where multipliers say much, a rise is tried.
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.linearization import BROKEN, Linearization
from tubeplanner.refinement.shared_columns import shared_columns
from tubeplanner.refinement.step_block import Step
from tubeplanner.refinement.step_program import step_program
from tubeplanner.refinement.step_search import StepSearch

# Where elastic rows cost more than this share of their penalty, multipliers say little else: then
# so many times what they are violated by is allowed, or this much.
_SHARE_OF_PENALTY, _SPARE_SHARE, _LEAST_SPARE = 0.5, 2.0, 1e-5
# The rise that is tried. (Beside such a start, multipliers of a tolerance said 0.3 to 400 where
# rises of 0.1 % to 10 % gained nothing. Steps of the program have room for this one.)
_RISE = 0.03
_TOLERANCE = 1e-6  # of the solution, absolute and relative


def limit_costs(
    linear: Linearization, plausible: FloatArray, rise: FloatArray
) -> FloatArray | None:
    """Return what each limit costs, shape (L,): d ln T^2 by its relative rise.

    Args:
        linear: The constraints to first order.
        plausible: Up to which cost of each limit multipliers are believed, shape (L,).
        rise: What slack a relative rise of its limit adds to each row, by the rows' numbers; to
            planes it adds all.

    Returns:
        None where multipliers tell the penalty alone: something stays violated.
    """
    step = _exact_step(linear)
    if step is None or step.elastic > BROKEN:
        return None
    limit, index = linear.limits()
    gained = np.where(index >= 0, rise[index], 1.0)
    known = slice(len(step.multipliers))  # what was added since is no part of the program
    costs, named = np.zeros(len(plausible)), limit[known] >= 0
    np.add.at(costs, limit[known][named], np.maximum(step.multipliers * gained[known], 0.0)[named])
    for k in np.flatnonzero(costs > plausible):
        risen = _solved(linear, _TOLERANCE, _RISE * gained * (limit == k))
        if risen is not None:
            costs[k] = max(step.duration - risen.duration, 0.0) / _RISE
    return costs


def _exact_step(linear: Linearization) -> Step | None:
    """Return the step to the finer tolerance, once it is known what counts.

    Where the solver does not get there, as near as steps are elsewhere. If something stays
    violated, by next to nothing, that much is allowed: else multipliers tell the penalty.
    """
    search = StepSearch([linear], shared_columns([linear.shape], [False]))
    steps = search.solve()
    if steps is None:
        return None
    (exact,) = search.solve_closely(_TOLERANCE) or steps
    elastic = linear.elastic_rows
    cost = float(abs(exact.multipliers * elastic[: len(exact.multipliers)]).sum())
    if cost < _SHARE_OF_PENALTY * linear.penalty:
        return exact
    spare = max(_SPARE_SHARE * exact.elastic, _LEAST_SPARE)
    return _solved(linear, _TOLERANCE, spare * elastic) or exact


def _solved(
    linear: Linearization, tolerance: float, extra: FloatArray | float = 0.0
) -> Step | None:
    """Return the step of the program whose rows have some more slack."""
    columns = shared_columns([linear.shape], [False])
    steps = step_program([linear.block(linear.plain, extra)], columns).solve(tolerance)
    return None if steps is None else steps[0]
