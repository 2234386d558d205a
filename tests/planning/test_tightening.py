"""Tightening: a problem with reserves in limits and tolerances; Survival of its plan in runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from stored_trajectories import REFINEMENT

from tubeplanner import GoalRegion, Obstacle, Robustness, Tube, load_problem, placement_of
from tubeplanner.execution.error_contributions import BlamedError, ErrorContribution
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.planning.tightening import (
    Survival,
    Tightening,
    allowed_tightening,
    tightened_problem,
)
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Holding

LINE = "two_link/paper_1_30mm"
MIDDLE = np.array([[0.9, -1.4]])
ENDS = np.array([[-0.16, -1.4], [1.9, -1.4]])  # on the axis of the line's tube
UP, SIDE = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])


@pytest.fixture(scope="module")
def tray(stored):
    """Return a problem with rotation tolerances, and where a stored motion begins and ends."""
    problem, motion = stored("ur5/level_tray", REFINEMENT)
    return problem.joined, motion.position(np.array([0.0, motion.duration]))


@pytest.fixture
def line(bundled):
    """Return a problem of one segment along y."""
    return bundled(LINE)


def asked(problem, **parts):
    return replace(Tightening.nothing(problem), **parts)


def allowed(problem, q, **parts):
    """Return how much of some parts is allowed in configurations."""
    return allowed_tightening(problem, asked(problem, **parts), q)


def about_middle(problem, **others):
    """Return the problem with a tube through the tool in the middle, along y."""
    tool = problem.robot.tool_position(MIDDLE)[0]
    return problem.with_tube(Tube([tool - 0.1 * SIDE, tool + 0.1 * SIDE], 0.03, **others))


def with_ball(problem, q, row):
    """Return the problem with a ball 0.2 m beside the tool, and its distance from the arm [m]."""
    tool = problem.robot.tool_position(q)[row]
    ball = Obstacle.sphere("ball", 0.01, placement_of(tool + 0.2 * SIDE))
    problem = replace(problem, obstacles=[ball])
    checker = problem.collision
    poses = zip(*problem.robot.body_poses(q), strict=True)
    return problem, min(checker.distances(*pose, checker.obstacle_pairs).min() for pose in poses)


def test_every_part_makes_its_own_limit_smaller_and_geometry_is_shared(tray):
    problem, _ = tray
    joints, segments = problem.robot.joint_count, problem.tube.segment_count
    reserves = Tightening(
        effort=0.9,
        velocity=np.linspace(0.8, 0.9, joints),
        radius=np.full(segments, 0.004),
        rotation=np.full(segments, 0.01),
        clearance=0.003,
        position=np.array([np.full(joints, 0.1), np.full(joints, 0.2)]),
    )
    less = tightened_problem(problem, reserves)
    limits, whole = less.robot.limits, problem.robot.limits
    assert limits.effort == pytest.approx(0.9 * whole.effort)
    assert limits.velocity == pytest.approx(np.linspace(0.8, 0.9, joints) * whole.velocity)
    assert limits.lower_position == pytest.approx(whole.lower_position + 0.1)
    assert limits.upper_position == pytest.approx(whole.upper_position - 0.2)
    assert less.tube.radius == pytest.approx(problem.tube.radius - 0.004)
    bounds = problem.tube.rotation.bounds
    finite = np.isfinite(bounds)
    assert less.tube.rotation.bounds[finite] == pytest.approx(bounds[finite] - 0.01)
    assert less.clearance == pytest.approx(problem.clearance + 0.003)
    assert less.collision is problem.collision
    assert problem.robot.limits is whole
    same = tightened_problem(problem, Tightening.nothing(problem))
    assert same.tube.radius.tolist() == problem.tube.radius.tolist()
    assert (same.robot.limits.effort == whole.effort).all() and same.clearance == problem.clearance


def test_a_contact_keeps_back_what_it_does_not_need_at_rest(tray):
    problem, ends = tray
    cup = Cup(force=30.0, radius=0.02, friction=0.5, safety=1.0, normal=(0, 0, -1))
    held = replace(problem, holding=[Holding(cup, Payload(1.0))])
    at_rest = 1 - 9.81 / 30.0  # upright: the share that the weight leaves of the force
    assert allowed(held, ends, holding=0.3).holding == 0.3
    assert allowed(held, ends, holding=0.9).holding == pytest.approx(at_rest, abs=0.05)
    less = tightened_problem(held, asked(held, holding=0.3))
    weaker = Holding(replace(cup, force=0.7 * cup.force), Payload(1.0))
    for own, other in zip(less.holding[0].cones, weaker.cones, strict=True):
        assert own.offset == pytest.approx(other.offset)
    assert allowed(problem, ends, holding=0.1).holding == 0.1  # nothing is held: no matter


def test_torque_speed_lines_and_ranges_of_effort_are_left_in_part():
    """A line's stall effort, a pair and a table each keep their share; friction stays."""
    table = {"position": [-1.0, 1.0], "effort": [5.0, 9.0]}
    motors = {"saturation_effort": [60.0, 20.0], "no_load_velocity": [20.0, 20.0]}
    changes = {
        "robot.limits.effort": {"joint1": [20.0, 30.0], "joint2": table},
        "robot.motors": {"viscous_friction": 0.2, **motors},
    }
    problem = load_problem(f"example:{LINE}", changes=changes)
    robot, less = problem.robot, tightened_problem(problem, asked(problem, effort=0.5)).robot
    q, v = np.array([[0.0, -1.0], [0.0, 0.0], [0.0, 2.0]]), np.full((3, 2), 0.7)
    for direction in (1.0, -1.0):
        whole = robot.limits.effort_at(q, direction)
        assert less.limits.effort_at(q, direction) == pytest.approx(0.5 * whole)
    stall = robot.motors.saturation_effort
    assert less.motors.saturation_effort == pytest.approx(0.5 * stall)
    assert less.motors.viscous_friction.tolist() == [0.2, 0.2]
    tau = robot.inverse_dynamics(q, v, v)
    assert less.inverse_dynamics(q, v, v) == pytest.approx(tau)


