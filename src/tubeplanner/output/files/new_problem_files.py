"""New problem files: commented starter; problems of a trail, of MoveIt's messages, of beads.

Lines that begin with `##` explain. Lines that begin with `# ` contain a field, which holds as soon
as the `# ` is removed, alone or with all others.
"""

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, TrajectoryError
from tubeplanner.fields import check_fields
from tubeplanner.first_guess.pose_configurations import pose_configurations
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.outcome import Infeasible
from tubeplanner.output.files.problem_file import (
    in_a_row,
    included_fields,
    new_fields,
    problem_contents,
    put_parts,
    read_fields,
)
from tubeplanner.resources import find_description, find_problem, rebased
from tubeplanner.robot.ros_files import read_srdf
from tubeplanner.studies.tubes.starter_problem import StarterProblem
from tubeplanner.studies.tubes.teach import joint_trail
from tubeplanner.task.beads import BeadOptions, bead_fields
from tubeplanner.task.drawings import Drawing
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.info import problem_doubts
from tubeplanner.task.moveit_files import (
    goal_of_request,
    scale_of_request,
    scene_solids,
    solids_of_state,
    state_joints,
)
from tubeplanner.task.moveit_messages import (
    Message,
    frames_of,
    is_request,
    is_scene,
    notes_on_unread,
    read_message,
)
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import PROBLEM_FORMAT, ProblemFields
from tubeplanner.task.problem_reader import parse_problem, robot_of
from tubeplanner.trajectory.reader import read_trajectory_file

# ---- A first problem file with comments: active fields, and fields to be switched on.

_WHY = {
    "position": "ranges that the URDF lacks [rad] or [m]",
    "velocity": "velocity limits that the URDF lacks [rad/s] or [m/s]",
    "effort": "effort limits that the URDF lacks [N m] or [N]",
    "acceleration": "without efforts nothing else limits accelerations [rad/s^2] or [m/s^2]",
    "jerk": "nor jerk [rad/s^3] or [m/s^3]",
}
_NO_MASSES = "no effort is limited, as links lack their <inertial>"
_WORDS = ("true", "false", "null")  # not text in YAML
_GENTLE = (
    "tool_acceleration: 20.0  # [m/s^2] of the tool centre point, gravity not counted",
    "acceleration: 10.0  # [rad/s^2] or [m/s^2], one number for all joints, a list or a map",
    "jerk: 500.0  # [rad/s^3] or [m/s^3]",
)


def starter_text(
    starter: StarterProblem,
    urdf: str,
    package_dirs: tuple[str, ...],
    folder: Path,
    xacro_args: Mapping[str, str] | None = None,
) -> str:
    """Return the contents of a problem file in a folder, to which its paths are relative.

    The URDF and the folders with packages are named relative to the working folder.
    """
    lines = [
        f"## {starter.info.name}: a first problem, which was planned before it was written.",
        '## Lines with "##" explain. In lines with "#" a field follows: remove "# " to use it.',
        "## `tubeplanner schema` has all fields, with units and defaults.",
        *(f"## note: {note}" for note in problem_doubts(starter.problem)),
        f"format: {PROBLEM_FORMAT}",
        "version: 1",
        *_robot_lines(starter, urdf, package_dirs, folder, xacro_args or {}),
        *_tube_lines(starter),
        *_end_lines(starter),
        *_cell_lines(starter),
    ]
    return "\n".join(lines) + "\n"


def _robot_lines(
    starter: StarterProblem,
    urdf: str,
    package_dirs: tuple[str, ...],
    folder: Path,
    xacro_args: Mapping[str, str],
) -> list[str]:
    frame = starter.info.tool_frame
    folders = [_as_yaml(rebased(each, Path(), folder)) for each in package_dirs]
    others = [name for name in starter.info.leaf_links if name != frame]
    return [
        "robot:",
        f"  urdf: {_as_yaml(rebased(urdf, Path(), folder))}",
        *([f"  package_dirs: [{', '.join(folders)}]"] if folders else []),
        *([f"  xacro_args: {json.dumps(xacro_args, ensure_ascii=False)}"] if xacro_args else []),
        f"  tool_frame: {_as_yaml(frame)}",
        *([f"  ## other ends of chains: {', '.join(others)}"] if others else []),
        "  ## the tool centre point in tool_frame; it is what stays in the tube [m]",
        "  # tool_offset: {position: [0.0, 0.0, 0.0]}",
        "  ## where the root link stands in the cell, whose frame is then that of all [m, rad]",
        "  # base: {position: [0.0, 0.0, 0.0], rpy: [0.0, 0.0, 0.0]}",
        "  ## what the tool carries: mass [kg], centre of mass and solid in tool_frame [m]",
        "  # payload: {mass: 0.1, com: [0.0, 0.0, 0.0]}",
        "  # attached: [{name: part, sphere: 0.01, position: [0.0, 0.0, 0.03], "
        f"touch_links: [{_as_yaml(frame)}]}}]",
        *_limit_lines(starter),
    ]


