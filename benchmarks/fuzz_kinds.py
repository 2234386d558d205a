"""The readers that are fuzzed: by kind, files that are right, and what reads them."""

import json
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from tubeplanner import (
    JointTrajectory,
    MeasureOptions,
    Obstacle,
    PlanOptions,
    explain,
    load_cycle,
    load_problem,
    load_robot,
    load_study,
    measure_tube,
    placement_of,
    plan,
    run_study,
)
from tubeplanner.geometry.point_clouds import read_point_cloud
from tubeplanner.output.files.new_problem_files import (
    imported_problem,
    read_cell,
    scene_and_request,
)
from tubeplanner.output.files.problem_file import read_fields, with_other_tube
from tubeplanner.output.link_visuals import read_visual_mesh
from tubeplanner.resources import bundled_folder
from tubeplanner.robot.info import robot_info
from tubeplanner.robot.ros_files import read_srdf
from tubeplanner.task.side_files import read_limits_file, read_points, read_preset
from tubeplanner.trajectory.reader import read_trajectory_file

_ROBOTS = bundled_folder()
URDF = (_ROBOTS / "two_link" / "two_link.urdf").read_text()
PROBLEM = (_ROBOTS / "two_link" / "around_a_post.yaml").read_text()
WITH_POINTS = """
robot: {urdf: example:two_link, tool_frame: hand, gravity: [0, 0, 0]}
tube: {points: points.csv, radius: 0.03, joint_signs: {joint2: "-"}}
start: {seed: [0.0, -1.0]}
"""
WITH_STATE = """
robot: {urdf: example:two_link, tool_frame: hand, gravity: [0, 0, 0], srdf: arm.srdf}
tube: {points: [[0.6, 0, 0], [0.5, 0, 0]], radius: 0.05}
start: {group_state: ready}
"""
INCLUDING = """
include: cell.yaml
tube: {points: [[0.3, -0.3, 0], [0.3, 0.3, 0]], radius: 0.03, joint_signs: {joint2: "-"}}
start: {seed: [0.0, -1.0]}
"""
CELL = """
robot:
  urdf: example:two_link
  tool_frame: hand
  gravity: [0, 0, 0]
  payload: {mass: 0.5, com: [0, 0, 0.1]}
  attached: [{name: pen, capsule: [0.005, 0.05], position: [0, 0, 0.05], touch_links: [link2]}]
obstacles:
  - {name: post, cylinder: [0.03, 0.3], position: [0.45, 0, 0]}
  - {name: wall, box: [0.1, 0.1, 0.1], position: [0, -0.6, 0], rpy: [0, 0, 0.5]}
clearance: {default: 0.001, pairs: [{links: [link2, post], clearance: 0.002}]}
collision: {self: true, ignore: [[link1, wall]]}
"""
PRESET = """
format: tubeplanner/preset
version: 1
joints: 2
limits: {velocity: [3, 3.5], acceleration: {joint1: 20}, effort: 90, jerk: 500}
motors: {viscous_friction: 0.2, coulomb_friction: [0.5, 0.4], armature: 0.01}
sources:
  limits.velocity: the maker
  limits.acceleration: the maker
  limits.effort: the maker
  limits.jerk: the maker
  motors.viscous_friction: measured
  motors.coulomb_friction: measured
  motors.armature: measured
"""
LIMITS = """
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 0.1
joint_limits:
  joint1:
    {has_velocity_limits: true, max_velocity: 3.0, has_acceleration_limits: true,
     max_acceleration: 20, has_position_limits: true, min_position: -3, max_position: 3}
  joint2: {has_jerk_limits: false, max_jerk: 0, has_effort_limits: true, max_effort: 25}
"""
SRDF = """<robot name="two_link">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <group_state name="ready" group="arm">
    <joint name="joint1" value="0"/><joint name="joint2" value="0"/>
  </group_state>
  <disable_collisions link1="base" link2="link1" reason="Adjacent"/>
  <disable_collisions link1="base" link2="link2" reason="Never"/>
</robot>"""
XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="reach" default="0.3"/>
  <xacro:property name="reach" value="$(arg reach)"/>
  <xacro:property name="given" value="${load_yaml('values.yaml')}"/>
  <xacro:macro name="turn" params="name parent child *origin">
    <joint name="${name}" type="revolute">
      <parent link="${parent}"/><child link="${child}"/><axis xyz="0 0 1"/>
      <xacro:insert_block name="origin"/>
      <limit lower="-3" upper="${pi}" effort="95" velocity="10"/>
    </joint>
    <link name="${child}">
      <inertial><origin xyz="${reach} 0 0"/><mass value="${2 * 7.3}"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><box size="${given['length']} 0.05 0.04"/></geometry></collision>
    </link>
  </xacro:macro>
  <link name="base"/>
  <xacro:turn name="joint1" parent="base" child="link1"><origin xyz="0 0 0"/></xacro:turn>
  <xacro:if value="${reach > 0.1}">
    <xacro:turn name="joint2" parent="link1" child="hand"><origin xyz="0.3 0 0"/></xacro:turn>
  </xacro:if>
