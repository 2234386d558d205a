"""Single steps of the optimiser, on a corner that straight steps leave."""

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.descent import FIRST_PENALTY
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.refinement.step_block import Step
from tubeplanner.refinement.trust_region import TrustRegion


@pytest.fixture(scope="module")
def begun():
    """Return a program, and the trajectory that it begins with: outside the tube by a radius."""
    problem = load_problem("example:two_link/paper_5_10mm")
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    spline = starting_spline(problem, branch, 8)
    program = SequentialProgram(problem, spline.grid)
    return program, program.iterate(spline)


def steps(begun, trust, count):
    program, begin = begun
    region = TrustRegion(trust)
    return program.improved(begin, region, FIRST_PENALTY, min_gain=1e-6, max_steps=count)


@pytest.mark.parametrize("trust", [0.2, 0.4])
def test_a_step_that_bends_out_of_the_tube_is_corrected_and_not_refused(begun, trust):
    """Without its correction it would end farther outside than it began."""
    begin = begun[1]
    after = steps(begun, trust, 1).iterate
    assert after is not begin
    assert after.excess < 0.6 * begin.excess


def test_a_step_costs_nothing_it_should_not(begun):
    """Whatever is taken is better: in duration, or in what is outside at its penalty."""
    begin = begun[1]
    for trust in (0.01, 0.05, 0.1):
        after = steps(begun, trust, 1).iterate
        share = after.squared_duration / begin.squared_duration
        assert share + FIRST_PENALTY * (after.excess - begin.excess) < 1


def test_a_region_that_is_too_small_grows(begun):
    assert steps(begun, 0.005, 4).trust.radius >= 8 * 0.005


def test_a_region_that_is_too_wide_shrinks_or_is_damped(begun):
    trust = steps(begun, 1.0, 6).trust
    assert trust.radius <= 0.5 or trust.damping > 100 * TrustRegion.damping


def test_the_radius_of_a_step_is_that_of_its_control_points_or_of_its_phases(begun):
    """A trust region lets phases change by eight times its radius, as a share of their widths."""
    program, begin = begun
    control = np.zeros_like(program.variables.lower)
    control[2, 1] = -0.004
    widths = np.diff(begin.spline.switching_times)
    switching = np.zeros(program.grid.switch_count)
    switching[0] = 0.02 * widths[:2].min()
    bent = Step(control, 0 * switching, 0.0, 0.0, np.zeros(0))
    shifted = Step(control, switching, 0.0, 0.0, np.zeros(0))
    assert program.radius_of(begin, bent, 0.5) == pytest.approx(0.008)
    assert program.radius_of(begin, shifted, 1.0) == pytest.approx(0.004)
    assert program.radius_of(begin, shifted, 100.0) == pytest.approx(0.02 / 8)
