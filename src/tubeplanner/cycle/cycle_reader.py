"""Cycles read from files and from nested dictionaries."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner.arguments import given_path
from tubeplanner.collision.obstacle import AttachedSolid
from tubeplanner.cycle.cycle import Cycle, anywhere
from tubeplanner.cycle.cycle_format import (
    AttachFields,
    CycleFields,
    DetachFields,
    EventFields,
    MoveFields,
    check_cycle_fields,
)
from tubeplanner.cycle.steps import Attach, Detach, Event, Move, Step
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.names import require_name
from tubeplanner.problem.clearance_fields import clearances_of, contacts_of
from tubeplanner.problem.merged_fields import merged_fields
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_fields import changed_problem
from tubeplanner.problem.problem_format import AttachedFields, ProblemFields
from tubeplanner.problem.problem_layers import ProblemLayers
from tubeplanner.problem.problem_reader import build_problem
from tubeplanner.problem.solid_fields import attached_of
from tubeplanner.resources import find_problem
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.robot.robot_model import RobotModel

_HEADER = ("robot", "start", "obstacles", "objective", "period")


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
    path = find_problem(name, given_path("directory", directory))
    called = f"{path.resolve().parent.name}/{path.stem}"
    return _build(ProblemLayers.read(path), changes, path.parent, called)


def parse_cycle(
    data: Mapping[str, Any],
    directory: str | Path = ".",
    name: str = "cycle",
    *,
    changes: Mapping[str, Any] | None = None,
) -> Cycle:
    """Build a cycle from what a cycle file holds, as dictionaries and lists.

    Args:
        data: The contents of a cycle file.
        directory: Where its relative paths start.
        name: What messages and plots call it.
        changes: As for `load_cycle`.

    Raises:
        ProblemError: As `load_cycle`.
        RobotError: As `load_cycle`.
    """
    folder = given_path("directory", directory)
    return _build(ProblemLayers.of(data, folder, name), changes, folder, name)


def _build(
    layers: ProblemLayers, changes: Mapping[str, Any] | None, directory: Path, name: str
) -> Cycle:
    source = layers.sources[-1]
    data = changed_problem(layers.merged, changes, CycleFields)
    fields = check_cycle_fields(data, source, layers.source_of)
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
                move or _rest_step(k, step, directory, first.robot)
                for k, (move, step) in enumerate(zip(steps, fields.moves, strict=True))
            ],
            obstacles=first.obstacles,
            attached=first.attached,
            closed=fields.closed,
            self_collision=fields.collision.self_,
            period=fields.period,
            name=name,
        )
    except (ProblemError, RobotError) as error:
        raise type(error)(f"{source}: {error}") from None


class _MoveReader:
    """Makes moves of what a cycle file holds, each by way of a planning problem."""

    def __init__(self, data: Mapping[str, Any], directory: Path, source: str) -> None:
        self._data, self._directory, self._source = data, directory, source
        self._robots: dict[str, RobotModel] = {}
        self.first: PlanningProblem | None = None

    def move(self, k: int, fields: MoveFields) -> Move:
        """Return move k of the file, which has these fields."""
        require_name(f"{self._source}: moves[{k}].name", fields.name, ProblemError)
        own = self._data["moves"][k]
        merged = self._merged(own)
        source = f"{self._source}: move '{fields.name}'"
        checked = ProblemFields.model_validate(merged)
        problem = build_problem(checked, self._directory, fields.name, source)
        self.first = self.first or problem
        clearance = ProblemFields.model_validate(
            {**merged, **_above(self._data, own, "clearance")}
        ).clearance
        segments = int(problem.tube.numbers[-1])
        ignored = [*self._ignored(self._data), *self._ignored(own), *problem.ignore_collisions]
        return Move(
            fields.name,
            self._robots.setdefault(json.dumps(merged["robot"], default=str), problem.robot),
            problem.tube,
            problem.goal,
            **clearances_of(clearance),
            contacts=contacts_of(fields.contacts, segments),
            ignore_collisions=tuple(ignored),
            objective=problem.objective,
            passes_through=fields.pass_through,
        )

    def _merged(self, own: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields of a problem that is a move alone.

        Without what names solids that come and go, and, but for the first, from anywhere.
        """
        merged = {key: self._data[key] for key in _HEADER if key in self._data}
        robot = merged["robot"]
        limits = merged_fields(robot.get("limits") or {}, own.get("limits") or {})
        merged["robot"] = {**robot, "limits": limits}
        merged |= _above(self._data, own, "objective")
        merged |= {key: own[key] for key in ("tube", "goal") if key in own}
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
    """Return what a move has under a key above the cycle's; nothing if neither has it."""
    given = [holder[key] for holder in (data, own) if holder.get(key) is not None]
    return {key: merged_fields(given[0], given[-1])} if given else {}


def _rest_step(k: int, step: Any, directory: Path, robot: RobotModel) -> Step:
    """Return step k of the file, which is no move."""
    try:
        if isinstance(step, EventFields):
            return Event(step.event, step.set, step.dwell)
        if isinstance(step, DetachFields):
            return Detach(step.detach, step.leave_as_obstacle)
        assert isinstance(step, AttachFields)
        return Attach(step.attach, _payload(step), _solid(step, directory, robot))
    except (ProblemError, RobotError) as error:
        raise type(error)(f"moves[{k}]: {error}") from None


def _payload(step: AttachFields) -> Payload | None:
    if step.payload is None:
        return None
    try:
        return Payload(**step.payload.model_dump())
    except RobotError as error:
        # It is called as that of the whole robot is.
        raise RobotError(f"attach '{step.attach}': {str(error).removeprefix('robot.')}") from None


def _solid(step: AttachFields, directory: Path, robot: RobotModel) -> AttachedSolid | None:
    if step.shape is None:
        return None
    fields = AttachedFields(name=step.attach, **step.shape.model_dump())
    field = f"attach '{step.attach}': shape"
    return attached_of(fields, directory, robot.package_dirs, field)
