"""The program of one step over all legs: native banded solver, PIQP."""

from dataclasses import replace

import numpy as np
import pytest
from cases import begun
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from tubeplanner import load_problem
from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer.control_variables import LegShape, shared_columns
from tubeplanner.optimizer.descent import (
    FIRST_PENALTY,
    Descent,
    DescentState,
    Remembered,
    SequentialProgram,
)
from tubeplanner.optimizer.step_program import (
    BandedProgram,
    Block,
    Bounds,
    Quadratic,
    SparseProgram,
    SparseRows,
    SymmetricEntries,
    _projected,
    stacked_rows,
)
from tubeplanner.optimizer.step_search import StepSearch, TrustRegion

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")

FINE, AGREE = 1e-8, 1e-6


def linearized(name, intervals, trust, **tube):
    """Return a block with all rows that a step needs, its columns, where switching times stand."""
    changes = {f"tube.{field}": value for field, value in tube.items()}
    problem = load_problem(f"example:{name}", changes=changes)
    spline = begun(problem, intervals)
    program = SequentialProgram(problem, spline.grid)
    begin, limits = program.iterate(spline), {"min_gain": 1e-3, "max_steps": 12}
    near = Descent((program,)).improved(DescentState((begin,), TrustRegion(0.2)), **limits).iterate
    nothing = Remembered(np.zeros(0, dtype=np.int64), ())
    linear = program.linearized(near, TrustRegion(trust), FIRST_PENALTY, nothing)
    columns = shared_columns([linear.shape], [False])
    assert StepSearch([linear], columns).solve() is not None
    return linear.block(linear.plain), columns, linear.shape.is_among


def unknowns(step):
    return np.concatenate([step.control.ravel(), step.switching, [step.duration, step.elastic]])


def cost(block, step):
    x = unknowns(step)
    return block.linear @ x + x @ block.quadratic.hessian.product(x) / 2


def least_slack(block, step):
    """Return the least that the step leaves of any row's slack."""
    x = unknowns(step)
    return (block.slack - matrix(stacked_rows(block.rows), len(x)) @ x).min()


def matrix(rows, size):
    ends = np.concatenate([[0], np.cumsum(rows.count)])
    return csr_matrix((rows.data, rows.column, ends), shape=(len(rows.count), size))


ALONG = np.linspace(0, 3, 41)
CORNERS = np.array([[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0], [0.2, 0.45, 0]])
# Forty segments, which ask in turns for other speeds of the tool: a phase each. The first and the
# last have many knots: what they share with others counts along all of them.
FORTY = {
    "points": [[np.interp(x, range(4), column) for column in CORNERS.T] for x in ALONG],
    "radius": 0.03,
    "tool_speed": [2.0, 2.1] * 20,
}


@NEEDS_LIBRARY
@pytest.mark.parametrize(
    ("name", "intervals", "trust", "tube"),
    [
        ("two_link/paper_5_10mm", 24, 0.01, {}),
        ("ur5/over_the_wall", 8, 0.1, {}),  # its goal is open: the tool is held there
        ("two_link/around_a_post", 40, 0.01, FORTY),  # switching times among configurations
    ],
)
def test_both_find_the_same_least_cost(name, intervals, trust, tube):
    block, columns, is_among = linearized(name, intervals, trust, **tube)
    steps = [program([block], columns).solve(FINE)[0] for program in (BandedProgram, SparseProgram)]
    costs = [cost(block, step) for step in steps]
    assert costs[0] == pytest.approx(costs[1], abs=AGREE)
    assert min(least_slack(block, step) for step in steps) > -1e-5
    assert min(step.multipliers.sum() for step in steps) > 0.5, "nothing but bounds counts"
    if tube:
        assert is_among[1:-1].all() and not is_among.all()
        assert abs(steps[0].switching).max() > 1e-5


def test_rows_lose_what_would_move_what_is_held_and_no_more():
    rows = SparseRows(np.array([3.0, 1.0, 2.0, 5.0]), np.array([0, 1, 2, 0]), np.array([3, 1]))
    lost = _projected(rows, np.array([1, 2]), np.array([[0.6, 0.8]]))
    first, second = matrix(lost, 3).toarray()
    assert first == pytest.approx([3.0, 1 - 0.6 * 2.2, 2 - 0.8 * 2.2])
    assert second.tolist() == [5.0, 0.0, 0.0]


# Small programs with known solutions, of one leg and of two, for both that solve them.

FAR, TOLERANCE = 0.1, 1e-8
FLAT_HESSIAN = (1e-6,) * 4


def diagonal(*curvature):
    count = np.arange(len(curvature))
    return SymmetricEntries(count, count, np.array(curvature), len(curvature))


