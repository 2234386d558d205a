"""Substitute tubes: narrower about a smoother path, wider for coarse knots."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import PlanningProblem, PlanOptions, Seed, Tube, plan
from tubeplanner.optimizer import stages as refinement
from tubeplanner.optimizer.phased_spline import KnotGrid
from tubeplanner.optimizer.tube_phases import sharpest_bend, smoother_problem, widened_radius

SEED = Seed([-0.2, -1.3, 1.9, -2.0, -1.6, 0])
RADIUS = 0.005


def line(count):
    s = np.linspace(0, 1, count + 1)
    return np.column_stack([0.35 + 0.25 * s, 0.04 * np.sin(2 * np.pi * s), 0.3 + 0 * s])


def scan(count, deviation=0.001):
    """Return a curved line with noise, by which it often runs backwards."""
    noise = deviation * np.random.default_rng(0).normal(size=(count + 1, 3))
    noise[[0, -1]] = 0
    return line(count) + noise


def problem(robot, points, radius=RADIUS, **more):
    return PlanningProblem(robot, Tube(points, radius, **more), SEED)


@pytest.fixture(scope="module")
def scanned(ur5):
    radius = RADIUS * (1 + 0.2 * (np.arange(200) % 3))
    signs = [{"elbow_joint": "+"} if k < 90 else {"elbow_joint": [0.1, 3]} for k in range(200)]
    upright = np.tile([0.0, 1.0, 0.0, 0.0], (201, 1))
    turns = {"orientations": upright, "rotation_tolerance": 0.4}
    return problem(ur5, scan(200), radius, tool_radius=0.001, joint_signs=signs, **turns)


def test_a_scan_is_smoothed(scanned):
    tube, inner = scanned.tube, smoother_problem(scanned).tube
    assert sharpest_bend(tube) > 2.0
    assert sharpest_bend(inner) < 1.0
    np.testing.assert_array_equal(inner.points[[0, -1]], tube.points[[0, -1]])
    for name in ("joint_ranges", "tool_radius", "rotation_tolerance"):
        assert getattr(inner, name) == getattr(tube, name)
    np.testing.assert_array_equal(inner.orientations, tube.orientations)
    np.testing.assert_array_equal(inner.numbers, tube.numbers)


def test_every_segment_lies_within_the_one_that_it_stands_for(scanned):
    """So that the ways in which a tool may visit the new segments are ways through the old."""
    tube, inner = scanned.tube, smoother_problem(scanned).tube
    generator = np.random.default_rng(1)
    for k in range(tube.segment_count):
        fraction = generator.uniform(size=(50, 1))
        direction = generator.normal(size=(50, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        axis = (1 - fraction) * inner.points[k] + fraction * inner.points[k + 1]
        on_wall = axis + inner.effective_radius[k] * direction
        assert tube.margin(on_wall, slice(k, k + 1)).min() > -1e-9


def test_a_point_at_which_the_path_turns_back_stays_where_it_is(ur5):
    there = scan(100)
    there = there[np.argsort(there[:, 0])]
    points = np.vstack([there, there[-2::-1] + np.array([0, 0, 0.002])])
    inner = smoother_problem(problem(ur5, points)).tube
    np.testing.assert_array_equal(inner.points[100], points[100])
    assert 100 in inner.compulsory_points


def test_a_given_start_is_where_the_smoother_path_begins(ur5):
    start, points = np.array(SEED.joints), scan(200)
    tool = ur5.tool_position(start[None])
    points += tool[0] - points[0] + [0.001, 0, 0]
    task = replace(problem(ur5, points), start=start)
    inner = smoother_problem(task)
    np.testing.assert_allclose(inner.tube.points[0], tool[0], atol=1e-12)
    assert inner.tube.margin(tool, slice(0, 1))[0, 0] > 0
    far = replace(task, tube=task.tube.with_radius(0.00105))
    assert smoother_problem(far) is None


def test_sharp_corners_are_not_smoothed(ur5):
    legs = np.arange(41)
    zigzag = np.column_stack([0.35 + 0.005 * legs, 0.03 * (legs % 2), 0.3 + 0 * legs])
    assert smoother_problem(problem(ur5, zigzag, 0.002)) is None


def grid(*intervals):
    return KnotGrid(tuple(np.linspace(0, 1, count + 1) for count in intervals))


STRAIGHT = [[0, 0, 0], [0.6, 0, 0]]
RIGHT_ANGLE = [*STRAIGHT, [0.6, 0.2, 0]]


@pytest.mark.parametrize(
    ("points", "radius", "intervals", "expected"),
    [
        (STRAIGHT, 0.001, [3], 0.2 * 0.6 / 3),  # a fifth of a knot interval
        (RIGHT_ANGLE, 0.001, [2, 1], 0.1 * 0.2),  # a tenth of the shorter leg
        # A straight continuation is no corner; the first segment is widened by its knots.
        ([[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0.6, 0.3, 0]], 0.001, [2, 2, 2], 0.03),
        (RIGHT_ANGLE, [0.15, 0.1], [2, 2], [0.15, 0.1]),  # never made smaller
    ],
)
def test_segments_are_widened_by_their_knots_and_corners(points, radius, intervals, expected):
    tube = Tube(points, radius)
    expected = np.broadcast_to(expected, tube.segment_count)
    np.testing.assert_allclose(widened_radius(tube, grid(*intervals)), expected)


def test_a_hairpin_is_hardly_widened():
    """Its legs are 2.9 degrees apart: a circle at both has a radius of a fortieth of a leg."""
    tube = Tube([[0, 0, 0], [0.4, 0, 0], [0, 0.02, 0]], 0.0005)
    assert (widened_radius(tube, grid(3, 3)) < 0.0012).all()


def test_without_widening_there_is_an_answer_too(bundled, monkeypatch):
    """Links count as inside on the coarsest knots: widened starts are given up on them."""
    widened, original = [], refinement.widened_radius

    def recorded(tube, grid):
        widened.append(grid.interval_count)
        return original(tube, grid)

    def is_hopeless(found):
        return found.spline.grid.interval_count == widened[0]

    monkeypatch.setattr(refinement, "_is_hopeless", is_hopeless)
    monkeypatch.setattr(refinement, "widened_radius", recorded)
    result = plan(bundled("two_link/paper_5_10mm"), PlanOptions(quality="fast", slack=0.0))
    assert result.succeeded and len(widened) > 0
    assert result.method == "refinement"


def test_a_box_is_widened_on_all_sides():
    tube = Tube(STRAIGHT, None, cross_section={"box": [0.02, 0.004], "up": [0, 0, 1]})
    widened = widened_radius(tube, grid(3))
    assert widened == pytest.approx(0.2 * 0.6 / 3)
    np.testing.assert_allclose(tube.regions_of(widened).half, [[0.2, 0.04, 0.04]])
