"""Trials of changes within a time budget; bracket of the decisive size."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pytest
from asked_problems import StubTrials, asked, simple_change

from tubeplanner import PlanOptions, plan
from tubeplanner.outcome import PlanningClock, TimeLimitReached
from tubeplanner.studies import remedies as module
from tubeplanner.studies import rows
from tubeplanner.studies.changes import Proposal
from tubeplanner.studies.remedies import (
    CLOSE,
    SizeBracket,
    Trial,
    Trials,
    planned_duration,
    try_sizes,
)

QUICK = PlanOptions(quality="fast", slack=0.0)
LINE = {"tube.points": [[0.3, -0.5, 0], [0.3, 0.5, 0]], "obstacles": []}
NO_LIMIT = float("inf")
LOSS = {"scale": 60.0, "most": 60.0, "is_loss": True}


def line(radius=0.03, **changes):
    return asked({**LINE, "tube.radius": radius, **changes})


def trials_of(question, limit=1000.0, executor=None, callback=None, **options):
    clock = PlanningClock(limit, callback)
    return Trials(question, PlanOptions(**options), clock, executor)


def with_effort(fraction):
    """Return the change of the effort of all joints to a fraction, as a size."""
    return simple_change("robot.limits.scale.effort"), fraction


@pytest.fixture
def checked_options(monkeypatch):
    """The options of every trial, which all succeed at once."""
    given = []

    def answered(problem, options, progress):
        given.append(options)
        return SimpleNamespace(duration=1.0, succeeded=True, stopped_by=None, message="")

    monkeypatch.setattr(rows, "plan_task", answered)
    return given


@pytest.mark.parametrize("workers", [0, 2])
def test_each_change_is_planned_with(workers):
    question, told = line(), []
    executor = ThreadPoolExecutor(workers) if workers else None
    trials = trials_of(question, executor=executor, callback=told.append)
    sizes = [0.5, 0.03]
    wide = [(simple_change(), size) for size in sizes]
    blocked = (simple_change("tube.points.1", propose=_far), 1.0)
    refused = (simple_change("start", propose=_unknown), 1.0)
    found = dict(trials.of([*wide, blocked, refused], True))
    assert (sorted(found), trials.count) == ([0, 1, 2, 3], 4)
    for location, size in enumerate(sizes):
        direct = plan(question.load({"tube.radius": size}), QUICK)
        assert (found[location].size, found[location].succeeded) == (size, True)
        assert found[location].duration == pytest.approx(direct.duration, rel=1e-9)
    for location in (2, 3):
        assert (found[location].duration, found[location].succeeded) == (None, False)
    assert found[2].proposal.text == "far away"
    assert sorted(each.stage for each in told)[0] == "tried: far away"


def _far(size):
    return Proposal({"tube.points.1": [0.3, 9.0, 0]}, None, "far away")


def _unknown(size):
    return Proposal({"start": {"joints": {"jiont1": 0}}}, None, "no such joint")


@pytest.mark.parametrize("is_thorough", [True, False])
def test_plans_are_quick_and_of_the_shortest_motion(checked_options, is_thorough):
    """And planning goes on only if it is to be thorough."""
    trials = trials_of(line(), limit=100.0, quality="best")
    ((_, found),) = trials.of([with_effort(0.5)], is_thorough)
    (options,) = checked_options
    assert (options.quality, options.slack) == ("fast", 0.0)
    assert 9.9 < options.time_limit <= 10.0
    assert found.is_thorough == options.persistent == is_thorough


def test_the_slack_that_is_asked_stays_and_short_searches_leave_each_plan_some_time(
    checked_options,
):
    list(trials_of(line(), slack=0.1).of([with_effort(0.5)], True))
    list(trials_of(line(), limit=5.0).of([with_effort(0.5)], True))
    assert checked_options[0].slack == 0.1
    assert checked_options[1].time_limit == 2.0


@pytest.mark.parametrize(("duration", "is_possible"), [(0.3, False), (1.0, True)])
def test_a_duration_that_is_asked_counts(duration, is_possible):
    question = line(**{"objective.duration": duration})
    (found,) = dict(trials_of(question).of([(simple_change(), 0.05)], True)).values()
    assert found.succeeded == is_possible


def test_the_search_ends_with_its_time_and_with_the_first_that_is_cut_short(monkeypatch):
    trials = trials_of(line(), limit=0.0)
    with pytest.raises(TimeLimitReached):
        list(trials.of([with_effort(1.0)], True))
    assert trials.count == 0
    times = iter([0.0, 0.0, 1.0, 2000.0])
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=times.__next__))
    trials = trials_of(line())
    asked_for = trials.of([with_effort(1.0), with_effort(0.9)], True)
    assert next(asked_for)[1].succeeded
    with pytest.raises(TimeLimitReached):
        next(asked_for)
    assert trials.count == 1


def test_what_is_cut_short_says_nothing(monkeypatch):
    spec = line().spec
    with pytest.raises(TimeLimitReached):
        planned_duration((spec, replace(QUICK, time_limit=100.0), -NO_LIMIT))
    failed = SimpleNamespace(duration=None, succeeded=False, stopped_by=None, message="")
    ended = SimpleNamespace(duration=1.0, succeeded=True, stopped_by=None, message="")
    for result, ending in ((failed, pytest.raises(TimeLimitReached)), (ended, nullcontext())):
        times = iter([0.0, 9.0])  # before planning and after
        monkeypatch.setattr(module.time, "monotonic", times.__next__)
        monkeypatch.setattr(rows, "plan_task", lambda problem, options, progress, r=result: r)
        with ending:
            assert planned_duration((spec, QUICK, 5.0)) == 1.0


def test_ctrl_c_while_it_is_planned_is_ctrl_c(monkeypatch):
    kept = SimpleNamespace(duration=1.0, succeeded=True, stopped_by="interrupt")
    monkeypatch.setattr(rows, "plan_task", lambda *_: kept)
    with pytest.raises(KeyboardInterrupt):
        list(trials_of(line()).of([with_effort(1.0)], True))


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


@pytest.mark.parametrize(
    ("known", "size"),
    [
        (bracket(scale=0.3), 0.1),
        (bracket(scale=0.3, most=0.05), 0.05),
        (bracket(larger=0.3), 0.0949),
        (bracket(smaller=0.3), 3.0),
        (bracket(smaller=0.3, most=2.0), 2.0),
        (bracket(0.1, 0.2), 0.141),
    ],
)
def test_the_next_size_is_between_or_beyond_what_is_known(known, size):
    assert known.next_size == size


@pytest.mark.parametrize(
    ("known", "is_close", "is_done"),
    [
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
        # Of a loss, what is left is close too, unless figures end.
        (bracket(55.5, 55.8, **LOSS), False, False),
        (bracket(55.7, 55.8, **LOSS), True, True),
        (bracket(55.5, 55.8, **{**LOSS, "is_loss": False}), True, True),
    ],
)
def test_a_bracket_is_done_when_close_or_nothing_is_left_to_try(known, is_close, is_done):
    assert (known.is_close, bool(known.is_done)) == (is_close, is_done)


@pytest.mark.parametrize(("helps", "size"), [(True, 0.316), (False, 10.5)])
def test_what_was_tried_in_vain_quickly_is_tried_once_more(helps, size):
    """What is found after all opens the bracket again."""
    known = bracket(1.0, CLOSE, helps)
    vain = known.impossible
    known.keep(replace(vain, is_thorough=False))
    assert known.open_size(is_thorough=False) is None
    assert known.open_size(is_thorough=True) == vain.size
    known.keep(vain)
    assert known.open_size(is_thorough=True) is None
    known.keep(trial(vain.size, succeeded=True))
    assert known.impossible is None
    assert known.open_size(is_thorough=False) == size


def test_a_smaller_size_in_vain_says_no_more_and_the_cost_is_the_larger_over_the_scale():
    known = bracket(smaller=2.0)
    known.keep(trial(1.0, succeeded=False))
    assert known.smaller.size == 2.0
    assert bracket(0.2, 0.8, scale=4.0).cost == 0.2
    assert bracket(0.2).cost == float("inf")


@pytest.mark.parametrize("threshold", [0.0123, 37.0])
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