</robot>"""
CYCLE = """
format: tubeplanner/cycle
robot: {urdf: example:two_link, tool_frame: hand, gravity: [0, -3, 0]}
start: {seed: [0.0, -1.0]}
closed: true
clearance: 0.001
obstacles: [{name: part, box: [0.02, 0.02, 0.02], position: [0.45, 0.1, 0.3]}]
moves:
  - name: over
    tube: {points: [[0.45, -0.3, 0], [0.45, 0.1, 0]], radius: 0.05, joint_signs: {joint2: "-"}}
  - {event: gripper, set: close, dwell: 0.05}
  - {attach: part, payload: {mass: 0.5, com: [0, 0, 0], inertia: [0.01, 0.01, 0.01, 0, 0, 0]}}
  - name: down
    tube: {points: [[0.45, 0.1, 0], [0.2, 0.1, 0]], radius: 0.05, joint_signs: {joint2: "-"}}
    limits: {velocity: 3}
    goal: {position: [0.2, 0.1, 0], tolerance: 0.01}
  - {detach: part, leave_as_obstacle: false}
  - name: back
    tube: {points: [[0.2, 0.1, 0], [0.45, -0.3, 0]], radius: 0.15, joint_signs: {joint2: "-"}}
"""
SCENE = """
robot_model_name: two_link
robot_state:
  joint_state: {name: [joint1, joint2], position: [0.0, -1.0]}
  multi_dof_joint_state:
    joint_names: [virtual_joint]
    transforms: [{translation: [0, 0, 0], rotation: [0, 0, 0, 1]}]
  attached_collision_objects:
    - link_name: hand
      touch_links: [link2]
      object: {id: pen, primitives: [{type: 2, dimensions: [0.01]}]}
fixed_frame_transforms:
  - {header: {frame_id: bench}, child_frame_id: world, transform: {translation: {x: 1.0}}}
allowed_collision_matrix:
  entry_names: [base, link1, wall]
  entry_values: [[false, true, false], {enabled: [true, false, false]}, [false, false, false]]
  default_entry_names: [pen]
  default_entry_values: [true]
world:
  collision_objects:
    - header: {frame_id: bench}
      id: wall
      pose: {position: {x: 0.0, y: 2.0, z: 0.0}, orientation: {w: 1.0}}
      primitives: [{type: box, dimensions: [0.1, 0.1, 0.1]}, {type: 3, dimensions: [0.2, 0.05]}]
      primitive_poses: [{position: [0, 0, 0]}, {position: [0, 0.3, 0], orientation: [0, 0, 0, 1]}]
    - id: part
      meshes:
        - vertices: [[0, 0, 1], {x: 0.1, z: 1.0}, [0, 0.1, 1], [0, 0, 1.1]]
          triangles: [[0, 2, 1], {vertex_indices: [0, 1, 3]}, [1, 2, 3], [0, 3, 2]]
      mesh_poses: [{position: [0, 0, 0.5]}]
"""
REQUEST = """
group_name: arm
max_velocity_scaling_factor: 0.5
start_state: {joint_state: {name: [joint1, joint2], position: [0.0, -1.0]}}
goal_constraints:
  - joint_constraints:
      - {joint_name: joint1, position: 0.5}
      - {joint_name: joint2, position: -1.5}
"""
POSE_REQUEST = """
start_state: {joint_state: {name: [joint1, joint2], position: [0.0, -1.0]}}
goal_constraints:
  - position_constraints:
      - link_name: hand
        constraint_region:
          primitives: [{type: 2, dimensions: [0.01]}]
          primitive_poses: [{position: {x: 0.4, y: 0.2}, orientation: {w: 1.0}}]
    orientation_constraints: [{link_name: hand, orientation: {w: 1.0}}]
