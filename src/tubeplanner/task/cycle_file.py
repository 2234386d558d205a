"""The cycle file's format; load_cycle, parse_cycle; files of a problem or a cycle."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Discriminator, Field, Tag

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_path
from tubeplanner.errors import ProblemError, RobotError, faults_of
from tubeplanner.fields import Finite, Flag, Section, Version, check_fields, one_of
from tubeplanner.resources import find_problem
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import angles_of, doubts
from tubeplanner.robot.overrides import LimitFields
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.cycle import Cycle, anywhere
from tubeplanner.task.field_changes import changed_problem
from tubeplanner.task.includes import ProblemLayers, merged_fields
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import (
    AttachedFields,
    Clearance,
    CollisionFields,
    ContactFields,
    EndpointFields,
    Holdings,
    ObjectiveFields,
    ObstacleItem,
    PayloadFields,
    ProblemFields,
    RobotFields,
    RobustnessFields,
    ShapeFields,
    TubeFields,
    clearances_of,
    contacts_of,
    holdings_from,
    is_cycle,
    read_document,
)
from tubeplanner.task.problem_reader import (
    attached_of,
    build_problem,
    load_problem,
    tube_anywhere,
)
from tubeplanner.task.steps import Attach, Detach, Event, Move, Step
from tubeplanner.text import require_name

# ---- Fields of the cycle file, with units and defaults. Other tools read it: names never change.


class MoveCollisionFields(Section):
    """What is not checked in a move, beside what is not in the cycle."""

    ignore: list[tuple[str, str]] = Field([], description="pairs of links or obstacles left out")


class MoveFields(Section):
    """A motion along a tube, or anywhere between its ends, from where the one before ended."""

    model_config = ConfigDict(
        json_schema_extra={
            "allOf": [
                {"anyOf": [{"required": ["name"]}, {"required": ["to"]}]},
                {"anyOf": [{"required": [key]} for key in ("tube", "goal", "to")]},
            ]
        }
    )

    name: str | None = Field(None, description="unique; what messages call it; left out: as in to")
    tube: TubeFields | None = Field(
        None,
        description="where the tool may be, and in which configuration; left out: anywhere",
    )
    goal: EndpointFields | None = Field(
        None, description="where it ends; left out: in whichever configuration is best"
    )
    to: str | None = Field(
        None,
        description="in place of goal: a group_state's name, or start, where the cycle begins; "
        "beside goal: what the move is called",
    )
    limits: LimitFields | None = Field(None, description="above the robot's limits")
    clearance: Clearance | None = Field(
        None, description="in place of the cycle's [m]; of a map, field by field"
    )
    contacts: list[ContactFields] = Field(
        [], description="solids that may be nearer where the move begins or ends"
    )
    objective: ObjectiveFields | None = Field(None, description="in place of the cycle's")
    collision: MoveCollisionFields = Field(
        MoveCollisionFields.model_construct(), description="what is checked"
    )
    pass_through: Flag = Field(False, description="no stop where it begins")
    holding: Holdings | None = Field(
        None, description="parts that the tool holds by contact, beside attached ones"
    )


class EventFields(Section):
    """Something that happens while the arm is at rest."""

    event: str = Field(description="what it is called")
    set: Annotated[
        Flag | float | str | None,
        one_of(
            lambda value: isinstance(value, str | bool | int | float | None),
            "a text, a number, true or false",
        ),
    ] = Field(None, description="what it sets, for those who read the marks")
    dwell: Finite = Field(0.0, description="how long the arm stays [s]")


class AttachFields(Section):
    """The tool takes something."""

    attach: str = Field(description="an obstacle, as it stands then, or what the shape is called")
    payload: PayloadFields | None = Field(None, description="adds to robot.payload")
    shape: ShapeFields | None = Field(
        None, description="in tool_frame, if it is no obstacle; left out: a mass alone"
    )
    holding: Holdings | None = Field(
        None, description="what holds it while it is attached; part: by default the payload"
    )


class DetachFields(Section):
    """The tool lets something go."""

    detach: str = Field(description="what was attached")
    leave_as_obstacle: Flag = Field(True, description="whether it stays where it is then")


_STEPS = {"event": EventFields, "attach": AttachFields, "detach": DetachFields}


def _step_kind(step: Any) -> str | None:
    """Return the name of a step's model, from the keys of the step; None: no key decides."""
    if isinstance(step, Section):
        return type(step).__name__
    keys = step if isinstance(step, dict) else {}
    for key, model in _STEPS.items():
        if key in keys:
            return model.__name__
    return "MoveFields" if keys.keys() & MoveFields.model_fields.keys() else None


