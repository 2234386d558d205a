import numpy as np
import pytest

from cases import PROBLEMS
from gantry import URDF
from tubeplanner import load_problem, load_robot
from tubeplanner.robot.reach_bound import reach_bound


@pytest.mark.parametrize("name", PROBLEMS)
def test_no_configuration_has_the_tool_outside(name):
    robot = load_problem(f"example:{name}").robot
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (2000, robot.joint_count))
    beyond = reach_bound(robot).beyond(robot.tool_position(q))
    assert beyond.max() <= 1e-9


def test_stretched_out_the_tool_is_on_its_edge(two_link):
    bound = reach_bound(two_link)
    assert bound.radius == pytest.approx(0.6)
    assert bound.beyond(two_link.tool_position(np.zeros((1, 2))))[0] == pytest.approx(0.0)


def test_a_sliding_joint_reaches_as_far_as_its_range(tmp_path):
    (tmp_path / "gantry.urdf").write_text(URDF)
    gantry = load_robot(tmp_path / "gantry.urdf", "head")
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    bound = reach_bound(gantry)
    assert np.isfinite(bound.radius)
    assert bound.beyond(gantry.tool_position(corners)).max() <= 1e-9