"""
STUDY = """
format: tubeplanner/study
study:
  problem: problem.yaml
  vary: {tube.radius: [x0.5, 0.03], robot.payload.mass: [0, 0.5]}
  options: {method: stop-at-corners, time_limit: 20}
"""
LATIN = """
format: tubeplanner/study
study:
  problem: [problem.yaml, example:two_link/paper_1_30mm]
  vary:
    robot.limits.scale.effort: {from: 0.5, to: 1, spacing: log}
    tube.radius: {from: 0.03, to: 0.05}
  design: {latin: 5, seed: 1}
"""
DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="part"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 0.1 0 0 0 0.1 0 0 0 0.1</float_array>
<technique_common><accessor count="4" source="#pa" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input offset="0" semantic="VERTEX" source="#v" set="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n" name="n"><instance_geometry url="#g"/>
</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""
_JOINTS = ("joint1", "joint2")
_INFO = ("info", "problem.yaml")
_CHECK = ("check", "problem.yaml")
_VIEW = ("view", "problem.yaml", "--html", "page.html")


def with_robot(field: str) -> str:
    """Return a problem of the two-link arm, with one more field of the robot."""
    return f"""
robot: {{urdf: example:two_link, tool_frame: hand, gravity: [0, 0, 0], {field}}}
tube: {{points: [[0.3, -0.3, 0], [0.3, 0.3, 0]], radius: 0.03, joint_signs: {{joint2: "-"}}}}
start: {{seed: [0.0, -1.0]}}
"""


def with_mesh(file: str) -> str:
    """Return a problem whose arm and obstacle have a mesh."""
    problem = with_robot("").replace("example:two_link", "robot.urdf")
    return f"{problem}obstacles: [{{name: part, mesh: {file}, position: [0, 1, 0]}}]\n"


def urdf_with_mesh(file: str) -> str:
    """Return the two-link arm with a mesh for its second link."""
    return URDF.replace('<box size="0.34 0.04 0.04"/>', f'<mesh filename="{file}"/>')


def part() -> bytes:
    """Return the bundled mesh."""
    return (_ROBOTS / "ur5" / "part.stl").read_bytes()


def mesh(ending: str) -> list[bytes]:
    """Return meshes of a format."""
    if ending == "dae":
        return [DAE.encode()]
    box = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type=ending)
    binary = [part()] if ending == "stl" else []
    text = box.encode() if isinstance(box, str) else box
    return [text, *binary]


def problems() -> list[bytes]:
    """Return problem files in YAML."""
    every_field = (_ROBOTS / "ur5" / "every_field.yaml").read_text()
    return [text.encode() for text in (PROBLEM, PROBLEM, with_robot(""), every_field)]


def json_problems() -> list[bytes]:
    """Return problem files in JSON."""
    return [json.dumps(yaml.safe_load(text)).encode() for text in problems()]


def urdfs() -> list[bytes]:
    """Return robots."""
    follower = '<mimic joint="joint1" multiplier="0.5"/></joint>'
    head, tail = URDF.rsplit('velocity="100"/>\n  </joint>', 1)
    return [URDF.encode(), f'{head}velocity="100"/>{follower}{tail}'.encode()]


def points() -> list[bytes]:
    """Return files of points, with and without a line of names."""
    rows = ((0.3, -0.3, 0), (0.3, 0, 0), (0.3, 0.3, 0))
    bare = "\n".join(",".join(map(str, row)) for row in rows)
    turned = "\n".join(",".join(map(str, (*row, 0, 0, 0, 1))) for row in rows)
    return [
        f"x,y,z\n{bare}\n".encode(),
        f"{bare}\n".encode(),
        f"x,y,z,qx,qy,qz,qw\n{turned}\n".encode(),
    ]


def clouds(ending: str) -> list[bytes]:
    """Return point clouds of a format."""
    rows = [(0.0, 2.0, 0.1 * k) for k in range(5)]
    text = "\n".join(" ".join(map(str, row)) for row in rows).encode()
    if ending == "xyz":
        return [b"# x y z\n" + text, text.replace(b" ", b",")]
    if ending == "ply":
        return [trimesh.PointCloud(rows).export(file_type="ply", encoding="ascii")]
    head = b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 5\nHEIGHT 1\n"
    head += b"POINTS 5\nDATA "
    return [head + b"ascii\n" + text, head + b"binary\n" + np.array(rows, "<f4").tobytes()]


def motion(ending: str) -> list[bytes]:
    """Return trajectory files as the package writes them: .json, .csv or .yaml (ROS)."""
    problem, trajectory = _planned()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"motion.{ending}"
        trajectory.save(path, None if ending == "json" else problem, rate=40.0)
        return [path.read_bytes()]


def journals() -> list[bytes]:
    """Return the journal of a study."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        (Path(folder) / "problem.yaml").write_text(PROBLEM)
        (Path(folder) / "study.yaml").write_text(STUDY)
        path = Path(folder) / "table.jsonl"
        run_study(load_study(Path(folder) / "study.yaml"), journal=path, executor=executor)
        return [path.read_bytes()]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        file: Its name in the folder of a case.
        form: Its format, as `fuzz_files.mutated` and `fuzz_files.attacks` call it.
        contents: Makes files that are right.
        read: Reads it; called with its path, in its folder.
        commands: Lines of the command line that read it.
        others: Makes the files beside it, by name.
        attacks: Formats whose attacks it is given.
    """

    file: str
    form: str
    contents: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    commands: tuple[tuple[str, ...], ...] = ()
    others: Callable[[], Mapping[str, bytes]] = dict
    attacks: tuple[str, ...] = field(default=())


@cache
def _planned() -> tuple[object, JointTrajectory]:
    problem = load_problem("example:two_link/around_a_post")
    trajectory = plan(problem, PlanOptions("stop-at-corners")).trajectory
    assert trajectory is not None
    return problem, trajectory


def _read_problem(path: Path) -> None:
    problem = load_problem(path)
    read_fields(path)
    with_other_tube(path, path.with_name("other.json"), problem.tube)


def _ask(path: Path) -> None:
    explain(path, time_limit=0.5)
    measure_tube(load_problem(path), MeasureOptions(samples=100))


def _read_mesh(path: Path) -> None:
    try:
        Obstacle.mesh("part", path, placement_of())
    finally:
        read_visual_mesh(path)


def _read_robot(path: Path) -> None:
    try:
        robot_info(path)
    finally:
        load_robot(path, "hand")


def _read_srdf(path: Path) -> None:
    srdf = read_srdf(path)
    srdf.allowed_pairs(["upper_arm", "lower_arm", "hand"])
    srdf.group_states()


def _read_study(path: Path) -> None:
    study = load_study(path)
    for index in range(min(3, len(study.points))):
        study.spec(study.points[index])


class _Nobody(Executor):
    """Plans nothing: what the journal lacks is refused."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(RuntimeError("not planned"))
        return future


