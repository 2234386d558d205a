"""The second stage: better within its time, certified, and the shortest motion where it fails."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases import slow_but
from tubeplanner import (
    LimitOverrides,
    Objective,
    Planner,
    PlanningProblem,
    PlanOptions,
    Seed,
    Tube,
    load_robot,
    plan,
    verify,
)
from tubeplanner.constraints.effort_variation import effort_variation
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_result import certified_result
from tubeplanner.refinement.second_stage import SecondStage

LINE, POST, WALL = "two_link/paper_1_30mm", "two_link/around_a_post", "ur5/over_the_wall"
TRAY, SHELVES = "ur5/level_tray", "panda/between_shelves"
SLACK = 0.005
# What is left of the effort variation of the busiest motor and of the largest jerk. In the plane,
# the two motors must switch: there is less to gain.
LEFT = {
    LINE: (0.85, 0.1),
    POST: (0.93, 0.1),
    WALL: (0.45, 0.01),
    TRAY: (0.8, 0.06),
    SHELVES: (0.8, 0.06),
}


@pytest.fixture(scope="module")
def stages(bundled):
    """Return a function from a problem's name to it, its shortest motion and its smooth one."""

    @cache
    def of(name):
        problem = bundled(name)
        return problem, plan(problem, PlanOptions(slack=0)), plan(problem)

    return of


def jerk(trajectory):
    return abs(trajectory.derivative_coefficients(3)).max()


PROBLEMS = slow_but((LINE, POST, WALL), list(LEFT))


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_takes_no_longer_than_it_may_and_is_certified(name, stages):
    problem, shortest, smooth = stages(name)
    assert smooth.succeeded
    assert smooth.shortest_duration == shortest.duration
    assert shortest.duration <= smooth.duration <= (1 + SLACK) * shortest.duration * (1 + 1e-9)
    assert smooth.duration == smooth.trajectory.duration
    assert verify(problem, smooth.trajectory).passed
    fields = smooth.as_dict()
    assert (fields["duration"], fields["shortest_duration"]) == (
        smooth.duration,
        shortest.duration,
    )


@pytest.mark.parametrize("name", PROBLEMS)
def test_efforts_swing_less_and_jerk_falls_by_clear_factors(name, stages):
    problem, shortest, smooth = stages(name)
    swing, rough = LEFT[name]
    before, after = (
        effort_variation(problem.robot, stage.trajectory) for stage in (shortest, smooth)
    )
    assert after.max() < swing * before.max()
    assert jerk(smooth.trajectory) < rough * jerk(shortest.trajectory)
    note = smooth.notes[-1]
    names = problem.robot.joint_names
    swings = [f"{swing.max():.1f} limits ('{names[swing.argmax()]}')" for swing in (after, before)]
    assert " instead of ".join(swings) in note
    assert "in 0.50 % more time" in note


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_keeps_the_distance_from_obstacles(name, stages):
    problem, shortest, smooth = stages(name)
    before, after = (
        stage.certificate.conditions["obstacles"].margin for stage in (shortest, smooth)
    )
    assert (before is None) == (not problem.obstacles)
    if before is not None:
        assert after >= 0.9 * min(max(before, 0.0), 0.02) - 1e-4


def test_the_shortest_motion_of_the_result_is_that_of_slack_zero(stages):
    _, shortest, smooth = stages(POST)
    for field in ("breakpoints", "coefficients"):
        np.testing.assert_array_equal(
            getattr(smooth.shortest, field), getattr(shortest.trajectory, field)
        )
    assert shortest.shortest is None
    assert shortest.shortest_duration == shortest.duration
    assert not any("smooth" in note for note in shortest.notes)
    assert smooth.sensitivities == shortest.sensitivities
    grows = "jerk grows with the square of the number of knots"  # of what is not smoothed
    assert [any(grows in note for note in stage.notes) for stage in (shortest, smooth)] == [
        True,
        False,
    ]


def test_the_same_input_gives_the_same_motion(stages):
    problem, _, smooth = stages(POST)
    again = plan(problem)
    np.testing.assert_array_equal(again.trajectory.coefficients, smooth.trajectory.coefficients)
    assert again.notes == smooth.notes


