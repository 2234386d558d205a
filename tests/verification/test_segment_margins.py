"""Margins of each segment at any t; best switching samples between segments."""

import itertools

import numpy as np
import pytest
from cases import SHORTEST

from tubeplanner import load_problem, plan
from tubeplanner.verification.enclosed_pose import enclosed_pose, enclosed_tool
from tubeplanner.verification.segment_margins import segment_margins
from tubeplanner.verification.switching_samples import best_switching_samples


def worst_margin(margin, switching_samples):
    """Return the worst margin of an ordered visit: a switching time counts in both its segments."""
    bounds = [0, *switching_samples, len(margin) - 1]
    return min(margin[a : b + 1, k].min() for k, (a, b) in enumerate(itertools.pairwise(bounds)))


@pytest.mark.parametrize("seed", range(20))
def test_no_other_choice_leaves_more(seed):
    rng = np.random.default_rng(seed)
    samples, segments = rng.integers(4, 12), rng.integers(1, 5)
    margin = np.round(rng.normal(size=(samples, segments)), 1)
    choices = itertools.combinations_with_replacement(range(samples), segments - 1)
    best = max(worst_margin(margin, choice) for choice in choices)
    found = best_switching_samples(margin)
    assert (np.diff(found) >= 0).all()
    assert worst_margin(margin, found) == best


def test_switching_times_may_share_an_instant():
    margin = np.array([[1.0, -1, -1], [1, 1, 1], [-1, -1, 1]])
    assert best_switching_samples(margin).tolist() == [1, 1]


def test_of_equal_choices_the_one_deepest_in_both_segments_is_taken():
    margin = np.array([[0.1, 0.1], [0.5, 0.2], [0.5, 0.5], [0.2, 0.5], [0.1, 0.1]])
    assert best_switching_samples(margin).tolist() == [2]


def test_the_segment_before_counts_as_much_as_the_one_after():
    margin = np.array([[0.1, 0.1], [0.2, 0.5], [0.5, 0.5], [0.5, 0.2], [0.1, 0.1]])
    assert best_switching_samples(margin).tolist() == [2]


def chain(margin):
    """Return the largest worst margin of an ordered visit: sample after sample, segment by segment.

    Whoever is in segment k was there at the sample before, or in segment k-1 at this one.
    """
    best = np.minimum.accumulate(margin[:, 0])
    for inside in margin.T[1:]:
        arrived, last = best.copy(), -np.inf
        for i, here in enumerate(inside):
            last = best[i] = min(here, max(last, arrived[i]))
    return best[-1]


@pytest.mark.parametrize("seed", range(20))
def test_no_other_choice_leaves_more_among_many_samples(seed):
    rng = np.random.default_rng(seed)
    drift = np.linspace(-3, 3, 60)[:, None] - np.array([-2.0, 0.0, 2.0])
    margin = rng.normal(size=(60, 3)) - 0.3 * drift**2
    found = best_switching_samples(margin)
    assert worst_margin(margin, found) == chain(margin)


def passing_margin(margin, passing, switching_samples):
    """Return the worst margin of a visit that passes points in one of the segments beside them."""
    ends = [0, *switching_samples, len(margin) - 1]
    passed = [inside[ends[k - 1] : ends[k + 1] + 1].max() for k, inside in passing.items()]
    return min([worst_margin(margin, switching_samples), *passed])


@pytest.mark.parametrize("seed", range(30))
def test_no_other_choice_passes_points_better(seed):
    rng = np.random.default_rng(seed)
    samples, segments = rng.integers(4, 10), rng.integers(2, 5)
    margin = np.round(rng.normal(size=(samples, segments)), 1)
    points = rng.permutation(np.arange(1, segments))[: rng.integers(1, segments)]
    passing = {int(k): np.round(rng.normal(size=samples), 1) for k in sorted(points)}
    choices = itertools.combinations_with_replacement(range(samples), segments - 1)
    best = max(passing_margin(margin, passing, choice) for choice in choices)
    found = best_switching_samples(margin, passing)
    assert (np.diff(found) >= 0).all()
    assert passing_margin(margin, passing, found) == best


def test_a_point_may_be_passed_before_or_after_the_switching_time():
    margin = np.ones((5, 2))
    for at in (0, 4):
        inside = np.where(np.arange(5) == at, 0.5, -1.0)
        found = best_switching_samples(margin, {1: inside})
        assert passing_margin(margin, {1: inside}, found) == 0.5


# What segments ask at any instant: at all of them, at one each, and nothing left out.


@pytest.fixture(scope="module")
def tray(stored):
    """A problem with joint signs and rotation tolerances, a trajectory, and its margins."""
    problem, trajectory = stored("ur5/level_tray")
    pose = enclosed_pose(problem.robot, trajectory, 1e-8, 1e-9)
    return problem, trajectory, segment_margins(problem, trajectory, pose.tool, pose.rotation, ())


@pytest.fixture(scope="module")
def times(tray):
    return np.random.default_rng(0).uniform(0, tray[1].duration, 200)


def test_they_are_those_of_tube_joints_and_rotation(tray, times):
    problem, trajectory, margins = tray
    q = trajectory.position(times)
    rotation, tool = problem.robot.tool_pose(q)
    lower, upper = problem.tube.ranges_of(problem.robot.joint_names)
    in_range = np.minimum(q[:, None] - lower, upper - q[:, None]).min(axis=2)
    expected = (
        problem.tube.margin(tool),
        in_range,
        problem.tube.rotation_margin(rotation, tool),
    )
    assert len(margins) == len(expected)
    for margin, wanted in zip(margins, expected, strict=True):
        np.testing.assert_allclose(margin.at(times), wanted, atol=1e-6)


def test_within_one_segment_each_they_are_the_same(tray, times):
    problem, _, margins = tray
    segment = np.random.default_rng(1).integers(0, problem.tube.segment_count, len(times))
    for margin in margins:
        every = margin.at(times)[np.arange(len(times)), segment]
        np.testing.assert_allclose(margin.within(segment, times), every, atol=1e-12)


def test_a_further_condition_is_asked_where_it_applies():
    problem = load_problem("example:two_link/around_a_post")
    trajectory = plan(problem, SHORTEST).trajectory
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    further = (lambda *_: None, lambda *known: known)
    *_, last = segment_margins(problem, trajectory, tool, None, further)
    assert last == (problem, trajectory)
    assert len(segment_margins(problem, trajectory, tool, None, further)) == 3
