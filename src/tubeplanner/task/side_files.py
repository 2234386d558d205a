"""Files beside a problem: presets, limits of MoveIt, reference points as CSV."""

import csv
import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_path
from tubeplanner.documents import DocumentError, read_text
from tubeplanner.errors import ProblemError, RobotError, faults_of, shown, unknown_name
from tubeplanner.fields import Flag, Number, Section, Version, check_fields
from tubeplanner.orientation import matrices_along, quaternion_of_matrix
from tubeplanner.resources import bundled_presets, find_preset
from tubeplanner.robot.joint_limits import LimitLayer
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import (
    LimitFields,
    LimitOverrides,
    MotorFields,
    MotorOverrides,
    limits_of,
)
from tubeplanner.task.problem_format import RobustnessFields, read_document

# ---- Presets: limits and motors of a robot, and controllers, each field with its source.


class _PresetFields(Section):
    """A file for all arms of one kind, or for a controller. SI units; lists in chain order."""

    what = "a preset is a map with format, joints and limits or motors, or robustness, and sources"

    format: Literal["tubeplanner/preset"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    joints: Annotated[int, Field(strict=True, ge=1)] | None = Field(
        None, description="number of the arm's; required beside limits or motors"
    )
    limits: LimitFields = Field(
        LimitFields.model_construct(), description="as robot.limits, without scale"
    )
    motors: MotorFields = Field(MotorFields.model_construct(), description="as robot.motors")
    robustness: RobustnessFields | None = Field(
        None, description="controller and errors, as robustness of a problem"
    )
    sources: dict[str, str] = Field(description="by field, such as limits.velocity: where from")

    @property
    def field_paths(self) -> list[str]:
        """Paths of the fields with values: "limits.velocity"."""
        sections = {"limits": self.limits, "motors": self.motors, "robustness": self.robustness}
        return [
            f"{section}.{name}"
            for section, fields in sections.items()
            if fields is not None
            for name in type(fields).model_fields
            if name in fields.model_fields_set
        ]


def read_preset(name: str | Path, directory: str | Path = ".") -> LimitLayer:
    """Read a preset, for `load_robot` below other limits.

    Args:
        name: A bundled name, such as "fr3", or the path of a YAML file.
        directory: Where a relative path starts.

    Raises:
        RobotError: The preset does not exist, or is malformed: a key is unknown, a number out of
            its bounds, or a field without a source.
    """
    label, fields = _preset(name, directory)
    if fields.joints is None:
        raise RobotError(
            f"{label} holds robustness alone: name it in robustness.preset, not in robot.preset"
        )
    try:
        limits, motors = limits_of(fields.limits), MotorOverrides(**fields.motors.model_dump())
    except RobotError as error:
        raise RobotError(f"{label}: {str(error).removeprefix('robot.')}") from None
    return LimitLayer(f"{label}: ", limits, fields.joints, motors=motors, source=label)


def read_robustness(name: str | Path, directory: str | Path = ".") -> dict[str, Any]:
    """Read the fields of `Robustness` that a preset gives, such as a maker's controller.

    Args:
        name: A bundled name, such as "franka_controller", or the path of a YAML file.
        directory: Where a relative path starts.

    Raises:
        RobotError: As `read_preset`.
    """
    label, fields = _preset(name, directory)
    if fields.robustness is None:
        raise RobotError(f"{label} holds no robustness: name it in robot.preset")
    return fields.robustness.model_dump(exclude_unset=True)


def _preset(name: str | Path, directory: str | Path) -> tuple[str, _PresetFields]:
    """Return the label and the fields of a preset.

    All fields with values, and no others, have a source.
    """
    path = find_preset(name, checked_path("directory", directory))
    label = f"preset {name}"
    with faults_of(label, ProblemError, error=RobotError):
        data = read_document(path, "file")
    fields = check_fields(_PresetFields, data, label, error=RobotError)
    if fields.limits.scale:
        raise RobotError(f"{label}: limits.scale belongs into robot.limits of a problem")
    names = fields.field_paths
    if not names:
        raise RobotError(f"{label}: limits, motors or robustness is required")
    of_arm = [name for name in names if not name.startswith("robustness.")]
    if of_arm and fields.joints is None:
        raise RobotError(f"{label}: joints is required beside {of_arm[0]}")
    if "robustness.preset" in names:
        raise RobotError(f"{label}: robustness.preset belongs into a problem")
    for name in names:
        if not fields.sources.get(name, "").strip():
            raise RobotError(f"{label}: sources.'{name}' is required: say where it is from")
    for name in fields.sources:
        if name not in names:
            raise RobotError(f"{label}: sources: {unknown_name('field', name, names)}")
    return label, fields


_COMPARED = ("velocity", "effort")


def fitting_presets(robot: RobotModel) -> list[str]:
    """Return the names of bundled presets with the velocity and effort limits of a robot's URDF.

    A preset without these limits fits no robot.
    """
    joints = [robot.urdf.joints[name] for name in robot.urdf.chain(robot.tool_frame)]
    joints = [joint for joint in joints if joint.name in robot.joint_names]
    names = [joint.name for joint in joints]
    fitting = []
    for preset, path in bundled_presets().items():
        data: Any = read_document(path, "file")
        if data.get("joints") != len(joints) or not {*_COMPARED} <= {*data.get("limits", {})}:
            continue
        layer = read_preset(preset)
        limits = {key: layer.limits.by_name(key, names, preset) for key in _COMPARED}
        if all(
            np.isclose(limits[key].get(joint.name, np.nan), getattr(joint, key) or np.nan)
            for key in _COMPARED
            for joint in joints
        ):
            fitting.append(preset)
    return fitting


# ---- Limits from MoveIt's `joint_limits.yaml`.

_QUANTITIES = ("effort", "velocity", "acceleration", "jerk")
_FACTORS = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")


class _JointFields(Section):
    """Limits of one joint; `has_...: false` switches one off. Further keys are noted."""

    has_position_limits: Flag | None = None
    min_position: Number | None = None
    max_position: Number | None = None
    has_velocity_limits: Flag | None = None
    max_velocity: Number | None = None
    has_acceleration_limits: Flag | None = None
    max_acceleration: Number | None = None
    has_deceleration_limits: Flag | None = None
    max_deceleration: Number | None = None
    has_jerk_limits: Flag | None = None
    max_jerk: Number | None = None
    has_effort_limits: Flag | None = None
    max_effort: Number | None = None
    angle_wraparound: Flag | None = None


class _FileFields(Section):
    """A file of limits as MoveIt's setup assistant writes it."""

    joint_limits: dict[str, _JointFields] = Field(description="by joint name")
    default_velocity_scaling_factor: Number = 1.0
    default_acceleration_scaling_factor: Number = 1.0


_KNOWN_KEYS = _FileFields.model_fields.keys()
_MISSPELT = 0.85  # least similarity of a misspelt key, from 0 to 1; it is refused


def read_limits_file(path: str | Path) -> LimitLayer:
    """Read MoveIt's `joint_limits.yaml`; joints outside the planning group are left out.

    Limits of position, velocity, effort, acceleration and jerk are read; of acceleration and
    deceleration the smaller. A limit that is switched off by `has_...: false` leaves the URDF's.
    Default scaling factors are for MoveIt's requests and no limits: a note names them, and another
    names other keys, which MoveIt passes over. ros2_control's files have the same keys, and
    joint_limits may lie deeper there.

    Raises:
        RobotError: The file cannot be read or is malformed.
    """
    path = checked_path("path", path)
    try:
        data = read_document(path, "file of limits")
    except ProblemError as error:
        raise RobotError(str(error)) from None
    if not isinstance(data, dict):
        raise RobotError(f"{path}: a file of limits is a map with joint_limits")
    data, unknown = _known_keys(data if "joint_limits" in data else _inner_limits(data) or data)
    fields = check_fields(_FileFields, data, str(path), error=RobotError)
    try:
        limits = _limits_of_joints(fields)
    except RobotError as error:
        raise RobotError(f"{path}: {str(error).removeprefix('robot.')}") from None
    factors = {key: getattr(fields, key) for key in _FACTORS}
    unused = [f"{key} {value:g}" for key, value in factors.items() if value != 1.0]
    note = (
        f"{path}: {' and '.join(unused)} not used: what MoveIt asks by default is no limit; "
        "robot.limits.scale slows the robot down"
    )
    notes = [note] if unused else []
    if unknown:
        listed = ", ".join(f"{key} ({whose})" if whose else key for key, whose in unknown.items())
        notes.append(f"{path}: keys that are no limits here, and are not used: {listed}")
    source = f"limits_file {path.name}"
    return LimitLayer(f"{path}: ", limits, skips_others=True, notes=tuple(notes), source=source)


def _inner_limits(data: dict[Any, Any]) -> dict[Any, Any] | None:
    """Return joint_limits of a deeper map, alone in a map; None without."""
    if "joint_limits" in data:
        return {"joint_limits": data["joint_limits"]}
    inner = (_inner_limits(value) for value in data.values() if isinstance(value, dict))
    return next((each for each in inner if each is not None), None)


def _known_keys(data: dict[Any, Any]) -> tuple[dict[Any, Any], dict[str, str]]:
    """Return a file's map without unknown keys, and these with the names of their joints."""
    unknown: dict[str, list[str]] = {key: [] for key in map(str, data.keys() - _KNOWN_KEYS)}
    joints = data.get("joint_limits")
    if isinstance(joints, dict) and all(isinstance(each, dict) for each in joints.values()):
        for name, joint in joints.items():
            for key in joint:
                if not difflib.get_close_matches(str(key), _JointFields.model_fields, 1, _MISSPELT):
                    unknown.setdefault(str(key), []).append(str(name))
        joints = {
            name: {key: joint[key] for key in joint if name not in unknown.get(str(key), ())}
            for name, joint in joints.items()
        }
    whose = {key: ", ".join(names) for key, names in sorted(unknown.items())}
    return {k: joints if k == "joint_limits" else data[k] for k in data if k in _KNOWN_KEYS}, whose


def _limits_of_joints(fields: _FileFields) -> LimitOverrides:
    limits: dict[str, Any] = {quantity: {} for quantity in ("position", *_QUANTITIES)}
    for name, joint in fields.joint_limits.items():
        where = f"joint_limits.{name}"
        lower = _value(where, joint, "position", "min_position")
        upper = _value(where, joint, "position", "max_position")
        if (lower is None) != (upper is None):
            missing = "min_position" if lower is None else "max_position"
            raise RobotError(f"{where}.{missing} is required beside the other")
        if lower is not None:
            limits["position"][name] = (lower, upper)
        for quantity in _QUANTITIES:
            value = _value(where, joint, quantity, f"max_{quantity}")
            if value is not None:
                limits[quantity][name] = value
        deceleration = _value(where, joint, "deceleration", "max_deceleration")
        if deceleration is not None:  # some files have a negative number
            accelerations = limits["acceleration"]
            accelerations[name] = min(abs(deceleration), accelerations.get(name, np.inf))
    return LimitOverrides(**limits)


def _value(where: str, joint: _JointFields, quantity: str, key: str) -> float | None:
    """Return a limit of a joint; None: missing or switched off."""
    has: bool | None = getattr(joint, f"has_{quantity}_limits")
    value: float | None = getattr(joint, key)
    if has and value is None:
        raise RobotError(f"{where}.{key} is required: has_{quantity}_limits is true")
    return None if has is False else value


# ---- Reference points from a CSV file of CAM or a scanner: one point per line.

_POSITION, _QUATERNION, _RADIUS = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("radius",)
_AXIS = ("i", "j", "k")
_COLUMNS = (*_POSITION, *_QUATERNION, *_AXIS, *_RADIUS)
# Columns by their number, for a file without a line of names.
_UNNAMED = {
    3: _POSITION,
    4: (*_POSITION, *_RADIUS),
    6: (*_POSITION, *_AXIS),
    7: (*_POSITION, *_QUATERNION),
    8: (*_POSITION, *_QUATERNION, *_RADIUS),
}
_OPPOSED = 1e-6  # [rad]: axes nearer to 180 degrees do not say which way the tool turns
_MAX_BYTES = 10_000_000


@dataclass(frozen=True)
class PointFile:
    """Content of a file of points."""

    points: list[list[float]]  # m+1 reference points [m]
    orientations: list[list[float]] | None  # m+1 quaternions x y z w; None if the file has none
    has_axes: bool  # True if the orientations are those of tool axes
    radius: list[float] | None  # radii of the m segments [m]; None if the file has none


def read_points(path: Path) -> PointFile:
    """Read a CSV file of reference points.

    The first line may name the columns: x, y, z, and optionally qx, qy, qz, qw (or i, j, k) and
    radius, in any order; without names they are in this order. i, j, k is the direction of the
    tool's z axis, of any length; from point to point the tool turns by the least angle. A radius is
    that of the segment that begins at the point. The last radius belongs to no segment: it is empty
    or repeats the one before. Lines that begin with # are comments.
    """
    try:
        text = read_text(path, _MAX_BYTES)
        rows = enumerate(csv.reader(text.splitlines(), skipinitialspace=True), 1)
        lines = [
            (k, row)
            for k, row in rows
            if any(cell.strip() for cell in row) and not row[0].startswith("#")
        ]
    except (DocumentError, csv.Error) as error:
        raise ProblemError(f"tube.points: {path} cannot be read: {error}") from None
    if not lines:
        raise ProblemError(f"tube.points: {path} is empty; give a line x, y, z for every point")
    names = _names(path, lines[0][1])
    is_named = not _is_number(lines[0][1][0])
    last = lines[-1][0]
    table = [_values(path, k, row, names, k == last) for k, row in lines[is_named:]]
    columns = {name: [row[name] for row in table] for name in names}
    points = [list(point) for point in zip(*(columns[name] for name in _POSITION), strict=True)]
    quaternions = [columns[name] for name in _QUATERNION if name in columns]
    orientations = [list(row) for row in zip(*quaternions, strict=True)] if quaternions else None
    has_axes = _AXIS[0] in columns
    if has_axes:
        axes = np.column_stack([columns[name] for name in _AXIS])
        orientations = _orientations(path, axes, [k for k, _ in lines[is_named:]])
    radius = None
    if "radius" in columns:
        *radius, end = columns["radius"]
        if radius and not math.isnan(end) and end != radius[-1]:
            raise ProblemError(
                f"tube.points: {path}: the last radius, {end:g} m, belongs to no segment: each is "
                f"that of the segment that begins there; leave it empty or repeat {radius[-1]:g}"
            )
    return PointFile(points, orientations, has_axes, radius)


def _orientations(path: Path, axes: FloatArray, lines: list[int]) -> list[list[float]]:
    """Return the quaternions x y z w of tools along axes (m+1, 3) from lines of a file."""
    lengths = np.linalg.norm(axes, axis=1)
    for line in np.array(lines)[lengths == 0]:
        raise ProblemError(
            f"tube.points: {path}, line {line}: i, j, k are 0; give the direction of the tool's z "
            "axis, of any length"
        )
    axes = axes / lengths[:, None]
    opposed = np.linalg.norm(axes[1:] + axes[:-1], axis=1) < _OPPOSED
    for k in np.flatnonzero(opposed):
        raise ProblemError(
            f"tube.points: {path}, line {lines[k + 1]}: i, j, k are opposed to those of line "
            f"{lines[k]}, so that the way in which the tool turns is undetermined; add a point "
            "between them"
        )
    quaternions: list[list[float]] = quaternion_of_matrix(matrices_along(axes)).tolist()
    return quaternions


def _names(path: Path, first: list[str]) -> tuple[str, ...]:
    """Return the names of the columns, from the file's first line."""
    if _is_number(first[0]):
        if len(first) not in _UNNAMED:
            raise ProblemError(
                f"tube.points: {path} has {len(first)} columns; x, y, z, then optionally "
                "i, j, k (or qx, qy, qz, qw) and radius are known: 3, 4, 6, 7 or 8 of them; with a "
                "line of names, as many as it has"
            )
        return _UNNAMED[len(first)]
    names = tuple(cell.strip() for cell in first)
    for name in names:
        if name not in _COLUMNS:
            raise ProblemError(f"tube.points: {path}: {unknown_name('column', name, _COLUMNS)}")
    missing = [name for name in _POSITION if name not in names]
    kinds = [kind for kind in (_QUATERNION, _AXIS) if any(name in names for name in kind)]
    missing += [name for kind in kinds for name in kind if name not in names]
    if len(kinds) > 1:
        raise ProblemError(
            f"tube.points: {path} has columns {', '.join(_QUATERNION)} and {', '.join(_AXIS)}; "
            "both say how the tool is turned: leave out one of them"
        )
    if missing or len(set(names)) < len(names):
        fault = f"no column {missing[0]}" if missing else "a column twice"
        raise ProblemError(f"tube.points: {path} has {fault}; its columns: {', '.join(names)}")
    return names


def _values(
    path: Path, line: int, row: list[str], names: tuple[str, ...], is_last: bool
) -> dict[str, float]:
    """Return a line's numbers by column; an empty radius of the last line is NaN."""
    if len(row) != len(names):
        raise ProblemError(
            f"tube.points: {path}, line {line} has {len(row)} values for {len(names)} columns"
        )
    values = {}
    for name, cell in zip(names, row, strict=True):
        may_be_empty = is_last and name == "radius" and not cell.strip()
        if not may_be_empty and not (_is_number(cell) and math.isfinite(float(cell))):
            raise ProblemError(
                f"tube.points: {path}, line {line}: {name} is {shown(cell)}; it must be a finite "
                "number"
            )
        values[name] = math.nan if may_be_empty else float(cell)
    return values


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
