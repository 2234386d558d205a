"""Lower bounds on the duration: closed forms, random ways through tubes, certified motions."""

from dataclasses import replace

import numpy as np
import pytest
from arms import rail_arm
from cases import anywhere, changed, limited_tool, one_joint, pose_at, with_motors
from gantry import gantry
from lifting_arm import URDF as LIFTING
from small_cycle import planned_cycle, small_cycle

from tubeplanner import (
    GoalRegion,
    JointTrajectory,
    LimitOverrides,
    LowerBound,
    PlanningProblem,
    PlanOptions,
    PointSpeed,
    Tube,
    load_problem,
    load_robot,
    lower_bound,
    plan,
)
from tubeplanner.limits.lower_bound import distance_in, rest_to_rest, slowest_joint, slowest_tool
from tubeplanner.limits.speed_limits import minimum_duration
from tubeplanner.task.endpoints import Seed, ToolPose

INF, R, SPEED = np.inf, 0.1, 0.5


@pytest.mark.parametrize(
    ("distance", "velocity", "acceleration", "jerk", "expected"),
    [
        (0.0, 2.0, 1.0, 1.0, 0.0),
        (0.0, INF, 1.0, INF, 0.0),
        (1.0, 2.0, INF, INF, 0.5),
        (1.0, INF, INF, INF, 0.0),
        (4.0, 1.0, 1.0, INF, 5.0),
        (1.0, 9.0, 4.0, INF, 1.0),
        (1.0, INF, 4.0, INF, 1.0),
        (2.0, INF, INF, 1.0, 4.0),
        (2.0, 9.0, 9.0, 1.0, 4.0),
        (4.0, 1.0, 9.0, 1.0, 6.0),
        (4.0, 1.0, 1.0, 1.0, 6.0),
        (4.0, 0.5, 0.5, 1.0, 9.5),
        (6.0, 9.0, 1.0, 1.0, 6.0),
    ],
)
def test_a_joint_alone_takes_its_double_s(distance, velocity, acceleration, jerk, expected):
    assert rest_to_rest(distance, velocity, acceleration, jerk) == pytest.approx(expected)
    if expected > 0:
        assert distance_in(expected, velocity, acceleration, jerk) == pytest.approx(distance)


def test_a_single_joint_comes_as_near_as_knots_allow(tmp_path):
    robot = one_joint(tmp_path, effort=1e6, acceleration=10.0, jerk=200.0)
    problem = changed(anywhere(robot), goal=np.array([2.0]))
    result = plan(problem, PlanOptions(slack=0.0))
    bound = LowerBound(
        rest_to_rest(2.0, 4.0, 10.0, 200.0), "acceleration of turn", "acceleration", "turn"
    )
    assert result.bound == lower_bound(problem) == bound
    assert bound.duration <= result.duration < 1.002 * bound.duration


@pytest.mark.parametrize(
    "name", ["two_link/paper_1_30mm", "two_link/around_a_post", "ur5/level_tray"]
)
def test_no_certified_motion_is_shorter(name, planned):
    """The tool's speed is limited to the largest that the motion has."""
    problem, result = planned(name, "refinement")
    speed = result.peaks.tool_speed.value
    limited = problem.with_tube(replace(problem.tube, tool_speed=speed))
    travel = slowest_tool(limited)
    assert travel.reason == f"tool_speed of segment {travel.segment}"
    assert 0 < travel.duration <= lower_bound(limited).duration <= result.duration


@pytest.mark.parametrize(
    ("bound", "duration", "text"),
    [
        (0.0, 1.0, ""),
        (0.48699, 0.5018, "nothing is faster than 0.4869 s"),
        (0.48699999, 0.5018, "nothing is faster than 0.4870 s"),
        (0.50181, 0.50179, "nothing is faster than 0.5017 s"),
    ],
)
def test_the_text_claims_no_more_than_is_proved_nor_than_was_planned(bound, duration, text):
    assert LowerBound(bound).beside(duration) == text


