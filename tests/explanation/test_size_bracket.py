"""The bracket about where a change begins to matter."""

from dataclasses import replace

import pytest

from asked_problems import StubTrials, simple_change
from tubeplanner.explanation.change import Proposal
from tubeplanner.explanation.size_bracket import CLOSE, SizeBracket, try_sizes
from tubeplanner.explanation.trials import Trial


def trial(size, succeeded):
    return Trial(size, Proposal({}, size, ""), 1.5 if succeeded else None)


def bracket(smaller=None, larger=None, helps=True, **change):
    """Return a bracket that knows some sizes."""
    found = SizeBracket(simple_change(**change), helps)
    if smaller is not None:
        found.keep(trial(smaller, not helps))
    if larger is not None:
        found.keep(trial(larger, helps))
    return found


@pytest.mark.parametrize("helps", [True, False])
def test_sizes_lie_on_the_side_that_they_were_seen_on(helps):
    known = bracket(0.2, 0.8, helps)
    assert (known.smaller.size, known.larger.size) == (0.2, 0.8)
    assert known.possible.size == (0.8 if helps else 0.2)
    assert known.impossible.size == (0.2 if helps else 0.8)
    assert known.possible.succeeded and not known.impossible.succeeded


@pytest.mark.parametrize(
    ("known", "size"),
    [
        (bracket(scale=0.3), 0.1),
        (bracket(scale=0.3, most=0.05), 0.05),
        (bracket(larger=0.3), 0.0949),
        (bracket(smaller=0.3), 3.0),
        (bracket(smaller=0.3, most=2.0), 2.0),
        (bracket(0.2, 0.8), 0.4),
        (bracket(0.1, 0.2), 0.141),
    ],
)
def test_the_next_size_is_between_or_beyond_what_is_known(known, size):
    assert known.next_size == size


@pytest.mark.parametrize(
    ("known", "is_close", "is_done"),
    [
        (bracket(), False, False),
        (bracket(1.0, CLOSE), True, True),
        (bracket(1.0, CLOSE + 0.001), False, False),
        (bracket(smaller=99.0), False, False),
        (bracket(smaller=100.0), False, True),
        (bracket(smaller=1.23, most=1.2345), False, True),
        (bracket(larger=0.0011), False, False),
        (bracket(larger=0.001), False, True),
        (bracket(is_switch=True), False, False),
        (bracket(smaller=1.0, is_switch=True), False, True),
        (bracket(larger=1.0, is_switch=True), False, True),
    ],
)
def test_a_bracket_is_done_when_close_or_nothing_is_left_to_try(known, is_close, is_done):
    assert (known.is_close, bool(known.is_done)) == (is_close, is_done)


@pytest.mark.parametrize(
    ("smaller", "larger", "is_close"),
    [(53.8, 55.8, False), (55.5, 55.8, False), (55.7, 55.8, True), (59.9, 60.0, True)],
)
def test_of_a_loss_what_is_left_is_close_too(smaller, larger, is_close):
    assert bracket(smaller, larger, scale=60.0, most=60.0, is_loss=True).is_close == is_close
    assert bracket(smaller, larger, scale=60.0, most=60.0).is_close


def test_the_search_ends_where_figures_do():
    assert bracket(10.2, 10.3, scale=12.0, most=12.0, is_loss=True).is_close


@pytest.mark.parametrize("helps", [True, False])
def test_what_was_tried_in_vain_quickly_is_tried_once_more(helps):
    known = bracket(1.0, CLOSE, helps)
    vain = known.impossible
    known.keep(replace(vain, is_thorough=False))
    assert known.open_size(is_thorough=False) is None
    assert known.open_size(is_thorough=True) == vain.size
    known.keep(vain)
    assert known.open_size(is_thorough=True) is None


@pytest.mark.parametrize(("helps", "size"), [(True, 0.316), (False, 10.5)])
def test_what_is_found_after_all_opens_the_bracket_again(helps, size):
    known = bracket(1.0, CLOSE, helps)
    known.keep(trial(known.impossible.size, succeeded=True))
    assert known.impossible is None
    assert known.open_size(is_thorough=False) == size


def test_a_smaller_size_in_vain_says_no_more_than_a_larger_one():
    known = bracket(smaller=2.0)
    known.keep(trial(1.0, succeeded=False))
    assert known.smaller.size == 2.0


def test_the_cost_is_the_larger_size_over_the_scale():
    assert bracket(0.2, 0.8, scale=4.0).cost == 0.2
    assert bracket(0.2).cost == float("inf")


@pytest.mark.parametrize("threshold", [0.0123, 0.9, 37.0])
def test_trying_next_sizes_ends_at_the_threshold(threshold):
    for helps in (True, False):
        trials = StubTrials({"tube.radius": threshold}, helps=helps)
        known = SizeBracket(simple_change(), helps)
        while not known.is_done:
            try_sizes(trials, [(known, known.next_size)], True)
        assert known.smaller.size < threshold <= known.larger.size <= CLOSE * known.smaller.size
        assert trials.count < 15


def test_each_bracket_keeps_its_own_answer_in_whatever_order_they_come():
    class Backwards(StubTrials):
        def of(self, asked, is_thorough):
            yield from reversed(list(super().of(asked, is_thorough)))

    first, second = (SizeBracket(simple_change(field), helps=True) for field in ("a", "b"))
    try_sizes(Backwards({"a": 1.0, "b": 5.0}), [(first, 2.0), (second, 3.0)], True)
    assert (first.larger.size, first.smaller) == (2.0, None)
    assert (second.smaller.size, second.larger) == (3.0, None)
