"""Tightening: a problem with reserves in limits and tolerances; Survival of its plan in runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from stored_trajectories import REFINEMENT, stored_trajectory

from tubeplanner import GoalRegion, Obstacle, Tube, load_problem, placement_of
from tubeplanner.problem.tightening import Tightening, allowed_tightening, tightened_problem
from tubeplanner.simulation.blamed_errors import Blame, BlamedError
from tubeplanner.simulation.run_verdict import RunVerdict
from tubeplanner.simulation.survival import Survival

TRAY, LINE = "example:ur5/level_tray", "example:two_link/paper_1_30mm"


@pytest.fixture(scope="module")
def tray():
    return load_problem(TRAY).joined


def ends():
    """Return where the stored motion begins and ends."""
    motion = stored_trajectory("ur5/level_tray", REFINEMENT).trajectory
    return motion.position(np.array([0.0, motion.duration]))


def test_nothing_kept_back_is_the_problem_itself(tray):
    same = tightened_problem(tray, Tightening.nothing(tray))
    assert same.tube.radius.tolist() == tray.tube.radius.tolist()
    assert same.robot.limits.effort.tolist() == tray.robot.limits.effort.tolist()
    assert same.clearance == tray.clearance
    assert same.tube.rotation.bounds.tolist() == tray.tube.rotation.bounds.tolist()


def test_every_part_makes_its_own_limit_smaller_and_geometry_is_shared(tray):
    joints, segments = tray.robot.joint_count, tray.tube.segment_count
    kept = Tightening(
        effort=0.9,
        velocity=0.8,
        radius=np.full(segments, 0.004),
        rotation=np.full(segments, 0.01),
        clearance=0.003,
        position=np.array([np.full(joints, 0.1), np.full(joints, 0.2)]),
    )
    less = tightened_problem(tray, kept)
    limits, whole = less.robot.limits, tray.robot.limits
    assert limits.effort == pytest.approx(0.9 * whole.effort)
    assert limits.velocity == pytest.approx(0.8 * whole.velocity)
    assert limits.lower_position == pytest.approx(whole.lower_position + 0.1)
    assert limits.upper_position == pytest.approx(whole.upper_position - 0.2)
    assert less.tube.radius == pytest.approx(tray.tube.radius - 0.004)
    finite = np.isfinite(tray.tube.rotation.bounds)
    assert less.tube.rotation.bounds[finite] == pytest.approx(
        tray.tube.rotation.bounds[finite] - 0.01
    )
    assert less.clearance == pytest.approx(tray.clearance + 0.003)
    assert less.collision is tray.collision
    assert tray.robot.limits is whole


def test_torque_speed_lines_and_ranges_of_effort_are_left_in_part():
    """A line's stall effort, a pair and a table each keep their share; friction stays."""
    problem = load_problem(
        LINE,
        changes={
            "robot.limits.effort": {
                "joint1": [20.0, 30.0],
                "joint2": {"position": [-1.0, 1.0], "effort": [5.0, 9.0]},
            },
            "robot.motors": {
                "viscous_friction": 0.2,
                "saturation_effort": [60.0, 20.0],
                "no_load_velocity": [20.0, 20.0],
            },
        },
    )
    less = tightened_problem(problem, replace(Tightening.nothing(problem), effort=0.5))
    q = np.array([[0.0, -1.0], [0.0, 0.0], [0.0, 2.0]])
    for way in (1.0, -1.0):
        whole = problem.robot.limits.effort_at(q, way)
        assert less.robot.limits.effort_at(q, way) == pytest.approx(0.5 * whole)
    stall = problem.robot.motors.saturation_effort
    assert less.robot.motors.saturation_effort == pytest.approx(0.5 * stall)
    assert less.robot.motors.viscous_friction.tolist() == [0.2, 0.2]
    v = np.full((3, 2), 0.7)
    assert less.robot.inverse_dynamics(q, v, v) == pytest.approx(
        problem.robot.inverse_dynamics(q, v, v)
    )


@pytest.fixture
def line():
    """A problem of one segment along y, and where its tool begins and ends, on the axis."""
    problem = load_problem(LINE)
    return problem, np.array([[-0.16, -1.4], [1.9, -1.4]])