def test_with_a_period_the_bound_is_a_multiple_of_it(tmp_path):
    problem = changed(anywhere(one_joint(tmp_path, acceleration=16.0)), goal=np.array([1.0]))
    for period, expected in [(None, 0.5), (0.008, 0.504), (0.125, 0.5)]:
        assert lower_bound(changed(problem, period=period)).duration == pytest.approx(expected)


# --- random motions ------------------------------------------------------------------------------


def random_motion(robot, rng):
    """From rest to rest between random configurations, with a detour of every joint."""
    low = np.maximum(robot.limits.lower_position, -3.0) * 0.9
    high = np.minimum(robot.limits.upper_position, 3.0) * 0.9
    start, goal = rng.uniform(low, high, (2, robot.joint_count))
    detour = rng.normal(size=robot.joint_count) * rng.choice([0.0, 0.3, 3.0])
    coefficients = np.zeros((8, 1, robot.joint_count))
    coefficients[2:5, 0] = np.array([[6.0], [-15.0], [10.0]]) * (goal - start)
    coefficients[1:5, 0] += np.array([[-1.0], [3.0], [-3.0], [1.0]]) * detour
    coefficients[-1, 0] = start
    return JointTrajectory(robot.joint_names, [0.0, 1.0], coefficients)


ACCELERATION, JERK = {"acceleration": 12.0}, {"acceleration": 12.0, "jerk": 300.0}
POINT = {"point_speed": (PointSpeed("forearm_link", (0, 0, 0.1), 0.5),), "tool_speed": 0.8}


def ur5(**limits):
    return load_robot("example:ur5", "tool0", limits=LimitOverrides(**limits))


@pytest.mark.parametrize("name", ["ur5", "panda", "two_link"])
def test_no_configuration_at_an_open_end_is_reached_sooner(name):
    """Each joint alone may move at its limits, from a configuration to any other one."""
    frame = {"ur5": "tool0", "panda": "panda_hand_tcp", "two_link": "hand"}[name]
    limits = LimitOverrides(velocity=3.0, **JERK)
    robot, rng = load_robot(f"example:{name}", frame, limits=limits), np.random.default_rng(7)
    ratios = []
    for size in [0.3, 1.0, 6.0] * 8:
        q = random_motion(robot, rng).position(0.0)
        step = rng.uniform(-size, size, len(q)) * rng.integers(0, 2, len(q))
        goal = robot.limits.clip(q + step)
        ends = robot.tool_position(np.array([q, goal]))
        tolerance = rng.uniform(0.0, 0.02)
        region = GoalRegion(ends[1] + [0.0, tolerance, 0.0], tolerance)
        tube = Tube([ends[0], region.position + 0.01], 1000.0)
        problem = PlanningProblem(robot, tube, q, region, self_collision=False)
        for each in (problem, changed(problem, goal=pose_at(problem, goal))):
            bound = lower_bound(each)
            times = [rest_to_rest(away, 3.0, 12.0, 300.0) for away in abs(goal - q)]
            ratios.append(bound.duration / max(*times, 1e-3))  # rounding where no joint moves
    assert 0.7 < max(ratios) <= 1.0


@pytest.mark.parametrize("limits", [{}, ACCELERATION, {"jerk": 300.0}, JERK, POINT])
def test_no_random_motion_is_shorter(limits):
    """Of configurations, of a goal's pose or position, from a seed, and with ranges of joints."""
    robot, rng = ur5(**limits), np.random.default_rng(5)
    ratios = []
    for _ in range(8):
        motion = random_motion(robot, rng)
        start, goal = motion.position(0.0), motion.position(motion.duration)
        ends = robot.tool_position(np.array([start, goal]))
        tube = Tube(ends, 1000.0, tool_speed=0.8 if "tool_speed" in limits else None)
        given = PlanningProblem(robot, tube, start, goal, self_collision=False)
        duration = minimum_duration(given, motion)
        bounds = [lower_bound(given).duration]
        pose = pose_at(given, goal)
        for start_, goal_ in [
            (start, pose),
            (start, None),
            (Seed(start), pose),
            (Seed(start), None),
        ]:
            bounds.append(lower_bound(changed(given, start=start_, goal=goal_)).duration)
        assert max(bounds) <= duration * (1 + 1e-9)
        assert min(bounds[:2]) > 0 and max(bounds[1:]) <= bounds[0]
        ratios.append(duration / bounds[0])
    assert min(ratios) < 3


