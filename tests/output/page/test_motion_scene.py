"""Scenes: tool axes and cones where they are, tools within tolerance in the cone, notes."""

import numpy as np
import pytest
from stored_trajectories import REFINEMENT

from tubeplanner import load_problem, view
from tubeplanner.orientation import rotation_matrix, rotation_vector
from tubeplanner.output.page.motion_scene import cone_axis, cone_rim
from tubeplanner.output.page.scene import Layer

INF = np.inf


@pytest.fixture(scope="module")
def tray(shown):
    return shown("ur5/level_tray", REFINEMENT).scene


def named(scene, layer, name):
    return next(item for item in scene.items if item.layer is layer and item.name == name)


@pytest.mark.parametrize(
    ("bounds", "axis"),
    [
        ((INF, 0.1, 0.2, INF), 0),
        ((0.1, 0.3, 0.2, INF), 1),
        ((INF, INF, INF, 0.2), 2),
        ((INF, 4.0, 0.1, INF), None),
    ],
)
def test_the_cone_is_about_the_axis_that_may_turn_farthest(bounds, axis):
    assert cone_axis(np.array(bounds)) == axis


def tilt_allowed(rim, axis, tip):
    """Return the angles of the rim in the direction of a tip, and of the tip."""
    ways = np.arctan2(rim[:-1, axis - 1], rim[:-1, axis - 2])
    way = np.arctan2(tip[axis - 1], tip[axis - 2])
    k = np.argmin(abs((ways - way + np.pi) % (2 * np.pi) - np.pi))
    return np.arccos(rim[k, axis]), np.arccos(tip[axis])


@pytest.mark.parametrize(
    ("bounds", "axis"),
    [((0.1, 0.2, INF, INF), 2), ((INF, 0.3, 0.1, 0.5), 0)],
)
def test_what_is_within_the_bounds_is_in_the_cone_and_some_on_its_rim(bounds, axis):
    bounds, random = np.array(bounds), np.random.default_rng(1)
    rim = cone_rim(bounds, axis)
    np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 1)
    most = np.minimum(np.minimum(bounds[:3], bounds[3]), np.pi)
    vectors = random.uniform(-most, most, (4000, 3))
    vectors = vectors[np.linalg.norm(vectors, axis=1) <= min(bounds[3], np.pi)]
    angles = [tilt_allowed(rim, axis, tip) for tip in rotation_matrix(vectors)[..., axis]]
    left = [allowed - tilt for allowed, tilt in angles]
    assert -0.015 < min(left) < 0.02  # between two points of the rim


def test_one_angle_is_a_round_cone():
    rim = cone_rim(np.array([INF, INF, INF, 0.2]), 2)
    np.testing.assert_allclose(rim[:, 2], np.cos(0.2), atol=1e-6)


def test_cones_stand_at_the_tool_as_the_reference_is_turned(tray):
    cone, shown = named(tray, Layer.ROTATION, "cone_0"), tray.trajectories[0]
    assert shown.present[cone.body].all()
    q = tray.sections[0][0].trajectory.position(shown.time)
    rotation, tool = tray.task.robot.tool_pose(q)
    for step in (0, 60, -1):
        placement = shown.placement(step, cone.body)
        assert placement[:3, 3] == pytest.approx(tool[step])
        relative = placement[:3, :3].T @ rotation[step]
        assert (abs(rotation_vector(relative)[:2]) <= 0.0525).all()


def test_axes_are_those_of_the_tool(tray):
    robot, shown = tray.task.robot, tray.trajectories[0]
    q = tray.sections[0][0].trajectory.position(shown.time[[50]])
    rotation, tool = robot.tool_pose(q)
    point = named(tray, Layer.TOOL, "point")
    placed = point.surface.moved(shown.placement(50, point.body)).vertices
    assert placed.mean(axis=0) == pytest.approx(tool[0], abs=1e-3)
    for axis, name in enumerate("xyz"):
        item = named(tray, Layer.AXES, name)
        points = item.surface.moved(shown.placement(50, item.body)).vertices - tool[0]
        along = points @ rotation[0][:, axis]
        assert along.min() == pytest.approx(0, abs=1e-9)
        across = points - np.outer(along, rotation[0][:, axis])
        assert np.linalg.norm(across, axis=1).max() < 0.1 * along.max()


def test_at_rest_cones_stand_at_the_reference_points(bundled, shown):
    scene = view(bundled("ur5/level_tray")).scene
    cones = [item for item in scene.items if item.layer is Layer.ROTATION]
    tips = [item.surface.vertices[0] for item in cones if item.name.startswith("tube_")]
    np.testing.assert_allclose(tips, scene.task.tube.points)
    assert Layer.ROTATION not in shown("two_link/around_a_post").scene.layers


def test_given_notes_come_first_and_an_empty_hand_stays_empty(stored):
    trajectory = stored("two_link/around_a_post")[1]
    part = {"name": "part", "sphere": 0.03, "touch_links": ["link2"]}
    problem = load_problem("example:two_link/around_a_post", changes={"robot.attached": [part]})
    scene = view(
        problem, trajectory, trajectory, names=["a", "b"], notes=["a: fails"], empty_handed=["b"]
    ).scene
    carried = [item.trajectory for item in scene.items if item.layer is Layer.CARRIED]
    assert carried == [0]
    assert scene.notes[0] == "a: fails"
