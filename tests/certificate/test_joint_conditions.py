"""Conditions on joints: velocity by position, continuity, start, goal, rest."""

import numpy as np
import pytest
from cases import anywhere, changed, one_joint, pose_at, quintic

from tubeplanner import (
    GoalRegion,
    JointTrajectory,
    Seed,
    Tolerance,
    ToolPose,
    load_problem,
    placement_of,
    verify,
)
from tubeplanner.certificate import joint_conditions as velocity_by_position
from tubeplanner.certificate.joint_conditions import velocity_by_position_left
from tubeplanner.certificate.judged_motion import JudgedMotion

UR5, POST = "ur5/over_the_wall", "two_link/around_a_post"

# Velocity limits that fall towards the ends, against closed forms: a bar that turns.


DECELERATION, OFFSET, LOWER, UPPER, LARGEST = 4.0, 0.6, -1.0, 2.0, 3.0
ZONE = OFFSET**2 / (2 * DECELERATION)
LAW = {"deceleration": DECELERATION, "offset": OFFSET, "lower": LOWER, "upper": UPPER}


@pytest.fixture
def bar(tmp_path):
    def limited(velocity=LARGEST, **changes):
        law = {"velocity_by_position": LAW | changes}
        return anywhere(one_joint(tmp_path, velocity=velocity, **law))

    return limited


def judged(problem, trajectory):
    return velocity_by_position_left(JudgedMotion(problem, trajectory, Tolerance()))


def course(powers, duration):
    """Return a joint's motion by a polynomial of the time, highest power first."""
    return JointTrajectory(["turn"], [0, duration], np.array(powers)[:, None, None])


def line(start, velocity):
    """Return a joint that moves on at one velocity."""
    return course([velocity, start], 0.1)


def left(q, v, offset=OFFSET):
    """Return what the law leaves at an instant, relative."""
    to_go = max(UPPER - q, 0.0) if v > 0 else max(q - LOWER, 0.0)
    return (max(0.0, np.sqrt(2 * DECELERATION * to_go) - offset) - abs(v)) / LARGEST


@pytest.mark.parametrize(
    ("start", "velocity"), [(0.0, 1.5), (1.8, 1.0), (-0.7, -1.0), (1.9, 1.5), (1.93, 1e-3)]
)
def test_on_a_line_the_end_of_it_decides(bar, start, velocity):
    condition = judged(bar(), line(start, velocity))
    worst = left(start + 0.1 * velocity, velocity)
    assert condition.margin == pytest.approx(worst, abs=2e-9)
    assert condition.where.joint == "turn"
    assert condition.where.time == pytest.approx(0.1, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("fraction", [1 - 1e-6, 1 + 1e-6])
def test_a_millionth_decides_between_samples(bar, sign, fraction):
    """A quintic that touches the law somewhere in the middle, by its duration."""
    end = 0.9 * (UPPER - ZONE) if sign > 0 else 0.9 * (LOWER + ZONE)
    shape = quintic(end, 1.0)
    at = shape.at(np.linspace(0, 1, 400_001)[1:-1])
    to_go = UPPER - at.position[:, 0] if sign > 0 else at.position[:, 0] - LOWER
    slowest = (abs(at.velocity[:, 0]) / (np.sqrt(2 * DECELERATION * to_go) - OFFSET)).max()
    trajectory = shape.scaled(slowest * fraction)
    condition = judged(bar(), trajectory)
    assert (condition.margin > 0) == (fraction > 1)
    assert abs(condition.margin) < 1.1e-6
    assert 0 < condition.where.time < trajectory.duration
    failures = verify(bar(), trajectory, Tolerance(1e-6, 1e-8)).failures()
    assert ("velocity" in failures) == (fraction < 1)


@pytest.mark.parametrize(
    ("start", "velocity"),
    [(UPPER - ZONE / 2, 0.0), (UPPER - ZONE / 2, 1e-3), (LOWER, 0.0), (UPPER + 0.5, 0.0)],
)
def test_where_it_must_not_move_on_it_may_rest(bar, start, velocity):
    condition = judged(bar(), line(start, velocity))
    assert condition.margin == pytest.approx(-velocity / LARGEST, abs=1e-12)
    assert condition.coverage == "for all t"


@pytest.mark.parametrize(
    ("start", "goal", "end"), [(UPPER, 0.0, {"upper": UPPER}), (LOWER, 1.0, {"lower": LOWER})]
)
def test_leaving_an_end_asks_nothing_of_that_end(bar, start, goal, end):
    """However fast: what is left is that of the other end, or nothing where it rests."""
    rows = np.add(quintic(goal - start, 0.3).coefficients.ravel(), [0, 0, 0, 0, 0, start])
    wide = {"lower": -1e4, "upper": 1e4}
    assert judged(bar(offset=0.0, **wide), course(rows, 0.3)).margin > 0
    away = judged(bar(**{**wide, **end}), course(rows, 0.3))
    assert away.margin == pytest.approx(0.0, abs=1e-9)


def test_without_an_offset_the_end_is_come_to_at_the_deceleration(bar):
    """v^2 = 2 d (u - q) all the way: the margin is 0 throughout, to rounding."""
    duration, speed = 0.5, DECELERATION * 0.5
    exact = course([-DECELERATION / 2, speed, UPPER - speed * duration / 2], duration)
    problem = bar(offset=0.0)
    assert judged(problem, exact).margin == pytest.approx(0.0, abs=1e-6)
    assert judged(problem, exact.scaled(1.001)).margin > -1e-6
    assert judged(problem, exact.scaled(0.999)).margin < -1e-4


def test_the_certificate_names_it_velocity(bar):
    """The worse of both: of the limit that does not change, or of the one that does."""

    def margin(problem, motion):
        return verify(problem, motion).conditions["velocity"].margin

    assert margin(bar(upper=5.0), line(1.5, 0.2)) == pytest.approx(1 - 0.2 / LARGEST)
    assert margin(bar(upper=5.0), line(0.0, 2.9)) == pytest.approx(1 - 2.9 / LARGEST)
    near = line(1.5, 1.2)
    assert margin(bar(), near) == pytest.approx(left(1.62, 1.2), abs=1e-8)
    # Without the other limit it is relative to the largest velocity that the law allows.
    expected = left(1.62, 1.2) * LARGEST / np.sqrt(24)
    assert margin(bar(velocity=np.inf), near) == pytest.approx(expected, abs=1e-8)


def test_without_such_a_limit_it_is_not_required(tmp_path):
    assert judged(anywhere(one_joint(tmp_path)), line(1.5, 1.2)).margin is None


def test_a_verdict_that_costs_too_much_is_undecided_and_safe(bar, monkeypatch):
    trajectory = quintic(1.7, 1.5)
    exact = judged(bar(), trajectory).margin
    monkeypatch.setattr(velocity_by_position, "_MAX_ROWS", 1)
    condition = judged(bar(), trajectory)
    assert "undecided" in condition.coverage
    assert condition.margin < exact


# Jumps between the pieces of a trajectory: found, added up, measured by what is large.


def raised(trajectory, order, piece, joint, size):
    """Return the trajectory with a coefficient of one piece changed: a jump at its ends."""
    coefficients = trajectory.coefficients.copy()
    coefficients[-1 - order, piece, joint] += size
    return JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)


