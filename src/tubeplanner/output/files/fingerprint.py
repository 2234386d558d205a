"""Hashes of robots, problems and cycles, whole and by part; origin of a trajectory.

Hashes depend on a robot's motion and effort and on a problem's conditions, not on the writing of
files, the covers of solids or the selection of pairs. Numbers are rounded to nine digits, so that
another machine, library or version of this package gives the same hash.
"""

import dataclasses
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, SolidContents
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.robot.joint_limits import LIMITS, JointLimits
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import JointMotors
from tubeplanner.robot.overrides import QUANTITIES
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Event


def origin(task: Task, method: str | None = None) -> dict[str, Any]:
    """Return the origin that a trajectory file states, with the method if known, as JSON values."""
    return {
        **({} if method is None else {"method": method}),
        "tubeplanner_version": __version__,
        "problem": task.name,
        "problem_hash": task_hash(task),
        "robot_hash": robot_hash(task.robot),
        "part_hashes": part_hashes(task),
    }


# ---- Hashes of robots and problems, and the hashed parts.

_CONFIGURATIONS, _SEED = 4, 0
_ROBOT_DIGITS, _PROBLEM_DIGITS = 16, 32


def robot_hash(robot: RobotModel) -> str:
    """Return a hash of a robot's kinematics, dynamics, limits and motors."""
    return hash_of(robot_parts(robot), _ROBOT_DIGITS)


def task_hash(task: Task) -> str:
    """Return a hash of everything that the certificate of a motion depends on."""
    return cycle_hash(task) if isinstance(task, Cycle) else problem_hash(task)


def problem_hash(problem: PlanningProblem) -> str:
    """Return a hash of everything that a certificate depends on, the robot included.

    Solids and links enter by kind, size, placement and the bytes of mesh files. The hash has twice
    as many digits as `robot_hash`.
    """
    robot = problem.robot
    parts = [*robot_parts(robot), *tube_parts(problem.tube, robot.joint_names)]
    parts += [*endpoint_parts(problem), *_collision_parts(problem), *holding_parts(problem)]
    return hash_of(parts, _PROBLEM_DIGITS)


def tube_parts(tube: Tube, joint_names: Sequence[str]) -> list[object]:
    """Return the conditions of a tube on the tool and on joints in an order."""
    parts: list[object] = [tube.points, tube.radius, tube.visit]
    parts += [tube.tool_radius, *tube.ranges_of(joint_names)]
    if tube.rotation is not None:
        parts += [tube.rotation.begin, tube.rotation.rotation_change, tube.rotation.bounds]
    # Only with another value than the default, so that files without a new field keep their hash.
    for field in dataclasses.fields(tube):
        if field.name in ("route", "events"):  # no certificate depends on them
            continue
        value = getattr(tube, field.name)
        if field.default is not dataclasses.MISSING and not np.array_equal(value, field.default):
            parts += [field.name, value.steady if field.name == "process" else value]
    # Only with compulsory points, so that hashes of files without any stay the same.
    if len(tube.compulsory_points):
        parts += ["points", tube.compulsory_points]
    return parts


def endpoint_parts(problem: PlanningProblem) -> list[object]:
    """Return the conditions of a problem on start and goal."""
    parts: list[object] = []
    values = problem.start, problem.goal
    for value, end in zip(values, problem.endpoints, strict=True):
        parts.append(type(value).__name__)
        if end.region is not None and end.kind == "position":
            parts += [end.region.position, end.region.tolerance, end.region.rotation_tolerance]
        elif end.pose is not None:
            parts += [end.pose.placement, end.seed]
        else:
            parts.append(end.seed if end.joints is None else end.joints)
    return parts


def holding_parts(problem: PlanningProblem) -> list[object]:
    """Return what the tool holds and how, each after its kind; nothing if nothing is held."""
    parts: list[object] = []
    for each in problem.holding:
        numbers = [np.ravel(value) for value in vars(each.contact).values()]
        parts += [each.kind, *numbers, *dataclasses.astuple(each.mass_properties)]
    robot = problem.robot
    return [*parts, *_link_poses(robot, robot.tool_frame), robot.gravity] if parts else []


def robot_parts(robot: RobotModel) -> list[object]:
    """Return a robot's behaviour: its tool's poses, its efforts, its limits, its motors."""
    return [*motion_parts(robot), robot.inverse_dynamics(*_sampled(robot)), *limit_parts(robot)]


def motion_parts(robot: RobotModel) -> list[object]:
    """Return the joints of a robot and its tool's poses."""
    return [*robot.joint_names, *robot.tool_pose(_sampled(robot)[0])]


