"""Hashes of cycles: what changes them, and what is said to differ."""

import pytest

from small_cycle import small_cycle
from tubeplanner.files.cycle_fingerprint import (
    cycle_hash,
    cycle_part_hashes,
    differing_cycle_parts,
)


@pytest.fixture(scope="module")
def stated():
    return cycle_part_hashes(small_cycle())


@pytest.mark.parametrize(
    ("changes", "differing"),
    [
        ({"moves__back__tube__radius": 0.2}, ["tube of move 'back'"]),
        ({"moves__beside__tube__radius": 0.06}, ["tube of move 'down, beside'"]),
        ({"moves__2__payload__mass": 0.6}, ["payload of move 'down, beside'"]),
        ({"robot__limits__acceleration": 500.0}, ["limits or motors"]),
        ({"moves__1__dwell": 0.04}, ["order of steps or dwells"]),
        ({"moves__5__event": "hand"}, ["order of steps or dwells"]),
        ({"moves__6__leave_as_obstacle": True}, None),
        ({"closed": False}, ["order of steps or dwells"]),
        ({"obstacles__part__box": [0.02, 0.02, 0.03]}, None),
        ({"start__seed": [0.0, -0.9]}, ["start or goal of move 'over'"]),
    ],
)
def test_what_changes_the_answer_changes_the_hash_and_is_named(changes, differing, stated):
    changed = small_cycle(**changes)
    assert cycle_hash(changed) != cycle_hash(small_cycle())
    found = differing_cycle_parts(changed, stated)
    assert found
    assert differing is None or found == differing


def test_the_same_cycle_has_the_same_hash(stated):
    assert cycle_hash(small_cycle()) == cycle_hash(small_cycle())
    assert differing_cycle_parts(small_cycle(), stated) == []
    assert differing_cycle_parts(small_cycle(), {}) == []


def test_what_an_event_sets_is_no_part_of_the_question():
    assert cycle_hash(small_cycle(moves__1__set="shut")) == cycle_hash(small_cycle())
