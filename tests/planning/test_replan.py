"""Planning again after a change, from the last motion."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import (
    Obstacle,
    Payload,
    Planner,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    ProblemError,
    Seed,
    Tube,
    load_problem,
    load_robot,
    placement_of,
    plan,
    verify,
)
from tubeplanner.planning.plan_result import certified_result

NOTE = "planned from the last motion, not afresh"
AS_GOOD = 1.003
OVER_THE_WALL = "ur5/over_the_wall"


@pytest.fixture(scope="module")
def planner_of(bundled):
    """Return a function from a bundled problem's name to a planner that has planned it."""
    plans = {}

    def of(name, options=SHORTEST):
        planner = Planner(bundled(name), options)
        if (name, options) not in plans:
            planner.plan()
            plans[name, options] = planner._last
        planner._last = plans[name, options]
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


def with_payload(problem, mass):
    robot = load_robot("example:ur5", problem.robot.tool_frame, payload=Payload(mass=mass))
    return replace(problem, robot=robot)


CHANGES = {
    "none": lambda problem: problem,
    "wider": lambda problem: problem.with_tube(problem.tube.scaled(1.1)),
    "narrower": lambda problem: problem.with_tube(problem.tube.scaled(0.9)),
    "goal": lambda problem: with_moved_goal(problem, [0.005, -0.008, 0.0]),
    "obstacle": lambda problem: with_moved_obstacle(problem, [0.0, 0.01, 0.0]),
    "payload": lambda problem: with_payload(problem, 0.5),
    "clearance": lambda problem: replace(problem, clearance=problem.clearance + 0.005),
}


@pytest.mark.parametrize("change", CHANGES)
def test_after_a_change_the_answer_is_as_good_as_a_fresh_one(change, planner_of, bundled):
    problem = CHANGES[change](bundled(OVER_THE_WALL))
    result, fresh = planner_of(OVER_THE_WALL).replan(problem), plan(problem, SHORTEST)
    assert NOTE in result.notes
    assert result.method == "refinement"
    assert verify(problem, result.trajectory).passed
    assert result.duration <= AS_GOOD * fresh.duration
    assert NOTE not in fresh.notes


def test_the_start_may_move_too(planner_of, bundled):
    problem = bundled("two_link/around_a_post")
    points = problem.tube.points + np.array([-0.01, 0.005, 0.0])
    problem = problem.with_tube(replace(problem.tube, points=points))
    result = planner_of("two_link/around_a_post").replan(problem)
    assert NOTE in result.notes
    assert result.duration <= AS_GOOD * plan(problem, SHORTEST).duration


def test_many_small_changes_leave_the_answer_as_good(planner_of, bundled):
    problem, random = bundled("two_link/around_a_post"), np.random.default_rng(0)
    planner = planner_of("two_link/around_a_post")
    for _ in range(10):
        changed = with_moved_goal(problem, [*random.uniform(-0.02, 0.0, 2), 0.0])
        result = planner.replan(changed)
        assert NOTE in result.notes
    assert result.duration <= AS_GOOD * plan(changed, SHORTEST).duration


def test_the_first_plan_is_what_plan_returns(bundled):
    problem = bundled("two_link/paper_1_30mm")
    result, alone = Planner(problem, SHORTEST).plan(), plan(problem, SHORTEST)
    np.testing.assert_array_equal(result.trajectory.coefficients, alone.trajectory.coefficients)
    again = Planner(problem, SHORTEST)
    again.plan()
    np.testing.assert_array_equal(
        again.plan().trajectory.coefficients, alone.trajectory.coefficients
    )


def same_as_fresh(planner, problem, options=SHORTEST):
    """Return the result, after a look whether it is what `plan` returns."""
    result, fresh = planner.replan(problem), plan(problem, options)
    assert NOTE not in result.notes
    assert (result.status, result.message, result.method) == (
        fresh.status,
        fresh.message,
        fresh.method,
    )
    return result


def test_without_a_motion_it_plans_afresh(bundled):
    problem = bundled("two_link/paper_1_30mm")
    planner = Planner(problem, SHORTEST)
    assert same_as_fresh(planner, problem).succeeded
    assert NOTE in planner.replan(problem).notes


def test_other_segments_or_another_arm_are_planned_afresh(planner_of, bundled):
    planner = planner_of("two_link/around_a_post")
    assert same_as_fresh(planner, bundled("two_link/paper_1_30mm")).succeeded
    assert same_as_fresh(planner, bundled(OVER_THE_WALL)).succeeded


def test_what_cannot_be_done_is_refused_as_by_plan_and_forgotten(planner_of, bundled):
    problem, planner = bundled("two_link/around_a_post"), planner_of("two_link/around_a_post")
    block = Obstacle.box("block", [0.1, 0.1, 0.1], placement_of([0.45, -0.3, 0.0]))
    blocked = replace(problem, obstacles=(*problem.obstacles, block))
    assert same_as_fresh(planner, blocked).status is PlanStatus.TUBE_BLOCKED
    out_of_reach = with_moved_goal(problem, [0.0, 0.5, 0.0])
    assert same_as_fresh(planner, out_of_reach).status is PlanStatus.UNREACHABLE
    assert NOTE in planner.replan(problem).notes


