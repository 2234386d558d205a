"""Problems from files, from dictionaries and from Python."""

import copy
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from cases import refusal

from tubeplanner import (
    LimitOverrides,
    Obstacle,
    Payload,
    PlanningProblem,
    PointSpeed,
    Seed,
    ToolOffset,
    Tube,
    compare,
    load_problem,
    load_robot,
    parse_problem,
    placement_of,
    plan,
    sweep,
    verify,
)
from tubeplanner.errors import ProblemError, RobotError, TrajectoryError
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.resources import bundled_folder, bundled_problems
from tubeplanner.robot.joint_limits import VelocityByPosition
from tubeplanner.task.problem_format import AttachedFields, ObstacleFields
from tubeplanner.task.problem_reader import attached_of, obstacle_of

# The two-link arm, stretched along x at its start, turns to y: the tool goes round the corner.
POINTS = [[0.6, 0, 0], [0.4, 0.4, 0], [0, 0.6, 0]]
MINIMAL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": POINTS, "radius": 0.1},
    "start": {"joints": [0, 0]},
}
START, GOAL = [0.0, 0.0], [np.pi / 2, 0.0]
# Their tubes are found by `route`.
WITHOUT_TUBE = ("two_link/through_the_gap", "ur5/past_a_wall", "panda/shelf_to_shelf")


def changed(**changes):
    """Return the least problem with values replaced; `__` stands for the dot between keys."""
    data = copy.deepcopy(MINIMAL)
    for location, value in changes.items():
        *sections, key = location.split("__")
        section = data
        for name in sections:
            section = section.setdefault(name, {})
        section[key] = value
    return data


def fault(kind=ProblemError, **changes):
    message = refusal(kind, parse_problem, changed(**changes), name="my problem")
    assert message.startswith("my problem: ")
    return message.removeprefix("my problem: ")


@pytest.fixture
def least(two_link):
    """Return a function that makes the least problem from its start and other fields."""
    tube = Tube(POINTS, 0.1)
    return lambda start=(0.0, 0.0), **more: PlanningProblem(two_link, tube, start, **more)


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("joints", [[0.1, -0.2], {"joint2": -0.2, "joint1": 0.1}])
def test_an_end_is_a_list_in_group_order_or_a_map_by_name(end, joints):
    problem = parse_problem(changed(tube__radius=2.0, **{end: {"joints": joints}}))
    np.testing.assert_array_equal(getattr(problem, end), [0.1, -0.2])
    # A seed need not be in the tube.
    seed = getattr(parse_problem(changed(**{end: {"seed": joints}})), end)
    assert isinstance(seed, Seed)
    np.testing.assert_array_equal(seed.joints, [0.1, -0.2])


TAKES = "END takes either joints or seed (or pose, group_state, trajectory); it has"
LIMITS = "position limits [-3.14159, 3.14159]"
SIGN = "its position limits and joint sign in segment K"


@pytest.mark.parametrize(
    ("end", "segment", "point", "away"),
    [
        ("start", 0, [0.6, 0.0, 0.0], np.hypot(1.0, 0.4)),  # from the far end of the segment
        ("goal", 1, [0.0, 0.6, 0.0], np.hypot(0.6, 0.6)),
    ],
)
@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ({"joints": [0]}, "END has 1 values for the 2 joints joint1, joint2"),
        ({"joints": {"joint1": 0}}, "END: no value for joint joint2"),
        (
            {"joints": {"joint1": 0, "join2": 0}},
            "END: unknown joint 'join2' (did you mean 'joint2'?); there is: joint1, joint2",
        ),
        ({}, f"{TAKES} neither"),
        ({"joints": [0, 0], "seed": [0, 0]}, f"{TAKES} both"),
        (
            {"seed": [0, 4]},
            f"END.seed: joint 'joint2' at 4 is outside its {LIMITS} (radians and metres are meant)",
        ),
        ({"joints": [0, 4]}, f"END: joint 'joint2' at 4 is outside [-3.14159, 3.14159], {SIGN}"),
        ({"joints": [0, -0.5]}, f"END: joint 'joint2' at -0.5 is outside [0, 3.14159], {SIGN}"),
        (
            {"joints": [np.pi, 0]},
            "END: the tool is at [-0.6, 0.0, 0.0] m, DISTANCE m outside the capsule of segment K "
            "(its end point is POINT m); move the END or the reference point",
        ),
    ],
)
def test_an_end_that_cannot_be_is_bad_input(end, segment, point, away, joints, message):
    signs = {"joint2": "+"} if joints == {"joints": [0, -0.5]} else {}
    expected = message.replace("END", end).replace("K", str(segment)).replace("POINT", str(point))
    expected = expected.replace("DISTANCE", f"{away - 0.1:.3g}")
    assert fault(tube__joint_signs=signs, **{end: joints}) == expected


