"""TaskInfo: what the file of a problem or cycle holds: robot, missing limits, task if it loads."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.geometry.convex_shapes import extent_of
from tubeplanner.geometry.link_geometry import link_extents
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.geometry.tube.points import SEGMENT_NUMBERS
from tubeplanner.resources import find_problem
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent, angles_of, doubts, implausible_values, unlimited_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_file import CycleFields, load_cycle
from tubeplanner.task.endpoints import Endpoint
from tubeplanner.task.field_changes import checked_layers, read_problem_fields
from tubeplanner.task.holding import Holding, holding_notes
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.legs import Leg, step_text
from tubeplanner.task.motion import Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import ProblemFields
from tubeplanner.task.problem_reader import load_problem, robot_arguments

if TYPE_CHECKING:
    from tubeplanner.robot.info import RobotInfo

_Task = TypeVar("_Task", bound=Task)

# ---- Files of problems and cycles.


@dataclass(frozen=True)
class SrdfInfo:
    """Content of an SRDF."""

    # joint positions by name of the state and of the joint [rad or m]
    states: Mapping[str, Mapping[str, float]]
    disabled_pairs: tuple[tuple[str, str], ...]  # pairs of links that may touch


@dataclass(frozen=True)
class TaskInfo:
    """Content of the file of a problem or a cycle."""

    kind: str  # "problem" or "cycle"
    robot: "RobotInfo"
    srdf: SrdfInfo | None  # None: there is none
    task: Task | None  # None if it does not load
    refused: str | None  # message of the error if the task does not load; else None

    @property
    def problem(self) -> PlanningProblem | None:
        """The problem, of a cycle its first leg's; None if it does not load."""
        return self.task.problem_from_anywhere(0) if isinstance(self.task, Cycle) else self.task

    def as_dict(self) -> dict[str, Any]:
        """Return the content as JSON values."""
        srdf = None if self.srdf is None else vars(self.srdf)
        values: dict[str, Any] = {"srdf": srdf, "refused": self.refused}
        if self.kind == "cycle":
            task = _cycle_task(self.task) if isinstance(self.task, Cycle) else None
            return self.robot.as_dict() | values | {"cycle": task}
        task = _problem_task(self.task) if isinstance(self.task, PlanningProblem) else None
        return self.robot.as_dict() | values | {"task": task}


def problem_info(name: str | Path, changes: Mapping[str, Any] | None = None) -> TaskInfo:
    """Return the content of a problem file, with its robot even if the problem does not load."""
    path = find_problem(name, Path())
    fields = read_problem_fields(path, changes)
    load = partial(load_problem, name, reads_tube=fields.tube is not None, changes=changes)
    return _task_info("problem", fields, path.parent, load)


def cycle_info(name: str | Path, changes: Mapping[str, Any] | None = None) -> TaskInfo:
    """Return the content of a cycle file; arguments and errors as of `problem_info`."""
    path = find_problem(name, Path())
    fields = checked_layers(ProblemLayers.read(path), changes, CycleFields)
    load = partial(load_cycle, name, changes=changes)
    return _task_info("cycle", fields, path.parent, load)


def _task_info(
    kind: str,
    fields: ProblemFields | CycleFields,
    directory: Path,
    load: Callable[[], _Task],
) -> TaskInfo:
    from tubeplanner.robot.info import robot_info

    robot = robot_info(**robot_arguments(fields.robot, directory))
    urdf, srdf = robot.arm.urdf, None
    if urdf.srdf is not None:
        srdf = SrdfInfo(urdf.srdf.group_states(), tuple(urdf.srdf.allowed_pairs(urdf.links)))
    try:
        task = load()
    except (ProblemError, RobotError) as error:
        notes = [*doubts(angles_of(fields.model_dump())), *robot_doubts(robot.arm)]
        return TaskInfo(kind, with_doubts(robot, notes), srdf, None, str(error))
    notes = [*task_doubts(task), *unlimited_notes(task.robot)]
    return TaskInfo(kind, with_doubts(robot, notes), srdf, task, None)


def with_doubts(robot: "RobotInfo", task_notes: Sequence[str] | None = None) -> "RobotInfo":
    """Return a robot with notes on its task; None: on implausible values of the robot alone."""
    notes = robot_doubts(robot.arm) if task_notes is None else task_notes
    return replace(robot, notes=(*robot.notes, *notes))


# ---- Implausible values of problems and cycles.


def robot_doubts(robot: RobotModel) -> tuple[str, ...]:
    """Return notes on implausible values of a robot; on its geometry, if that can be read."""
    try:
        extents = link_extents(robot)
    except RobotError:  # a mesh is missing or unreadable, which loading says
        extents = {}
    return implausible_values(robot, extents)


def problem_doubts(problem: PlanningProblem) -> tuple[str, ...]:
    """Return notes on implausible values of a problem: file, robot, solids, goal."""
    points = problem.tube.points
    tube = Extent(0, np.array([points.min(axis=0), points.max(axis=0)]))
    extents = {**problem.collision.extents, "the tube's points": tube}
    notes = (*implausible_values(problem.robot, extents), *holding_notes(problem.holding))
    return (*problem.notes, *notes, *_goal_note(problem))


def task_doubts(task: Task) -> tuple[str, ...]:
    """Return notes on implausible values of a problem or a cycle."""
    return cycle_doubts(task) if isinstance(task, Cycle) else problem_doubts(task)


