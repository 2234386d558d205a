"""What planning with a change shows, and when it is not known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import pytest

from asked_problems import asked, simple_change
from tubeplanner import PlanOptions, plan
from tubeplanner.explanation import trials as module
from tubeplanner.explanation.change import Proposal
from tubeplanner.explanation.trials import Asked, Trials, planned
from tubeplanner.progress import PlanningClock, TimeLimitReached

QUICK = PlanOptions(quality="fast", slack=0.0)
LINE = {"tube.points": [[0.3, -0.5, 0], [0.3, 0.5, 0]], "obstacles": []}
NO_LIMIT = float("inf")


def line(radius=0.03, **changes):
    return asked({**LINE, "tube.radius": radius, **changes})


def trials_of(question, limit=1000.0, executor=None, callback=None, **options):
    clock = PlanningClock(limit, callback)
    return Trials(question, PlanOptions(**options), clock, executor)


def with_effort(share):
    """Return the change of the effort of all joints to a share, as a size."""
    return simple_change("robot.limits.scale.effort"), share


@pytest.fixture
def given_options(monkeypatch):
    """The options of every trial, which all succeed at once."""
    given = []

    def answered(problem, options):
        given.append(options)
        return SimpleNamespace(duration=1.0, succeeded=True, stopped_by=None)

    monkeypatch.setattr(module, "plan_either", answered)
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
    assert sorted(found) == [0, 1, 2, 3]
    assert trials.count == 4
    for place, size in enumerate(sizes):
        direct = plan(question.load({"tube.radius": size}), QUICK)
        assert found[place].size == size
        assert found[place].duration == pytest.approx(direct.duration, rel=1e-9)
        assert found[place].succeeded
    for place in (2, 3):
        assert (found[place].duration, found[place].succeeded) == (None, False)
    assert found[2].proposal.text == "far away"
    assert sorted(each.stage for each in told)[0] == "tried: far away"


def _far(size):
    return Proposal({"tube.points.1": [0.3, 9.0, 0]}, None, "far away")


def _unknown(size):
    return Proposal({"start": {"joints": {"jiont1": 0}}}, None, "no such joint")


def test_plans_are_quick_and_of_the_shortest_motion(given_options):
    list(trials_of(line(), limit=100.0, quality="best").of([with_effort(0.5)], True))
    (options,) = given_options
    assert (options.quality, options.slack) == ("fast", 0.0)
    assert 9.9 < options.time_limit <= 10.0


@pytest.mark.parametrize("is_thorough", [True, False])
def test_planning_goes_on_only_if_it_is_to_be_thorough(given_options, is_thorough):
    (found,) = dict(trials_of(line()).of([with_effort(0.5)], is_thorough)).values()
    assert given_options[0].persistent == is_thorough
    assert found.is_thorough == is_thorough


def test_the_slack_that_is_asked_stays(given_options):
    list(trials_of(line(), slack=0.1).of([with_effort(0.5)], True))
    assert given_options[0].slack == 0.1


def test_short_searches_leave_each_plan_some_time(given_options):
    list(trials_of(line(), limit=5.0).of([with_effort(0.5)], True))
    assert given_options[0].time_limit == 2.0


@pytest.mark.parametrize(("duration", "is_possible"), [(0.3, False), (1.0, True)])
def test_a_duration_that_is_asked_counts(duration, is_possible):
    question = line(**{"objective.duration": duration})
    (found,) = dict(trials_of(question).of([(simple_change(), 0.05)], True)).values()
    assert found.succeeded == is_possible


def test_there_is_an_end_to_the_time():
    trials = trials_of(line(), limit=0.0)
    with pytest.raises(TimeLimitReached):
        list(trials.of([with_effort(1.0)], True))
    assert trials.count == 0


def test_what_is_cut_short_says_nothing(monkeypatch):
    posed = line().posed
    late = Asked(posed, replace(QUICK, time_limit=100.0), until=-NO_LIMIT)
    assert planned(late).is_cut_short
    failed = SimpleNamespace(duration=None, succeeded=False, stopped_by=None)
    ended = SimpleNamespace(duration=1.0, succeeded=True, stopped_by=None)
    for result, is_cut_short in ((failed, True), (ended, False)):
        times = iter([0.0, 9.0])  # before planning and after
        monkeypatch.setattr(module.time, "monotonic", times.__next__)
        monkeypatch.setattr(module, "plan_either", lambda problem, options, r=result: r)
        answer = planned(Asked(posed, QUICK, until=5.0))
        assert (answer.duration, answer.is_cut_short) == (result.duration, is_cut_short)


def test_the_search_ends_with_the_first_that_is_cut_short(monkeypatch):
    times = iter([0.0, 0.0, 1.0, 2000.0])
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=times.__next__))
    trials = trials_of(line())
    asked_for = trials.of([with_effort(1.0), with_effort(0.9)], True)
    assert next(asked_for)[1].succeeded
    with pytest.raises(TimeLimitReached):
        next(asked_for)
    assert trials.count == 1


def test_ctrl_c_while_it_is_planned_is_ctrl_c(monkeypatch):
    kept = SimpleNamespace(duration=1.0, succeeded=True, stopped_by="interrupt")
    monkeypatch.setattr(module, "plan_either", lambda problem, options: kept)
    with pytest.raises(KeyboardInterrupt):
        list(trials_of(line()).of([with_effort(1.0)], True))
