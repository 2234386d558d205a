"""Prefixes that are used and not declared: declared on the root, and nothing else changed."""

import xml.etree.ElementTree as ElementTree

import pytest

from tubeplanner.robot.undeclared_prefixes import declare_prefixes

DRAKE = ' xmlns:drake="http://drake.mit.edu"'
UNCHANGED = {
    "no prefix": '<robot name="a"><link name="b"/></robot>',
    "a declared one": f'<robot{DRAKE}><limit drake:acceleration="2"/></robot>',
    "declared beside": f'<robot><limit{DRAKE} drake:acceleration="2"/></robot>',
    "XML's own": '<robot xml:lang="en"/>',
    "malformed": "<robot><drake:a></robot>",
    "empty": "",
    "an encoding that nobody has": '<?xml version="1.0" encoding="klingon"?><robot drake:a="1"/>',
}


@pytest.mark.parametrize("name", UNCHANGED)
def test_what_lacks_nothing_or_is_malformed_stays(name):
    xml = UNCHANGED[name].encode()
    assert declare_prefixes(xml).xml == xml
    assert declare_prefixes(xml).undeclared == {}


def test_the_root_declares_what_was_missing_and_the_rest_stays():
    text = (
        '<?xml version="1.0"?><!-- <robot> -->\n<robot name="ä">'
        '<drake:b drake:c="1"/><limit drake:acceleration="2.5"/><x y:z="1"/><drake:b/></robot>'
    )
    declared = declare_prefixes(text.encode())
    added = f'{DRAKE} xmlns:y="undeclared:y"'
    assert declared.xml.decode() == text.replace("\n<robot", f"\n<robot{added}")
    assert declared.undeclared == {"drake": ("b", "c", "acceleration"), "y": ("z",)}
    ElementTree.fromstring(declared.xml)


def test_a_declaration_serves_only_inside_its_element():
    text = f'<robot><limit{DRAKE} drake:jerk="2"/><limit drake:acceleration="2"/></robot>'
    declared = declare_prefixes(text.encode())
    assert declared.undeclared == {"drake": ("acceleration",)}
    ElementTree.fromstring(declared.xml)


def test_a_file_in_another_alphabet_of_bytes_stays():
    xml = '<?xml version="1.0" encoding="utf-16"?><robot drake:a="1"/>'.encode("utf-16")
    assert declare_prefixes(xml).xml == xml
