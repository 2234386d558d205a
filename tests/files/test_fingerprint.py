"""Hashes of robots, problems and cycles, whole and by part; origin of a trajectory."""

import copy
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from small_cycle import small_cycle

from tubeplanner import AttachedSolid, Obstacle, Seed, ToolPose, Tube, parse_problem, placement_of
from tubeplanner.collision import link_pairs, mesh_cover, mesh_file
from tubeplanner.collision.convex_shape import box
from tubeplanner.files.cycle_fingerprint import cycle_hash, cycle_part_hashes, differing_cycle_parts
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.problem.problem import PlanningProblem

# A problem's hash comes from its contents: not from how they are written, covered or paired.


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
        {"name": "fixture", "mesh": "fixture.stl", "position": [1, 1, 0], "rpy": [0, 0, np.pi / 2]},
        {"name": "ball", "sphere": 0.1, "position": [-1, 0, 0]},
        {"name": "post", "cylinder": [0.05, 1.0], "position": [0, -1, 0]},
    ],
    "clearance": 0.01,
    "collision": {"ignore": [["upper", "post"], ["tip", "ball"]]},
}


@pytest.fixture
def cell(tmp_path):
    """A folder with an arm, its mesh and an obstacle's, both concave."""
    (tmp_path / "arm.urdf").write_text(URDF)
    angles = np.linspace(0, np.pi / 2, 9)
    balls = [
        trimesh.creation.icosphere(1, 0.03).apply_translation([np.cos(a) / 2, np.sin(a) / 2, 0])
        for a in angles
    ]
    bow = trimesh.util.concatenate(balls)
    bow.export(tmp_path / "upper.stl")
    bow.export(tmp_path / "fixture.stl")
    return tmp_path


@pytest.fixture
def covered_roughly(monkeypatch):
    """Covers are hulls, and links are looked at in one configuration: quick, and no matter."""

    def hull_alone(mesh):
        return [mesh_cover.convex_hull(mesh.vertices)]

    monkeypatch.setattr(mesh_file, "cover_mesh", hull_alone)
    monkeypatch.setattr(mesh_file, "OUTER_ERROR", 1.0)  # [m]: no cover is refined
    monkeypatch.setattr(link_pairs, "_TOUCH_SAMPLES", 1)


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


