"""Problems from files, from dictionaries and from Python."""

import copy
import dataclasses
import re
import shutil

import numpy as np
import pytest

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
from tubeplanner.resources import bundled_folder, bundled_problems
from tubeplanner.robot.velocity_by_position import VelocityByPosition

# The two-link arm, stretched along x at its start, turns to y: the tool goes round the corner.
MINIMAL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0], [0, 0.6, 0]], "radius": 0.1},
    "start": {"joints": [0, 0]},
}
START, GOAL = [0.0, 0.0], [np.pi / 2, 0.0]
# Their tubes are found by `route`.
WITHOUT_TUBE = ("two_link/through_the_gap", "ur5/past_a_wall", "panda/shelf_to_shelf")


def changed(**changes):
    """Return the least problem with values replaced; `__` stands for the dot between keys."""
    data = copy.deepcopy(MINIMAL)
    for place, value in changes.items():
        *sections, key = place.split("__")
        section = data
        for name in sections:
            section = section.setdefault(name, {})
        section[key] = value
    return data


def fault(data, kind=ProblemError):
    with pytest.raises(kind) as caught:
        parse_problem(data, name="my problem")
    return str(caught.value)


# --- start and goal ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "given",
    [{"joints": [0.1, -0.2]}, {"joints": {"joint2": -0.2, "joint1": 0.1}}],
    ids=["list", "map"],
)
@pytest.mark.parametrize("end", ["start", "goal"])
def test_an_end_may_be_a_list_in_group_order_or_a_map_by_name(end, given):
    data = changed(tube__radius=2.0, **{end: given})
    np.testing.assert_array_equal(getattr(parse_problem(data), end), [0.1, -0.2])


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("given", [[0.1, -3.0], {"joint2": -3.0, "joint1": 0.1}])
def test_an_end_may_be_a_seed_which_need_not_be_in_the_tube(end, given):
    seed = getattr(parse_problem(changed(**{end: {"seed": given}})), end)
    assert isinstance(seed, Seed)
    np.testing.assert_array_equal(seed.joints, [0.1, -3.0])


def test_without_a_goal_there_is_none():
    assert parse_problem(MINIMAL).goal is None


def test_values_follow_the_group_order_of_the_file():
    data = changed(robot__joints=["joint2", "joint1"], start={"joints": {"joint1": 0, "joint2": 1}})
    data["tube"]["radius"] = 1.0
    np.testing.assert_array_equal(parse_problem(data).start, [1, 0])


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"joints": [0]}, "END has 1 values for the 2 joints joint1, joint2"),
        ({"joints": [0, 0, 0]}, "END has 3 values for the 2 joints joint1, joint2"),
        ({"seed": []}, "END.seed has 0 values for the 2 joints joint1, joint2"),
        ({"joints": {"joint1": 0}}, "END: no value for joint joint2"),
        ({"seed": {}}, "END.seed: no value for joint joint1, joint2"),
        (
            {"joints": {"joint1": 0, "join2": 0}},
            "END: unknown joint 'join2' (did you mean 'joint2'?); there is: joint1, joint2",
        ),
        ({}, "END takes either joints or seed (or pose, group_state, trajectory); it has neither"),
        (
            {"joints": [0, 0], "seed": [0, 0]},
            "END takes either joints or seed (or pose, group_state, trajectory); it has both",
        ),
        (
            {"seed": [0, 4]},
            "END.seed: joint 'joint2' at 4 is outside its position limits [-3.14159, 3.14159] "
            "(radians and metres are meant)",
        ),
        (
            {"joints": [0, 4]},
            "END: joint 'joint2' at 4 is outside [-3.14159, 3.14159], its position limits and "
            "joint sign in segment K",
        ),
        (
            {"joints": [0, -0.5]},
            "END: joint 'joint2' at -0.5 is outside [0, 3.14159], its position limits and joint "
            "sign in segment K",
        ),
        (
            {"joints": [np.pi, 0]},
            "END: the tool is at [-0.6, 0.0, 0.0] m, DISTANCE m outside the capsule of segment K "
            "(its end point is POINT m); move the END or the reference point",
        ),
    ],
)
def test_an_end_that_cannot_be_is_bad_input(end, given, message):
    radius, signs = 0.1, ({"joint2": "+"} if given == {"joints": [0, -0.5]} else {})
    segment, point, away = {
        "start": (0, [0.6, 0.0, 0.0], np.hypot(1.0, 0.4)),  # from the far end of the segment
        "goal": (1, [0.0, 0.6, 0.0], np.hypot(0.6, 0.6)),
    }[end]
    text = message.replace("END", end).replace("K", str(segment)).replace("POINT", str(point))
    text = text.replace("DISTANCE", f"{away - radius:.3g}")
    data = changed(tube__joint_signs=signs, **{end: given})
    assert fault(data) == f"my problem: {text}"


