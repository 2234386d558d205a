"""Remedies: smallest single change that helps; headroom of each quantity."""

import json

import pytest
from asked_problems import REMEDY, ROOM, StubTrials, asked, simple_change

from tubeplanner.outcome import TimeLimitReached
from tubeplanner.studies.remedies import CLOSE, HeadroomSearch, RemedySearch, worsening_changes

REMEDY_KEYS = (
    *("field", "from", "to", "unit", "certified", "duration", "text", "changes"),
    *("cost", "too_little", "too_little_text", "is_smallest"),
)
ROOM_KEYS = (
    *("field", "from", "to", "unit", "duration", "text"),
    *("too_much", "too_much_text", "is_exact"),
)
EVERYWHERE = {"a": 0.4, "b": 0.03, "c": 30.0, "d": 5.0}


def test_json_has_the_keys_that_are_read_and_infinity_is_a_word():
    remedy, headroom = REMEDY.as_dict(), ROOM.as_dict()
    for fields, keys in ((remedy, REMEDY_KEYS), (headroom, ROOM_KEYS)):
        assert tuple(fields) == keys
        assert json.loads(json.dumps(fields, allow_nan=False)) == fields
    assert remedy["changes"] == {"tube.rotation_tolerance": [[0.3, 0.3, ".inf"]]}
    assert (remedy["from"], remedy["to"], remedy["certified"]) == (0.1, 0.3, True)
    assert (headroom["from"], headroom["to"]) == (["-.inf", 1.0], None)


def search_of(thresholds, groups, **stub):
    """Return a search, when it is done unless it is to be stopped, and its trials.

    A group is a text of fields, each a letter, or a list of changes.
    """
    trials = StubTrials(thresholds, **stub)
    tiers = [
        [[simple_change(each) if isinstance(each, str) else each for each in group]]
        for group in groups
    ]
    search = RemedySearch(trials, tiers)
    if "stop" not in stub:
        search.run()
    return search, trials


def test_remedies_are_narrowed_and_come_in_the_order_of_their_cost():
    search, _ = search_of(EVERYWHERE, ["ab", "c", "d"])
    assert [remedy.field for remedy in search.remedies] == ["b", "a", "c"]
    for remedy in search.remedies:
        threshold = EVERYWHERE[remedy.field]
        assert remedy.too_little < threshold <= remedy.after <= CLOSE * remedy.too_little
        assert (remedy.is_smallest, remedy.cost, remedy.duration) == (True, remedy.after, 1.5)
        assert remedy.changes == {remedy.field: remedy.after}
        assert remedy.text == f"{remedy.field} to {remedy.after:g}"


def test_another_robot_and_what_is_not_narrowed_come_last_once_a_field():
    changes = [simple_change("a", is_of_robot=True), simple_change("b")]
    search, _ = search_of({"a": 0.1, "b": 3.0}, [changes, "", ""])
    assert [remedy.field for remedy in search.remedies] == ["b", "a"]
    changes = [simple_change("c"), simple_change("c"), simple_change("a")]
    stopped = {"budget": 6, "stop": TimeLimitReached}
    search, _ = search_of({"a": 100.0, "c": 50.0}, [changes, "", ""], **stopped)
    with pytest.raises(TimeLimitReached):
        search.run()
    assert [(each.field, each.is_smallest) for each in search.remedies] == [
        *(("c", False), ("a", False)),
    ]


def test_a_move_is_tried_by_a_middle_size_too():
    search, trials = search_of({}, [[simple_change("a", is_move=True)], "", ""])
    assert trials.asked[:3] == [("a", 1.0), ("a", 10.0), ("a", 100.0)]
    assert search.ineffective == ("a",)


def test_the_least_likely_are_tried_only_if_nothing_else_helps():
    search, trials = search_of({"d": 5.0, "a": 1.0}, ["a", "c", "d"])
    assert "d" not in {field for field, _ in trials.asked}
    assert search.ineffective == ("c",)
    search, _ = search_of({"d": 5.0}, ["a", "c", "d"])
    assert [remedy.field for remedy in search.remedies] == ["d"]
    assert search.ineffective == ("a", "c")


def test_what_helps_nowhere_is_tried_by_as_much_as_makes_sense():
    search, trials = search_of({}, ["ab", "", ""])
    once = [("a", 1.0), ("b", 1.0), ("a", 100.0), ("b", 100.0)]
    assert trials.asked == 2 * once
    assert trials.thorough == once
    assert (search.remedies, search.ineffective) == ((), ("a", "b"))


def test_a_field_that_helps_in_one_direction_is_not_in_vain():
    changes = [simple_change("a"), simple_change("a", most=0.5)]
    search, _ = search_of({"a": 0.9}, [changes, "", ""])
    assert [remedy.field for remedy in search.remedies] == ["a"]
    assert search.ineffective == ()


