"""Plans of tubes whose segments are visited in any order: several motions compete."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    Obstacle,
    Planner,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    placement_of,
    plan,
    verify,
)

QUICK = PlanOptions(slack=0.0, candidate_points=12)
# The last segment begins beside the end of the first; the two between lead out and back.
DETOUR = [[0.45, -0.2, 0], [0.45, 0.05, 0], [0.55, 0.1, 0], [0.5, 0.2, 0], [0.4, 0.1, 0]]
# At the far end of the detour.
BALL = Obstacle.sphere("ball", 0.05, placement_of([0.53, 0.1, 0]))
NOTE = "planned from the last motion, not afresh"


def union_of(arm, points=DETOUR, radius=0.06, **others):
    tube = Tube(points, radius, visit="any", joint_signs={"joint2": "-"})
    return PlanningProblem(arm, tube, Seed(np.array([-0.9, 1.0])), **others)


def in_order(problem):
    return problem.with_tube(replace(problem.tube, visit="ordered"))


@pytest.fixture(scope="module")
def detour(two_link):
    problem = union_of(two_link)
    return problem, plan(problem, QUICK)


def test_segments_that_lead_astray_are_left_out(detour):
    """Refinement's motion in order, and in the segments alone that it visits: so it has prices."""
    problem, answer = detour
    ordered = plan(in_order(problem), QUICK)
    assert (answer.method, ordered.method) == ("refinement", "refinement")
    assert answer.duration < 0.7 * ordered.duration
    assert verify(problem, answer.trajectory).passed
    assert "points" not in verify(in_order(problem), answer.trajectory).failures()
    assert answer.search.best_duration > answer.duration  # branch and bound ran, too
    visited = answer.motion.spline.grid.runs
    assert sum(map(len, visited)) < problem.tube.segment_count


def test_branch_and_bound_leads_on_where_the_first_start_is_blocked(two_link):
    problem = union_of(two_link, obstacles=[BALL])
    brief = replace(QUICK, persistent=False, quality="fast")
    answer = plan(problem, brief)
    assert plan(in_order(problem), brief).status is PlanStatus.TUBE_BLOCKED
    assert answer.duration < answer.search.best_duration
    assert verify(problem, answer.trajectory).passed


def test_compulsory_points_are_passed_in_a_union(two_link):
    """Out and back to the first point, then a detour that is left out."""
    points = [DETOUR[0], DETOUR[1], DETOUR[0], [0.38, -0.35, 0], [0.52, -0.28, 0]]
    problem = union_of(two_link, points)
    ordered, answer = plan(in_order(problem), QUICK), plan(problem, QUICK)
    assert problem.tube.compulsory_points.tolist() == [1]
    assert answer.duration <= ordered.duration
    assert verify(problem, answer.trajectory).conditions["points"].margin >= 0


def test_one_segment_has_an_order(two_link):
    answer = plan(union_of(two_link, DETOUR[:2]), QUICK)
    assert (answer.method, answer.search) == ("refinement", None)


def test_a_changed_union_is_planned_from_the_last_motion(detour):
    problem, answer = detour
    planner = Planner(problem, QUICK)
    planner._last = answer.motion
    narrower = problem.with_tube(problem.tube.scaled(0.95))
    again = planner.replan(narrower)
    assert NOTE in again.notes
    assert again.duration == pytest.approx(plan(narrower, QUICK).duration, rel=3e-3)


def test_a_union_is_smoothed(detour):
    problem, shortest = detour
    answer = plan(problem, replace(QUICK, slack=0.05))
    assert answer.shortest_duration == shortest.duration
    assert answer.duration == pytest.approx(1.05 * shortest.duration, rel=1e-3)


@pytest.mark.parametrize("stage", ["trajectory along it, stopping at corners", "branch and bound"])
def test_ctrl_c_leaves_the_fastest_motion_so_far(stage, detour):
    problem, answer = detour

    def interrupt(progress):
        if progress.stage == stage:
            raise KeyboardInterrupt

    result = plan(problem, QUICK, interrupt)
    assert (result.status, result.stopped_by) == (PlanStatus.SUCCESS, "interrupt")
    assert result.method == "refinement"
    assert result.duration == pytest.approx(answer.duration, rel=2e-3)
