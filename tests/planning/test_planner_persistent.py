"""Planning that gives up early: quick refusals, and the same answers."""

from dataclasses import replace

import pytest

from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.blocked_spot import blocked_spot, surely_blocked_spot
from tubeplanner.progress import PlanningClock

FAST = PlanOptions(quality="fast", slack=0.0)
EARLY = replace(FAST, persistent=False)
POST = "example:two_link/around_a_post"
BALL = {"obstacles": [{"name": "ball", "sphere": 0.06, "position": [0.2, 0.1, 0.0]}]}


def stages_of(problem, options):
    stages = []
    result = plan(problem, options, lambda now: stages.append(now.stage))
    return result, list(dict.fromkeys(stages))


def test_an_answer_is_the_same():
    problem = load_problem(POST)
    assert plan(problem, EARLY).duration == plan(problem, FAST).duration


def test_a_place_without_a_configuration_ends_it_at_once():
    result, stages = stages_of(load_problem(POST, changes=BALL), EARLY)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert (result.proved, result.place.obstacle) == (False, "ball")
    assert result.starts_tried
    assert not [stage for stage in stages if "refinement" in stage]


@pytest.mark.parametrize("method", ["stop-at-corners", "branch-and-bound"])
def test_other_methods_take_no_notice(method):
    problem = load_problem(POST)
    durations = [plan(problem, replace(each, method=method)).duration for each in (EARLY, FAST)]
    assert durations[0] == durations[1]


def test_the_tool_may_pass_anywhere_in_the_tube():
    """A ball at a corner leaves no configuration near it, but others in the tube about it."""
    ball = {"name": "ball", "sphere": 0.03, "position": [0.2, 0.1, 0.0]}
    problem = load_problem(POST, changes={"obstacles": [ball]})
    start = KnownBranches(problem, PlanningClock(None, None)).require_ends()[0]
    assert blocked_spot(problem, start, Place()).place.obstacle == "ball"
    assert surely_blocked_spot(problem, start) is None