def limit_parts(robot: RobotModel) -> list[object]:
    """Return a robot's limits and motors."""
    limits = robot.limits
    return [
        limits.lower_position,
        limits.upper_position,
        *(getattr(limits, name) for name in LIMITS if QUANTITIES[name].in_urdf != "never"),
        *_optional_limits(limits),
        *_motor_parts(robot.motors),
    ]


def _optional_limits(limits: JointLimits) -> list[object]:
    """Return the limits that few robots have, each after its name."""
    parts: list[object] = []
    for name in ("tool_speed", "tool_acceleration"):
        if np.isfinite(getattr(limits, name)):
            parts += [name, getattr(limits, name)]
    for name in LIMITS:
        if QUANTITIES[name].in_urdf == "never" and np.isfinite(getattr(limits, name)).any():
            parts += [name, getattr(limits, name)]
    for law in limits.velocity_by_position:
        parts += ["velocity_by_position", dataclasses.astuple(law)]
    for point in limits.point_speed:
        parts += ["point_speed", point.link, point.position, point.speed]
    for each in limits.effort_ranges:
        parts += ["effort_range", each.joint, each.position, each.backwards, each.forwards]
    return parts


def _motor_parts(motors: JointMotors) -> list[object]:
    """Return the properties of motors outside the inverse dynamics, each after its name."""
    parts: list[object] = []
    if motors.has_coulomb_friction:
        parts += ["coulomb_friction", motors.backwards_friction, motors.forwards_friction]
    if motors.has_curve.any():
        parts += ["motor_curve", motors.saturation_effort, motors.no_load_velocity]
    if motors.has_friction and motors.friction_uncertainty:
        parts += ["friction_uncertainty", motors.friction_uncertainty]
    return parts


def shape_parts(shape: ConvexShape) -> list[object]:
    """Return the vertices of a shape in any order, and its radius."""
    return [np.sort(shape.vertices, axis=0), shape.radius]


def _collision_parts(problem: PlanningProblem) -> list[object]:
    """Return pairs, solids and clearances, independent of the order of names."""
    robot = problem.robot
    may_touch = [*problem.ignore_collisions]
    may_touch += [(solid.name, link) for solid in problem.attached for link in solid.touch_links]
    parts: list[object] = ["collision", problem.clearance, problem.self_collision]
    parts += [name for pair in sorted({tuple(sorted(p)) for p in may_touch}) for name in pair]
    parts += clearance_parts(problem)
    parts.append("links")
    for link, contents in sorted(problem.collision.link_contents.items()):
        parts += [link, *_link_poses(robot, link), *_contents_parts(contents)]
    parts += solids_parts("obstacles", problem.obstacles)
    if problem.attached:
        parts += _link_poses(robot, robot.tool_frame)
    return [*parts, *solids_parts("attached", problem.attached)]


def clearance_parts(problem: PlanningProblem) -> list[object]:
    """Return clearances of pairs and contacts, independent of their order."""
    pairs = {tuple(sorted(names)): value for names, value in problem.pair_clearances.items()}
    parts: list[object] = ["pairs"] if pairs else []
    for names in sorted(pairs):
        parts += [*names, pairs[names]]
    contacts = [
        (*sorted(contact.links), *sorted(contact.ends), contact.within)
        for contact in problem.contacts
    ]
    return parts + [part for contact in sorted(contacts) for part in ("contact", *contact)]


def solids_parts(what: str, solids: Sequence[Obstacle | AttachedSolid]) -> list[object]:
    """Return a heading, then names and origins of solids, independent of their order."""
    parts: list[object] = [what]
    for solid in sorted(solids, key=lambda solid: solid.name):
        if solid.contents is not None:
            parts += [solid.name, *_contents_parts([solid.contents])]
        else:
            shapes = sorted(_text(shape_parts(shape)) for shape in solid.shapes)
            parts += [solid.name, "shapes", *shapes]
    return parts


def _contents_parts(contents: Iterable[SolidContents]) -> list[str]:
    """Return kind, size, mesh and placement of solids, independent of their order."""
    texts = []
    for each in contents:
        # The orientation of a ball has no effect.
        placement = each.placement[:3, 3] if each.kind == "sphere" else each.placement
        texts.append(_text([each.kind, each.sizes, each.mesh_hash, placement]))
    return sorted(texts)