def leg(
    slope, weight=1.0, which=1, held=None, bounds=(-FAR, FAR), gradient=0.0, hessian=FLAT_HESSIAN
):
    """Return a leg of two configurations of one joint: eta >= slope * one of them."""
    lower, upper = np.full((2, 1), bounds[0]), np.full((2, 1), bounds[1])
    rows = SparseRows(np.array([slope, -1.0]), np.array([which, 2]), np.array([2]))
    quadratic = Quadratic(diagonal(*hessian), np.full(2, gradient)).weighted(weight)
    held = np.zeros((0, 1)) if held is None else np.array(held)
    bounds = Bounds(lower, upper, np.zeros(0), np.ones(1), (-1.0, 1.0), held)
    return Block([rows], np.zeros(1), bounds, quadratic, 3.0 * weight)


def two_joints():
    """Return a leg of one configuration of two joints, of which only the difference may change."""
    ends = np.full((1, 2), FAR)
    rows = SparseRows(np.array([-3.0, -1.0, -1.0]), np.array([0, 1, 2]), np.array([3]))
    held = np.full((1, 2), 0.5**0.5)
    bounds = Bounds(-ends, ends, np.zeros(0), np.ones(1), (-1.0, 1.0), held)
    return Block([rows], np.zeros(1), bounds, Quadratic(diagonal(*FLAT_HESSIAN), np.zeros(2)), 3.0)


NATIVE = pytest.param(BandedProgram, id="native", marks=NEEDS_LIBRARY)


@pytest.fixture(params=[NATIVE, pytest.param(SparseProgram, id="PIQP")])
def solved(request):
    """Return what sets a program up and solves it."""

    def solved_by(blocks, is_tied):
        shapes = [LegShape(*block.bounds.lower.shape, 0) for block in blocks]
        program = request.param(blocks, shared_columns(shapes, is_tied))
        return program, program.solve(TOLERANCE)

    return solved_by


def test_a_leg_alone_goes_as_far_as_it_gains(solved):
    _, (step,) = solved([leg(-0.5)], [False])
    assert step.control[1, 0] == pytest.approx(FAR, abs=1e-5)
    assert step.duration == pytest.approx(-0.5 * FAR, abs=1e-5)
    assert step.elastic == pytest.approx(0.0, abs=1e-5)
    assert step.multipliers == pytest.approx([1.0], abs=1e-3)
    _, (step,) = solved([two_joints()], [False])
    assert step.control[0].sum() == pytest.approx(0.0, abs=1e-6)
    assert step.duration == pytest.approx(-2 * FAR, abs=1e-5)


NARROW = {"bounds": (-0.01, 0.03)}


@pytest.mark.parametrize(
    ("legs", "is_tied", "ends", "accuracy"),
    [
        # Those that fraction nothing take their own steps.
        ([leg(-1.0, 0.6), leg(2.0, 0.4, 0)], False, [FAR, -FAR], 1e-5),
        # A shared configuration keeps both bounds,
        ([leg(-1.0, 0.6), leg(1.0, 0.4, 0, **NARROW)], True, [0.03, 0.03], 1e-5),
        ([leg(-1.0, 0.6, **NARROW), leg(2.0, 0.4, 0)], True, [-0.01, -0.01], 1e-5),
        # costs both what it costs each: one would go one way, the other half as much the other way,
        ([leg(0.0, gradient=-1.0), leg(0.0, which=0, gradient=0.5)], True, [FAR, FAR], 1e-5),
        # and does not move where it is held.
        ([leg(-1.0, 0.6, held=[[1.0]]), leg(-1.0, 0.4, 0)], True, [0.0, 0.0], 1e-6),
        # One that costs the square of what it changes, behind one that costs next to nothing.
        (
            [leg(0.0, gradient=-0.02), leg(0.0, gradient=-0.02, hessian=(1.0, 1.0, 1e-6, 1e-6))],
            False,
            [FAR, 0.02],
            1e-4,
        ),
    ],
)
def test_two_legs_end_and_begin_where_it_costs_least(solved, legs, is_tied, ends, accuracy):
    _, (first, second) = solved(legs, [is_tied, False])
    values = [first.control[1, 0], second.control[0, 0]]
    assert values == pytest.approx(ends, abs=accuracy)


@pytest.mark.parametrize(("slope", "way"), [(1.0, 1), (2.0, -1)])
def test_a_shared_configuration_goes_where_the_weighted_sum_is_least(solved, slope, way):
    """0.6 of the first one's gain against 0.4 of the second one's loss, which is as steep."""
    _, steps = solved([leg(-1.0, 0.6), leg(slope, 0.4, which=0)], [True, False])
    assert steps[0].control[1] == steps[1].control[0]
    assert steps[0].control[1, 0] == pytest.approx(way * FAR, abs=1e-5)
    assert steps[0].duration == pytest.approx(-way * FAR, abs=1e-5)
    assert steps[1].duration == pytest.approx(way * slope * FAR, abs=1e-5)
    assert steps[0].multipliers == pytest.approx([0.6], abs=1e-3)
    assert steps[1].multipliers == pytest.approx([0.4], abs=1e-3)


