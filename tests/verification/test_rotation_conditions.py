"""Rotation conditions of the certificate."""

from dataclasses import replace

import numpy as np
import pytest
from cases import changed
from scipy.spatial.transform import Rotation

from tubeplanner import GoalRegion, JointTrajectory, PlanningProblem, Seed, Tube, verify
from tubeplanner.verification.enclosed_pose import enclosed_pose
from tubeplanner.verification.rotation_visits import least_rotation_margin
from tubeplanner.verification.tube_visits import Visit, tube_visits

# The last orientation against what the goal asks, beside what the tube asks on the way.


TRAY = "ur5/level_tray"


def ended(stored, bound, tolerance=None):
    """Return the condition of a tray's motion, its goal and perhaps its tube bounded otherwise."""
    problem, trajectory = stored(TRAY)
    tube = problem.tube
    if tolerance is not None:
        tube = Tube(
            tube.points,
            tube.radius,
            joint_signs=list(tube.joint_ranges),
            orientations=tube.orientations,
            rotation_tolerance=tolerance,
        )
    goal = GoalRegion(tube.points[-1], 0.0, bound)
    certificate = verify(changed(problem, tube=tube, goal=goal), trajectory)
    return certificate.conditions["rotation"], trajectory


def vector(stored):
    """Return the rotation vector from the last orientation to the end's."""
    problem, trajectory = stored(TRAY)
    rotation, tool = problem.robot.tool_pose(trajectory.position([trajectory.duration]))
    return problem.tube.rotation.error(rotation, tool, problem.tube.segment_count - 1)[0]


@pytest.mark.parametrize("components", [False, True])
def test_the_end_is_judged_against_the_last_orientation(components, stored):
    turned = abs(vector(stored))
    worst = int(turned.argmax())
    assert turned[worst] > 2e-3
    room = np.where(np.arange(3) == worst, 1e-3, 0.2)
    bound = tuple((turned + room).tolist()) if components else float(np.linalg.norm(turned)) + 1e-3
    condition, trajectory = ended(stored, bound, tolerance=np.inf)
    assert condition.margin == pytest.approx(1e-3, abs=1e-9)
    assert (condition.unit, condition.coverage) == ("rad", "at the goal")
    assert condition.where.time == trajectory.duration
    less = tuple(value - 2e-3 for value in bound) if components else bound - 2e-3
    assert ended(stored, less, tolerance=np.inf)[0].margin == pytest.approx(-1e-3, abs=1e-9)


def test_the_lesser_margin_counts(stored):
    alone, _ = ended(stored, None)
    assert alone.coverage == "for all t"
    wide, _ = ended(stored, 3.0)
    assert wide == alone
    tight = float(np.linalg.norm(vector(stored))) - 1e-3
    if tight > 0:
        assert ended(stored, tight)[0].coverage == "at the goal"


def test_a_goal_that_bounds_nothing_is_not_judged(stored):
    free, _ = ended(stored, (np.inf, np.inf, np.inf), tolerance=np.inf)
    assert free.margin is None


# The rotation's least margin for all t, against dense evaluation and closed forms.


INF = np.inf


def pose_of(robot, trajectory):
    return enclosed_pose(robot, trajectory, 1e-8, 1e-9)


def wavy(robot, seed, pieces=4, width=0.1):
    """Return cubics that wander about, continuous in position only."""
    rng = np.random.default_rng(seed)
    n = robot.joint_count
    first = np.clip(rng.uniform(-1, 1, n), robot.limits.lower_position, robot.limits.upper_position)
    knots = first + np.cumsum(rng.uniform(-0.3, 0.35, (pieces + 1, n)), axis=0)
    bend = rng.uniform(-3, 3, (pieces, n))
    slope = np.diff(knots, axis=0) / width - bend * width
    coefficients = np.stack([bend, slope, knots[:-1]])
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), coefficients)


def margins(robot, tube, trajectory, t, segment):
    rotation, tool = robot.tool_pose(trajectory.position(t))
    return tube.rotation.margin(rotation, tool, segment)


