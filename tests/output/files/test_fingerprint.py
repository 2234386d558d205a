"""Hashes of robots, problems and cycles: of what they hold, not how it is written or covered."""

import copy
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from small_cycle import small_cycle

from tubeplanner import AttachedSolid, Obstacle, Seed, ToolPose, Tube, parse_problem, placement_of
from tubeplanner.geometry import collision_checker
from tubeplanner.geometry import meshes as mesh_cover
from tubeplanner.geometry import meshes as mesh_file
from tubeplanner.geometry.convex_shapes import box
from tubeplanner.output.files.fingerprint import (
    cycle_hash,
    differing_parts,
    part_hashes,
    problem_hash,
    robot_hash,
)
from tubeplanner.task.problem import PlanningProblem

MASS = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
URDF = f"""<robot name="arm"><link name="base"/>
<link name="upper"><inertial>{MASS}</inertial>
  <collision><origin xyz="0.2 0 0"/><geometry>
    <mesh filename="upper.stl" scale="1 1 1"/></geometry></collision></link>
<link name="tip"><inertial>{MASS}</inertial>
  <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="tip"/><axis xyz="0 0 1"/>
  <origin xyz="0.4 0 0"/><limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
</robot>"""

FIXTURE = {"name": "fixture", "mesh": "fixture.stl", "position": [1, 1, 0]}
FIELDS = {
    "robot": {
        "urdf": "arm.urdf",
        "tool_frame": "tip",
        "tool_offset": {"position": [0.3, 0, 0]},
        "attached": [{"name": "rod", "box": [0.1, 0.02, 0.02], "touch_links": ["tip", "upper"]}],
    },
    "tube": {
        "points": [[0.6, 0.1, 0], [0.5, 0.4, 0]],
        "radius": 0.1,
        "joint_signs": {"j2": "+"},
    },
    "start": {"seed": [0.1, 0.5]},
    "obstacles": [
        {**FIXTURE, "rpy": [0, 0, np.pi / 2]},
        {"name": "ball", "sphere": 0.1, "position": [-1, 0, 0]},
        {"name": "post", "cylinder": [0.05, 1.0], "position": [0, -1, 0]},
    ],
    "clearance": 0.01,
    "collision": {"ignore": [["upper", "post"], ["tip", "ball"]]},
}