@pytest.mark.parametrize(("angle", "part"), [(-1.2, 0.85), (0.9, 0.85), (2.5, 0.5)])
def test_the_first_joint_turns_the_tool_to_an_open_end(angle, part):
    """Wrists may turn the tool by some of it; over its head, the arm is faster."""
    robot = ur5(**JERK)
    q = np.array([0.3, -1.3, 1.8, -1.9, -1.7, 0.0])
    turned = q + angle * np.eye(6)[0]
    tube = Tube(robot.tool_position(np.array([q, turned])), 1000.0)
    alone = rest_to_rest(abs(angle), robot.limits.velocity[0], 12.0, 300.0)
    for start, goal in [(q, None), (Seed(q), turned)]:
        bound = lower_bound(PlanningProblem(robot, tube, start, goal, self_collision=False))
        assert bound.joint == "shoulder_pan_joint"
        assert part * alone < bound.duration <= alone


FREE, OUT = (-9.0, 9.0), (1.0, 2.0)


@pytest.mark.parametrize(
    ("ranges", "start", "goal", "distances", "jerk"),
    [
        ([FREE, OUT, FREE], 0.0, 0.0, [1.0, 1.0], INF),
        ([FREE, OUT, FREE], 0.0, 0.5, [1.0, 0.5], INF),
        ([FREE, OUT, FREE], 0.0, 1.5, [1.5], 500.0),
        ([(-1.0, 0.0), FREE, OUT], None, None, [1.0], 500.0),
        ([(-1.0, 0.2), FREE, OUT, FREE, (-1.0, 0.0)], None, None, [0.8, 1.0], INF),
        ([FREE, OUT, (-1.0, 1.0), FREE], None, 0.0, [1.0], INF),
    ],
)
def test_ranges_of_segments_force_a_joint_on_and_back(
    ranges, start, goal, distances, jerk, tmp_path
):
    """It has no velocity where it turns, but may have an acceleration: jerk does not count."""
    robot = one_joint(tmp_path, acceleration=10.0, jerk=500.0)
    points = np.outer(np.arange(len(ranges) + 1), [1e-3, 0, 0])
    tube = Tube(points, 1000.0, joint_signs=[{"turn": each} for each in ranges])
    start = Seed(np.zeros(1)) if start is None else [start]
    goal = None if goal is None else [goal]
    problem = PlanningProblem(robot, tube, start, goal, self_collision=False)
    expected = sum(rest_to_rest(distance, 4.0, 10.0, jerk) for distance in distances)
    assert slowest_joint(problem).duration == pytest.approx(expected, rel=1e-5)
    anyhow = changed(problem, tube=replace(tube, visit="any"))
    if goal is not None and not isinstance(start, Seed):
        alone = rest_to_rest(goal[0] - start[0], 4.0, 10.0, 500.0)
        assert slowest_joint(anyhow).duration == alone
    else:
        assert slowest_joint(anyhow).duration == 0


# --- efforts of sliding joints -------------------------------------------------------------------