def test_an_end_may_exceed_its_bounds_by_what_rounding_does():
    data = changed(tube__joint_signs={"joint2": "+"}, start={"joints": [0, -1e-7]})
    assert parse_problem(data).start[1] == -1e-7
    assert "joint 'joint2' at -1e-05" in fault(changed(**{**data, "start": {"joints": [0, -1e-5]}}))


# About z; the tool of a stretched arm is off by 0.11 rad at the start, by pi/2 - 1 at the goal.
TURNING = [[0, 0, np.sin(a / 2), np.cos(a / 2)] for a in (-0.11, 0.5, 1.0)]


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        ([0.11, np.pi / 2 - 1], None),
        ([[0.01, 0.01, 0.11], [np.inf, 0.01, np.inf]], None),
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
    data = changed(tube__orientations=TURNING, tube__rotation_tolerance=tolerance)
    data["goal"] = {"joints": GOAL}
    if message is None:
        tube = parse_problem(data).tube
        np.testing.assert_allclose(tube.orientations, TURNING)
        assert tube.rotation_tolerance == tuple(
            tuple(bound) if isinstance(bound, list) else bound for bound in tolerance
        )
    else:
        assert fault(data) == f"my problem: {message}"


@pytest.mark.parametrize(("outside", "refused"), [(1e-7, False), (1e-5, True)])
def test_the_tool_may_leave_the_capsule_by_what_rounding_does(outside, refused):
    points = [[0.6 + 0.1 + outside, 0, 0], [1, 0, 0]]
    data = changed(tube__points=points)
    if refused:
        assert "m outside the capsule of segment 0" in fault(data)
    else:
        assert parse_problem(data).start.tolist() == START


# --- tube and joints ---------------------------------------------------------------------------


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_the_way_of_visiting_reaches_the_tube(visit):
    assert parse_problem(changed(tube__visit=visit)).tube.visit == visit


def test_position_limits_and_signs_are_cut_per_segment():
    data = changed(
        tube__joint_signs=[{"joint2": "+"}, {"joint2": [-1.0, 0.5], "joint1": "-"}],
        start={"joints": [0, 0]},
    )
    problem = parse_problem(data)
    full, half = 2 * np.pi, np.pi
    np.testing.assert_allclose(problem.joint_lower, [[-full, 0], [-full, -1]])
    np.testing.assert_allclose(problem.joint_upper, [[full, half], [0, 0.5]])


def test_segments_that_ask_the_same_of_the_joints_share_their_bounds():
    data = changed(
        tube__points=[[0.6, 0, 0], [0.4, 0.4, 0], [0.2, 0.5, 0], [0, 0.6, 0]],
        tube__joint_signs=[{"joint2": "+"}, {"joint2": [-1.0, 0.5]}, {"joint2": "+"}],
        start={"joints": [0, 0]},
    )
    lower, upper, bounds_of = parse_problem(data).distinct_joint_bounds
    assert len(lower) == len(upper) == 2 and bounds_of[0] == bounds_of[2] != bounds_of[1]
    np.testing.assert_array_equal(lower[bounds_of], parse_problem(data).joint_lower)
    np.testing.assert_array_equal(upper[bounds_of], parse_problem(data).joint_upper)


@pytest.mark.parametrize(
    ("signs", "message"),
    [
        (
            {"joint3": "+"},
            "tube.joint_signs: unknown joint 'joint3' (did you mean 'joint2'?); there is: joint1, "
            "joint2",
        ),
        (
            {"joint2": [4, 5]},
            "tube.joint_signs: joint 'joint2' has no value left in segment 0: signs and position "
            "limits [-3.14159, 3.14159] ask for >= 4 and <= 3.14159; proved: there is no motion",
        ),
        ([{}], "tube.joint_signs has 1 maps for 2 segments; give one, or one each"),
        (
            [{"joint2": [0, 1]}, {"joint2": [2, 3]}],
            "tube.joint_signs: joint 'joint2' has the range [0.0, 1.0] in segment 0 and [2.0, 3.0] "
            "in segment 1, which do not meet; give ranges that share a value; proved: there is no "
            "motion",
        ),
    ],
)
def test_joint_signs_that_cannot_hold_are_refused(signs, message):
    assert fault(changed(tube__joint_signs=signs)) == f"my problem: {message}"