def asked(problem, **parts):
    return replace(Tightening.nothing(problem), **parts)


def test_a_tenth_of_a_radius_is_always_left(line):
    problem, _ = line
    middle, side = np.array([[0.9, -1.4]]), np.array([0, 0.1, 0])
    tool = problem.robot.tool_position(middle)[0]
    problem = problem.with_tube(Tube([tool - side, tool + side], 0.03))
    allowed = allowed_tightening(problem, asked(problem, radius=np.array([0.5])), middle)
    assert allowed.radius == pytest.approx([0.027])
    assert (
        allowed_tightening(problem, asked(problem, radius=np.array([0.01])), middle).radius == 0.01
    )


def test_of_a_radius_that_holds_a_tool_it_is_a_tenth_of_what_is_left_for_its_centre(line):
    problem, _ = line
    middle, side = np.array([[0.9, -1.4]]), np.array([0, 0.1, 0])
    tool = problem.robot.tool_position(middle)[0]
    problem = problem.with_tube(Tube([tool - side, tool + side], 0.03, tool_radius=0.01))
    allowed = allowed_tightening(problem, asked(problem, radius=np.array([0.5])), middle)
    assert allowed.radius == pytest.approx([0.018])


def test_start_and_goal_stay_inside(line):
    """The start 12 mm off the axis of the first segment, the goal 21 mm off that of the last."""
    problem, q = line
    first, last = problem.robot.tool_position(q)
    side = np.array([0, 0, 1.0])
    points = [first + 0.012 * side, [0.3, 0.0, 0.0], last + 0.021 * side]
    problem = problem.with_tube(Tube(points, 0.03))
    wanted = asked(problem, radius=np.full(2, 0.025))
    allowed = allowed_tightening(problem, wanted, q)
    assert allowed.radius == pytest.approx([0.018, 0.009], abs=4e-5)
    assert (
        (tightened_problem(problem, allowed).tube.margin(problem.robot.tool_position(q))[0, 0]) >= 0
    )
    assert allowed_tightening(problem, wanted, q[:1]).radius == pytest.approx(
        [0.018, 0.025], abs=4e-5
    )


def test_clearance_grows_no_farther_than_start_and_goal_are_away(line):
    problem, q = line
    tool = problem.robot.tool_position(q)[1]
    ball = Obstacle.sphere("ball", 0.01, placement_of(tool + np.array([0, 0.2, 0])))
    problem = replace(problem, obstacles=[ball], clearance=0.02)
    checker = problem.collision
    rotation, position = problem.robot.body_poses(q)
    near = min(
        checker.distances(rotation[k], position[k], checker.obstacle_pairs).min() for k in range(2)
    )
    allowed = allowed_tightening(problem, asked(problem, clearance=1.0), q)
    assert allowed.clearance == pytest.approx(near - 0.02, abs=2e-6)
    assert allowed_tightening(problem, asked(problem, clearance=0.001), q).clearance == 0.001
    free = replace(problem, obstacles=[])
    assert allowed_tightening(free, asked(free, clearance=1.0), q).clearance == 1.0


def test_rotation_tolerances_hold_the_turned_start(tray):
    wanted = asked(tray, rotation=np.full(tray.tube.segment_count, 1.0))
    turned, tool = tray.robot.tool_pose(ends())
    margin = tray.tube.rotation_margin(turned, tool)
    allowed = allowed_tightening(tray, wanted, ends()).rotation
    assert allowed[0] <= margin[0, 0]
    assert allowed[-1] <= margin[1, -1]
    assert (allowed < tray.tube.rotation.bounds.min(axis=1)).all()
    assert (allowed > 0).all()


def test_a_free_rotation_has_nothing_to_keep_back(line):
    problem, q = line
    allowed = allowed_tightening(problem, asked(problem, rotation=np.array([0.3])), q[:1])
    assert allowed.rotation.tolist() == [0.0]