@pytest.mark.parametrize(
    ("tool_radius", "wanted", "expected"),
    [(0.0, 0.5, 0.027), (0.0, 0.01, 0.01), (0.01, 0.5, 0.018)],
)
def test_a_tenth_of_the_radius_for_the_tools_centre_is_always_left(
    line, tool_radius, wanted, expected
):
    problem = about_middle(line, tool_radius=tool_radius)
    radius = allowed(problem, MIDDLE, radius=np.array([wanted])).radius
    assert radius == pytest.approx([expected])


def test_of_a_velocity_limit_at_least_three_tenths_are_left_and_at_most_all(line):
    assert allowed(line, MIDDLE, velocity=np.array([0.1, 1.2])).velocity.tolist() == [0.3, 1.0]


def test_start_and_goal_stay_inside(line):
    """The start 12 mm off the axis of the first segment, the goal 21 mm off that of the last."""
    first, last = line.robot.tool_position(ENDS)
    points = [first + 0.012 * UP, [0.3, 0.0, 0.0], last + 0.021 * UP]
    problem = line.with_tube(Tube(points, 0.03))
    wanted = {"radius": np.full(2, 0.025)}
    both = allowed(problem, ENDS, **wanted)
    assert both.radius == pytest.approx([0.018, 0.009], abs=4e-5)
    assert tightened_problem(problem, both).tube.margin(first[None])[0, 0] >= 0
    alone = allowed(problem, ENDS[:1], **wanted)
    assert alone.radius == pytest.approx([0.018, 0.025], abs=4e-5)


def test_a_goals_position_stays_inside(line):
    """10 mm beside the segment, it leaves 20 of 30 mm as a reserve."""
    problem = replace(line, goal=GoalRegion(line.tube.points[-1] + 0.01 * UP, 0.5))
    reserves = allowed(problem, ENDS[:1], radius=np.full(problem.tube.segment_count, 0.025))
    assert reserves.radius[-1] == pytest.approx(0.02, abs=2e-6)
    assert tightened_problem(problem, reserves).goal is problem.goal


