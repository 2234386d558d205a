"""Conditions on joints: position, velocity to jerk, signs, continuity, start, goal, rest."""

from itertools import pairwise

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
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.judged import velocity_by_position
from tubeplanner.verification.judged.velocity_by_position import velocity_by_position_left
from tubeplanner.verification.judged_motion import JudgedMotion

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


def line(start, velocity, duration=0.1):
    """Return a joint that moves on at one velocity."""
    return JointTrajectory(["turn"], [0, duration], np.array([[[velocity]], [[start]]]))


def left(q, v, offset=OFFSET):
    """Return what the law leaves at an instant, relative."""
    to_go = max(UPPER - q, 0.0) if v > 0 else max(q - LOWER, 0.0)
    return (max(0.0, np.sqrt(2 * DECELERATION * to_go) - offset) - abs(v)) / LARGEST


@pytest.mark.parametrize(
    ("start", "velocity"),
    [(0.0, 1.5), (1.0, 2.0), (1.8, 1.0), (0.0, -1.5), (-0.7, -1.0), (1.9, 1.5), (1.93, 1e-3)],
)
def test_on_a_line_the_end_of_it_decides(bar, start, velocity):
    trajectory = line(start, velocity)
    condition = judged(bar(), trajectory)
    worst = left(start + 0.1 * velocity, velocity)
    assert condition.margin == pytest.approx(worst, abs=2e-9)
    assert condition.where.joint == "turn"
    assert condition.where.time == pytest.approx(0.1, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [1 - 1e-6, 1 + 1e-6])
def test_a_millionth_decides_between_samples(bar, sign, share):
    """A quintic that touches the law somewhere in the middle, by its duration."""
    end = 0.9 * (UPPER - ZONE) if sign > 0 else 0.9 * (LOWER + ZONE)
    shape = quintic(end, 1.0)
    at = shape.at(np.linspace(0, 1, 400_001)[1:-1])
    to_go = UPPER - at.position[:, 0] if sign > 0 else at.position[:, 0] - LOWER
    slowest = (abs(at.velocity[:, 0]) / (np.sqrt(2 * DECELERATION * to_go) - OFFSET)).max()
    trajectory = shape.scaled(slowest * share)
    condition = judged(bar(), trajectory)
    assert (condition.margin > 0) == (share > 1)
    assert abs(condition.margin) < 1.1e-6
    assert 0 < condition.where.time < trajectory.duration
    failures = verify(bar(), trajectory, Tolerance(1e-6, 1e-8)).failures()
    assert ("velocity" in failures) == (share < 1)


def test_a_short_bump_is_found(bar):
    """A thousandth of the duration, at ten times the velocity of the rest."""
    times = np.cumsum([0.0, 0.3171, 0.001, 0.7])
    rates = np.array([0.1, 1.5, 0.1])
    places = 1.5 + np.cumsum([0.0, *(rates * np.diff(times))])[:-1]
    trajectory = JointTrajectory(["turn"], times, np.array([rates, places])[:, :, None])
    condition = judged(bar(), trajectory)
    assert condition.margin == pytest.approx(left(places[2], 1.5), abs=1e-6)
    assert 0.3171 <= condition.where.time <= 0.3181


@pytest.mark.parametrize(
    ("start", "velocity", "margin"),
    [
        (UPPER, 0.0, 0.0),
        (UPPER - ZONE / 2, 0.0, 0.0),
        (UPPER - ZONE / 2, 1e-9, -1e-9 / LARGEST),
        (UPPER - ZONE / 2, 1e-3, -1e-3 / LARGEST),
        (LOWER, 0.0, 0.0),
        (UPPER + 0.5, 0.0, 0.0),
    ],
)
def test_where_it_must_not_move_on_it_may_rest(bar, start, velocity, margin):
    condition = judged(bar(), line(start, velocity))
    assert condition.margin == pytest.approx(margin, abs=1e-12)
    assert condition.coverage == "for all t"


@pytest.mark.parametrize(("start", "goal"), [(UPPER, 0.0), (LOWER, 1.0)])
def test_leaving_an_end_asks_nothing_of_that_end(bar, start, goal):
    """However fast: what is left is that of the other end, or nothing where it rests."""
    move = quintic(goal - start, 0.3)
    rows = move.coefficients.copy()
    rows[-1] += start
    condition = judged(
        bar(offset=0.0, lower=-1e4, upper=1e4), JointTrajectory(["turn"], [0, 0.3], rows)
    )
    assert condition.margin > 0
    away = judged(
        bar(upper=UPPER if start > 0 else 1e4, lower=LOWER if start < 0 else -1e4),
        JointTrajectory(["turn"], [0, 0.3], rows),
    )
    assert away.margin == pytest.approx(0.0, abs=1e-9)


