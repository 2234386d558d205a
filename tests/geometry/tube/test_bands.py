"""Speed bands: largest and least speeds, stretches, gates, run-ins, and what is refused."""

import numpy as np
import pytest

from tubeplanner import PlanningProblem, Tube, load_robot
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.bands import Process

POINTS = [[0, 0, 0.1], [0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0], [0.2, 0.2, 0.1]]
BAND = {"speed": 0.25, "tolerance": 0.05}
SPEEDS = [None, BAND, {"between": [0.2, 0.25]}, None]
INF = np.inf


def test_bands_are_largest_and_least_speeds_of_one_stretch():
    tube = Tube(POINTS, 0.001, tool_speed=SPEEDS)
    assert tube.tool_speed.tolist() == [INF, 0.25, 0.25, INF]
    assert tube.least_tool_speed.tolist() == [INF, 0.2375, 0.2, INF]
    assert tube.stretches == ((1, 2),)
    begin, end = tube.gates
    assert (begin.point, end.point) == (1, 3)
    # Outside the stretch is behind its begin and beyond its end.
    tool = np.array([[-0.01, 0, 0.05], [0.2, 0.23, 0]])
    np.testing.assert_allclose(begin.margin(tool), [0.01, -0.2], atol=1e-12)
    np.testing.assert_allclose(end.margin(tool), [-0.2, 0.03], atol=1e-12)
    assert Tube(POINTS, 0.001, tool_speed=SPEEDS, process={"steady": "best"}).gates == ()
    assert Tube(POINTS, 0.001, tool_speed=0.25).least_tool_speed is None


def test_run_ins_are_straight_ways_of_the_stretch_s_own_radius():
    ways = {"run_in": 0.01, "run_out": 0.02}
    radius = [0.03, 0.001, 0.002, 0.03]
    tube = Tube(POINTS, radius, tool_speed=SPEEDS, process=ways)
    np.testing.assert_allclose(tube.points[[1, 5]], [[-0.01, 0, 0], [0.2, 0.22, 0]])
    assert tube.radius.tolist() == [0.03, 0.001, 0.001, 0.002, 0.002, 0.03]
    assert tube.stretches == ((2, 3),)
    assert [tube.segment_number(k) for k in range(6)] == [0, 0, 1, 2, 3, 3]
    assert tube.process == Process()  # laid: another tube made from this one gets no more
    assert tube.with_radius(0.004).segment_count == 6
    assert tube.notes == (
        "tube.process: ways with the stretch's own radius are added: 0.01 m at point 1, 0.02 m at "
        "point 3",
    )


REFUSED = [
    ({"speed": 0.25}, {}, "a band is {speed: 0.25, tolerance: 0.05} or {between"),
    ({"speed": -1, "tolerance": 0.1}, {}, "tube.tool_speed.speed is -1; it must be from 1e-06"),
    ({"speed": 1, "tolerance": 1}, {}, "tube.tool_speed.tolerance is 1; it must be from 0.0001"),
    ({"between": [1, 0.5]}, {}, "tube.tool_speed.between is [1, 0.5]; give [lower, upper]"),
    ({"spede": 1}, {}, "unknown field 'spede' (did you mean 'speed'?); there is: speed"),
    (
        [None, BAND, {"between": [0.3, 0.4]}, None],
        {},
        "segments 1 and 2 have no speed in common, which the tool has where it passes from one to "
        "the other: one begins at 0.3 m/s, the other ends at 0.25 m/s",
    ),
    ([None, BAND, 0.1, None], {}, "segments 1 and 2 have no speed in common"),
    (SPEEDS, {"run_in": -1}, "tube.process.run_in is -1; it must be from 0 to 10 m"),
    (SPEEDS, {"steady": "bst"}, "unknown value 'bst' (did you mean 'best'?)"),
    (SPEEDS, {"run": 1}, "tube.process: unknown field 'run'"),
    ([BAND, BAND, None, None], {"run_in": 0.01}, "run_in: segment 0 is at an end of the tube"),
]


@pytest.mark.parametrize(("speeds", "process", "message"), REFUSED)
def test_what_is_no_band_is_refused(speeds, process, message):
    with pytest.raises(ProblemError) as error:
        Tube(POINTS, 0.001, tool_speed=speeds, process=process)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("speeds", "visit", "message"),
    [
        ([None, BAND], "ordered", "segment 1 has a least speed of 0.2375 m/s, but the motion ends"),
        ([BAND, None], "ordered", "segment 0 has a least speed of 0.2375 m/s, but the motion begi"),
        ([BAND, None], "any", "a band, which does not go with visit: any"),
    ],
)
def test_a_motion_rests_where_it_begins_and_ends(speeds, visit, message):
    robot = load_robot("example:ur5", "tool0")
    start = np.array([0.1, -1.3, 1.8, -2.0, 0.1, 2.0])
    tool = robot.tool_position(start[None])[0]
    points = tool + np.array([[0, 0, 0], [0, 0, 0.1], [0, 0.1, 0.1]])
    tube = Tube(points, 0.01, tool_speed=speeds, visit=visit)
    with pytest.raises(ProblemError) as error:
        PlanningProblem(robot, tube, start)
    assert message in str(error.value)