def test_clearance_grows_no_farther_than_start_and_goal_are_away(line):
    problem, near = with_ball(line, ENDS, 1)
    problem = replace(problem, clearance=0.02)
    assert allowed(problem, ENDS, clearance=1.0).clearance == pytest.approx(near - 0.02, abs=2e-6)
    assert allowed(problem, ENDS, clearance=0.001).clearance == 0.001
    assert allowed(replace(problem, obstacles=[]), ENDS, clearance=1.0).clearance == 1.0


def test_rotation_tolerances_and_position_limits_hold_start_and_goal(tray):
    problem, ends = tray
    margin = problem.tube.rotation_margin(*problem.robot.tool_pose(ends))
    rotation = allowed(problem, ends, rotation=np.full(problem.tube.segment_count, 1.0)).rotation
    assert rotation[0] <= margin[0, 0]
    assert rotation[-1] <= margin[1, -1]
    assert ((rotation > 0) & (rotation < problem.tube.rotation.bounds.min(axis=1))).all()
    reserves = allowed(problem, ends, position=np.full((2, problem.robot.joint_count), 20.0))
    limits = tightened_problem(problem, reserves).robot.limits
    assert (limits.lower_position <= ends).all() and (ends <= limits.upper_position).all()
    assert limits.lower_position == pytest.approx(ends.min(axis=0), abs=2e-6)


def test_a_free_rotation_has_no_reserve(line):
    assert allowed(line, ENDS[:1], rotation=np.array([0.3])).rotation.tolist() == [0.0]
    first, last = line.robot.tool_position(ENDS)
    turned = {"orientations": [[0, 0, 0, 1]] * 3, "rotation_tolerance": [3.0, np.inf]}
    problem = line.with_tube(Tube([first, [0.3, 0.0, 0.0], last], 0.03, **turned))
    rotation = allowed(problem, ENDS[:1], rotation=np.array([0.3, 0.3])).rotation
    assert rotation == pytest.approx([0.3, 0.0])


def test_at_the_very_limits_there_is_no_reserve(line):
    """A start at its tube's border, turned as far as it may be, at a joint's limit, at a ball."""
    q = np.array([[0.9, line.robot.limits.upper_position[1]]])
    angle = q.sum()
    (turned,), (tool,) = line.robot.tool_pose(q)
    assert turned[0, 0] == pytest.approx(np.cos(angle))
    at_tolerance = [0, 0, np.sin(angle / 2 - 0.1), np.cos(angle / 2 - 0.1)]
    points = tool + np.array([[0, 0, 0.03], [0, 0.1, 0.03]])
    tube = Tube(points, 0.03, orientations=[at_tolerance] * 2, rotation_tolerance=0.2)
    problem, near = with_ball(line.with_tube(tube), q, 0)
    reserves = allowed(
        replace(problem, clearance=near),
        q,
        radius=np.array([0.01]),
        rotation=np.array([0.1]),
        clearance=0.01,
        position=np.full((2, 2), 0.1),
    )
    assert reserves.radius.tolist() == reserves.rotation.tolist() == [reserves.clearance] == [0.0]
    assert reserves.position.tolist() == [[0.1, 0.1], [0.1, 0.0]]


def test_reserves_of_joined_segments_are_those_of_all_their_parts(line):
    points = [[0.3, -0.5, 0], [0.3, 0, 0], [0.3, 0.5, 0], [0.1, 0.5, 0]]
    problem = line.with_tube(Tube(points, 0.03, joint_signs={"joint2": "-"}))
    joined = problem.joined
    assert joined.tube.segment_count == 2
    parts = {"radius": np.array([0.001, 0.002]), "rotation": np.array([0.01, 0.02])}
    of_parts = asked(joined, **parts).of_parts(joined.tube)
    assert of_parts.radius.tolist() == [0.001, 0.001, 0.002]
    assert of_parts.rotation.tolist() == [0.01, 0.01, 0.02]
    assert of_parts.of_parts(problem.tube) is of_parts