SAME = {
    "a radius per segment": {"tube__radius": [0.1]},
    "a range instead of a sign": {"tube__joint_signs": [{"j2": [0, np.inf]}]},
    "a sign that is free": {"tube__joint_signs": {"j2": 1, "j1": "0"}},
    "joints by name": {"start__seed": {"j2": 0.5, "j1": 0.1}},
    "the name of the problem's format": {"format": "tubeplanner/problem"},
    "another order of obstacles": {"obstacles": FIELDS["obstacles"][::-1]},
    "a quaternion": {
        "obstacles__0": {
            "name": "fixture",
            "mesh": "fixture.stl",
            "position": [1, 1, 0],
            "quaternion": [0, 0, 2, 2],
        }
    },
    "a ball that is turned": {
        "obstacles__1": {"name": "ball", "sphere": 0.1, "position": [-1, 0, 0], "rpy": [1, 2, 3]}
    },
    "ignored pairs turned round": {"collision__ignore": [["ball", "tip"], ["post", "upper"]]},
    "touch_links as ignored pairs": {
        "robot__attached": [{"name": "rod", "box": [0.1, 0.02, 0.02], "touch_links": ["upper"]}],
        "collision__ignore": [["upper", "post"], ["tip", "ball"], ["rod", "tip"]],
    },
    "a tool's speed that is free": {
        "robot__limits": {"tool_speed": None},
        "tube__tool_speed": [None],
    },
    "a tool's speed without end": {"robot__limits": {"tool_speed": np.inf}},
    "an effort's rate without end": {"robot__limits": {"effort_rate": np.inf}},
    "limits that nobody asks": {
        "robot__limits": {"effort_rate": {}, "velocity_by_position": {}, "point_speed": []}
    },
    "limits for all joints, by name and as a list": {
        "robot__limits": {"effort_rate": {"j1": np.inf}, "jerk": [np.inf] * 2, "acceleration": {}}
    },
    "discs and no boxes": {"tube__cross_section": [None]},
    "the default of a limit": {"robot__limits": {"effort": {"j1": 50}}},
    "the same effort both ways": {"robot__limits": {"effort": {"j1": [50, 50]}}},
    "motors that nobody asks": {
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
}
OTHER = {
    "a radius": {"tube__radius": 0.11},
    "a box that holds the disc": {
        "tube__radius": None,
        "tube__cross_section": {"box": [0.2, 0.2], "up": [0, 0, 1]},
    },
    "a clearance": {"clearance": 0.02},
    "an attached solid's size": {"robot__attached__0__box": [0.1, 0.02, 0.03]},
    "an attached solid's place": {"robot__attached__0__position": [0, 0, 0.01]},
    "a post's length": {"obstacles__2__cylinder": [0.05, 1.1]},
    "a capsule instead": {
        "obstacles__2": {"name": "post", "capsule": [0.05, 1.0], "position": [0, -1, 0]}
    },
    "the name of an obstacle": {"obstacles__2__name": "pole", "collision__ignore": []},
    "a mesh's scale": {"obstacles__0__scale": 1.01},
    "a mesh's turn": {"obstacles__0__rpy": [0, 0, 1.5]},
    "pairs that are ignored": {"collision__ignore": [["upper", "post"]]},
    "no self-collision": {"collision__self": False},
    "an effort limit": {"robot__limits": {"effort": {"j1": 51}}},
    "a limit on the tool's speed": {"robot__limits": {"tool_speed": 0.5}},
    "a limit on the effort's rate": {"robot__limits": {"effort_rate": {"j2": 100}}},
    "another joint's": {"robot__limits": {"effort_rate": {"j1": 100}}},
    "a velocity by position": {
        "robot__limits": {"velocity_by_position": {"j1": {"deceleration": 5, "offset": 0.1}}}
    },
    "another deceleration": {
        "robot__limits": {"velocity_by_position": {"j1": {"deceleration": 6, "offset": 0.1}}}
    },
    "a point's speed": {
        "robot__limits": {"point_speed": [{"link": "tip", "position": [0, 0, 0], "speed": 1}]}
    },
    "another point's": {
        "robot__limits": {"point_speed": [{"link": "tip", "position": [0, 0, 1], "speed": 1}]}
    },
    "another link's": {
        "robot__limits": {"point_speed": [{"link": "upper", "position": [0, 0, 0], "speed": 1}]}
    },
    "less effort backwards": {"robot__limits": {"effort": {"j1": [40, 50]}}},
    "still less effort backwards": {"robot__limits": {"effort": {"j1": [30, 50]}}},
    "less effort forwards": {"robot__limits": {"effort": {"j1": [50, 40]}}},
    "still less effort forwards": {"robot__limits": {"effort": {"j1": [50, 30]}}},
    "less effort of the other joint": {"robot__limits": {"effort": {"j2": [50, 40]}}},
    "less effort at one end": {
        "robot__limits": {"effort": {"j1": {"position": [-1, 1], "effort": [50, 40]}}}
    },
    "less effort at one end alone": {
        "robot__limits": {"effort": {"j1": {"position": [0, 1], "effort": [50, 40]}}}
    },
    "a rotor": {"robot__motors": {"armature": {"j1": 0.1}}},
    "friction that grows": {"robot__motors": {"viscous_friction": {"j1": 0.1}}},
    "friction backwards": {"robot__motors": {"coulomb_friction": {"j1": [1, 0]}}},
    "more friction backwards": {"robot__motors": {"coulomb_friction": {"j1": [2, 0]}}},
    "friction forwards": {"robot__motors": {"coulomb_friction": {"j1": [0, 1]}}},
    "more friction forwards": {"robot__motors": {"coulomb_friction": {"j1": [0, 2]}}},
    "friction that may be more": {
        "robot__motors": {"coulomb_friction": {"j1": [0, 1]}, "friction_uncertainty": 0.5}
    },
    "a torque-speed line": {"robot__motors": {"saturation_effort": 50, "no_load_velocity": 2}},
    "a stronger one": {"robot__motors": {"saturation_effort": 60, "no_load_velocity": 2}},
    "a flatter one": {"robot__motors": {"saturation_effort": 50, "no_load_velocity": 3}},
    "one in the tube": {"tube__tool_speed": 0.5},
    "another one in the tube": {"tube__tool_speed": [0.6]},
}


@pytest.mark.usefixtures("covered_roughly")
@pytest.mark.parametrize("changes", SAME.values(), ids=SAME)
def test_one_problem_written_in_two_ways_has_one_hash(changes, cell):
    assert hash_of(changed(**changes), cell) == hash_of(FIELDS, cell)


@pytest.mark.usefixtures("covered_roughly")
def test_no_two_changes_have_one_hash(cell):
    hashes = {name: hash_of(changed(**changes), cell) for name, changes in OTHER.items()}
    assert len(set(hashes.values())) == len(OTHER)


@pytest.mark.usefixtures("covered_roughly")
@pytest.mark.parametrize("changes", OTHER.values(), ids=OTHER)
def test_another_problem_has_another_hash(changes, cell):
    assert hash_of(changed(**changes), cell) != hash_of(FIELDS, cell)


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


@pytest.mark.usefixtures("covered_roughly")
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
    before = hash_of(FIELDS, cell)
    mesh = trimesh.load(str(cell / name), force="mesh")
    mesh.update_faces(np.arange(len(mesh.faces)) != 7)
    mesh.export(cell / name)
    after = parse_problem(FIELDS, cell)
    assert problem_hash(after) != before
    assert robot_hash(after.robot) == robot_hash(parse_problem(FIELDS, cell).robot)


def moved_collision(text):
    return text.replace('<origin xyz="0.2 0 0"/><geometry>', '<origin xyz="0.2 0 0.01"/><geometry>')


def longer_sphere(text):
    return text.replace('radius="0.05"', 'radius="0.06"')


@pytest.mark.usefixtures("covered_roughly")
@pytest.mark.parametrize("change", [moved_collision, longer_sphere])
def test_other_collision_elements_are_another_problem(change, cell):
    before = hash_of(FIELDS, cell)
    path = cell / "arm.urdf"
    assert change(path.read_text()) != path.read_text()
    path.write_text(change(path.read_text()))
    assert hash_of(FIELDS, cell) != before


def test_covers_and_pairs_do_not_matter(cell, request):
    before = parse_problem(FIELDS, cell)
    request.getfixturevalue("covered_roughly")
    after = parse_problem(FIELDS, cell)
    assert len(after.collision.shapes) < len(before.collision.shapes)
    assert problem_hash(after) == problem_hash(before)


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


@pytest.mark.usefixtures("covered_roughly")
def test_another_problem_has_its_own_hash_each_time(cell):
    hashes = {hash_of(changed(**changes), cell) for changes in OTHER.values()}
    assert len(hashes) == len(OTHER)


@pytest.mark.usefixtures("covered_roughly")
def test_all_limits_on_the_tools_speed_have_their_own_hash(cell):
    """In the robot or in the tube, and how large: none is taken for another."""
    given = [{"tube__tool_speed": 0.5}, {"tube__tool_speed": 0.6}]
    given += [{"robot__limits": {"tool_speed": speed}} for speed in (0.5, 0.6)]
    problems = [parse_problem(changed(**changes), cell) for changes in [{}, *given]]
    assert len({problem_hash(problem) for problem in problems}) == 5
    robots = [robot_hash(problem.robot) for problem in problems]
    assert robots[0] == robots[1] == robots[2]
    assert len(set(robots)) == 3


@pytest.mark.usefixtures("covered_roughly")
def test_each_side_of_a_box_and_its_turn_count(cell):
    boxes = [([0.2, 0.2], [0, 0, 1]), ([0.2, 0.3], [0, 0, 1]), ([0.3, 0.2], [0, 0, 1])]
    boxes += [([0.2, 0.2], [1, 1, 1]), ([0.2, 0.3], [0, 0, 2])]
    hashes = [
        hash_of(changed(tube__radius=None, tube__cross_section={"box": b, "up": u}), cell)
        for b, u in boxes
    ]
    assert len(set(hashes[:4])) == 4
    assert hashes[4] == hashes[1]


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


# Hashes of cycles: what changes them, and what is said to differ.


@pytest.fixture(scope="module")
def stated():
    return cycle_part_hashes(small_cycle())


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
def test_what_changes_the_answer_changes_the_hash_and_is_named(changes, differing, stated):
    changed = small_cycle(**changes)
    assert cycle_hash(changed) != cycle_hash(small_cycle())
    found = differing_cycle_parts(changed, stated)
    assert found
    assert differing is None or found == differing


def test_the_same_cycle_has_the_same_hash(stated):
    assert cycle_hash(small_cycle()) == cycle_hash(small_cycle())
    assert differing_cycle_parts(small_cycle(), stated) == []
    assert differing_cycle_parts(small_cycle(), {}) == []


def test_what_an_event_sets_is_no_part_of_the_question():
    assert cycle_hash(small_cycle(moves__1__set="shut")) == cycle_hash(small_cycle())