def test_an_end_may_exceed_its_bounds_by_the_size_of_rounding():
    sign = {"tube__joint_signs": {"joint2": "+"}}
    assert parse_problem(changed(**sign, start={"joints": [0, -1e-7]})).start[1] == -1e-7
    assert "joint 'joint2' at -1e-05" in fault(**sign, start={"joints": [0, -1e-5]})
    points = [[0.7 + 1e-7, 0, 0], [1, 0, 0]]
    assert parse_problem(changed(tube__points=points)).start.tolist() == START
    points = [[0.7 + 1e-5, 0, 0], [1, 0, 0]]
    assert "m outside the capsule of segment 0" in fault(tube__points=points)


# About z; the tool of a stretched arm is off by 0.11 rad at the start, by pi/2 - 1 at the goal.
TURNING = {
    "tube__orientations": [[0, 0, np.sin(a / 2), np.cos(a / 2)] for a in (-0.11, 0.5, 1.0)],
    "goal": {"joints": GOAL},
}


@pytest.mark.parametrize(
    "tolerance", [(0.11, np.pi / 2 - 1), ((0.01, 0.01, 0.11), (np.inf, 0.01, np.inf))]
)
def test_an_end_may_be_turned_as_far_as_its_tolerance(tolerance):
    tube = parse_problem(changed(**TURNING, tube__rotation_tolerance=list(tolerance))).tube
    np.testing.assert_allclose(tube.orientations, TURNING["tube__orientations"])
    assert tube.rotation_tolerance == tolerance


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        (
            [0.1, 9.0],
            "start: the tool is turned by 0.11 rad, where the rotation tolerance of segment 0 is "
            "0.1 rad; turn the start, change tube.orientations[0] or widen "
            "tube.rotation_tolerance[0]",
        ),
        (
            [9.0, [0.01, 0.01, 0.2]],
            "goal: the tool is turned by 0.5708 rad about z of the reference orientation, where "
            "the rotation tolerance of segment 1 is 0.2 rad; turn the goal, change "
            "tube.orientations[2] or widen tube.rotation_tolerance[1]",
        ),
    ],
)
def test_an_end_turned_too_far_is_bad_input(tolerance, message):
    assert fault(**TURNING, tube__rotation_tolerance=tolerance) == message


@pytest.mark.parametrize("start", [np.zeros(2, dtype=complex), [0.0, False], ["0", "0"], 5])
def test_joints_are_real_numbers(least, start):
    with pytest.raises(ProblemError, match=r"start .* must be numbers, one per joint"):
        least(start)


def test_position_limits_and_signs_are_cut_per_segment():
    signs = [{"joint2": "+"}, {"joint2": [-1.0, 0.5], "joint1": "-"}]
    problem = parse_problem(changed(tube__joint_signs=signs))
    full, half = 2 * np.pi, np.pi
    np.testing.assert_allclose(problem.joint_lower, [[-full, 0], [-full, -1]])
    np.testing.assert_allclose(problem.joint_upper, [[full, half], [0, 0.5]])