def _read_journal(path: Path) -> None:
    result = run_study(load_study("study.yaml"), journal=path, executor=_Nobody())
    json.dumps(result.as_dict(), allow_nan=False)
    result.csv()


def _beside(**texts: str) -> Callable[[], Mapping[str, bytes]]:
    return lambda: {name.replace("__", "."): text.encode() for name, text in texts.items()}


def _mesh(ending: str, form: str) -> Kind:
    return Kind(
        f"solid.{ending}",
        form,
        partial(mesh, ending),
        _read_mesh,
        (_INFO, _VIEW),
        lambda: {
            "problem.yaml": with_mesh(f"solid.{ending}").encode(),
            "robot.urdf": urdf_with_mesh(f"solid.{ending}").encode(),
        },
        (ending, "xml") if form == "xml" else (ending,),
    )


def _motion(ending: str, form: str) -> Kind:
    file = f"motion.{ending}"
    return Kind(
        file,
        form,
        partial(motion, ending),
        lambda path: read_trajectory_file(path, _JOINTS),
        ((*_CHECK, file), (*_VIEW, file), ("plot", "problem.yaml", file, "-o", "plot.png")),
        _beside(problem__yaml=PROBLEM),
        (form,),
    )


def _cloud(ending: str) -> Kind:
    scan = f"{{name: scan, points: scan.{ending}, size: 0.05}}"
    return Kind(
        f"scan.{ending}",
        "csv" if ending == "xyz" else "stl",
        partial(clouds, ending),
        read_point_cloud,
        (_INFO,),
        _beside(problem__yaml=f"{with_robot('')}obstacles: [{scan}]\n"),
    )


def _read_messages(path: Path) -> None:
    scene, request = scene_and_request([Path("scene.yaml"), Path("request.yaml")])
    cell = read_cell("example:two_link", "hand", None, None)
    imported_problem(cell, scene, request, "it")