@pytest.mark.parametrize("clearance", [-0.01, -1])
def test_a_negative_clearance_is_refused(clearance):
    message = f"my problem: clearance is {clearance:g} m; 0 to 10000 m are accepted"
    assert fault(changed(clearance=clearance)) == message


# --- robot -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot__urdf": "none.urdf"}, "robot description none.urdf does not exist"),
        ({"robot__urdf": "example:two_lnk"}, "(did you mean 'two_link'?)"),
        ({"robot__tool_frame": "hnd"}, "unknown tool_frame 'hnd' (did you mean 'hand'?)"),
        ({"robot__joints": ["joint1", "join2"]}, "unknown movable joint 'join2'"),
        (
            {"robot__locked_joints": {"joint9": 1}},
            "robot.locked_joints: unknown joint outside the group",
        ),
        (
            {"robot__limits": {"effort": {"elbow": 1}}},
            "robot.limits.effort: unknown joint 'elbow'; there is: joint1, joint2",
        ),
        (
            {"robot__limits": {"effort": {"joint1": np.inf}, "velocity": {"joint1": np.inf}}},
            "joint 'joint1' has no finite limit among effort, velocity and acceleration",
        ),
        (
            {"robot__limits": {"scale": {"effort": 2}}},
            "robot.limits.scale: effort at 2 must be in (0, 1]",
        ),
        (
            {"robot__limits": {"tool_speed": 0}},
            "robot.limits.tool_speed is 0.0; give a number from 1e-06 m/s",
        ),
        ({"robot__payload": {"mass": -1}}, "robot.payload: mass -1 kg must be from 0 to 1e+06 kg"),
    ],
)
def test_a_robot_that_cannot_be_planned_with_says_why(change, message):
    assert message in fault(changed(**change), RobotError)


def test_every_field_of_the_robot_reaches_the_robot():
    problem = parse_problem(
        {
            "robot": {
                "urdf": "example:ur5",
                "tool_frame": "tool0",
                "tool_offset": {"position": [0, 0, 0.1], "rpy": [0.1, 0.2, 0.3]},
                "joints": ["elbow_joint", "shoulder_pan_joint", "shoulder_lift_joint"],
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
                    "point_speed": [
                        {"link": "forearm_link", "position": [0, 0, 0.1], "speed": 0.9}
                    ],
                    "scale": {"effort": 0.5},
                },
            },
            "tube": {"points": [[0, 0, 0], [1, 0, 0]], "radius": 5},
            "start": {"joints": [1, 0, 0]},
        }
    )
    expected = load_robot(
        "example:ur5",
        "tool0",
        tool_offset=ToolOffset((0, 0, 0.1), (0.1, 0.2, 0.3)),
        joints=["elbow_joint", "shoulder_pan_joint", "shoulder_lift_joint"],
        locked_joints={"wrist_1_joint": 0.5},
        gravity=(9.81, 0, 0),
        payload=Payload(2, (0, 0, 0.1), (0.1, 0.1, 0.1, 0, 0, 0)),
    )
    robot, q = problem.robot, np.array([[0.4, -0.5, 0.6]])
    assert robot.joint_names == expected.joint_names
    for mine, other in zip(robot.tool_pose(q), expected.tool_pose(q), strict=True):
        np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(
        robot.inverse_dynamics(q, q, q), expected.inverse_dynamics(q, q, q)
    )
    limits = robot.limits
    assert (limits.lower_position[0], limits.upper_position[0]) == (0, 3)
    assert limits.effort.tolist() == [50, 75, 75]
    assert limits.tool_speed == 0.7
    assert limits.velocity.tolist() == [np.inf, 3.15, 3.15]
    assert (limits.acceleration[0], limits.jerk[0]) == (7, 70)
    assert limits.effort_rate.tolist() == [3000, 1000, 2000]  # given along the chain
    assert limits.velocity_by_position == (VelocityByPosition(0, 6, 0.3, 0, 3),)
    assert limits.point_speed == (PointSpeed("forearm_link", (0, 0, 0.1), 0.9),)


