"""Planning scenes and motion plan requests of MoveIt, as obstacles and as problem files."""

import json

import numpy as np
import pytest
from cases import refusal

from tubeplanner import load_problem, load_robot, parse_cycle, parse_problem
from tubeplanner.cli.main import main
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import ProblemError
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.robot.pinocchio_model import BasePose
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.moveit_files import solids_of_scene

ROBOT = {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]}
PROBLEM = {
    "robot": ROBOT,
    "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0]], "radius": 0.1},
    "start": {"seed": [0, 1]},
}
# Corners and triangles of a tetrahedron, as messages may have them.
CORNERS = [[0, 0, 0], {"x": 0.1}, {"y": 0.1, "x": 0, "z": 0}, [0, 0, 0.1]]
FACES = [[0, 2, 1], {"vertex_indices": [0, 1, 3]}, [1, 2, 3], [0, 3, 2]]
SCENE = {
    "name": "",
    "robot_model_name": "two_link",
    "robot_state": {
        "joint_state": {"name": ["joint1", "joint2"], "position": [0.0, 1.0]},
        "attached_collision_objects": [
            {
                "link_name": "link2",
                "touch_links": ["hand"],
                "object": {
                    "id": "part",
                    "primitives": [{"type": 2, "dimensions": [0.02]}],
                    "primitive_poses": [{"position": [0.35, 0, 0]}],
                },
            }
        ],
    },
    "fixed_frame_transforms": [
        {
            "header": {"frame_id": "shelf"},
            "child_frame_id": "world",
            "transform": {"translation": [0, 0, 1], "rotation": [0, 0, 0, 1]},
        }
    ],
    "allowed_collision_matrix": {
        "entry_names": ["link1", "link2", "post"],
        "entry_values": [[False, True, False], {"enabled": [True, False, True]}, [0, 1, 0]],
        "default_entry_names": ["wall", "camera"],
        "default_entry_values": [True, False],
    },
    "world": {
        "collision_objects": [
            {
                "header": {"frame_id": "world"},
                "id": "post",
                "pose": {"position": {"x": 1, "y": 0, "z": 0}, "orientation": {"z": 1, "w": 1}},
                "primitives": [{"type": "cylinder", "dimensions": [0.8, 0.05]}],
                "primitive_poses": [{"position": [0, 0.5, 0], "orientation": [0, 0, 0, 1]}],
            },
            {
                "header": {"frame_id": "shelf"},
                "id": "shelf_of_two",
                "primitives": [{"type": 1, "dimensions": [1, 2, 3]}],
                "primitive_poses": [{"position": [0, 0, 2]}],
                "meshes": [{"vertices": CORNERS, "triangles": FACES}],
                "mesh_poses": [{"position": [0, 3, 0]}],
            },
            {"id": "wall", "primitives": [{"type": "box", "dimensions": [1, 1, 1]}]},
            {"id": "link1", "primitives": [{"type": "sphere", "dimensions": [0.1]}]},
        ]
    },
    "link_padding": [{"link_name": "hand", "padding": 0.01}],
}
REQUEST = {
    "group_name": "arm",
    "start_state": {"joint_state": {"name": ["joint2", "joint1"], "position": [1.0, 0.5]}},
    "goal_constraints": [
        {
            "joint_constraints": [
                {"joint_name": "joint1", "position": 1.0, "tolerance_above": 0.01},
                {"joint_name": "joint2", "position": 0.5},
            ]
        }
    ],
    "max_velocity_scaling_factor": 0.5,
    "max_acceleration_scaling_factor": 0,
    "workspace_parameters": {"min_corner": [-1, -1, -1]},
}
TARGET = {
    "header": {"frame_id": ""},
    "link_name": "link2",
    "target_point_offset": [0.3, 0, 0],
    "constraint_region": {
        "primitives": [{"type": "sphere", "dimensions": [0.01]}],
        "primitive_poses": [{"position": [0.4, 0.4, 0]}],
    },
}
TURN = {"link_name": "link2", "orientation": {"z": 1, "w": 1}}


