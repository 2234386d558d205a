"""Paths of many points: certified, and as fast as the same curve of few."""

import numpy as np
import pytest

from tubeplanner import PlanningProblem, Seed, Tube, load_robot, plan, verify

RADIUS = 0.005


@pytest.fixture(scope="module")
def robot():
    return load_robot("example:ur5", "tool0")


def circle(robot, count):
    """Return a UR5 on a closed circle of 70 mm in so many chords."""
    angles = np.linspace(0, 2 * np.pi, count + 1)
    points = [0.45, 0, 0.3] + 0.07 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    tube = Tube(points, RADIUS, joint_signs={"elbow_joint": "+"})
    return PlanningProblem(robot, tube, Seed([-0.2, -1.3, 1.9, -2.0, -1.6, 0]))


@pytest.fixture(scope="module")
def answers(robot):
    return {count: plan(circle(robot, count)) for count in (25, 100)}


@pytest.mark.parametrize("count", [25, 100])
def test_a_circle_of_many_chords_is_planned_by_refinement(robot, answers, count):
    answer = answers[count]
    assert answer.method == "refinement"
    assert verify(circle(robot, count), answer.trajectory).passed


def test_more_chords_make_no_slower_motion(answers):
    assert answers[100].duration < 1.01 * answers[25].duration


def test_every_segment_of_a_chain_has_its_price(answers):
    """A wall that four times as many segments share costs as much."""
    totals = {}
    for count, answer in answers.items():
        prices = [p for p in answer.sensitivities if p.limit == "radius"]
        assert {p.segment for p in prices} <= set(range(count))
        assert all(p.elasticity <= 0 for p in prices)
        totals[count] = sum(p.elasticity for p in prices)
    assert totals[100] == pytest.approx(totals[25], rel=0.1)
    assert totals[100] < -0.01


def test_ctrl_c_during_the_first_step_has_an_answer_that_stops_at_corners(robot):
    """Before there is any trajectory of refinement's own: as soon as the branch is known."""

    def interrupt(progress):
        if progress.stage.startswith("refinement"):
            raise KeyboardInterrupt

    answer = plan(circle(robot, 60), progress=interrupt)
    assert (answer.succeeded, answer.method) == (True, "stop-at-corners")
    assert answer.stopped_by == "interrupt"
    assert answer.planning_time < 20  # two seconds on an idle machine