StepFields: TypeAlias = Annotated[
    Annotated[MoveFields, Tag("MoveFields")]
    | Annotated[EventFields, Tag("EventFields")]
    | Annotated[AttachFields, Tag("AttachFields")]
    | Annotated[DetachFields, Tag("DetachFields")],
    Discriminator(
        _step_kind,
        custom_error_type="step",
        custom_error_message="it must be a map with name or to (of a move), event, attach or "
        "detach",
    ),
]


class CycleFields(Section):
    """Moves one after the other. SI units, radians; positions in the URDF's root link's frame."""

    what = "a cycle is a map"
    model_config = ConfigDict(title="tubeplanner cycle")

    format: Literal["tubeplanner/cycle"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    include: str | list[str] = Field(
        [], description="parts of problem files below this one, relative to this one"
    )
    robot: RobotFields = Field(description="the arm, its tool and its limits")
    start: EndpointFields = Field(description="where the first move begins, at rest")
    obstacles: list[ObstacleItem] = Field([], description="solids in the base frame, at first")
    clearance: Clearance = Field(
        0.0, description="least distance of links to obstacles [m]; or others for pairs"
    )
    collision: CollisionFields = Field(
        CollisionFields.model_construct(), description="what is checked"
    )
    objective: ObjectiveFields | None = Field(
        None, description="of all moves, beside short; left out: smooth within a slack of 0.005"
    )
    period: Finite | None = Field(
        None, description="the controller's: durations and breakpoints are multiples of it [s]"
    )
    robustness: RobustnessFields | None = Field(
        None, description="what every move is to survive in simulation"
    )
    closed: Flag = Field(False, description="whether the arm ends where it began")
    moves: list[StepFields] = Field(description="moves and what happens between them, in order")


def cycle_schema() -> dict[str, Any]:
    """Return the JSON schema of the cycle file."""
    return CycleFields.model_json_schema(by_alias=True)


# ---- Cycles from files and from nested dictionaries.

_START = "start"  # as the goal of a move: where the cycle begins
_HEADER = ("robot", "start", "obstacles", "objective", "period", "robustness")


def load_cycle(
    name: str | Path, directory: str | Path = ".", *, changes: Mapping[str, Any] | None = None
) -> Cycle:
    """Read a cycle file, its robot and its robot's collision geometry.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled cycle.
        directory: Where a relative path starts.
        changes: Other values by field path, such as `{"moves.to_place.tube.radius": 0.02}`.

    Raises:
        ProblemError: The file contradicts its format, itself or its robot.
        RobotError: The robot cannot be planned with.
    """
    path = find_problem(name, checked_path("directory", directory))
    label = f"{path.resolve().parent.name}/{path.stem}"
    return _build(ProblemLayers.read(path), changes, path.parent, label)


def parse_cycle(
    data: Mapping[str, Any],
    directory: str | Path = ".",
    name: str = "cycle",
    *,
    changes: Mapping[str, Any] | None = None,
) -> Cycle:
    """Build a cycle from the content of a cycle file, as dictionaries and lists.

    Args:
        data: Content of a cycle file.
        directory: Where its relative paths start.
        name: Name in messages and plots.
        changes: As for `load_cycle`.

    Raises:
        ProblemError: As `load_cycle`.
        RobotError: As `load_cycle`.
    """
    folder = checked_path("directory", directory)
    return _build(ProblemLayers.of(data, folder, name), changes, folder, name)


def _build(
    layers: ProblemLayers, changes: Mapping[str, Any] | None, directory: Path, name: str
) -> Cycle:
    source = layers.sources[-1]
    data = changed_problem(layers.merged, changes, CycleFields)
    fields = check_fields(CycleFields, data, source, layers.source_of)
    reader = _MoveReader(data, directory, source)
    steps = [
        reader.move(k, step) if isinstance(step, MoveFields) else None
        for k, step in enumerate(fields.moves)
    ]
    first = reader.first
    if first is None:
        raise ProblemError(f"{source}: moves has no move; give one with a name and a tube")
    try:
        return Cycle(
            start=first.start,
            steps=[
                move or _stop_step(k, step, directory, first.robot)
                for k, (move, step) in enumerate(zip(steps, fields.moves, strict=True))
            ],
            obstacles=first.obstacles,
            attached=first.attached,
            closed=fields.closed,
            self_collision=fields.collision.self_,
            period=fields.period,
            name=name,
            robustness=first.robustness,
            notes=tuple(dict.fromkeys((*doubts(angles_of(fields.model_dump())), *first.notes))),
        )
    except (ProblemError, RobotError) as error:
        raise type(error)(f"{source}: {error}") from None


class _MoveReader:
    """Reader of a cycle file's moves, each by way of a planning problem."""

    def __init__(self, data: Mapping[str, Any], directory: Path, source: str) -> None:
        self._data, self._directory, self._source = data, directory, source
        self._robots: dict[str, RobotModel] = {}
        self._end: FloatArray | None = None  # the tool's position (3,) at the last move's end [m]
        self.first: PlanningProblem | None = None

    def move(self, k: int, fields: MoveFields) -> Move:
        """Return move k of the file."""
        name, own = fields.name or fields.to, self._data["moves"][k]
        if name is None:
            raise ProblemError(f"{self._source}: moves[{k}].name is required, or to")
        require_name(f"{self._source}: moves[{k}].name", name, ProblemError)
        source = f"{self._source}: move '{name}'"
        if fields.to is not None and fields.goal is not None and fields.name is not None:
            raise ProblemError(f"{source}: goal and to are given; leave out one of them")
        if fields.to is not None and fields.goal is None:
            with faults_of(source, ProblemError):
                own = {**own, "goal": self._goal_of(k, fields)}
        merged, tube_of = self._merged(own), None
        if fields.tube is None:
            if merged.get("goal") is None:
                raise ProblemError(
                    f"{self._source}: moves[{k}].tube is required, or else goal, or to"
                )
            tube_of = partial(tube_anywhere, begin=self._end)
        problem_fields = ProblemFields.model_validate(merged)
        where = (self._directory, name, source, tube_of)
        problem = build_problem(problem_fields, *where, is_part=True)
        self.first = self.first or problem
        clearance = ProblemFields.model_validate(
            {**merged, **_above(self._data, own, "clearance")}
        ).clearance
        segments = int(problem.tube.numbers[-1])
        ignored = [*self._ignored(self._data), *self._ignored(own), *problem.ignore_collisions]
        with faults_of(source, ProblemError):
            holding = holdings_from(fields.holding)
        move = Move(
            name,
            self._robots.setdefault(json.dumps(merged["robot"], default=str), problem.robot),
            problem.tube,
            problem.goal,
            **clearances_of(clearance),
            contacts=contacts_of(fields.contacts, segments),
            ignore_collisions=tuple(ignored),
            objective=problem.objective,
            passes_through=fields.pass_through,
            holding=holding,
        )
        self._end = move.end_position
        return move

    def _goal_of(self, k: int, fields: MoveFields) -> dict[str, Any]:
        """Return the fields of the goal of move k that names it."""
        if fields.to != _START:
            return {"group_state": fields.to}
        start: dict[str, Any] = self._data["start"]
        if not {"seed", "pose"} & start.keys():
            return start
        # Planning chooses that configuration, in which the last move of a closed cycle ends.
        is_last = all(
            "to" not in step and "name" not in step for step in self._data["moves"][k + 1 :]
        )
        if self.first is None or not (self._data.get("closed") and is_last):
            raise ProblemError(
                "to: start: the start is a seed or a pose, whose configuration planning chooses; "
                "give start.joints, or closed: true if this is the last move"
            )
        return {"position": self.first.tube.points[0].tolist()}

    def _merged(self, own: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields of a problem of a move alone.

        Without names of solids that steps attach; except for the first move, with an arbitrary
        start.
        """
        merged = {key: self._data[key] for key in _HEADER if key in self._data}
        robot = merged["robot"]
        limits = merged_fields(robot.get("limits") or {}, own.get("limits") or {})
        merged["robot"] = {**robot, "limits": limits}
        merged |= _above(self._data, own, "objective")
        merged |= {key: own[key] for key in ("tube", "goal") if own.get(key) is not None}
        segments = _above(self._data, own, "clearance").get("clearance")
        if isinstance(segments, dict) and segments.get("segments") is not None:
            merged["clearance"] = {"segments": segments["segments"]}
        if self.first is not None:
            merged["start"] = {"seed": anywhere(self.first.robot).tolist()}
        return merged

    @staticmethod
    def _ignored(holder: Mapping[str, Any]) -> list[tuple[str, str]]:
        pairs = (holder.get("collision") or {}).get("ignore") or []
        return [(first, second) for first, second in pairs]


def _above(data: Mapping[str, Any], own: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return a field of a cycle with the move's above the cycle's; empty if neither has the key."""
    values = [holder[key] for holder in (data, own) if holder.get(key) is not None]
    return {key: merged_fields(values[0], values[-1])} if values else {}


def _stop_step(k: int, step: Any, directory: Path, robot: RobotModel) -> Step:
    """Return step k of the file, an event, attaching or detaching."""
    try:
        if isinstance(step, EventFields):
            return Event(step.event, step.set, step.dwell)
        if isinstance(step, DetachFields):
            return Detach(step.detach, step.leave_as_obstacle)
        assert isinstance(step, AttachFields)
        payload, solid = None, None
        if step.payload is not None:
            try:
                payload = Payload(**step.payload.model_dump())
            except RobotError as error:
                # The message names the field as that of the robot.
                reason = str(error).removeprefix("robot.")
                raise RobotError(f"attach '{step.attach}': {reason}") from None
        if step.shape is not None:
            fields = AttachedFields(name=step.attach, **step.shape.model_dump())
            field = f"attach '{step.attach}': shape"
            solid = attached_of(fields, directory, robot.package_dirs, field)
        with faults_of(f"attach '{step.attach}'", ProblemError):
            holding = holdings_from(step.holding, payload=payload)
        return Attach(step.attach, payload, solid, holding)
    except (ProblemError, RobotError) as error:
        raise type(error)(f"moves[{k}]: {error}") from None


# ---- Files of a problem or a cycle.


def load_problem_or_cycle(
    name: str | Path,
    directory: str | Path = ".",
    *,
    reads_tube: bool | None = True,
    changes: Mapping[str, Any] | None = None,
) -> PlanningProblem | Cycle:
    """Read a problem file as `load_problem`, or a cycle file as `load_cycle`."""
    if is_cycle_file(name, directory):
        return load_cycle(name, directory, changes=changes)
    return load_problem(name, directory, reads_tube=reads_tube, changes=changes)


def is_cycle_file(name: str | Path, directory: str | Path = ".") -> bool:
    """Return True if a file is a cycle file; arguments as `load_problem_or_cycle`.

    Raises:
        ProblemError: The file does not exist, or cannot be read.
    """
    return is_cycle(read_document(find_problem(name, checked_path("directory", directory))))