def _limit_lines(starter: StarterProblem) -> list[str]:
    """Return placeholders for missing limits, to be replaced, and gentle examples."""
    joints = starter.info.joints
    gentle = [
        line
        for line in _GENTLE
        if (name := line.partition(":")[0]) not in starter.placeholders
        and any(joint.limits[name.removeprefix("tool_")].is_missing for joint in joints)
    ]
    why = "  ## without these a motion may be as abrupt as the motors allow"
    if not starter.placeholders:
        fields = ", ".join(line.partition("  #")[0] for line in gentle)
        return [why, f"  # limits: {{{fields}}}"] if gentle else []
    lines = ["  limits:"]
    for quantity, values in starter.placeholders.items():
        endless = quantity == "effort" and np.isinf(list(values.values())).all()
        lines.append(f"    ## PLACEHOLDERS: {_NO_MASSES if endless else _WHY[quantity]};")
        lines.append("    ## REPLACE THEM by the maker's")
        lines.append(f"    {quantity}: {_row(values)}")
    return [*lines, *([f"  {why}"] if gentle else []), *(f"    # {line}" for line in gentle)]


def _tube_lines(starter: StarterProblem) -> list[str]:
    tube = starter.problem.tube
    signs = tube.joint_signs[0]
    return [
        "tube:",
        "  ## reference points of the tool in the frame of the root link [m]",
        "  points:",
        *(f"    - {_row(point)}" for point in tube.points.tolist()),
        "  ## how far the tool may stray from the lines between them, one number or one each [m]",
        f"  radius: {tube.radius[0]:g}",
        *(["  ## the arm stays in the configuration of its start"] if signs else []),
        *([f"  joint_signs: {_row(signs)}"] if signs else []),
        "  ## of the tool [m/s]",
        "  # tool_speed: 0.25",
    ]


def _end_lines(starter: StarterProblem) -> list[str]:
    names, trajectory = starter.problem.robot.joint_names, starter.result.trajectory
    q = starter.problem.endpoints[0].joints
    assert q is not None and trajectory is not None
    start = dict(zip(names, q.tolist(), strict=True))
    last = trajectory.position(trajectory.duration).round(4).tolist()
    return [
        "start:",
        f"  joints: {_row(start)}",
        "## without a goal the motion ends in any configuration, the tool at the last point",
        f"# goal: {{joints: {_row(dict(zip(names, last, strict=True)))}}}",
    ]


def _cell_lines(starter: StarterProblem) -> list[str]:
    """Return examples of further fields."""
    beyond = round(2 * starter.reach + 1, 1)
    return [
        "## box: side lengths; also sphere, cylinder, capsule, mesh; with rpy or quaternion [m]",
        f"# obstacles: [{{name: box, box: [0.2, 0.2, 0.2], position: [{beyond}, 0.0, 0.1]}}]",
        "## least distance of links to obstacles [m]",
        "# clearance: 0.01",
        "## by which share longer than the shortest the motion may be, to be smooth",
        "# objective: {slack: 0.02, minimise: smoothness}",
        "## of the controller: duration and breakpoints are multiples of it [s]",
        "# period: 0.001",
    ]


def _row(values: Any) -> str:
    """Return a list or map in YAML, on a single line."""
    if isinstance(values, Mapping):
        return "{" + ", ".join(f"{_as_yaml(k)}: {_row(v)}" for k, v in values.items()) + "}"
    if isinstance(values, list | tuple):
        return "[" + ", ".join(_row(value) for value in values) + "]"
    return _as_yaml(values)


