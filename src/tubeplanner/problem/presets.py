"""Presets: the limits of a robot as its maker gives them, each number with its source."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tubeplanner.errors import ProblemError, RobotError, unknown_name
from tubeplanner.problem.limit_values import limits_of
from tubeplanner.problem.problem_faults import first_fault
from tubeplanner.problem.problem_format import LimitFields, Version, read_document
from tubeplanner.resources import find_preset
from tubeplanner.robot.limit_layers import LimitLayer


class _PresetFields(BaseModel):
    """A file of limits for all arms of one kind. SI units, radians; lists are in chain order."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    format: Literal["tubeplanner/preset"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    joints: Annotated[int, Field(strict=True, ge=1)] = Field(description="number of the arm's")
    limits: LimitFields = Field(description="as robot.limits, without scale")
    sources: dict[str, str] = Field(description="by field, such as limits.velocity: where from")


def read_preset(name: str | Path, directory: str | Path = ".") -> LimitLayer:
    """Read a preset, to be given to `load_robot` below limits of one's own.

    Args:
        name: A bundled name, such as "fr3", or the path of a YAML file.
        directory: Where a relative path starts.

    Raises:
        RobotError: There is no such preset, or it is malformed: a key is unknown, a number out of
            its bounds or without a source.
    """
    path = find_preset(name, Path(directory))
    called = f"preset {name}"
    try:
        data = read_document(path, "file")
    except ProblemError as error:
        raise RobotError(f"{called}: {error}") from None
    if not isinstance(data, dict):
        raise RobotError(f"{called}: a preset is a map with format, joints, limits and sources")
    try:
        fields = _PresetFields.model_validate(data)
    except ValidationError as error:
        raise RobotError(f"{called}: {first_fault(data, error, _PresetFields)}") from None
    _require_sources(called, fields)
    try:
        limits = limits_of(fields.limits)
    except RobotError as error:
        raise RobotError(f"{called}: {str(error).removeprefix('robot.')}") from None
    return LimitLayer(f"{called}: limits", limits, fields.joints)


def _require_sources(called: str, fields: _PresetFields) -> None:
    """Raise RobotError unless every quantity that is given has a source, and no other."""
    if fields.limits.scale:
        raise RobotError(f"{called}: limits.scale belongs into robot.limits of a problem")
    limits = fields.limits
    given = [
        f"limits.{name}"
        for name, field in type(limits).model_fields.items()
        if getattr(limits, name) != field.default
    ]
    for name in given:
        if not fields.sources.get(name, "").strip():
            raise RobotError(f"{called}: sources.'{name}' is required: say where it is from")
    for name in fields.sources:
        if name not in given:
            raise RobotError(f"{called}: sources: {unknown_name('field', name, given)}")
