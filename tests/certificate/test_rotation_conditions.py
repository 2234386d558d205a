"""Rotation conditions of the certificate."""

from dataclasses import replace

import numpy as np
import pytest
from cases import changed, wandering, with_bump
from scipy.spatial.transform import Rotation

from tubeplanner import GoalRegion, JointTrajectory, PlanningProblem, Seed, Tube, verify
from tubeplanner.certificate.enclosed_quantities import enclosed_pose
from tubeplanner.certificate.tool_conditions import least_rotation_margin
from tubeplanner.certificate.tube_visits import Visit, tube_visits

INF = np.inf
TRAY = "ur5/level_tray"


def with_tolerance(problem, tolerance):
    """Return a problem whose tube has another rotation tolerance."""
    tube = problem.tube
    bounded = Tube(
        tube.points,
        tube.radius,
        joint_signs=list(tube.joint_ranges),
        orientations=tube.orientations,
        rotation_tolerance=tolerance,
    )
    return changed(problem, tube=bounded)


# The last orientation against what the goal asks, beside what the tube asks on the way.


def at_goal(stored, bound, tolerance=None):
    """Return the condition of a tray's motion, its goal and perhaps its tube bounded otherwise."""
    problem, trajectory = stored(TRAY)
    if tolerance is not None:
        problem = with_tolerance(problem, tolerance)
    goal = GoalRegion(problem.tube.points[-1], 0.0, bound)
    return verify(changed(problem, goal=goal), trajectory).conditions["rotation"]


@pytest.fixture
def turned(stored):
    """The rotation vector from the last orientation to the end's, by size."""
    problem, trajectory = stored(TRAY)
    pose = problem.robot.tool_pose(trajectory.position([trajectory.duration]))
    return abs(problem.tube.rotation.error(*pose, problem.tube.segment_count - 1)[0])


@pytest.mark.parametrize("components", [False, True])
def test_the_end_is_judged_against_the_last_orientation(components, stored, turned):
    worst = int(turned.argmax())
    assert turned[worst] > 2e-3
    for slack in (1e-3, -1e-3):
        bound = float(np.linalg.norm(turned)) + slack
        if components:
            bound = tuple((turned + np.where(np.arange(3) == worst, slack, 0.2)).tolist())
        condition = at_goal(stored, bound, tolerance=INF)
        assert condition.margin == pytest.approx(slack, abs=1e-9)
        assert (condition.unit, condition.coverage) == ("rad", "at the goal")
        assert condition.where.time == stored(TRAY)[1].duration


def test_the_lesser_margin_counts(stored, turned):
    alone = at_goal(stored, None)
    assert alone.coverage == "for all t"
    assert at_goal(stored, 3.0) == alone
    assert at_goal(stored, float(np.linalg.norm(turned)) - 1e-3).coverage == "at the goal"


def test_a_goal_that_bounds_nothing_is_not_judged(stored):
    assert at_goal(stored, (INF, INF, INF), tolerance=INF).margin is None


# The rotation's least margin for all t, against dense evaluation and closed forms.