def test_segments_of_equal_joint_ranges_share_their_bounds():
    points = [[0.6, 0, 0], [0.4, 0.4, 0], [0.2, 0.5, 0], [0, 0.6, 0]]
    signs = [{"joint2": "+"}, {"joint2": [-1.0, 0.5]}, {"joint2": "+"}]
    problem = parse_problem(changed(tube__points=points, tube__joint_signs=signs))
    lower, upper, bounds_of = problem.distinct_joint_bounds
    assert len(lower) == len(upper) == 2 and bounds_of[0] == bounds_of[2] != bounds_of[1]
    np.testing.assert_array_equal(lower[bounds_of], problem.joint_lower)
    np.testing.assert_array_equal(upper[bounds_of], problem.joint_upper)


@pytest.mark.parametrize(
    ("signs", "message"),
    [
        ({"joint3": "+"}, "unknown joint 'joint3' (did you mean 'joint2'?); there is: joint1, "),
        (
            {"joint2": [4, 5]},
            f"joint 'joint2' has no value left in segment 0: signs and {LIMITS} ask for >= 4 and "
            "<= 3.14159; proved: there is no motion",
        ),
    ],
)
def test_joint_signs_that_cannot_hold_are_refused(signs, message):
    assert fault(tube__joint_signs=signs).startswith(f"tube.joint_signs: {message}")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"urdf": "none.urdf"}, "robot description none.urdf does not exist"),
        ({"tool_frame": "hnd"}, "unknown tool_frame 'hnd' (did you mean 'hand'?)"),
        ({"limits": {"effort": {"elbow": 1}}}, "robot.limits.effort: unknown joint 'elbow'; there"),
        ({"limits": {"tool_speed": 0}}, "robot.limits.tool_speed is 0.0; give a number from 1e-06"),
    ],
)
def test_a_robot_that_cannot_be_planned_with_says_why(fields, message):
    changes = {f"robot__{name}": value for name, value in fields.items()}
    assert message in fault(RobotError, **changes)


GROUP = ["elbow_joint", "shoulder_pan_joint", "shoulder_lift_joint"]
ROBOT = {
    "urdf": "example:ur5",
    "tool_frame": "tool0",
    "tool_offset": {"position": [0, 0, 0.1], "rpy": [0.1, 0.2, 0.3]},
    "joints": GROUP,
    "locked_joints": {"wrist_1_joint": 0.5},
    "gravity": [9.81, 0, 0],
    "payload": {"mass": 2, "com": [0, 0, 0.1], "inertia": [0.1, 0.1, 0.1, 0, 0, 0]},
    "limits": {
        "effort": {"elbow_joint": 100},
        "velocity": {"elbow_joint": np.inf},
        "position": {"elbow_joint": [0, 3]},
        "acceleration": {"elbow_joint": 7},
        "jerk": {"elbow_joint": 70},
        "tool_speed": 0.7,
        "effort_rate": [1000, 2000, 3000],
        "velocity_by_position": {"elbow_joint": {"deceleration": 6, "offset": 0.3}},
        "point_speed": [{"link": "forearm_link", "position": [0, 0, 0.1], "speed": 0.9}],
        "scale": {"effort": 0.5},
    },
}


