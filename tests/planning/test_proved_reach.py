import numpy as np
import pytest

from tubeplanner import PlanningProblem, PlanStatus, Seed, Tube, plan
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.proved_reach import require_within_bound

SEED = Seed(np.array([0.0, -1.0]))  # of an arm that reaches 0.6 m


def problem_of(two_link, points, radius=0.03):
    return PlanningProblem(two_link, Tube(points, radius), SEED)


@pytest.mark.parametrize(("far", "proved"), [(0.599, False), (0.61, True)])
def test_a_goal_beyond_all_links_is_proved(two_link, far, proved):
    problem = problem_of(two_link, [[0.3, -0.3, 0], [far, 0, 0]])
    if not proved:
        require_within_bound(problem)
        return
    with pytest.raises(Infeasible, match=r"at least 0\.01 m nearer") as caught:
        require_within_bound(problem)
    assert caught.value.proved
    assert caught.value.place.point == 1
    result = plan(problem)
    assert result.status is PlanStatus.UNREACHABLE
    assert result.proved
    assert result.message.endswith("; proved: there is no motion")


@pytest.mark.parametrize(("far", "proved"), [(0.868, False), (0.88, True)])
def test_a_corner_may_be_cut_as_far_as_the_tube_is_wide(two_link, far, proved):
    """Capsules of 0.1 m about legs of slope 2 to 5 meet up to 0.269 m from their corner."""
    points = [[far - 0.5, -0.2, 0], [far, 0, 0], [far - 0.5, 0.2, 0]]
    problem = problem_of(two_link, points, 0.1)
    if not proved:
        require_within_bound(problem)
        return
    with pytest.raises(Infeasible, match=r"may stay 0\.2693 m away") as caught:
        require_within_bound(problem)
    assert caught.value.place.point == 1


def test_where_it_starts_may_be_left_aside(two_link):
    problem = problem_of(two_link, [[0.7, 0, 0], [0.3, 0, 0]])
    with pytest.raises(Infeasible, match="move the start at least"):
        require_within_bound(problem)
    require_within_bound(problem, start_is_known=False)