def test_a_program_is_solved_again_with_other_slack(solved):
    blocks = [leg(-1.0, 0.6), leg(2.0, 0.4, which=0)]
    program, _ = solved(blocks, [True, False])
    slack = (np.array([0.05]), np.array([-0.02]))
    program.correct([replace(each, slack=own) for each, own in zip(blocks, slack, strict=True)])
    steps = program.solve(TOLERANCE)
    assert steps[0].duration == pytest.approx(FAR - 0.05, abs=1e-5)
    assert steps[1].duration == pytest.approx(-2 * FAR + 0.02, abs=1e-5)


def test_a_row_that_joins_is_obeyed_and_has_its_own_multiplier(solved):
    block = leg(-1.0)
    program, (free,) = solved([block], [False])
    assert free.control[1, 0] == pytest.approx(FAR, abs=1e-5)
    wall = SparseRows(np.array([2.0]), np.array([1]), np.array([1]))
    program.join([replace(block, rows=[*block.rows, wall], slack=np.array([0.0, 0.02]))])
    (step,) = program.solve(TOLERANCE)
    assert step.control[1, 0] == pytest.approx(0.01, abs=1e-5)
    assert step.multipliers == pytest.approx([1.0, 0.5], abs=1e-3)


STEEP, COUNT = 1e10, 300


def steep_leg():
    """Return a leg whose jerk is limited on many knots: its rows leave hardly any room."""
    rng = np.random.default_rng(0)
    count, pulls = 2 * (COUNT - 3), 5
    third = np.tile(STEEP * np.array([-1.0, 3.0, -3.0, 1.0]), (COUNT - 3, 1))
    columns = np.tile(np.add.outer(np.arange(COUNT - 3), np.arange(4)).ravel(), 2)
    jerk = SparseRows(np.concatenate([third, -third]).ravel(), columns, np.full(count, 4))
    places = np.linspace(10, COUNT - 10, pulls).astype(int)
    ways = np.column_stack([rng.choice([-1.0, 1.0], pulls), np.full(pulls, -1.0)])
    eta = np.column_stack([places, np.full(pulls, COUNT)])
    gains = SparseRows(ways.ravel(), eta.ravel(), np.full(pulls, 2))
    slack = np.concatenate([rng.uniform(0.0, 1.0, count), np.zeros(pulls)])
    ends = np.full((COUNT, 1), FAR)
    bounds = Bounds(-ends, ends, np.zeros(0), np.ones(1), (-1.0, 1.0), np.zeros((0, 1)))
    quadratic = Quadratic(diagonal(*np.full(COUNT + 2, 1e-6)), np.zeros(COUNT))
    return Block([jerk, gains], slack, bounds, quadratic, 3.0)


@NEEDS_LIBRARY
def test_where_rounding_lets_nothing_get_nearer_the_nearest_will_do():
    block = steep_leg()
    program = BandedProgram([block], shared_columns([LegShape(COUNT, 1, 0)], [False]))
    rows = stacked_rows(block.rows)
    least = linprog(
        np.eye(COUNT + 1)[-1],
        matrix(rows, COUNT + 1),
        block.slack,
        bounds=[(-FAR, FAR)] * COUNT + [(-1.0, 1.0)],
    ).fun
    for tolerance in (1e-4, 1e-6):  # the second one is more than can be had
        (step,) = program.solve(tolerance)
        assert step.duration == pytest.approx(least, rel=1e-4)
    iterations = program.iterations
    assert iterations < 100, "it ends when nothing gets better"


@NEEDS_LIBRARY
def test_a_program_that_cannot_be_solved_can_be_when_it_has_other_slack():
    block = leg(-1.0)
    walls = SparseRows(np.array([1.0, -1.0]), np.array([1, 1]), np.array([1, 1]))
    crossed, open_ = (
        replace(block, rows=[*block.rows, walls], slack=np.array([0.0, *own]))
        for own in ((-0.05, -0.05), (0.05, 0.05))
    )
    program = BandedProgram([crossed], shared_columns([LegShape(2, 1, 0)], [False]))
    assert program.solve(TOLERANCE) is None
    program.correct([open_])
    (step,) = program.solve(TOLERANCE)
    assert step.control[1, 0] == pytest.approx(0.05, abs=1e-5)
