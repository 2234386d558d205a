"""Problem files with a new tube or base: comments kept, paths valid."""

import io
import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, shown
from tubeplanner.fields import Section
from tubeplanner.geometry.tube.points import SEGMENT_NUMBERS, sign_of
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.task.field_changes import changed_problem
from tubeplanner.task.includes import (
    ProblemLayers,
    is_named,
    merged_fields,
    move_paths,
    name_of,
)
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import (
    PROBLEM_FORMAT,
    BaseFields,
    EndpointFields,
    TubeFields,
    read_document,
    require_problem,
)

# ---- Problem files with another tube, base or ends: comments kept, relative paths adapted.

_MAX_LINE_LENGTH = 1000  # [characters]: no line is wrapped
_MAX_REASON = 200  # [characters]
_ORDER = ("format", "version", "include", "robot", "tube", "start", "goal")
_MEASURED = ("radius", "cross_section", "joint_signs")
_OF_PROCESS = ("steady", "lead_on", "lead_off")
_CELL = ("obstacles", "clearance", "contacts", "collision")


def read_fields(path: Path, changes: Mapping[str, Any] | None = None) -> Any:
    """Return the fields of a problem file with changes by path, of YAML with comments."""
    plain = read_document(path)  # raises the clearer messages
    if not isinstance(plain, dict):
        raise ProblemError(f"{path}: a problem is a map with robot, tube and start")
    require_problem(plain, str(path))
    fields = plain if path.suffix == ".json" else _with_comments(path)
    changes = changes or {}
    rows = {key: in_a_row(v) if isinstance(v, list | dict) else v for key, v in changes.items()}
    merged = included_fields(fields, path.parent, path)
    change_own(fields, merged, changed_problem(merged, rows))
    return fields