def around(robot, trajectory, seed, tolerance, reach=0.2):
    """Return a tube near the tool whose reference turns along; its nearest points pass the ends."""
    rng = np.random.default_rng(seed)
    rotation, tool = robot.tool_pose(trajectory.position(np.array([0.0, 0.2, 0.4])))
    points = tool + rng.uniform(-reach, reach, (3, 3))
    off = Rotation.from_rotvec(rng.normal(scale=0.4, size=(3, 3)))
    quaternions = (Rotation.from_matrix(rotation) * off).as_quat()
    return Tube(points, 9.0, orientations=quaternions, rotation_tolerance=tolerance)


TOLERANCES = {
    "angles": [0.5, 1.2],
    "triples": [[0.4, 0.7, INF], [INF, INF, 0.3]],
    "wide": [[3.0, 2.0, 2.5], 3.0],
}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", TOLERANCES)
def test_the_least_margin_is_bracketed(name, seed, robot):
    trajectory = wavy(robot, seed)
    tube = around(robot, trajectory, seed, TOLERANCES[name])
    visits = [Visit(0, 0.0, 0.23), Visit(1, 0.23, trajectory.duration)]
    least = least_rotation_margin(tube.rotation, pose_of(robot, trajectory), visits)
    t = np.linspace(0, trajectory.duration, 40_001)
    early, late = t[t <= 0.23], t[t >= 0.23]
    true = min(
        margins(robot, tube, trajectory, early, 0).min(),
        margins(robot, tube, trajectory, late, 1).min(),
    )
    assert least.lower_bound <= true + 1e-9
    assert least.attained >= true - 2e-5
    assert least.attained - least.lower_bound <= max(1e-6, 0.02 * abs(least.attained) + 3e-7)
    here = margins(robot, tube, trajectory, np.array([least.time]), least.segment)
    assert here[0] == pytest.approx(least.attained, abs=1e-6)
    assert least.intervals < 20_000


@pytest.mark.parametrize("seed", range(4))
def test_touching_a_bound_is_decided(seed, ur5):
    """The bound is set to the largest value the trajectory takes: contact without crossing."""
    trajectory = wavy(ur5, seed)
    wide = around(ur5, trajectory, seed, [[3.0, INF, INF], INF])
    visit = [Visit(0, 0.0, trajectory.duration)]
    pose, used = pose_of(ur5, trajectory), 3.0
    for _ in range(4):
        again = Tube(
            wide.points,
            9.0,
            orientations=wide.orientations,
            rotation_tolerance=[[used, INF, INF], INF],
        )
        least = least_rotation_margin(again.rotation, pose, visit)
        used -= least.attained
    assert -1e-6 < least.lower_bound <= least.attained < 1e-6
    assert least.intervals < 3000


def test_what_the_polynomials_miss_is_taken_off_the_margin(two_link):
    """Of the rotation itself; and of the tool's place, where the reference turns along."""
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.1, 0.1]], [[0.3, -1.0]]])
    tool = two_link.tool_position(trajectory.position(np.array([0.0])))[0]
    points = tool + np.array([[-0.5, 0, 0], [0.5, 0, 0]])
    quaternions = Rotation.from_euler("z", [[0.0], [1.0]]).as_quat()
    tube = Tube(points, 9.0, orientations=quaternions, rotation_tolerance=3.0).rotation
    pose, visit, miss = pose_of(two_link, trajectory), [Visit(0, 0.0, 1.0)], 1e-2
    exact = least_rotation_margin(tube, pose, visit)
    for part in ("rotation", "tool"):
        enclosure = getattr(pose, part)
        rough = replace(pose, **{part: replace(enclosure, error=enclosure.error + miss)})
        least = least_rotation_margin(tube, rough, visit)
        assert least.attained == exact.attained
        # The reference turns by one radian over one metre.
        assert least.lower_bound <= exact.attained - miss


