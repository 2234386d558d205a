"""Wide tubes are planned through narrower ones where links get stuck in them."""

from dataclasses import replace

import pytest

from cases import SHORTEST
from tubeplanner import plan
from tubeplanner.planning import narrowed_plan as module
from tubeplanner.planning.narrowed_plan import narrowed_plan
from tubeplanner.progress import PlanningClock


@pytest.fixture(scope="module")
def wide(bundled):
    """Links get stuck in the wall, from every start."""
    problem = bundled("ur5/over_the_wall")
    return problem.with_tube(problem.tube.scaled(2.0))


@pytest.fixture(scope="module")
def answer(wide):
    return plan(wide, SHORTEST)


@pytest.mark.slow
def test_a_wider_tube_is_faster_though_links_get_stuck_in_it(answer, planned):
    """By branch and bound alone it took 0.866 s."""
    narrow = planned("ur5/over_the_wall", "refinement")[1]
    assert answer.method == "refinement"
    assert answer.certificate.passed
    assert answer.duration < 0.9 * narrow.duration
    assert answer.motion is not None


def test_where_the_whole_tube_gives_nothing_the_narrower_motion_is_the_answer(
    wide, planned, monkeypatch
):
    monkeypatch.setattr(module, "_widened", lambda problem, start, clock: None)
    found = narrowed_plan(wide, SHORTEST, PlanningClock(None, None))
    narrow = planned("ur5/over_the_wall", "refinement")[1]
    assert found.succeeded
    assert found.motion is not None  # what a second stage begins with
    assert found.duration == pytest.approx(narrow.duration, rel=1e-6)


def test_without_the_start_in_a_narrower_tube_there_is_none(wide):
    """It is beside the first point, inside the tube alone as it is."""
    points = wide.tube.points.copy()
    points[0] += [0.9 * wide.tube.radius[0], 0, 0]
    beside = wide.with_tube(replace(wide.tube, points=points))
    assert narrowed_plan(beside, SHORTEST, PlanningClock(None, None)) is None
