"""Second stage of planning: smoother motions and less energy in more time."""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from cases import INERTIA, one_joint

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
from tubeplanner.limits.peaks import effort_variation
from tubeplanner.optimizer.stages import SecondStage
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.planning.result import certified_result

# The second stage: better within its time, certified, and the shortest motion where it fails.

LINE, POST, WALL = "two_link/paper_1_30mm", "two_link/around_a_post", "ur5/over_the_wall"
SLACK = 0.005
FAST = PlanOptions(quality="fast")
# What is left of the effort variation of the busiest motor and of the largest jerk. In the plane,
# the two motors must switch: there is less to gain.
LEFT = {POST: (0.93, 0.1), WALL: (0.45, 0.01)}


@pytest.fixture(scope="module")
def quick(bundled):
    """Return the problem of a line, its shortest motion and its smooth one, on few knots."""
    problem = bundled(LINE)
    return problem, plan(problem, replace(FAST, slack=0)), plan(problem, FAST)


def jerk(trajectory):
    return abs(trajectory.derivative_coefficients(3)).max()


@pytest.mark.parametrize("name", [POST, pytest.param(WALL, marks=pytest.mark.slow)])
def test_in_hardly_more_time_efforts_swing_less_and_jerk_falls_by_clear_factors(name, planned):
    """It is certified, and keeps the distance from obstacles."""
    problem, shortest = planned(name, "refinement")
    smooth = plan(problem)
    assert smooth.shortest_duration == shortest.duration
    assert shortest.duration <= smooth.duration <= (1 + SLACK) * shortest.duration * (1 + 1e-9)
    assert smooth.duration == smooth.trajectory.duration
    assert verify(problem, smooth.trajectory).passed
    fields = smooth.as_dict()
    assert (fields["duration"], fields["shortest_duration"]) == (smooth.duration, shortest.duration)
    swing, rough = LEFT[name]
    both = shortest, smooth
    before, after = (effort_variation(problem.robot, stage.trajectory) for stage in both)
    assert after.max() < swing * before.max()
    assert jerk(smooth.trajectory) < rough * jerk(shortest.trajectory)
    note = smooth.notes[-1]
    names = problem.robot.joint_names
    swings = [f"{swing.max():.1f} limits ('{names[swing.argmax()]}')" for swing in (after, before)]
    assert " instead of ".join(swings) in note
    least = f"the shortest is {shortest.duration:.4f} s (--slack 0); largest effort swing "
    assert note.startswith(f"smoothed: {smooth.duration:.4f} s; {least}")
    before, after = (stage.certificate.conditions["obstacles"].margin for stage in both)
    assert (before is None) == (not problem.obstacles)
    if before is not None:
        assert after >= 0.9 * min(max(before, 0.0), 0.02) - 1e-4


def test_the_shortest_motion_of_the_result_is_that_of_slack_zero(quick):
    _, shortest, smooth = quick
    for field in ("breakpoints", "coefficients"):
        ours, theirs = getattr(smooth.shortest, field), getattr(shortest.trajectory, field)
        np.testing.assert_array_equal(ours, theirs)
    assert shortest.shortest is None
    assert shortest.shortest_duration == shortest.duration
    assert not any("smooth" in note for note in shortest.notes)
    assert smooth.sensitivities == shortest.sensitivities
    grows = "jerk grows with the square of the number of knots"  # of what is not smoothed
    assert any(grows in note for note in shortest.notes)
    assert not any(grows in note for note in smooth.notes)


def test_the_problems_objective_holds_unless_options_say_another(quick):
    problem, shortest, smooth = quick
    asks = replace(problem, objective=Objective(0.05))
    slower = plan(asks, FAST)
    assert slower.duration == pytest.approx(1.05 * shortest.duration, rel=1e-9)
    assert jerk(slower.trajectory) < 0.5 * jerk(smooth.trajectory)
    assert plan(asks, replace(FAST, slack=0)).duration == shortest.duration
    never = replace(problem, objective=Objective(0.0))
    assert plan(never, FAST).shortest is None
    same = plan(never, replace(FAST, slack=SLACK))
    np.testing.assert_array_equal(same.trajectory.coefficients, smooth.trajectory.coefficients)
    assert same.notes == smooth.notes