def turning_wrist(ur5, tray, end):
    """Return the level start with the last joint turning at one rad/s, and a tube about it."""
    q = tray.start
    trajectory = JointTrajectory(ur5.joint_names, [0, end], [[[0] * 5 + [1.0]], [q]])
    rotation, tool = ur5.tool_pose(q[None])
    tilted = Rotation.from_matrix(rotation[0]) * Rotation.from_rotvec([-0.02, 0, 0])
    points = tool + np.array([[0, 0, 0], [0.1, 0, 0]])
    return trajectory, Tube(
        points, 0.1, orientations=[tilted.as_quat()] * 2, rotation_tolerance=[[0.04, 0.04, INF]]
    )


@pytest.mark.parametrize("end", [2.0, 3.5, 6.2])
def test_a_turn_beyond_half_a_turn_is_followed(end, bundled):
    """Tilt 0.02 about x, then a turn by a: |v| sin(0.01) (cos(a/2), sin(a/2)), most at a = pi."""
    tray = bundled("ur5/level_tray")
    trajectory, tube = turning_wrist(tray.robot, tray, end)
    pose = pose_of(tray.robot, trajectory)
    least = least_rotation_margin(tube.rotation, pose, [Visit(0, 0.0, end)])
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
    tray = bundled("ur5/level_tray")
    rotation, tool = tray.robot.tool_pose(tray.start[None])
    first = (Rotation.from_matrix(rotation[0]) * Rotation.from_rotvec([0, 0, -3.0])).as_quat()
    points = tool + np.array([[0, 0, 0], [0.1, 0, 0]])
    tube = Tube(points, 0.1, orientations=[first] * 2, rotation_tolerance=4.0)
    trajectory = JointTrajectory(
        tray.robot.joint_names, [0, 1.0], [[[0] * 5 + [0.3]], [tray.start]]
    )
    visit = [Visit(0, 0.0, 1.0)]
    least = least_rotation_margin(tube.rotation, pose_of(tray.robot, trajectory), visit)
    assert 0.97 * (4 - np.pi) <= least.lower_bound <= 4 - np.pi + 1e-9
    assert least.attained > 4 - np.pi + 1e-6
    judged = verify(PlanningProblem(tray.robot, tube, tray.start), trajectory)
    assert judged.conditions["rotation"].margin == least.lower_bound


def spiked(trajectory, joint, size, when, width):
    """Return the trajectory with a smooth bump of one joint, of this width about a time."""
    parts = [
        trajectory.between(0.0, when),
        trajectory.between(when, when + width),
        trajectory.between(when + width, trajectory.duration),
    ]
    cut = np.concatenate([part.coefficients for part in parts], axis=1)
    breakpoints = np.concatenate(
        [
            parts[0].breakpoints,
            when + parts[1].breakpoints[1:],
            when + width + parts[2].breakpoints[1:],
        ]
    )
    coefficients = np.concatenate([np.zeros((1, *cut.shape[1:])), cut])
    piece = len(parts[0].widths)
    bump = 64 * size * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    coefficients[:, piece, joint] += bump
    return JointTrajectory(trajectory.joint_names, breakpoints, coefficients)


def test_a_spike_between_two_thousand_samples_is_found(stored):
    """The fifth joint tilts the tray by 4 degrees and back, within 20 microseconds."""
    problem, trajectory = stored("ur5/level_tray")
    regular = np.linspace(0, trajectory.duration, 2001)
    when = regular[1000] + 2e-4
    trajectory = spiked(trajectory, 4, 0.07, when, 2e-5)
    rotation, tool = problem.robot.tool_pose(trajectory.position(regular))
    assert problem.tube.rotation.margin(rotation, tool, 1).min() > 0.05
    condition = verify(problem, trajectory).conditions["rotation"]
    assert condition.where.time == pytest.approx(when + 1e-5, abs=1e-5)
    assert condition.where.segment == 1
    assert condition.unit == "rad"
    at = problem.robot.tool_pose(trajectory.position(np.array([when + 1e-5])))
    deepest = problem.tube.rotation.margin(*at, 1)[0]
    assert deepest < -0.01
    assert condition.margin == pytest.approx(deepest, rel=0.05)


