"""The planners' limit on the tool's speed: which limit counts where, and what methods make of it."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import LimitOverrides, PlanningProblem, PlanOptions, Seed, Tube, load_robot, plan
from tubeplanner.baselines.baselines import BASELINES, judged_baseline
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor
from tubeplanner.constraints.tool_speed import ToolSpeed

POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0], [0.1, 0.4, 0]]
FREE = {"joint1": np.inf, "joint2": np.inf}


def problem_of(tube_speed=None, robot_speed=None, count=3):
    """Return a problem of the two-link arm in a bent tube."""
    limits = LimitOverrides(velocity=FREE, tool_speed=robot_speed)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    signs = {"joint2": "-"}
    tube = Tube(POINTS[: count + 1], 0.05, joint_signs=signs, tool_speed=tube_speed)
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


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
    limit = ToolSpeed(problem_of(tube_speed, robot_speed))
    assert limit.limit.tolist() == expected
    limited = np.flatnonzero(np.isfinite(expected)).tolist()
    assert [(key.kind, key.joint, key.segment) for key in limit.keys] == [
        ("tool_speed", None, k) for k in limited
    ]


def test_a_sample_has_the_key_of_its_segment():
    problem = problem_of([0.6, None, 0.8])
    at = PathSamples(problem, np.zeros((3, 4, 2)), lambda: np.array([0, 2, 2, 0]))
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


def require_kept(problem, certificate):
    condition = certificate.conditions["tool_speed"]
    assert -1e-6 <= condition.margin < 0.2
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("given", [([None, 0.5], None), (None, 0.6), ([0.4, 0.9], 0.8)])
@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it(method, given):
    problem = problem_of(*given, count=2)
    result = plan(problem, PlanOptions(method))
    assert result.succeeded
    require_kept(problem, result.certificate)
    assert result.certificate.conditions["tool_speed"].margin < 0.01
    free = plan(problem_of(count=2), PlanOptions(method))
    assert free.duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it(method):
    """Of the tool's own: which segment a continuation is in, they do not know while they search."""
    problem = problem_of([None, 0.5], 1.2, count=2)
    result = plan(problem, PlanOptions(method))
    assert result.succeeded
    assert result.method == method
    require_kept(problem, result.certificate)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it(name):
    problem = problem_of([None, 0.5], 1.2, count=2)
    _, certificate = judged_baseline(problem, name)
    require_kept(problem, certificate)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [[None, 0.5, None], 0.5])
def test_a_ur5_is_slow_over_the_wall(bundled, speed):
    """At its limit in the middle for most of the time, and certified."""
    problem = bundled("ur5/over_the_wall")
    limited = problem.with_tube(replace(problem.tube, tool_speed=speed))
    result = plan(limited)
    assert result.succeeded
    require_kept(limited, result.certificate)
    trajectory = result.trajectory
    at = trajectory.at(np.linspace(0, trajectory.duration, 2001))
    fast = np.linalg.norm(problem.robot.tool_velocity(at.position, at.velocity)[0], axis=1)
    assert (abs(fast - 0.5) < 0.005).mean() > 0.4
    assert (fast.max() > 0.6) == isinstance(speed, list)
    prices = {p.segment: p.elasticity for p in result.sensitivities if p.limit == "tool_speed"}
    assert min(prices, key=prices.get) == 1
    assert prices[1] < -0.4
    assert plan(problem).duration < 0.8 * result.duration


@pytest.mark.slow
def test_many_points_keep_it():
    """Chains of segments, each with a limit of its own or none."""
    angles = np.linspace(-0.6, 0.9, 40)
    points = np.column_stack([0.45 * np.cos(angles), 0.45 * np.sin(angles), 0 * angles])
    speeds = [0.6 if 10 <= k < 20 else None for k in range(39)]
    tube = Tube(points, 0.02, joint_signs={"joint2": "-"}, tool_speed=speeds)
    problem = PlanningProblem(problem_of().robot, tube, Seed(np.array([0.0, -1.0])))
    result = plan(problem)
    assert result.succeeded
    require_kept(problem, result.certificate)
