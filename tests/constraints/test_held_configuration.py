"""What motors must hold: a bar against weight and friction, both ways and one way."""

import numpy as np
import pytest

from cases import anywhere, one_joint, with_motors
from tubeplanner import PlanningProblem, Tube, plan
from tubeplanner.constraints.held_configuration import require_held
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.robot.effort_range import EffortRange

HELD = 4.905  # weight of 1 kg at half a metre, the bar level [N m]; the limit is 5
LEVEL = np.zeros(1)


@pytest.fixture
def bar(tmp_path):
    def made(mass=1.0, ranges=(), **motors):
        return with_motors(one_joint(tmp_path, mass=mass), ranges, **motors)

    return made


def dry(effort):
    return {"forwards_friction": effort, "backwards_friction": effort}


def pair(backwards, forwards):
    return [EffortRange(0, np.zeros(1), np.array([backwards]), np.array([forwards]))]


@pytest.mark.parametrize(
    ("mass", "ranges", "motors"),
    [
        (1.0, (), {}),
        (1.0, (), dry(2.0)),  # upwards it is blocked, downwards not
        (2.0, (), dry(5.0)),  # friction holds what the motor could not
        (1.0, pair(5.0, 4.0), dry(1.0)),
        (1.0, pair(0.1, 5.0), {"backwards_friction": 9.0}),  # downwards it is
        (0.0, (), dry(4.9)),
        (1.0, (), {"saturation_effort": 5.0, "no_load_velocity": 1.0}),
    ],
)
def test_one_way_is_enough(bar, mass, ranges, motors):
    require_held(anywhere(bar(mass, ranges, **motors)), LEVEL)


@pytest.mark.parametrize(
    ("mass", "ranges", "motors", "needed", "limit"),
    [
        (2.0, (), {}, 2 * HELD, 5.0),
        (2.0, (), dry(1.0), 2 * HELD - 1, 5.0),
        (1.0, (), dry(12.0), 12 - HELD, 5.0),
        (1.0, pair(2.0, 4.0), {}, HELD, 4.0),
        (1.0, pair(2.0, 4.0), dry(7.0), 7.0 - HELD, 2.0),
        (1.0, (), {"saturation_effort": 4.5, "no_load_velocity": 1.0}, HELD, 4.5),
        # Less of both: what is lost is the same, and friction may hold less.
        (2.0, (), dry(4.7) | {"friction_uncertainty": 0.5}, 2 * HELD - 4.7 * 0.5, 5.0),
    ],
)
def test_blocked_both_ways_is_refused_with_joint_and_place(
    bar, mass, ranges, motors, needed, limit
):
    with pytest.raises(Infeasible) as caught:
        require_held(anywhere(bar(mass, ranges, **motors)), LEVEL)
    assert caught.value.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert caught.value.place.joint == "turn"
    assert np.shape(caught.value.place.position) == (3,)
    assert f"needs {needed:.2f} N m against gravity" in str(caught.value)
    assert f"its effort limit is {limit:.2f};" in str(caught.value)


def test_the_table_counts_where_the_joint_is(bar):
    table = EffortRange(0, np.array([0.0, 1.0]), np.array([9.0, 1.0]), np.array([9.0, 1.0]))
    problem = anywhere(bar(1.0, [table]))
    require_held(problem, LEVEL)
    with pytest.raises(Infeasible, match=r"needs 2\.65 N m .* limit is 1\.00;"):
        require_held(problem, np.ones(1))


def test_the_joint_that_lacks_most_is_named(ur5):
    q = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    friction = np.array([0.0, 0.0, 400.0, 200.0, 0.0, 0.0])
    forwards = friction + np.array([900.0, 0, 0, 0, 0, 0])  # the first can go backwards
    arm = with_motors(ur5, forwards_friction=forwards, backwards_friction=friction)
    with pytest.raises(Infeasible, match="elbow_joint") as caught:
        require_held(anywhere(arm), q)
    held = abs(ur5.gravity_effort(q[None])[0, 2])
    assert f"needs {400 - held:.2f} N m against gravity and friction" in str(caught.value)


def test_planning_refuses_it(bar):
    robot, tube = bar(2.0), Tube([[0.0, 0, 0], [1.0, 0, 0]], 1000.0)
    problem = PlanningProblem(robot, tube, LEVEL, np.array([0.5]), self_collision=False)
    assert plan(problem).status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
