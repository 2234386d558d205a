"""Small programs with known solutions: of one leg, and of two that share a configuration."""

import numpy as np
import pytest

from tubeplanner.refinement.step_block import (
    Block,
    Bounds,
    Quadratic,
    SparseRows,
)
from tubeplanner.refinement.shared_columns import LegShape, shared_columns

FAR, TOLERANCE = 0.1, 1e-8


def leg(slope, weight=1.0, which=1, held=None, bounds=(-FAR, FAR), gradient=0.0):
    """Return a leg of two configurations of one joint: eta >= slope * one of them."""
    lower, upper = np.full((2, 1), bounds[0]), np.full((2, 1), bounds[1])
    rows = SparseRows(np.array([slope, -1.0]), np.array([which, 2]), np.array([2]))
    hessian = sparse.csc_matrix(1e-6 * np.eye(4))
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


def solved(blocks, is_tied):
    shapes = [LegShape(2, 1, 0)] * len(blocks)
    program = StepProgram(blocks, shared_columns(shapes, is_tied), TOLERANCE)
    return program, program.solve()


def test_a_leg_alone_goes_as_far_as_it_gains():
    _, (step,) = solved([leg(-0.5)], [False])
    assert step.control[1, 0] == pytest.approx(FAR, abs=1e-5)
    assert step.duration == pytest.approx(-0.5 * FAR, abs=1e-5)
    assert step.elastic == pytest.approx(0.0, abs=1e-5)
    assert step.multipliers == pytest.approx([1.0], abs=1e-3)


@pytest.mark.parametrize(("slope", "way"), [(1.0, 1), (2.0, -1)])
def test_a_shared_configuration_goes_where_the_weighted_sum_is_least(slope, way):
    """0.6 of the first one's gain against 0.4 of the second one's loss, which is as steep."""
    _, steps = solved([leg(-1.0, 0.6), leg(slope, 0.4, which=0)], [True, False])
    assert steps[0].control[1] == steps[1].control[0]
    assert steps[0].control[1, 0] == pytest.approx(way * FAR, abs=1e-5)
    assert steps[0].duration == pytest.approx(-way * FAR, abs=1e-5)
    assert steps[1].duration == pytest.approx(way * slope * FAR, abs=1e-5)
    assert steps[0].multipliers == pytest.approx([0.6], abs=1e-3)
    assert steps[1].multipliers == pytest.approx([0.4], abs=1e-3)


def test_legs_that_share_nothing_take_their_own_steps():
    _, steps = solved([leg(-1.0, 0.6), leg(2.0, 0.4, which=0)], [False, False])
    assert steps[0].control[1, 0] == pytest.approx(FAR, abs=1e-5)
    assert steps[1].control[0, 0] == pytest.approx(-FAR, abs=1e-5)


@pytest.mark.parametrize(
    ("one", "other"), [((-FAR, FAR), (-0.01, 0.03)), ((-0.01, 0.03), (-FAR, FAR))]
)
@pytest.mark.parametrize(("slope", "end"), [(1.0, 0.03), (2.0, -0.01)])
def test_a_shared_configuration_keeps_both_bounds(one, other, slope, end):
    blocks = [leg(-1.0, 0.6, bounds=one), leg(slope, 0.4, which=0, bounds=other)]
    _, steps = solved(blocks, [True, False])
    assert steps[0].control[1, 0] == pytest.approx(end, abs=1e-5)


def test_a_shared_configuration_costs_both_what_it_costs_each():
    """One would have it go one way, the other half as much the other way."""
    blocks = [leg(0.0, gradient=-1.0), leg(0.0, which=0, gradient=0.5)]
    _, steps = solved(blocks, [True, False])
    assert steps[1].control[0, 0] == pytest.approx(FAR, abs=1e-5)


def test_what_is_held_does_not_move():
    _, steps = solved([leg(-1.0, 0.6, held=[[1.0]]), leg(-1.0, 0.4, which=0)], [True, False])
    assert steps[1].control[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_a_program_is_solved_again_with_other_slack():
    program, _ = solved([leg(-1.0, 0.6), leg(2.0, 0.4, which=0)], [True, False])
    steps = program.solve_again([np.array([0.05]), np.array([-0.02])])
    assert steps[0].duration == pytest.approx(FAR - 0.05, abs=1e-5)
    assert steps[1].duration == pytest.approx(-2 * FAR + 0.02, abs=1e-5)
