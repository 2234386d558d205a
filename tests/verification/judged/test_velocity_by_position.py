"""Velocity limits that fall towards the ends, against closed forms: a bar that turns."""

import numpy as np
import pytest

from cases import anywhere, one_joint, quintic
from tubeplanner import JointTrajectory, Tolerance, verify
from tubeplanner.verification.judged import velocity_by_position
from tubeplanner.verification.judged.velocity_by_position import velocity_by_position_left
from tubeplanner.verification.judged_motion import JudgedMotion

DECELERATION, OFFSET, LOWER, UPPER, LARGEST = 4.0, 0.6, -1.0, 2.0, 3.0
ZONE = OFFSET**2 / (2 * DECELERATION)
LAW = {"deceleration": DECELERATION, "offset": OFFSET, "lower": LOWER, "upper": UPPER}


@pytest.fixture
def bar(tmp_path):
    def limited(velocity=LARGEST, **changes):
        law = {"velocity_by_position": LAW | changes}
        return anywhere(one_joint(tmp_path, velocity=velocity, **law))

    return limited


def judged(problem, trajectory):
    return velocity_by_position_left(JudgedMotion(problem, trajectory, Tolerance()))


def line(start, velocity, duration=0.1):
    """Return a joint that moves on at one velocity."""
    return JointTrajectory(["turn"], [0, duration], np.array([[[velocity]], [[start]]]))


def left(q, v, offset=OFFSET):
    """Return what the law leaves at an instant, relative."""
    to_go = max(UPPER - q, 0.0) if v > 0 else max(q - LOWER, 0.0)
    return (max(0.0, np.sqrt(2 * DECELERATION * to_go) - offset) - abs(v)) / LARGEST


@pytest.mark.parametrize(
    ("start", "velocity"),
    [(0.0, 1.5), (1.0, 2.0), (1.8, 1.0), (0.0, -1.5), (-0.7, -1.0), (1.9, 1.5), (1.93, 1e-3)],
)
def test_on_a_line_the_end_of_it_decides(bar, start, velocity):
    trajectory = line(start, velocity)
    condition = judged(bar(), trajectory)
    worst = left(start + 0.1 * velocity, velocity)
    assert condition.margin == pytest.approx(worst, abs=2e-9)
    assert condition.where.joint == "turn"
    assert condition.where.time == pytest.approx(0.1, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [1 - 1e-6, 1 + 1e-6])
def test_a_millionth_decides_between_samples(bar, sign, share):
    """A quintic that touches the law somewhere in the middle, by its duration."""
    end = 0.9 * (UPPER - ZONE) if sign > 0 else 0.9 * (LOWER + ZONE)
    shape = quintic(end, 1.0)
    at = shape.at(np.linspace(0, 1, 400_001)[1:-1])
    to_go = UPPER - at.position[:, 0] if sign > 0 else at.position[:, 0] - LOWER
    slowest = (abs(at.velocity[:, 0]) / (np.sqrt(2 * DECELERATION * to_go) - OFFSET)).max()
    trajectory = shape.scaled(slowest * share)
    condition = judged(bar(), trajectory)
    assert (condition.margin > 0) == (share > 1)
    assert abs(condition.margin) < 1.1e-6
    assert 0 < condition.where.time < trajectory.duration
    failures = verify(bar(), trajectory, Tolerance(1e-6, 1e-8)).failures()
    assert ("velocity" in failures) == (share < 1)


def test_a_short_bump_is_found(bar):
    """A thousandth of the duration, at ten times the velocity of the rest."""
    times = np.cumsum([0.0, 0.3171, 0.001, 0.7])
    rates = np.array([0.1, 1.5, 0.1])
    places = 1.5 + np.cumsum([0.0, *(rates * np.diff(times))])[:-1]
    trajectory = JointTrajectory(["turn"], times, np.array([rates, places])[:, :, None])
    condition = judged(bar(), trajectory)
    assert condition.margin == pytest.approx(left(places[2], 1.5), abs=1e-6)
    assert 0.3171 <= condition.where.time <= 0.3181


