"""The planners' limits on the speed of points of the arm: which one counts, and how."""

import numpy as np
import pytest

from cases import anywhere, one_joint, quintic
from tubeplanner import LimitOverrides, PointSpeed, load_robot
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.point_speed import PointSpeedLimit
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor

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
