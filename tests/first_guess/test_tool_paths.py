"""Curves of the tool, the arm along them, and time parameterizations put into paths."""

import numpy as np
import pytest
from cases import quintic

from tubeplanner import JointTrajectory, Tube
from tubeplanner.first_guess import tool_paths as tool_path_module
from tubeplanner.first_guess.baselines import averaged_parameterization, run_along, times_at
from tubeplanner.first_guess.branches import RedundancyRule, ReferenceBranch, reference_branch
from tubeplanner.first_guess.tool_paths import arc_lengths_on_line, rounded_polyline, tool_paths
from tubeplanner.outcome import Infeasible
from tubeplanner.studies.comparison import smoothness_class

BENT = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0], [3, 4, 1]], dtype=float)


def branch_of(problem):
    return reference_branch(problem, RedundancyRule.AS_NEEDED)


def test_a_polyline_without_arcs_stops_at_every_point():
    curves = rounded_polyline(BENT, None)
    assert [curve.length for curve in curves] == pytest.approx([1, 1, 1, 3])
    np.testing.assert_allclose(
        curves[3].point(np.array([0, 1.5, 3.0])), [[1, 2, 0], [2, 3, 0.5], BENT[4]]
    )


def test_arcs_join_their_lines_and_touch_the_wall():
    radius = np.array([0.02, 0.05, 0.05, 0.03])
    (curve,) = rounded_polyline(BENT, radius)  # straight on at the third point: no stop, no arc
    assert (curve.curvature > 0).tolist() == [False, True, False, False, True, False]
    arc_lengths = np.linspace(0, curve.length, 20_001)
    points = curve.point(arc_lengths)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, arc_lengths[1], rtol=1e-6)  # the way is the length
    bend = np.diff(points, n=2, axis=0) / arc_lengths[1] ** 2
    assert np.linalg.norm(bend, axis=1).max() == pytest.approx(curve.curvature.max(), rel=1e-4)
    tube = Tube(BENT, radius)
    use = (tube.distance(points) / radius).min(axis=1)
    assert 0.99 < use.max() <= 1.0
    assert np.linalg.norm(points[-1] - BENT[-1]) < 1e-12


def test_of_unequal_capsules_the_wider_one_holds_more_of_the_arc():
    """With equal radii r, an arc through a right angle has the radius r / (1 - cos 45 deg)."""
    corner = BENT[:3]
    (equal,) = rounded_polyline(corner, np.array([0.02, 0.02]))
    (wider,) = rounded_polyline(corner, np.array([0.02, 0.06]))
    assert 1 / equal.curvature[1] == pytest.approx(0.02 / (1 - np.cos(np.pi / 4)), rel=2e-3)
    assert wider.curvature[1] < 0.7 * equal.curvature[1]


def test_arcs_share_short_lines_and_a_way_back_is_a_stop():
    short = np.array([[0, 0, 0], [1, 0, 0], [1, 0.1, 0], [0, 0.1, 0]])
    (curve,) = rounded_polyline(short, np.full(3, 0.5))
    assert curve.curvature.tolist() == pytest.approx([0, 20, 20, 0])  # half the short line each
    back = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]])
    assert len(rounded_polyline(back, np.full(2, 0.1))) == 2


@pytest.mark.parametrize("name", ["two_link/paper_2_30mm", "ur5/level_tray"])
def test_the_tool_is_on_its_lines(bundled, name):
    problem = bundled(name)
    branch = branch_of(problem)
    for k, path in enumerate(tool_paths(problem, branch, arcs=False)):
        lengths = np.linspace(0, path.joints.duration, 997)
        q = path.joints.position(lengths)
        tool = problem.robot.tool_position(q)
        assert problem.tube.distance(tool)[:, k].max() < 1e-5
        np.testing.assert_allclose(q[[0, -1]], branch.segments[k][[0, -1]], atol=1e-7)
        unit = np.linalg.norm(path.joints.velocity(lengths[::20]), axis=1)
        np.testing.assert_allclose(unit, 1.0, atol=0.02)


