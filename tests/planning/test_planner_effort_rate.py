"""Every method keeps the limits on how fast efforts change, and uses them."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import LimitOverrides, PlanningProblem, PlanOptions, Seed, Tube, load_robot, plan
from tubeplanner.baselines.baselines import BASELINES, judged_baseline

SMOOTH = ("smoothed-bang-bang", "smoothed-arc-corners")
NAMES = ("joint1", "joint2")


def bent(gravity=(0, 0, 0), **rates):
    """A two-link arm with limited effort rates [N m/s] in a tube around a corner."""
    limits = LimitOverrides(velocity=dict.fromkeys(NAMES, np.inf), effort_rate=rates)
    robot = load_robot("example:two_link", "hand", gravity=gravity, limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


def require_used(certificate):
    condition = certificate.conditions["effort_rate"]
    assert -1e-6 <= condition.margin < 0.01
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("rates", [{"joint1": 300.0, "joint2": 200.0}, {"joint2": 60.0}])
@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, -1.6, 0)])
def test_plans_keep_them_and_use_them(rates, gravity):
    result = plan(bent(gravity, **rates), SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    require_used(result.certificate)
    assert plan(bent(gravity), SHORTEST).duration < 0.95 * result.duration
    dear = [one for one in result.sensitivities if one.limit == "effort_rate"]
    assert {one.joint for one in dear} == set(rates)
    assert min(one.elasticity for one in dear) < -0.05


def test_with_a_limit_on_every_joint_no_note_speaks_of_growing_jerk():
    both, one = plan(bent(joint1=300.0, joint2=200.0), SHORTEST), plan(bent(joint1=300.0), SHORTEST)
    assert not any("jerk" in note for note in both.notes)
    assert any("jerk" in note and "'joint2'" in note for note in one.notes)


@pytest.mark.parametrize("method", ["branch-and-bound", "stop-at-corners"])
def test_other_methods_keep_them(method):
    result = plan(bent(joint1=300.0), PlanOptions(method, slack=0.0))
    assert (result.succeeded, result.method) == (True, method)
    require_used(result.certificate)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_them_where_their_acceleration_is_continuous(name):
    """The others fail of what cannot be smooth in them, and of nothing else."""
    _, certificate = judged_baseline(bent(joint1=300.0), name)
    if name in SMOOTH:
        assert certificate.passed
        require_used(certificate)
    else:
        assert {"rest", "continuity"} <= set(certificate.failures())
        assert set(certificate.failures()) <= {"rest", "continuity", "effort_rate"}


@pytest.mark.slow
def test_a_panda_keeps_what_its_controller_is_asked_for(bundled):
    problem = bundled("panda/between_shelves")
    rates = dict.fromkeys(problem.robot.joint_names, 1000.0)
    robot = load_robot(
        "example:panda", problem.robot.tool_frame, limits=LimitOverrides(effort_rate=rates)
    )
    limited = PlanningProblem(
        robot,
        problem.tube,
        problem.start,
        problem.goal,
        obstacles=problem.obstacles,
        clearance=problem.clearance,
    )
    result = plan(limited, SHORTEST)
    assert result.succeeded
    require_used(result.certificate)
    assert result.duration < 1.15 * plan(problem, SHORTEST).duration
