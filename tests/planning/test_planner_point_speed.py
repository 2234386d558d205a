"""Every method keeps the limits on the speeds of points, and uses them."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    PointSpeed,
    Seed,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.baselines.baselines import BASELINES, judged_baseline

POINTS = [PointSpeed("hand", (0.0, 0.1, 0.0), 0.6), PointSpeed("link2", (0.0, 0.0, 0.0), 0.5)]


def problem(points=POINTS):
    """The two-link arm in a bent tube."""
    free = {"joint1": np.inf, "joint2": np.inf}
    limits = LimitOverrides(velocity=free, point_speed=points)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


def require_kept(certificate, most=0.01):
    condition = certificate.conditions["point_speed"]
    assert -1e-6 <= condition.margin < most
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it(method):
    result = plan(problem(), PlanOptions(method))
    assert result.succeeded
    require_kept(result.certificate)
    assert plan(problem([]), PlanOptions(method)).duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it(method, bundled):
    free = bundled("two_link/paper_1_30mm")
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(point_speed=POINTS))
    result = plan(replace(free, robot=robot), PlanOptions(method))
    assert result.succeeded
    assert result.method == method
    require_kept(result.certificate, most=0.2)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it(name):
    _, certificate = judged_baseline(problem(), name)
    require_kept(certificate, most=0.2)


@pytest.mark.slow
def test_the_elbow_of_a_ur5_keeps_its_limit(bundled):
    """Over the wall, the elbow reaches 1.37 m/s if it may."""
    free = bundled("ur5/over_the_wall")
    elbow = [PointSpeed("forearm_link", (0.0, 0.0, 0.0), 0.8)]
    limits = LimitOverrides(point_speed=elbow)
    limited = replace(free, robot=load_robot("example:ur5", "tool0", limits=limits))
    result = plan(limited)
    assert result.succeeded
    require_kept(result.certificate)
    assert plan(free).duration < result.duration < 1.5 * plan(free).duration
    (price,) = (one for one in result.sensitivities if one.limit == "point_speed")
    assert price.elasticity < -0.05