@pytest.mark.parametrize(("slack", "passes"), [(2e-5, True), (-2e-5, False)])
def test_a_bound_is_judged_to_hundredths_of_a_milliradian(slack, passes, stored):
    """The largest tilt of a wavering tool, and a bound that is beside it by 2e-5 rad."""
    problem, trajectory = stored("ur5/level_tray")
    trajectory = spiked(trajectory, 4, 0.03, 0.6, 0.2)
    rotation, tool = problem.robot.tool_pose(trajectory.position(np.linspace(0.6, 0.8, 20_001)))
    largest = abs(problem.tube.rotation.error(rotation, tool, 1)[:, :2]).max()
    tube = problem.tube
    bound = (largest + slack, largest + slack, INF)
    judged = Tube(
        tube.points, tube.radius, orientations=tube.orientations, rotation_tolerance=[bound] * 3
    )
    asked = PlanningProblem(problem.robot, judged, problem.start)
    condition = verify(asked, trajectory).conditions["rotation"]
    assert (condition.margin >= 0) is passes
    assert condition.margin == pytest.approx(slack, abs=1e-6)
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("visit", ["ordered", "any"])
@pytest.mark.parametrize(("bound", "left"), [(0.3, 0.0), (0.29, -0.01), (0.35, 0.05)])
def test_the_switching_time_is_when_both_rotation_tolerances_hold(two_link, visit, bound, left):
    """The tool's angle goes from -0.4 to 0.5; the references, far away, are at -0.3 and 0.3."""
    angles = [[-0.3], [0.3], [0.3]]
    quaternions = Rotation.from_euler("z", angles).as_quat()
    points = [[2, 0, 0], [3, 0, 0], [4, 0, 0]]
    tube = Tube(points, 9.0, visit=visit, orientations=quaternions, rotation_tolerance=[bound] * 2)
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])))
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.9, 0.0]], [[0.6, -1.0]]])
    pose = pose_of(two_link, trajectory)
    visits = tube_visits(problem, trajectory, pose.tool, pose.rotation)
    assert [visit.segment for visit in visits] == [0, 1]
    assert visits[0].end == pytest.approx(0.4 / 0.9, abs=1e-7)
    least = least_rotation_margin(tube.rotation, pose, visits)
    # Elsewhere the angle is at most 0.2 off its reference.
    assert least.attained == pytest.approx(min(left, bound - 0.2), abs=2e-7)
    assert least.lower_bound == pytest.approx(least.attained, abs=2e-3)
    condition = verify(problem, trajectory).conditions["rotation"]
    assert (condition.margin >= -1e-6) is (left >= 0)


def test_a_segment_that_leaves_the_rotation_free_is_not_judged(two_link):
    quaternions = [[0, 0, 0, 1]] * 3
    tube = Tube(
        [[2, 0, 0], [3, 0, 0], [4, 0, 0]],
        9.0,
        orientations=quaternions,
        rotation_tolerance=[[INF, INF, INF], 0.1],
    )
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.9, 0.0]], [[0.6, -1.0]]])
    pose = pose_of(two_link, trajectory)
    assert least_rotation_margin(tube.rotation, pose, [Visit(0, 0.0, 1.0)]) is None
    both = least_rotation_margin(tube.rotation, pose, [Visit(0, 0.0, 0.5), Visit(1, 0.5, 1.0)])
    assert both.attained == pytest.approx(0.1 - 0.5, abs=1e-6)
    assert both.segment == 1


def test_a_trajectory_that_no_machine_could_make_is_left_open(two_link):
    """A million radians within a microsecond: the bound is poor, finite, and not above the true."""
    wild = JointTrajectory(two_link.joint_names, [0, 1e-6], [[[1e11, 1e11]], [[0.0, 0.0]]])
    tube = Tube([[2, 0, 0], [3, 0, 0]], 9.0, orientations=[[0, 0, 0, 1]] * 2, rotation_tolerance=1)
    least = least_rotation_margin(tube.rotation, pose_of(two_link, wild), [Visit(0, 0.0, 1e-6)])
    assert 1 - np.pi - 1e-3 <= least.lower_bound <= least.attained