# --- obstacles ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        (
            {},
            "obstacles: 'part' must have exactly one of box, sphere, cylinder, capsule, mesh; it ",
        ),
        ({"box": [1, 1, 1], "sphere": 1}, "it has box, sphere"),
        ({"mesh": "part.stl"}, "mesh part.stl, named in the problem file, does not exist"),
        ({"box": [1, 0, 1]}, "obstacle 'part': box has size 0 m; 1e-06 to 10000 m are accepted"),
        ({"sphere": -1}, "obstacle 'part': sphere has size -1 m; 1e-06 to 10000 m are accepted"),
        (
            {"sphere": 1, "rpy": [0, 0, 0], "quaternion": [0, 0, 0, 1]},
            "rpy or quaternion, not both",
        ),
        ({"sphere": 1, "quaternion": [0, 0, 0, 0]}, "has no direction"),
        ({"sphere": 1, "scale": 2}, "obstacles: 'part': scale belongs to a mesh alone; remove it"),
        (
            {"sphere": 1, "position": [0, 0, 2e4]},
            "position [0.0, 0.0, 20000.0] must be three finite",
        ),
    ],
)
def test_an_obstacle_that_cannot_be_is_named(obstacle, message):
    text = fault(changed(obstacles=[{"name": "part", **obstacle}]))
    assert text.startswith("my problem: ")
    assert message in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"obstacles": [{"name": "a", "sphere": 1}, {"name": "a", "sphere": 2}]},
            "my problem: obstacles: the name 'a' is given 2 times",
        ),
        (
            {"obstacles": [{"name": "link1", "sphere": 1}]},
            "my problem: obstacles: 'link1' is also the name of a link; choose another",
        ),
        (
            {"collision__ignore": [["link1", "wal"]]},
            "my problem: collision.ignore: unknown link or obstacle 'wal'; there is: base, link1, "
            "link2, hand",
        ),
    ],
)
def test_names_of_obstacles_are_checked_on_loading(change, message):
    assert fault(changed(**change)) == message


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
    spans = {
        obstacle.name: np.ptp(obstacle.shapes[0].vertices, axis=0) for obstacle in problem.obstacles
    }
    np.testing.assert_allclose(spans["a"], [2, 1, 3], atol=1e-12)
    np.testing.assert_allclose(spans["c"][1], 2, atol=1e-12)
    np.testing.assert_allclose(spans["d"], [0, 0, 2], atol=1e-12)
    centers = {obstacle.name: obstacle.shapes[0].center for obstacle in problem.obstacles}
    np.testing.assert_allclose(centers["b"], [0, 5, 0])
    assert [obstacle.shapes[0].radius for obstacle in problem.obstacles] == [0, 0.5, 0, 0.5]
    assert problem.clearance == 0.25
    assert len(problem.collision.link_pairs) == 0
    checked = {problem.collision.shapes[j].owner for _, j in problem.collision.obstacle_pairs}
    assert checked == {"a", "b", "d"}


# --- files -------------------------------------------------------------------------------------

YAML_TEXT = """\
robot: {urdf: arms/two.urdf, tool_frame: hand, gravity: [0, 0, 0]}
tube: {points: [[0.6, 0, 0], [0, 0.6, 0]], radius: 0.3}
start: {joints: [0, 0]}
"""


@pytest.fixture
def cell(tmp_path):
    """A folder with a problem file and, in a folder beside it, its robot."""
    (tmp_path / "arms").mkdir()
    shutil.copy(bundled_folder() / "two_link" / "two_link.urdf", tmp_path / "arms" / "two.urdf")
    (tmp_path / "turn.yaml").write_text(YAML_TEXT)
    return tmp_path


def test_paths_are_relative_to_the_problem_file(cell, monkeypatch):
    monkeypatch.chdir("/")
    problem = load_problem(cell / "turn.yaml")
    assert problem.robot.urdf.path == cell / "arms" / "two.urdf"
    assert load_problem("turn.yaml", cell).robot.urdf.path == problem.robot.urdf.path


def test_package_folders_are_relative_to_the_problem_file_too(cell, monkeypatch):
    monkeypatch.chdir("/")
    text = YAML_TEXT.replace("arms/two.urdf", "package://arms/two.urdf, package_dirs: [.]")
    (cell / "turn.yaml").write_text(text)
    assert load_problem(cell / "turn.yaml").robot.urdf.path == cell / "arms" / "two.urdf"


def test_a_fault_in_a_file_is_reported_with_the_file(cell):
    (cell / "turn.yaml").write_text(YAML_TEXT.replace("[0, 0]}", "[0, 0, 0]}"))
    with pytest.raises(ProblemError) as caught:
        load_problem(cell / "turn.yaml")
    assert str(caught.value) == (
        f"{cell / 'turn.yaml'}: start has 3 values for the 2 joints joint1, joint2"
    )