def test_every_field_of_the_robot_reaches_the_robot():
    tube = {"points": [[0, 0, 0], [1, 0, 0]], "radius": 5}
    robot = parse_problem({"robot": ROBOT, "tube": tube, "start": {"joints": [1, 0, 0]}}).robot
    expected = load_robot(
        "example:ur5",
        "tool0",
        tool_offset=ToolOffset((0, 0, 0.1), (0.1, 0.2, 0.3)),
        joints=GROUP,
        locked_joints={"wrist_1_joint": 0.5},
        gravity=(9.81, 0, 0),
        payload=Payload(2, (0, 0, 0.1), (0.1, 0.1, 0.1, 0, 0, 0)),
    )
    q = np.array([[0.4, -0.5, 0.6]])
    assert robot.joint_names == expected.joint_names
    for mine, other in zip(robot.tool_pose(q), expected.tool_pose(q), strict=True):
        np.testing.assert_array_equal(mine, other)
    tau = expected.inverse_dynamics(q, q, q)
    np.testing.assert_array_equal(robot.inverse_dynamics(q, q, q), tau)
    limits = robot.limits
    assert (limits.lower_position[0], limits.upper_position[0]) == (0, 3)
    assert limits.effort.tolist() == [50, 75, 75]
    assert limits.tool_speed == 0.7
    assert limits.velocity.tolist() == [np.inf, 3.15, 3.15]
    assert (limits.acceleration[0], limits.jerk[0]) == (7, 70)
    assert limits.effort_rate.tolist() == [3000, 1000, 2000]  # given along the chain
    assert limits.velocity_by_position == (VelocityByPosition(0, 6, 0.3, 0, 3),)
    assert limits.point_speed == (PointSpeed("forearm_link", (0, 0, 0.1), 0.9),)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"box": [1, 1, 1], "sphere": 1}, "obstacles: 'part' must have exactly one of box, sphere"),
        ({"mesh": "part.stl"}, "mesh part.stl, named in the problem file, does not exist"),
        ({"box": [1, 0, 1]}, "box has size 0 m; 1e-06 to 10000 m are accepted"),
        ({"name": "link1", "sphere": 1}, "obstacles: 'link1' is also the name of a link; choose"),
        ({"sphere": 1, "scale": 2}, "obstacles: 'part': scale belongs to a mesh alone; remove it"),
    ],
)
def test_an_obstacle_that_cannot_be_is_named(fields, message):
    assert message in fault(obstacles=[{"name": "part", **fields}])
    assert "unknown link or obstacle 'wal'" in fault(collision__ignore=[["link1", "wal"]])


def test_each_kind_of_obstacle_stands_where_the_file_puts_it():
    quarter = np.sqrt(0.5)
    problem = parse_problem(
        changed(
            obstacles=[
                {"name": "a", "box": [1, 2, 3], "position": [5, 0, 0], "rpy": [0, 0, np.pi / 2]},
                {"name": "b", "sphere": 0.5, "position": [0, 5, 0]},
                {"name": "c", "cylinder": [0.5, 2], "quaternion": [quarter, 0, 0, quarter]},
                {"name": "d", "capsule": [0.5, 2], "position": [0, 0, 5]},
            ],
            collision={"self": False, "ignore": [["c", "link1"], ["c", "link2"]]},
            clearance=0.25,
        )
    )
    shapes = {obstacle.name: obstacle.shapes[0] for obstacle in problem.obstacles}
    spans = {name: np.ptp(shape.vertices, axis=0) for name, shape in shapes.items()}
    np.testing.assert_allclose(spans["a"], [2, 1, 3], atol=1e-12)
    np.testing.assert_allclose(spans["c"][1], 2, atol=1e-12)
    np.testing.assert_allclose(spans["d"], [0, 0, 2], atol=1e-12)
    np.testing.assert_allclose(shapes["b"].center, [0, 5, 0])
    assert [shape.radius for shape in shapes.values()] == [0, 0.5, 0, 0.5]
    assert problem.clearance == 0.25
    assert len(problem.collision.link_pairs) == 0
    checked = {problem.collision.shapes[j].owner for _, j in problem.collision.obstacle_pairs}
    assert checked == {"a", "b", "d"}


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_mesh_is_scaled_about_its_own_origin(tmp_path, scale):
    trimesh.creation.box((0.2, 0.4, 0.6)).export(tmp_path / "brick.stl")
    fields = ObstacleFields(name="brick", mesh="brick.stl", scale=scale, position=(1.0, 0.0, 0.0))
    (shape,) = obstacle_of(fields, tmp_path, ()).shapes
    sides = scale * np.array([0.2, 0.4, 0.6])
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), sides, atol=1e-6)
    np.testing.assert_allclose(shape.vertices.mean(axis=0), [1, 0, 0], atol=1e-6)


