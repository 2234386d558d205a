"""Every method keeps the limits on the tool's speed, and uses them."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST, limited_tool
from tubeplanner import PlanningProblem, PlanOptions, Seed, Tube, plan
from tubeplanner.baselines.baselines import BASELINES, judged_baseline


def require_kept(problem, certificate):
    condition = certificate.conditions["tool_speed"]
    assert -1e-6 <= condition.margin < 0.2
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("given", [([None, 0.5], None), (None, 0.6), ([0.4, 0.9], 0.8)])
@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it(method, given):
    problem = limited_tool(*given, count=2)
    result = plan(problem, PlanOptions(method, slack=0.0))
    assert result.succeeded
    require_kept(problem, result.certificate)
    assert result.certificate.conditions["tool_speed"].margin < 0.01
    free = plan(limited_tool(count=2), PlanOptions(method, slack=0.0))
    assert free.duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it(method, bundled):
    problem = bundled("two_link/paper_1_30mm")
    problem = problem.with_tube(replace(problem.tube, tool_speed=0.8))
    result = plan(problem, PlanOptions(method, slack=0.0))
    assert result.succeeded
    assert result.method == method
    require_kept(problem, result.certificate)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it(name):
    problem = limited_tool([None, 0.5], 1.2, count=2)
    _, certificate = judged_baseline(problem, name)
    require_kept(problem, certificate)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [[None, 0.5, None], 0.5])
def test_a_ur5_is_slow_over_the_wall(bundled, speed):
    """At its limit in the middle for most of the time, and certified."""
    problem = bundled("ur5/over_the_wall")
    limited = problem.with_tube(replace(problem.tube, tool_speed=speed))
    result = plan(limited, SHORTEST)
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
    assert plan(problem, SHORTEST).duration < 0.8 * result.duration


@pytest.mark.slow
def test_many_points_keep_it():
    """Chains of segments, each with a limit of its own or none."""
    angles = np.linspace(-0.6, 0.9, 40)
    points = np.column_stack([0.45 * np.cos(angles), 0.45 * np.sin(angles), 0 * angles])
    speeds = [0.6 if 10 <= k < 20 else None for k in range(39)]
    tube = Tube(points, 0.02, joint_signs={"joint2": "-"}, tool_speed=speeds)
    problem = PlanningProblem(limited_tool().robot, tube, Seed(np.array([0.0, -1.0])))
    result = plan(problem, SHORTEST)
    assert result.succeeded
    require_kept(problem, result.certificate)