def pose_of(robot, trajectory):
    tube = Tube([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 1.0)
    return enclosed_pose(robot, tube, trajectory, 1e-8, 1e-9)


def least_margin(robot, tube, trajectory, visits=None):
    visits = visits or [Visit(0, 0.0, trajectory.duration)]
    return least_rotation_margin(tube.rotation, pose_of(robot, trajectory), visits)


def margins(robot, tube, trajectory, t, segment=0):
    rotation, tool = robot.tool_pose(trajectory.position(t))
    return tube.rotation.margin(rotation, tool, segment)


def referred(points, rotations, tolerance, radius=9.0, **options):
    """Return a wide tube with references at its points."""
    quaternions = [each.as_quat() for each in rotations]
    return Tube(points, radius, orientations=quaternions, rotation_tolerance=tolerance, **options)


def around(robot, trajectory, seed, tolerance, reach=0.2):
    """Return a tube near the tool whose reference turns along; its nearest points pass the ends."""
    rng = np.random.default_rng(seed)
    rotation, tool = robot.tool_pose(trajectory.position(np.array([0.0, 0.2, 0.4])))
    points = tool + rng.uniform(-reach, reach, (3, 3))
    off = Rotation.from_rotvec(rng.normal(scale=0.4, size=(3, 3)))
    return referred(points, Rotation.from_matrix(rotation) * off, tolerance)


TOLERANCES = {
    "angles": [0.5, 1.2],
    "triples": [[0.4, 0.7, INF], [INF, INF, 0.3]],
    "wide": [[3.0, 2.0, 2.5], 3.0],
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", TOLERANCES)
def test_the_least_margin_is_bracketed(name, seed, robot):
    trajectory = wandering(robot, seed)
    tube = around(robot, trajectory, seed, TOLERANCES[name])
    visits = [Visit(0, 0.0, 0.23), Visit(1, 0.23, trajectory.duration)]
    least = least_margin(robot, tube, trajectory, visits)
    t = np.linspace(0, trajectory.duration, 8_001)  # breakpoints are among them
    true = min(
        margins(robot, tube, trajectory, t[t <= 0.23], 0).min(),
        margins(robot, tube, trajectory, t[t >= 0.23], 1).min(),
    )
    assert least.lower_bound <= true + 1e-9
    assert least.attained >= true - 2e-5
    assert least.attained - least.lower_bound <= max(1e-6, 0.02 * abs(least.attained) + 3e-7)
    here = margins(robot, tube, trajectory, np.array([least.time]), least.segment)
    assert here[0] == pytest.approx(least.attained, abs=1e-6)
    assert least.intervals < 20_000


def test_touching_a_bound_is_decided(ur5):
    """The bound is set to the largest value the trajectory takes: contact without crossing."""
    trajectory, used = wandering(ur5, 0), 3.0
    for _ in range(4):
        tube = around(ur5, trajectory, 0, [[used, INF, INF], INF])
        least = least_margin(ur5, tube, trajectory)
        used -= least.attained
    assert -1e-6 < least.lower_bound <= least.attained < 1e-6
    assert least.intervals < 3000


def test_what_the_polynomials_miss_is_taken_off_the_margin(two_link):
    """Of the rotation itself; and of the tool's place, where the reference turns along."""
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.1, 0.1]], [[0.3, -1.0]]])
    tool = two_link.tool_position(trajectory.position(np.array([0.0])))[0]
    points = tool + np.array([[-0.5, 0, 0], [0.5, 0, 0]])
    tube = referred(points, Rotation.from_euler("z", [[0.0], [1.0]]), 3.0).rotation
    pose, visit, miss = pose_of(two_link, trajectory), [Visit(0, 0.0, 1.0)], 1e-2
    exact = least_rotation_margin(tube, pose, visit)
    for part in ("rotation", "tool"):
        enclosure = getattr(pose, part)
        rough = replace(pose, **{part: replace(enclosure, error=enclosure.error + miss)})
        least = least_rotation_margin(tube, rough, visit)
        assert least.attained == exact.attained
        # The reference turns by one radian over one metre.
        assert least.lower_bound <= exact.attained - miss


def turning_wrist(tray, off, speed, duration, tolerance):
    """Return the level start with its last joint turning [rad/s], and a tube about it."""
    robot, q = tray.robot, tray.start
    trajectory = JointTrajectory(robot.joint_names, [0, duration], [[[0] * 5 + [speed]], [q]])
    rotation, tool = robot.tool_pose(q[None])
    reference = Rotation.from_matrix(rotation[0]) * Rotation.from_rotvec(off)
    points = tool + np.array([[0, 0, 0], [0.1, 0, 0]])
    return trajectory, referred(points, [reference] * 2, tolerance, 0.1)