@pytest.mark.parametrize("name", bundled_problems())
def test_bundled_problems_load_by_name_and_are_called_so(name):
    problem = load_problem(f"example:{name}", reads_tube=name not in WITHOUT_TUBE)
    assert problem.name == name
    assert len(problem.collision.shapes) > len(problem.obstacles)


@pytest.mark.parametrize("name", WITHOUT_TUBE)
def test_a_problem_without_a_tube_says_how_to_find_one(name):
    with pytest.raises(ProblemError) as caught:
        load_problem(f"example:{name}")
    assert str(caught.value) == (
        f"{bundled_problems()[name]}: tube is required; `tubeplanner route` finds one from start, "
        "goal and obstacles"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal": None}, "goal is required: joints, or the position of the tool"),
        ({"start": {"seed": START}}, "start.joints is required: a seed belongs to the first point"),
        ({"goal": {"seed": GOAL}}, "goal.seed belongs to a position; give goal.position or goal"),
        (
            {"goal": {"joints": GOAL, "position": [0, 0.6, 0]}},
            "goal.position is not to be given: it is the one of goal.joints",
        ),
        (
            {"start": {"joints": START, "position": [0.6, 0, 0]}},
            "start.position is not to be given: start takes joints",
        ),
        ({"goal": {"joints": [0]}}, "goal has 1 values for the 2 joints joint1, joint2"),
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


# --- Python ------------------------------------------------------------------------------------


def test_a_problem_built_in_python_equals_the_one_that_was_parsed():
    parsed = parse_problem(
        changed(
            robot__limits={"velocity": {"joint1": np.inf}},
            tube__joint_signs={"joint2": "+"},
            tube__tool_radius=0.02,
            goal={"joints": GOAL},
            obstacles=[{"name": "post", "cylinder": [0.03, 0.3], "position": [0.2, 0.2, 1]}],
            clearance=0.01,
            collision={"ignore": [["post", "link1"]]},
        ),
        name="turn",
    )
    built = PlanningProblem(
        robot=load_robot(
            "example:two_link",
            "hand",
            gravity=(0, 0, 0),
            limits=LimitOverrides(velocity={"joint1": np.inf}),
        ),
        tube=Tube(MINIMAL["tube"]["points"], 0.1, tool_radius=0.02, joint_signs={"joint2": "+"}),
        start=np.array(START),
        goal={"joint1": GOAL[0], "joint2": GOAL[1]},
        obstacles=[Obstacle.cylinder("post", 0.03, 0.3, placement_of((0.2, 0.2, 1)))],
        clearance=0.01,
        ignore_collisions=[("post", "link1")],
        name="turn",
    )
    same = np.testing.assert_array_equal
    for name in ("start", "goal", "joint_lower", "joint_upper"):
        same(getattr(built, name), getattr(parsed, name))
    for name in ("points", "radius", "tool_radius", "effective_radius"):
        same(getattr(built.tube, name), getattr(parsed.tube, name))
    assert built.tube.joint_ranges == parsed.tube.joint_ranges
    assert built.tube.visit == parsed.tube.visit
    for name in ("lower_position", "upper_position", "velocity", "effort", "acceleration"):
        same(getattr(built.robot.limits, name), getattr(parsed.robot.limits, name))
    assert built.robot.joint_names == parsed.robot.joint_names
    same(built.robot.gravity, parsed.robot.gravity)
    assert (built.name, built.clearance) == (parsed.name, parsed.clearance)
    same(built.collision.obstacle_pairs, parsed.collision.obstacle_pairs)
    same(built.collision.link_pairs, parsed.collision.link_pairs)
    for mine, other in zip(built.collision.shapes, parsed.collision.shapes, strict=True):
        assert (mine.owner, mine.body) == (other.owner, other.body)
        same(mine.shape.vertices, other.shape.vertices)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": [0.0]}, "start has 1 values for the 2 joints joint1, joint2"),
        ({"start": [0.0, np.nan]}, "start must be finite numbers"),
        ({"start": Seed(np.array([np.inf, 0]))}, "start.seed must be finite numbers"),
        ({"start": Seed(np.zeros(3))}, "start.seed has 3 values for the 2 joints joint1, joint2"),
        ({"goal": [3.0, 0.0]}, "goal: the tool is at [-0.594, 0.0847, 0.0] m"),
        ({"clearance": np.inf}, "clearance is inf m; 0 to 10000 m are accepted"),
        ({"clearance": np.nan}, "clearance is nan m; 0 to 10000 m are accepted"),
    ],
)
def test_a_problem_built_in_python_is_checked_at_once(two_link, options, message):
    tube = Tube(MINIMAL["tube"]["points"], 0.1)
    with pytest.raises(ProblemError) as caught:
        PlanningProblem(two_link, tube, **{"start": START, **options})
    assert str(caught.value).startswith(message)