def test_a_gantry_is_as_slow_as_its_mass_at_its_effort(tmp_path):
    """It has 3 kg along x, and 1 kg across."""
    limits = {"effort": {"along": 30.0, "across": 20.0}, "velocity": {"across": 1.0}}
    problem = load_problem(gantry(tmp_path), changes={"robot.limits": limits})
    problem = changed(problem, goal=np.array([0.5, 0.0]), self_collision=False)
    bound, result = lower_bound(problem), plan(problem, PlanOptions(slack=0.0))
    assert (bound.reason, bound.joint) == ("effort of along", "along")
    assert bound.duration == pytest.approx(2 * np.sqrt(0.5 / 10.0))
    assert bound.duration <= result.duration < 1.01 * bound.duration


def test_gravity_and_friction_help_a_lift_and_its_rotor_does_not(tmp_path):
    """A lift of 1 kg whose rotor feels like 2 kg, its effort 20 N, its friction at most 3 N."""
    (tmp_path / "lift.urdf").write_text(LIFTING)
    robot = load_robot("lift.urdf", "hand", directory=tmp_path)
    friction = {"backwards_friction": [0, 3], "forwards_friction": [0, 1]}
    limits = {"velocity": [INF, INF], "effort": [1000, 20]}
    robot = with_motors(robot, (), limits, 0.5, armature=[0, 2], **friction)
    problem = changed(anywhere(robot), goal=np.array([0.0, 0.5]))
    expected = 2 * np.sqrt(0.5 * (1 + 2) / (20 + 9.81 + 1.5 * 3))
    assert lower_bound(problem).duration == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(3))
def test_no_random_motion_of_an_arm_on_a_rail_is_shorter(seed, tmp_path):
    """Whatever the arm does, the rail moves the centre of mass; turning joints have no bound."""
    (tmp_path / "rail.urdf").write_text(rail_arm())
    robot = load_robot("rail.urdf", "flange", directory=tmp_path)
    rail, limits = np.eye(6)[0], {"velocity": np.full(6, INF)}
    friction = {"backwards_friction": 40 * rail, "forwards_friction": 20 * rail}
    robot = with_motors(robot, limits=limits, armature=2 * rail, **friction)
    rng = np.random.default_rng(seed)
    ratios = []
    for _ in range(10):
        motion = random_motion(robot, rng)
        start, goal = motion.position(0.0), motion.position(motion.duration)
        problem = changed(anywhere(robot), start=start, goal=goal)
        bound = lower_bound(problem)
        assert bound.reason == "effort of rail"
        ratios.append(minimum_duration(problem, motion) / bound.duration)
    assert 1.0 <= min(ratios) < 4.0


# --- cycles --------------------------------------------------------------------------------------


def test_the_moves_and_rests_of_a_cycle_add_up():
    """Its velocity limits are the largest velocities of the motion; it ends where it began."""
    motion = planned_cycle().motion
    velocity = abs(motion.trajectory.per_piece(50).velocity).max(axis=0) * 1.0001
    a, b, c = (q.tolist() for q in motion.junctions[:3])
    limits = {"robot__limits__velocity": dict(zip(("joint1", "joint2"), velocity, strict=True))}
    ends = {"start": {"joints": a}, "moves__over__goal": {"joints": b}}
    steps = abs(np.diff([a, b, c, a], axis=0)) / velocity
    rests = 0.05 + 0.06 + 0.1
    known = lower_bound(small_cycle(**limits, **ends, moves__beside__goal={"joints": c}))
    assert known.duration == pytest.approx(rests + steps.max(axis=1).sum())
    part = lower_bound(small_cycle(**limits, **ends)).duration
    assert rests + steps[0].max() < part < known.duration < motion.trajectory.duration