@pytest.fixture(scope="module")
def arm():
    return load_robot("example:two_link", "hand")


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a scene, in lines as Windows ends them, and a request."""
    (tmp_path / "scene.yaml").write_bytes(
        b"\xef\xbb\xbf"
        + json.dumps(SCENE, indent=1).replace("\n", "\r\n").encode()
        + b"\r\n---\r\n"
    )
    (tmp_path / "request.json").write_text(json.dumps({"motion_plan_request": REQUEST}))
    return tmp_path


def solids(folder, robot, content):
    (folder / "s.json").write_text(json.dumps(content))
    return solids_of_scene(folder / "s.json", robot)


def of_object(**fields):
    """Return a scene of one object, a box with other fields."""
    box = {"id": "a", "primitives": [{"type": "box", "dimensions": [1, 1, 1]}]} | fields
    return {"world": {"collision_objects": [box]}}


def test_a_scene_is_an_item_of_the_obstacles(folder):
    post = {"name": "ball", "sphere": 0.1, "position": [2, 2, 2]}
    fields = PROBLEM | {"obstacles": [post, {"moveit_scene": "scene.yaml"}]}
    problem = parse_problem(fields, folder)
    names = ["ball", "post", "shelf_of_two_1", "shelf_of_two_2", "wall", "link1_object"]
    assert [each.name for each in problem.obstacles] == names
    post, box, mesh, *_ = [each.shapes[0] for each in problem.obstacles[1:]]
    # The object is turned by 90 degrees, the cylinder in it half a metre along its y.
    np.testing.assert_allclose(post.center, [0.5, 0, 0], atol=1e-12)
    assert problem.obstacles[1].contents.sizes == (0.05, 0.8)
    np.testing.assert_allclose(box.center, [0, 0, 3])
    np.testing.assert_allclose(mesh.vertices.min(axis=0), [0, 3, 1], atol=1e-12)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.1, 3.1, 1.1])
    (part,) = problem.attached
    np.testing.assert_allclose(part.shapes[0].center, [0.05, 0, 0], atol=1e-12)
    assert part.touch_links == ("link2", "hand")
    wall = {frozenset(("wall", name)) for name in ("base", "link1", "link2", "hand", "part")}
    pairs = {frozenset(pair) for pair in problem.ignore_collisions}
    assert pairs == wall | {frozenset(("link1", "link2")), frozenset(("link2", "post"))}
    notes = "\n".join(problem.notes)
    assert "not read: link_padding" in notes
    assert "neither a link nor an object: camera" in notes
    assert "'link1' has a link's name; here it is 'link1_object'" in notes
    moved = json.loads(json.dumps(SCENE))
    moved["world"]["collision_objects"][0]["pose"]["position"]["x"] = 1.1
    (folder / "scene.yaml").write_text(json.dumps(moved))
    assert problem_hash(parse_problem(fields, folder)) != problem_hash(problem)


def test_a_scene_of_an_included_cell_is_beside_those_of_the_problem(folder):
    (folder / "cells").mkdir()
    (folder / "cells" / "cell.yaml").write_text("obstacles: [{moveit_scene: ../scene.yaml}]")
    own = [{"moveit_scene": "scene.yaml"}, {"moveit_scene": "other.yaml"}]
    layers = ProblemLayers.of({"include": "cells/cell.yaml", "obstacles": own}, folder, "it")
    assert layers.merged["obstacles"] == own


def test_a_cycle_takes_a_scene(folder):
    move = {"name": "go", "tube": PROBLEM["tube"]}
    cycle = {"format": "tubeplanner/cycle", "robot": ROBOT, "start": PROBLEM["start"]}
    cycle |= {"obstacles": [{"moveit_scene": "scene.yaml"}], "moves": [move]}
    result = parse_cycle(cycle, folder)
    assert len(result.obstacles) == 5
    assert [each.name for each in result.attached] == ["part"]
    assert any("link_padding" in note for note in result.notes)


def test_the_planning_frame_is_the_cell_or_lies_where_the_state_has_the_arm(folder, arm):
    floating = {
        "joint_names": ["virtual_joint"],
        "transforms": [{"translation": [0, 0, 2], "rotation": [0, 0, 0, 1]}],
    }
    scene = of_object() | {"robot_state": {"multi_dof_joint_state": floating}}
    (box,) = solids(folder, arm, scene).obstacles
    assert box.position == (0, 0, -2)
    based = load_robot("example:two_link", "hand", base=BasePose(position=(0, 0, 0.1)))
    assert solids(folder, based, scene).obstacles[0].position == (0, 0, 0)
    scene = of_object(header={"frame_id": "base"})
    assert solids(folder, based, scene).obstacles[0].position == (0, 0, 0.1)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"obstacles": []}, "this is no planning scene: it has no world"),
        (of_object(id=""), "id is required"),
        (of_object(primitives=[]), "has no primitives and no meshes"),
        (of_object(primitives=[{"type": 4, "dimensions": [1, 1]}]), "type 'cone' is not read"),
        (of_object(primitives=[{"type": 1, "dimensions": [1]}]), "a box has 3 dimensions, not 1"),
        (of_object(primitive_poses=[{}, {}]), "has 1 primitives and 2 primitive_poses"),
        (of_object(pose={"position": [0, 0]}), "position is [0, 0]; it must be 3 numbers"),
        (of_object(planes=[{"coef": [0, 0, 1, 0]}]), "planes are no solids"),
        (of_object(operation=1), "operation is to remove or move it"),
        (of_object(header={"frame_id": "link2"}), "is a link that joints move"),
        (of_object(header={"frame_id": "bose"}), "unknown frame 'bose' (did you mean 'base'?)"),
        ({"world": {"octomap": {"octomap": {"data": [1]}}}}, "is an octree, which is not read"),
        ({"world": {"collision_objects": 3}}, "collision_objects is 3; it must be a list"),
        (
            of_object() | {"allowed_collision_matrix": {"entry_names": ["a"]}},
            "entry_values must be 1 rows of 1 values",
        ),
        (
            {"world": {}, "robot_state": {"attached_collision_objects": [{"link_name": "link1"}]}},
            "id is required",
        ),
    ],
)
def test_what_a_scene_cannot_mean_is_refused_by_name(folder, arm, content, message):
    assert message in refusal(ProblemError, solids, folder, arm, content)


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (5, "obstacles[0] is 5; it must be a map with name, box"),
        ({"moveit_scene": 5}, "obstacles[0].moveit_scene is 5; it must be text"),
        ({"moveit_scene": "a", "name": "b"}, "unknown key 'name'; there is: moveit_scene"),
        ({"moveit_scene": "none.yaml"}, "obstacles: moveit_scene: "),
        ({"name": "a", "mesh": 7}, "mesh is 7; it must be a file, or a map with vertices"),
        ({"name": "a", "mesh": {"vertices": []}}, "obstacles[0].mesh.triangles is required"),
    ],
)
def test_an_item_that_is_neither_a_solid_nor_a_scene_is_refused_by_name(tmp_path, item, message):
    assert message in refusal(
        ProblemError, parse_problem, PROBLEM | {"obstacles": [item]}, tmp_path
    )


def test_an_object_on_a_link_before_the_tool_is_not_carried(folder, arm):
    own = of_object()["world"]["collision_objects"][0]
    state = {"attached_collision_objects": [{"link_name": "link1", "object": own}]}
    message = refusal(ProblemError, solids, folder, arm, {"world": {}, "robot_state": state})
    assert "joints move the link 'link1' against the tool frame 'hand'" in message


@pytest.fixture
def imported(folder, capsys):
    """Return a function from changes of the request to exit status, problem file and errors."""

    def call(*options, **changes):
        (folder / "request.json").write_text(json.dumps(REQUEST | changes))
        files = [str(folder / name) for name in ("request.json", "scene.yaml", "out.yaml")]
        words = ["import", *files[:2], "-o", files[2], *(options or ROBOT_OPTIONS)]
        status = main(words)
        captured = capsys.readouterr()
        return status, folder / "out.yaml", captured.out + captured.err

    return call


ROBOT_OPTIONS = ("--urdf", "example:two_link", "--tool-frame", "hand")


def test_import_writes_the_problem_of_a_request_in_a_scene(imported, folder):
    status, path, said = imported()
    assert status == 0
    fields = parse_yaml(path.read_text())
    assert fields["start"] == {"joints": {"joint1": 0.5, "joint2": 1.0}}
    assert fields["goal"] == {"joints": {"joint1": 1.0, "joint2": 0.5}}
    assert fields["robot"]["limits"] == {"scale": {"velocity": 0.5}}
    for field in ("workspace_parameters", "tolerance_above", "link_padding"):
        assert field in said
        assert field in path.read_text()
    problem = load_problem(path, reads_tube=None)
    direct = PROBLEM | {"obstacles": [{"moveit_scene": "scene.yaml"}]}
    expected = parse_problem(direct, folder)
    for name in ("obstacles", "attached"):
        pairs = zip(getattr(problem, name), getattr(expected, name), strict=True)
        for one, other in pairs:
            assert one.name == other.name
            np.testing.assert_allclose(one.shapes[0].vertices, other.shapes[0].vertices)
    own = [set(map(frozenset, each.ignore_collisions)) for each in (problem, expected)]
    assert own[0] == own[1]


def test_a_goal_of_position_and_orientation_is_a_pose_of_the_tool(imported):
    goal = [{"position_constraints": [TARGET], "orientation_constraints": [TURN]}]
    status, path, said = imported(goal_constraints=[*goal, {}])
    assert status == 0
    pose = parse_yaml(path.read_text())["goal"]["pose"]
    np.testing.assert_allclose(pose["position"], [0.4, 0.4, 0], atol=1e-12)
    np.testing.assert_allclose(pose["quaternion"], [0, 0, 0.5**0.5, 0.5**0.5], atol=1e-12)
    assert "2 goals; the first is used" in said


def test_a_position_alone_is_a_ball(imported):
    status, path, _ = imported(goal_constraints=[{"position_constraints": [TARGET]}])
    assert status == 0
    assert parse_yaml(path.read_text())["goal"] == {"position": [0.4, 0.4, 0], "tolerance": 0.01}
    other = TARGET | {"target_point_offset": [0.2, 0, 0]}
    status, _, said = imported(goal_constraints=[{"position_constraints": [other]}])
    assert status == 2
    assert "give robot.tool_offset: {position: [-0.1, 0.0, 0.0]}" in said


def test_import_fills_in_a_problem_file_and_keeps_its_limits(imported, folder):
    limits = {"acceleration": 5, "scale": {"velocity": 0.8}}
    own = PROBLEM | {"robot": {**ROBOT, "limits": limits}, "clearance": 0.01}
    (folder / "cell.yaml").write_text(json.dumps(own))
    status, path, _ = imported("--problem", str(folder / "cell.yaml"))
    assert status == 0
    fields = parse_yaml(path.read_text())
    assert (fields["clearance"], fields["robot"]["limits"]["acceleration"]) == (0.01, 5)
    assert fields["robot"]["limits"]["scale"] == {"velocity": 0.4}
    assert "tube" not in fields


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal_constraints": [{}]}, "has 0 position and 0 orientation constraints"),
        ({"max_velocity_scaling_factor": 2}, "is 2; it must be a number from 0 to 1"),
        (
            {"goal_constraints": [{"joint_constraints": [{"joint_name": "joint1"}]}]},
            "has no joint joint2; all joints of the planning group are needed",
        ),
        (
            {"start_state": {"joint_state": {"name": ["joint1"], "position": []}}},
            "has 1 names and 0 positions",
        ),
    ],
)
def test_a_request_that_is_no_problem_is_refused_by_name(imported, changes, message):
    status, path, said = imported(**changes)
    assert status == 2
    assert message in said
    assert not path.exists()
