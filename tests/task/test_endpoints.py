"""Start and goal: tool pose, goal region, group state or end of a trajectory; checks of them."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest
from cases import refusal

from tubeplanner import (
    GoalRegion,
    JointTrajectory,
    PlanningProblem,
    ProblemError,
    Seed,
    ToolPose,
    Tube,
    parse_problem,
    placement_of,
    read_trajectory,
)
from tubeplanner.orientation import matrix_of_rpy
from tubeplanner.output.files.fingerprint import problem_hash

LAST = [0.2, 0.3, 0.0]
POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], LAST]
FLAT = [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0.6, 0.8]]
MINIMAL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": POINTS, "radius": 0.05},
    "start": {"seed": [0, -1]},
}


@pytest.fixture
def problem(two_link):
    """Return a function that makes a problem from a goal and fields of the tube."""

    def make(goal, **tube):
        start = Seed(np.array([0.0, -1.0]))
        return PlanningProblem(two_link, Tube(POINTS, 0.05, **tube), start, goal)

    return make


def parsed(goal, **tube):
    return parse_problem({**MINIMAL, "tube": {**MINIMAL["tube"], **tube}, "goal": goal})


TOO_FAR = np.eye(4) + np.eye(4, k=3) * 2e4
NO_PLACEMENTS = [np.eye(3), np.diag([1, 1, -1, 1]), np.diag([1, 1, 1, 2]), TOO_FAR, "here"]


@pytest.mark.parametrize("placement", NO_PLACEMENTS)
def test_a_pose_is_a_placement(placement):
    assert "give a rotation and translation" in refusal(ProblemError, ToolPose, placement)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi])
def test_errors_are_the_distance_and_the_angle_of_the_turn_between(angle):
    placement = placement_of([1, 2, 3], rpy=[0.3, -0.5, 1.1])
    pose = ToolPose(placement)
    placement[0, 3] = 5
    assert pose.position.tolist() == [1, 2, 3]
    rotated = pose.rotation @ matrix_of_rpy(0, angle, 0)
    away, turn = pose.errors(rotated, pose.position + np.array([0.3, 0, 0.4]))
    assert away == pytest.approx(0.5)
    assert turn == pytest.approx(angle, abs=1e-15)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (([0, 0],), "goal.position is [0, 0]; give [x, y, z], finite numbers"),
        (([0, np.nan, 0],), "goal.position is [0, nan, 0]; give [x, y, z], finite numbers"),
        ((LAST, -0.01), "goal.tolerance is -0.01 m; 0 to 10000 m are accepted"),
        ((LAST, 0.01, 0.0), "goal.rotation_tolerance is 0.0 rad; it must be > 0"),
        ((LAST, 0.01, [1, 2]), "goal.rotation_tolerance is [1, 2]; it must be one angle or"),
    ],
)
def test_a_wrong_value_is_named(values, message):
    assert message in refusal(ProblemError, GoalRegion, *values)


def test_points_of_the_ball():
    goal = GoalRegion([1.0, 2.0, 3.0], 0.5)
    inside, outside = np.array([1.0, 2.3, 3.0]), np.array([1.0, 2.0, 5.0])
    assert goal.margin(inside) == pytest.approx(0.2)
    assert goal.margin(outside) == pytest.approx(-1.5)
    np.testing.assert_allclose(goal.nearest(inside), inside)
    np.testing.assert_allclose(goal.nearest(outside), [1, 2, 3.5])
    np.testing.assert_allclose(goal.nearest(inside, 0.5), [1, 2.25, 3])
    np.testing.assert_allclose(GoalRegion([1, 2, 3]).nearest(outside), [1, 2, 3])


def test_a_file_has_it_as_python_does():
    read = parsed({"position": LAST, "tolerance": 0.02})
    assert read.goal.position.tolist() == LAST
    assert (read.goal.tolerance, read.goal.rotation_tolerance) == (0.02, None)
    exact = parsed({"position": LAST})
    assert (exact.goal.tolerance, exact.given_goal) == (0.0, None)
    tube = {"orientations": FLAT, "rotation_tolerance": 0.3}
    bounded = parsed({"position": LAST, "rotation_tolerance": [0.1, 0.2, np.inf]}, **tube)
    assert bounded.goal.rotation_tolerance == (0.1, 0.2, np.inf)


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({"position": LAST, "seed": [0, 0]}, "goal.seed beside goal.position is for"),
        ({"position": LAST, "joints": [0, 0]}, "goal.position is not to be given: it is the one"),
        ({"seed": [0, 0], "tolerance": 0.1}, "goal.tolerance is for goal.position, which is not"),
        ({"joints": [0, 0], "rotation_tolerance": 1}, "goal.rotation_tolerance is for goal.pos"),
        ({"position": LAST, "rotation_tolerance": 0.1}, "but tube.orientations is not given"),
    ],
)
def test_a_goal_that_no_file_may_have_is_named(goal, message):
    assert message in refusal(ProblemError, parsed, goal)


def test_the_position_is_in_the_last_region_and_the_ball_need_not_be(problem):
    inside = problem(GoalRegion([0.2, 0.345, 0], 1.0))
    assert inside.open_goal is inside.goal
    message = refusal(ProblemError, problem, GoalRegion([0.45, -0.2, 0], 1.0))
    assert re.search(r"0\.2\d+ m outside the capsule of segment 1 \(its end point is", message)
    with pytest.raises(ProblemError, match="outside the capsule"):
        inside.with_tube(inside.tube.with_radius(0.02))


def test_an_open_goal_is_at_the_last_point(problem):
    left_out = problem(None)
    assert left_out.open_goal.position.tolist() == LAST
    assert left_out.open_goal.tolerance == 0
    seeded = problem(Seed(np.array([1.0, -1.0])))
    assert seeded.open_goal is None
    assert seeded.given_goal is seeded.goal


def test_its_rotation_is_a_row_after_those_of_the_segments(problem):
    tube = {"orientations": FLAT, "rotation_tolerance": np.inf}
    assert problem(GoalRegion(LAST, 0.01), **tube).rotation is None
    bounded = problem(GoalRegion(LAST, 0.01, (0.1, np.inf, 0.2)), **tube)
    np.testing.assert_array_equal(bounded.rotation.bounds[:2], np.inf)
    assert bounded.rotation.bounds[2].tolist() == [0.1, np.inf, 0.2, np.inf]
    expected = matrix_of_rpy(0, 0, 2 * np.arctan2(0.6, 0.8))
    anywhere = np.array([[5.0, 3.0, 1.0], [0.0, 0.0, 0.0]])
    for reference in bounded.rotation.reference(anywhere, 2):
        np.testing.assert_allclose(reference, expected, atol=1e-12)


def test_hashes_know_all_of_it(problem):
    goals = [None, GoalRegion(LAST), GoalRegion(LAST, 0.01), GoalRegion([0.21, 0.3, 0], 0.01)]
    goals += [GoalRegion(LAST, 0.01, 0.1), GoalRegion(LAST, 0.01, (0.1, 0.1, 0.1))]
    base = problem(None, orientations=FLAT, rotation_tolerance=0.5)
    hashes = [problem_hash(replace(base, goal=goal)) for goal in goals]
    assert len(set(hashes)) == len(goals)
    assert problem_hash(replace(base, goal=GoalRegion(LAST, 0.01))) == hashes[2]


Q = [0.3, 0.7]
WIDE = MINIMAL | {"tube": {"points": [[0.5, 0.2, 0], [0.3, 0.4, 0]], "radius": 0.3}}
SRDF = """<robot name="two_link">
<group_state name="ready" group="hand"><joint name="finger" value="1"/></group_state>
<group_state name="ready" group="arm"><joint name="joint2" value="0.7"/>
 <joint name="joint1" value="0.3"/><joint name="finger" value="0"/></group_state>
