"""Remedies and rooms as JSON, which other tools read."""

import json

import pytest

from asked_problems import REMEDY, ROOM


@pytest.mark.parametrize(
    ("found", "keys"),
    [
        (
            REMEDY,
            [
                *("field", "from", "to", "unit", "certified", "duration", "text", "changes"),
                *("cost", "too_little", "too_little_text", "is_smallest"),
            ],
        ),
        (
            ROOM,
            [
                *("field", "from", "to", "unit", "duration", "text"),
                *("too_much", "too_much_text", "is_exact"),
            ],
        ),
    ],
)
def test_json_has_the_keys_that_are_read_and_no_infinity(found, keys):
    fields = found.as_dict()
    assert list(fields) == keys
    assert json.loads(json.dumps(fields, allow_nan=False)) == fields


def test_infinity_is_a_word():
    assert REMEDY.as_dict()["changes"] == {"tube.rotation_tolerance": [[0.3, 0.3, ".inf"]]}
    assert REMEDY.as_dict()["certified"] is True
    assert (REMEDY.as_dict()["from"], REMEDY.as_dict()["to"]) == (0.1, 0.3)
    assert ROOM.as_dict()["from"] == ["-.inf", 1.0]
    assert ROOM.as_dict()["to"] is None
