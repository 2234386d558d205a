"""Descent: trust region, single steps, accepted iterates of one or more legs."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from begun_splines import begun

from tubeplanner import GoalRegion, PlanningProblem, PlanOptions, Seed, Tube, load_robot, plan
from tubeplanner.refinement import descent
from tubeplanner.refinement.descent import FIRST_PENALTY, Descent
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.step_block import Step
from tubeplanner.refinement.trust_region import MIN_RADIUS, Outcome, TrustRegion, motion_unit

# How the region follows what became of steps.


def outcome(predicted=0.1, linear=0.1, gain=0.1, size=0.1, squared_rates=1.0):
    return Outcome(predicted, linear, gain, size, squared_rates)


@pytest.mark.parametrize(
    ("region", "became", "radius", "damping"),
    [
        (TrustRegion(0.1, 0.3), outcome(), 0.2, 0.3 / 5),  # a good step at the border
        (TrustRegion(0.1, 0.3), outcome(size=0.01), 0.1, 0.3 / 5),  # and one inside
        (TrustRegion(0.1, 0.3), outcome(gain=0.04), 0.1, 0.3),  # a fair one
        (TrustRegion(0.1, 0.3), outcome(gain=0.06), 0.1, 0.3 / 5),  # a decent one
        # A bad one, off by 0.5 at rates of 2: a fifth of that over their square; at least doubled.
        (
            TrustRegion(0.1, 1e-6),
            outcome(linear=-0.4, gain=-0.4, squared_rates=4.0),
            0.04,
            0.2 * 0.5 / 4,
        ),
        (TrustRegion(0.1, 1.0), outcome(linear=0.02, gain=0.02, squared_rates=100.0), 0.1, 2.0),
        # One that a correction saved is not damped for what it left out, unless saved but a little.
        (TrustRegion(0.1, 0.3), outcome(linear=-5.0, gain=0.09), 0.2, 0.3 / 5),
        (TrustRegion(0.1, 1e-6), outcome(linear=-0.4, gain=0.02), 0.1, 0.2 * 0.5),
        # One shorter than the radius shrinks it below its own size.
        (TrustRegion(0.4), outcome(gain=-1.0, size=0.05), 0.02, None),
    ],
)
def test_the_region_follows_what_became_of_a_step(region, became, radius, damping):
    after = region.after(became)
    assert after.radius == pytest.approx(radius)
    assert damping is None or after.damping == pytest.approx(damping)


def test_it_ends_when_no_step_is_left():
    assert not TrustRegion(MIN_RADIUS).has_collapsed
    assert TrustRegion(MIN_RADIUS).smaller().has_collapsed
    assert TrustRegion(0.1, 1e15).has_collapsed
    # In a small motion much damping is of use.
    assert not TrustRegion(0.1, 1e9, unit=1e-3).has_collapsed
    # Variables that do not move leave no rates to divide by.
    still = outcome(gain=-1.0, linear=-1.0, size=0.0, squared_rates=0.0)
    assert TrustRegion(0.1).after(still).has_collapsed


def test_radii_are_in_units_of_the_farthest_joint_of_all_motions():
    region = TrustRegion(0.1, unit=0.01)
    assert region.largest_change == pytest.approx(1e-3)
    assert region.after(outcome()).unit == region.smaller().unit == 0.01
    still, small, large = np.zeros((3, 2)), np.array([[0.0, 5.0], [0.01, 5.03]]), np.eye(2)
    assert motion_unit([still, small]) == pytest.approx(0.03 / 0.3)
    assert motion_unit([small, large]) == 1.0
    assert motion_unit([still]) == 1.0


def test_damping_that_holds_steps_back_is_relaxed_twice():
    assert not TrustRegion(0.1, 0.1).may_relax
    assert not TrustRegion(0.1, 100.0, unit=0.01).may_relax, "of a small motion that is little"
    trust = TrustRegion(0.1, 1.0)
    assert trust.relaxed() == TrustRegion(0.1, 0.01, times_relaxed=1)
    for _ in range(2):
        assert trust.may_relax
        trust = replace(trust.relaxed(), damping=1e6)
    assert not trust.may_relax


# Single steps, on a corner that straight steps leave.


@pytest.fixture(scope="module")
def corner(bundled):
    """A program, and the trajectory that it begins with: outside the tube by a radius."""
    problem = bundled("two_link/paper_5_10mm")
    spline = begun(problem, 8)
    program = SequentialProgram(problem, spline.grid)
    return program, program.iterate(spline)


def steps(corner, radius, count):
    program, begin = corner
    limits = {"min_gain": 1e-6, "max_steps": count}
    return program.improved(begin, TrustRegion(radius), FIRST_PENALTY, **limits)


@pytest.mark.parametrize("radius", [0.01, 0.05, 0.1, 0.2, 0.4])
def test_a_step_that_bends_out_of_the_tube_is_corrected_and_costs_nothing_it_should_not(
    corner, radius
):
    """Without its correction a long one would end farther outside than it began.

    Whatever is taken is better: in duration, or in what is outside at its penalty.
    """
    begin, after = corner[1], steps(corner, radius, 1).iterate
    assert after is not begin
    if radius >= 0.2:
        assert after.excess < 0.6 * begin.excess
    share = after.squared_duration / begin.squared_duration
    assert share + FIRST_PENALTY * (after.excess - begin.excess) < 1


def test_a_region_that_is_too_small_grows_and_one_that_is_too_wide_shrinks_or_is_damped(corner):
    assert steps(corner, 0.005, 4).trust.radius >= 8 * 0.005
    trust = steps(corner, 1.0, 6).trust
    assert trust.radius <= 0.5 or trust.damping > 100 * TrustRegion.damping


def test_the_radius_of_a_step_is_that_of_its_control_points_or_of_its_phases(corner):
    """A trust region lets phases change by eight times its radius, as a share of their widths."""
    program, begin = corner
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


# Steps of several legs at once: what they promise, and what they share.


POINTS = np.array([[0.3, -0.5, 0.0], [0.5, 0.2, 0.0], [0.1, 0.6, 0.0]])


def planned(points):
    """Return legs of a two-link arm planned one after the other, each to a ball at a point."""
    robot, start, found = load_robot("example:two_link", "hand"), Seed([0.0, -1.0]), []
    for ends in pairwise(points):
        problem = PlanningProblem(robot, Tube(list(ends), 0.08), start, GoalRegion(ends[1], 0.05))
        result = plan(problem, PlanOptions(quality="fast", slack=0.0))
        start = result.motion.spline.control_points[-1]
        found.append(result.motion)
    return found


@pytest.fixture(scope="module")
def motions():
    """Two legs, the end between them in a ball."""
    return planned(POINTS)


def improved(motions, is_tied, radius, steps=1, announced=lambda iterates: None):
    programs = [
        SequentialProgram(motion.problem, motion.spline.grid, start_moves=is_tied[k - 1])
        for k, motion in enumerate(motions)
    ]
    pairs = zip(programs, motions, strict=True)
    begin = tuple(program.iterate(motion.spline) for program, motion in pairs)
    limits = {"min_gain": 1e-7, "max_steps": steps, "checkpoint": announced}
    descent = Descent(programs, is_tied)
    return begin, descent.improved(begin, TrustRegion(radius), FIRST_PENALTY, **limits)


def total(iterates):
    return sum(iterate.duration for iterate in iterates)


def test_tied_legs_gain_where_legs_alone_have_nothing_left(motions):
    """Both are as short as they get, each from its start: what is left is where they meet."""
    begun, alone = improved(motions, (False, False), 0.02, steps=4)
    assert total(alone.iterates) > 0.998 * total(begun)
    _, tied = improved(motions, (True, False), 0.02, steps=4)
    assert total(tied.iterates) < 0.993 * total(begun)


def test_tied_ends_agree_after_every_step(motions):
    iterates = []
    improved(motions, (True, False), 0.05, steps=5, announced=iterates.append)
    assert len(iterates) == 5
    ends = np.array([one.spline.control_points[-3:] for one, _ in iterates])
    starts = np.array([other.spline.control_points[:3] for _, other in iterates])
    np.testing.assert_array_equal(ends, starts)
    assert abs(ends[-1] - motions[0].spline.control_points[-1]).max() > 0.01


def test_what_legs_gain_counts_by_their_durations(monkeypatch):
    """Seconds count, not shares: twice the share by which the sum is less, as T^2 is what counts.

    The second leg is short: most of its duration is gained, and some of the first one's lost.
    """
    outcomes, sums = [], []

    def noted(*fields):
        outcomes.append(Outcome(*fields))
        return outcomes[-1]

    legs = planned(np.array([*POINTS[:2], [0.46, 0.32, 0.0]]))
    monkeypatch.setattr(descent, "Outcome", noted)
    begin, _ = improved(legs, (True, False), 0.01, 4, lambda iterates: sums.append(total(iterates)))
    shares = -np.diff([total(begin), *sums]) / [total(begin), *sums[:-1]]
    gains = np.array([outcome.gain for outcome in outcomes])
    assert (shares > 0.003).sum() >= 2
    np.testing.assert_allclose(gains[shares > 0.003], 2 * shares[shares > 0.003], rtol=0.4)


def test_a_single_iterate_is_that_of_a_single_leg(motions):
    _, found = improved(motions[:1], (False,), 0.005)
    assert found.iterate is found.iterates[0]
    _, both = improved(motions, (False, False), 0.005)
    with pytest.raises(ValueError, match="too many values"):
        _ = both.iterate


@pytest.mark.parametrize(("radius", "factor"), [(1e-4, 4), (0.01, 1), (0.2, 1)])
def test_what_stays_broken_costs_more_unless_the_step_mends_a_part(radius, factor, motions):
    motion = motions[0]
    narrower = motion.problem.with_tube(motion.problem.tube.scaled(0.7))
    outside = replace(motion, problem=narrower)
    begun, found = improved([outside], (False,), radius)
    assert begun[0].excess > 0.1
    assert found.penalty == factor * FIRST_PENALTY