def cycle_doubts(cycle: Cycle) -> tuple[str, ...]:
    """Return notes on implausible values of a cycle: of its file, its robot and its solids."""
    notes = list(cycle.notes)
    for k in range(len(cycle.legs)):
        notes += problem_doubts(cycle.problem_from_anywhere(k))
    return tuple(dict.fromkeys(notes))


def _goal_note(problem: PlanningProblem) -> list[str]:
    """Return a note if the goal's ball holds the start and all points of the tube."""
    start, region = problem.endpoints[0], problem.open_goal
    if region is None or region.bounds_rotation:
        return []
    tool = problem.tube.points[0] if start.position is None else start.position
    if start.joints is not None:
        tool = problem.robot.tool_position(start.joints)
    if max(map(region.distance, (tool, *problem.tube.points))) > region.tolerance:
        return []
    away, most = 1000 * region.distance(tool), 1000 * region.tolerance
    return [
        f"the goal's ball holds the start: there the tool is {away:.4g} mm from goal.position, and "
        f"goal.tolerance is {most:g} mm; no motion is needed: move the goal, or give a smaller "
        "tolerance [m]"
    ]


def _solid(solid: Obstacle | AttachedSolid) -> dict[str, Any]:
    """Return name, size along the axes, centre [m] and number of shapes of a solid."""
    low, high = extent_of(solid.shapes)
    size, center = (high - low).tolist(), ((low + high) / 2).tolist()
    return {"name": solid.name, "size": size, "center": center, "shapes": len(solid.shapes)}


def _problem_task(problem: PlanningProblem) -> dict[str, Any]:
    """Return start, tube, solids and payload of a problem as JSON values."""
    tube, payload = problem.tube, problem.robot.payload
    return {
        "name": problem.name,
        "start": _end(problem, problem.endpoints[0]),
        "goal": None if problem.goal is None else _end(problem, problem.endpoints[1]),
        "points": tube.points.tolist(),
        "segments": [_segment(problem, k) for k in range(tube.segment_count)],
        "obstacles": list(map(_solid, problem.obstacles)),
        "attached": list(map(_solid, problem.attached)),
        "clearance": problem.clearance,
        "pair_clearances": [
            {"links": list(links), "clearance": clearance}
            for links, clearance in problem.pair_clearances.items()
        ],
        "contacts": [asdict(contact) for contact in problem.contacts],
        "payload": None if payload is None else {"mass": payload.mass, "com": list(payload.com)},
        "period": problem.period,
        "holding": list(map(_held, problem.holding)),
    }


def _held(holding: Holding) -> dict[str, Any]:
    """Return kind, numbers and part of a holding as JSON values."""
    part = None if holding.kind == "liquid" else asdict(holding.mass_properties)
    return {"kind": holding.kind, **asdict(holding.contact), "part": part}


def _end(problem: PlanningProblem, end: Endpoint) -> dict[str, Any]:
    """Return the kind of an end, its joints or seed, and the tool's position; None if unknown."""
    joints, tool = end.joints if end.pose is not None else end.seed, end.position
    if end.joints is not None:
        joints, tool = end.joints, problem.robot.tool_position(end.joints)
    return {
        "kind": end.kind,
        "joints": None if joints is None else joints.tolist(),
        "tool": None if tool is None else tool.tolist(),
    }


def _segment(problem: PlanningProblem, k: int) -> dict[str, Any]:
    """Return the number, size and conditions of a segment of the tube."""
    tube = problem.tube
    bound = None if tube.rotation is None else tube.rotation.bounds[k]
    columns = {name: getattr(tube, name) for name in SEGMENT_NUMBERS}
    numbers = {name: None if each is None else float(each[k]) for name, each in columns.items()}
    for name in ("tool_speed", "tool_acceleration"):
        numbers[name] = np.inf if numbers[name] is None else numbers[name]
    return {
        "number": tube.segment_number(k),
        "length": float(np.linalg.norm(tube.points[k + 1] - tube.points[k])),
        "radius": None if tube.is_box[k] else float(tube.radius[k]),
        "rotation_tolerance": None if bound is None else bound.tolist(),
        **numbers,
        "joint_ranges": tube.joint_ranges[k],
    }


def _cycle_task(cycle: Cycle) -> dict[str, Any]:
    """Return start, moves and rests, and solids of a cycle as JSON values."""
    return {
        "name": cycle.name,
        "start": cycle.endpoint.kind,
        "closed": cycle.closed,
        "period": cycle.period,
        "obstacles": list(map(_solid, cycle.obstacles)),
        "attached": list(map(_solid, cycle.attached)),
        "legs": [_leg(cycle, k, leg) for k, leg in enumerate(cycle.legs)],
        "after": [step_text(step) for step in cycle.after.steps],
    }


def _leg(cycle: Cycle, k: int, leg: Leg) -> dict[str, Any]:
    """Return the rest before a leg, its moves, and its payload and attached solids."""
    payload = leg.robot.payload
    return {
        "before": [step_text(step) for step in leg.before.steps],
        "moves": [
            {
                "name": move.name,
                "points": move.tube.points.tolist(),
                "length": float(np.linalg.norm(np.diff(move.tube.points, axis=0), axis=1).sum()),
                "goal": None if move.goal is None else move.endpoint.kind,
            }
            for move in leg.moves
        ],
        "payload": None if payload is None else {"mass": payload.mass, "com": list(payload.com)},
        "attached": [solid.name for solid in cycle.problem_from_anywhere(k).attached],
        "holding": list(map(_held, cycle.problem_from_anywhere(k).holding)),
    }
