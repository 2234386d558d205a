"""Attempts by refinement, with samples at counterexamples: branch, last motion, narrower tubes."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST

from tubeplanner import LowerBound, PlanningProblem, PlanOptions, Seed, Tube, plan, verify
from tubeplanner.optimizer.tube_phases import tube_chains
from tubeplanner.outcome import PlanningClock
from tubeplanner.planning import refined_plan as module
from tubeplanner.planning import result as result_module
from tubeplanner.planning.refined_plan import narrowed_plan

# Paths of many points: certified, and as fast as the same curve of few.

RADIUS = 0.005


def circle(two_link, count):
    """Return a problem of the two-link arm on a closed circle of 70 mm in so many chords."""
    angles = np.linspace(0, 2 * np.pi, count + 1)
    points = [0.35, 0, 0] + 0.07 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    tube = Tube(points, RADIUS, joint_signs={"joint2": "-"})
    return PlanningProblem(two_link, tube, Seed([0.7, -1.4]))


def test_more_chords_make_no_slower_motion_and_each_has_its_price(two_link):
    """A wall that twice as many segments share costs as much."""
    totals, durations = [], []
    for count in (25, 50):
        problem = circle(two_link, count)
        answer = plan(problem, PlanOptions(slack=0.0, quality="fast"))
        assert answer.method == "refinement"
        assert verify(problem, answer.trajectory).passed
        prices = [p for p in answer.sensitivities if p.limit == "radius"]
        assert {p.segment for p in prices} <= set(range(count))
        assert all(p.elasticity <= 0 for p in prices)
        totals.append(sum(p.elasticity for p in prices))
        durations.append(answer.duration)
    assert totals[1] == pytest.approx(totals[0], rel=0.1)
    assert totals[1] < -0.01
    assert durations[1] < 1.01 * durations[0]


def ur5_problem(robot, points, radius):
    tube = Tube(points, radius, joint_signs={"elbow_joint": "+"})
    return PlanningProblem(robot, tube, Seed([-0.2, -1.3, 1.9, -2, -1.6, 0]))


def curve(count):
    s = np.linspace(0, 1, count + 1)
    wave = 0.04 * np.sin(2 * np.pi * (s + 0.3 * s * s))
    return np.column_stack([0.35 + 0.25 * s, wave, 0.3 + 0.03 * np.sin(np.pi * s)])


def require_refined(problem):
    """Return the duration [s] of refinement's answer, which must be certified."""
    answer = plan(problem, SHORTEST)
    assert (answer.succeeded, answer.method) == (True, "refinement")
    assert verify(problem, answer.trajectory).passed
    assert {p.segment for p in answer.sensitivities} <= {None, *range(problem.tube.segment_count)}
    return answer.duration


@pytest.mark.slow  # paths of hundreds of segments for an arm of six joints, as those below
def test_a_scan_that_runs_backwards_is_no_slower_than_what_was_scanned(ur5):
    noise = 0.001 * np.random.default_rng(0).normal(size=(201, 3))
    noise[[0, -1]] = 0
    scanned = require_refined(ur5_problem(ur5, curve(200) + noise, RADIUS))
    assert scanned < 1.02 * require_refined(ur5_problem(ur5, curve(200), RADIUS))


@pytest.mark.slow
def test_forty_sharp_corners_all_end_a_phase(ur5):
    """Samples beside a corner inside a chain leave out its inner side: 0.05 mm too much."""
    legs = np.arange(41)
    right_angles = [0.01 * (legs // 2), 0.03 * ((legs + 1) // 2 % 2), 0 * legs]
    points = np.column_stack(right_angles) + np.array([0.35, -0.015, 0.3])
    problem = ur5_problem(ur5, points, 0.002)
    assert len(tube_chains(problem)) == 40
    assert require_refined(problem) < 0.83  # it is 0.807, and 1.76 with stops


# Another start follows an answer that may be faster.

UNUSED = (
    "5.0% of the speed that the limits allow is unused on average: a faster trajectory may exist"
)


@pytest.mark.parametrize(
    ("quality", "unused", "above", "starts"),
    [
        ("balanced", 0.05, 1.06, [(18, (4,)), (8, (3, 4))]),
        ("fast", 0.05, 1.06, [(8, (4,)), (8, (3, 4))]),
        ("best", 0.05, 1.06, [(18, (4,)), (8, (3, 4))]),
        ("balanced", 0.05, 1.04, [(18, (4,))]),
        ("balanced", 0.02, 1.06, [(18, (4,))]),
    ],
)
def test_other_knots_follow_an_answer_that_may_be_faster(
    quality, unused, above, starts, planned, monkeypatch
):
    """The better one is the answer; only what still may be faster has the note."""
    problem, known = planned("two_link/paper_2_30mm", "refinement")
    bound, begun, durations = known.duration / above, [], []

    class Watched(module.Refinement):
        def __init__(self, problem, spline, divisions, *rest, **named):
            begun.append((spline.grid.interval_count, divisions))
            super().__init__(problem, spline, divisions, *rest, **named)

    def of_speed(problem, trajectory):
        durations.append(trajectory.duration)
        return unused

    monkeypatch.setattr(module, "Refinement", Watched)
    monkeypatch.setattr(result_module, "unused_speed", of_speed)
    monkeypatch.setattr(result_module, "lower_bound", lambda problem: LowerBound(bound))
    answer = plan(problem, PlanOptions(slack=0.0, quality=quality))
    assert begun[: len(starts)] == starts
    assert quality == "best" or len(begun) == len(starts)
    assert answer.duration == min(durations)
    notes = [note for note in answer.notes if "unused" in note]
    expected = f"{UNUSED}, of {bound:.4g} s at least; --quality best searches from more starts"
    assert notes == [expected] * (len(starts) > 1)
    assert answer.may_be_faster == bool(notes)


# Wide tubes are planned through narrower ones where links get stuck in them.


@pytest.fixture(scope="module")
def wide(bundled):
    """Links get stuck in the wall, from every start."""
    problem = bundled("ur5/over_the_wall")
    return problem.with_tube(problem.tube.scaled(2.0))


@pytest.mark.slow
def test_a_wider_tube_is_faster_though_links_get_stuck_in_it(wide, planned):
    """By branch and bound alone it took 0.866 s."""
    answer = plan(wide, SHORTEST)
    narrow = planned("ur5/over_the_wall", "refinement")[1]
    assert answer.method == "refinement"
    assert answer.certificate.passed
    assert answer.duration < 0.9 * narrow.duration
    assert answer.motion is not None


@pytest.mark.dear("plans for an arm of six joints")
def test_where_the_whole_tube_gives_nothing_the_narrower_motion_is_the_answer(
    wide, planned, monkeypatch
):
    monkeypatch.setattr(module, "_widened", lambda problem, start, clock: None)
    found = narrowed_plan(wide, SHORTEST, PlanningClock(None, None))
    narrow = planned("ur5/over_the_wall", "refinement")[1]
    assert found.motion is not None  # what a second stage begins with
    assert found.duration == pytest.approx(narrow.duration, rel=1e-6)


def test_without_the_start_in_a_narrower_tube_there_is_none(wide):
    """It is beside the first point, inside the tube alone as it is."""
    points = wide.tube.points.copy()
    points[0] += [0.9 * wide.tube.radius[0], 0, 0]
    beside = wide.with_tube(replace(wide.tube, points=points))
    assert narrowed_plan(beside, SHORTEST, PlanningClock(None, None)) is None