def test_the_tool_on_arcs_stays_in_the_tube_and_as_level_as_the_branch(bundled):
    problem = bundled("ur5/level_tray")
    (path,) = tool_paths(problem, branch_of(problem), arcs=True)
    rotation, tool = problem.robot.tool_pose(
        path.joints.position(np.linspace(0, path.joints.duration, 997))
    )
    inside = np.minimum(problem.tube.margin(tool), problem.tube.rotation_margin(rotation, tool))
    assert inside.max(axis=1).min() > -1e-6
    wanted = path.curve.point(np.linspace(0, path.curve.length, 20_000))
    assert np.linalg.norm(tool[::50, None] - wanted, axis=2).min(axis=1).max() < 6e-5


def test_arc_lengths_of_places_on_a_line_are_found_in_a_few_steps(bundled, monkeypatch):
    """Where a few steps do not do, the places are bracketed."""
    problem = bundled("two_link/around_a_post")
    for line in tool_paths(problem, branch_of(problem), arcs=False):
        distance = line.curve.length * np.linspace(0.01, 0.99, 30)
        accuracy = {"rtol": 0, "atol": 1e-12 * line.joints.duration}
        slowly = tool_path_module._by_bracketing(problem.robot, line, distance)
        found = tool_path_module._by_newton(problem.robot, line, distance)
        np.testing.assert_allclose(found, slowly, **accuracy)
    distance = line.curve.length * np.array([0.0, 0.1, 0.6, 1.0])
    wanted = arc_lengths_on_line(problem.robot, line, distance)
    monkeypatch.setattr(tool_path_module, "_NEWTON_STEPS", 1)
    found = arc_lengths_on_line(problem.robot, line, distance)
    np.testing.assert_allclose(found, wanted, **accuracy)


def test_without_a_path_there_is_a_reason(bundled):
    problem = bundled("two_link/paper_1_10mm")
    branch = branch_of(problem)
    still = ReferenceBranch((np.tile(branch.start, (2, 1)),))
    with pytest.raises(Infeasible, match="the start is the goal: there is nothing to move"):
        tool_paths(problem, still, arcs=False)
    turned = np.vstack([branch.start, branch.start + np.array([2 * np.pi, 0.0])])
    with pytest.raises(Infeasible, match="segment 0: joints have to move where the tool stands"):
        tool_paths(problem, ReferenceBranch((turned,)), arcs=False)


def test_a_law_put_into_a_path_is_exact():
    path = JointTrajectory(
        ["a"], [0, 0.4, 1.0], [[[1.0], [-2.0]], [[0.5], [0.7]], [[0.1], [0.5]], [[0], [0.184]]]
    )
    timing = JointTrajectory(
        ["arc_length"], [0, 1.0, 2.0], [[[0.25], [-0.3]], [[0.1], [1.0]], [[0.0], [0.35]]]
    )
    length = timing.position(2.0)[0]
    timing = JointTrajectory(["arc_length"], timing.breakpoints, timing.coefficients / length)
    trajectory = run_along(path, timing)
    times = np.linspace(0, 2, 401)
    np.testing.assert_allclose(
        trajectory.position(times),
        path.position(timing.position(times)[:, 0]),
        atol=1e-12,
    )
    assert trajectory.duration == 2.0
    assert len(trajectory.coefficients) == 7
    arc_lengths = np.array([0.0, 0.3, 0.4, 1.0])
    np.testing.assert_allclose(
        timing.position(times_at(timing, arc_lengths))[:, 0],
        arc_lengths,
        atol=1e-12,
    )


@pytest.mark.parametrize("intervals", [3, 50])
def test_an_averaged_law_is_smooth_and_never_falls(intervals):
    timing = JointTrajectory(
        ["arc_length"], [0, 0.5, 1.0], [[[2.0], [-2.0]], [[0.0], [2.0]], [[0.0], [0.5]]]
    )
    smooth = averaged_parameterization(timing, intervals)
    assert smoothness_class(timing) == "C1"
    assert smoothness_class(smooth) == smoothness_class(quintic()) == "C2"
    assert smooth.position([0.0, smooth.duration]).ravel().tolist() == pytest.approx([0, 1])
    assert smooth.velocity(np.linspace(0, smooth.duration, 500)).min() > -1e-12
    assert abs(smooth.acceleration(np.linspace(0, smooth.duration, 500))).max() <= 4.0 + 1e-9