def _link_poses(robot: RobotModel, link: str) -> tuple[FloatArray, FloatArray]:
    """Return rotations and positions of a link in the sampled configurations."""
    rotation, position = robot.body_poses(_sampled(robot)[0])
    body, placement = robot.link_body[link], robot.link_placement[link]
    offset = np.einsum("nij,j->ni", rotation[:, body], placement[:3, 3])
    return rotation[:, body] @ placement[:3, :3], position[:, body] + offset


def _sampled(robot: RobotModel) -> FloatArray:
    """Return positions, velocities and accelerations of random states, shape (3, N, n)."""
    shape = (3, _CONFIGURATIONS, robot.joint_count)
    return np.random.default_rng(_SEED).uniform(-1, 1, shape)


def hash_of(parts: Iterable[object], digits: int) -> str:
    """Return a hash of texts, None and numbers, as hexadecimal digits."""
    return hashlib.sha256(_text(parts).encode()).hexdigest()[:digits]


def _text(parts: Iterable[object]) -> str:
    texts = (str, type(None))
    return "".join(f"{part if isinstance(part, texts) else _digits(part)};" for part in parts)


def _digits(values: object) -> str:
    # Adding zero makes -0.0 to 0.0; values below rounding errors become zero.
    flat = np.round(np.asarray(values, dtype=np.float64).ravel(), 9) + 0.0
    return " ".join(f"{value:.8e}" for value in flat)


# ---- Hashes of the parts of a problem, for notes on differences.
#
# They name differing parts; equality of problems is decided by `problem_hash`.

CARRIED = "carried solids"
_DIGITS = 8


def part_hashes(task: Task) -> dict[str, str]:
    """Return a hash of each part of a problem or a cycle, by its name in messages."""
    if isinstance(task, Cycle):
        parts = {_STEPS: hash_of(_step_parts(task), _DIGITS)}
        for k, leg in enumerate(task.legs):
            of_leg = part_hashes(task.problem_from_anywhere(k))
            parts |= {f"{part}{_OF_MOVE}'{leg.name}'": value for part, value in of_leg.items()}
        return parts
    return {name: hash_of(parts, _DIGITS) for name, parts in _parts(task).items()}


def _parts(problem: PlanningProblem) -> dict[str, list[object]]:
    robot = problem.robot
    payload = [] if robot.payload is None else list(dataclasses.astuple(robot.payload))
    touching = sorted({tuple(sorted(pair)) for pair in problem.ignore_collisions})
    return {
        "robot": motion_parts(robot),
        "payload": payload,
        "limits or motors": limit_parts(robot),
        "tube": tube_parts(problem.tube, robot.joint_names),
        "start or goal": endpoint_parts(problem),
        "obstacles": solids_parts("obstacles", problem.obstacles),
        CARRIED: solids_parts("attached", problem.attached),
        "clearance or collision": [
            problem.clearance,
            problem.self_collision,
            *(name for pair in touching for name in pair),
            *clearance_parts(problem),
        ],
        "holding": holding_parts(problem),
    }


def differing_parts(task: Task, stated: Mapping[str, str]) -> list[str]:
    """Return the parts in which a task differs from the task of the stated hashes.

    A part that differs in every move of a cycle is named once.
    """
    own, count = part_hashes(task), len(task.legs) if isinstance(task, Cycle) else 1
    moves: dict[str, list[str]] = {}
    for name, value in own.items():
        if stated.get(name, value) != value:
            part, _, move = name.partition(_OF_MOVE)
            moves.setdefault(part, []).append(move)
    return [
        _OF_MOVE.join(filter(None, (part, name)))
        for part, names in moves.items()
        for name in ([""] if len(names) == count else names)
    ]


# ---- Hashes of cycles.
#
# They consist of the hashes of the moves' problems, each before its start is known, and of the
# steps between moves.

_CYCLE_DIGITS = 32
_STEPS = "order of steps or dwells"
_OF_MOVE = " of move "


def cycle_hash(cycle: Cycle) -> str:
    """Return a hash of everything that the certificate of a cycle's motion depends on."""
    problems = [problem_hash(cycle.problem_from_anywhere(k)) for k in range(len(cycle.legs))]
    return hash_of([*_step_parts(cycle), *problems], _CYCLE_DIGITS)


def _step_parts(cycle: Cycle) -> list[object]:
    """Return the order of steps, with the properties that no move's problem has."""
    parts: list[object] = ["cycle", "closed" if cycle.closed else "open"]
    for step in cycle.steps:
        parts += [type(step).__name__, step.name]
        if isinstance(step, Event):
            parts.append(step.dwell)
    return parts