@pytest.mark.parametrize(
    ("start", "velocity", "margin"),
    [
        (UPPER, 0.0, 0.0),
        (UPPER - ZONE / 2, 0.0, 0.0),
        (UPPER - ZONE / 2, 1e-9, -1e-9 / LARGEST),
        (UPPER - ZONE / 2, 1e-3, -1e-3 / LARGEST),
        (LOWER, 0.0, 0.0),
        (UPPER + 0.5, 0.0, 0.0),
    ],
)
def test_where_it_must_not_move_on_it_may_rest(bar, start, velocity, margin):
    condition = judged(bar(), line(start, velocity))
    assert condition.margin == pytest.approx(margin, abs=1e-12)
    assert condition.coverage == "for all t"


@pytest.mark.parametrize(("start", "goal"), [(UPPER, 0.0), (LOWER, 1.0)])
def test_leaving_an_end_asks_nothing_of_that_end(bar, start, goal):
    """However fast: what is left is that of the other end, or nothing where it rests."""
    move = quintic(goal - start, 0.3)
    rows = move.coefficients.copy()
    rows[-1] += start
    condition = judged(
        bar(offset=0.0, lower=-1e4, upper=1e4), JointTrajectory(["turn"], [0, 0.3], rows)
    )
    assert condition.margin > 0
    away = judged(
        bar(upper=UPPER if start > 0 else 1e4, lower=LOWER if start < 0 else -1e4),
        JointTrajectory(["turn"], [0, 0.3], rows),
    )
    assert away.margin == pytest.approx(0.0, abs=1e-9)


def test_without_an_offset_the_end_is_come_to_at_the_deceleration(bar):
    """v^2 = 2 d (u - q) all the way: the margin is 0 throughout, to rounding."""
    duration, speed = 0.5, DECELERATION * 0.5
    rows = np.array([-DECELERATION / 2, speed, UPPER - speed * duration / 2])[:, None, None]
    exact = JointTrajectory(["turn"], [0, duration], rows)
    problem = bar(offset=0.0)
    assert judged(problem, exact).margin == pytest.approx(0.0, abs=1e-6)
    assert judged(problem, exact.scaled(1.001)).margin > -1e-6
    assert judged(problem, exact.scaled(0.999)).margin < -1e-4


@pytest.mark.parametrize(("velocity", "largest"), [(LARGEST, LARGEST), (np.inf, np.sqrt(24.0))])
def test_it_is_relative_to_the_joints_largest(bar, velocity, largest):
    condition = judged(bar(velocity=velocity), line(1.8, 1.0))
    assert condition.margin == pytest.approx(left(1.9, 1.0) * LARGEST / largest, abs=1e-8)


def test_the_certificate_names_it_velocity(bar):
    """The worse of both: of the limit that does not change, or of the one that does."""
    slow, fast = line(1.5, 0.2), line(0.0, 2.9)
    conditions = [verify(bar(upper=5.0), motion).conditions["velocity"] for motion in (slow, fast)]
    assert conditions[0].margin == pytest.approx(1 - 0.2 / LARGEST)
    assert conditions[1].margin == pytest.approx(1 - 2.9 / LARGEST)
    near = verify(bar(), line(1.5, 1.2)).conditions["velocity"]
    assert near.margin == pytest.approx(left(1.62, 1.2), abs=1e-8)
    unlimited = verify(bar(velocity=np.inf), line(1.5, 1.2)).conditions["velocity"]
    assert unlimited.margin == pytest.approx(near.margin * LARGEST / np.sqrt(24), abs=1e-8)


def test_without_such_a_limit_it_is_not_required(tmp_path):
    condition = judged(anywhere(one_joint(tmp_path)), line(1.5, 1.2))
    assert condition.margin is None


def test_a_verdict_that_costs_too_much_is_undecided_and_safe(bar, monkeypatch):
    trajectory = quintic(1.7, 1.5)
    exact = judged(bar(), trajectory).margin
    monkeypatch.setattr(velocity_by_position, "_MAX_ROWS", 1)
    condition = judged(bar(), trajectory)
    assert "undecided" in condition.coverage
    assert condition.margin < exact