def test_where_a_segment_leaves_rotation_free_nothing_is_kept_back_of_it(line):
    problem, q = line
    first, last = problem.robot.tool_position(q)
    points, still = [first, [0.3, 0.0, 0.0], last], [[0, 0, 0, 1]] * 3
    tube = Tube(points, 0.03, orientations=still, rotation_tolerance=[3.0, np.inf])
    problem = problem.with_tube(tube)
    allowed = allowed_tightening(problem, asked(problem, rotation=np.array([0.3, 0.3])), q[:1])
    assert allowed.rotation == pytest.approx([0.3, 0.0])


def test_at_the_very_limits_nothing_is_kept_back(line):
    """A start at its tube's border, turned as far as it may be, at a joint's limit, at a ball."""
    problem, _ = line
    limits = problem.robot.limits
    q = np.array([[0.9, limits.upper_position[1]]])
    (turned,), (tool,) = problem.robot.tool_pose(q)
    points = tool + np.array([[0, 0, 0.03], [0, 0.1, 0.03]])
    angle = 0.9 + limits.upper_position[1]
    assert turned[0, 0] == pytest.approx(np.cos(angle))
    tube = Tube(
        points,
        0.03,
        orientations=[[0, 0, np.sin(angle / 2 - 0.1), np.cos(angle / 2 - 0.1)]] * 2,
        rotation_tolerance=0.2,
    )
    problem = problem.with_tube(tube)
    rotation, position = problem.robot.body_poses(q)
    ball = Obstacle.sphere("ball", 0.01, placement_of(tool + np.array([0, 0.2, 0])))
    problem = replace(problem, obstacles=[ball])
    checker = problem.collision
    near = float(checker.distances(rotation[0], position[0], checker.obstacle_pairs).min())
    problem = replace(problem, clearance=near)
    wanted = asked(
        problem,
        radius=np.array([0.01]),
        rotation=np.array([0.1]),
        clearance=0.01,
        position=np.full((2, 2), 0.1),
    )
    allowed = allowed_tightening(problem, wanted, q)
    assert allowed.radius.tolist() == allowed.rotation.tolist() == [0.0]
    assert allowed.clearance == 0.0
    assert allowed.position.tolist() == [[0.1, 0.1], [0.1, 0.0]]


def test_position_limits_hold_start_and_goal(tray):
    wanted = asked(tray, position=np.full((2, tray.robot.joint_count), 20.0))
    allowed = allowed_tightening(tray, wanted, ends())
    limits = tightened_problem(tray, allowed).robot.limits
    q = ends()
    assert (limits.lower_position <= q).all() and (q <= limits.upper_position).all()
    assert limits.lower_position == pytest.approx(q.min(axis=0), abs=2e-6)


def test_what_joined_segments_keep_back_all_their_parts_do():
    points = [[0.3, -0.5, 0], [0.3, 0, 0], [0.3, 0.5, 0], [0.1, 0.5, 0]]
    problem = load_problem(LINE).with_tube(Tube(points, 0.03, joint_signs={"joint2": "-"}))
    joined = problem.joined
    assert joined.tube.segment_count == 2
    kept = asked(joined, radius=np.array([0.001, 0.002])).of_parts(joined.tube)
    assert kept.radius.tolist() == [0.001, 0.001, 0.002]
    assert kept.of_parts(problem.tube) is kept
    turned = asked(joined, rotation=np.array([0.01, 0.02])).of_parts(joined.tube)
    assert turned.rotation.tolist() == [0.01, 0.01, 0.02]


def test_parts_are_taken_one_by_one(line):
    problem, _ = line
    kept = asked(problem, effort=0.9, radius=np.array([0.01]), clearance=0.002)
    some = kept.only(["effort", "radius"])
    assert (some.effort, some.radius.tolist(), some.clearance) == (0.9, [0.01], 0.0)
    assert [part for part in ("effort", "velocity", "radius", "clearance") if kept.has(part)] == [
        "effort",
        "radius",
        "clearance",
    ]
    assert not some.has("clearance") and not kept.only([]).has("effort")
    slower = asked(problem, velocity=0.8, position=np.array([[0.0, 0.0], [0.1, 0.0]]))
    assert slower.has("velocity") and slower.has("position")
    assert slower.only(["position"]).velocity == 1.0
    assert slower.only(["velocity"]).velocity == 0.8