def test_a_carried_solid_keeps_what_it_touches_and_what_it_was_made_from(tmp_path):
    fields = AttachedFields(name="cup", cylinder=(0.03, 0.1), touch_links=["hand", "arm2"])
    solid = attached_of(fields, tmp_path, ())
    assert solid.touch_links == ("hand", "arm2")
    assert solid.contents is not None


YAML_TEXT = """\
robot: {urdf: arms/two.urdf, tool_frame: hand, gravity: [0, 0, 0]}
tube: {points: [[0.6, 0, 0], [0, 0.6, 0]], radius: 0.3}
start: {joints: [0, 0]}
"""


@pytest.fixture
def cell(tmp_path, monkeypatch):
    """A problem file and, in a folder beside it, its robot; the working folder is elsewhere."""
    (tmp_path / "arms").mkdir()
    shutil.copy(bundled_folder() / "two_link" / "two_link.urdf", tmp_path / "arms" / "two.urdf")
    (tmp_path / "turn.yaml").write_text(YAML_TEXT)
    monkeypatch.chdir("/")
    return tmp_path / "turn.yaml"


def test_paths_and_package_folders_are_relative_to_the_problem_file(cell):
    urdf = cell.parent / "arms" / "two.urdf"
    assert load_problem(cell).robot.urdf.path == urdf
    assert load_problem("turn.yaml", cell.parent).robot.urdf.path == urdf
    package = "package://arms/two.urdf, package_dirs: [.]"
    cell.write_text(YAML_TEXT.replace("arms/two.urdf", package))
    assert load_problem(cell).robot.urdf.path == urdf


def test_a_fault_in_a_file_is_reported_with_the_file(cell):
    cell.write_text(YAML_TEXT.replace("[0, 0]}", "[0, 0, 0]}"))
    message = refusal(ProblemError, load_problem, cell)
    assert message == f"{cell}: start has 3 values for the 2 joints joint1, joint2"


@pytest.mark.parametrize("name", bundled_problems())
def test_bundled_problems_load_by_name_and_are_called_so(name):
    problem = load_problem(f"example:{name}", reads_tube=name not in WITHOUT_TUBE)
    assert problem.name == name
    assert len(problem.collision.shapes) > len(problem.obstacles)


@pytest.mark.parametrize("name", WITHOUT_TUBE)
def test_a_problem_without_a_tube_says_how_to_find_one(name):
    advice = "tube is required; `tubeplanner route` finds one from start, goal and obstacles"
    message = refusal(ProblemError, load_problem, f"example:{name}")
    assert message == f"{bundled_problems()[name]}: {advice}"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal": None}, "goal is required: joints, or the position of the tool"),
        ({"start": {"seed": START}}, "start.joints is required: a seed belongs to the first point"),
        ({"goal": {"seed": GOAL}}, "goal.seed belongs to a position; give goal.position or goal"),
        ({"start": {"position": [0, 0, 0]}}, "start.position is not to be given: start takes joi"),
    ],
)
def test_ends_that_no_route_can_join(changes, message):
    with pytest.raises(ProblemError, match=re.escape(message)):
        parse_problem({**MINIMAL, "goal": {"joints": GOAL}, **changes}, reads_tube=False)


def test_without_its_tube_a_problem_lets_the_tool_be_anywhere():
    problem = parse_problem({**MINIMAL, "goal": {"position": [0, 0.5, 0]}}, reads_tube=False)
    np.testing.assert_allclose(problem.tube.points, [[0.6, 0, 0], [0, 0.5, 0]], atol=1e-9)
    assert problem.goal.position.tolist() == [0, 0.5, 0] and problem.tube.radius[0] >= 1e3
    still = parse_problem({**MINIMAL, "goal": {"joints": START}}, reads_tube=False)
    np.testing.assert_allclose(still.tube.points[0], [0.6, 0, 0], atol=1e-9)


