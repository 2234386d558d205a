"""The search for remedies, with trials whose answer is known."""

import pytest

from asked_problems import StubTrials, simple_change
from tubeplanner.explanation.remedy_search import RemedySearch
from tubeplanner.explanation.size_bracket import CLOSE
from tubeplanner.progress import TimeLimitReached

EVERYWHERE = {"a": 0.4, "b": 0.03, "c": 30.0, "d": 5.0}


def search_of(thresholds, groups, **stub):
    """Return a search and its trials; a group is a text of fields, each a letter."""
    trials = StubTrials(thresholds, **stub)
    changes = [[simple_change(field) for field in each] for each in groups]
    return RemedySearch(trials, changes), trials


def test_remedies_are_narrowed_and_come_in_the_order_of_their_cost():
    search, _ = search_of(EVERYWHERE, ["ab", "c", "d"])
    search.run()
    assert [remedy.field for remedy in search.remedies] == ["b", "a", "c"]
    for remedy in search.remedies:
        threshold = EVERYWHERE[remedy.field]
        assert remedy.too_little < threshold <= remedy.after <= CLOSE * remedy.too_little
        assert remedy.is_smallest
        assert remedy.cost == remedy.after
        assert remedy.duration == 1.5
        assert remedy.changes == {remedy.field: remedy.after}
        assert remedy.text == f"{remedy.field} to {remedy.after:g}"


def test_the_least_likely_are_tried_only_if_nothing_else_helps():
    search, trials = search_of({"d": 5.0, "a": 1.0}, ["a", "c", "d"])
    search.run()
    assert "d" not in {field for field, _ in trials.asked}
    assert search.in_vain == ("c",)
    search, _ = search_of({"d": 5.0}, ["a", "c", "d"])
    search.run()
    assert [remedy.field for remedy in search.remedies] == ["d"]
    assert search.in_vain == ("a", "c")


def test_what_helps_nowhere_is_tried_by_as_much_as_makes_sense():
    search, trials = search_of({}, ["ab", "", ""])
    search.run()
    assert trials.asked == [("a", 1.0), ("b", 1.0), ("a", 100.0), ("b", 100.0)]
    assert (search.remedies, search.in_vain) == ((), ("a", "b"))


def test_a_field_that_helps_in_one_direction_is_not_in_vain():
    changes = [simple_change("a"), simple_change("a", most=0.5)]
    trials = StubTrials({"a": 0.9})
    search = RemedySearch(trials, [changes, [], []])
    search.run()
    assert [remedy.field for remedy in search.remedies] == ["a"]
    assert search.in_vain == ()


def test_a_switch_is_tried_once_and_has_no_size():
    switches = [simple_change(field, most=1.0, is_switch=True) for field in "ab"]
    trials = StubTrials({"b": 1.0})
    search = RemedySearch(trials, [switches, [], []])
    search.run()
    assert trials.asked == [("a", 1.0), ("b", 1.0)]
    (remedy,) = search.remedies
    assert (remedy.text, remedy.too_little) == ("b to 1 would work", None)
    assert remedy.is_smallest
    assert search.in_vain == ("a",)


def test_a_size_is_not_tried_twice():
    search, trials = search_of(EVERYWHERE, ["abc", "d", ""])
    search.run()
    assert len(set(trials.asked)) == trials.count


@pytest.mark.parametrize("stop", [TimeLimitReached, KeyboardInterrupt])
def test_what_was_found_is_kept_when_the_search_is_stopped(stop):
    search, _ = search_of(EVERYWHERE, ["ab", "c", "d"], budget=4, stop=stop)
    with pytest.raises(stop):
        search.run()
    assert {remedy.field for remedy in search.remedies} == {"a", "b"}
    assert not all(remedy.is_smallest for remedy in search.remedies)
    assert all(remedy.after >= EVERYWHERE[remedy.field] for remedy in search.remedies)
    # It was not tried by as much as makes sense: nobody knows.
    assert search.in_vain == ()
