"""A closed cycle whose last move gives no goal ends where it began."""

import numpy as np

from tubeplanner import PlanOptions
from tubeplanner.cycle.cycle_reader import parse_cycle
from tubeplanner.cycle_planning.cycle_planner import plan_cycle

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


def test_open_moves_of_a_closed_cycle_lead_back_to_a_given_start():
    result = plan_cycle(parse_cycle(CYCLE), PlanOptions(quality="fast"))
    assert result.succeeded, result.message
    trajectory = result.motion.trajectory
    np.testing.assert_allclose(trajectory.position([0.0])[0], HOME, atol=1e-9)
    np.testing.assert_allclose(trajectory.position([trajectory.duration])[0], HOME, atol=1e-6)