@pytest.mark.parametrize("to_and_fro", [False, True])
def test_many_small_jumps_add_up_in_radians(two_link, to_and_fro):
    """A staircase up, or up and down, in no time; each step is within the tolerance.

    Shares of the largest position do not count.
    """
    problem = load_problem("example:two_link/paper_1_30mm")
    steps, height, tolerance = 600, 8e-4, Tolerance(1e-3, 0.9)
    k = np.arange(steps) % 2 if to_and_fro else np.arange(steps)
    q = np.array([1.0, 0.5]) + height * k[:, None] * np.array([1.0, 0.0])
    times = np.linspace(0.0, 0.01, steps + 1)
    staircase = JointTrajectory(two_link.joint_names, times, q[None])
    condition = verify(problem, staircase, tolerance).conditions["continuity"]
    assert condition.margin == pytest.approx(-height * (steps - 1))
    assert (condition.unit, condition.where.joint) == ("rad", "joint1")
    assert not condition.holds(tolerance)


def test_the_rounding_errors_of_a_joint_at_rest_are_no_jumps(stored):
    """The joint that stands still is given the noise that sums of large numbers leave."""
    problem, trajectory = stored(UR5)
    still = trajectory.coefficients.copy()
    still[:, :, 5] = 0.0
    still[:-1, :, 5] = np.random.default_rng(0).normal(size=still[:-1, :, 5].shape) * 1e-15
    noisy = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, still)
    assert not {"rest", "continuity"} & set(verify(problem, noisy).failures())


@pytest.mark.parametrize("order", [1, 2])
def test_a_jump_is_found_and_measured_by_the_largest_however_slow(order, stored):
    problem, trajectory = stored(POST, "branch-and-bound")
    jumping = raised(trajectory, order, 3, 1, 0.5)
    dense = jumping.per_piece(2000)
    worst = []
    for values in (dense.velocity, dense.acceleration):
        ends = values.reshape(-1, 2000, 2)[:, [0, -1]]
        jumps = abs(ends[1:, 0] - ends[:-1, 1]) / abs(values).max(axis=0)
        worst.append(jumps.sum(axis=0).max())
    found, slower = (
        verify(problem, each, Tolerance(0.9, 0.0)).conditions["continuity"]
        for each in (jumping, jumping.scaled(50.0))
    )
    assert found.margin == pytest.approx(-max(worst), rel=1e-3)
    assert slower.margin == pytest.approx(found.margin, rel=1e-9)
    assert found.where.joint == "joint2"
    assert found.where.time in trajectory.breakpoints[[3, 4]]