def test_what_a_problem_holds_cannot_be_written_to(two_link):
    problem = PlanningProblem(two_link, Tube(MINIMAL["tube"]["points"], 0.1), START)
    for array in (problem.start, problem.joint_lower, problem.joint_upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def post(x):
    return Obstacle.cylinder("post", 0.03, 0.3, placement_of((x, 0.2, 1)))


def test_the_callers_list_of_obstacles_may_change_afterwards():
    obstacles = [post(0.2)]
    problem = dataclasses.replace(parse_problem(MINIMAL), obstacles=obstacles)
    obstacles[0] = post(0.1)
    obstacles.append(post(0.3))
    assert problem.obstacles[0].shapes[0].center[0] == pytest.approx(0.2)
    assert len(problem.obstacles) == 1
    assert problem.collision.shapes[-1].shape.center[0] == pytest.approx(0.2)


def test_collision_geometry_is_shared_until_what_it_is_made_of_is_replaced():
    problem = dataclasses.replace(parse_problem(MINIMAL), obstacles=[post(0.2)])
    assert problem.with_tube(problem.tube.with_radius(0.2)).collision is problem.collision
    assert problem.along(problem.tube, problem.start).collision is problem.collision
    moved = dataclasses.replace(problem, obstacles=[post(0.1)])
    assert moved.collision is not problem.collision
    assert moved.collision.shapes[-1].shape.center[0] == pytest.approx(0.1)


def sweep_a_radius(problem):
    return sweep(problem, [0.1])


def verify_nothing(problem):
    return verify(problem, None)


@pytest.fixture
def least(two_link):
    tube = Tube([[0.6, 0, 0], [0.4, 0.4, 0], [0, 0.6, 0]], 0.1)
    return lambda start=(0.0, 0.0), **more: PlanningProblem(two_link, tube, start, **more)


@pytest.mark.parametrize(
    "start",
    [
        np.zeros(2, dtype=complex),
        np.zeros(2, dtype=bool),
        [False, False],
        [0.0, False],
        np.ma.masked_array([0.0, 0.0], [True, False]),
        ["0", "0"],
        np.array(["0", "0"]),
        None,
        "ab",
        5,
        [0.0, None],
        [0.0, 10**400],
    ],
)
def test_joints_are_real_numbers(least, start):
    with pytest.raises(ProblemError, match=r"start .* must be numbers, one per joint"):
        least(start)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"obstacles": "ab"}, r"obstacles\[0\] is 'a'; give Obstacle.box"),
        ({"obstacles": 5}, r"obstacles\[0\] is 5; give Obstacle.box"),
        ({"obstacles": [None]}, r"obstacles\[0\] is None; give Obstacle.box"),
        ({"attached": ["a"]}, r"attached\[0\] is 'a'; give AttachedSolid"),
        ({"ignore_collisions": ["ab"]}, r"ignore_collisions\[0\] is 'ab'; give pairs of names"),
        ({"ignore_collisions": [(1, 2, 3)]}, r"ignore_collisions\[0\] is .*; give pairs of names"),
        ({"clearance": "a"}, "clearance is 'a' m; 0 to 10000 m are accepted"),
        ({"clearance": True}, "clearance is True m; 0 to 10000 m are accepted"),
        ({"clearance": None}, "clearance is None m; 0 to 10000 m are accepted"),
    ],
)
def test_what_a_problem_is_made_of_is_checked(least, fields, message):
    with pytest.raises(ProblemError, match=message):
        least(**fields)


@pytest.mark.parametrize("function", [plan, compare, sweep_a_radius, verify_nothing])
def test_what_takes_a_problem_says_so(function):
    with pytest.raises(ProblemError, match="the problem is None; give a PlanningProblem"):
        function(None)


def test_a_trajectory_is_asked_for(least):
    with pytest.raises(TrajectoryError, match="the trajectory is 'a'; give a JointTrajectory"):
        verify(least(), "a")
