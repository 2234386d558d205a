"""Descent: trust region, single steps, accepted iterates of one or more legs, open ends."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import begun

from tubeplanner import GoalRegion, PlanningProblem, PlanOptions, Seed, Tube, load_robot, plan
from tubeplanner.optimizer import descent
from tubeplanner.optimizer.descent import FIRST_PENALTY, Descent, DescentState, SequentialProgram
from tubeplanner.optimizer.step_program import Step
from tubeplanner.optimizer.step_search import MIN_RADIUS, Outcome, TrustRegion, motion_unit
from tubeplanner.optimizer.tied_legs import TiedLegs


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
    return Descent((program,)).improved(DescentState((begin,), TrustRegion(radius)), **limits)


@pytest.mark.parametrize("radius", [0.01, 0.05, 0.1, 0.2, 0.4])
def test_a_step_that_bends_out_of_the_tube_is_corrected_and_costs_nothing_it_should_not(
    corner, radius
):
    """Whatever is taken is better: in duration, or in what is outside at its penalty."""
    begin, after = corner[1], steps(corner, radius, 1).iterate
    assert after is not begin
    if radius >= 0.2:
        assert after.excess < 0.6 * begin.excess
    fraction = after.squared_duration / begin.squared_duration
    assert fraction + FIRST_PENALTY * (after.excess - begin.excess) < 1


def test_the_radius_of_a_step_is_that_of_its_control_points_or_of_its_phases(corner):
    """A trust region lets phases change by eight times its radius, relative to their widths."""
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

FAST = PlanOptions(quality="fast", slack=0.0)
# Where the hand of a two-link arm starts, and ends each leg, within a tolerance.
POINTS = np.array([[0.3, -0.5, 0.0], [0.5, 0.2, 0.0], [0.1, 0.6, 0.0], [-0.4, 0.3, 0.0]])
TOLERANCE, RADIUS = 0.05, 0.08


@pytest.fixture(scope="module")
def robot():
    return load_robot("example:two_link", "hand")


def leg(robot, ends, start, goal):
    return PlanningProblem(robot, Tube(ends, RADIUS), start, goal)


def planned_legs(robot, points):
    """Return the results of legs planned one after the other, each to a ball at a point."""
    start, results = Seed([0.0, -1.0]), []
    for ends in pairwise(points):
        results.append(plan(leg(robot, list(ends), start, GoalRegion(ends[1], TOLERANCE)), FAST))
        start = results[-1].trajectory.position(results[-1].duration)
    return results


@pytest.fixture(scope="module")
def results(robot):
    return planned_legs(robot, POINTS)


@pytest.fixture(scope="module")
def motions(results):
    return [result.motion for result in results]


def improved(motions, is_tied, radius, steps=1, announced=lambda iterates: None):
    programs = [
        SequentialProgram(motion.problem, motion.spline.grid, start_moves=is_tied[k - 1])
        for k, motion in enumerate(motions)
    ]
    pairs = zip(programs, motions, strict=True)
    begin = tuple(program.iterate(motion.spline) for program, motion in pairs)
    limits = {"min_gain": 1e-7, "max_steps": steps, "checkpoint": announced}
    descent = Descent(programs, is_tied)
    return begin, descent.improved(DescentState(begin, TrustRegion(radius)), **limits)


def total(iterates):
    return sum(iterate.duration for iterate in iterates)


def test_tied_legs_gain_where_legs_alone_have_nothing_left(motions):
    """Both are as short as they get, each from its start: what is left is where they meet."""
    begin, alone = improved(motions[:2], (False, False), 0.02, steps=4)
    assert total(alone.iterates) > 0.998 * total(begin)
    _, tied = improved(motions[:2], (True, False), 0.02, steps=4)
    assert total(tied.iterates) < 0.993 * total(begin)
    with pytest.raises(ValueError, match="too many values"):
        _ = tied.iterate
    _, single = improved(motions[:1], (False,), 0.005)
    assert single.iterate is single.iterates[0]


def test_tied_ends_agree_after_every_step(motions):
    iterates = []
    improved(motions[:2], (True, False), 0.05, steps=5, announced=iterates.append)
    assert len(iterates) == 5
    ends = np.array([one.spline.control_points[-3:] for one, _ in iterates])
    starts = np.array([other.spline.control_points[:3] for _, other in iterates])
    np.testing.assert_array_equal(ends, starts)
    assert abs(ends[-1] - motions[0].spline.control_points[-1]).max() > 0.01


def test_what_legs_gain_counts_by_their_durations(robot, monkeypatch):
    """Seconds count, not shares: twice the fraction of the sum, as T^2 is what counts."""
    outcomes, sums = [], []

    def noted(*fields):
        outcomes.append(Outcome(*fields))
        return outcomes[-1]

    legs = planned_legs(robot, [*POINTS[:2], np.array([0.46, 0.32, 0.0])])
    monkeypatch.setattr(descent, "Outcome", noted)
    legs = [result.motion for result in legs]
    begin, _ = improved(legs, (True, False), 0.01, 4, lambda iterates: sums.append(total(iterates)))
    fractions = -np.diff([total(begin), *sums]) / [total(begin), *sums[:-1]]
    gains = np.array([outcome.gain for outcome in outcomes])
    assert (fractions > 0.003).sum() >= 2
    np.testing.assert_allclose(gains[fractions > 0.003], 2 * fractions[fractions > 0.003], rtol=0.4)


@pytest.mark.parametrize(("radius", "factor"), [(1e-4, 4), (0.01, 1), (0.2, 1)])
def test_what_stays_broken_costs_more_unless_the_step_mends_a_part(radius, factor, motions):
    problem = motions[0].problem
    outside = replace(motions[0], problem=problem.with_tube(problem.tube.scaled(0.7)))
    begin, after = improved([outside], (False,), radius)
    assert begin[0].excess > 0.1
    assert after.penalty == factor * FIRST_PENALTY


# Legs whose common ends are open: where they end, and what that is worth.

DEAR = pytest.mark.dear("plans and improves several legs")


@pytest.fixture(scope="module")
def tied(motions):
    legs = TiedLegs(motions, [True, True])
    return legs, legs.run()


@DEAR
def test_tied_ends_agree_exactly_at_rest_and_all_legs_take_less(robot, results, tied):
    """The hand stays within the goals' tolerance, of which it makes use."""
    alone = TiedLegs([result.motion for result in results], [False, False])
    alone.run()
    assert sum(tied[0].durations) < 0.995 * sum(alone.durations)
    for one, other in zip(tied[1][:-1], tied[1][1:], strict=True):
        q = one.control_points[-1]
        np.testing.assert_array_equal(one.control_points[-3:], [q, q, q])
        np.testing.assert_array_equal(other.control_points[:3], [q, q, q])
    before = results[0].motion.spline.control_points[0]
    np.testing.assert_array_equal(tied[1][0].control_points[0], before)
    ends = np.array([spline.control_points[-1] for spline in tied[1]])
    away = np.linalg.norm(robot.tool_position(ends) - POINTS[1:], axis=1)
    assert (away <= TOLERANCE).all()
    assert away.max() > 0.9 * TOLERANCE


