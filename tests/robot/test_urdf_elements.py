"""Elements of a URDF: values that are not used, prefixes that are not declared."""

import xml.etree.ElementTree as ElementTree

import pytest

from tubeplanner.robot.undeclared_prefixes import declare_prefixes
from tubeplanner.robot.unused_values import unused_values

# What joints of a URDF say in vain: standard and drake's tags, zeros and repetitions left out.

LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
LAW = "position_based_velocity_limits"
VALUES = {
    LIMIT: {},
    LIMIT + '<dynamics damping="0" friction="0.0"/>': {},
    LIMIT + '<dynamics damping="0.5" friction="2" mu_viscous="16"/>': {
        "dynamics damping": "0.5",
        "dynamics friction": "2",
    },
    '<limit xmlns:drake="http://drake.mit.edu" upper="2" drake:acceleration="15"/>': {
        "limit drake:acceleration": "15"
    },
    '<limit upper="2" jerk=" 7500 "/>': {"limit jerk": "7500"},
    LIMIT + f'<{LAW} deceleration_limit="6" velocity_offset="0.3"/>': {
        f"{LAW} deceleration_limit": "6",
        f"{LAW} velocity_offset": "0.3",
    },
    # Soft limits, one as the hard one.
    LIMIT + '<safety_controller k_position="9" soft_lower_limit="-1.0" soft_upper_limit="1"/>': {
        "safety_controller soft_upper_limit": "1"
    },
    '<safety_controller soft_lower_limit="-1" soft_upper_limit="0"/>': {
        "safety_controller soft_lower_limit": "-1"
    },
    '<dynamics damping="${d}"/>': {"dynamics damping": "${d}"},
}


@pytest.mark.parametrize("inner", VALUES)
def test_values_that_are_not_used_are_found(inner):
    assert unused_values(ElementTree.fromstring(f"<joint>{inner}</joint>")) == VALUES[inner]


# Prefixes that are used and not declared: declared on the root, and nothing else changed.

DRAKE = ' xmlns:drake="http://drake.mit.edu"'
UNCHANGED = {
    "no prefix": '<robot name="a"><link name="b"/></robot>',
    "a declared one": f'<robot{DRAKE}><limit drake:acceleration="2"/></robot>',
    "declared beside": f'<robot><limit{DRAKE} drake:acceleration="2"/></robot>',
    "XML's own": '<robot xml:lang="en"/>',
    "malformed": "<robot><drake:a></robot>",
    "empty": "",
    "an encoding that nobody has": '<?xml version="1.0" encoding="klingon"?><robot drake:a="1"/>',
    "in two bytes": '<?xml version="1.0" encoding="utf-16"?><robot drake:a="1"/>',
}


@pytest.mark.parametrize("name", UNCHANGED)
def test_what_lacks_nothing_or_is_malformed_stays(name):
    xml = UNCHANGED[name].encode("utf-16" if name == "in two bytes" else "utf-8")
    declared = declare_prefixes(xml)
    assert (declared.xml, declared.undeclared) == (xml, {})


def test_the_root_declares_what_was_missing_and_the_rest_stays():
    """A declaration serves only inside its element."""
    text = (
        '<?xml version="1.0"?><!-- <robot> -->\n<robot name="ä">'
        f'<drake:b drake:c="1"/><limit{DRAKE} drake:jerk="2"/>'
        '<limit drake:acceleration="2.5"/><x y:z="1"/><drake:b/></robot>'
    )
    declared = declare_prefixes(text.encode())
    added = f'{DRAKE} xmlns:y="undeclared:y"'
    assert declared.xml.decode() == text.replace("\n<robot", f"\n<robot{added}")
    assert declared.undeclared == {"drake": ("b", "c", "acceleration"), "y": ("z",)}
    ElementTree.fromstring(declared.xml)