def least_slack(problem, trajectory):
    """Return the tool's least distance to the wall of one straight tube, in radii."""
    tool = problem.robot.tool_position(trajectory.per_piece(40).position)
    (begin, end), (radius,) = problem.tube.points, problem.tube.radius
    along = end - begin
    fraction = np.clip((tool - begin) @ along / (along @ along), 0, 1)
    return 1 - np.linalg.norm(tool - begin - fraction[:, None] * along, axis=1).max() / radius


def test_it_keeps_the_room_that_the_shortest_motion_left(two_link, monkeypatch):
    """Without being asked for it, it would not."""
    tube = Tube([[-0.36, 0.17, 0], [0.215, -0.333, 0]], 0.131)
    problem = PlanningProblem(two_link, tube, Seed(np.array([3.2, -1.0])))
    options = PlanOptions(slack=0.05)
    smooth = plan(problem, options)
    before = least_slack(problem, smooth.shortest)
    assert before > 0.1
    assert smooth.duration > smooth.shortest_duration
    assert least_slack(problem, smooth.trajectory) > before - 0.1
    none = "tubeplanner.optimizer.stages._slack"
    monkeypatch.setattr(none, lambda problem, dense: np.full(problem.tube.segment_count, 0.05))
    assert least_slack(problem, plan(problem, options).trajectory) < before - 0.1


def test_arms_without_effort_limits_and_sliding_joints_are_smoothed_too(slider):
    limits = LimitOverrides(effort={"slide": np.inf}, acceleration={"slide": 5.0})
    robot = load_robot(slider.robot.urdf.path, "cart", limits=limits)
    for problem in (slider, replace(slider, robot=robot)):
        smooth = plan(problem, PlanOptions(slack=0.02))
        assert smooth.succeeded
        assert jerk(smooth.trajectory) < 0.1 * jerk(smooth.shortest)
        assert "m/s^3 ('slide') instead of" in smooth.notes[-1]


NOTHING_FOUND = "no better motion was found within "


def require_shortest(result, shortest, reason, stopped_by=None):
    """The shortest motion bit for bit, with the reason."""
    assert (result.succeeded, result.stopped_by) == (True, stopped_by)
    np.testing.assert_array_equal(result.trajectory.coefficients, shortest.trajectory.coefficients)
    assert result.shortest is None
    assert result.certificate.passed
    (note,) = [note for note in result.notes if reason in note]
    assert note.startswith("the answer is the shortest motion, not smoothed: ")
    assert not any(note.startswith("smoothed") for note in result.notes)


def fails(*arguments):
    raise Infeasible(PlanStatus.NO_TRAJECTORY, "", Location())


@pytest.mark.parametrize(
    ("step", "does", "reason"),
    [
        ("optimizer.stages.SecondStage.run", lambda self: False, NOTHING_FOUND),
        ("optimizer.stages.SecondStage.run", fails, NOTHING_FOUND),
        (
            "planning.second_stage.lengthened",
            lambda trajectory, duration, period: trajectory.scaled(2.0),
            " s, more than ",
        ),
    ],
    ids=["nothing found", "infeasible", "too long"],
)
def test_where_nothing_smoother_is_found_the_answer_is_the_shortest(
    step, does, reason, quick, monkeypatch
):
    problem, shortest, _ = quick
    monkeypatch.setattr(f"tubeplanner.{step}", does)
    require_shortest(plan(problem, FAST), shortest, reason)


def test_so_it_is_where_the_smoother_one_has_no_certificate(quick, monkeypatch):
    """However often samples are added where it fails."""
    problem, shortest, _ = quick
    judged = []

    def judge(problem, trajectory, *more):
        result = certified_result(problem, trajectory, *more)
        if trajectory.duration <= 1.004 * shortest.duration:
            return result
        judged.append(trajectory)
        conditions = dict(result.certificate.conditions)
        conditions["tube"] = replace(conditions["tube"], margin=-1.0)
        failed = replace(result.certificate, conditions=conditions)
        said = {"status": PlanStatus.CERTIFICATE_FAILED, "message": "it leaves the tube"}
        return replace(result, **said, trajectory=None, certificate=failed)

    monkeypatch.setattr("tubeplanner.planning.refined_plan.certified_result", judge)
    require_shortest(plan(problem, FAST), shortest, "was not certified: it leaves the tube")
    assert 1 < len(judged) <= 5


