import numpy as np

from tubeplanner.branches.joint_middle import half_ranges, middle_of

LOWER = np.array([-1.0, 2.0, -np.inf, 1.0, -np.inf])
UPPER = np.array([3.0, 2.0, np.inf, np.inf, -2.0])


def test_open_ranges_have_a_middle_too():
    assert middle_of(LOWER, UPPER).tolist() == [1.0, 2.0, 0.0, 1.0, -2.0]
    assert half_ranges(LOWER, UPPER).tolist() == [2.0, 0.0, np.pi, np.pi, np.pi]