def test_the_problems_objective_holds_unless_options_say_another(stages):
    problem, shortest, smooth = stages(LINE)
    asks = replace(problem, objective=Objective(0.02))
    assert plan(asks).duration == pytest.approx(1.02 * shortest.duration, rel=1e-9)
    assert plan(asks, PlanOptions(slack=0)).duration == shortest.duration
    assert plan(asks, PlanOptions(slack=SLACK)).duration == smooth.duration
    never = replace(problem, objective=Objective(0.0))
    assert plan(never).shortest is None
    assert plan(never, PlanOptions(slack=SLACK)).duration == smooth.duration


def test_more_time_makes_it_smoother(stages):
    problem, _, smooth = stages(LINE)
    slower = plan(problem, PlanOptions(slack=0.05))
    assert jerk(slower.trajectory) < 0.5 * jerk(smooth.trajectory)


# --- room in the tube ----------------------------------------------------------------------------


def across(robot, start, goal, radius, sign):
    """A wide tube, bent motions inside of it."""
    tube = Tube([[*start, 0], [*goal, 0]], radius, joint_signs={"joint2": sign})
    seed = Seed(np.array([np.arctan2(start[1], start[0]) + 0.5, -1.0]))
    return PlanningProblem(robot, tube, seed)


def least_room(problem, trajectory):
    """Return the tool's least distance to the wall of one straight tube, in radii."""
    tool = problem.robot.tool_position(trajectory.per_piece(40).position)
    (begin, end), (radius,) = problem.tube.points, problem.tube.radius
    along = end - begin
    share = np.clip((tool - begin) @ along / (along @ along), 0, 1)
    return 1 - np.linalg.norm(tool - begin - share[:, None] * along, axis=1).max() / radius


@pytest.mark.parametrize(
    ("start", "goal", "radius", "sign"),
    [
        ((-0.36, 0.17), (0.215, -0.333), 0.131, "0"),
        ((-0.191, -0.23), (0.363, 0.381), 0.116, "-"),
    ],
)
def test_it_keeps_the_room_that_the_shortest_motion_left(
    start, goal, radius, sign, two_link, monkeypatch
):
    """Without being asked for it, it would not."""
    problem, options = across(two_link, start, goal, radius, sign), PlanOptions(slack=0.05)
    smooth = plan(problem, options)
    before = least_room(problem, smooth.shortest)
    assert before > 0.1
    assert smooth.duration > smooth.shortest_duration
    assert least_room(problem, smooth.trajectory) > before - 0.1
    none = "tubeplanner.refinement.second_stage._room"
    monkeypatch.setattr(none, lambda problem, dense: np.full(problem.tube.segment_count, 0.05))
    assert least_room(problem, plan(problem, options).trajectory) < before - 0.1


# --- other robots --------------------------------------------------------------------------------


def test_arms_without_effort_limits_and_sliding_joints_are_smoothed_too(slider):
    limits = LimitOverrides(effort={"slide": np.inf}, acceleration={"slide": 5.0})
    robot = load_robot(slider.robot.urdf.path, "cart", limits=limits)
    for problem in (slider, replace(slider, robot=robot)):
        smooth = plan(problem, PlanOptions(slack=0.02))
        assert smooth.succeeded
        assert jerk(smooth.trajectory) < 0.1 * jerk(smooth.shortest)
        assert "m/s^3 ('slide') instead of" in smooth.notes[-1]


# --- where it fails ------------------------------------------------------------------------------

NOT_SMOOTHED = "the answer is the shortest motion, not smoothed: "


def require_shortest(result, shortest, reason, stopped_by=None):
    """The shortest motion bit for bit, with the reason."""
    assert result.succeeded
    assert result.stopped_by == stopped_by
    np.testing.assert_array_equal(result.trajectory.coefficients, shortest.trajectory.coefficients)
    assert result.shortest is None
    assert result.certificate.passed
    (note,) = [note for note in result.notes if note.startswith(NOT_SMOOTHED)]
    assert reason in note
    assert not any(note.startswith("smoothed") for note in result.notes)


@pytest.mark.parametrize("error", [None, Infeasible(PlanStatus.NO_TRAJECTORY, "", Place())])
def test_where_nothing_smoother_is_found_the_answer_is_the_shortest(error, stages, monkeypatch):
    def run(self):
        if error is not None:
            raise error
        return False

    problem, shortest, _ = stages(LINE)
    monkeypatch.setattr(SecondStage, "run", run)
    require_shortest(plan(problem), shortest, "no better one was found in the time")


