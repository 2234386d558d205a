"""The search for room, with trials whose answer is known."""

import pytest

from asked_problems import StubTrials, asked, simple_change
from tubeplanner.explanation.room_search import RoomSearch, worsening_changes
from tubeplanner.explanation.size_bracket import CLOSE
from tubeplanner.progress import TimeLimitReached

PAYLOAD = {"mass": 5.0, "com": [0.0, 0.0, 0.0], "inertia": [0.01, 0.01, 0.01, 0, 0, 0]}


def test_room_ends_where_nothing_is_found_any_more():
    ends = {"a": 0.4, "b": 0.02}
    changes = [simple_change(field) for field in "abc"]
    search = RoomSearch(StubTrials(ends, helps=False), changes)
    search.run()
    second, first, last = sorted(search.rooms, key=lambda room: room.field)
    assert search.rooms == (first, second, last)  # the least room first
    for room in (first, second):
        assert room.after < ends[room.field] <= room.too_much <= CLOSE * room.after
        assert room.is_exact
        assert room.text == f"{room.field} to {room.after:g}"
    assert (last.after, last.too_much, last.duration) == (100.0, None, 1.5)


def test_where_there_is_no_room_the_mildest_change_is_named():
    search = RoomSearch(StubTrials({"a": 0.0}, helps=False), [simple_change("a")])
    search.run()
    (room,) = search.rooms
    assert (room.after, room.duration, room.is_exact) == (None, None, True)
    assert room.too_much <= 1e-3
    assert room.text == f"not even a to {room.too_much:g}"


@pytest.mark.parametrize("stop", [TimeLimitReached, KeyboardInterrupt])
def test_what_was_found_is_kept_when_the_search_is_stopped(stop):
    changes = [simple_change(field) for field in "abc"]
    search = RoomSearch(StubTrials({"a": 0.4}, budget=2, helps=False, stop=stop), changes)
    with pytest.raises(stop):
        search.run()
    assert [room.field for room in search.rooms] == ["a", "b"]
    assert not any(room.is_exact for room in search.rooms)


def test_quantities_that_bound_the_motion_are_made_worse():
    question = asked({"robot.payload": PAYLOAD, "clearance": 0.01})
    worse = {each.kind: each.propose(each.scale / 2).after for each in worsening_changes(question)}
    assert worse["radius"] == 0.025
    assert worse["clearance"] == 0.015
    assert worse["payload"] == 7.5
    assert worse["effort"] == 13.5
    assert set(worse) == {"radius", "clearance", "payload", "effort", "obstacle"}
