"""Speed limits of the tool per segment, and of link points."""

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, limited_tool, one_joint, quintic

from tubeplanner import LimitOverrides, PointSpeed, load_robot
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.point_speed import PointSpeedLimit
from tubeplanner.constraints.speed_of_points import speed_by_path
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor
from tubeplanner.constraints.tool_speed import ToolSpeed

# How multiples of a point's speed change with an arm's path.


def test_where_the_point_rests_there_is_none(ur5):
    found = speed_by_path(ur5.tool_velocity(*np.zeros((2, 3, 6))), np.ones(3))
    assert all((each == 0).all() for each in found)


# The planners' limit on the tool's speed: which one counts where.


@pytest.mark.parametrize(
    ("tube_speed", "robot_speed", "expected"),
    [
        (None, None, [np.inf] * 3),
        (None, 0.7, [0.7] * 3),
        (0.6, None, [0.6] * 3),
        ([0.6, None, 0.8], 0.7, [0.6, 0.7, 0.7]),
        ([0.6, None, 0.8], None, [0.6, np.inf, 0.8]),
    ],
)
def test_of_the_robots_limit_and_the_tubes_the_smaller_one_counts(
    tube_speed, robot_speed, expected
):
    limit = ToolSpeed(limited_tool(tube_speed, robot_speed))
    assert limit.limit.tolist() == expected
    limited = np.flatnonzero(np.isfinite(expected)).tolist()
    assert [(key.kind, key.joint, key.segment) for key in limit.keys] == [
        ("tool_speed", None, k) for k in limited
    ]


def test_a_sample_has_the_key_of_its_segment():
    problem = limited_tool([None, 0.6, 0.8])
    at = PathSamples(problem, np.zeros((3, 4, 2)), lambda: np.array([1, 2, 2, 1]))
    assert ToolSpeed(problem).key_of(at).tolist() == [[0], [1], [1], [0]]


def test_a_shape_is_run_at_the_limit_of_each_segment(stored):
    problem, trajectory = stored("two_link/around_a_post")
    problem = problem.with_tube(replace(problem.tube, tool_speed=[None, 0.3, 0.4]))
    at = trajectory.at(np.linspace(0, trajectory.duration, 50)[1:-1])
    known = at.position, at.velocity, at.acceleration
    velocity = problem.robot.tool_velocity(at.position, at.velocity)[0]
    speed = np.linalg.norm(velocity, axis=1)
    free = scaling_factor(problem, *known, segment=np.zeros(48, dtype=int))
    for segment, limit in ((1, 0.3), (2, 0.4)):
        factor = scaling_factor(problem, *known, segment=np.full(48, segment))
        np.testing.assert_allclose(factor, np.minimum(free, limit / speed), rtol=1e-9)
    pieces = np.full(len(trajectory.widths), 2)
    scaled = scaled_to_limits(problem, trajectory, segments=pieces)
    at = scaled.at(np.linspace(0, scaled.duration, 20_001))
    velocity = problem.robot.tool_velocity(at.position, at.velocity)[0]
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(0.4, rel=1e-5)


# The planners' limits on the speed of points of the arm: which one counts, and how.


# A point that turns on a lever of half a metre, and one of 1.3 m.
POINTS = [PointSpeed("bar", (0.3, 0.4, 0.7), 0.5), PointSpeed("bar", (1.2, -0.5, 0.0), 2.6)]
LEVERS = np.array([0.5, 1.3])


@pytest.fixture
def bar(tmp_path):
    """Return a function from points to a bar that turns about z, in no tube."""
    one_joint(tmp_path)

    def limited(points):
        limits = LimitOverrides(point_speed=points)
        return anywhere(load_robot(tmp_path / "bar.urdf", "bar", limits=limits))

    return limited


def test_each_point_is_a_share_of_its_own_limit(bar):
    problem = bar(POINTS)
    limit = PointSpeedLimit(problem.robot.limits.point_speed)
    rates = np.array([[0.6], [-1.1], [0.0]])
    at = PathSamples(problem, np.stack([0 * rates, rates, 0 * rates]))
    shares = abs(rates) * LEVERS / [0.5, 2.6]
    np.testing.assert_allclose(limit.used(at).at(2.0), 2 * shares, atol=1e-12)
    assert [(key.kind, key.link, key.point) for key in limit.keys] == [
        ("point_speed", "bar", 0),
        ("point_speed", "bar", 1),
    ]
    assert limit.key_of(at).tolist() == [[0, 1]]
    by_rate = limit.by_path(at, 2.0)[1]
    expected = 2.0 * np.sign(rates) * LEVERS / [0.5, 2.6]
    np.testing.assert_allclose(by_rate[..., 0], expected, atol=1e-12)


@pytest.mark.parametrize(("points", "most"), [(POINTS, 1.0), (POINTS[1:], 2.0), ([], np.inf)])
def test_the_slowest_limit_counts(bar, points, most):
    """The first allows 1 rad/s, the second 2 rad/s, as far as other limits do."""
    free, problem = bar([]), bar(points)
    shape = quintic(2.0, 1.0)
    at = shape.at(np.linspace(0, 1, 101)[1:-1])
    known = at.position, at.velocity, at.acceleration
    allowed = np.minimum(scaling_factor(free, *known), most / abs(at.velocity[:, 0]))
    np.testing.assert_allclose(scaling_factor(problem, *known), allowed, rtol=1e-9)
    scaled = scaled_to_limits(problem, shape)
    fastest = abs(scaled.at(np.linspace(0, scaled.duration, 10_001)).velocity).max()
    if np.isfinite(most):
        assert fastest == pytest.approx(most, rel=1e-6)
