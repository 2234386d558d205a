"""Margins of each segment at any t; best switching samples between segments."""

import itertools

import numpy as np
import pytest

from tubeplanner.certificate.enclosed_quantities import enclosed_pose, enclosed_tool
from tubeplanner.certificate.segment_margins import best_switching_samples, segment_margins
from tubeplanner.certificate.tube_visits import _worst_passing, ordered_switching_samples

# Of all choices of switching samples none leaves more.


def worst_margin(margin, switching_samples, passing=None):
    """Return the worst margin of an ordered visit that passes points in a segment beside them.

    A switching time counts in both its segments.
    """
    ends = [0, *switching_samples, len(margin) - 1]
    inside = [margin[a : b + 1, k].min() for k, (a, b) in enumerate(itertools.pairwise(ends))]
    passed = [row[ends[k - 1] : ends[k + 1] + 1].max() for k, row in (passing or {}).items()]
    return min(inside + passed)


@pytest.mark.parametrize("seed", range(30))
def test_no_other_choice_leaves_more(seed):
    """Without compulsory points for even seeds, with some for odd ones."""
    rng = np.random.default_rng(seed)
    samples, segments = rng.integers(4, 12), rng.integers(1 + seed % 2, 5)
    margin = np.round(rng.normal(size=(samples, segments)), 1)
    points = (
        rng.permutation(np.arange(1, segments))[: rng.integers(1, segments)] if seed % 2 else []
    )
    passing = {int(k): np.round(rng.normal(size=samples), 1) for k in sorted(points)}
    choices = itertools.combinations_with_replacement(range(samples), segments - 1)
    best = max(worst_margin(margin, choice, passing) for choice in choices)
    found = best_switching_samples(margin, passing)
    assert (np.diff(found) >= 0).all()
    assert worst_margin(margin, found, passing) == best


@pytest.mark.parametrize(
    ("margin", "expected"),
    [
        ([[0.1, 0.1], [0.5, 0.2], [0.5, 0.5], [0.2, 0.5], [0.1, 0.1]], [2]),
        ([[0.1, 0.1], [0.2, 0.5], [0.5, 0.5], [0.5, 0.2], [0.1, 0.1]], [2]),
    ],
)
def test_of_equal_choices_the_deepest_is_taken(margin, expected):
    assert best_switching_samples(np.array(margin)).tolist() == expected


@pytest.mark.parametrize("at", range(5))
def test_a_point_counts_as_passed_in_both_segments_beside_it(at):
    inside = {2: np.where(np.arange(5) == at, 0.5, -1.0)}
    assert _worst_passing(np.array([1, 2, 3]), inside) == (0.5 if 1 <= at <= 3 else -1.0)


def test_other_switching_times_pass_a_point_only_if_they_keep_the_rest():
    inside = {1: np.array([-5.0, -5.0, -5.0, 0.5])}
    strict = np.array([[1.0, 1, -1], [-1, 1, 1], [-1, -1, 1], [-1, -1, 1]])
    assert ordered_switching_samples(strict, inside).tolist() == [0, 1]
    wide = np.array([[1.0, 1, -1], [-1, 1, 1], [-1, 0.1, 1], [-1, 0.1, 1]])
    assert ordered_switching_samples(wide, inside).tolist() == [0, 3]
    assert ordered_switching_samples(wide, {}).tolist() == [0, 1]


# What segments ask at any instant: at all of them, at one each, and nothing left out.


def test_they_are_those_of_tube_joints_and_rotation(stored):
    problem, trajectory = stored("ur5/level_tray")
    pose = enclosed_pose(problem.robot, problem.tube, trajectory, 1e-8, 1e-9)
    margins = segment_margins(problem, trajectory, pose.tool, pose.rotation, ())
    times = np.random.default_rng(0).uniform(0, trajectory.duration, 200)
    q = trajectory.position(times)
    rotation, tool = problem.robot.tool_pose(q)
    lower, upper = problem.tube.ranges_of(problem.robot.joint_names)
    expected = (
        problem.tube.margin(tool),
        np.minimum(q[:, None] - lower, upper - q[:, None]).min(axis=2),
        problem.tube.rotation_margin(rotation, tool),
    )
    segment = np.random.default_rng(1).integers(0, problem.tube.segment_count, len(times))
    for margin, wanted in zip(margins, expected, strict=True):
        found = margin.at(times)
        np.testing.assert_allclose(found, wanted, atol=1e-6)
        every = found[np.arange(len(times)), segment]
        np.testing.assert_allclose(margin.within(segment, times), every, atol=1e-12)


def test_a_further_condition_is_asked_where_it_applies(stored):
    problem, trajectory = stored("two_link/around_a_post")
    tool = enclosed_tool(problem.robot, problem.tube, trajectory, 1e-7)
    further = (lambda *_: None, lambda *known: known)
    margins = segment_margins(problem, trajectory, tool, None, further)
    assert len(margins) == 3
    assert margins[-1] == (problem, trajectory)
