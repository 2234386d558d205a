"""Both that solve programs of steps, on programs of real trajectories."""

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.native.library import LIBRARY
from tubeplanner.refinement.banded_program import BandedProgram, _without
from tubeplanner.refinement.descent import FIRST_PENALTY, Remembered
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.shared_columns import shared_columns
from tubeplanner.refinement.sparse_program import SparseProgram
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.refinement.step_block import SparseRows, stacked_rows
from tubeplanner.refinement.step_search import StepSearch
from tubeplanner.refinement.trust_region import TrustRegion

FINE, AGREE = 1e-8, 1e-6
NOTHING = Remembered(np.zeros(0, dtype=np.int64), ())
pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the native library is left out")


def linearized(name, intervals, trust, **tube):
    """Return a trajectory to first order, with all rows that its step needs; other tube fields."""
    changes = {f"tube.{field}": value for field, value in tube.items()}
    problem = load_problem(f"example:{name}", changes=changes)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    spline = starting_spline(problem, branch, intervals)
    program = SequentialProgram(problem, spline.grid)
    begun, wide = program.iterate(spline), TrustRegion(0.2)
    near = program.improved(begun, wide, FIRST_PENALTY, min_gain=1e-3, max_steps=12).iterate
    linear = program.linearized(near, TrustRegion(trust), FIRST_PENALTY, NOTHING)
    assert StepSearch([linear], shared_columns([linear.shape], [False])).solve() is not None
    return linear


def cost(block, step):
    x = np.concatenate([step.control.ravel(), step.switching, [step.duration, step.elastic]])
    return block.linear @ x + x @ block.quadratic.hessian.product(x) / 2


def least_slack(block, step):
    """Return the least that the step leaves of any row's slack."""
    x = np.concatenate([step.control.ravel(), step.switching, [step.duration, step.elastic]])
    every = stacked_rows(block.rows)
    used = [row.data @ x[row.column] for row in every.rows()]
    return (block.slack - np.array(used)).min()


@pytest.mark.parametrize("trust", [0.1, 0.01])
@pytest.mark.parametrize(
    ("name", "intervals"),
    [
        ("two_link/paper_5_10mm", 24),
        ("two_link/around_a_post", 8),
        ("ur5/over_the_wall", 16),  # its goal is open: the tool is held there
        ("panda/between_shelves", 16),
        ("ur5/every_field", 8),
    ],
)
def test_both_find_the_same_least_cost(name, intervals, trust):
    linear = linearized(name, intervals, trust)
    columns = shared_columns([linear.shape], [False])
    block = linear.block(linear.plain)
    steps = [program([block], columns).solve(FINE)[0] for program in (BandedProgram, SparseProgram)]
    costs = [cost(block, step) for step in steps]
    assert costs[0] == pytest.approx(costs[1], abs=AGREE)
    assert min(least_slack(block, step) for step in steps) > -1e-5
    assert min(step.multipliers.sum() for step in steps) > 0.5, "nothing but bounds counts"


def test_both_do_where_switching_times_stand_among_the_configurations():
    """Forty segments, which ask in turns for other speeds of the tool: a phase each.

    The first and the last have many knots: what they share with others counts along all of them.
    """
    corners = np.array([[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0], [0.2, 0.45, 0]])
    along = np.linspace(0, 3, 41)
    points = np.column_stack([np.interp(along, range(4), column) for column in corners.T])
    tube = {"points": points.tolist(), "radius": 0.03, "tool_speed": [2.0, 2.1] * 20}
    linear = linearized("two_link/around_a_post", 40, 0.01, **tube)
    assert linear.shape.is_among[1:-1].all() and not linear.shape.is_among.all()
    block, (columns,) = linear.block(linear.plain), shared_columns([linear.shape], [False])
    programs = BandedProgram([block], [columns]), SparseProgram([block], [columns])
    (banded,), (sparse,) = (program.solve(FINE) for program in programs)
    assert cost(block, banded) == pytest.approx(cost(block, sparse), abs=AGREE)
    assert abs(banded.switching).max() > 1e-5


def test_rows_that_join_lead_to_the_same_step_as_rows_given_at_once():
    linear = linearized("ur5/over_the_wall", 16, 0.1)
    columns = shared_columns([linear.shape], [False])
    block = linear.block(linear.plain)
    (whole,) = BandedProgram([block], columns).solve(FINE)
    counts = np.array([len(rows.count) for rows in block.rows])
    some = len(counts) // 2
    begun = type(block)(
        block.rows[:some],
        block.slack[: counts[:some].sum()],
        block.bounds,
        block.quadratic,
        block.penalty,
    )
    program = BandedProgram([begun], columns)
    assert program.solve(1e-4) is not None
    program.join([block])
    (step,) = program.solve(FINE)
    assert cost(block, step) == pytest.approx(cost(block, whole), abs=AGREE)
    assert whole.multipliers.sum() > 0.5
    assert step.multipliers.sum() == pytest.approx(whole.multipliers.sum(), rel=1e-3)


def test_rows_lose_what_would_move_what_is_held_and_no_more():
    rows = SparseRows(np.array([3.0, 1.0, 2.0, 5.0]), np.array([0, 1, 2, 0]), np.array([3, 1]))
    held = SparseRows(np.array([0.6, 0.8]), np.array([1, 2]), np.array([2]))
    first, second = _without(rows, [held]).rows()
    whole = np.zeros(3)
    np.add.at(whole, first.column, first.data)
    assert whole == pytest.approx([3.0, 1 - 0.6 * 2.2, 2 - 0.8 * 2.2])
    assert second.data.tolist() == [5.0]