def _as_yaml(value: Any) -> str:
    """Return a name or a number in YAML."""
    if isinstance(value, str):
        plain = value.replace("_", "").replace("/", "").replace(".", "").replace(":", "")
        is_plain = plain.isascii() and plain.isalnum() and plain[0].isalpha()
        is_word = value.lower() in _WORDS or value.endswith(":")
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return value if is_plain and not is_word else f'"{escaped}"'
    if np.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return repr(float(value) + 0.0)


# ---- The problem of a recorded trail: a robot and its cell, with the trail's ends.

_TRAIL_KEYS = ("tube", "start", "goal")  # keys determined by a trail
# Fields of a tube that stay beside a trail, and those that a trail gives.
_KEPT = ("tool_radius", "tool_speed", "tool_acceleration", "rotation_tolerance")
_NEW = ("points", "radius", "cross_section", "joint_signs")
_JOINTS = ("joints", "seed")
_SAMPLES_PER_PIECE = 20  # of a trail that is a trajectory of ours


@dataclass(frozen=True, eq=False)
class Cell:
    """A robot and its surroundings, from a problem file."""

    fields: Any  # the problem file's own fields, without tube, start and goal
    merged: Any  # the fields with included files, without tube, start and goal
    replaced: Mapping[str, Any]  # tube, start and goal of the problem file, included files counted
    folder: Path  # base of relative paths
    source: str  # name in messages


def read_cell(
    urdf: str | None,
    tool_frame: str | None,
    obstacles: Path | None,
    template: str | None,
    changes: Mapping[str, Any] | None = None,
    srdf: str | None = None,
) -> Cell:
    """Return the cell of a problem file, the template, or of a robot and a file of obstacles.

    Raises:
        ProblemError: A file cannot be read, or a path leads nowhere.
    """
    if template is not None:
        path = find_problem(template, Path())
        fields = read_fields(path, changes)
        folder, source = path.parent, str(path)
    else:
        assert urdf is not None and tool_frame is not None
        fields, folder, source = new_fields(urdf, tool_frame, obstacles), Path(), "the problem"
        if srdf is not None:
            fields["robot"]["srdf"] = srdf
    merged = included_fields(fields, folder)
    for key in _TRAIL_KEYS:
        fields.pop(key, None)
    without_ends = {key: value for key, value in merged.items() if key not in _TRAIL_KEYS}
    replaced = {key: merged[key] for key in _TRAIL_KEYS if isinstance(merged.get(key), dict)}
    return Cell(fields, without_ends, replaced, folder, source)


def taught_problem(
    cell: Cell, path: Path
) -> tuple[PlanningProblem, FloatArray, float, tuple[str, ...]]:
    """Return the problem from a trail's start to its end, the trail (N, n), its time [s], notes.

    The tool may be anywhere. What the cell's tube has for all segments alike of `_KEPT` stays; the
    notes name what stays and what does not, and how the trail was read.
    """
    ends: dict[str, Any] = {"start": {"joints": []}, "goal": {"joints": []}}
    robot = robot_of(check_fields(ProblemFields, {**cell.merged, **ends}, cell.source), cell.folder)
    read = read_trajectory_file(path, robot.joint_names)
    trajectory = read.trajectory
    if read.interpolation is None:
        samples = trajectory.per_piece(_SAMPLES_PER_PIECE).position
    else:
        samples = trajectory.position(trajectory.breakpoints)
    try:
        trail = joint_trail(robot, trajectory.joint_names, samples)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from None
    ends = {"start": {"joints": trail[0].tolist()}, "goal": {"joints": trail[-1].tolist()}}
    problem = parse_problem({**cell.merged, **ends}, cell.folder, path.stem, reads_tube=False)
    fields = cell.replaced.get("tube", {})
    fields_kept = {
        key: value for key in _KEPT if (value := _of_all_segments(fields, key)) is not None
    }
    notes = [
        f"kept of the problem's tube: {key} {value}"
        + ", about the trail's orientations" * (key == "rotation_tolerance")
        for key, value in fields_kept.items()
    ]
    has_rotation = "rotation_tolerance" in fields_kept
    names = (*fields_kept, *["orientations"] * has_rotation)
    notes += notes_on_dropped(cell.replaced, names, "reference points and ends are the trail's")
    if has_rotation:
        fields_kept["orientations"] = quaternion_of_matrix(robot.tool_pose(trail[[0, -1]])[0])
    problem = problem.with_tube(replace(problem.tube, **fields_kept))
    return problem, trail, trajectory.duration, (*read.remarks, *notes)