def _messages(file: str, contents: tuple[str, ...]) -> Kind:
    arm = ("--urdf", "example:two_link", "--srdf", "arm.srdf")
    scene = f"{with_robot('')}obstacles: [{{moveit_scene: scene.yaml}}]\n"
    return Kind(
        file,
        "yaml",
        lambda: [text.encode() for text in contents],
        _read_messages,
        (_INFO, ("import", "scene.yaml", "request.yaml", *arm)),
        _beside(problem__yaml=scene, scene__yaml=SCENE, request__yaml=REQUEST, arm__srdf=SRDF),
        ("yaml",),
    )


def _part(file: str, text: str, read: Callable[[Path], object], problem: str) -> Kind:
    """Return a YAML file that a problem names."""
    return Kind(
        file,
        "yaml",
        lambda: [text.encode()],
        read,
        (_INFO,),
        _beside(problem__yaml=problem),
        ("yaml",),
    )


KINDS: Mapping[str, Kind] = {
    "problem-yaml": Kind(
        "problem.yaml",
        "yaml",
        problems,
        _read_problem,
        (_INFO, _VIEW, ("links", "problem.yaml"), (*_CHECK, "motion.json")),
        lambda: {"part.stl": part(), "motion.json": motion("json")[0]},
        ("yaml",),
    ),
    "questions": Kind(
        "problem.yaml",
        "yaml",
        problems,
        _ask,
        (
            ("explain", "problem.yaml", "--time-limit", "1", "--processes", "1"),
            ("measure", "problem.yaml"),
        ),
        lambda: {"part.stl": part()},
        ("yaml",),
    ),
    "problem-json": Kind(
        "problem.json",
        "json",
        json_problems,
        _read_problem,
        (("info", "problem.json"),),
        lambda: {"part.stl": part()},
        ("json",),
    ),
    "include": _part("cell.yaml", CELL, lambda path: load_problem("problem.yaml"), INCLUDING),
    "preset": _part("arm.yaml", PRESET, read_preset, with_robot("preset: arm.yaml")),
    "joint-limits": _part(
        "joint_limits.yaml", LIMITS, read_limits_file, with_robot("limits_file: joint_limits.yaml")
    ),
    "points": Kind(
        "points.csv",
        "csv",
        points,
        lambda path: (read_points(path), load_problem("problem.yaml")),
        (_INFO,),
        _beside(problem__yaml=WITH_POINTS),
        ("csv",),
    ),
    "trajectory-json": _motion("json", "json"),
    "trajectory-csv": _motion("csv", "csv"),
    "trajectory-ros": _motion("yaml", "yaml"),
    "urdf": Kind(
        "robot.urdf",
        "xml",
        urdfs,
        _read_robot,
        (("info", "robot.urdf"), _INFO, _VIEW),
        _beside(problem__yaml=with_robot("").replace("example:two_link", "robot.urdf")),
        ("xml",),
    ),
    "xacro": Kind(
        "arm.urdf.xacro",
        "xml",
        lambda: [XACRO.encode()],
        lambda path: load_robot(path, "hand"),
        (("info", "arm.urdf.xacro"),),
        _beside(values__yaml="length: 0.3\n"),
        ("xml", "xacro"),
    ),
    "srdf": Kind(
        "arm.srdf",
        "xml",
        lambda: [SRDF.encode()],
        _read_srdf,
        (_INFO,),
        _beside(problem__yaml=WITH_STATE),
        ("xml",),
    ),
    "moveit-scene": _messages("scene.yaml", (SCENE,)),
    "moveit-request": _messages("request.yaml", (REQUEST, POSE_REQUEST)),
    "ply": _cloud("ply"),
    "pcd": _cloud("pcd"),
    "xyz": _cloud("xyz"),
    "stl": _mesh("stl", "stl"),
    "obj": _mesh("obj", "text"),
    "dae": _mesh("dae", "xml"),
    "cycle": Kind(
        "cycle.yaml",
        "yaml",
        lambda: [CYCLE.encode()],
        load_cycle,
        (("info", "cycle.yaml"), ("check", "cycle.yaml", "motion.json")),
        lambda: {"motion.json": motion("json")[0]},
        ("yaml",),
    ),
    "study": Kind(
        "study.yaml",
        "yaml",
        lambda: [STUDY.encode(), LATIN.encode()],
        _read_study,
        (("info", "study.yaml"),),
        _beside(problem__yaml=PROBLEM),
        ("yaml",),
    ),
    "journal": Kind(
        "table.jsonl",
        "text",
        journals,
        _read_journal,
        (),
        _beside(problem__yaml=PROBLEM, study__yaml=STUDY),
        ("json",),
    ),
}