@pytest.mark.parametrize(("after", "by"), [(1, "interrupt"), (4, "interrupt"), (1, "time_limit")])
def test_what_stops_it_leaves_the_shortest_motion(after, by, quick, monkeypatch):
    """From the stage's first announcement on; what it has found by then has no certificate."""
    problem, shortest, _ = quick
    counted = []

    def stop(progress):
        counted.append(progress.stage == "smoothing")
        if sum(counted) >= after and by == "interrupt":
            raise KeyboardInterrupt
        if sum(counted) >= after:
            none_left = property(lambda clock: -1.0)
            monkeypatch.setattr("tubeplanner.outcome.PlanningClock.remaining", none_left)

    result = plan(problem, replace(FAST, time_limit=1000.0), stop)
    require_shortest(result, shortest, f"stopped by {by.replace('_', ' ')}", by)


def test_an_interrupt_after_something_smoother_was_found_leaves_that(quick, monkeypatch):
    problem, shortest, smooth = quick
    run = SecondStage.run

    def interrupted(self):
        assert run(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(SecondStage, "run", interrupted)
    result = plan(problem, FAST)
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert result.shortest_duration == shortest.duration
    np.testing.assert_array_equal(result.trajectory.coefficients, smooth.trajectory.coefficients)


def interrupting_once():
    """Return a progress callback that presses Ctrl-C where there is an answer, once."""
    interrupts = []

    def interrupt(progress):
        if progress.best_duration is not None and not interrupts:
            interrupts.append(progress.stage)
            raise KeyboardInterrupt

    return interrupt


def test_planning_that_was_stopped_is_not_smoothed(quick):
    problem, _, _ = quick
    result = plan(problem, FAST, interrupting_once())
    assert (result.succeeded, result.stopped_by, result.shortest) == (True, "interrupt", None)


def test_planning_again_begins_with_the_shortest_motion(quick):
    """The motion that is kept has nothing to do with the smooth one."""
    problem, shortest, smooth = quick
    kept, points = (each.motion.spline.control_points for each in (smooth, shortest))
    np.testing.assert_array_equal(kept, points)
    planners = [Planner(problem, replace(FAST, slack=slack)) for slack in (0, SLACK)]
    wider = problem.with_tube(problem.tube.scaled(1.05))
    for planner in planners:
        planner.plan()
    again = [planner.replan(wider) for planner in planners]
    assert again[1].shortest_duration == again[0].duration
    assert again[1].duration > again[0].duration
    for result in again:
        assert "planned from the last motion, not afresh" in result.notes


# Energy and work saved: against physics, within a slack and in a fixed duration.

TRAVEL = 1.7  # [rad], of the bar


def turning(tmp_path, start=0.0, mass=0.0, objective=None):
    """A bar that turns by so much; nothing is asked of it but its limits."""
    robot = one_joint(tmp_path, mass)
    tube = Tube([[0.0, 0, 0], [1.0, 0, 0]], 1000.0)
    ends = np.array([start]), np.array([start + TRAVEL])
    return PlanningProblem(robot, tube, *ends, self_collision=False, objective=objective)


def quadrature(robot, trajectory, integrand, count=20_001):
    """Return the integral of a function of efforts and velocities, by midpoints of even steps."""
    width = trajectory.duration / count
    t = (np.arange(count) + 0.5) * width
    state = trajectory.position(t), trajectory.velocity(t), trajectory.acceleration(t)
    return integrand(robot.inverse_dynamics(*state), state[1]).sum() * width


def energy_of(robot, trajectory, weights=None):
    weights = robot.limits.effort**-2 if weights is None else weights
    return quadrature(robot, trajectory, lambda effort, _: effort**2 @ weights)


def work_of(robot, trajectory):
    return quadrature(robot, trajectory, lambda effort, velocity: np.maximum(effort * velocity, 0))


COSTS = {"energy": energy_of, "work": work_of}


@pytest.fixture(scope="module")
def saving(bundled):
    """Return a function from an objective's fields to the problem of a line and its answer."""

    @cache
    def of(*fields):
        problem = replace(bundled(LINE), objective=Objective(*fields))
        return problem, plan(problem, FAST)

    return of


def test_a_bar_in_free_rotation_takes_little_more_energy_than_any_motion_must(tmp_path):
    """12 (I angle)^2 / T^3: the cubic, which only motions with a jump of effort at both ends are.

    (Euler and Lagrange: the effort of least energy from rest to rest is a straight line.)
    """
    duration = 3.0
    problem = turning(tmp_path, objective=Objective(None, "energy", duration))
    result = plan(problem, FAST)
    bound = 12 * (INERTIA * TRAVEL) ** 2 / duration**3
    found = energy_of(problem.robot, result.trajectory, np.ones(1))
    assert result.duration == pytest.approx(duration, rel=1e-12)
    assert bound < found < 1.03 * bound
    smooth = plan(replace(problem, objective=Objective(duration=duration)), FAST)
    assert energy_of(problem.robot, smooth.trajectory, np.ones(1)) > 1.05 * bound


def test_a_bar_that_is_lifted_takes_little_more_work_than_its_height(tmp_path):
    """m g h: what is put into speed is given back on the way up."""
    mass, start = 0.5, -1.2
    problem = turning(tmp_path, start, mass, Objective(None, "work", 8.0))
    result = plan(problem, FAST)
    height = 0.5 * (np.sin(start + TRAVEL) - np.sin(start))
    bound = mass * 9.81 * height
    found = work_of(problem.robot, result.trajectory)
    assert result.shortest is not None
    assert bound <= found * (1 + 1e-6)
    assert found < 1.03 * bound
    assert work_of(problem.robot, result.shortest) > 1.5 * bound


@pytest.mark.parametrize("minimise", COSTS)
def test_it_falls_as_slack_grows_and_below_that_of_the_smooth_motion(minimise, saving, quick):
    cost = COSTS[minimise]
    problem, shortest, _ = quick
    costs = [cost(problem.robot, shortest.trajectory)]
    for slack in (0.05, 0.2):
        problem, result = saving(slack, minimise)
        assert result.succeeded
        assert verify(problem, result.trajectory).passed
        assert shortest.duration < result.duration <= (1 + slack) * shortest.duration * (1 + 1e-9)
        costs.append(cost(problem.robot, result.trajectory))
    assert all(later < 0.95 * earlier for earlier, later in pairwise(costs))
    smooth = saving(0.05)[1].trajectory
    assert costs[1] < 0.98 * cost(problem.robot, smooth)


def deviation_of(problem, trajectory):
    """Return the mean square distance from the nearest segment, in radii."""
    tube, t = problem.tube, np.linspace(0, trajectory.duration, 3000)
    tool = problem.robot.tool_position(trajectory.position(t))
    segment = tube.distance(tool).argmin(axis=1)
    return float((tube.regions.deviation(tool, segment)[0] ** 2).sum(axis=1).mean())


ARC = np.linspace(-0.8, 0.8, 151)
BENT = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0]]
DEVIATING = {
    "corner": Tube(BENT, [0.03, 0.05]),
    "chain": Tube(0.45 * np.array([np.cos(ARC), np.sin(ARC), 0 * ARC]).T, 0.01),
    "boxes": Tube(BENT, None, cross_section={"box": [0.06, 0.1], "up": [0, 0, 1]}),
}