def notes_on_dropped(
    replaced: Mapping[str, Any], fields_kept: Sequence[str], reason: str
) -> list[str]:
    """Return a note on the fields of a replaced tube, start and goal that are not kept, if any.

    The reason is a clause.
    """
    dropped = [
        f"{part}.{key}"
        for part, values in replaced.items()
        for key, value in values.items()
        if value and key not in ((*fields_kept, *_NEW) if part == "tube" else _JOINTS)
    ]
    return [f"not kept of the problem: {', '.join(dropped)}; {reason}"] * bool(dropped)


def _of_all_segments(fields: Mapping[str, Any], key: str) -> Any:
    """Return a value of a tube's fields that all segments share; None: none, or several."""
    value = fields.get(key)
    if not isinstance(value, list):
        return value or None
    if key == "rotation_tolerance" and len(value) == 3 and not isinstance(value[0], list):
        points = fields.get("points")
        # An angle for each of three segments, or the bounds of every segment.
        value = value if not isinstance(points, list) or len(points) == 4 else [value]
    alike = all(each == value[0] for each in value)
    first = list(value[0]) if isinstance(value[0], list) else value[0]
    return None if not alike else [first] if isinstance(first, list) else first


# ---- The problem of a planning scene and a motion plan request of MoveIt.


def scene_and_request(paths: Sequence[Path]) -> tuple[Message | None, Message | None]:
    """Return the planning scene and the motion plan request of files, each at most once."""
    scenes, requests = list[Message](), list[Message]()
    for path in paths:
        message = read_message(path)
        if not is_scene(message) and not is_request(message):
            raise ProblemError(
                f"{path}: this is neither a planning scene (with world) nor a motion plan request "
                "(with goal_constraints) of MoveIt"
            )
        (scenes if is_scene(message) else requests).append(message)
    for what, messages in (("planning scenes", scenes), ("motion plan requests", requests)):
        if len(messages) > 1:
            labels = " and ".join(each.label for each in messages)
            raise ProblemError(f"{labels} are {what}; give one")
    return next(iter(scenes), None), next(iter(requests), None)


def tool_frame_of(request: Message | None, srdf: str | None) -> str | None:
    """Return the link of a request's tool: that of its goal, or the end of its group's chain."""
    if request is None:
        return None
    for goal in request.parts("goal_constraints")[:1]:
        for position in goal.parts("position_constraints"):
            return position.text("link_name") or None
    if srdf is None:
        return None
    group = request.text("group_name")
    chains = (
        chain
        for each in read_srdf(find_description(srdf, Path())).root.findall("group")
        if each.get("name") == group
        for chain in each.findall("chain")
    )
    return next((chain.get("tip_link") for chain in chains), None)