def test_a_move_after_a_ball_may_begin_anywhere_in_it():
    """The tool need not be at the first point of its tube, so that joint ranges alone count."""
    motion = planned_cycle().motion
    a, b, c = (q.tolist() for q in motion.junctions[:3])
    limits = {"robot__limits__velocity": 1.0, "start": {"joints": a}}
    tool = motion.task.robot.tool_position(np.array(b)).tolist()
    ends = {"moves__beside__goal": {"joints": c}}
    ball = {"moves__over__goal": {"position": tool, "tolerance": 0.08}}
    point, wide = (small_cycle(**limits, **ends, **goal) for goal in ({}, ball))
    legs = [wide.problem_from_anywhere(k) for k in range(3)]
    moves = [lower_bound(legs[0]), slowest_joint(replace(legs[1], goal=np.array(c)))]
    known = abs(np.subtract(a, c)).max() + 0.05 + 0.06 + 0.1
    assert lower_bound(wide).duration == pytest.approx(known + sum(m.duration for m in moves))
    assert lower_bound(point).duration > lower_bound(wide).duration + 0.01


# --- the tool through the tube -------------------------------------------------------------------

ARM = load_robot("example:ur5", "tool0")


def pose(position):
    placement = np.eye(4)
    placement[:3, 3] = position
    return ToolPose(placement)


def through(points, goal=None, radius=R, tool_speed=SPEED, **fields):
    """A problem of the least time of a tool alone, from the first to the last point."""
    tube = Tube(points, radius, tool_speed=tool_speed, **fields)
    goal = pose(points[-1]) if goal is None else goal
    return PlanningProblem(ARM, tube, pose(points[0]), goal, self_collision=False)


CORNER = [[-1, 0, 0], [0, 0, 0], [0, 1, 0]]
BACK = [[0, 0, 0], [1, 0, 0], [0, 0.01, 0]]
BOX = {"box": [0.2, 0.04], "up": [0, 0, 1]}


@pytest.mark.parametrize(
    ("problem", "length"),
    [
        (through([[0, 0, 0], [1, 0, 0]]), 1.0),
        (through([[0, 0, 0], [1, 0, 0]], GoalRegion([1, 0, 0], 0.05)), 0.95),
        (through([[0, 0, 0], [0.5, 0, 0], [1, 0, 0]]), 1.0),
        (through(CORNER), 2 * np.hypot(1 - R, R)),
        (through(CORNER, radius=None, cross_section=BOX), 2 * np.hypot(1 - R, R)),
        (through(CORNER, tool_speed=[SPEED, None]), 1 - R),
        (through(CORNER, tool_speed=None), 0.0),
        (through(CORNER, visit="any"), np.sqrt(2)),
        (through(BACK), 2 * (1 - R)),
        (through(BACK, pass_through_points="none"), 0.01),
    ],
)
def test_the_least_way_through_a_tube(problem, length):
    assert slowest_tool(problem).duration == pytest.approx(length / SPEED, rel=2e-4, abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_no_way_through_a_random_tube_is_shorter(seed):
    """Random points near the reference points are inside both segments, or in the goal's ball."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-0.3, 0.5, (rng.integers(3, 30), 3)), axis=0)
    radius, speed = rng.uniform(0.01, 0.4, (2, len(points) - 1))
    goal = GoalRegion(points[-1], radius[-1])
    problem = through(points, goal, radius, speed, pass_through_points="none")
    bound = slowest_tool(problem).duration
    passing = np.minimum(np.append(radius, radius[-1]), np.append(radius[0], radius))
    passing[0] = 0.0
    direct = points[0] - points
    directions = [*rng.normal(size=(50, len(points), 3)), direct, direct[::-1]]
    times = []
    for away in directions:
        size = np.linalg.norm(away, axis=1, keepdims=True)
        near = points + away / np.maximum(size, 1e-9) * np.minimum(passing[:, None], size)
        times.append((np.linalg.norm(np.diff(near, axis=0), axis=1) / speed).sum())
    assert 0 < bound <= min(times)


def test_in_a_tube_for_two_link_arms_the_tool_may_be_beside_the_end():
    """That arm does not reach all points of the ball: its tool is anywhere in it."""
    problem = limited_tool(tube_value=SPEED, count=1)
    length = np.linalg.norm(np.diff(problem.tube.points, axis=0))
    assert slowest_tool(problem).duration == pytest.approx((length - 2 * 0.05) / SPEED, rel=1e-4)