@pytest.mark.parametrize(
    ("case", "period"), [("corner", None), ("corner", 0.004), ("chain", None), ("boxes", None)]
)
def test_a_motion_is_nearer_to_its_reference_within_the_slack(case, period, bundled):
    robot, objective = bundled(LINE).robot, Objective(0.03, "deviation")
    others = {"period": period, "objective": objective, "self_collision": False}
    problem = PlanningProblem(robot, DEVIATING[case], Seed([-1.5, 1.4]), **others)
    result = plan(problem, FAST)
    (note,) = [note for note in result.notes if note.startswith("deviation reduced: ")]
    after, before = (deviation_of(problem, own) for own in (result.trajectory, result.shortest))
    assert verify(problem, result.trajectory).passed
    assert after < 0.6 * before
    said = map(float, re.search(r" (\S+) instead of (\S+) radii", note).groups())
    assert list(said) == pytest.approx([after**0.5, before**0.5], rel=0.06)
    assert result.duration <= result.shortest_duration * (1 + 0.03) * (1 + 1e-9)


def test_what_weights_make_dear_is_spared(bundled):
    problem = bundled(LINE)
    alone = []
    for weights in ({"joint1": 1.0, "joint2": 0.0}, {"joint1": 0.0, "joint2": 1.0}):
        asks = replace(problem, objective=Objective(0.05, "energy", weights=weights))
        trajectory = plan(asks, FAST).trajectory
        alone.append([energy_of(problem.robot, trajectory, own) for own in np.eye(2)])
    assert alone[0][0] < 0.95 * alone[1][0]
    assert alone[1][1] < 0.95 * alone[0][1]