def test_halving_ends_after_so_many_rows(ur5, monkeypatch):
    """The bounds then count as they stand."""
    trajectory = wavy(ur5, 1)
    tube, pose = around(ur5, trajectory, 1, [0.5, 0.5]), pose_of(ur5, trajectory)
    visit = [Visit(0, 0.0, trajectory.duration)]
    whole = least_rotation_margin(tube.rotation, pose, visit)
    monkeypatch.setattr("tubeplanner.verification.rotation_visits._MAX_ROWS", len(pose.tool.width))
    least = least_rotation_margin(tube.rotation, pose, visit)
    assert least.intervals == len(pose.tool.width) < whole.intervals
    assert least.lower_bound < whole.lower_bound


# Over one second: how far the boom extends, and how the tool turns, as polynomials of time, highest
# power first, in shares of the reference's turn; the largest deviation between two ends that agree.
BETWEEN_ENDS = {
    "the tool turns": ([0, 0, 0.2], [-1.0, 1.0, 0.2], 0.25),
    "the reference turns": ([-1.0, 1.0, 0.4], [0, 0, 0.4], 0.25),
    "the reference stops half-way": ([0, 1.0, 0.5], [0, 0.5, 0.5], 0.25),
    "the reference begins half-way": ([0, 1.0, -0.5], [0, 0.5, 0.0], 0.25),
    "the reference stops for a while": ([-0.8, 0.8, 0.9], [0, 0, 0.9], 0.1),
    "the reference goes back for a while": ([0.4, -0.4, 1.05], [0, 0, 1.0], 0.05),
}


@pytest.mark.parametrize(("extended", "turned", "largest"), BETWEEN_ENDS.values(), ids=BETWEEN_ENDS)
def test_what_happens_between_two_ends_is_bounded(extended, turned, largest, slide):
    """In closed form, for a sliding tool; so little that it is settled at the first look."""
    robot, turn, bound = slide, 0.02, 1.0
    coefficients = np.zeros((3, 1, 3))
    coefficients[:, 0, 1], coefficients[:, 0, 2] = extended, turn * np.array(turned)
    trajectory = JointTrajectory(robot.joint_names, [0, 1.0], coefficients)
    quaternions = Rotation.from_euler("y", [[0.0], [turn]]).as_quat()
    points = [[0.6, 0, 0.5], [1.6, 0, 0.5]]
    tube = Tube(points, 9.0, orientations=quaternions, rotation_tolerance=[[INF, bound, INF]])
    dense = margins(robot, tube, trajectory, np.linspace(0, 1, 10_001), 0).min()
    assert dense == pytest.approx(bound - turn * largest, abs=1e-12)
    pose = pose_of(robot, trajectory)
    least = least_rotation_margin(tube.rotation, pose, [Visit(0, 0.0, 1.0)])
    assert least.intervals <= 3
    assert 0.97 * dense <= least.lower_bound <= dense + 1e-12


def test_a_tool_that_turns_where_an_unturned_reference_ends_is_bounded(slide):
    """Nothing jumps there, and what the tool does in between counts as it does elsewhere."""
    coefficients = np.zeros((3, 1, 3))
    coefficients[:, 0, 1], coefficients[:, 0, 2] = [0, 1.0, 0.5], [-0.02, 0.02, 0.004]
    trajectory = JointTrajectory(slide.joint_names, [0, 1.0], coefficients)
    points = [[0.6, 0, 0.5], [1.6, 0, 0.5]]
    tube = Tube(points, 9.0, orientations=[[0, 0, 0, 1]] * 2, rotation_tolerance=[[INF, 1.0, INF]])
    pose = pose_of(slide, trajectory)
    least = least_rotation_margin(tube.rotation, pose, [Visit(0, 0.0, 1.0)])
    assert least.intervals <= 3
    assert 0.97 <= least.lower_bound <= 1.0 - 0.009 + 1e-12


