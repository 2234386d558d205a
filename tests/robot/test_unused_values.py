"""What joints of a URDF say in vain: standard and drake's tags, zeros and repetitions left out."""

import xml.etree.ElementTree as ElementTree

import pytest

from tubeplanner.robot.unused_values import unused_values

LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
VALUES = {
    "nothing": (LIMIT, {}),
    "zeros": (LIMIT + '<dynamics damping="0" friction="0.0"/>', {}),
    "friction": (
        LIMIT + '<dynamics damping="0.5" friction="2" mu_viscous="16"/>',
        {"dynamics damping": "0.5", "dynamics friction": "2"},
    ),
    "drake's acceleration": (
        '<limit xmlns:drake="http://drake.mit.edu" upper="2" drake:acceleration="15"/>',
        {"limit drake:acceleration": "15"},
    ),
    "a plain jerk": ('<limit upper="2" jerk=" 7500 "/>', {"limit jerk": "7500"}),
    "Franka's velocities": (
        LIMIT + '<position_based_velocity_limits deceleration_limit="6" velocity_offset="0.3"/>',
        {
            "position_based_velocity_limits deceleration_limit": "6",
            "position_based_velocity_limits velocity_offset": "0.3",
        },
    ),
    "soft limits, one as the hard one": (
        LIMIT + '<safety_controller k_position="9" soft_lower_limit="-1.0" soft_upper_limit="1"/>',
        {"safety_controller soft_upper_limit": "1"},
    ),
    "soft limits alone": (
        '<safety_controller soft_lower_limit="-1" soft_upper_limit="0"/>',
        {"safety_controller soft_lower_limit": "-1"},
    ),
    "no number": ('<dynamics damping="${d}"/>', {"dynamics damping": "${d}"}),
}


@pytest.mark.parametrize("name", VALUES)
def test_values(name):
    inner, expected = VALUES[name]
    assert unused_values(ElementTree.fromstring(f"<joint>{inner}</joint>")) == expected
