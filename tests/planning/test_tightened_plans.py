"""What plans with some of the limits kept back are said to lack, and to take without lacking it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner import ProblemError, Robustness, Tube, load_problem
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning import tightened_plans
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.tightened_plans import TightenedPlans
from tubeplanner.problem.tightening import Tightening
from tubeplanner.progress import PlanningClock, TimeLimitReached
from tubeplanner.refinement.sensitivities import Sensitivity
from tubeplanner.simulation.plant import Draw
from tubeplanner.simulation.shortfall import Shortfall

NUMBERS = [0, 2, 5, 6]
FEW, MORE = Draw(4, 0), Draw(8, 0)
BOX = {"box": [0.06, 0.1], "up": [0, 0, 1]}
TURNED = [[0, 0, 0, 1]] * 4
ERRORS = Robustness(mass=0.1, tool=0.001)


class Seen:
    """What the simulated runs of a plan are made to show, and what was asked of them."""

    def __init__(self, **shown):
        none = {"radius": np.full(3, -1.0), "rotation": np.full(3, -1e3), "clearance": -1e3}
        none |= {"position": np.full((2, 2), -1.0), "self_collision": -1e3}
        self.shortfall = Shortfall(**(none | shown))
        self.failed = 0
        self.asked = None

    def runs(self, problem, trajectory, errors, draw, checkpoint):
        self.asked = problem, trajectory, errors, draw
        failing = [SimpleNamespace(survives=False, broken=("tube",))] * self.failed
        return failing + [SimpleNamespace(survives=True, broken=())] * (draw.runs - self.failed)


@pytest.fixture
def seen(monkeypatch):
    """Return a function that sets what runs show."""

    def show(**shown):
        now = Seen(**shown)
        monkeypatch.setattr(tightened_plans, "simulated_runs", now.runs)
        monkeypatch.setattr(tightened_plans, "shown_shortfall", lambda problem, runs: now.shortfall)
        return now

    return show


@pytest.fixture
def problem():
    """Three segments of 30, 40 and 20 mm; the tool begins and ends on the axis of the first."""
    robot = load_problem("example:two_link/paper_1_30mm")
    first = robot.robot.tool_position(ends())[0]
    points = first + np.array([[0, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0], [0.2, 0.1, 0]])
    tube = Tube(points, [0.03, 0.04, 0.02], numbers=NUMBERS)
    return replace(robot.with_tube(tube), robustness=ERRORS)


def ends():
    return np.array([[0.9, -1.4]])


def plans_of(problem, again=None):
    return TightenedPlans(problem, again, ends(), PlanningClock(None, None))


def result(duration=2.0, *sensitivities):
    return PlanResult(
        PlanStatus.SUCCESS,
        "",
        Place(),
        "",
        trajectory=SimpleNamespace(duration=duration),
        sensitivities=sensitivities,
    )


def price_of(limit, segment, elasticity):
    return Sensitivity(limit, None, segment, elasticity, 0.0)


def kept(problem, **parts):
    return replace(Tightening.nothing(problem), **parts)


def test_what_is_short_makes_it_longer_by_the_price_of_its_own_segment(problem, seen):
    """2 s, and 2 s * 0.06 / 40 mm = 3 s/m of the segment that is called 2: of 5 mm, 15 ms."""
    seen(radius=np.array([-1.0, 0.005, 0.001]))
    shown = result(
        2.0, price_of("radius", 2, -0.06), price_of("effort", None, -0.4), price_of("width", 2, -9)
    )
    tried = plans_of(problem).simulated(Tightening.nothing(problem), shown, FEW)
    assert tried.wanted.radius == pytest.approx([0.0, 0.005, 0.001])
    assert tried.expected == pytest.approx(2.015)
    assert tried.duration == 2.0
    assert tried.lacking == 0.0


def test_what_is_to_spare_makes_it_shorter_by_the_price_where_it_is(problem, seen):
    """Of 40 mm, of which 10 mm are kept back: 2 s * 0.06 / 30 mm = 4 s/m; of 2 mm, 8 ms."""
    seen(radius=np.array([-1.0, -0.002, -1.0]))
    shown = result(2.0, price_of("radius", 2, -0.06))
    before = kept(problem, radius=np.array([0.0, 0.01, 0.0]))
    tried = plans_of(problem).simulated(before, shown, FEW)
    assert tried.wanted.radius == pytest.approx([0.0, 0.008, 0.0])
    assert tried.expected == pytest.approx(1.992)


def test_a_box_is_narrowed_at_both_sides(problem, seen):
    """Width 60 mm and height 100 mm, by 5 mm at each side: by 10 mm each."""
    boxes = Tube(problem.tube.points, None, cross_section=BOX, numbers=NUMBERS)
    problem = problem.with_tube(boxes)
    seen(radius=np.array([0.005, -1.0, -1.0]))
    shown = result(3.0, price_of("width", 0, -0.06), price_of("height", 0, -0.1))
    tried = plans_of(problem).simulated(Tightening.nothing(problem), shown, FEW)
    assert tried.expected == pytest.approx(3 + 3 * (0.06 / 0.06 + 0.1 / 0.1) * 0.01)


def test_rotation_has_a_price_of_its_own(problem, seen):
    """Of 0.2 rad: 2 s * 0.03 / 0.2 rad = 0.3 s/rad; of 0.1 rad, 30 ms."""
    tube = Tube(
        problem.tube.points,
        [0.03, 0.04, 0.02],
        numbers=NUMBERS,
        orientations=TURNED,
        rotation_tolerance=[3.0, 0.2, (0.1, 0.3, 0.4)],
    )
    problem = problem.with_tube(tube)
    seen(rotation=np.array([-1.0, 0.1, 0.3]))
    tried = plans_of(problem).simulated(
        Tightening.nothing(problem), result(2.0, price_of("rotation", 2, -0.03)), FEW
    )
    assert tried.wanted.rotation == pytest.approx([0.0, 0.1, 0.09])
    assert tried.expected == pytest.approx(2.03)
    assert tried.lacking == pytest.approx(2.1)


def test_what_there_is_no_room_for_is_lacking_in_shares_of_the_tolerance(problem, seen):
    """Of 20 mm at most 18 mm are kept back: of 21 mm 3 mm are lacking; of clearance all."""
    plans, nothing = plans_of(problem), Tightening.nothing(problem)
    seen(radius=np.array([-1.0, 0.03, 0.021]))
    assert plans.simulated(nothing, result(), FEW).lacking == pytest.approx(0.15)
    seen(self_collision=0.004)
    assert plans.simulated(nothing, result(), FEW).lacking == pytest.approx(0.004)
    limits = problem.robot.limits
    seen(position=np.array([[-1.0, -1.0], [5.75, -1.0]]))
    room = limits.upper_position[0] - 0.9
    assert plans.simulated(nothing, result(), FEW).lacking == pytest.approx(5.75 - room, abs=1e-5)


def test_what_is_kept_back_counts_as_well_as_what_is_short(problem, seen):
    seen(
        radius=np.array([0.002, -0.001, -0.5]),
        clearance=0.001,
        position=np.array([[0.1, -0.3], [-1.0, 0.2]]),
    )
    before = kept(
        problem,
        effort=0.9,
        velocity=0.95,
        radius=np.full(3, 0.004),
        clearance=0.002,
        position=np.full((2, 2), 0.2),
    )
    wanted = plans_of(problem).simulated(before, result(), FEW).wanted
    assert (wanted.effort, wanted.velocity) == (0.9, 0.95)
    assert wanted.radius == pytest.approx([0.006, 0.003, 0.0])
    assert wanted.clearance == pytest.approx(0.003)
    assert wanted.position == pytest.approx(np.array([[0.3, 0.0], [0.0, 0.4]]))


def test_runs_are_of_the_whole_problem_with_errors_enlarged(problem, seen):
    shown = seen()
    before, planned = kept(problem, radius=np.full(3, 0.004)), result()
    tried = plans_of(problem).simulated(before, planned, MORE)
    asked, trajectory, errors, draw = shown.asked
    assert (asked, trajectory, draw) == (problem, planned.trajectory, MORE)
    assert errors == ERRORS.enlarged(1.3)
    assert tried.verdict.runs == 8


def test_the_shortest_survivor_is_kept(problem, seen):
    plans, nothing = plans_of(problem), Tightening.nothing(problem)
    shown = seen()
    assert plans.survivor is None
    shown.failed = 1
    assert not plans.simulated(nothing, result(1.0), FEW).survives
    assert plans.survivor is None
    shown.failed = 0
    for duration in (2.2, 2.0, 2.1):
        plans.simulated(nothing, result(duration), FEW)
    assert plans.survivor.duration == 2.0


def test_a_problem_is_planned_once_and_its_notes_are_left_out(problem):
    calls = []

    def again(given, motion):
        calls.append(given)
        return replace(result(), notes=("smoothed",))

    plans = plans_of(problem, again)
    by = kept(problem, effort=0.9)
    found = plans.planned(by, None)
    assert found.notes == ()
    assert plans.planned(kept(problem, effort=0.9), None) is found
    assert len(calls) == 1
    assert calls[0].robot.limits.effort == pytest.approx(0.9 * problem.robot.limits.effort)
    plans.planned(kept(problem, effort=0.8), None)
    assert len(calls) == 2


def raising(error):
    def again(problem, motion):
        raise error

    return again


@pytest.mark.parametrize(
    "again",
    [
        raising(ProblemError("nothing is left")),
        raising(Infeasible(PlanStatus.TUBE_BLOCKED, "no", Place())),
        lambda problem, motion: replace(result(), status=PlanStatus.NO_TRAJECTORY),
    ],
    ids=["no problem", "infeasible", "no answer"],
)
def test_where_there_is_no_plan_there_is_none(problem, again):
    plans, nothing = plans_of(problem, again), Tightening.nothing(problem)
    assert plans.planned(nothing, None) is None
    assert plans.tried(nothing, None, FEW) is None


@pytest.mark.parametrize(
    ("by", "error"), [("time_limit", TimeLimitReached), ("interrupt", KeyboardInterrupt)]
)
def test_planning_that_was_stopped_stops_the_search(problem, by, error):
    plans = plans_of(problem, lambda problem, motion: replace(result(), stopped_by=by))
    with pytest.raises(error):
        plans.planned(Tightening.nothing(problem), None)
