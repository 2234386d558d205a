"""The planners' limit on the tool's speed: which one counts where."""

from dataclasses import replace

import numpy as np
import pytest

from cases import limited_tool
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor
from tubeplanner.constraints.tool_speed import ToolSpeed


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
