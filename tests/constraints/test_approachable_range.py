"""How near to their ends joints come whose velocity limits fall towards these."""

import numpy as np
import pytest

from cases import anywhere, changed, one_joint
from tubeplanner.constraints.approachable_range import approachable_range, require_approachable
from tubeplanner.constraints.velocity_by_position import VelocityByPositionLimit
from tubeplanner.outcome import Infeasible

ZONE = 0.6**2 / 8
LAW = {"deceleration": 4.0, "offset": 0.6, "lower": -1.0, "upper": 2.0}


@pytest.fixture
def bar(tmp_path):
    def made(**changes):
        return anywhere(one_joint(tmp_path, velocity_by_position=LAW | changes))

    return made


def test_without_such_a_limit_there_is_no_bound(tmp_path):
    problem = anywhere(one_joint(tmp_path))
    assert approachable_range(problem)[0].tolist() == [-np.inf]
    assert approachable_range(problem)[1].tolist() == [np.inf]
    require_approachable(problem, np.zeros(1), np.full(1, 8.9))


def test_it_ends_where_a_hundredth_of_the_largest_velocity_is_left(bar):
    problem = bar()
    lower, upper = approachable_range(problem)
    limit = VelocityByPositionLimit(problem.robot.limits)
    assert limit.allowed(upper[None])[0, 0] == pytest.approx(0.01 * 4.0)
    assert limit.allowed(lower[None])[0, 1] == pytest.approx(0.01 * 4.0)


@pytest.mark.parametrize(("start", "goal"), [(1.99, 0.0), (0.0, 1.953), (-0.99, 1.99)])
def test_start_and_goal_are_inside(bar, start, goal):
    plain = approachable_range(bar())
    ends = [start, goal]
    problem = changed(bar(), start=np.array([start]), goal=np.array([goal]))
    lower, upper = approachable_range(problem)
    assert lower[0] == min(plain[0][0], *ends)
    assert upper[0] == max(plain[1][0], *ends)


def test_a_law_that_leaves_no_range_bounds_nothing(bar):
    lower, upper = approachable_range(bar(offset=30.0))
    assert (lower[0], upper[0]) == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("start", "goal", "offset", "passes"),
    [
        (0.0, 2.0 - ZONE - 1e-6, 0.6, True),
        (0.0, 2.0 - ZONE, 0.6, False),
        (0.0, 2.0 - ZONE / 2, 0.6, False),
        (2.0, 2.0 - ZONE / 2, 0.6, True),
        (2.0 - ZONE / 2, 2.0 - ZONE / 2, 0.6, True),
        (2.0 - ZONE / 2, 2.0, 0.6, False),
        (0.0, -1.0 + ZONE / 2, 0.6, False),
        (-1.0, -1.0 + ZONE / 2, 0.6, True),
        (0.0, 2.0, 0.0, True),
        (0.0, 2.1, 0.0, False),
    ],
)
def test_a_goal_is_come_to_only_where_the_law_lets_one(bar, start, goal, offset, passes):
    problem, ends = bar(offset=offset), (np.array([start]), np.array([goal]))
    if passes:
        require_approachable(problem, *ends)
        return
    with pytest.raises(Infeasible, match="allows it no velocity that way") as caught:
        require_approachable(problem, *ends)
    assert caught.value.place.joint == "turn"