def test_without_an_offset_the_end_is_come_to_at_the_deceleration(bar):
    """v^2 = 2 d (u - q) all the way: the margin is 0 throughout, to rounding."""
    duration, speed = 0.5, DECELERATION * 0.5
    rows = np.array([-DECELERATION / 2, speed, UPPER - speed * duration / 2])[:, None, None]
    exact = JointTrajectory(["turn"], [0, duration], rows)
    problem = bar(offset=0.0)
    assert judged(problem, exact).margin == pytest.approx(0.0, abs=1e-6)
    assert judged(problem, exact.scaled(1.001)).margin > -1e-6
    assert judged(problem, exact.scaled(0.999)).margin < -1e-4


@pytest.mark.parametrize(("velocity", "largest"), [(LARGEST, LARGEST), (np.inf, np.sqrt(24.0))])
def test_it_is_relative_to_the_joints_largest(bar, velocity, largest):
    condition = judged(bar(velocity=velocity), line(1.8, 1.0))
    assert condition.margin == pytest.approx(left(1.9, 1.0) * LARGEST / largest, abs=1e-8)


def test_the_certificate_names_it_velocity(bar):
    """The worse of both: of the limit that does not change, or of the one that does."""
    slow, fast = line(1.5, 0.2), line(0.0, 2.9)
    conditions = [verify(bar(upper=5.0), motion).conditions["velocity"] for motion in (slow, fast)]
    assert conditions[0].margin == pytest.approx(1 - 0.2 / LARGEST)
    assert conditions[1].margin == pytest.approx(1 - 2.9 / LARGEST)
    near = verify(bar(), line(1.5, 1.2)).conditions["velocity"]
    assert near.margin == pytest.approx(left(1.62, 1.2), abs=1e-8)
    unlimited = verify(bar(velocity=np.inf), line(1.5, 1.2)).conditions["velocity"]
    assert unlimited.margin == pytest.approx(near.margin * LARGEST / np.sqrt(24), abs=1e-8)


def test_without_such_a_limit_it_is_not_required(tmp_path):
    condition = judged(anywhere(one_joint(tmp_path)), line(1.5, 1.2))
    assert condition.margin is None


def test_a_verdict_that_costs_too_much_is_undecided_and_safe(bar, monkeypatch):
    trajectory = quintic(1.7, 1.5)
    exact = judged(bar(), trajectory).margin
    monkeypatch.setattr(velocity_by_position, "_MAX_ROWS", 1)
    condition = judged(bar(), trajectory)
    assert "undecided" in condition.coverage
    assert condition.margin < exact


# Jumps between the pieces of a trajectory: found, added up, measured by what is large.


UR5 = "ur5/over_the_wall"


@pytest.mark.parametrize(
    ("order", "condition"), [(0, "continuity"), (1, "continuity"), (2, "continuity")]
)
def test_a_jump_is_found_at_its_joint_and_time(order, condition, stored):
    problem, trajectory = stored(UR5)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1 - order, 20, 3] += 1e-3
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    certificate = verify(problem, jumping)
    assert condition in certificate.failures()
    where = certificate.conditions[condition].where
    assert where.joint == "wrist_1_joint"
    assert where.time in trajectory.breakpoints[[20, 21]]


def test_a_jump_of_position_is_judged_in_radians(stored):
    """There and back: a milliradian in sum, within a thousandth but not within the tolerance."""
    problem, trajectory = stored(UR5)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1, 20, 1] += 5e-4
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    certificate = verify(problem, jumping, Tolerance(1e-4, 1e-3))
    condition = certificate.conditions["continuity"]
    assert "continuity" in certificate.failures()
    assert condition.unit == "rad"
    assert condition.margin == pytest.approx(-1e-3, rel=1e-6)


