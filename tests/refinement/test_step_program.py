"""Small programs with known solutions, of one leg and of two, for both that solve them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from tubeplanner.native.library import LIBRARY
from tubeplanner.refinement.banded_program import BandedProgram
from tubeplanner.refinement.shared_columns import LegShape, shared_columns
from tubeplanner.refinement.sparse_program import SparseProgram
from tubeplanner.refinement.step_block import (
    Block,
    Bounds,
    Quadratic,
    SparseRows,
    stacked_rows,
)
from tubeplanner.refinement.symmetric_entries import SymmetricEntries

FAR, TOLERANCE = 0.1, 1e-8


def leg(slope, weight=1.0, which=1, held=None, bounds=(-FAR, FAR), gradient=0.0):
    """Return a leg of two configurations of one joint: eta >= slope * one of them."""
    lower, upper = np.full((2, 1), bounds[0]), np.full((2, 1), bounds[1])
    rows = SparseRows(np.array([slope, -1.0]), np.array([which, 2]), np.array([2]))
    eye = np.arange(4)
    hessian = SymmetricEntries(eye, eye, np.full(4, 1e-6), 4)
    quadratic = Quadratic(hessian, np.full(2, gradient)).weighted(weight)
    return Block(
        [rows],
        np.zeros(1),
        Bounds(
            lower,
            upper,
            np.zeros(0),
            np.ones(1),
            (-1.0, 1.0),
            np.zeros((0, 1)) if held is None else np.array(held),
        ),
        quadratic,
        3.0 * weight,
    )


NATIVE = pytest.param(
    BandedProgram,
    id="native",
    marks=pytest.mark.skipif(LIBRARY.functions is None, reason="the native library is left out"),
)


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


def test_legs_that_share_nothing_take_their_own_steps(solved):
    _, steps = solved([leg(-1.0, 0.6), leg(2.0, 0.4, which=0)], [False, False])
    assert steps[0].control[1, 0] == pytest.approx(FAR, abs=1e-5)
    assert steps[1].control[0, 0] == pytest.approx(-FAR, abs=1e-5)


@pytest.mark.parametrize(
    ("one", "other"), [((-FAR, FAR), (-0.01, 0.03)), ((-0.01, 0.03), (-FAR, FAR))]
)
@pytest.mark.parametrize(("slope", "end"), [(1.0, 0.03), (2.0, -0.01)])
def test_a_shared_configuration_keeps_both_bounds(solved, one, other, slope, end):
    blocks = [leg(-1.0, 0.6, bounds=one), leg(slope, 0.4, which=0, bounds=other)]
    _, steps = solved(blocks, [True, False])
    assert steps[0].control[1, 0] == pytest.approx(end, abs=1e-5)


def test_a_shared_configuration_costs_both_what_it_costs_each(solved):
    """One would have it go one way, the other half as much the other way."""
    blocks = [leg(0.0, gradient=-1.0), leg(0.0, which=0, gradient=0.5)]
    _, steps = solved(blocks, [True, False])
    assert steps[1].control[0, 0] == pytest.approx(FAR, abs=1e-5)


def test_what_is_held_does_not_move(solved):
    _, steps = solved([leg(-1.0, 0.6, held=[[1.0]]), leg(-1.0, 0.4, which=0)], [True, False])
    assert steps[1].control[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_a_program_is_solved_again_with_other_slack(solved):
    blocks = [leg(-1.0, 0.6), leg(2.0, 0.4, which=0)]
    program, _ = solved(blocks, [True, False])
    others = ([0.05], [-0.02])
    program.correct(
        [replace(block, slack=np.array(own)) for block, own in zip(blocks, others, strict=True)]
    )
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


def test_rows_that_would_move_what_is_held_do_not(solved):
    """Two joints, of which only their difference may change."""
    lower, upper = np.full((1, 2), -FAR), np.full((1, 2), FAR)
    rows = SparseRows(np.array([-3.0, -1.0, -1.0]), np.array([0, 1, 2]), np.array([3]))
    bounds = Bounds(
        lower, upper, np.zeros(0), np.ones(1), (-1.0, 1.0), np.array([[0.5**0.5, 0.5**0.5]])
    )
    eye = np.arange(4)
    hessian = SymmetricEntries(eye, eye, np.full(4, 1e-6), 4)
    block = Block([rows], np.zeros(1), bounds, Quadratic(hessian, np.zeros(2)), 3.0)
    _, (step,) = solved([block], [False])
    assert step.control[0].sum() == pytest.approx(0.0, abs=1e-6)
    assert step.duration == pytest.approx(-2 * FAR, abs=1e-5)


def test_curvature_is_that_of_each_legs_own_variables(solved):
    """A leg that costs the square of what it changes, behind one that costs next to nothing."""
    soft, stiff = leg(0.0, gradient=-0.02), leg(0.0, gradient=-0.02)
    eye = np.arange(4)
    hessian = SymmetricEntries(eye, eye, np.array([1.0, 1.0, 1e-6, 1e-6]), 4)
    stiff = replace(stiff, quadratic=replace(stiff.quadratic, hessian=hessian))
    _, steps = solved([soft, stiff], [False, False])
    assert steps[0].control[0, 0] == pytest.approx(FAR, abs=1e-4)
    assert steps[1].control[0, 0] == pytest.approx(0.02, abs=1e-4)


# What a third difference of configurations may be, and how steeply it counts.
STEEP, COUNT = 1e10, 300
NATIVE_ALONE = pytest.mark.skipif(LIBRARY.functions is None, reason="of the native library")


def steep_leg():
    """Return a leg whose jerk is limited on many knots: its rows leave hardly any room."""
    rng = np.random.default_rng(0)
    count, pulls = 2 * (COUNT - 3), 5
    configurations = np.add.outer(np.arange(COUNT - 3), np.arange(4))
    third = np.tile(STEEP * np.array([-1.0, 3.0, -3.0, 1.0]), (COUNT - 3, 1))
    jerk = SparseRows(
        np.concatenate([third, -third]).ravel(),
        np.tile(configurations.ravel(), 2),
        np.full(count, 4),
    )
    places = np.linspace(10, COUNT - 10, pulls).astype(int)
    ways = np.column_stack([rng.choice([-1.0, 1.0], pulls), np.full(pulls, -1.0)])
    eta = np.column_stack([places, np.full(pulls, COUNT)])
    gains = SparseRows(ways.ravel(), eta.ravel(), np.full(pulls, 2))
    slack = np.concatenate([rng.uniform(0.0, 1.0, count), np.zeros(pulls)])
    eye = np.arange(COUNT + 2)
    hessian = SymmetricEntries(eye, eye, np.full(COUNT + 2, 1e-6), COUNT + 2)
    ends = np.full((COUNT, 1), FAR)
    bounds = Bounds(-ends, ends, np.zeros(0), np.ones(1), (-1.0, 1.0), np.zeros((0, 1)))
    return Block([jerk, gains], slack, bounds, Quadratic(hessian, np.zeros(COUNT)), 3.0)


@NATIVE_ALONE
def test_where_rounding_lets_nothing_get_nearer_the_nearest_will_do():
    block = steep_leg()
    program = BandedProgram([block], shared_columns([LegShape(COUNT, 1, 0)], [False]))
    rows = stacked_rows(block.rows)
    ends = np.concatenate([[0], np.cumsum(rows.count)])
    least = linprog(
        np.eye(COUNT + 1)[-1],
        csr_matrix((rows.data, rows.column, ends), shape=(len(rows.count), COUNT + 1)),
        block.slack,
        bounds=[(-FAR, FAR)] * COUNT + [(-1.0, 1.0)],
    ).fun
    for tolerance in (1e-4, 1e-6):  # the second one is more than can be had
        (step,) = program.solve(tolerance)
        assert step.duration == pytest.approx(least, rel=1e-4)
    iterations = program._program.iterations
    assert iterations < 100, "it ends when nothing gets better"


@NATIVE_ALONE
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