# Other ways to write the same.
SAME = [
    {"tube__radius": [0.1]},
    {"tube__joint_signs": [{"j2": [0, np.inf]}]},
    {"tube__joint_signs": {"j2": 1, "j1": "0"}},
    {"tube__cross_section": [None]},
    {"start__seed": {"j2": 0.5, "j1": 0.1}},
    {"format": "tubeplanner/problem"},
    {"obstacles": FIELDS["obstacles"][::-1]},
    {"obstacles__0": FIXTURE | {"quaternion": [0, 0, 2, 2]}},
    {"obstacles__1__rpy": [1, 2, 3]},  # of a ball
    {"collision__ignore": [["ball", "tip"], ["post", "upper"]]},
    {
        "robot__attached": [{"name": "rod", "box": [0.1, 0.02, 0.02], "touch_links": ["upper"]}],
        "collision__ignore": [["upper", "post"], ["tip", "ball"], ["rod", "tip"]],
    },
    {"robot__limits": {"tool_speed": None}, "tube__tool_speed": [None]},
    {"robot__limits": {"tool_speed": np.inf}},
    {"robot__limits": {"effort_rate": np.inf}},
    {"robot__limits": {"effort_rate": {}, "velocity_by_position": {}, "point_speed": []}},
    {"robot__limits": {"effort_rate": {"j1": np.inf}, "jerk": [np.inf] * 2, "acceleration": {}}},
    {"robot__limits": {"effort": {"j1": 50}}},
    {"robot__limits": {"effort": {"j1": [50, 50]}}},
    {
        "robot__motors": {
            "armature": 0,
            "viscous_friction": {},
            "coulomb_friction": {"j1": [0, 0]},
            "saturation_effort": np.inf,
            "no_load_velocity": np.inf,
            "friction_from_urdf": True,
            "friction_uncertainty": 0.5,
        }
    },
]
# Of the robot model.
OTHER_ROBOTS = [
    {"robot__tool_offset": {"position": [0.3, 0, 0], "rpy": [0, 0, 0.1]}},
    {"robot__tool_offset": {"position": [0.3, 0, 0.01]}},
    {"robot__gravity": [0, -1, 0]},
    {"robot__payload": {"mass": 1.0}},
    {"robot__limits": {"effort": {"j1": 51}}},
    {"robot__limits": {"effort": {"j1": [40, 50]}}},
    {"robot__limits": {"effort": {"j1": [30, 50]}}},
    {"robot__limits": {"effort": {"j1": [50, 40]}}},
    {"robot__limits": {"effort": {"j1": [50, 30]}}},
    {"robot__limits": {"effort": {"j2": [50, 40]}}},
    {"robot__limits": {"effort": {"j1": {"position": [-1, 1], "effort": [50, 40]}}}},
    {"robot__limits": {"effort": {"j1": {"position": [0, 1], "effort": [50, 40]}}}},
    {"robot__limits": {"tool_speed": 0.5}},
    {"robot__limits": {"tool_speed": 0.6}},
    {"robot__limits": {"tool_acceleration": 0.5}},
    {"robot__limits": {"effort_rate": {"j2": 100}}},
    {"robot__limits": {"effort_rate": {"j1": 100}}},
    {"robot__limits": {"velocity_by_position": {"j1": {"deceleration": 5, "offset": 0.1}}}},
    {"robot__limits": {"velocity_by_position": {"j1": {"deceleration": 6, "offset": 0.1}}}},
    {"robot__limits": {"point_speed": [{"link": "tip", "position": [0, 0, 0], "speed": 1}]}},
    {"robot__limits": {"point_speed": [{"link": "tip", "position": [0, 0, 1], "speed": 1}]}},
    {"robot__limits": {"point_speed": [{"link": "upper", "position": [0, 0, 0], "speed": 1}]}},
    {"robot__motors": {"armature": {"j1": 0.1}}},
    {"robot__motors": {"viscous_friction": {"j1": 0.1}}},
    {"robot__motors": {"coulomb_friction": {"j1": [1, 0]}}},
    {"robot__motors": {"coulomb_friction": {"j1": [2, 0]}}},
    {"robot__motors": {"coulomb_friction": {"j1": [0, 1]}}},
    {"robot__motors": {"coulomb_friction": {"j1": [0, 2]}}},
    {"robot__motors": {"coulomb_friction": {"j1": [0, 1]}, "friction_uncertainty": 0.5}},
    {"robot__motors": {"saturation_effort": 50, "no_load_velocity": 2}},
    {"robot__motors": {"saturation_effort": 60, "no_load_velocity": 2}},
    {"robot__motors": {"saturation_effort": 50, "no_load_velocity": 3}},
]
TURNED = {"orientations": [[0, 0, 0, 1]] * 2, "rotation_tolerance": 3.0}


def tube(**fields):
    return {"tube": {**FIELDS["tube"], **fields}}


def boxed(*sides, up=(0, 0, 1)):
    return tube(radius=None, cross_section={"box": list(sides), "up": list(up)})


# Of the rest of the problem.
OTHER = [
    tube(radius=0.11),
    tube(joint_signs={}),
    tube(visit="any"),
    tube(tool_radius=0.01),
    tube(tool_speed=0.5),
    tube(tool_speed=[0.6]),
    tube(tool_acceleration=0.5),
    tube(**TURNED),
    tube(**TURNED | {"rotation_tolerance": 3.1}),
    tube(**TURNED | {"orientations": [[0.1, 0, 0, 0.995]] * 2}),
    boxed(0.2, 0.2),
    boxed(0.2, 0.3),
    boxed(0.3, 0.2),
    boxed(0.2, 0.2, up=(1, 1, 1)),
    {"start__seed": [0.1, 0.501]},
    {"clearance": 0.02},
    {"robot__attached__0__box": [0.1, 0.02, 0.03]},
    {"robot__attached__0__position": [0, 0, 0.01]},
    {"obstacles__2__cylinder": [0.05, 1.1]},
    {"obstacles__2": {"name": "post", "capsule": [0.05, 1.0], "position": [0, -1, 0]}},
    {"obstacles__2__name": "pole", "collision__ignore": []},
    {"obstacles": FIELDS["obstacles"][:2], "collision__ignore": [["tip", "ball"]]},
    {"obstacles__0__scale": 1.01},
    {"obstacles__0__rpy": [0, 0, 1.5]},
    {"collision__ignore": [["upper", "post"]]},
    {"collision__self": False},
]


@pytest.fixture(scope="module")
def rough_covers(tmp_path_factory):
    """A folder for rough covers: others look for exact ones."""
    return tmp_path_factory.mktemp("covers")


