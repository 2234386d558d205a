"""Presets: limits and motors of a robot, each number with its source."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from tubeplanner.arguments import given_path
from tubeplanner.errors import ProblemError, RobotError, unknown_name
from tubeplanner.problem.field_types import Section, Version
from tubeplanner.problem.limit_fields import LimitFields, MotorFields
from tubeplanner.problem.limit_values import limits_of, motors_of
from tubeplanner.problem.problem_faults import first_fault
from tubeplanner.problem.problem_format import read_document
from tubeplanner.resources import find_preset
from tubeplanner.robot.limit_layers import LimitLayer


class _PresetFields(Section):
    """A file for all arms of one kind. SI units, radians; lists are in chain order."""

    format: Literal["tubeplanner/preset"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    joints: Annotated[int, Field(strict=True, ge=1)] = Field(description="number of the arm's")
    limits: LimitFields = Field(LimitFields(), description="as robot.limits, without scale")
    motors: MotorFields = Field(MotorFields(), description="as robot.motors")
    sources: dict[str, str] = Field(description="by field, such as limits.velocity: where from")

    @property
    def given(self) -> list[str]:
        """What has values, such as "limits.velocity"."""
        return [
            f"{section}.{name}"
            for section, fields in (("limits", self.limits), ("motors", self.motors))
            for name, field in type(fields).model_fields.items()
            if getattr(fields, name) != field.default
        ]


def read_preset(name: str | Path, directory: str | Path = ".") -> LimitLayer:
    """Read a preset, to be given to `load_robot` below limits of one's own.

    Args:
        name: A bundled name, such as "fr3", or the path of a YAML file.
        directory: Where a relative path starts.

    Raises:
        RobotError: There is no such preset, or it is malformed: a key is unknown, a number out of
            its bounds or without a source.
    """
    path = find_preset(name, given_path("directory", directory))
    called = f"preset {name}"
    try:
        data = read_document(path, "file")
    except ProblemError as error:
        raise RobotError(f"{called}: {error}") from None
    if not isinstance(data, dict):
        raise RobotError(
            f"{called}: a preset is a map with format, joints, limits or motors, and sources"
        )
    try:
        fields = _PresetFields.model_validate(data)
    except ValidationError as error:
        raise RobotError(f"{called}: {first_fault(data, error, _PresetFields)}") from None
    _require_sources(called, fields)
    try:
        limits, motors = limits_of(fields.limits), motors_of(fields.motors)
    except RobotError as error:
        raise RobotError(f"{called}: {str(error).removeprefix('robot.')}") from None
    return LimitLayer(f"{called}: ", limits, fields.joints, motors=motors, source=called)


def _require_sources(called: str, fields: _PresetFields) -> None:
    """Raise RobotError unless every quantity that is given has a source, and no other."""
    if fields.limits.scale:
        raise RobotError(f"{called}: limits.scale belongs into robot.limits of a problem")
    given = fields.given
    if not given:
        raise RobotError(f"{called}: limits or motors is required")
    for name in given:
        if not fields.sources.get(name, "").strip():
            raise RobotError(f"{called}: sources.'{name}' is required: say where it is from")
    for name in fields.sources:
        if name not in given:
            raise RobotError(f"{called}: sources: {unknown_name('field', name, given)}")