def imported_problem(
    cell: Cell, scene: Message | None, request: Message | None, name: str
) -> tuple[PlanningProblem, list[str]]:
    """Complete the fields of a cell by a scene and a request; return their problem, and notes.

    Added are solids, allowed pairs, start, goal, locked joints and scaling factors. A cell's own
    stay, but for what `notes_on_dropped` names.
    """
    own = cell.fields
    robot_fields = own.setdefault("robot", {})
    placeholder = {**cell.merged, "start": {"joints": []}}
    robot = robot_of(check_fields(ProblemFields, placeholder, cell.source), cell.folder)
    notes, frames = list[str](), frames_of(robot, scene)
    joints: dict[str, float] = {}
    scale: dict[str, float] = {}
    goal = None
    solids = []
    for message, key in ((scene, "robot_state"), (request, "start_state")):
        if message is None:
            continue
        state = message.part(key)
        joints |= state_joints(state)
        _ = state.value("is_diff"), state.value("multi_dof_joint_state")
        if message is scene:
            solids.append(scene_solids(message, robot, frames))
        else:
            solids.append(solids_of_state(state, frames))
            goal, goal_notes = goal_of_request(message, robot, frames)
            scale = scale_of_request(message)
            notes += goal_notes
            _ = message.text("group_name")
        notes += [*solids[-1].notes, *notes_on_unread(message)]
    missing = [each for each in robot.joint_names if each not in joints]
    if missing:
        labels = " and ".join(each.label for each in (scene, request) if each is not None)
        raise ProblemError(f"{labels}: the state of the robot has no joint {', '.join(missing)}")
    followers = {each for each, joint in robot.urdf.joints.items() if joint.mimic is not None}
    others = [each for each in joints if each not in robot.joint_names]
    free = [each for each in others if each in robot.urdf.movable() and each not in followers]
    if fixed := [each for each in others if each not in free and each not in followers]:
        notes.append(f"not used: the values of {', '.join(fixed)}, which cannot move")
    locked = {each: joints[each] for each in free if joints[each]}
    if locked:
        robot_fields["locked_joints"] = in_a_row(
            {**(cell.merged["robot"].get("locked_joints") or {}), **locked}
        )
    if scale:
        limits = robot_fields.setdefault("limits", {})
        before = (cell.merged["robot"].get("limits") or {}).get("scale") or {}
        scaled = {key: value * before.get(key, 1.0) for key, value in scale.items()}
        limits["scale"] = in_a_row({**before, **scaled})
    for each in solids:
        rows = [in_a_row(fields.model_dump(exclude_unset=True)) for fields in each.attached]
        if rows:
            robot_fields.setdefault("attached", []).extend(rows)
        rows = [in_a_row(fields.model_dump(exclude_unset=True)) for fields in each.obstacles]
        if rows:
            own.setdefault("obstacles", []).extend(rows)
        if each.allowed_pairs:
            collision = own.setdefault("collision", {})
            collision.setdefault("ignore", []).extend(map(in_a_row, map(list, each.allowed_pairs)))
    start = {each: joints[each] for each in robot.joint_names}
    own["start"] = in_a_row({"joints": start})
    if goal is not None:
        own["goal"] = in_a_row(goal)
    problem = parse_problem(own, cell.folder, name, reads_tube=None)
    notes += notes_on_dropped(cell.replaced, (), "start and goal are the request's")
    return problem, notes


def imported_contents(cell: Cell, notes: Sequence[str], target: Path) -> bytes:
    """Return the contents of the problem file of a completed cell, with notes as comments."""
    comments = [f"## note: {note}\n" for note in notes if target.suffix != ".json"]
    return "".join(comments).encode() + problem_contents(deepcopy(cell.fields), cell.folder, target)


# ---- The problem of beads of a drawing.


def bead_problem(
    cell: Cell, drawing: Drawing, options: BeadOptions, name: str
) -> tuple[PlanningProblem, list[str]]:
    """Complete the fields of a cell by the tube and the start of a drawing; return their problem.

    Notes name what of the drawing and the cell was not used, and a start that cannot be reached.
    """
    parts, notes = bead_fields(drawing, options)
    tube, start = parts["tube"], parts["start"]
    below = ProblemLayers.of(cell.fields, cell.folder, "the problem").below
    for key, values in tube.items():
        by_point = key in ("points", "orientations")  # a line each
        tube[key] = [_in_rows(row) for row in values] if by_point else _in_rows(values)
    if below.get("goal") is not None:
        cell.fields["goal"] = None
    put_parts(cell.fields, below, {"tube": tube, "start": {"pose": _in_rows(start["pose"])}})
    problem = parse_problem(cell.fields, cell.folder, name)
    notes += notes_on_dropped(cell.replaced, (), "tube and ends are the drawing's")
    pose = problem.endpoints[0].pose
    assert pose is not None
    try:
        pose_configurations(problem, pose, 0)
    except Infeasible as reason:
        notes.append(f"the robot does not reach the drawing where --frame puts it: {reason}")
    return problem, notes


def _in_rows(values: Any) -> Any:
    """Return lists and maps, one in the other, that YAML writes on a single line."""
    if isinstance(values, dict):
        return in_a_row({key: _in_rows(value) for key, value in values.items()})
    return in_a_row([_in_rows(v) for v in values]) if isinstance(values, list) else values