def test_parts_are_taken_one_by_one(line):
    reserves = asked(line, effort=0.9, radius=np.array([0.01]), clearance=0.002)
    some = reserves.only(["effort", "radius"])
    assert (some.effort, some.radius.tolist(), some.clearance) == (0.9, [0.01], 0.0)
    parts = ("effort", "velocity", "radius", "clearance")
    assert [part for part in parts if reserves.has(part)] == ["effort", "radius", "clearance"]
    assert not some.has("clearance") and not reserves.only([]).has("effort")
    slower = asked(line, velocity=np.array([0.8, 1.0]), position=np.array([[0.0, 0.0], [0.1, 0.0]]))
    assert slower.has("velocity") and slower.has("position")
    assert slower.only(["position"]).velocity.tolist() == [1.0, 1.0]
    assert slower.only(["velocity"]).velocity.tolist() == [0.8, 1.0]


NONE_FAILED = RunVerdict(200, 0, {"tube": 0}, 1.02, 0.013)
MANY_FAILED = RunVerdict(200, 150, {"tube": 150}, None, 0.02)
KEPT = Tightening(
    effort=0.93,
    velocity=np.array([1.0, 0.97]),
    radius=np.array([0.0012, 0.0034]),
    rotation=np.array([0.012, 0.0]),
    clearance=0.0021,
    position=np.array([[0.0, 0.05], [0.0, 0.0]]),
)
PARTS = ("effort", "velocity", "radius", "rotation", "clearance", "position")
COSTS = dict(zip(PARTS, (0.012, 0.003, 0.0015, 0.0011, 0.0003, 0.0001), strict=True))  # [s]
BLAME = ErrorContribution(
    "radius", "m", 0.004, -0.009, (BlamedError("mass", 0.05, -0.001), BlamedError("lag", 0.1, 0.0))
)


@pytest.fixture
def survival():
    return Survival(Robustness(), NONE_FAILED, True, KEPT, 0.9, MANY_FAILED, COSTS)


def test_the_verdict_is_that_of_fresh_runs_and_costs_sum_up(survival):
    assert survival.seen == NONE_FAILED.survived(Robustness())
    assert replace(survival, verdict=None).seen == "its runs were not simulated to the end"
    assert survival.added == pytest.approx(0.018)
    assert replace(survival, costs={}).added == 0


def test_a_note_tells_what_every_part_costs(survival):
    (note,) = survival.notes
    assert note == (
        "surviving takes 18.0 ms more, 2 %: 93 % of the effort limits (12.0 ms); as little as "
        "97 % of the velocity limits (3.0 ms); up to 3.4 mm less radius (1.5 ms); up to 12 mrad "
        "less rotation (1.1 ms); 2.1 mm more clearance (0.3 ms); up to 50 mrad or mm less joint "
        f"range (0.1 ms); without robustness the plan takes 0.9000 s, and {MANY_FAILED}"
    )
    (note,) = replace(survival, verdict_without=None, costs={"effort": 0.009}).notes
    assert note == (
        "surviving takes 9.0 ms more, 1 %: 93 % of the effort limits (9.0 ms); without robustness "
        "the plan takes 0.9000 s"
    )
    assert replace(survival, costs={}).notes == ()


def test_blame_is_of_the_plan_whose_runs_it_is_about(survival):
    (note,) = replace(survival, costs={}, contribution=BLAME).notes
    assert note == f"the plan without robustness: {BLAME}"
    (note,) = replace(survival, reached=False, costs={}, contribution=BLAME).notes
    assert note == f"no plan was found that survives errors 1.3 times as large: {BLAME}"
    assert len(replace(survival, contribution=BLAME).notes) == 2


def test_as_json_it_has_all_of_it(survival):
    found = json.loads(json.dumps(replace(survival, contribution=BLAME).as_dict()))
    assert (found["reached"], found["duration_without"], found["costs"]) == (True, 0.9, COSTS)
    assert (found["verdict"]["failed"], found["verdict_without"]["failed"]) == (0, 150)
    assert found["kept_back"]["velocity"] == [1.0, 0.97]
    assert found["kept_back"]["radius"] == [0.0012, 0.0034]
    assert found["kept_back"]["position"] == [[0.0, 0.05], [0.0, 0.0]]
    assert found["blame"]["errors"][0] == {"error": "mass", "size": 0.05, "short": -0.001}
    stopped = replace(survival, verdict=None, verdict_without=None).as_dict()
    assert (stopped["verdict"], stopped["verdict_without"], stopped["blame"]) == (None, None, None)