@pytest.mark.parametrize("end", [2.0, 3.5])
def test_a_turn_beyond_half_a_turn_is_followed(end, bundled):
    """Tilt 0.02 about x, then a turn by a: |v| sin(0.01) (cos(a/2), sin(a/2)), most at a = pi."""
    tray = bundled(TRAY)
    trajectory, tube = turning_wrist(tray, [-0.02, 0, 0], 1.0, end, [[0.04, 0.04, INF]])
    least = least_margin(tray.robot, tube, trajectory)
    a = np.linspace(0, end, 100_001)[1:]
    angle = 2 * np.arccos(np.clip(np.cos(0.01) * np.cos(a / 2), -1, 1))
    angle = np.minimum(angle, 2 * np.pi - angle)
    scale = angle * np.sin(0.01) / np.sin(angle / 2)
    expected = 0.04 - (scale * np.maximum(abs(np.cos(a / 2)), abs(np.sin(a / 2)))).max()
    assert expected - 1e-6 <= least.attained
    assert 0.97 * expected <= least.lower_bound <= expected + 1e-9
    assert least.attained - least.lower_bound <= 0.03 * expected
    if end > np.pi:
        assert expected == pytest.approx(0.04 - np.pi * np.sin(0.01), abs=1e-6)


def test_half_a_turn_between_two_ends_is_seen(bundled):
    """From 3 to 3.3 rad: the angle is pi in between, and at both ends less."""
    tray = bundled(TRAY)
    trajectory, tube = turning_wrist(tray, [0, 0, -3.0], 0.3, 1.0, 4.0)
    least = least_margin(tray.robot, tube, trajectory)
    assert 0.97 * (4 - np.pi) <= least.lower_bound <= 4 - np.pi + 1e-9
    assert least.attained > 4 - np.pi + 1e-6
    judged = verify(PlanningProblem(tray.robot, tube, tray.start), trajectory)
    assert judged.conditions["rotation"].margin == least.lower_bound


def test_a_spike_between_two_thousand_samples_is_found(stored):
    """The fifth joint tilts the tray by 5 degrees and back, within 20 microseconds."""
    problem, trajectory = stored(TRAY)
    regular = np.linspace(0, trajectory.duration, 2001)
    when = regular[1000] + 2e-4
    trajectory = with_bump(trajectory, 4, when, 2e-5, 0.085)
    assert margins(problem.robot, problem.tube, trajectory, regular, 1).min() > 0.05
    condition = verify(problem, trajectory).conditions["rotation"]
    assert condition.where.time == pytest.approx(when + 1e-5, abs=1e-5)
    assert condition.where.segment == 1
    assert condition.unit == "rad"
    (deepest,) = margins(problem.robot, problem.tube, trajectory, np.array([when + 1e-5]), 1)
    assert deepest < -0.01
    assert condition.margin == pytest.approx(deepest, rel=0.05)


FAR_POINTS = [[2, 0, 0], [3, 0, 0], [4, 0, 0]]
SWEEP = JointTrajectory(("joint1", "joint2"), [0, 1.0], [[[0.9, 0.0]], [[0.6, -1.0]]])


@pytest.mark.parametrize("visit", ["ordered", "any"])
@pytest.mark.parametrize(("bound", "left"), [(0.29, -0.01), (0.35, 0.05)])
def test_the_switching_time_is_when_both_rotation_tolerances_hold(two_link, visit, bound, left):
    """The tool's angle goes from -0.4 to 0.5; the references, far away, are at -0.3 and 0.3."""
    references = Rotation.from_euler("z", [[-0.3], [0.3], [0.3]])
    tube = referred(FAR_POINTS, references, [bound] * 2, visit=visit)
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])))
    pose = pose_of(two_link, SWEEP)
    visits = tube_visits(problem, SWEEP, pose.tool, pose.rotation)
    assert [visit.segment for visit in visits] == [0, 1]
    assert visits[0].end == pytest.approx(0.4 / 0.9, abs=1e-7)
    least = least_rotation_margin(tube.rotation, pose, visits)
    # Elsewhere the angle is at most 0.2 off its reference.
    assert least.attained == pytest.approx(min(left, bound - 0.2), abs=2e-7)
    assert least.lower_bound == pytest.approx(least.attained, abs=2e-3)
    condition = verify(problem, SWEEP).conditions["rotation"]
    assert (condition.margin >= -1e-6) is (left >= 0)


