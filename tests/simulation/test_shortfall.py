from dataclasses import replace

import numpy as np
import pytest

from judged_run import judged_run
from tubeplanner import Tube, load_problem
from tubeplanner.outcome import Place
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.shortfall import shown_shortfall

POINTS = [[0.3, -0.5, 0], [0.3, 0, 0], [0.0, 0.3, 0], [0.3, 0.3, 0]]


@pytest.fixture(scope="module")
def problem():
    """Three segments."""
    tube = Tube(POINTS, 0.03, numbers=[0, 2, 5, 6], pass_through_points="all")
    return load_problem("example:two_link/paper_1_30mm").with_tube(tube)


def run(tube=(-0.01, -0.01, -0.01), near=None, **given):
    usual = {
        "clearance": 0.02,
        "tube_by_segment": np.array(tube),
        "rotation_by_segment": np.array([-1e3] * 3),
        "position_by_joint": -np.ones((2, 2)),
    }
    near = None if near is None else Extreme(near, Place())
    return judged_run(**(usual | {"obstacles": near} | given))


def test_the_same_in_every_run_is_what_is_short(problem):
    found = shown_shortfall(problem, [run((0.004, -0.002, 0.0), near=0.017)] * 3)
    assert found.radius == pytest.approx([0.004, -0.002, 0.0])
    assert found.clearance == pytest.approx(0.003)
    assert found.position == pytest.approx(-np.ones((2, 2)))
    assert found.most("radius") == pytest.approx(0.004)


def test_more_is_expected_of_others_than_was_seen(problem):
    """Of 100 from a normal distribution, the mean and 2.5 deviations; of one far out, that one."""
    drawn = np.random.default_rng(0).normal(0.0, 0.001, 100)
    mean, deviation = drawn.mean(), drawn.std()
    found = shown_shortfall(problem, [run((value, -1.0, -1.0)) for value in drawn])
    assert found.radius[0] == pytest.approx(max(mean + 2.5 * deviation, drawn.max()))
    few = shown_shortfall(problem, [run((value, -1.0, -1.0)) for value in (0.0, 0.001)])
    assert few.radius[0] == pytest.approx(0.0005 + 2.5 * 0.0005)
    lost = [run((0.0, -1.0, -1.0))] * 49 + [run((1.0, -1.0, -1.0))]
    assert shown_shortfall(problem, lost).radius[0] == 1.0


def test_a_compulsory_point_that_is_missed_asks_of_both_segments_beside_it(problem):
    """Point 5 is the third, between the second and the third segment."""
    missed = Extreme(0.006, Place(point=5))
    found = shown_shortfall(problem, [run((0.001, 0.002, 0.02), points=missed)] * 2)
    assert found.radius == pytest.approx([0.001, 0.006, 0.02])


def test_of_points_that_are_missed_the_worst_asks_for_what_is_expected_of_all(problem):
    """Point 2 by 4 mm, point 5 by 6 mm: 5 mm and 2.5 deviations of 1 mm."""
    missed = [Extreme(0.004, Place(point=2)), Extreme(0.006, Place(point=5))]
    found = shown_shortfall(problem, [run((-1.0, -1.0, -1.0), points=one) for one in missed])
    assert found.radius == pytest.approx([-1.0, 0.0075, 0.0075])


def test_what_nothing_asks_is_never_short(problem):
    found = shown_shortfall(problem, [run(), run()])
    assert found.clearance == -1e3
    assert found.self_collision == -1e3
    assert (found.rotation == -1e3).all()


def test_links_that_meet_are_short_of_room(problem):
    met = Extreme(-0.002, Place())
    assert shown_shortfall(problem, [run(), run(self_collision=met)]).self_collision == 0.002
    turned = replace(run(), rotation_by_segment=np.array([0.01, -0.2, -0.2]))
    assert shown_shortfall(problem, [turned]).rotation == pytest.approx([0.01, -0.2, -0.2])