def test_a_goals_position_stays_inside(line):
    """10 mm beside the segment, it leaves 20 of 30 mm to be kept back."""
    problem, found = line
    position = problem.tube.points[-1] + np.array([0.0, 0.0, 0.01])
    problem = replace(problem, goal=GoalRegion(position, 0.5))
    whole = asked(problem, radius=np.full(problem.tube.segment_count, 0.025))
    allowed = allowed_tightening(problem, whole, found[:1])
    assert allowed.radius[-1] == pytest.approx(0.02, abs=2e-6)
    assert tightened_problem(problem, allowed).goal is problem.goal


# What is said of plans that are to survive errors.


NONE_FAILED, MANY_FAILED = RunVerdict(200, 0, {"tube": 0}), RunVerdict(200, 150, {"tube": 150})
KEPT = Tightening(
    effort=0.93,
    velocity=0.97,
    radius=np.array([0.0012, 0.0034]),
    rotation=np.array([0.012, 0.0]),
    clearance=0.0021,
    position=np.array([[0.0, 0.05], [0.0, 0.0]]),
)
COSTS = {
    "effort": 0.012,
    "velocity": 0.003,
    "radius": 0.0015,
    "rotation": 0.0011,
    "clearance": 0.0003,
    "position": 0.0001,
}
BLAME = Blame(
    "radius", "m", 0.004, -0.009, (BlamedError("mass", 0.05, -0.001), BlamedError("lag", 0.1, 0.0))
)


@pytest.fixture
def survival():
    return Survival(NONE_FAILED, True, KEPT, 0.9, MANY_FAILED, COSTS)


def test_what_was_seen_is_the_verdict_of_fresh_runs(survival):
    assert survival.seen == f"seen in simulation: {NONE_FAILED}"
    stopped = replace(survival, verdict=None)
    assert stopped.seen == "its runs were not simulated to the end"


def test_costs_sum_up(survival):
    assert survival.added == pytest.approx(0.018)
    assert replace(survival, costs={}).added == 0


def test_a_note_tells_what_every_part_costs(survival):
    (note,) = survival.notes
    assert note == (
        "surviving takes 18.0 ms more, 2 %: 93 % of the effort limits (12.0 ms); 97 % of the "
        "velocity limits (3.0 ms); up to 3.4 mm less radius (1.5 ms); up to 12 mrad less rotation "
        "(1.1 ms); 2.1 mm more clearance (0.3 ms); up to 50 mrad or mm less joint range (0.1 ms); "
        f"without robustness the plan takes 0.9000 s, and {MANY_FAILED}"
    )


def test_it_tells_nothing_of_what_was_not_seen(survival):
    (note,) = replace(survival, verdict_without=None, costs={"effort": 0.009}).notes
    assert note == (
        "surviving takes 9.0 ms more, 1 %: 93 % of the effort limits (9.0 ms); without robustness "
        "the plan takes 0.9000 s"
    )
    assert replace(survival, costs={}).notes == ()


def test_blame_is_of_the_plan_whose_runs_it_is_about(survival):
    (note,) = replace(survival, costs={}, blame=BLAME).notes
    assert note == f"the plan without robustness: {BLAME}"
    (note,) = replace(survival, reached=False, costs={}, blame=BLAME).notes
    assert note == f"no plan was found of which all runs survive, their errors enlarged: {BLAME}"
    assert len(replace(survival, blame=BLAME).notes) == 2


def test_as_json_it_has_all_of_it(survival):
    found = json.loads(json.dumps(replace(survival, blame=BLAME).as_dict()))
    assert found["reached"] is True
    assert found["verdict"]["failed"] == 0
    assert found["verdict_without"]["failed"] == 150
    assert found["duration_without"] == 0.9
    assert found["costs"] == COSTS
    assert found["kept_back"]["radius"] == [0.0012, 0.0034]
    assert found["kept_back"]["position"] == [[0.0, 0.05], [0.0, 0.0]]
    assert found["blame"]["errors"][0] == {"error": "mass", "size": 0.05, "short": -0.001}
    stopped = replace(survival, verdict=None, verdict_without=None).as_dict()
    assert (stopped["verdict"], stopped["verdict_without"], stopped["blame"]) == (None, None, None)