def test_so_it_is_where_the_smoother_one_has_no_certificate(stages, monkeypatch):
    """However often samples are added where it fails."""
    problem, shortest, _ = stages(LINE)
    judged = []

    def judge(problem, trajectory, *more):
        judged.append(trajectory)
        found = certified_result(problem, trajectory, *more)
        conditions = {**found.certificate.conditions}
        tube = conditions["tube"]
        conditions["tube"] = replace(tube, margin=-1.0)
        failed = replace(found.certificate, conditions=conditions)
        return replace(
            found,
            status=PlanStatus.CERTIFICATE_FAILED,
            message="it leaves the tube",
            trajectory=None,
            certificate=failed,
        )

    monkeypatch.setattr(
        "tubeplanner.planning.certified_motion.certified_result",
        lambda problem, trajectory, *more: (
            judge(problem, trajectory, *more)
            if trajectory.duration > 1.004 * shortest.duration
            else certified_result(problem, trajectory, *more)
        ),
    )
    require_shortest(plan(problem), shortest, "was not certified: it leaves the tube")
    assert 1 < len(judged) <= 5


def test_and_where_it_takes_too_long(stages, monkeypatch):
    problem, shortest, _ = stages(LINE)
    monkeypatch.setattr(
        "tubeplanner.planning.second_stage_plan.lengthened",
        lambda trajectory, duration, period: trajectory.scaled(2.0),
    )
    require_shortest(plan(problem), shortest, " s, more than it may")


@pytest.mark.parametrize("after", [1, 2, 4])
def test_an_interrupt_leaves_the_shortest_motion(after, stages):
    """From the stage's first announcement on; what it has found by then has no certificate."""
    problem, shortest, _ = stages(LINE)
    counted = []

    def interrupt(progress):
        counted.append(progress.stage == "smoothing")
        if sum(counted) >= after:
            raise KeyboardInterrupt

    result = plan(problem, progress=interrupt)
    require_shortest(result, shortest, "stopped by interrupt", "interrupt")


def test_a_time_limit_leaves_it_too(stages, monkeypatch):
    problem, shortest, _ = stages(LINE)
    options = PlanOptions(time_limit=1000.0)

    def late(progress):
        if progress.stage == "smoothing":
            monkeypatch.setattr(
                "tubeplanner.progress.PlanningClock.remaining", property(lambda clock: -1.0)
            )

    result = plan(problem, options, late)
    require_shortest(result, shortest, "stopped by time limit", "time_limit")


def test_an_interrupt_after_something_smoother_was_found_leaves_that(stages, monkeypatch):
    problem, shortest, smooth = stages(LINE)
    run = SecondStage.run

    def interrupted(self):
        assert run(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(SecondStage, "run", interrupted)
    result = plan(problem)
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert result.shortest_duration == shortest.duration
    np.testing.assert_array_equal(result.trajectory.coefficients, smooth.trajectory.coefficients)


def test_planning_that_was_stopped_is_not_smoothed(stages):
    problem, _, _ = stages(LINE)
    interrupts = []

    def interrupt_once(progress):
        if progress.best_duration is not None and not interrupts:
            interrupts.append(progress.stage)
            raise KeyboardInterrupt

    result = plan(problem, progress=interrupt_once)
    assert (result.succeeded, result.stopped_by, result.shortest) == (True, "interrupt", None)


# --- planning again ------------------------------------------------------------------------------


def test_planning_again_begins_with_the_shortest_motion(stages):
    """The motion that is kept has nothing to do with the smooth one."""
    problem, shortest, smooth = stages(POST)
    assert smooth.motion is not None
    np.testing.assert_array_equal(
        smooth.motion.spline.control_points, shortest.motion.spline.control_points
    )
    planners = [Planner(problem, PlanOptions(slack=slack)) for slack in (0, SLACK)]
    wider = problem.with_tube(problem.tube.scaled(1.05))
    for planner in planners:
        planner.plan()
    again = [planner.replan(wider) for planner in planners]
    assert again[1].shortest_duration == again[0].duration
    assert again[1].duration > again[0].duration
    for result in again:
        assert "planned from the last motion, not afresh" in result.notes