# Start and goal: what is missed, by how much, and by which joint.


def test_another_start_or_goal_is_found(stored):
    problem, trajectory = stored("panda/between_shelves")
    for end in ("start", "goal"):
        q = getattr(problem, end) + 1e-4
        certificate = verify(changed(problem, **{end: q}), trajectory)
        assert certificate.failures() == [end]
        assert certificate.conditions[end].margin == pytest.approx(-1e-4)


def test_the_joint_that_is_farthest_from_the_start_is_named(stored):
    problem, trajectory = stored(UR5)
    other = problem.start + 1e-4 - np.where(np.arange(6) == 2, 5e-3, 0.0)
    condition = verify(changed(problem, start=other), trajectory).conditions["start"]
    assert condition.margin == pytest.approx(-4.9e-3, abs=1e-9)
    assert (condition.where.joint, condition.where.time) == ("elbow_joint", 0.0)


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_tool_that_is_not_at_the_reference_point_is_found(end, stored):
    """Where any configuration will do that has the tool there."""
    problem, trajectory = stored(UR5)
    free = changed(problem, start=Seed(problem.start), goal=None)
    times = (0.0, 0.9) if end == "goal" else (0.1, 1.0)
    part = trajectory.between(*(fraction * trajectory.duration for fraction in times))
    index, time = (-1, part.duration) if end == "goal" else (0, 0.0)
    tool = problem.robot.tool_position(part.position([time]))[0]
    away = np.linalg.norm(tool - problem.tube.points[index])
    conditions = verify(free, part).conditions
    assert away > 1e-4
    assert conditions[end].margin == pytest.approx(-away)
    assert (conditions[end].unit, conditions[end].where.time) == ("m", time)
    assert conditions["goal" if end == "start" else "start"].margin > -1e-6


@pytest.mark.parametrize("tolerance", [0.0, 0.02])
def test_how_far_the_tool_is_inside_its_ball_is_the_goals_margin(tolerance, stored):
    problem, trajectory = stored(UR5)
    position = problem.tube.points[-1] + [0.003, -0.004, 0.0]
    certificate = verify(changed(problem, goal=GoalRegion(position, tolerance)), trajectory)
    goal = certificate.conditions["goal"]
    assert goal.margin == pytest.approx(tolerance - 0.005, abs=1e-6)
    assert (goal.unit, goal.where.time) == ("m", trajectory.duration)
    assert goal.coverage == f"tool within {tolerance:g} m of the goal's position"
    assert certificate.failures() == ([] if tolerance > 0.005 else ["goal"])


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize(
    ("shift", "rpy", "unit", "margin"),
    [
        ([0, 0, 0], [0, 0, 0], None, 0.0),
        ([0, 0, 2e-3], [0, 0, 1e-3], "m", -2e-3),
        ([0, 1e-3, 0], [0, 2e-3, 0], "rad", -2e-3),
    ],
)
def test_a_tool_that_is_not_at_its_pose_is_found(end, shift, rpy, unit, margin, stored):
    problem, trajectory = stored(UR5)
    time = 0.0 if end == "start" else trajectory.duration
    pose = pose_at(problem, trajectory.position([time])[0])
    off = ToolPose(pose.placement @ placement_of(shift, rpy))
    condition = verify(changed(problem, **{end: off}), trajectory).conditions[end]
    assert condition.margin == pytest.approx(margin, abs=1e-9)
    assert unit in (None, condition.unit)
    assert (condition.coverage, condition.where.time) == ("tool at its pose", time)


# A trajectory that still moves at an end: found, at its joint, measured by its largest rates.


@pytest.mark.parametrize("at_end", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_motion_at_an_end_is_measured_by_the_largest(order, at_end, stored):
    """A slope or a bend of one joint at the start or the end, as a fraction of its largest."""
    problem, trajectory = stored(POST, "branch-and-bound")
    moving = raised(trajectory, order, -1 if at_end else 0, 1, 0.3)
    dense = moving.per_piece(2000)
    time = moving.duration if at_end else 0.0
    fractions = [
        abs(rate(time)[1]) / abs(values[:, 1]).max()
        for rate, values in (
            (moving.velocity, dense.velocity),
            (moving.acceleration, dense.acceleration),
        )
    ]
    certificate = verify(problem, moving)
    condition = certificate.conditions["rest"]
    assert "rest" in certificate.failures()
    assert condition.margin == pytest.approx(-max(fractions), rel=1e-3)
    assert (condition.where.time, condition.where.joint) == (time, "joint2")