@pytest.mark.parametrize(
    ("minimise", "weights", "unit"),
    [
        ("energy", None, "limits^2 s"),
        ("energy", {"joint1": 2.0, "joint2": 3.0}, "with the given weights"),
        ("work", None, "J"),
    ],
)
def test_the_note_says_what_was_gained(minimise, weights, unit, bundled, saving):
    if weights is None:
        problem, result = saving(0.05, minimise)
    else:
        problem = replace(bundled(LINE), objective=Objective(0.05, minimise, weights=weights))
        result = plan(problem, FAST)
    (note,) = [note for note in result.notes if note.startswith(f"{minimise} saved: ")]
    assert f"{result.duration:.4f} s; the shortest is {result.shortest.duration:.4f} s" in note
    after, before = map(float, re.search(r" (\S+) instead of (\S+) ", note).groups())
    assert note.endswith(f" {unit}")
    own = () if weights is None else (np.array([2.0, 3.0]),)
    for said, trajectory in ((after, result.trajectory), (before, result.shortest)):
        assert said == pytest.approx(COSTS[minimise](problem.robot, trajectory, *own), rel=1e-3)
    assert after < before


@pytest.mark.parametrize(
    ("minimise", "duration"), [("smoothness", None), ("energy", 1.1), ("work", 2.0)]
)
def test_a_fixed_duration_is_kept_exactly(minimise, duration, saving, quick):
    _, shortest, _ = quick
    duration = duration or shortest.duration * 1.0005
    problem, result = saving(None, minimise, duration)
    assert result.duration == pytest.approx(duration, rel=1e-12)
    assert result.shortest_duration == shortest.duration
    assert verify(problem, result.trajectory).passed


def test_a_slack_of_options_holds_before_it(saving):
    problem, result = saving(None, "energy", 1.1)
    assert plan(problem, replace(FAST, slack=0)).duration == result.shortest_duration


@pytest.mark.parametrize("period", [None, 0.004])
def test_less_than_the_shortest_is_no_trajectory(period, bundled):
    problem = replace(bundled(LINE), period=period, objective=Objective(None, "energy", 0.6))
    result = plan(problem, FAST)
    assert (result.status, result.trajectory) == (PlanStatus.NO_TRAJECTORY, None)
    shortest = plan(replace(problem, objective=Objective(0.0)), FAST)
    assert result.shortest_duration == shortest.duration
    assert f"takes {shortest.duration:.6g} s; give " in result.message
    least = float(re.search(r"give (\S+) s or more", result.message).group(1))
    assert shortest.duration * (1 - 1e-12) <= least < shortest.duration + 1.1e-4
    enough = plan(replace(problem, objective=Objective(None, "energy", least)), FAST)
    assert enough.duration == pytest.approx(least, rel=1e-12)


def test_where_nothing_better_is_found_the_shortest_motion_is_run_slower(saving, monkeypatch):
    monkeypatch.setattr(SecondStage, "run", lambda self: False)
    problem, _ = saving(None, "energy", 1.1)
    result = plan(problem, FAST)
    assert result.duration == pytest.approx(1.1, rel=1e-12)
    assert verify(problem, result.trajectory).passed
    assert "is the shortest motion, not changed to save anything: no " in str(result.notes)
    assert "run slower, to last the required 1.1 s" in result.notes[-1]


def test_so_it_is_where_planning_was_stopped(saving):
    problem, _ = saving(None, "energy", 1.1)
    result = plan(problem, FAST, interrupting_once())
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert result.duration == pytest.approx(1.1, rel=1e-12)