def test_a_segment_that_leaves_the_rotation_free_is_not_judged(two_link):
    tube = referred(FAR_POINTS, [Rotation.identity()] * 3, [[INF, INF, INF], 0.1])
    assert least_margin(two_link, tube, SWEEP) is None
    both = least_margin(two_link, tube, SWEEP, [Visit(0, 0.0, 0.5), Visit(1, 0.5, 1.0)])
    assert both.attained == pytest.approx(0.1 - 0.5, abs=1e-6)
    assert both.segment == 1


def test_a_trajectory_that_no_machine_could_make_is_left_open(two_link):
    """A million radians within a microsecond: the bound is poor, finite, and not above the true."""
    wild = JointTrajectory(two_link.joint_names, [0, 1e-6], [[[1e11, 1e11]], [[0.0, 0.0]]])
    tube = referred(FAR_POINTS[:2], [Rotation.identity()] * 2, 1)
    least = least_margin(two_link, tube, wild)
    assert 1 - np.pi - 1e-3 <= least.lower_bound <= least.attained


def test_halving_ends_after_so_many_rows(ur5, monkeypatch):
    """The bounds then count as they stand."""
    trajectory = wandering(ur5, 1)
    tube, count = around(ur5, trajectory, 1, [0.5, 0.5]), len(pose_of(ur5, trajectory).tool.width)
    whole = least_margin(ur5, tube, trajectory)
    monkeypatch.setattr("tubeplanner.certificate.tool_conditions._MAX_ROWS", count)
    least = least_margin(ur5, tube, trajectory)
    assert least.intervals == count < whole.intervals
    assert least.lower_bound < whole.lower_bound


# Between two ends that agree, in closed form: the sliding arm's tool turns about y as it lifts, its
# reference turns as the boom extends along x. So little that it is settled at the first look.


ALONG = [[0.6, 0, 0.5], [1.6, 0, 0.5]]
ACROSS = [[0.6, -1.0, 0.5], [0.6, 1.0, 0.5]]


def moved(slide, *powers):
    """Return motions of turn, extend and lift over a second by powers of time, highest first."""
    rows = np.zeros((3, 1, 3))
    rows[:, 0] = np.array(powers).T
    return JointTrajectory(slide.joint_names, [0, 1.0], rows)


STILL = [0, 0, 0]
TURN = 0.02  # of the reference [rad]
# How far the boom extends, how the tool turns, in shares of the reference's turn, and the largest
# deviation.
BETWEEN_ENDS = {
    "the tool turns": ([0, 0, 0.2], [-1.0, 1.0, 0.2], TURN, 0.25),
    "the reference turns": ([-1.0, 1.0, 0.4], [0, 0, 0.4], TURN, 0.25),
    "the reference stops half-way": ([0, 1.0, 0.5], [0, 0.5, 0.5], TURN, 0.25),
    "the reference begins half-way": ([0, 1.0, -0.5], [0, 0.5, 0.0], TURN, 0.25),
    "the reference stops for a while": ([-0.8, 0.8, 0.9], [0, 0, 0.9], TURN, 0.1),
    # Nothing jumps there, and what the tool does in between counts as it does elsewhere.
    "an unturned reference ends": ([0, 1.0, 0.5], [-1.0, 1.0, 0.2], 0.0, 0.45),
}


@pytest.mark.parametrize(
    ("extended", "turned", "reference", "largest"), BETWEEN_ENDS.values(), ids=BETWEEN_ENDS
)
def test_what_happens_between_two_ends_is_bounded(extended, turned, reference, largest, slide):
    trajectory = moved(slide, STILL, extended, TURN * np.array(turned))
    tube = referred(ALONG, Rotation.from_euler("y", [[0.0], [reference]]), [[INF, 1.0, INF]])
    dense = margins(slide, tube, trajectory, np.linspace(0, 1, 10_001)).min()
    assert dense == pytest.approx(1.0 - TURN * largest, abs=1e-12)
    least = least_margin(slide, tube, trajectory)
    assert least.intervals <= 3
    assert 0.97 * dense <= least.lower_bound <= dense + 1e-12


