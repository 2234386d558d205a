"""A problem whose cell is moved together with its robot is the same problem."""

import copy

import numpy as np
import pytest

from cases import PROBLEMS, SHORTEST
from placed_problem import SHIFT, TURN, bundled_fields, placed_fields
from stored_trajectories import REFINEMENT
from tubeplanner import ProblemError, RobotError, parse_problem, plan, verify
from tubeplanner.collision.link_covers import link_covers
from tubeplanner.files.fingerprint import problem_hash
from tubeplanner.resources import bundled_problems

# FCL finds a distance this well [m].
ROUNDING = 1e-5
PLACES = {"shifted": SHIFT, "turned": TURN}


def placed(name, place):
    folder = bundled_problems()[name].parent
    return parse_problem(placed_fields(bundled_fields(name), PLACES[place]), folder)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_judge_finds_the_same_margins(name, place, bundled, stored):
    _, trajectory = stored(name, REFINEMENT)
    expected = verify(bundled(name), trajectory).conditions
    found = verify(placed(name, place), trajectory).conditions
    assert found.keys() == expected.keys()
    for condition, one in found.items():
        if one.margin is None:  # nothing is asked
            assert expected[condition].margin is None
        else:
            rounding = ROUNDING if condition in ("obstacles", "self_collision") else 1e-9
            assert one.margin == pytest.approx(expected[condition].margin, rel=1e-6, abs=rounding)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["two_link/around_a_post", "ur5/over_the_wall", "ur5/level_tray"])
def test_it_has_the_same_answer(name, place, bundled):
    result, other = plan(bundled(name), SHORTEST), plan(placed(name, place), SHORTEST)
    assert other.duration == pytest.approx(result.duration, rel=2e-4)
    start, begun = (each.trajectory.position(0.0) for each in (result, other))
    np.testing.assert_allclose(begun, start, rtol=0, atol=1e-9)


def test_a_moved_base_alone_is_another_problem(bundled):
    name = "ur5/over_the_wall"
    fields = bundled_fields(name)
    fields["robot"]["base"] = {"position": [0.01, 0.0, 0.0]}
    with pytest.raises(ProblemError, match="start: the tool is at"):
        parse_problem({**fields, "tube": {**fields["tube"], "radius": 0.005}})
    assert problem_hash(parse_problem(fields)) != problem_hash(bundled(name))


def test_covers_and_pairs_of_links_are_those_of_the_arm_alone(bundled):
    plain, turned = bundled("ur5/over_the_wall"), placed("ur5/over_the_wall", "turned")
    assert turned.collision.left_out == plain.collision.left_out
    np.testing.assert_array_equal(turned.collision.pairs, plain.collision.pairs)
    assert link_covers(turned.collision) == link_covers(plain.collision)


def test_links_that_stand_are_seen_by_those_that_move(bundled):
    plain, turned = bundled("ur5/over_the_wall"), placed("ur5/over_the_wall", "turned")
    q = np.random.default_rng(3).uniform(-2, 2, (20, 6))
    distances = []
    for problem in (plain, turned):
        checker = problem.collision
        poses = [checker.robot.body_poses(each) for each in q]
        distances.append([checker.distances(*pose, checker.pairs) for pose in poses])
    np.testing.assert_allclose(distances[1], distances[0], rtol=0, atol=ROUNDING)


def test_a_base_that_is_none_names_the_problem():
    fields = copy.deepcopy(bundled_fields("ur5/over_the_wall"))
    fields["robot"]["base"] = {"rpy": [0, 0, 0], "quaternion": [0, 0, 0, 1]}
    with pytest.raises(RobotError, match=r"problem: robot\.base takes rpy or quaternion, not both"):
        parse_problem(fields)