def test_a_problem_built_in_python_equals_the_one_that_was_parsed():
    parsed = parse_problem(
        changed(
            robot__limits={"velocity": {"joint1": np.inf}},
            tube__joint_signs={"joint2": "+"},
            tube__tool_radius=0.02,
            tube__visit="any",
            goal={"joints": GOAL},
            obstacles=[{"name": "post", "cylinder": [0.03, 0.3], "position": [0.2, 0.2, 1]}],
            clearance=0.01,
            collision={"ignore": [["post", "link1"]]},
        ),
        name="turn",
    )
    limits = LimitOverrides(velocity={"joint1": np.inf})
    built = PlanningProblem(
        robot=load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits),
        tube=Tube(POINTS, 0.1, tool_radius=0.02, joint_signs={"joint2": "+"}, visit="any"),
        start=np.array(START),
        goal={"joint1": GOAL[0], "joint2": GOAL[1]},
        obstacles=[post(0.2)],
        clearance=0.01,
        ignore_collisions=[("post", "link1")],
        name="turn",
    )
    assert problem_hash(built) == problem_hash(parsed)
    assert built.name == parsed.name


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"start": [0.0, np.nan]}, "start must be finite numbers"),
        ({"start": Seed(np.array([np.inf, 0]))}, "start.seed must be finite numbers"),
        ({"goal": [3.0, 0.0]}, "goal: the tool is at [-0.594, 0.0847, 0.0] m"),
        ({"clearance": np.inf}, "clearance is inf m; 0 to 10000 m are accepted"),
        ({"clearance": "a"}, "clearance is 'a' m; 0 to 10000 m are accepted"),
        ({"obstacles": "ab"}, "obstacles[0] is 'a'; give Obstacle.box"),
        ({"attached": ["a"]}, "attached[0] is 'a'; give AttachedSolid"),
        ({"ignore_collisions": [(1, 2, 3)]}, "ignore_collisions[0] is (1, 2, 3); give pairs of"),
    ],
)
def test_a_problem_built_in_python_is_checked_at_once(least, fields, message):
    assert refusal(ProblemError, least, **fields).startswith(message)


def test_its_arrays_cannot_be_written_to(least):
    problem = least()
    for array in (problem.start, problem.joint_lower, problem.joint_upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def post(x):
    return Obstacle.cylinder("post", 0.03, 0.3, placement_of((x, 0.2, 1)))


def test_the_callers_list_of_obstacles_may_change_afterwards(least):
    obstacles = [post(0.2)]
    problem = least(obstacles=obstacles)
    obstacles[0] = post(0.1)
    assert problem.obstacles[0].shapes[0].center[0] == pytest.approx(0.2)
    assert problem.collision.shapes[-1].shape.center[0] == pytest.approx(0.2)


def test_collision_geometry_is_shared_until_its_parts_are_replaced(least):
    problem = least(obstacles=[post(0.2)])
    assert problem.with_tube(problem.tube.with_radius(0.2)).collision is problem.collision
    assert problem.along(problem.tube, problem.start).collision is problem.collision
    changed = replace(problem, obstacles=[post(0.1)])
    assert changed.collision is not problem.collision
    assert changed.collision.shapes[-1].shape.center[0] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("function", "arguments"), [(plan, ()), (compare, ()), (sweep, ([0.1],)), (verify, (None,))]
)
def test_every_taker_of_a_problem_or_a_trajectory_says_so(least, function, arguments):
    with pytest.raises(ProblemError, match="the problem is None; give a PlanningProblem"):
        function(None, *arguments)
    with pytest.raises(TrajectoryError, match="the trajectory is 'a'; give a JointTrajectory"):
        verify(least(), "a")
