"""The cycle file's shape: fields, units, defaults. Other tools read it, so names never change."""

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag

from tubeplanner.problem.checked_fields import check_fields
from tubeplanner.problem.clearance_fields import Clearance, ContactFields
from tubeplanner.problem.field_types import Finite, Flag, Section, Version
from tubeplanner.problem.limit_fields import LimitFields
from tubeplanner.problem.problem_format import (
    CollisionFields,
    EndpointFields,
    ObjectiveFields,
    ObstacleFields,
    PayloadFields,
    RobotFields,
    ShapeFields,
    TubeFields,
)


class MoveCollisionFields(Section):
    """What is not checked in a move, beside what is not in the cycle."""

    ignore: list[tuple[str, str]] = Field([], description="pairs of links or obstacles left out")


class MoveFields(Section):
    """A motion along a tube, from where the one before ended."""

    name: str = Field(description="unique; what messages call it")
    tube: TubeFields = Field(description="where the tool may be, and in which configuration")
    goal: EndpointFields | None = Field(
        None, description="where it ends; left out: in whichever configuration is best"
    )
    limits: LimitFields | None = Field(None, description="above the robot's limits")
    clearance: Clearance | None = Field(
        None, description="in place of the cycle's [m]; of a map, field by field"
    )
    contacts: list[ContactFields] = Field(
        [], description="solids that may be nearer where the move begins or ends"
    )
    objective: ObjectiveFields | None = Field(None, description="in place of the cycle's")
    collision: MoveCollisionFields = Field(MoveCollisionFields(), description="what is checked")
    pass_through: Flag = Field(False, description="no stop where it begins")


def _plain(value: object) -> object:
    """Report what an event may set."""
    if not isinstance(value, str | bool | int | float | None):
        raise ValueError("it must be a text, a number, true or false")
    return value


class EventFields(Section):
    """Something that happens while the arm is at rest."""

    event: str = Field(description="what it is called")
    set: Annotated[Flag | float | str | None, BeforeValidator(_plain)] = Field(
        None, description="what it sets, for those who read the marks"
    )
    dwell: Finite = Field(0.0, description="how long the arm stays [s]")


class AttachFields(Section):
    """The tool takes something."""

    attach: str = Field(description="an obstacle, as it stands then, or what the shape is called")
    payload: PayloadFields | None = Field(None, description="adds to robot.payload")
    shape: ShapeFields | None = Field(
        None, description="in tool_frame, if it is no obstacle; left out: a mass alone"
    )


class DetachFields(Section):
    """The tool lets something go."""

    detach: str = Field(description="what was attached")
    leave_as_obstacle: Flag = Field(True, description="whether it stays where it is then")


_STEPS = {"event": EventFields, "attach": AttachFields, "detach": DetachFields}


def _step_kind(step: Any) -> str | None:
    """Return which step something is meant to be; None: there is no telling."""
    if isinstance(step, Section):
        return type(step).__name__
    keys = step if isinstance(step, dict) else {}
    named = [model.__name__ for key, model in _STEPS.items() if key in keys]
    return next(iter(named), "MoveFields" if keys.keys() & MoveFields.model_fields.keys() else None)


StepFields: TypeAlias = Annotated[
    Annotated[MoveFields, Tag("MoveFields")]
    | Annotated[EventFields, Tag("EventFields")]
    | Annotated[AttachFields, Tag("AttachFields")]
    | Annotated[DetachFields, Tag("DetachFields")],
    Discriminator(
        _step_kind,
        custom_error_type="step",
        custom_error_message="it must be a map with name (of a move), event, attach or detach",
    ),
]


class CycleFields(Section):
    """Moves one after the other. SI units, radians; positions in the URDF's root link's frame."""

    model_config = ConfigDict(title="tubeplanner cycle")

    format: Literal["tubeplanner/cycle"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    include: str | list[str] = Field(
        [], description="parts of problem files below this one, relative to this one"
    )
    robot: RobotFields = Field(description="the arm, its tool and its limits")
    start: EndpointFields = Field(description="where the first move begins, at rest")
    obstacles: list[ObstacleFields] = Field([], description="solids in the base frame, at first")
    clearance: Clearance = Field(
        0.0, description="least distance of links to obstacles [m]; or others for pairs"
    )
    collision: CollisionFields = Field(CollisionFields(), description="what is checked")
    objective: ObjectiveFields | None = Field(
        None, description="of all moves, beside short; left out: smooth within a slack of 0.005"
    )
    period: Finite | None = Field(
        None, description="the controller's: durations and breakpoints are multiples of it [s]"
    )
    closed: Flag = Field(False, description="whether the arm ends where it began")
    moves: list[StepFields] = Field(description="moves and what happens between them, in order")


def cycle_schema() -> dict[str, Any]:
    """Return the JSON schema of the cycle file."""
    return CycleFields.model_json_schema(by_alias=True)


def check_cycle_fields(
    data: object, source: str, source_of: Callable[[Any, Sequence[int | str]], str]
) -> CycleFields:
    """Check the shape of a cycle given as nested dictionaries; arguments as `check_fields`.

    Raises:
        ProblemError: A key is unknown, a value has the wrong type. The message names the field.
    """
    return check_fields(CycleFields, data, "a cycle is a map", source, source_of)
