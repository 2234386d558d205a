"""How the region follows what became of steps."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner.refinement.trust_region import MIN_RADIUS, Outcome, TrustRegion, motion_unit


def outcome(predicted=0.1, linear=0.1, gain=0.1, size=0.1, squared_rates=1.0):
    return Outcome(predicted, linear, gain, size, squared_rates)


def test_a_good_step_at_the_border_widens_the_region_and_is_damped_less():
    region = TrustRegion(0.1, 0.3).after(outcome())
    assert region.radius == pytest.approx(0.2)
    assert region.damping == pytest.approx(0.3 / 5)


def test_a_good_step_inside_leaves_the_radius():
    assert TrustRegion(0.1, 0.3).after(outcome(size=0.01)).radius == 0.1


def test_a_fair_step_changes_nothing():
    region = TrustRegion(0.1, 0.3)
    assert region.after(outcome(gain=0.04)) == region


def test_a_decent_step_is_damped_less_and_widens_nothing():
    region = TrustRegion(0.1, 0.3).after(outcome(gain=0.06))
    assert (region.radius, region.damping) == (0.1, pytest.approx(0.3 / 5))


def test_a_bad_step_is_answered_by_a_share_of_what_was_left_out():
    """At rates of 2 the prediction was off by 0.5: damping of a fifth of that over their square."""
    region = TrustRegion(0.1, 1e-6).after(outcome(linear=-0.4, gain=-0.4, squared_rates=4.0))
    assert region.radius == pytest.approx(0.04)
    assert region.damping == pytest.approx(0.2 * 0.5 / 4)


def test_damping_is_at_least_doubled():
    region = TrustRegion(0.1, 1.0).after(outcome(linear=0.02, gain=0.02, squared_rates=100.0))
    assert region.damping == 2.0


def test_a_step_that_a_correction_saved_is_not_damped_for_what_it_left_out():
    assert TrustRegion(0.1, 0.3).after(outcome(linear=-5.0, gain=0.09)).damping < 0.3


def test_a_step_shorter_than_the_radius_shrinks_it_below_its_own_size():
    assert TrustRegion(0.4).after(outcome(gain=-1.0, size=0.05)).radius == pytest.approx(0.02)


def test_it_ends_when_no_step_is_left():
    assert not TrustRegion(MIN_RADIUS).has_collapsed
    assert TrustRegion(MIN_RADIUS).smaller().has_collapsed
    assert TrustRegion(0.1, 1e15).has_collapsed


def test_in_a_small_motion_much_damping_is_of_use():
    assert not TrustRegion(0.1, 1e9, unit=1e-3).has_collapsed


def test_radii_are_in_units_of_the_motion():
    region = TrustRegion(0.1, unit=0.01)
    assert region.largest_change == pytest.approx(1e-3)
    assert region.after(outcome()).unit == region.smaller().unit == 0.01


def test_the_unit_is_that_of_the_farthest_joint_of_all_motions():
    still, small, large = np.zeros((3, 2)), np.array([[0.0, 5.0], [0.01, 5.03]]), np.eye(2)
    assert motion_unit([still, small]) == pytest.approx(0.03 / 0.3)
    assert motion_unit([small, large]) == 1.0
    assert motion_unit([still]) == 1.0


def test_the_region_of_a_standstill_is_finite():
    """Variables that do not move leave no rates to divide by."""
    region = TrustRegion(0.1).after(outcome(gain=-1.0, linear=-1.0, size=0.0, squared_rates=0.0))
    assert region.has_collapsed


def test_a_correction_that_helps_a_little_does_not_hide_what_was_left_out():
    region = TrustRegion(0.1, 1e-6).after(outcome(linear=-0.4, gain=0.02))
    assert region.damping == pytest.approx(0.2 * 0.5)


def test_damping_that_holds_steps_back_is_relaxed():
    assert not TrustRegion(0.1, 0.1).may_relax
    assert TrustRegion(0.1, 1.0).may_relax
    assert not TrustRegion(0.1, 100.0, unit=0.01).may_relax, "of a small motion that is little"
    assert TrustRegion(0.1, 1.0).relaxed() == TrustRegion(0.1, 0.01, times_relaxed=1)


def test_damping_is_relaxed_twice_only_however_often_it_is_raised():
    trust = TrustRegion(0.1, 1.0)
    for _ in range(2):
        assert trust.may_relax
        trust = replace(trust.relaxed(), damping=1e6)
    assert not trust.may_relax
