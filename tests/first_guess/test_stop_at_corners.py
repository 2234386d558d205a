"""Stop at corners: it rests at every reference point and runs every segment at its limits."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tubeplanner import PlanningProblem, Tube, verify
from tubeplanner.first_guess import stop_at_corners as stop_at_corners_module
from tubeplanner.first_guess.branches import redundancy_rules, reference_branch
from tubeplanner.first_guess.line_schemes import PAPER
from tubeplanner.first_guess.stop_at_corners import stop_at_corners
from tubeplanner.limits.speed_limits import minimum_duration


def branch_of(problem):
    """Return the branch by the first rule for redundant joints."""
    return reference_branch(problem, redundancy_rules(problem)[0])


@pytest.fixture(scope="module")
def stopping(bundled):
    """Return a function from a bundled problem's name to the problem and what stops at corners."""

    @cache
    def of(name):
        return bundled(name), stop_at_corners(bundled(name), branch_of(bundled(name)))

    return of


@pytest.mark.parametrize("name", ["two_link/around_a_post", "ur5/level_tray"])
def test_it_rests_at_every_reference_point_and_every_segment_runs_at_its_limits(name, stopping):
    """No segment could be run faster, and none breaks a limit: its own minimum is its duration."""
    problem, trajectory = stopping(name)
    moving = abs(trajectory.velocity(trajectory.breakpoints)).max(axis=1) > 1e-9
    stops = trajectory.breakpoints[~moving]
    tool = problem.robot.tool_position(trajectory.position(stops))
    np.testing.assert_allclose(tool, problem.tube.points, atol=1e-4)
    for begin, end in pairwise(stops):
        part = trajectory.between(begin, end)
        assert minimum_duration(problem, part) == pytest.approx(end - begin, rel=1e-5)


def test_it_beats_the_conventional_scheme_of_the_paper_with_the_same_numbers_each_time(stopping):
    problem, trajectory = stopping("two_link/around_a_post")
    lengths = np.linalg.norm(np.diff(problem.tube.points, axis=0), axis=1)
    assert trajectory.duration < sum(PAPER.duration(length) for length in lengths)
    again = stop_at_corners(problem, branch_of(problem))
    np.testing.assert_array_equal(again.coefficients, trajectory.coefficients)


def test_splines_follow_the_branch_within_the_rotation_tolerance(bundled):
    """A tenth of a milliradian, while the reference turns by a radian a leg: few knots are off."""
    tray = bundled("ur5/level_tray")
    turns = [(0, 0, 0), (0, 0.5, 0.6), (0.5, 0, 1.5), (0, 0, 2.5)]
    first = Rotation.from_matrix(tray.robot.tool_pose(tray.start[None])[0][0])
    tube = Tube(
        tray.tube.points,
        tray.tube.radius,
        joint_signs=tray.tube.joint_ranges,
        orientations=[(first * Rotation.from_rotvec(turn)).as_quat() for turn in turns],
        rotation_tolerance=1e-4,
    )
    problem = PlanningProblem(tray.robot, tube, tray.start)
    trajectory = stop_at_corners(problem, branch_of(problem))
    assert verify(problem, trajectory).passed


def test_a_fit_is_held_against_the_rotation_too(bundled):
    """Its margins are those of the tool and, where that is bounded, of the rotation."""
    tray = bundled("ur5/level_tray")
    q = tray.start + np.array([[0] * 6, [0, 0, 0, 0, 0.01, 0]])
    turned = tray.tube.rotation.margin(*tray.robot.tool_pose(q), 0)
    tool = tray.tube.margin(tray.robot.tool_position(q))[:, 0]
    expected = [tool.min(), turned[1]]
    np.testing.assert_allclose(stop_at_corners_module._least_margins(tray, q, 0), expected)
    free = bundled("ur5/over_the_wall")
    assert stop_at_corners_module._least_margins(free, free.start[None], 0).shape == (1,)


def test_all_ramps_are_fitted_at_once_and_as_one_by_one(bundled):
    """At once it takes less time, of which a time limit may leave little."""
    problem, fits = bundled("ur5/over_the_wall"), stop_at_corners_module._fits
    branch, ramps = branch_of(problem), list(stop_at_corners_module._RAMP_FRACTIONS)
    together = fits(problem, branch.segments[1], 1, ramps, 16)
    for ramp, shape in zip(ramps, together, strict=True):
        (alone,) = fits(problem, branch.segments[1], 1, [ramp], 16)
        np.testing.assert_allclose(alone.coefficients, shape.coefficients, rtol=1e-9, atol=1e-9)


def test_few_knots_are_tried_before_many_and_only_for_ramps_that_need_them(bundled, monkeypatch):
    problem, asked, fits = bundled("ur5/level_tray"), [], stop_at_corners_module._fits

    def counting(problem, q, segment, ramps, intervals):
        asked.append((segment, intervals, tuple(ramps)))
        return fits(problem, q, segment, ramps, intervals)

    monkeypatch.setattr(stop_at_corners_module, "_fits", counting)
    stop_at_corners(problem, branch_of(problem))
    before = {}
    for segment, intervals, ramps in asked:
        known = before.get(segment)
        if known is None:
            assert (intervals, ramps) == (16, stop_at_corners_module._RAMP_FRACTIONS)
        else:
            assert intervals == 2 * known[0] and set(ramps) <= set(known[1])
        before[segment] = (intervals, ramps)