@pytest.mark.parametrize("beside", [-1e-3, 1e-3, 1.001, 0.999])
def test_a_tool_that_may_be_before_an_end_or_beyond_it_is_bounded(slide, beside):
    """Its place is known to a centimetre: its reference may turn by as much as it does there."""
    turn, miss = 0.5, 1e-2
    trajectory = moved(slide, STILL, [0, 0, beside], [0, 0, turn * np.clip(beside, 0, 1)])
    tube = referred(ALONG, Rotation.from_euler("y", [[0.0], [turn]]), [[INF, 1.0, INF]])
    pose = pose_of(slide, trajectory)
    rough = replace(pose, tool=replace(pose.tool, error=pose.tool.error + miss))
    least = least_rotation_margin(tube.rotation, rough, [Visit(0, 0.0, 1.0)])
    assert least.attained == pytest.approx(1.0)
    assert 0.97 <= least.lower_bound <= 1.0 - turn * (miss - 1e-3)


FAR, NEAR = Rotation.from_euler("x", 2.0), Rotation.from_euler("x", 0.02)
# How turn, boom and lift move, from and to [rad or m]; the segment; the reference at both its ends.
BENDS = {
    "the reference turns far from the tool": (
        ([0, 0.12, 0], [0, 0.89, 0]),
        ALONG,
        [Rotation.from_euler("z", angle) * FAR for angle in (-0.5, 0.5)],
    ),
    "the tool turns where a far reference ends": (
        ([-0.37, 0, 0], [0.42, 0, 0]),
        [ALONG[0], ACROSS[1]],
        [FAR, FAR],
    ),
    "both turn about different axes": (
        ([0, 0.02, -0.05], [0, 0.97, 0.06]),
        ALONG,
        [NEAR * Rotation.from_euler("z", angle) for angle in (-0.05, 0.05)],
    ),
}


@pytest.mark.parametrize(("ends", "points", "reference"), BENDS.values(), ids=BENDS)
def test_a_rotation_vector_that_bends_is_bounded(ends, points, reference, slide):
    """Joints and reference move evenly, the rotation vector does not: it just keeps its bound."""
    begin, end = np.array(ends)
    trajectory = JointTrajectory(slide.joint_names, [0, 1.0], [[end - begin], [begin]])
    wide = referred(points, reference, [[3.0, INF, INF]])
    dense = margins(slide, wide, trajectory, np.linspace(0, 1, 10_001))
    assert dense.min() < min(dense[0], dense[-1]) - 5e-4
    tube = referred(points, reference, [[3.0 - dense.min() + 1e-4, INF, INF]])
    assert 0.95e-4 <= least_margin(slide, tube, trajectory).lower_bound <= 1e-4 + 1e-9


@pytest.mark.parametrize("joint", [0, 2])
def test_a_turn_across_a_far_rotation_vector_moves_it_by_more(joint, slide):
    """By a / 2 sideways at an angle a: the tool turns there and back, about z or y."""
    angle, turned = 3.0, 5e-3
    powers = [STILL, STILL, STILL]
    powers[joint] = [-4 * turned, 4 * turned, 0]
    trajectory = moved(slide, *powers)
    bounds = np.where(np.arange(3) == (1 if joint == 0 else 2), 1.0, INF)
    tube = referred(ACROSS, [Rotation.from_euler("x", angle)] * 2, [bounds.tolist()])
    dense = margins(slide, tube, trajectory, np.linspace(0, 1, 1001)).min()
    assert dense == pytest.approx(1.0 - angle / 2 * turned, abs=1e-5)
    least = least_margin(slide, tube, trajectory)
    assert least.intervals <= 3
    assert 0.97 * dense <= least.lower_bound <= dense + 1e-12