def test_a_motion_without_a_certificate_is_planned_afresh(planner_of, bundled, monkeypatch):
    problem, judged = bundled("two_link/around_a_post"), []
    planner = planner_of("two_link/around_a_post")

    def judge(*arguments):
        judged.append(certified_result(*arguments))
        refused = replace(judged[-1], status=PlanStatus.CERTIFICATE_FAILED, certificate=None)
        return refused if len(judged) == 1 else judged[-1]

    monkeypatch.setattr("tubeplanner.planning.certified_motion.certified_result", judge)
    result = planner.replan(problem)
    assert len(judged) == 2
    assert result.succeeded
    assert NOTE not in result.notes


def test_a_motion_that_is_too_far_away_is_planned_afresh(planner_of, bundled):
    """In a tube twice as wide the best motion is another."""
    problem = bundled(OVER_THE_WALL)
    wide = problem.with_tube(problem.tube.scaled(2.0))
    assert same_as_fresh(planner_of(OVER_THE_WALL), wide).succeeded


def test_options_hold_for_every_plan(bundled):
    problem = bundled("two_link/paper_1_30mm")
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
    problem = bundled("two_link/around_a_post")
    wider, counts = problem.with_tube(problem.tube.scaled(1.1)), []

    def after(steps):
        def interrupt(progress):
            counts.append(progress.best_duration is not None)
            if sum(counts) >= steps:
                counts.clear()
                raise KeyboardInterrupt

        return interrupt

    result = planner_of("two_link/around_a_post").replan(wider, after(2))
    assert result.succeeded
    assert result.stopped_by == "interrupt"
    assert NOTE in result.notes
    with pytest.raises(KeyboardInterrupt):
        planner_of("two_link/around_a_post").replan(wider, after(0))


def test_a_shortest_motion_is_remembered_though_it_was_not_smoothed(bundled):
    def interrupt(step):
        if step.stage == "smoothing":
            raise KeyboardInterrupt

    problem = bundled("two_link/around_a_post")
    planner = Planner(problem)
    assert planner.plan(interrupt).stopped_by == "interrupt"
    result = planner.replan(problem, interrupt)
    assert NOTE in result.notes and result.stopped_by == "interrupt"


def test_a_time_limit_ends_it(planner_of, bundled):
    problem = bundled("two_link/around_a_post")
    planner = planner_of("two_link/around_a_post")
    planner._options = PlanOptions(time_limit=1e-9, slack=0.0)
    result = planner.replan(problem)
    assert result.status is PlanStatus.TIME_LIMIT
    assert "time limit of 1e-09 s" in result.message


def test_a_path_of_many_points_is_planned_from_its_last_motion(ur5):
    """Its segments form chains, and what is refined is a smoother problem."""
    s = np.linspace(0, 1, 101)
    points = np.column_stack([0.35 + 0.25 * s, 0.04 * np.sin(2 * np.pi * s), 0.3 + 0 * s])
    points[1:-1] += 0.001 * np.random.default_rng(0).normal(size=(99, 3))
    seed = Seed([-0.2, -1.3, 1.9, -2.0, -1.6, 0])
    problem = PlanningProblem(ur5, Tube(points, 0.005), seed)
    planner = Planner(problem, SHORTEST)
    assert planner.plan().motion.is_smoother
    wider = problem.with_tube(problem.tube.scaled(1.02))
    result = planner.replan(wider)
    assert NOTE in result.notes
    assert result.duration <= AS_GOOD * plan(wider, SHORTEST).duration


def test_it_takes_problems_only(bundled):
    with pytest.raises(ProblemError, match="give a PlanningProblem"):
        Planner("problem.yaml")
    with pytest.raises(ProblemError, match="give a PlanningProblem"):
        Planner(load_problem("example:two_link/paper_1_30mm")).replan(None)


def test_steps_count_until_the_motion_is_judged(planner_of, bundled, monkeypatch):
    problem, steps, judged = CHANGES["wider"](bundled(OVER_THE_WALL)), [], []

    def judge(*arguments):
        judged.append(len(steps))
        return certified_result(*arguments)

    monkeypatch.setattr("tubeplanner.planning.certified_motion.certified_result", judge)
    planner_of(OVER_THE_WALL).replan(problem, steps.append)
    count = sum(one.best_duration is not None for one in steps[: judged[0]])
    limit = "tubeplanner.planning.continued_plan._MAX_STEPS"
    monkeypatch.setattr(limit, count)
    assert NOTE in planner_of(OVER_THE_WALL).replan(problem).notes
    monkeypatch.setattr(limit, count - 1)
    assert NOTE not in planner_of(OVER_THE_WALL).replan(problem).notes
