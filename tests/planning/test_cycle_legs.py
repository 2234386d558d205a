"""A closed cycle whose last end is open: it ends where it began, and its ends are shared."""

import numpy as np
import pytest
from small_cycle import cycle_of, move

from tubeplanner import PlanOptions
from tubeplanner.planning.strategy import plan_cycle
from tubeplanner.task.cycle_file import parse_cycle

HOME = [-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0]
THERE, BACK = [0.45, 0.0, 0.35], [0.45, -0.3, 0.2]
CYCLE = {
    "format": "tubeplanner/cycle",
    "robot": {"urdf": "example:ur5", "tool_frame": "tool0", "limits": {"acceleration": 15}},
    "start": {"joints": HOME},
    "closed": True,
    "moves": [
        {"name": "there", "tube": {"points": [BACK, THERE], "radius": 0.1}},
        {"event": "look"},
        {"name": "back", "tube": {"points": [THERE, BACK], "radius": 0.1}},
    ],
}
SHORTEST = PlanOptions(quality="fast", slack=0.0)


def test_open_moves_of_a_closed_cycle_lead_back_to_a_given_start():
    result = plan_cycle(parse_cycle(CYCLE), SHORTEST)
    assert result.succeeded, result.message
    trajectory = result.motion.trajectory
    np.testing.assert_allclose(trajectory.position([0.0])[0], HOME, atol=1e-9)
    np.testing.assert_allclose(trajectory.position([trajectory.duration])[0], HOME, atol=1e-6)


def test_where_a_closed_cycle_begins_is_chosen_where_it_is_open():
    """The hand of this arm is turned as it likes."""
    result = plan_cycle(parse_cycle({**CYCLE, "start": {"seed": HOME}}), SHORTEST)
    assert result.duration < result.greedy_duration - 0.002
    begin, end = result.motion.junctions[0], result.motion.junctions[-1]
    assert abs(end - begin).max() < 1e-9
    assert abs(begin - HOME).max() > 0.02
    np.testing.assert_allclose(result.motion.cycle.robot.tool_position(begin), BACK, atol=1e-6)


@pytest.mark.parametrize("kind", ["seed", "joints"])
def test_moves_that_end_in_balls_save_as_much_whether_the_start_is_given_or_not(kind):
    """The arm reaches where the first tube begins in one way: the start itself is not open."""
    ways = [move(way, way, tolerance=0.05) for way in ("ab", "bc", "ca")]
    elbow = -2 * np.arccos(np.hypot(0.45, 0.3) / 0.6)  # of two links of 0.3 m, the tool at a
    start = [float(np.arctan2(-0.3, 0.45) - elbow / 2), float(elbow)]
    result = plan_cycle(cycle_of(*ways, closed=True, start={kind: start}), SHORTEST)
    assert result.duration < result.greedy_duration - 0.018
    np.testing.assert_allclose(result.motion.junctions[0], start, atol=1e-6)
    np.testing.assert_allclose(result.motion.junctions[-1], start, atol=1e-6)
