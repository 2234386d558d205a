"""Every method keeps velocity limits that fall towards the ends, also near and in the zones."""

from dataclasses import replace

import numpy as np
import pytest

from cases import one_joint
from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.baselines.baselines import BASELINES, judged_baseline

UPPER, DECELERATION = 2.0, 4.0
# Those of a Franka FR3, joint by joint.
FR3 = zip([6, 2.585, 3.5, 4, 17, 5.5, 17], [0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35], strict=True)
NEAR = {
    "joint1": {"deceleration": 4.0, "offset": 0.3, "lower": -0.5, "upper": 2.0},
    "joint2": {"deceleration": 5.0, "offset": 0.2, "lower": -2.0, "upper": 0.5},
}


def two_link(laws=NEAR):
    free = {"joint1": np.inf, "joint2": np.inf}
    limits = LimitOverrides(velocity=free, velocity_by_position=laws)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


@pytest.fixture
def bar(tmp_path):
    """Return a function from start, goal and offset to the problem of a bar that turns."""

    def moved(start, goal, offset):
        law = {"deceleration": DECELERATION, "offset": offset, "lower": -UPPER, "upper": UPPER}
        robot = one_joint(tmp_path, velocity_by_position=law)
        tool = robot.tool_position(np.zeros((1, 1)))[0]
        tube = Tube([tool, tool + np.array([1.0, 0.0, 0.0])], 1000.0)
        return PlanningProblem(
            robot, tube, np.array([start]), np.array([goal]), self_collision=False
        )

    return moved


def require_kept(certificate, most=0.01):
    condition = certificate.conditions["velocity"]
    assert -1e-6 <= condition.margin < most
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it(method):
    result = plan(two_link(), PlanOptions(method))
    assert result.succeeded
    require_kept(result.certificate)
    assert plan(two_link({}), PlanOptions(method)).duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it(method, bundled):
    free = bundled("two_link/paper_1_30mm")
    q = plan(free).trajectory.position(np.linspace(0, 0.8, 200))
    laws = {
        name: {"deceleration": 4.0, "offset": 0.3, "lower": low - 0.5, "upper": high + 0.5}
        for name, low, high in zip(
            free.robot.joint_names, q.min(axis=0).tolist(), q.max(axis=0).tolist(), strict=True
        )
    }
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(velocity_by_position=laws))
    result = plan(replace(free, robot=robot), PlanOptions(method))
    assert result.succeeded
    assert result.method == method
    require_kept(result.certificate, most=0.2)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it(name):
    _, certificate = judged_baseline(two_link(), name)
    require_kept(certificate, most=0.2)


@pytest.mark.parametrize("below", [0.1, 1e-3, 1e-6])
def test_a_goal_next_to_the_zone_is_come_to(bar, below):
    """It takes some 75 ms for each factor e of the distance: the velocity falls in proportion."""
    zone = 0.3**2 / (2 * DECELERATION)
    result = plan(bar(0.0, UPPER - zone - below, 0.3))
    assert result.succeeded
    require_kept(result.certificate)
    assert result.duration < 1.1 + 0.3 / DECELERATION * np.log(1.0 / below) + 0.2


def test_without_an_offset_the_end_itself_is_come_to(bar):
    """Sped up at 5 N m / 0.7 kg m^2, slowed down at the law's deceleration: a closed form."""
    result = plan(bar(0.0, UPPER, 0.0))
    assert result.succeeded
    require_kept(result.certificate)
    speeding_up = 5 / 0.7
    fastest = np.sqrt(2 * UPPER / (1 / speeding_up + 1 / DECELERATION))
    least = fastest / speeding_up + fastest / DECELERATION
    assert least < result.duration < 1.02 * least


@pytest.mark.parametrize(("start", "goal"), [(UPPER, 0.0), (UPPER, UPPER - 0.005), (-UPPER, 0.0)])
def test_it_leaves_a_zone_as_if_there_were_none(bar, start, goal):
    """From rest, where no velocity is allowed towards the end."""
    result = plan(bar(start, goal, 0.3))
    assert result.succeeded
    require_kept(result.certificate, most=1.0)
    elasticities = [p.elasticity for p in result.sensitivities if p.limit == "velocity_by_position"]
    assert elasticities == pytest.approx([0.0], abs=1e-6)


@pytest.mark.parametrize(("start", "goal"), [(0.0, UPPER - 0.005), (UPPER - 0.005, UPPER)])
def test_a_goal_in_a_zone_is_refused(bar, start, goal):
    result = plan(bar(start, goal, 0.3))
    assert result.status is PlanStatus.NO_TRAJECTORY
    assert result.place.joint == "turn"
    assert "limits.velocity_by_position allows it no velocity that way" in result.message


@pytest.mark.slow
@pytest.mark.parametrize("joint", range(7))
def test_a_motion_goes_round_a_zone_that_the_fastest_would_enter(bundled, joint):
    """Four tenths of what the free motion exceeds its ends by are left to it."""
    free = bundled("panda/between_shelves")
    motion = plan(free).trajectory
    q = motion.position(np.linspace(0, motion.duration, 2001))[:, joint]
    sign = 1.0 if q.max() - max(q[0], q[-1]) > min(q[0], q[-1]) - q.min() else -1.0
    top = max(sign * q[0], sign * q[-1])
    beyond = (sign * q).max() - top
    assert beyond > 0.02
    upper = top + 0.4 * beyond + 0.3**2 / (2 * DECELERATION)
    ends = sorted([sign * upper, -sign * 9.0])
    law = {"deceleration": DECELERATION, "offset": 0.3, "lower": ends[0], "upper": ends[1]}
    limits = LimitOverrides(velocity_by_position={free.robot.joint_names[joint]: law})
    robot = load_robot("example:panda", "panda_hand_tcp", limits=limits)
    goal = motion.position(np.array([motion.duration]))[0]
    result = plan(replace(free, robot=robot, goal=goal))
    assert result.succeeded
    assert result.method == "refinement"
    require_kept(result.certificate)
    assert result.duration < 1.7 * motion.duration


@pytest.mark.slow
def test_a_panda_keeps_the_law_of_an_fr3(bundled):
    """Which its fastest motion breaks by a tenth of the velocity; it costs next to nothing."""
    free = bundled("panda/between_shelves")
    names = free.robot.joint_names
    laws = {name: {"deceleration": d, "offset": o} for name, (d, o) in zip(names, FR3, strict=True)}
    limits = LimitOverrides(velocity_by_position=laws)
    robot = load_robot("example:panda", "panda_hand_tcp", limits=limits)
    result = plan(replace(free, robot=robot))
    assert result.succeeded
    require_kept(result.certificate)
    assert result.duration == pytest.approx(plan(free).duration, rel=0.01)