def test_many_small_jumps_add_up(two_link):
    """A staircase turns a joint by half a radian in no time; each step is within the tolerance."""
    problem = load_problem("example:two_link/paper_1_30mm")
    steps, tolerance = 600, Tolerance(1e-3, 1e-3)
    start = np.array([1.0, 0.5])
    q = start + np.linspace(0.0, 0.5, steps)[:, None] * np.array([1.0, 0.0])
    times = np.linspace(0.0, 0.01, steps + 1)
    staircase = JointTrajectory(two_link.joint_names, times, q[None])
    assert abs(np.diff(q, axis=0)).max() < tolerance.absolute
    condition = verify(problem, staircase, tolerance).conditions["continuity"]
    assert condition.margin == pytest.approx(-0.5)
    assert not condition.holds(tolerance)


def test_slices_that_are_shifted_add_up(stored):
    problem, trajectory = stored(UR5)
    times = np.linspace(0.0, trajectory.duration, 3001)
    parts = [trajectory.between(a, b) for a, b in pairwise(times)]
    whole = concatenate([part for part in parts if len(part.widths) == 1])
    coefficients = whole.coefficients.copy()
    coefficients[-1, :, 2] += 8e-7 * (np.arange(len(whole.widths)) % 2)
    shifted = JointTrajectory(whole.joint_names, whole.breakpoints, coefficients)
    condition = verify(problem, shifted).conditions["continuity"]
    assert condition.where.joint == "elbow_joint"
    assert condition.margin < -1e-3


def test_the_rounding_errors_of_a_joint_at_rest_are_no_jumps(stored):
    """The joint that stands still is given the noise that sums of large numbers leave."""
    problem, trajectory = stored(UR5)
    still = trajectory.coefficients.copy()
    still[:, :, 5] = 0.0
    still[:-1, :, 5] = np.random.default_rng(0).normal(size=still[:-1, :, 5].shape) * 1e-15
    noisy = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, still)
    failures = verify(problem, noisy).failures()
    assert "rest" not in failures
    assert "continuity" not in failures