def _with_comments(path: Path) -> Any:
    """Return the fields of a readable YAML file, with comments."""
    try:
        return _yaml().load(path.read_text("utf-8-sig"))
    except (YAMLError, ValueError, TypeError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise ProblemError(
            f"{path} cannot be rewritten with its comments, {shown(reason, _MAX_REASON)}; save it "
            "as plain YAML or as JSON"
        ) from None


def included_fields(fields: Any, folder: Path, path: Path | None = None) -> Any:
    """Return the fields of a problem file in a folder with its included files."""
    return ProblemLayers.of(fields, folder, str(path or "the problem"), path).merged


def new_fields(urdf: str, tool_frame: str, cell: Path | None) -> Any:
    """Return the fields of a new problem file in the current folder, without tube and ends."""
    robot = CommentedMap(urdf=urdf, tool_frame=tool_frame)
    fields = CommentedMap(format=PROBLEM_FORMAT, version=1, robot=robot)
    if cell is not None:
        source = included_fields(read_fields(cell), cell.parent, cell)
        if not source.get("obstacles"):
            raise ProblemError(f"{cell}: obstacles is required: a list of solids")
        copied = {key: source[key] for key in _CELL if key in source}
        move_paths(copied, cell.parent, Path())
        fields.update(copied)
    return fields


def with_problem(fields: Any, folder: Path, target: Path, problem: PlanningProblem) -> bytes:
    """Return a problem file's contents with a problem's tube, start and goal."""
    below = ProblemLayers.of(fields, folder, "the problem").below
    merged = merged_fields(below, fields)
    tube_fields = _tube_fields(problem.tube)
    tube_fields.update(_rotation_fields(problem.tube))
    if problem.tube.tool_radius:
        tube_fields["tool_radius"] = problem.tube.tool_radius
    changes: dict[str, Any] = {"tube": tube_fields}
    for end, q in (("start", problem.start), ("goal", problem.goal)):
        assert isinstance(q, np.ndarray)
        end_fields = merged.get(end)
        # A configuration of the file is kept as it is written.
        if not (isinstance(end_fields, dict) and end_fields.get("joints") is not None):
            changes[end] = in_a_row({"joints": in_a_row(q.tolist())})
    put_parts(fields, below, changes)
    return problem_contents(fields, folder, target)


def put_parts(fields: Any, below: Mapping[str, Any], parts: Mapping[str, Any]) -> None:
    """Put a new tube, start or goal into a file's fields above those of lower layers."""
    for key, value in parts.items():
        alone = _alone(value, below.get(key), TubeFields if key == "tube" else EndpointFields)
        if key in fields:
            fields[key] = alone
        else:
            _insert(fields, key, alone)


def _alone(value: Any, below: Any, model: type[Section]) -> Any:
    """Return a map with defaults for keys of a lower layer, so that merging keeps its meaning."""
    if not isinstance(below, dict):
        return value
    for key in below:
        if key not in value:
            value[key] = model.model_fields[key].default
    if isinstance(value.get("joint_signs"), dict) and below.get("joint_signs"):
        # A map would be merged; a list replaces the lower layer's.
        value["joint_signs"] = [deepcopy(value["joint_signs"]) for _ in value["radius"]]
    return value


def with_other_tube(
    source: Path, target: Path, tube: Tube, changes: Mapping[str, Any] | None = None
) -> bytes:
    """Return a problem file's contents with other radii and joint signs, for another folder.

    Its points are written too if the file refers to another file of points, or if points were left
    out.
    """
    fields, other = read_fields(source, changes), _tube_fields(tube)
    below = ProblemLayers.of(fields, source.parent, str(source)).below.get("tube") or {}
    own = fields.setdefault("tube", CommentedMap())
    file_points = merged_fields(below, own)["points"]
    if isinstance(file_points, str) or len(file_points) != len(tube.points):
        own["points"] = other["points"]
        for key, values in (_rotation_fields(tube) | _number_fields(tube)).items():
            own[key] = values
        if tube.clearance is not None:
            segments = {"segments": _numbers_or_none(tube.clearance)}
            fields.setdefault("clearance", CommentedMap()).update(segments)
    for key in _MEASURED:
        own.pop(key, None)
    values = {key: other[key] for key in _MEASURED if key in other}
    hidden = {key: below[key] for key in _MEASURED if key in below}
    own.update(_alone(values, hidden, TubeFields))
    return problem_contents(fields, source.parent, target)


def with_placement(
    source: Path,
    target: Path,
    placement: Mapping[str, Any],
    changes: Mapping[str, Any] | None = None,
) -> bytes:
    """Return a problem file's contents with another base of the robot, for another folder."""
    fields = read_fields(source, changes)
    below = ProblemLayers.of(fields, source.parent, str(source)).below
    for path, value in placement.items():
        rows = {k: in_a_row(v) if isinstance(v, list | dict) else v for k, v in value.items()}
        if path == "robot.base":
            hidden = (below.get("robot") or {}).get("base")
            robot = fields.setdefault("robot", CommentedMap())
            robot["base"] = _alone(in_a_row(rows), hidden, BaseFields)
        elif path in fields:
            fields[path] = _alone(in_a_row(rows), below.get(path), EndpointFields)
        else:
            _insert(fields, path, _alone(in_a_row(rows), below.get(path), EndpointFields))
    return problem_contents(fields, source.parent, target)


def problem_contents(fields: Any, folder: Path, target: Path) -> bytes:
    """Return a problem file's contents for a target, its paths now relative to a folder."""
    move_paths(fields, folder, target.parent)
    if target.suffix == ".json":
        return (json.dumps(fields, indent=2) + "\n").encode()  # limits may be Infinity
    stream = io.BytesIO()
    _yaml().dump(fields, stream)
    return stream.getvalue()


def _tube_fields(tube: Tube) -> CommentedMap:
    if tube.route is not None:
        route = [in_a_row(q) for q in tube.route.tolist()]
        return CommentedMap(route=CommentedSeq(route), **_number_fields(tube))
    points = in_a_row([in_a_row(point) for point in tube.points.tolist()])
    # Ranges of joints are written as signs where equivalent.
    maps = [
        in_a_row({name: sign_of(b) or in_a_row(list(b)) for name, b in ranges.items()})
        for ranges in tube.joint_ranges
    ]
    signs = maps[0] if all(row == maps[0] for row in maps) else maps
    fields = CommentedMap(points=points, radius=in_a_row(tube.radius.tolist()))
    if tube.cross_section is not None:
        radii = zip(tube.radius.tolist(), tube.is_box, strict=True)
        fields["radius"] = in_a_row([None if is_box else radius for radius, is_box in radii])
        sections = [
            in_a_row({"box": in_a_row(row[:2]), "up": in_a_row(row[2:])}) if any(row) else None
            for row in tube.cross_section.tolist()
        ]
        fields["cross_section"] = in_a_row(sections)
    fields["joint_signs"] = signs
    fields.update(_number_fields(tube))
    return fields


def _rotation_fields(tube: Tube) -> dict[str, Any]:
    """Return the fields of orientations and their tolerances, if any."""
    if tube.orientations is None or tube.rotation_tolerance is None:
        return {}
    entries = tube.rotation_tolerance
    bounds = [in_a_row(list(b)) if isinstance(b, tuple) else b for b in entries]
    orientations = [in_a_row(q) for q in tube.orientations.tolist()]
    return {"orientations": in_a_row(orientations), "rotation_tolerance": in_a_row(bounds)}


def _number_fields(tube: Tube) -> dict[str, Any]:
    """Return the fields of numbers of segments, if any; null where infinite."""
    fields = {
        name: _numbers_or_none(values)
        for name, number in SEGMENT_NUMBERS.items()
        if (values := getattr(tube, name)) is not None and number.field == f"tube.{name}"
    }
    least = fields.pop("least_tool_speed", None)
    if least is not None:
        rows = [
            upper if lower is None else in_a_row({"between": in_a_row([lower, upper])})
            for lower, upper in zip(least, fields["tool_speed"], strict=True)
        ]
        fields["tool_speed"] = in_a_row(rows)
        process = {**vars(tube.process)}  # run-ins are segments by now
        fields["process"] = in_a_row({name: process[name] for name in _OF_PROCESS})
    if tube.events:
        fields["events"] = [in_a_row(vars(each)) for each in tube.events]
    return fields


def _numbers_or_none(values: FloatArray) -> Any:
    """Return the number of each segment for a file, null where infinite."""
    return in_a_row([value if np.isfinite(value) else None for value in values.tolist()])


def in_a_row(values: Sequence[Any] | Mapping[str, Any]) -> Any:
    """Return a list or map that YAML writes on a single line."""
    row: Any = CommentedMap(values) if isinstance(values, Mapping) else CommentedSeq(values)
    row.fa.set_flow_style()
    return row


def _insert(fields: Any, key: str, value: Any) -> None:
    """Put a key into its usual place: tube, start and goal in this order, after the robot."""
    names = list(fields)
    before = _ORDER[: _ORDER.index(key)]
    index = 1 + max((names.index(name) for name in before if name in fields), default=-1)
    if isinstance(fields, CommentedMap):
        fields.insert(index, key, value)
        return
    rest = list(fields.items())[index:]
    for name, _ in rest:
        del fields[name]
    fields.update({key: value, **dict(rest)})


def _yaml() -> YAML:
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _MAX_LINE_LENGTH
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


def change_own(own: Any, merged: Any, target: Any) -> None:
    """Change a file's own fields so that the merged fields get target values, no key left out.

    Comments stay; fields that need no change are untouched.
    """
    for key, value in target.items():
        old = merged.get(key)
        if value == old:
            continue
        if isinstance(value, dict) and isinstance(old, dict):
            change_own(_own_part(own, key, {}), old, value)
        elif old and value and is_named(old) and is_named(value) and len(old) == len(value):
            _change_items(_own_part(own, key, []), old, value)
        else:
            own[key] = value


def _change_items(own: Any, merged: Any, target: Any) -> None:
    """Change a list of named items to give target items with included files."""
    indices = {name_of(item): k for k, item in enumerate(own)}
    for old, value in zip(merged, target, strict=True):
        if value == old:
            continue
        name = name_of(old)
        if name not in indices:
            indices[name] = len(own)
            own.append({"name": name})
        change_own(_own_part(own, indices[name], {}), old, value)


def _own_part(own: Any, key: Any, empty: Any) -> Any:
    """Return a copied entry of a map or list, new in a map without the entry."""
    part = own.get(key) if isinstance(own, dict) else own[key]
    # A copy: an alias elsewhere in the file keeps its value.
    own[key] = empty if part is None else deepcopy(part)
    return own[key]
