"""Motors that a problem gives: what is refused at once, and in which words."""

import numpy as np
import pytest

from tubeplanner import MotorOverrides, RobotError
from tubeplanner.robot.motor_overrides import MOTOR_QUANTITIES

INF = np.inf
WANTED = "give a number from 0 to 1e+09"
LINE = "give a number from 1e-06 to 1e+09, or .inf where there is no torque-speed line"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"armature": -0.1}, f"robot.motors.armature is -0.1; {WANTED}"),
        ({"armature": [1, INF]}, f"robot.motors.armature[1] is inf; {WANTED}"),
        ({"armature": {"j": np.nan}}, f"robot.motors.armature: joint 'j' at nan; {WANTED}"),
        ({"armature": [[1, 2]]}, f"robot.motors.armature[0] is [1, 2]; {WANTED}"),
        (
            {"viscous_friction": {"j": 2e9}},
            f"robot.motors.viscous_friction: joint 'j' at 2e+09; {WANTED}",
        ),
        ({"viscous_friction": [True]}, f"robot.motors.viscous_friction[0] is True; {WANTED}"),
        ({"saturation_effort": 0}, f"robot.motors.saturation_effort is 0; {LINE}"),
        (
            {"no_load_velocity": {"j": -1}},
            f"robot.motors.no_load_velocity: joint 'j' at -1; {LINE}",
        ),
        (
            {"friction_from_urdf": 1},
            "robot.motors.friction_from_urdf is 1; it must be true or false",
        ),
        (
            {"armature": "a"},
            "robot.motors.armature is 'a'; it must be one number for all joints, a list with one "
            "for each, or a map by name, such as {'elbow_joint': 1.5}",
        ),
    ],
)
def test_a_senseless_motor_is_refused_at_once(given, message):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(**given)
    assert str(caught.value) == message


@pytest.mark.parametrize("value", [-1, [1, -1], [1], [1, 2, 3], [1, INF], [1, True], "12", None])
def test_a_coulomb_friction_is_an_amount_or_two(value):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(coulomb_friction={"j": value})
    shown = repr(value)
    assert str(caught.value) == (
        f"robot.motors.coulomb_friction: joint 'j' at {shown}; {WANTED}, or [backwards, forwards] "
        "of such"
    )


@pytest.mark.parametrize("share", [-0.1, 1, 1.0, np.nan, True, "a"])
def test_an_uncertainty_is_a_share_below_one(share):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(friction_uncertainty=share)
    assert str(caught.value).endswith("; give a share from 0, below 1")
    assert str(caught.value).startswith("robot.motors.friction_uncertainty is ")


def test_bounds_themselves_are_allowed():
    MotorOverrides(
        armature=0,
        viscous_friction=1e9,
        coulomb_friction=[[0, 1e9], (0, 0), np.zeros(2)],
        saturation_effort=[1e-6, INF],
        no_load_velocity={"j": 1e9},
        friction_from_urdf=False,
        friction_uncertainty=0,
    )


@pytest.mark.parametrize("quantity", MOTOR_QUANTITIES)
def test_numbers_lists_and_maps_go_by_name(quantity):
    def by_name(given):
        return dict(MotorOverrides(**{quantity: given}).by_name(quantity, ["j", "k"], "here"))

    assert by_name(2) == {"j": 2, "k": 2}
    assert by_name([2, 3]) == {"j": 2, "k": 3}
    assert by_name({"other": 2}) == {"other": 2}
    with pytest.raises(RobotError, match=r"^here has 1 values for 2 joints; give one for all jo"):
        by_name([2])
