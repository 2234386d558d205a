"""load_problem, parse_problem: fields to robot, solids, tube, endpoints, problem."""

import copy
import json

import numpy as np
import pytest
import trimesh

from refusals import refusal
from tubeplanner import JointTrajectory, ProblemError, ToolPose, parse_problem, read_trajectory
from tubeplanner.problem.problem_format import AttachedFields, ObstacleFields
from tubeplanner.problem.solid_fields import attached_of, obstacle_of

Q = [0.3, 0.7]
DATA = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": [[0.5, 0.2, 0], [0.3, 0.4, 0]], "radius": 0.3},
}
SRDF = """<robot name="two_link">
<group_state name="ready" group="hand"><joint name="finger" value="1"/></group_state>
<group_state name="ready" group="arm"><joint name="joint2" value="0.7"/>
 <joint name="joint1" value="0.3"/><joint name="finger" value="0"/></group_state>
<group_state name="half" group="arm"><joint name="joint2" value="0.7"/></group_state>
<group_state name="words" group="arm"><joint name="joint2" value="0 0"/>
 <joint name="joint1" value="0.3"/></group_state>
</robot>"""


# --- solids of a file ----------------------------------------------------------------------------


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


# --- start and goal by a pose, by a name in an SRDF, and by where a trajectory ends --------------


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.srdf").write_text(SRDF)
    return tmp_path


def posed(folder, srdf="arm.srdf", **fields):
    data = copy.deepcopy(DATA) | {"start": {"joints": Q}} | fields
    if any("group_state" in end for end in fields.values()):
        data["robot"]["srdf"] = srdf
    return parse_problem(data, folder)


def fault(folder, **fields):
    return refusal(ProblemError, posed, folder, **fields)


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_group_state_is_the_one_with_all_joints(folder, end):
    problem = posed(folder, **{end: {"group_state": "ready"}})
    assert getattr(problem, end).tolist() == Q


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


def test_a_group_state_needs_an_srdf(folder):
    message = fault(folder, srdf=None, start={"group_state": "ready"})
    assert "start.group_state 'ready' " in message and " give robot.srdf" in message


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
    problem = posed(folder, **{end: {"trajectory": f"runs/{name}"}})
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
    given = {"pose": {"position": position, **turn}, "seed": {"joint2": 0.5, "joint1": 0.1}}
    pose = getattr(posed(folder, **{end: given}), end)
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
        ({"group_state": "ready", "trajectory": "a.json"}, "it has group_state, trajectory"),
        ({"group_state": "ready", "seed": Q}, "it has group_state, seed"),
        ({"joints": Q, "trajectory": "a.json"}, "it has trajectory, joints (what an included file"),
    ],
)
def test_an_end_that_is_none_is_named(folder, start, fragment):
    assert fragment in fault(folder, start=start)


def test_a_pose_is_turned_within_the_rotation_tolerance(folder):
    data = copy.deepcopy(DATA)
    data["tube"] |= {"orientations": [[0, 0, 0, 1]] * 2, "rotation_tolerance": 0.1}
    data["start"] = {"pose": {"position": [0.5, 0.2, 0], "rpy": [0, 0, 0.2]}}
    with pytest.raises(ProblemError, match=r"the tool is turned by 0\.2 rad"):
        parse_problem(data, folder)


def test_where_nothing_bounds_the_tool_an_end_says_where_it_is(folder):
    """As `route` reads it."""
    stored(["joint1", "joint2"], Q).save(folder / "last.json")
    data = copy.deepcopy(DATA) | {
        "start": {"trajectory": "last.json"},
        "goal": {"pose": {"position": [0.3, 0.4, 0], "rpy": [0, 0, 1]}},
    }
    problem = parse_problem(json.loads(json.dumps(data)), folder, reads_tube=False)
    begin = problem.robot.tool_position(np.array([problem.start]))[0]
    np.testing.assert_allclose(problem.tube.points, [begin, [0.3, 0.4, 0]])
