"""The search for what to keep back, held against plans whose durations and runs are formulas."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner.planning import kept_back
from tubeplanner.planning.kept_back import MANY, WORKING, surviving_plan
from tubeplanner.planning.tightened_plans import TriedPlan
from tubeplanner.problem.tightening import Tightening
from tubeplanner.refinement.sensitivities import Sensitivity
from tubeplanner.simulation.run_verdict import RunVerdict

RADIUS = 0.01  # [m]
SHARES = np.array(kept_back._EFFORTS)


@dataclass
class Formulas:
    """Plans of one segment: T0 (1 + a (1 - e) + b (1 - v)) + p r + q r^2, of shares e and v.

    Runs lack c + s ((e - e0)+)^2 + w (v - v0)+ - g r of radius. Some fail where more than `seen` is
    short, of few runs where it is twice as much: less is seen of few than is expected of many.
    """

    slower: float = 0.5  # a
    slower_by_velocity: float = 0.0  # b
    price: float = 0.4  # p [s/m]
    curvature: float = 0.0  # q [s/m^2]
    always: float = 1e-3  # c [m]
    by_effort: float = 0.0  # s [m]
    enough_effort: float = 0.5  # e0
    by_velocity: float = 0.0  # w [m]
    enough_velocity: float = 0.8  # v0
    gain: float = 1.0  # g
    seen: float = 0.0  # [m]
    room: float = 0.9 * RADIUS  # [m]
    least_effort: float = 0.0  # below it there is no plan
    most_radius: float = 1.0  # [m]: with more kept back there is none either
    links_meet: float = 0.0
    velocity_elasticity: float = 0.0
    taken: list = field(default_factory=list)  # radii of plans with all arms
    made: list = field(default_factory=list)

    @staticmethod
    def kept(effort=1.0, radius=0.0, velocity=1.0):
        none = np.zeros(1)
        return Tightening(effort, velocity, np.array([radius]), none, 0.0, np.zeros((2, 2)))

    def duration(self, kept):
        radius = float(kept.radius[0])
        share = self.slower * (1 - kept.effort) + self.slower_by_velocity * (1 - kept.velocity)
        return 1 + share + self.price * radius + self.curvature * radius**2

    def short(self, kept):
        beyond = max(kept.effort - self.enough_effort, 0)
        fast = max(kept.velocity - self.enough_velocity, 0)
        asked = self.always + self.by_effort * beyond**2 + self.by_velocity * fast
        return asked - self.gain * float(kept.radius[0])

    def problem(self, kept):
        return kept

    def allowed(self, kept):
        return replace(kept, radius=np.minimum(kept.radius, self.room))

    def planned(self, kept, motion):
        if kept.effort < self.least_effort or kept.radius[0] > min(self.room, self.most_radius):
            return None
        prices = (
            Sensitivity("effort", "joint1", None, -0.4, 0.0),
            Sensitivity("velocity", "joint1", None, self.velocity_elasticity, 0.0),
        )
        return SimpleNamespace(
            duration=self.duration(kept),
            motion=None,
            stopped_by=None,
            sensitivities=prices,
            trajectory=object(),
            lacks=0.0,
        )

    def simulated(self, kept, result, draw):
        short = self.short(kept) + result.lacks
        asked = max(float(kept.radius[0]) + short, 0.0)
        wanted = min(asked, self.room)
        seen = self.seen if draw.runs >= WORKING.runs else 2 * self.seen
        failed = int(np.ceil(np.clip((short - seen) / RADIUS, 0, 1) * draw.runs))
        price = self.price + 2 * self.curvature * float(kept.radius[0])
        tried = TriedPlan(
            kept_back=kept,
            result=result,
            verdict=RunVerdict(draw.runs, failed, {"tube": failed}),
            shortfall=None,
            wanted=self.kept(kept.effort, wanted, kept.velocity),
            lacking=(asked - wanted) / RADIUS + self.links_meet,
            expected=result.duration + price * (wanted - float(kept.radius[0])),
        )
        self.made.append(tried)
        if draw == WORKING:
            self.taken.append(float(kept.radius[0]))
        return tried

    def tried(self, kept, motion, draw):
        result = self.planned(kept, motion)
        return None if result is None else self.simulated(kept, result, draw)

    def answer(self, follow=lambda problem, shortest: shortest):
        nothing = self.kept()
        start = self.simulated(nothing, self.planned(nothing, None), WORKING)
        self.made.clear(), self.taken.clear()
        return surviving_plan(self, start, follow)

    @property
    def survivors(self):
        return [tried for tried in self.made if tried.survives and tried.verdict.runs == MANY.runs]


@pytest.mark.parametrize("best", [0.975, 0.955, 0.93, 0.905, 0.875, 0.83, 0.75, 0.66, 0.6])
def test_the_share_of_effort_is_that_of_the_least_expected_duration(best):
    """That is least where a T0 = 2 p s (e - e0), and of its shares at the nearest to that."""
    price, slower, beyond = 0.4, 0.1, 0.2
    plans = Formulas(
        price=price,
        slower=slower,
        enough_effort=best - beyond,
        by_effort=slower / (2 * price * beyond),
        room=1.0,
    )
    found = plans.answer()
    assert found.survives
    assert found.kept_back.effort == SHARES[abs(SHARES - best).argmin()]


def test_no_effort_is_kept_back_where_radii_are_cheaper():
    plans = Formulas(enough_effort=0.9, by_effort=0.05)
    found = plans.answer()
    assert found.survives and found.kept_back.effort == 1.0
    assert len(plans.made) < 5


VELOCITY = {"slower_by_velocity": 0.02, "by_velocity": 0.2, "enough_velocity": 0.925, "room": 1.0}


def test_where_velocity_binds_its_share_is_looked_for_as_well():
    """Down to 0.93, from which on nothing more is gained by it; beside the best effort."""
    found = Formulas(velocity_elasticity=-0.3, **VELOCITY).answer()
    assert (found.kept_back.velocity, found.kept_back.effort) == (0.93, 1.0)
    both = {"by_effort": 2.0, "enough_effort": 0.91, "slower": 0.1}
    found = Formulas(velocity_elasticity=-0.3, **VELOCITY, **both).answer()
    assert (found.kept_back.velocity, found.kept_back.effort) == (0.93, 0.98)


def test_where_it_does_not_bind_it_is_left_alone():
    found = Formulas(velocity_elasticity=-0.001, **VELOCITY).answer()
    assert found.survives and found.kept_back.velocity == 1.0


def test_what_is_short_is_taken_and_of_what_is_to_spare_half_is_given_back():
    plans = Formulas(price=40.0, slower=5.0)
    found = plans.answer()
    first, second = plans.taken
    assert 1e-3 < first < 1.2e-3
    assert second - 1e-3 == pytest.approx((first - 1e-3) / 2)
    assert found.kept_back.radius[0] == second


def test_what_gains_little_is_not_given_back():
    plans = Formulas(price=4.0)
    found = plans.answer()
    assert plans.taken == [found.kept_back.radius[0]]


def test_it_is_taken_again_until_no_run_fails():
    """Radii help by 8 mm in 10: what is short is never seen to the end, but less and less is."""
    plans = Formulas(gain=0.8, seen=1e-5)
    found = plans.answer()
    assert found.survives
    assert plans.taken == sorted(plans.taken)
    assert len(plans.taken) == 3
    assert found.kept_back.radius[0] == plans.taken[-1] < 1e-3 / 0.8


def test_giving_back_too_much_leaves_the_survivor():
    """With less radius given back than half, runs fail again."""

    class Sudden(Formulas):
        def short(self, kept):
            radius = float(kept.radius[0])
            return -5e-4 if radius >= 1.08e-3 else 1e-3 - radius

    plans = Sudden(price=40.0, slower=5.0)
    found = plans.answer()
    assert [tried.survives for tried in plans.made if tried.verdict.runs == 32] == [True, False]
    assert found.kept_back.radius[0] == plans.taken[0]
    assert found is plans.survivors[0]


@pytest.mark.parametrize(
    "formulas",
    [
        {"slower": 0.2, "price": 1.0, "curvature": 4e3, "by_effort": 0.05, "enough_effort": 0.8},
        {"slower": 0.1, "price": 4.0, "curvature": 8e3, "by_effort": 0.1, "enough_effort": 0.7},
        {"slower": 0.1, "price": 4.0, "curvature": 8e3, "by_effort": 0.2, "enough_effort": 0.8},
    ],
)
def test_less_effort_is_tried_where_radii_cost_more_than_expected(formulas):
    """The price rises with the radius; of what survives the shortest is the answer."""
    plans = Formulas(**formulas)
    at = [plans.kept(effort) for effort in SHARES]
    expected = [plans.duration(kept) + plans.price * plans.short(kept) for kept in at]
    found = plans.answer()
    assert found.survives
    assert found.kept_back.effort < SHARES[int(np.argmin(expected))]
    assert found.duration == min(tried.duration for tried in plans.survivors)


def test_less_effort_is_tried_where_nothing_was_found_with_more():
    """With 3 mm kept back there is no plan: little enough is short with 96 % of the effort."""
    plans = Formulas(by_effort=0.4, enough_effort=0.9, most_radius=3e-3)
    found = plans.answer()
    assert found.survives and found.kept_back.effort == 0.96
    never = Formulas(most_radius=5e-4).answer()
    assert not never.survives


def test_where_less_effort_does_not_help_at_once_still_less_is_tried():
    """Runs are lost with more than 80 % of it, by however much more."""

    class Lost(Formulas):
        def short(self, kept):
            return (0.02 if kept.effort > 0.8 else 1e-3) - float(kept.radius[0])

    found = Lost().answer()
    assert found.survives and found.kept_back.effort == 0.79


def test_where_not_all_that_is_wanted_is_allowed_effort_makes_up_for_it():
    """Little slower with all the effort, but there is no room for the radius that it takes."""
    plans = Formulas(by_effort=0.2, enough_effort=0.6, price=0.1, room=4e-3)
    found = plans.answer()
    assert found.survives
    enough = 0.6 + np.sqrt(3e-3 / 0.2)
    assert found.kept_back.effort <= enough
    assert found.kept_back.effort in [share for share in SHARES if share <= enough][:2]


def test_where_nothing_survives_it_is_what_fails_least():
    """Links that meet leave nothing to have: all shares are tried, and the least failing is it."""
    plans = Formulas(always=12e-3, by_effort=0.01, links_meet=0.1, least_effort=0.7)
    found = plans.answer()
    assert not found.survives
    share = [tried.verdict.failed / tried.verdict.runs for tried in plans.made]
    assert found.verdict.failed / found.verdict.runs == min(share)
    assert found.kept_back.effort < 1
    assert found.kept_back.radius[0] == plans.room


def test_no_more_is_taken_than_there_is_room_for():
    """All that is short could be had, a tenth more could not."""
    plans = Formulas(room=1.02e-3)
    found = plans.answer()
    assert found.survives
    assert found.kept_back.radius[0] == plans.room


def test_what_survives_with_few_arms_is_tried_with_all():
    """1 mm is short: of few arms none fails by that, of all some do."""
    plans = Formulas(always=1e-3, seen=7e-4, by_effort=2.5, enough_effort=0.9, price=10.0)
    found = plans.answer()
    few = [tried for tried in plans.made if tried.survives and tried.verdict.runs < WORKING.runs]
    assert few
    assert found.survives
    assert found.verdict.runs >= WORKING.runs
    assert found.kept_back.radius[0] > 0


def test_of_failing_plans_the_share_counts_not_the_number():
    """12 of 16 are worse than 17 of 32."""
    plans = Formulas()

    def failing(failed, runs):
        tried = plans.simulated(plans.kept(), plans.planned(plans.kept(), None), WORKING)
        return replace(tried, verdict=RunVerdict(runs, failed, {}))

    few, all_ = failing(12, 16), failing(17, 32)
    assert kept_back._better(few, all_) is all_
    assert kept_back._better(all_, few) is all_


def following(lacks, trajectory=object):
    """What makes plans that take 1 % longer and whose runs lack so much more [m]."""
    given = []

    def follow(problem, shortest):
        given.append((problem, shortest))
        return SimpleNamespace(
            duration=1.01 * shortest.duration,
            motion=None,
            stopped_by=None,
            sensitivities=(),
            trajectory=trajectory(),
            lacks=lacks,
        )

    return follow, given


def test_what_is_written_survives_as_well():
    """0.2 mm more is short of it, of which a tenth of 1 mm was kept back."""
    plans = Formulas()
    follow, given = following(2e-4)
    found = plans.answer(follow)
    assert found.survives
    assert [float(problem.radius[0]) for problem, _ in given] == pytest.approx([1.1e-3, 1.21e-3])
    assert found.kept_back is given[1][0]
    assert found.duration == 1.01 * given[1][1].duration
    assert given[1][1].duration == plans.duration(found.kept_back)


def test_what_is_written_and_survives_at_once_is_the_answer():
    follow, given = following(5e-5)
    found = Formulas().answer(follow)
    assert len(given) == 1
    assert found.survives and found.duration == 1.01 * given[0][1].duration


def test_where_nothing_else_is_written_it_is_the_shortest_itself():
    plans = Formulas()
    found = plans.answer()
    assert found.result.lacks == 0.0
    assert len(plans.taken) == 1
    follow, given = following(2e-4, trajectory=lambda: None)
    assert plans.answer(follow).duration == given[0][1].duration


def test_what_is_written_is_so_once_where_none_survives():
    follow, given = following(2e-4)
    found = Formulas(always=12e-3, links_meet=0.1).answer(follow)
    assert len(given) == 1
    assert not found.survives and found.result.lacks == 2e-4


def test_where_no_more_room_is_left_for_what_is_written_it_is_what_fails_least():
    plans = Formulas(room=1.15e-3)
    follow, given = following(2e-3)
    found = plans.answer(follow)
    assert len(given) == 5
    assert not found.survives
    assert float(found.kept_back.radius[0]) == plans.room


def test_of_what_is_written_and_fails_it_is_what_fails_least():
    """The more is kept back after the first, the more fail."""

    class Worse(Formulas):
        def short(self, kept):
            radius = float(kept.radius[0])
            return 1e-3 - radius if radius < 1.15e-3 else radius

    follow, given = following(2e-3)
    found = Worse().answer(follow)
    assert len(given) == 5
    assert found.kept_back.radius[0] == given[0][0].radius[0] == pytest.approx(1.1e-3)


def test_where_there_is_no_plan_to_write_with_more_it_is_what_was_written():
    follow, given = following(2e-4)
    found = Formulas(most_radius=1.15e-3).answer(follow)
    assert len(given) == 1
    assert not found.survives and found.result.lacks == 2e-4


def test_every_part_is_kept_back_by_what_it_lacks_itself():
    none, joints = np.zeros(1), np.zeros((2, 2))
    now = Tightening(0.9, 0.8, none, none + 0.1, 0.01, joints)
    wanted = replace(now, rotation=none + 0.2, clearance=0.006, position=joints + 0.3)
    allowed = SimpleNamespace(allowed=lambda asked: asked)
    found = kept_back._next(allowed, SimpleNamespace(kept_back=now, wanted=wanted))
    assert (found.effort, found.velocity, found.radius.tolist()) == (0.9, 0.8, [0.0])
    assert found.rotation == pytest.approx([0.1 + 1.1 * 0.1])
    assert found.clearance == pytest.approx(0.008)
    assert found.position == pytest.approx(1.1 * (joints + 0.3))
