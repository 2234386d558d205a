import numpy as np

from tubeplanner.explanation.directions import AXES, along


def test_each_axis_has_two_ways():
    ways = {name: direction.tolist() for name, direction in AXES}
    assert len(ways) == 6
    assert (ways["in +y"], ways["in -z"]) == ([0, 1, 0], [0, 0, -1])


def test_a_position_is_moved_by_the_size():
    way = np.array([0.6, 0.0, -0.8])
    assert along(np.array([0.1, 0.2, 0.3]), way, 0.5) == [0.4, 0.2, -0.1]