@DEAR
def test_an_end_that_is_not_tied_stays_and_every_step_is_announced_with_the_sum(results, motions):
    """A checkpoint may end the work."""
    sums = []
    first, second, third = TiedLegs(motions, [True, False], checkpoint=sums.append).run()
    before = motions[2].spline.control_points[0]
    np.testing.assert_array_equal(third.control_points[0], before)
    np.testing.assert_array_equal(first.control_points[-1], second.control_points[0])
    assert len(sums) > 2
    assert sums[-1] == pytest.approx(sum(result.duration for result in results), rel=0.05)

    def stop(duration):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        TiedLegs(motions, [True, True], checkpoint=stop).run()


@DEAR
def test_a_closed_cycle_begins_where_it_ends(robot, results):
    """A leg back to the first point; where the cycle closes is chosen as well."""
    first = results[0]
    goal, last = (first.trajectory.position(t) for t in (0.0, first.duration))
    back = plan(PlanningProblem(robot, Tube(POINTS[[1, 0]], 0.7), last, goal), FAST).motion
    back = replace(back, problem=replace(back.problem, goal=GoalRegion(POINTS[0], TOLERANCE)))
    legs = TiedLegs([first.motion, back], [True], is_closed=True)
    splines = legs.run()
    begin, end = splines[0].control_points[:3], splines[-1].control_points[-3:]
    np.testing.assert_array_equal(begin, np.tile(end[-1], (3, 1)))
    assert np.ptp(end, axis=0).max() == 0
    shift = robot.tool_position(begin[:1])[0] - POINTS[0]
    assert 0.001 < np.linalg.norm(shift) <= TOLERANCE
    assert abs(begin[0] - goal).max() > 0.01
    open_legs = TiedLegs([first.motion, back], [True])
    open_legs.run()
    assert sum(legs.durations) < sum(open_legs.durations) + 1e-3
