import numpy as np

from tubeplanner.branches.outside_bounds import outside_bounds


def test_the_joint_farthest_outside_in_the_configuration_that_is_least_outside(two_link):
    found = np.array([[0.2, 3.0], [-1.3, 1.2]])
    outside = outside_bounds(two_link, found, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert outside.joint == 0
    assert not outside.is_above
    assert outside.words == "'joint1' would be at -1.3, outside [-1, 1]"