@pytest.mark.parametrize("order", [1, 2])
def test_a_jump_is_measured_by_the_largest(order, stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    joint, piece = 1, 3
    coefficients = trajectory.coefficients.copy()
    coefficients[-1 - order, piece, joint] += 0.5
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    dense = jumping.per_piece(2000)
    values = (dense.position, dense.velocity, dense.acceleration)
    ends = [value.reshape(-1, 2000, 2)[:, [0, -1]] for value in values]
    jumps = [abs(end[1:, 0] - end[:-1, 1]) for end in ends]
    shares = [jump / abs(v).max(axis=0) for jump, v in zip(jumps, values, strict=True)]
    worst = max(float(share.sum(axis=0).max()) for share in shares[1:])
    condition = verify(problem, jumping, Tolerance(0.5, 0.0)).conditions["continuity"]
    assert condition.margin == pytest.approx(-worst, rel=1e-3)


@pytest.mark.parametrize("slower", [1.0, 50.0])
def test_a_jump_counts_the_same_however_slow_the_trajectory(slower, stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    coefficients = trajectory.coefficients.copy()
    coefficients[-2, 3, 1] += 0.5
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    tolerance = Tolerance(0.9, 0.0)
    fast = verify(problem, jumping, tolerance).conditions["continuity"]
    slow = verify(problem, jumping.scaled(slower), tolerance).conditions["continuity"]
    assert slow.margin == pytest.approx(fast.margin, rel=1e-9)


# Start and goal: what is missed, by how much, and by which joint.


def test_another_start_or_goal_is_found(stored):
    problem, trajectory = stored("panda/between_shelves")
    for end in ("start", "goal"):
        q = getattr(problem, end) + 1e-4
        certificate = verify(changed(problem, **{end: q}), trajectory)
        assert certificate.failures() == [end]
        assert certificate.conditions[end].margin == pytest.approx(-1e-4)


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_the_joint_that_is_farthest_from_the_start_is_named(joint, stored):
    problem, trajectory = stored(UR5)
    other = np.array(problem.start)
    other += 1e-4
    other[joint] -= 5e-3
    condition = verify(changed(problem, start=other), trajectory).conditions["start"]
    assert condition.margin == pytest.approx(-4.9e-3, abs=1e-9)
    assert condition.where.joint == problem.robot.joint_names[joint]


def test_two_joints_in_each_others_place_are_found_at_the_start(stored):
    problem, trajectory = stored(UR5)
    names = list(problem.robot.joint_names)
    names[0], names[1] = names[1], names[0]
    certificate = verify(
        problem, JointTrajectory(names, trajectory.breakpoints, trajectory.coefficients)
    )
    assert "start" in certificate.failures()
    assert certificate.conditions["start"].where.joint in names[:2]
    assert certificate.conditions["start"].where.time == 0.0


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_tool_that_is_not_at_the_reference_point_is_found(end, stored):
    """Where any configuration will do that has the tool there."""
    problem, trajectory = stored(UR5)
    free = changed(problem, start=Seed(problem.start), goal=None)
    times = (0.0, 0.9) if end == "goal" else (0.1, 1.0)
    part = trajectory.between(*(share * trajectory.duration for share in times))
    index, time = (-1, part.duration) if end == "goal" else (0, 0.0)
    tool = problem.robot.tool_position(part.position([time]))[0]
    away = np.linalg.norm(tool - problem.tube.points[index])
    conditions = verify(free, part).conditions
    assert away > 1e-4
    assert conditions[end].margin == pytest.approx(-away)
    assert (conditions[end].unit, conditions[end].where.time) == ("m", time)
    assert conditions["goal" if end == "start" else "start"].margin > -1e-6


@pytest.mark.parametrize("tolerance", [0.0, 0.003, 0.02])
def test_how_far_the_tool_is_inside_its_ball_is_the_goals_margin(tolerance, stored):
    problem, trajectory = stored(UR5)
    position = problem.tube.points[-1] + [0.003, -0.004, 0.0]
    ending = changed(problem, goal=GoalRegion(position, tolerance))
    certificate = verify(ending, trajectory)
    goal = certificate.conditions["goal"]
    assert goal.margin == pytest.approx(tolerance - 0.005, abs=1e-6)
    assert (goal.unit, goal.where.time) == ("m", trajectory.duration)
    assert goal.coverage == f"tool within {tolerance:g} m of the goal's position"
    assert certificate.failures() == ([] if tolerance > 0.005 else ["goal"])


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_tool_that_is_not_at_its_pose_is_found(end, stored):
    problem, trajectory = stored(UR5)
    q = trajectory.position([0.0 if end == "start" else trajectory.duration])[0]
    pose = pose_at(problem, q)
    for shift, rpy, unit, margin in (
        ([0, 0, 0], [0, 0, 0], None, 0.0),
        ([0, 0, 2e-3], [0, 0, 1e-3], "m", -2e-3),
        ([0, 1e-3, 0], [0, 2e-3, 0], "rad", -2e-3),
    ):
        off = ToolPose(pose.placement @ placement_of(shift, rpy))
        condition = verify(changed(problem, **{end: off}), trajectory).conditions[end]
        assert condition.margin == pytest.approx(margin, abs=1e-9)
        assert unit in (None, condition.unit)
        assert condition.coverage == "tool at its pose"
        assert condition.where.time == (0.0 if end == "start" else trajectory.duration)


# A trajectory that still moves at an end: found, at its joint, measured by its largest rates.


def test_a_trajectory_that_does_not_stop_is_found(stored):
    problem, trajectory = stored(UR5)
    moving = trajectory.between(0.0, trajectory.duration * 0.97)
    failures = verify(problem, moving).failures()
    assert {"rest", "goal"} <= set(failures)


@pytest.mark.parametrize("at_end", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_trajectory_at_an_end_is_measured_by_the_largest(order, at_end, stored):
    """A slope or a bend of one joint at the start or the end, as a share of its largest."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    joint = 1
    coefficients = trajectory.coefficients.copy()
    piece = -1 if at_end else 0
    coefficients[-1 - order, piece, joint] += 0.3
    moving = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    rate = moving.velocity if order == 1 else moving.acceleration
    dense = moving.per_piece(2000)
    largest = abs((dense.velocity, dense.acceleration)[order - 1][:, joint]).max()
    time = moving.duration if at_end else 0.0
    condition = verify(problem, moving).conditions["rest"]
    shares = [
        abs(f(time)[joint]) / abs(values[:, joint]).max()
        for f, values in (
            (moving.velocity, dense.velocity),
            (moving.acceleration, dense.acceleration),
        )
    ]
    assert abs(rate(time)[joint]) / largest in shares
    assert condition.margin == pytest.approx(-max(shares), rel=1e-3)
    assert condition.where.time == time
    assert condition.where.joint == "joint2"
