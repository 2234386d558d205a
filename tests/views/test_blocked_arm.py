"""The arm where it is blocked, and where solids touch."""

from dataclasses import replace

import numpy as np
import pytest

from asked_problems import PLANAR
from tubeplanner import Explanation, load_problem, parse_problem, plan
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.views.blocked_arm import blocked_arm, contact_point

PROBLEM = parse_problem(PLANAR)
HERE = np.array([0.4, -1.3])
REACH = 0.6  # of the two links together [m]


def found_with(place, configuration=None):
    result = PlanResult(PlanStatus.TUBE_BLOCKED, "", place, "refinement")
    result = replace(result, configuration=configuration)
    return Explanation("name", PROBLEM, result, None)


def test_the_arm_is_where_planning_met_what_blocks():
    shown = blocked_arm(PROBLEM, found_with(Place(), HERE))
    assert shown.name == "where it is blocked"
    np.testing.assert_allclose(shown.tool, PROBLEM.robot.tool_position(HERE[None]))


@pytest.mark.parametrize("away", [0.0, 0.1])
def test_the_arm_is_as_near_to_the_place_as_it_comes(away):
    target = np.array([0.6, 0.8, 0]) * (0.5 if away == 0 else REACH + away)
    shown = blocked_arm(PROBLEM, found_with(Place().at(target)))
    assert np.linalg.norm(shown.tool[0] - target) == pytest.approx(away, abs=1e-4)
    near = "100 mm from where it must be" if away else "where it is blocked"
    assert shown.name == near


def test_of_no_place_nothing_is_known():
    assert blocked_arm(PROBLEM, found_with(Place(joint="joint1"))) is None


def test_solids_touch_between_them():
    post = {"name": "post", "sphere": 0.05, "position": [0.45, -0.3, 0.0]}
    problem = parse_problem({**PLANAR, "obstacles": [post]})
    result = plan(problem, PlanOptions(quality="fast"))
    assert result.place.obstacle == "post"
    point = contact_point(problem, result.place, result.configuration)
    assert np.linalg.norm(point - post["position"]) < 0.1
    assert contact_point(problem, result.place, None) is None
    assert contact_point(problem, Place(joint="joint1"), HERE) is None


def test_of_a_link_of_several_pieces_the_deepest_counts():
    block = {"name": "block", "sphere": 0.05, "position": [0.3, -0.3, 0.45]}
    problem = load_problem("example:ur5/over_the_wall", changes={"obstacles": [block]})
    pairs = problem.collision.between("forearm_link", "block")
    assert pairs.sum() > 1
    point = contact_point(problem, Place(links=("forearm_link",), obstacle="block"), problem.start)
    assert np.linalg.norm(point - block["position"]) < 0.3
