"""Planning again after a change, from the last motion."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST

from tubeplanner import (
    Obstacle,
    Planner,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    ProblemError,
    Seed,
    Tube,
    placement_of,
    plan,
    verify,
)
from tubeplanner.planning.result import certified_result

NOTE = "planned from the last motion, not afresh"
AS_GOOD = 1.003
POST, LINE = "two_link/around_a_post", "two_link/paper_1_30mm"


@pytest.fixture(scope="module")
def planner_of(planned):
    """Return a function from a bundled problem's name to a planner that has planned it."""

    def of(name):
        problem, result = planned(name, "refinement")
        planner = Planner(problem, SHORTEST)
        planner._last = result.motion
        return planner

    return of


def with_moved_goal(problem, step):
    points = problem.tube.points.copy()
    points[-1] += step
    return problem.with_tube(replace(problem.tube, points=points))


def with_moved_obstacle(problem, step):
    first, *others = problem.obstacles
    placement = placement_of(step)
    shapes = tuple(shape.transformed(placement) for shape in first.shapes)
    return replace(problem, obstacles=(Obstacle(first.name, shapes), *others))


CHANGES = {
    "narrower": lambda problem: problem.with_tube(problem.tube.scaled(0.9)),
    "goal": lambda problem: with_moved_goal(problem, [0.005, -0.008, 0.0]),
    "obstacle": lambda problem: with_moved_obstacle(problem, [0.0, 0.01, 0.0]),
}


@pytest.mark.parametrize("change", CHANGES)
def test_after_a_change_the_answer_is_as_good_as_a_fresh_one(change, planner_of, bundled):
    problem = CHANGES[change](bundled(POST))
    result, fresh = planner_of(POST).replan(problem), plan(problem, SHORTEST)
    assert NOTE in result.notes and NOTE not in fresh.notes
    assert result.method == "refinement"
    assert verify(problem, result.trajectory).passed
    assert result.duration <= AS_GOOD * fresh.duration


def test_the_start_may_move_too_and_the_goal_time_and_again(planner_of, bundled):
    problem, planner = bundled(POST), planner_of(POST)
    points = problem.tube.points + np.array([-0.01, 0.005, 0.0])
    moved = problem.with_tube(replace(problem.tube, points=points))
    for goal in ([0.0, 0.0, 0.0], [-0.013, -0.015, 0.0]):
        changed = with_moved_goal(moved, goal)
        result = planner.replan(changed)
        assert NOTE in result.notes
    assert result.duration <= AS_GOOD * plan(changed, SHORTEST).duration


def same_as_fresh(planner, problem, options=SHORTEST):
    """Return the result, after a look whether it is what `plan` returns."""
    result, fresh = planner.replan(problem), plan(problem, options)
    assert NOTE not in result.notes
    for field in ("status", "message", "method"):
        assert getattr(result, field) == getattr(fresh, field)
    return result


def test_the_first_plan_is_what_plan_returns_and_so_is_it_again(planned):
    problem, alone = planned(LINE, "refinement")
    planner = Planner(problem, SHORTEST)
    for result in (planner.plan(), planner.plan(), Planner(problem, SHORTEST).replan(problem)):
        np.testing.assert_array_equal(result.trajectory.coefficients, alone.trajectory.coefficients)
        assert NOTE not in result.notes
    assert NOTE in planner.replan(problem).notes


@pytest.mark.dear("plans another arm")
def test_other_segments_or_another_arm_are_planned_afresh(planner_of, planned):
    planner = planner_of(POST)
    assert same_as_fresh(planner, planned(LINE)[0]).succeeded
    problem, fresh = planned("ur5/level_tray", "refinement")
    result = planner.replan(problem)
    assert NOTE not in result.notes
    assert result.duration == fresh.duration


def test_what_cannot_be_done_is_refused_as_by_plan_and_forgotten(planner_of, bundled):
    problem, planner = bundled(POST), planner_of(POST)
    block = Obstacle.box("block", [0.1, 0.1, 0.1], placement_of([0.45, -0.3, 0.0]))
    blocked = replace(problem, obstacles=(*problem.obstacles, block))
    assert same_as_fresh(planner, blocked).status is PlanStatus.TUBE_BLOCKED
    out_of_reach = with_moved_goal(problem, [0.0, 0.5, 0.0])
    assert same_as_fresh(planner, out_of_reach).status is PlanStatus.UNREACHABLE
    assert NOTE in planner.replan(problem).notes