@pytest.fixture
def cell(tmp_path, monkeypatch, rough_covers):
    """A folder with an arm, its mesh and an obstacle's, both concave.

    Covers are hulls, and links are looked at in one configuration: quick, and no matter.
    """
    (tmp_path / "arm.urdf").write_text(URDF)
    angles = np.linspace(0, np.pi / 2, 9)
    balls = [
        trimesh.creation.icosphere(1, 0.03).apply_translation([np.cos(a) / 2, np.sin(a) / 2, 0])
        for a in angles
    ]
    bow = trimesh.util.concatenate(balls)
    bow.export(tmp_path / "upper.stl")
    bow.export(tmp_path / "fixture.stl")
    monkeypatch.setattr(mesh_file, "cover_mesh", lambda m: [mesh_cover.convex_hull(m.vertices)])
    monkeypatch.setattr(mesh_file, "OUTER_ERROR", 1.0)  # [m]: no cover is refined
    monkeypatch.setattr(collision_checker, "TOUCH_SAMPLES", 1)
    monkeypatch.setenv("TUBEPLANNER_CACHE", str(rough_covers))
    return tmp_path


def changed(**changes):
    """Return the fields with other values, by path with `__` for dots."""
    fields = copy.deepcopy(FIELDS)
    for path, value in changes.items():
        *keys, last = (int(key) if key.isdigit() else key for key in path.split("__"))
        holder = fields
        for key in keys:
            holder = holder[key]
        holder[last] = value
    return fields


def hash_of(fields, cell):
    return problem_hash(parse_problem(fields, cell))


@pytest.mark.parametrize("changes", SAME)
def test_one_problem_written_in_two_ways_has_one_hash(changes, cell):
    assert hash_of(changed(**changes), cell) == hash_of(FIELDS, cell)


def test_all_problems_have_their_own_hash_and_all_robots(cell):
    problems, robots = {}, {}
    for changes in ({}, *OTHER_ROBOTS, *OTHER):
        problem = parse_problem(changed(**changes), cell)
        twin = problems.setdefault(problem_hash(problem), changes)
        assert twin is changes, (twin, changes)
        robots.setdefault(robot_hash(problem.robot), []).append(changes)
    assert list(robots.values()) == [[{}, *OTHER], *([changes] for changes in OTHER_ROBOTS)]


def test_the_length_of_the_axis_that_turns_a_box_does_not_count(cell):
    one, other = boxed(0.2, 0.3), boxed(0.2, 0.3, up=(0, 0, 2))
    assert hash_of(changed(**one), cell) == hash_of(changed(**other), cell)


def test_a_problem_built_in_python_has_the_hash_of_its_file(cell):
    read = parse_problem(FIELDS, cell)
    rod = Obstacle.box("rod", [0.1, 0.02, 0.02], placement_of())
    post = Obstacle.cylinder("post", 0.05, 1.0, placement_of([0, -1, 0]))
    ball = Obstacle.sphere("ball", 0.1, placement_of([-1, 0, 0]))
    turned = placement_of([1, 1, 0], rpy=[0, 0, np.pi / 2])
    built = PlanningProblem(
        read.robot,
        read.tube,
        read.start,
        obstacles=[post, ball, Obstacle.mesh("fixture", cell / "fixture.stl", turned)],
        attached=[AttachedSolid("rod", rod.shapes, ("tip", "upper"), rod.contents)],
        clearance=0.01,
        ignore_collisions=[("post", "upper"), ("tip", "ball")],
        name="another name",
    )
    assert problem_hash(built) == problem_hash(read)


def test_files_elsewhere_and_under_other_names_are_the_same_problem(cell, tmp_path_factory):
    other = tmp_path_factory.mktemp("elsewhere")
    text = (cell / "arm.urdf").read_text()
    (other / "robot.urdf").write_text(
        text.replace('filename="upper.stl" scale="1 1 1"', 'filename="one.STL"')
    )
    shutil.copy(cell / "upper.stl", other / "one.STL")
    shutil.copy(cell / "fixture.stl", other / "two.stl")
    fields = changed(robot__urdf="robot.urdf", obstacles__0__mesh="two.stl")
    assert hash_of(fields, other) == hash_of(FIELDS, cell)


