"""How much farther apart pairs of shapes are than they must be."""

import numpy as np

from tubeplanner import parse_problem
from tubeplanner.measurement.pair_clearance import PairClearance

BARE = {
    "robot": {"urdf": "example:asr_twodof", "tool_frame": "Tip"},
    "start": {"joints": [0.0, 0.9]},
    "goal": {"joints": [1.0, 0.9]},
}


def test_an_arm_without_geometry_is_clear_of_everything():
    problem = parse_problem(BARE, reads_tube=False)
    least = PairClearance(problem, 0.01).least(np.zeros((3, 2)), near=1.0)
    assert (least.clearance == np.inf).all()
