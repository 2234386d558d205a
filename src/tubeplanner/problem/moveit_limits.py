"""Limits from MoveIt's `joint_limits.yaml`."""

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from tubeplanner.arguments import given_path
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.problem.field_types import Flag, Number, Section
from tubeplanner.problem.problem_faults import first_fault
from tubeplanner.problem.problem_format import read_document
from tubeplanner.robot.limit_layers import LimitLayer
from tubeplanner.robot.limit_overrides import LimitOverrides

_QUANTITIES = ("effort", "velocity", "acceleration", "jerk")
_FACTORS = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")


class _JointFields(Section):
    """Limits of one joint; `has_...: false` switches one off."""

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


def read_limits_file(path: str | Path) -> LimitLayer:
    """Read MoveIt's `joint_limits.yaml`; joints that are not planned are left out.

    Position, velocity, effort, acceleration and jerk limits are taken; of acceleration and
    deceleration the smaller one. What is switched off by `has_...: false` leaves what the URDF
    says. Default scaling factors are those of MoveIt's requests, no limits: a note names them.

    Raises:
        RobotError: The file cannot be read or is malformed.
    """
    path = given_path("path", path)
    try:
        data = read_document(path, "file of limits")
    except ProblemError as error:
        raise RobotError(str(error)) from None
    if not isinstance(data, dict):
        raise RobotError(f"{path}: a file of limits is a map with joint_limits")
    try:
        fields = _FileFields.model_validate(data)
    except ValidationError as error:
        raise RobotError(f"{path}: {first_fault(data, error, _FileFields)}") from None
    try:
        limits = _limits_of_joints(fields)
    except RobotError as error:
        raise RobotError(f"{path}: {str(error).removeprefix('robot.')}") from None
    notes = _notes(path, fields)
    source = f"limits_file {path.name}"
    return LimitLayer(f"{path}: ", limits, skips_others=True, notes=notes, source=source)


def _limits_of_joints(fields: _FileFields) -> LimitOverrides:
    given: dict[str, Any] = {quantity: {} for quantity in ("position", *_QUANTITIES)}
    for name, joint in fields.joint_limits.items():
        where = f"joint_limits.{name}"
        lower = _value(where, joint, "position", "min_position")
        upper = _value(where, joint, "position", "max_position")
        if (lower is None) != (upper is None):
            missing = "min_position" if lower is None else "max_position"
            raise RobotError(f"{where}.{missing} is required beside the other")
        if lower is not None:
            given["position"][name] = (lower, upper)
        for quantity in _QUANTITIES:
            value = _value(where, joint, quantity, f"max_{quantity}")
            if value is not None:
                given[quantity][name] = value
        deceleration = _value(where, joint, "deceleration", "max_deceleration")
        if deceleration is not None:  # given as a negative number by some
            accelerations = given["acceleration"]
            accelerations[name] = min(abs(deceleration), accelerations.get(name, np.inf))
    return LimitOverrides(**given)


def _value(where: str, joint: _JointFields, quantity: str, key: str) -> float | None:
    """Return a limit of a joint; None if there is none or it is switched off."""
    has: bool | None = getattr(joint, f"has_{quantity}_limits")
    value: float | None = getattr(joint, key)
    if has and value is None:
        raise RobotError(f"{where}.{key} is required: has_{quantity}_limits is true")
    return None if has is False else value


def _notes(path: Path, fields: _FileFields) -> tuple[str, ...]:
    factors = {key: getattr(fields, key) for key in _FACTORS}
    unused = [f"{key} {value:g}" for key, value in factors.items() if value != 1.0]
    if not unused:
        return ()
    return (
        f"{path}: {' and '.join(unused)} not used: what MoveIt asks by default is no limit; "
        "robot.limits.scale slows the robot down",
    )