<group_state name="half" group="arm"><joint name="joint2" value="0.7"/></group_state>
<group_state name="words" group="arm"><joint name="joint2" value="0 0"/>
 <joint name="joint1" value="0.3"/></group_state>
</robot>"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.srdf").write_text(SRDF)
    return tmp_path


def spec(folder, srdf="arm.srdf", **fields):
    data = copy.deepcopy(WIDE) | {"start": {"joints": Q}} | fields
    if any("group_state" in end for end in fields.values()):
        data["robot"]["srdf"] = srdf
    return parse_problem(data, folder)


def fault(folder, **fields):
    return refusal(ProblemError, spec, folder, **fields)


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_group_state_is_the_one_with_all_joints(folder, end):
    problem = spec(folder, **{end: {"group_state": "ready"}})
    assert getattr(problem, end).tolist() == Q
    message = fault(folder, srdf=None, start={"group_state": "ready"})
    assert "start.group_state 'ready' " in message and " give robot.srdf" in message


@pytest.mark.parametrize(
    ("state", "fragment"),
    [
        ("redy", "unknown group_state 'redy' (did you mean 'ready'?); there is: half, ready, wor"),
        ("half", "group_state 'half' of group 'arm' has no value for joint joint1; its joints are"),
        ("words", "has '0 0' for joint 'joint2'; it must be a number"),
    ],
)
def test_a_group_state_that_gives_no_configuration_is_named(folder, state, fragment):
    message = fault(folder, start={"group_state": state})
    assert "start.group_state: " in message
    assert fragment in message