@pytest.mark.parametrize("beside", [-1e-3, 1e-3, 1.001, 0.999])
def test_a_tool_that_may_be_before_an_end_or_beyond_it_is_bounded(slide, beside):
    """Its place is known to a centimetre: its reference may turn by as much as it does there."""
    turn, miss = 0.5, 1e-2
    coefficients = np.zeros((1, 1, 3))
    coefficients[0, 0, 1], coefficients[0, 0, 2] = beside, turn * np.clip(beside, 0, 1)
    trajectory = JointTrajectory(slide.joint_names, [0, 1.0], coefficients)
    quaternions = Rotation.from_euler("y", [[0.0], [turn]]).as_quat()
    points = [[0.6, 0, 0.5], [1.6, 0, 0.5]]
    tube = Tube(points, 9.0, orientations=quaternions, rotation_tolerance=[[INF, 1.0, INF]])
    pose = pose_of(slide, trajectory)
    rough = replace(pose, tool=replace(pose.tool, error=pose.tool.error + miss))
    least = least_rotation_margin(tube.rotation, rough, [Visit(0, 0.0, 1.0)])
    assert least.attained == pytest.approx(1.0)
    assert 0.97 <= least.lower_bound <= 1.0 - turn * (miss - 1e-3)


# How turn, boom and lift move, from and to [rad or m]; the segment; the reference at both its ends.
FAR = Rotation.from_euler("x", 2.0)
NEAR = Rotation.from_euler("x", 0.02)
ALONG = [[0.6, 0, 0.5], [1.6, 0, 0.5]]
BENDS = {
    "the reference turns far from the tool": (
        ([0, 0.12, 0], [0, 0.89, 0]),
        ALONG,
        [Rotation.from_euler("z", angle) * FAR for angle in (-0.5, 0.5)],
    ),
    "the tool turns where a far reference ends": (
        ([-0.37, 0, 0], [0.42, 0, 0]),
        [[0.6, 0, 0.5], [0.6, 1.0, 0.5]],
        [FAR, FAR],
    ),
    "the tool turns far from its reference": (
        ([-0.37, 0, 0], [0.42, 0, 0]),
        [[0.6, -1.0, 0.5], [0.6, 1.0, 0.5]],
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
    begin, end = (np.array(each) for each in ends)
    trajectory = JointTrajectory(slide.joint_names, [0, 1.0], [[end - begin], [begin]])
    quaternions = [each.as_quat() for each in reference]

    def bounded(bound):
        tolerance = [[bound, INF, INF]]
        return Tube(points, 9.0, orientations=quaternions, rotation_tolerance=tolerance)

    dense = margins(slide, bounded(3.0), trajectory, np.linspace(0, 1, 10_001), 0)
    assert dense.min() < min(dense[0], dense[-1]) - 5e-4
    tube, visit = bounded(3.0 - dense.min() + 1e-4), [Visit(0, 0.0, 1.0)]
    least = least_rotation_margin(tube.rotation, pose_of(slide, trajectory), visit)
    assert 0.95e-4 <= least.lower_bound <= 1e-4 + 1e-9


@pytest.mark.parametrize("joint", [0, 2])
def test_a_turn_across_a_far_rotation_vector_moves_it_by_more(joint, slide):
    """By a / 2 sideways at an angle a: the tool turns there and back, about z or y."""
    angle, turned = 3.0, 5e-3
    coefficients = np.zeros((3, 1, 3))
    coefficients[:, 0, joint] = [-4 * turned, 4 * turned, 0]
    trajectory = JointTrajectory(slide.joint_names, [0, 1.0], coefficients)
    far, bounds = Rotation.from_euler("x", angle).as_quat(), [INF, INF, INF]
    sideways = 1 if joint == 0 else 2
    bounds[sideways] = 1.0
    points = [[0.6, -1.0, 0.5], [0.6, 1.0, 0.5]]
    tube = Tube(points, 9.0, orientations=[far, far], rotation_tolerance=[bounds])
    dense = margins(slide, tube, trajectory, np.linspace(0, 1, 1001), 0).min()
    assert dense == pytest.approx(1.0 - angle / 2 * turned, abs=1e-5)
    least = least_rotation_margin(tube.rotation, pose_of(slide, trajectory), [Visit(0, 0.0, 1.0)])
    assert least.intervals <= 3
    assert 0.97 * dense <= least.lower_bound <= dense + 1e-12