@pytest.mark.parametrize("name", ["upper.stl", "fixture.stl"])
def test_other_bytes_of_a_mesh_are_another_problem(name, cell):
    """Within its hull: only the bytes tell."""
    before = parse_problem(FIELDS, cell)
    before_hash = problem_hash(before)
    mesh = trimesh.load(str(cell / name), force="mesh")
    mesh.update_faces(np.arange(len(mesh.faces)) != 7)
    mesh.export(cell / name)
    after = parse_problem(FIELDS, cell)
    assert problem_hash(after) != before_hash
    assert robot_hash(after.robot) == robot_hash(before.robot)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<origin xyz="0.2 0 0"/><geometry>', '<origin xyz="0.2 0 0.01"/><geometry>'),
        ('<sphere radius="0.05"/>', '<sphere radius="0.06"/>'),
    ],
)
def test_other_collision_elements_are_another_problem(old, new, cell):
    before = hash_of(FIELDS, cell)
    assert old in URDF
    (cell / "arm.urdf").write_text(URDF.replace(old, new))
    assert hash_of(FIELDS, cell) != before


def test_covers_and_pairs_do_not_matter(cell, monkeypatch):
    rough = parse_problem(FIELDS, cell)
    monkeypatch.undo()
    monkeypatch.setenv("TUBEPLANNER_CACHE", "off")
    fine = parse_problem(FIELDS, cell)
    assert len(fine.collision.shapes) > len(rough.collision.shapes)
    assert problem_hash(fine) == problem_hash(rough)


def test_a_pickled_problem_keeps_its_hash_without_the_files(cell):
    problem = parse_problem(FIELDS, cell)
    before, packed = problem_hash(problem), pickle.dumps(problem)
    for path in cell.iterdir():
        path.unlink()
    assert problem_hash(pickle.loads(packed)) == before


def test_solids_given_as_shapes_are_known_by_them(cell):
    problem = parse_problem(FIELDS, cell)

    def with_block(*sizes):
        shapes = tuple(box([size] * 3) for size in sizes)
        block = Obstacle("block", tuple(s.transformed(placement_of([0, 0, 3])) for s in shapes))
        return problem_hash(
            PlanningProblem(problem.robot, problem.tube, problem.start, obstacles=[block])
        )

    assert with_block(0.1, 0.2) == with_block(0.2, 0.1)
    assert with_block(0.1, 0.2) != with_block(0.1, 0.3)


def test_a_pose_counts_with_its_seed(cell):
    """And is another end than the configuration that it leads to."""
    problem = parse_problem(FIELDS, cell)
    q = np.array([0.1, 0.2])
    rotation, position = problem.robot.tool_pose(q[None])
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation[0], position[0]
    turned = placement @ placement_of(rpy=[0, 0, 0.1])
    tube = Tube([position[0], position[0] + np.array([0, 0.1, 0])], 0.1)
    ends = [ToolPose(placement), ToolPose(placement, q), ToolPose(turned), q, Seed(q)]
    hashes = {problem_hash(replace(problem, tube=tube, start=end)) for end in ends}
    assert len(hashes) == len(ends)


@pytest.fixture(scope="module")
def cycle():
    return small_cycle()


@pytest.mark.parametrize(
    ("changes", "differing"),
    [
        ({"moves__back__tube__radius": 0.2}, ["tube of move 'back'"]),
        ({"moves__beside__tube__radius": 0.06}, ["tube of move 'down, beside'"]),
        ({"moves__2__payload__mass": 0.6}, ["payload of move 'down, beside'"]),
        ({"robot__limits__acceleration": 500.0}, ["limits or motors"]),
        ({"moves__1__dwell": 0.04}, ["order of steps or dwells"]),
        ({"moves__5__event": "hand"}, ["order of steps or dwells"]),
        ({"moves__6__leave_as_obstacle": True}, None),
        ({"closed": False}, ["order of steps or dwells"]),
        ({"obstacles__part__box": [0.02, 0.02, 0.03]}, None),
        ({"start__seed": [0.0, -0.9]}, ["start or goal of move 'over'"]),
    ],
)
def test_what_changes_the_answer_changes_the_hash_and_is_named(changes, differing, cycle):
    changed = small_cycle(**changes)
    assert cycle_hash(changed) != cycle_hash(cycle)
    result = differing_parts(changed, part_hashes(cycle))
    assert result
    assert differing is None or result == differing


def test_the_same_cycle_has_the_same_hash(cycle):
    again = small_cycle(moves__1__set="shut")  # what an event sets is no part of the question
    assert cycle_hash(again) == cycle_hash(cycle)
    assert differing_parts(again, part_hashes(cycle)) == []
    assert differing_parts(again, {}) == []