def stored(names, q):
    """Return a trajectory of cubics whose last bits depend on how it is evaluated."""
    rng = np.random.default_rng(3)
    coefficients = rng.uniform(-0.1, 0.1, (4, 1, len(names)))
    curve = JointTrajectory(names, [0, 0.7], coefficients)
    coefficients[-1] += np.array(q) - curve.position(curve.duration)
    return JointTrajectory(names, [0, 0.7], coefficients)


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("name", ["last.json", "last.csv", "last.yaml"])
def test_a_trajectory_gives_the_very_bits_where_it_ends(folder, end, name):
    (folder / "runs").mkdir()
    stored(["joint2", "finger", "joint1"], [0.7, 9, 0.3]).save(folder / "runs" / name)
    last = read_trajectory(folder / "runs" / name)
    q = last.position(last.duration)
    problem = spec(folder, **{end: {"trajectory": f"runs/{name}"}})
    assert getattr(problem, end).tolist() == [q[2], q[0]]


def test_a_trajectory_that_gives_no_configuration_is_named(folder):
    stored(["joint1", "finger"], Q).save(folder / "half.json")
    message = fault(folder, start={"trajectory": "half.json"})
    assert "start.trajectory: " in message
    assert "half.json has no joint joint2; its joints are joint1, finger" in message
    assert "start.trajectory: trajectory file" in fault(folder, start={"trajectory": "no.json"})


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize(
    "turn", [{"rpy": [0, 0, 1.0]}, {"quaternion": [0, 0, np.sin(0.5), np.cos(0.5)]}]
)
def test_a_pose_is_kept_with_its_seed(folder, end, turn):
    position = [0.5, 0.2, 0]
    fields = {"pose": {"position": position, **turn}, "seed": {"joint2": 0.5, "joint1": 0.1}}
    pose = getattr(spec(folder, **{end: fields}), end)
    assert isinstance(pose, ToolPose)
    assert pose.position.tolist() == position
    np.testing.assert_allclose(pose.rotation[:2, 0], [np.cos(1), np.sin(1)])
    assert pose.seed.tolist() == [0.1, 0.5]


TURN = {"rpy": [0, 0, 0]}
AXES = {"quaternion": [0, 0, 0, 1]}


def at(*position, **turn):
    return {"position": list(position), **turn}


@pytest.mark.parametrize(
    ("start", "fragment"),
    [
        ({"pose": at(0.5, 0, 0)}, "pose takes either quaternion or rpy; it has neither"),
        ({"pose": at(0, 0, 0, **TURN, **AXES)}, "pose takes either quaternion or rpy; it has both"),
        ({"pose": at(0, 0, 0, quaternion=[0, 0, 0, 0])}, "start.pose: quaternion"),
        ({"pose": at(0.9, 0, 0, **TURN)}, "m outside the capsule of segment"),
        ({"pose": at(0.5, 0.2, 0, **TURN), "seed": [0, 99]}, "start.seed: jo"),
        ({"pose": at(0, 0, 0, **TURN), "joints": Q}, "it has pose, joints"),
        ({"joints": Q, "trajectory": "a.json"}, "it has trajectory, joints (what an included file"),
    ],
)
def test_an_end_that_is_none_is_named(folder, start, fragment):
    assert fragment in fault(folder, start=start)


def test_where_nothing_bounds_the_tool_an_end_says_where_it_is(folder):
    """Read without a tube, as by `route`."""
    stored(["joint1", "joint2"], Q).save(folder / "last.json")
    data = copy.deepcopy(WIDE) | {
        "start": {"trajectory": "last.json"},
        "goal": {"pose": {"position": [0.3, 0.4, 0], "rpy": [0, 0, 1]}},
    }
    problem = parse_problem(data, folder, reads_tube=False)
    begin = problem.robot.tool_position(np.array([problem.start]))[0]
    np.testing.assert_allclose(problem.tube.points, [begin, [0.3, 0.4, 0]])