def test_a_motion_without_a_certificate_is_planned_afresh(planner_of, bundled, monkeypatch):
    problem, judged = bundled(POST), []
    planner = planner_of(POST)

    def judge(*arguments):
        judged.append(certified_result(*arguments))
        refused = replace(judged[-1], status=PlanStatus.CERTIFICATE_FAILED, certificate=None)
        return refused if len(judged) == 1 else judged[-1]

    monkeypatch.setattr("tubeplanner.planning.refined_plan.certified_result", judge)
    result = planner.replan(problem)
    assert (len(judged), result.succeeded) == (2, True)
    assert NOTE not in result.notes


def test_options_hold_for_every_plan(bundled):
    problem = bundled(LINE)
    wider = problem.with_tube(problem.tube.scaled(1.1))
    stopping = PlanOptions("stop-at-corners")
    planner = Planner(problem, stopping)
    assert planner.plan().method == "stop-at-corners"
    assert same_as_fresh(planner, wider, stopping).method == "stop-at-corners"
    fast = Planner(problem, PlanOptions(quality="fast", slack=0.0))
    knots = len(fast.plan().trajectory.widths)
    assert len(fast.replan(wider).trajectory.widths) == knots < 72


def test_every_start_is_tried_again_with_the_best_quality(bundled):
    problem, best = bundled("two_link/paper_2_30mm"), PlanOptions(quality="best", slack=0.0)
    planner = Planner(problem, best)
    planner.plan()
    assert same_as_fresh(planner, problem, best).succeeded


def test_an_interrupt_leaves_what_is_certified_or_is_passed_on(planner_of, bundled):
    problem = bundled(POST)
    wider, counts = problem.with_tube(problem.tube.scaled(1.1)), []

    def after(steps):
        def interrupt(progress):
            counts.append(progress.best_duration is not None)
            if sum(counts) >= steps:
                counts.clear()
                raise KeyboardInterrupt

        return interrupt

    result = planner_of(POST).replan(wider, after(2))
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert NOTE in result.notes
    with pytest.raises(KeyboardInterrupt):
        planner_of(POST).replan(wider, after(0))


def test_a_shortest_motion_is_remembered_though_it_was_not_smoothed(bundled):
    def interrupt(step):
        if step.stage == "smoothing":
            raise KeyboardInterrupt

    problem = bundled(POST)
    planner = Planner(problem)
    assert planner.plan(interrupt).stopped_by == "interrupt"
    result = planner.replan(problem, interrupt)
    assert NOTE in result.notes and result.stopped_by == "interrupt"


def test_a_time_limit_ends_it(planner_of, bundled):
    problem = bundled(POST)
    planner = planner_of(POST)
    planner._options = PlanOptions(time_limit=1e-9, slack=0.0)
    result = planner.replan(problem)
    assert result.status is PlanStatus.TIME_LIMIT
    assert "time limit of 1e-09 s" in result.message


@pytest.mark.dear("plans many segments thrice")
def test_a_path_of_many_points_is_planned_from_its_last_motion(two_link):
    """Its segments form chains, and what is refined is a smoother problem."""
    s = np.linspace(0, 1, 101)
    points = np.column_stack([0.45 - 0.05 * s, 0.3 * s - 0.1, 0 * s])
    points[1:-1, :2] += 0.001 * np.random.default_rng(0).normal(size=(99, 2))
    tube = Tube(points, 0.005, joint_signs={"joint2": "-"})
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.3, -1.0])))
    planner = Planner(problem, SHORTEST)
    assert planner.plan().motion.is_smoother
    wider = problem.with_tube(problem.tube.scaled(1.02))
    result = planner.replan(wider)
    assert NOTE in result.notes
    assert result.duration <= AS_GOOD * plan(wider, SHORTEST).duration


def test_it_takes_problems_only(bundled):
    for planning in (lambda: Planner("problem.yaml"), lambda: Planner(bundled(LINE)).replan(None)):
        with pytest.raises(ProblemError, match="give a PlanningProblem"):
            planning()


def test_steps_count_until_the_motion_is_judged(planner_of, bundled, monkeypatch):
    problem, steps, judged = CHANGES["narrower"](bundled(POST)), [], []
    planner = planner_of(POST)  # planned before the judge is watched

    def judge(*arguments):
        judged.append(len(steps))
        return certified_result(*arguments)

    monkeypatch.setattr("tubeplanner.planning.refined_plan.certified_result", judge)
    planner.replan(problem, steps.append)
    count = sum(one.best_duration is not None for one in steps[: judged[0]])
    limit = "tubeplanner.planning.refined_plan._MAX_STEPS"
    monkeypatch.setattr(limit, count)
    assert NOTE in planner_of(POST).replan(problem).notes
    monkeypatch.setattr(limit, count - 1)
    assert NOTE not in planner_of(POST).replan(problem).notes