def test_a_switch_is_tried_once_and_has_no_size():
    switches = [simple_change(field, most=1.0, is_switch=True) for field in "ab"]
    search, trials = search_of({"b": 1.0}, [switches, "", ""])
    assert (trials.asked, trials.thorough) == ([("a", 1.0), ("b", 1.0)], [])
    (remedy,) = search.remedies
    assert (remedy.text, remedy.too_little) == ("b to 1 would work", None)
    assert (remedy.is_smallest, search.ineffective) == (True, ("a",))


def test_a_size_is_not_tried_twice_and_thoroughly_only_where_a_bracket_ends():
    search, trials = search_of(EVERYWHERE, ["abc", "d", ""])
    quick = trials.count - len(trials.thorough)
    assert len(set(trials.asked)) == quick
    assert len(set(trials.thorough)) == len(trials.thorough)
    search, trials = search_of(EVERYWHERE, ["ab", "", ""])
    ends = [(remedy.field, remedy.too_little) for remedy in search.remedies]
    assert trials.thorough == ends


def test_what_helps_only_thoroughly_is_found_and_narrowed():
    search, trials = search_of(EVERYWHERE, ["ab", "c", "d"], quick={"a": 0.8, "b": 0.03})
    found = {remedy.field: remedy for remedy in search.remedies}
    for field, threshold in EVERYWHERE.items():
        if field != "d":
            assert found[field].too_little < threshold <= found[field].after
            assert found[field].after <= CLOSE * found[field].too_little
    assert ("a", found["a"].too_little) in trials.thorough


def test_all_is_tried_thoroughly_if_nothing_helps_quickly():
    never = dict.fromkeys("abcd", float("inf"))
    search, trials = search_of({"a": 5.0}, ["ab", "c", "d"], quick=never)
    (remedy,) = search.remedies
    assert remedy.field == "a"
    assert 5.0 <= remedy.after <= 1.05 * 5.0
    assert search.ineffective == ("b", "c", "d")
    assert "d" not in {field for field, _ in trials.thorough}


def test_what_was_found_is_kept_when_the_search_is_stopped():
    search, _ = search_of(EVERYWHERE, ["ab", "c", "d"], budget=4, stop=TimeLimitReached)
    with pytest.raises(TimeLimitReached):
        search.run()
    assert {remedy.field for remedy in search.remedies} == {"a", "b"}
    assert not all(remedy.is_smallest for remedy in search.remedies)
    assert all(remedy.after >= EVERYWHERE[remedy.field] for remedy in search.remedies)
    # It was not tried by as much as makes sense: nobody knows.
    assert search.ineffective == ()
    changes = [simple_change(field) for field in "abc"]
    trials = StubTrials({"a": 0.4}, budget=2, helps=False, stop=KeyboardInterrupt)
    search = HeadroomSearch(trials, changes)
    with pytest.raises(KeyboardInterrupt):
        search.run()
    assert [headroom.field for headroom in search.headrooms] == ["a", "b"]
    assert not any(headroom.is_exact for headroom in search.headrooms)


def test_room_ends_where_nothing_is_found_any_more():
    ends = {"a": 0.4, "b": 0.02}
    headrooms = rooms_of(ends, "abc")
    second, first, last = sorted(headrooms, key=lambda headroom: headroom.field)
    assert headrooms == (first, second, last)  # the least room first
    for headroom in (first, second):
        assert headroom.after < ends[headroom.field] <= headroom.too_much <= CLOSE * headroom.after
        assert headroom.is_exact
        assert headroom.text == f"{headroom.field} to {headroom.after:g}"
    assert (last.after, last.too_much, last.duration) == (100.0, None, 1.5)


def rooms_of(ends, fields):
    """Return the rooms that are found, by where they end."""
    search = HeadroomSearch(
        StubTrials(ends, helps=False), [simple_change(field) for field in fields]
    )
    search.run()
    return search.headrooms


def test_where_there_is_no_room_the_mildest_change_is_named():
    (headroom,) = rooms_of({"a": 0.0}, "a")
    assert (headroom.after, headroom.duration, headroom.is_exact) == (None, None, True)
    assert headroom.too_much <= 1e-3
    assert headroom.text == f"not even a to {headroom.too_much:g}"


def test_quantities_that_bound_the_motion_are_made_worse():
    payload = {"mass": 5.0, "com": [0.0, 0.0, 0.0], "inertia": [0.01, 0.01, 0.01, 0, 0, 0]}
    question = asked({"robot.payload": payload, "clearance": 0.01})
    worse = {each.kind: each.propose(each.scale / 2).after for each in worsening_changes(question)}
    del worse["obstacle"]
    assert worse == {"radius": 0.025, "clearance": 0.015, "payload": 7.5, "effort": 13.5}
