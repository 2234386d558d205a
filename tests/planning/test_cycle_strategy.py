"""plan_cycle: whole cycles to one certified motion, and what is said where there is none."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from cases import study_but
from small_cycle import cycle_of, move, three_moves

from tubeplanner import (
    Cycle,
    CycleResult,
    OptionError,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    PlanStatus,
    ProblemError,
    plan,
    plan_cycle,
    verify,
)
from tubeplanner.outcome import PlanningClock, Progress
from tubeplanner.planning import strategy
from tubeplanner.planning.legs import _first_answer
from tubeplanner.resources import bundled_cycles
from tubeplanner.task.cycle_file import load_cycle

SHORTEST = PlanOptions(slack=0.0, quality="fast")


def two_moves(**more: Any) -> Cycle:
    """Return two moves, of which the first ends in a ball."""
    return cycle_of(move("first", "ab", tolerance=0.05), move("second", "bc"), **more)


@pytest.fixture(scope="module")
def shared() -> CycleResult:
    return plan_cycle(two_moves(), SHORTEST)


def test_shared_configurations_are_quicker_than_moves_alone(shared: CycleResult) -> None:
    alone = plan_cycle(two_moves(), SHORTEST, shares_configurations=False)
    assert alone.duration == pytest.approx(alone.greedy_duration, abs=1e-12)
    assert shared.greedy_duration == pytest.approx(alone.duration, abs=1e-12)
    assert shared.duration < alone.duration - 0.005
    for result in (alone, shared):
        assert result.succeeded
        assert result.certificate.passed
        assert list(result.certificate.moves) == ["first", "second"]
    # Every leg of the answer is a certified motion of its problem.
    motion = shared.motion
    problems = motion.cycle.problems(motion.junctions)
    for problem, leg in zip(problems, motion.legs, strict=True):
        assert verify(problem, leg).passed
    for before, after in pairwise(motion.legs):
        assert abs(before.position(before.duration) - after.position(0.0)).max() < 1e-9


def test_a_cycle_of_one_move_is_the_plan_of_its_problem() -> None:
    cycle = cycle_of(move("only", "abcd"))
    result = plan_cycle(cycle, SHORTEST)
    start = result.motion.junctions[0]
    alone = plan(cycle.problem(0, [start]), SHORTEST)
    assert result.duration == alone.duration
    assert np.array_equal(result.motion.trajectory.coefficients, alone.trajectory.coefficients)


def test_a_closed_cycle_ends_where_it_begins_wherever_that_is() -> None:
    steps = [move("there", "ab", tolerance=0.05), move("back", "ba")]
    free = plan_cycle(cycle_of(*steps, closed=True), SHORTEST)
    assert free.certificate.junctions["closed"]["continuity"].margin > -1e-9
    shoulder, elbow = free.motion.junctions[0]
    q = np.array([shoulder + elbow, -elbow])  # bent to the other side, the tool in the same place
    fixed = cycle_of(*steps, closed=True, start={"joints": q.tolist()})
    result = plan_cycle(fixed, SHORTEST)
    assert np.array_equal(result.motion.junctions[0], q)
    assert abs(result.motion.junctions[-1] - q).max() < 1e-9


def test_a_given_last_goal_of_a_closed_cycle_is_where_it_begins() -> None:
    there = plan_cycle(cycle_of(move("there", "ab")), SHORTEST).motion.junctions[-1]
    cycle = cycle_of(
        move("back", "ba"),
        {**move("there", "ab"), "goal": {"joints": there.tolist()}},
        closed=True,
        start={"seed": (-there).tolist()},  # the elbow bent to the other side
    )
    result = plan_cycle(cycle, SHORTEST)
    assert result.succeeded
    assert abs(result.motion.junctions[0] - there).max() < 1e-9


@pytest.mark.dear("plans three cycles")
def test_passing_through_saves_the_stop() -> None:
    first, second = move("first", "abc"), move("second", "cd")
    stops = plan_cycle(cycle_of(first, second), SHORTEST)
    passes = plan_cycle(cycle_of(first, {**second, "pass_through": True}), SHORTEST)
    whole = plan_cycle(cycle_of(move("whole", "abcd")), SHORTEST)
    assert passes.duration < 0.95 * stops.duration
    assert passes.duration == pytest.approx(whole.duration, rel=1e-9)
    handed_over, _ = passes.motion.move_times["second"]
    assert 0 < handed_over < passes.duration
    cycle, q = passes.motion.cycle, passes.motion.trajectory.position(handed_over)
    margins = cycle.legs[0].joined.tube.margin(cycle.robot.tool_position(q[None]))[0]
    assert (margins[1:] > -1e-6).all()  # in the last segment of the first, and in the second's


def test_rests_take_their_time_and_what_is_attached_weighs() -> None:
    load = {"mass": 3.0, "com": [0, 0, 0]}
    light = [move("first", "ab"), {"event": "grip", "set": "close", "dwell": 0.2}]
    bare = plan_cycle(cycle_of(*light, move("second", "bc")), SHORTEST)
    heavy = plan_cycle(
        cycle_of(*light, {"attach": "load", "payload": load}, move("second", "bc")), SHORTEST
    )
    for result in (bare, heavy):
        first, second = result.motion.leg_times
        assert second[0] - first[1] == pytest.approx(0.2, abs=1e-12)
        middle = (first[1] + second[0]) / 2
        assert not result.motion.trajectory.velocity(middle).any()
    duration = [result.legs[1].duration for result in (bare, heavy)]
    assert duration[1] > 1.03 * duration[0]


def test_a_note_on_every_move_is_there_once_without_their_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The plan of a leg repeats the notes on its robot.
    monkeypatch.setattr(strategy, "robot_notes", lambda _: ("of the robot", "of the robot"))
    notes = plan_cycle(two_moves(), SHORTEST, shares_configurations=False).notes
    assert [note for note in notes if "of the robot" in note] == ["of the robot"]


@pytest.mark.parametrize(
    "passes",
    [pytest.param(False, marks=pytest.mark.dear("begins at every configuration there")), True],
)
def test_a_blocked_move_is_told_with_its_number_name_and_segment(passes: bool) -> None:
    """Of two that are planned as one leg, segments are counted over all."""
    wall = {"name": "wall", "box": [0.5, 0.02, 0.5], "position": [0.3, 0.4, 0.0]}
    second = move("second", "cd") | ({"pass_through": True} if passes else {})
    cycle = cycle_of(move("first", "bc"), second, obstacles=[wall])
    result = plan_cycle(cycle, replace(SHORTEST, persistent=False))
    assert (result.status, result.motion) == (PlanStatus.TUBE_BLOCKED, None)
    assert result.location.obstacle == "wall"
    if passes:
        assert result.location.move in ("second", "first, second")
        assert "counted over all" in result.message
    else:
        assert result.location.move == "second"
        assert "move 2 of 2, 'second'" in result.message
        assert "other start configurations have no answer either" in result.message


@pytest.mark.parametrize("sign", "+-")
def test_an_end_from_which_the_next_move_leads_nowhere_is_chosen_again(sign: str) -> None:
    """Where the first move ends by itself the elbow may be bent the other way than asked next.

    A part that is taken there is held as it is taken in the end.
    """
    start, part = [0.3, 1e-3], {"name": "part", "sphere": 0.01}
    x, y, _ = cycle_of(move("any", "ab")).robot.tool_position(np.array(start))
    first = {"name": "first", "tube": {"points": [[x, y, 0.0], [0.45, 0.1, 0.0]], "radius": 0.05}}
    second = move("second", "bc")
    second["tube"]["joint_signs"] = {"joint2": sign}
    cycle = cycle_of(
        *(first, {"attach": "part"}, second),
        start={"joints": start},
        obstacles=[{**part, "position": [0.45, 0.1, 0.3]}],
    )
    result = plan_cycle(cycle, SHORTEST, shares_configurations=False)
    assert result.succeeded, result.message
    elbow = result.motion.junctions[1][1]
    assert elbow > 0 if sign == "+" else elbow < 0
    ours, exact = (
        problem.attached[0].shapes[0].center
        for problem in (result.legs[1].problem, cycle.problems(result.motion.junctions)[1])
    )
    np.testing.assert_allclose(ours, exact, atol=1e-9)


def test_prices_are_sums_over_moves(shared: CycleResult) -> None:
    by_joint = [
        sum(
            each.saved
            for leg in shared.legs
            for each in leg.result.sensitivities
            if (each.limit, each.joint) == ("effort", joint)
        )
        for joint in ("joint1", "joint2")
    ]
    told = {each.joint: each.saved for each in shared.sensitivities if each.limit == "effort"}
    assert [told["joint1"], told["joint2"]] == pytest.approx(by_joint)
    ranked = [each.saved for each in shared.sensitivities]
    assert ranked == sorted(ranked, reverse=True)
    assert all(each.move for each in shared.sensitivities if each.limit == "radius")


def test_slack_is_that_of_every_move_and_ends_stay_where_they_are_shared(
    shared: CycleResult,
) -> None:
    smooth = plan_cycle(two_moves(), replace(SHORTEST, slack=0.02))
    assert smooth.shortest_duration == pytest.approx(shared.duration, rel=1e-9)
    for leg, shortest in zip(smooth.legs, shared.legs, strict=True):
        assert shortest.duration < leg.duration <= 1.02 * shortest.duration * (1 + 1e-9)
    for ours, theirs in zip(smooth.motion.junctions, shared.motion.junctions, strict=True):
        assert abs(ours - theirs).max() < 1e-9


def test_a_time_limit_leaves_an_answer_or_says_so() -> None:
    result = plan_cycle(two_moves(), replace(SHORTEST, time_limit=1e-9))
    assert result.status is PlanStatus.TIME_LIMIT
    assert "move 1 of 2" in result.message


def test_every_move_has_its_share_of_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float] = []

    def noting(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
        assert options.time_limit is not None
        assert clock.remaining <= options.time_limit
        given.append(options.time_limit)
        return _first_answer(problem, options, clock)

    monkeypatch.setattr("tubeplanner.planning.legs._first_answer", noting)
    plan_cycle(three_moves(), replace(SHORTEST, time_limit=1000.0), shares_configurations=False)
    # Twice what would be left to each of the others.
    assert all(limit <= most for limit, most in zip(given, (500, 667, 1000), strict=True))


@pytest.mark.parametrize("has_answer", [False, True])
def test_ctrl_c_before_every_move_has_an_answer_ends_it(has_answer: bool) -> None:
    def interrupt(progress: Progress) -> None:
        is_found = progress.best_duration is not None
        if "move 2 of 3" in str(progress) and is_found is has_answer:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_cycle(three_moves(), SHORTEST, interrupt)


def test_ctrl_c_while_configurations_are_shared_leaves_the_moves_as_they_are() -> None:
    def interrupt(progress: object) -> None:
        if "shared" in str(progress):
            raise KeyboardInterrupt

    result = plan_cycle(two_moves(), SHORTEST, interrupt)
    assert result.succeeded
    assert result.stopped_by == "interrupt"
    assert result.duration == pytest.approx(result.greedy_duration, abs=1e-12)


def test_only_cycles_are_planned() -> None:
    with pytest.raises(ProblemError, match="give a Cycle"):
        plan_cycle("cycle.yaml")
    assert not isinstance(two_moves(), PlanningProblem)


def test_a_period_is_that_of_what_is_written_and_takes_no_sharing_away(shared: CycleResult) -> None:
    period = 0.004
    result = plan_cycle(two_moves(period=period), SHORTEST)
    assert result.greedy_duration == pytest.approx(shared.greedy_duration, rel=1e-9)
    counts = result.motion.trajectory.breakpoints / period
    assert abs(counts - np.round(counts)).max() < 1e-6
    assert shared.duration < result.duration < shared.greedy_duration + 6 * period
    for ours, theirs in zip(result.motion.junctions, shared.motion.junctions, strict=True):
        assert abs(ours - theirs).max() < 1e-6


def test_robustness_is_that_of_every_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    cycle, problems = two_moves(robustness={"mass": 0.05}), []

    def noting(problem: PlanningProblem, *others: Any) -> PlanResult:
        problems.append(problem)
        shortest, _, follow, _ = others
        return follow(problem, shortest)

    monkeypatch.setattr("tubeplanner.planning.robust_plan.robust_plan", noting)
    result = plan_cycle(cycle, SHORTEST)
    assert [each.robustness for each in problems] == [cycle.robustness] * 2
    assert cycle.robustness.mass == 0.05
    for problem, leg in zip(problems, result.motion.legs, strict=True):
        assert verify(problem, leg).passed


def test_a_slack_that_the_method_does_not_honour_is_refused() -> None:
    with pytest.raises(OptionError, match="stop-at-corners"):
        plan_cycle(two_moves(), PlanOptions(method="stop-at-corners", slack=0.1))


# The fraction of the moves planned alone that the whole takes at most: where ends are chosen
# together and the arm has several configurations to choose from, less.
FRACTIONS = {
    "panda/tray_to_the_next_shelf": 0.95,
    "ur10/boxes_onto_a_pallet": 0.95,
    "ur5/through_the_door": 1.0,
}


# Whole cycles of arms with six and seven joints. That of the Panda is also planned by `make demo`.
@pytest.mark.parametrize("name", study_but(["ur5/through_the_door"], sorted(bundled_cycles())))
def test_bundled_cycles_are_planned_and_certified(name):
    cycle = load_cycle(f"example:{name}")
    result = plan_cycle(cycle)
    assert result.succeeded, result.message
    assert result.certificate.passed
    assert len(result.motion.marks) == len(cycle.steps)
    assert result.shortest_duration <= FRACTIONS[name] * result.greedy_duration
