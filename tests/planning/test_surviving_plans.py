"""Plans for tightened problems, simulated; search for the least tightening."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import judged_run

from tubeplanner import ProblemError, Robustness, Tube, load_problem
from tubeplanner.execution.error_contributions import Shortfall
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, TimeLimitReached
from tubeplanner.planning import surviving_plans as tightened_plans
from tubeplanner.planning import surviving_plans as tightening
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.surviving_plans import (
    MANY,
    WORKING,
    Candidate,
    TightenedPlans,
    safer_plan,
    surviving_plan,
)
from tubeplanner.planning.tightening import Tightening
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Holding

# What plans with some of the limits kept back are said to lack, and to take without lacking it.

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
        none |= dict.fromkeys(("velocity", "tracking"), np.full(2, -1.0)) | {"tool_tracking": -1.0}
        self.shortfall = Shortfall(**(none | shown))
        self.failed = 0
        self.asked = None

    def runs(self, problem, trajectory, errors, draw, checkpoint):
        self.asked = problem, trajectory, errors, draw
        failing = [judged_run(tube=Extreme(0.1, Location()))] * self.failed
        return failing + [judged_run()] * (draw.runs - self.failed)


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


def as_it_is(problem, shortest):
    return shortest


def plans_of(problem, again=None, follow=as_it_is):
    return TightenedPlans(problem, again, follow, ends(), PlanningClock(None, None))


def result(duration=2.0, *prices):
    trajectory = SimpleNamespace(duration=duration)
    success = PlanResult(PlanStatus.SUCCESS, "", Location(), "", trajectory=trajectory)
    return replace(success, sensitivities=prices)


def price_of(limit, segment, elasticity, joint=None):
    return Sensitivity(limit, joint, segment, elasticity, 0.0)


def kept(problem, **parts):
    return replace(Tightening.nothing(problem), **parts)


def tried_of(problem, *prices, **before):
    """Return what is said of a plan of 2 s, with prices, and with so much kept back."""
    return plans_of(problem).simulated(kept(problem, **before), result(2.0, *prices), FEW)


def test_what_is_short_makes_it_longer_by_the_price_of_its_own_segment(problem, seen):
    """2 s, and 2 s * 0.06 / 40 mm = 3 s/m of the segment that is called 2: of 5 mm, 15 ms."""
    seen(radius=np.array([-1.0, 0.005, 0.001]))
    others = price_of("effort", None, -0.4), price_of("width", 2, -9)
    tried = tried_of(problem, price_of("radius", 2, -0.06), *others)
    assert tried.target.radius == pytest.approx([0.0, 0.005, 0.001])
    assert tried.expected == pytest.approx(2.015)
    assert (tried.duration, tried.deficit) == (2.0, 0.0)


def test_what_is_to_spare_makes_it_shorter_by_the_price_where_it_is(problem, seen):
    """Of 40 mm, of which 10 mm are kept back: 2 s * 0.06 / 30 mm = 4 s/m; of 2 mm, 8 ms."""
    seen(radius=np.array([-1.0, -0.002, -1.0]))
    tried = tried_of(problem, price_of("radius", 2, -0.06), radius=np.array([0.0, 0.01, 0.0]))
    assert tried.target.radius == pytest.approx([0.0, 0.008, 0.0])
    assert tried.expected == pytest.approx(1.992)


def test_a_box_is_narrowed_at_both_sides(problem, seen):
    """Width 60 mm and height 100 mm, by 5 mm at each side: by 10 mm each."""
    boxes = Tube(problem.tube.points, None, cross_section=BOX, numbers=NUMBERS)
    seen(radius=np.array([0.005, -1.0, -1.0]))
    prices = price_of("width", 0, -0.06), price_of("height", 0, -0.1)
    tried = tried_of(problem.with_tube(boxes), *prices)
    assert tried.expected == pytest.approx(2 + 2 * (0.06 / 0.06 + 0.1 / 0.1) * 0.01)


def test_rotation_has_a_price_of_its_own(problem, seen):
    """Of 0.2 rad: 2 s * 0.03 / 0.2 rad = 0.3 s/rad; of 0.1 rad, 30 ms."""
    tolerance = [3.0, 0.2, (0.1, 0.3, 0.4)]
    turned = {"orientations": TURNED, "rotation_tolerance": tolerance, "numbers": NUMBERS}
    tube = Tube(problem.tube.points, [0.03, 0.04, 0.02], **turned)
    seen(rotation=np.array([-1.0, 0.1, 0.3]))
    tried = tried_of(problem.with_tube(tube), price_of("rotation", 2, -0.03))
    assert tried.target.rotation == pytest.approx([0.0, 0.1, 0.09])
    assert tried.expected == pytest.approx(2.03)
    assert tried.deficit == pytest.approx(2.1)


def test_what_a_contact_lacks_has_the_price_of_its_force(problem, seen):
    """Of 2 s * 0.3, 5 % are 30 ms; what is kept back already counts as well."""
    cup = Cup(force=40.0, radius=0.02, friction=0.5, safety=1.0)
    held = replace(problem, holding=[Holding(cup, Payload(0.1))])
    seen(holding=0.05)
    price = replace(price_of("holding", None, -0.3), field="holding.cup.force")
    friction = replace(price_of("holding", None, -9.0), field="holding.cup.friction")
    tried = tried_of(held, price, friction, holding=0.02)
    assert tried.target.holding == pytest.approx(0.07)
    assert tried.expected == pytest.approx(2.03)


def test_what_there_is_no_room_for_is_lacking_in_shares_of_the_tolerance(problem, seen):
    """Of 20 mm at most 18 mm are kept back: of 21 mm 3 mm are lacking; of clearance all."""
    slack = problem.robot.limits.upper_position[0] - 0.9
    for shown, deficit in (
        ({"radius": np.array([-1.0, 0.03, 0.021])}, 0.15),
        ({"self_collision": 0.004}, 0.004),
        ({"tool_tracking": 0.07}, 0.07),
        ({"velocity": np.array([-1.0, 4.99])}, 0.8),  # of a sixth, 0.3 is left at least
        ({"position": np.array([[-1.0, -1.0], [5.75, -1.0]])}, 5.75 - slack),
    ):
        seen(**shown)
        assert tried_of(problem).deficit == pytest.approx(deficit, abs=1e-5)


def test_what_is_kept_back_counts_as_well_as_what_is_short(problem, seen):
    position = np.array([[0.1, -0.3], [-1.0, 0.2]])
    seen(radius=np.array([0.002, -0.001, -0.5]), clearance=0.001, position=position)
    before = {"radius": np.full(3, 0.004), "clearance": 0.002, "position": np.full((2, 2), 0.2)}
    wanted = tried_of(problem, effort=0.9, **before).target
    assert wanted.effort == 0.9
    assert wanted.radius == pytest.approx([0.006, 0.003, 0.0])
    assert wanted.clearance == pytest.approx(0.003)
    assert wanted.position == pytest.approx(np.array([[0.3, 0.0], [0.0, 0.4]]))


def test_velocity_is_kept_back_of_the_joint_that_is_too_fast_or_too_far_behind(problem, seen):
    """1 % more than what is short; 2 s * 0.3 of one limit, of which 1 / 1.1 is left, are 60 ms."""
    seen(velocity=np.array([0.09, -0.2]), tracking=np.array([-0.5, 0.25]))
    prices = price_of("velocity", None, -0.3, "joint1"), price_of("velocity", None, -9, "tool")
    tried = tried_of(problem, *prices, velocity=np.array([0.9, 0.8]))
    assert tried.target.velocity == pytest.approx([0.9 / 1.1, 0.64])
    assert tried.expected == pytest.approx(2.06)
    # What is to spare is given back, up to the whole limit.
    seen(velocity=np.array([-0.11, -0.3]))
    wanted = tried_of(problem, velocity=np.array([0.72, 0.9])).target
    assert wanted.velocity == pytest.approx([0.8, 1.0])


def test_runs_are_of_the_whole_problem_with_errors_enlarged(problem, seen):
    shown, planned = seen(), result()
    before = kept(problem, radius=np.full(3, 0.004))
    tried = plans_of(problem).simulated(before, planned, MORE)
    assert shown.asked == (problem, planned.trajectory, ERRORS.enlarged(1.3), MORE)
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


def test_what_is_simulated_is_what_would_be_written_and_planned_on_from_the_shortest(problem):
    """What is written may be smoothed, and has no motion to plan from."""
    shortest = replace(result(2.0), motion="a motion")
    written = result(2.02)
    given = []

    def follow(tightened, found):
        given.append((tightened.clearance, found.duration))
        return written

    plans, by = plans_of(problem, lambda *_: shortest, follow), kept(problem, clearance=0.002)
    found = plans.planned(by, None)
    assert given == [(problem.clearance + 0.002, 2.0)]
    assert found.trajectory is written.trajectory
    assert found.motion == "a motion"
    unwritten = plans_of(problem, lambda *_: shortest, lambda *_: replace(written, trajectory=None))
    assert unwritten.planned(by, None) is None
    stopped = replace(written, stopped_by="time_limit")
    with pytest.raises(TimeLimitReached):
        plans_of(problem, lambda *_: shortest, lambda *_: stopped).planned(by, None)


def raising(error):
    def again(problem, motion):
        raise error

    return again


@pytest.mark.parametrize(
    "again",
    [
        raising(ProblemError("nothing is left")),
        raising(Infeasible(PlanStatus.TUBE_BLOCKED, "no", Location())),
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


# The search for what to keep back, held against plans whose durations and runs are formulas.

RADIUS = 0.01  # [m]
FRACTIONS = np.array(tightening._EFFORTS)


@dataclass
class Formulas:
    """Plans of one segment: T0 (1 + a (1 - e)) + p r + q r^2, of a fraction e.

    Runs lack c + s ((e - e0)+)^2 - g r of radius, those of some draws more. Some fail
    where more than `seen` is short, of few runs where it is twice as much: less is seen of few than
    is expected of many.
    """

    slower: float = 0.5  # a
    price: float = 0.4  # p [s/m]
    curvature: float = 0.0  # q [s/m^2]
    always: float = 1e-3  # c [m]
    by_effort: float = 0.0  # s [m]
    enough_effort: float = 0.5  # e0
    gain: float = 1.0  # g
    seen: float = 0.0  # [m]
    slack: float = 0.9 * RADIUS  # [m]
    least_effort: float = 0.0  # below it there is no plan
    most_radius: float = 1.0  # [m]: with more kept back there is none either
    links_meet: float = 0.0
    more: dict = field(default_factory=dict)  # [m], by draw
    taken: list = field(default_factory=list)  # radii of plans with all arms
    made: list = field(default_factory=list)

    @staticmethod
    def kept(effort=1.0, radius=0.0):
        none = np.zeros(1)
        return Tightening(effort, np.ones(2), np.array([radius]), none, 0.0, np.zeros((2, 2)))

    def duration(self, kept):
        radius = float(kept.radius[0])
        return (
            1 + self.slower * (1 - kept.effort) + self.price * radius + self.curvature * radius**2
        )

    def short(self, kept):
        beyond = max(kept.effort - self.enough_effort, 0)
        asked = self.always + self.by_effort * beyond**2
        return asked - self.gain * float(kept.radius[0])

    def problem(self, kept):
        return kept

    def allowed(self, kept):
        return replace(kept, radius=np.minimum(kept.radius, self.slack))

    def planned(self, kept, motion):
        if kept.effort < self.least_effort or kept.radius[0] > min(self.slack, self.most_radius):
            return None
        return SimpleNamespace(duration=self.duration(kept), motion=None)

    def simulated(self, kept, result, draw):
        short = self.short(kept) + self.more.get(draw, 0.0)
        asked = max(float(kept.radius[0]) + short, 0.0)
        wanted = min(asked, self.slack)
        seen = self.seen if draw.runs >= WORKING.runs else 2 * self.seen
        failed = int(np.ceil(np.clip((short - seen) / RADIUS, 0, 1) * draw.runs))
        price = self.price + 2 * self.curvature * float(kept.radius[0])
        tried = Candidate(
            tightening=kept,
            result=result,
            verdict=RunVerdict(draw.runs, failed, {"tube": failed}, None, 0.0),
            target=self.kept(kept.effort, wanted),
            deficit=(asked - wanted) / RADIUS + self.links_meet,
            expected=result.duration + price * (wanted - float(kept.radius[0])),
        )
        self.made.append(tried)
        if draw == WORKING:
            self.taken.append(float(kept.radius[0]))
        return tried

    def tried(self, kept, motion, draw):
        result = self.planned(kept, motion)
        return None if result is None else self.simulated(kept, result, draw)

    def answer(self):
        nothing = self.kept()
        start = self.simulated(nothing, self.planned(nothing, None), WORKING)
        self.made.clear(), self.taken.clear()
        return surviving_plan(self, start)

    @property
    def survivors(self):
        return [tried for tried in self.made if tried.survives and tried.verdict.runs == MANY.runs]


@pytest.mark.parametrize("best", [0.975, 0.93, 0.875, 0.75, 0.6])
def test_the_share_of_effort_is_that_of_the_least_expected_duration(best):
    """That is least where a T0 = 2 p s (e - e0), and of its shares at the nearest to that."""
    price, slower, beyond = 0.4, 0.1, 0.2
    by_effort = slower / (2 * price * beyond)
    plans = Formulas(slower, price=price, enough_effort=best - beyond, by_effort=by_effort, slack=1)
    found = plans.answer()
    assert found.survives
    assert found.tightening.effort == FRACTIONS[abs(FRACTIONS - best).argmin()]


def test_what_is_short_is_taken_and_of_what_is_to_spare_half_is_given_back():
    """Where that gains much."""
    plans = Formulas(price=40.0, slower=5.0)
    found = plans.answer()
    first, second = plans.taken
    assert 1e-3 < first < 1.2e-3
    assert second - 1e-3 == pytest.approx((first - 1e-3) / 2)
    assert found.tightening.radius[0] == second
    cheap = Formulas(price=4.0)
    assert cheap.answer().tightening.radius[0] == cheap.taken[-1]
    assert len(cheap.taken) == 1


def test_it_is_taken_again_until_no_run_fails():
    """Radii help by 8 mm in 10: what is short is never seen to the end, but less and less is."""
    plans = Formulas(gain=0.8, seen=1e-5)
    found = plans.answer()
    assert found.survives
    assert plans.taken == sorted(plans.taken)
    assert len(plans.taken) == 3
    assert found.tightening.radius[0] == plans.taken[-1] < 1e-3 / 0.8


def test_giving_back_too_much_leaves_the_survivor():
    """With less radius given back than half, runs fail again."""

    class Sudden(Formulas):
        def short(self, kept):
            radius = float(kept.radius[0])
            return -5e-4 if radius >= 1.08e-3 else 1e-3 - radius

    plans = Sudden(price=40.0, slower=5.0)
    found = plans.answer()
    assert [tried.survives for tried in plans.made if tried.verdict.runs == 32] == [True, False]
    assert found.tightening.radius[0] == plans.taken[0]
    assert found is plans.survivors[0]


def test_less_effort_is_tried_where_radii_cost_more_than_expected():
    """The price rises with the radius; of what survives the shortest is the answer."""
    plans = Formulas(0.1, price=4.0, curvature=8e3, by_effort=0.1, enough_effort=0.7)
    at = [plans.kept(effort) for effort in FRACTIONS]
    expected = [plans.duration(kept) + plans.price * plans.short(kept) for kept in at]
    found = plans.answer()
    assert found.survives
    assert found.tightening.effort < FRACTIONS[int(np.argmin(expected))]
    assert found.duration == min(tried.duration for tried in plans.survivors)


def test_less_effort_is_tried_where_nothing_was_found_with_more():
    """With 3 mm kept back there is no plan: little enough is short with 96 % of the effort."""
    plans = Formulas(by_effort=0.4, enough_effort=0.9, most_radius=3e-3)
    found = plans.answer()
    assert found.survives and found.tightening.effort == 0.96
    never = Formulas(most_radius=5e-4).answer()
    assert not never.survives


def test_where_nothing_survives_it_is_what_fails_least():
    """Links that meet leave nothing to have: all shares are tried, and the least failing is it."""
    plans = Formulas(always=12e-3, by_effort=0.01, links_meet=0.1, least_effort=0.7)
    found = plans.answer()
    assert not found.survives
    fraction = [tried.verdict.failed / tried.verdict.runs for tried in plans.made]
    assert found.verdict.failed / found.verdict.runs == min(fraction)
    assert found.tightening.effort < 1
    assert found.tightening.radius[0] == plans.slack


def test_no_more_is_taken_than_there_is_room_for():
    """All that is short could be had, a tenth more could not."""
    plans = Formulas(slack=1.02e-3)
    found = plans.answer()
    assert found.survives
    assert found.tightening.radius[0] == plans.slack


def test_what_survives_with_few_arms_is_tried_with_all():
    """1 mm is short: of few arms none fails by that, of all some do."""
    plans = Formulas(always=1e-3, seen=7e-4, by_effort=2.5, enough_effort=0.9, price=10.0)
    found = plans.answer()
    few = [tried for tried in plans.made if tried.survives and tried.verdict.runs < WORKING.runs]
    assert few
    assert found.survives
    assert found.verdict.runs >= WORKING.runs
    assert found.tightening.radius[0] > 0


def test_of_failing_plans_the_share_counts_not_the_number():
    """12 of 16 are worse than 17 of 32."""
    plans = Formulas()
    tried = plans.simulated(plans.kept(), plans.planned(plans.kept(), None), WORKING)
    few, every = (
        replace(tried, verdict=RunVerdict(*counts, {}, None, 0.0))
        for counts in ((16, 12), (32, 17))
    )
    assert tightening._better(few, every) is tightening._better(every, few) is every


def radii_of_many(plans):
    return [float(tried.tightening.radius[0]) for tried in plans.made if tried.verdict.runs == 96]


def test_what_many_arms_need_more_is_kept_back_as_well():
    """0.2 mm more is short of them, of which a tenth of 1 mm was kept back."""
    plans = Formulas(more={MANY: 2e-4})
    found = plans.answer()
    assert found.survives and found.verdict.runs == MANY.runs
    assert radii_of_many(plans) == pytest.approx([1.1e-3, 1.21e-3])
    assert found.tightening.radius[0] == radii_of_many(plans)[-1]


@pytest.mark.parametrize(
    ("formulas", "count", "survives"),
    [
        ({"more": {MANY: 5e-5}}, 1, True),
        ({"always": 12e-3, "links_meet": 0.1}, 1, False),
        ({"most_radius": 1.15e-3, "more": {MANY: 2e-4}}, 1, False),  # with more there is no plan
        ({"slack": 1.15e-3, "more": {MANY: 2e-3}}, 6, False),
    ],
)
def test_it_is_tried_with_many_arms_until_it_survives_or_no_more_can_be(formulas, count, survives):
    """Where none survives, it is what fails least."""
    plans = Formulas(**formulas)
    found = plans.answer()
    assert (len(radii_of_many(plans)), found.survives) == (count, survives)
    assert found.verdict.runs == MANY.runs


FRESH = Draw(200, 1)


def test_arms_that_failed_afterwards_make_it_safer():
    plans = Formulas(more={FRESH: 2e-4})
    survivor = plans.answer()
    found = safer_plan(plans, survivor, FRESH)
    assert survivor.tightening.radius == pytest.approx([1.1e-3])
    assert found.tightening.radius == pytest.approx([1.21e-3])
    assert found.survives and found.verdict.runs == MANY.runs
    assert safer_plan(Formulas(most_radius=1.15e-3, more={FRESH: 2e-4}), survivor, FRESH) is None
    never = Formulas(slack=1.15e-3, more={FRESH: 2e-4, MANY: 2e-3})
    assert safer_plan(never, survivor, FRESH) is None


def test_every_part_is_kept_back_by_what_it_lacks_itself():
    none, joints = np.zeros(1), np.zeros((2, 2))
    now = Tightening(0.9, np.array([0.8, 0.8]), none, none + 0.1, 0.01, joints)
    velocity = np.array([0.7, 0.9])
    wanted = replace(
        now, rotation=none + 0.2, clearance=0.006, position=joints + 0.3, velocity=velocity
    )
    allowed = SimpleNamespace(allowed=lambda asked: asked)
    found = tightening._next(allowed, SimpleNamespace(tightening=now, target=wanted))
    assert (found.effort, found.radius.tolist()) == (0.9, [0.0])
    assert found.velocity == pytest.approx([0.8 - 1.1 * 0.1, 0.85])
    assert found.rotation == pytest.approx([0.1 + 1.1 * 0.1])
    assert found.clearance == pytest.approx(0.008)
    assert found.position == pytest.approx(1.1 * (joints + 0.3))
    tried = SimpleNamespace(tightening=now, target=wanted)
    safer = tightening._next(allowed, tried, given_back=0.0)
    assert (safer.clearance, safer.velocity.tolist()) == (0.01, pytest.approx([0.69, 0.8]))
