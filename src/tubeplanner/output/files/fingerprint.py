"""Hashes of robots, problems and cycles, whole and by part; origin of a trajectory.

They are taken from what a robot does and from what a problem asks, not from how their files are
written, nor from how solids are covered or which pairs are checked: numbers are rounded to nine
digits, so that another machine, library or version of this package gives the same hash.
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
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import JointMotors
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.endpoints import GoalRegion, Seed, ToolPose
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Event

# ---- Hashes of robots and problems: are two files about the same thing?

_CONFIGURATIONS, _SEED = 4, 0
_ROBOT_DIGITS, _PROBLEM_DIGITS = 16, 32


def robot_hash(robot: RobotModel) -> str:
    """Return a hash of a robot's kinematics, dynamics, limits and motors."""
    return hash_of(robot_parts(robot), _ROBOT_DIGITS)


def problem_hash(problem: PlanningProblem) -> str:
    """Return a hash of all that a certificate depends on, the robot included.

    Of solids and links it takes kinds, sizes, placements and the bytes of mesh files. It has twice
    as many digits as `robot_hash`.
    """
    parts = [*robot_parts(problem.robot), *_question_parts(problem), *_collision_parts(problem)]
    return hash_of(parts, _PROBLEM_DIGITS)


def _question_parts(problem: PlanningProblem) -> list[object]:
    """Return what a problem asks of the tool and of start and goal, apart from collisions."""
    return [*tube_parts(problem.tube, problem.robot.joint_names), *endpoint_parts(problem)]


def tube_parts(tube: Tube, joint_names: Sequence[str]) -> list[object]:
    """Return what a tube asks of the tool and of joints in an order."""
    parts: list[object] = [tube.points, tube.radius, tube.visit]
    parts += [tube.tool_radius, *tube.ranges_of(joint_names)]
    if tube.rotation is not None:
        parts += [tube.rotation.begin, tube.rotation.turn, tube.rotation.bounds]
    parts += _optional_parts(tube)
    # Only where points are asked that earlier versions did not know.
    if len(tube.compulsory_points):
        parts += ["points", tube.compulsory_points]
    return parts


def endpoint_parts(problem: PlanningProblem) -> list[object]:
    """Return what a problem asks of start and goal."""
    parts: list[object] = []
    for given in (problem.start, problem.goal):
        parts.append(type(given).__name__)
        if isinstance(given, GoalRegion):
            bounds = given.rotation_tolerance
            parts += [given.position, given.tolerance, bounds]
        elif isinstance(given, ToolPose):
            parts += [given.placement, given.seed]
        else:
            parts.append(given.joints if isinstance(given, Seed) else given)
    return parts


def robot_parts(robot: RobotModel) -> list[object]:
    """Return what a robot does: its tool's poses, its efforts, its limits, its motors."""
    return [*motion_parts(robot), robot.inverse_dynamics(*_sampled(robot)), *limit_parts(robot)]


def motion_parts(robot: RobotModel) -> list[object]:
    """Return how a robot's tool moves."""
    return [*robot.joint_names, *robot.tool_pose(_sampled(robot)[0])]


def limit_parts(robot: RobotModel) -> list[object]:
    """Return a robot's limits and motors."""
    limits = robot.limits
    return [
        limits.lower_position,
        limits.upper_position,
        limits.velocity,
        limits.effort,
        limits.acceleration,
        limits.jerk,
        *_optional_limits(limits),
        *_motor_parts(robot.motors),
    ]


def _optional_limits(limits: JointLimits) -> list[object]:
    """Return the limits that few robots have, each after its name."""
    parts: list[object] = []
    if np.isfinite(limits.tool_speed):
        parts += ["tool_speed", limits.tool_speed]
    if np.isfinite(limits.effort_rate).any():
        parts += ["effort_rate", limits.effort_rate]
    for law in limits.velocity_by_position:
        parts += ["velocity_by_position", dataclasses.astuple(law)]
    for point in limits.point_speed:
        parts += ["point_speed", point.link, point.position, point.speed]
    for one in limits.effort_ranges:
        parts += ["effort_range", one.joint, one.position, one.backwards, one.forwards]
    return parts


def _motor_parts(motors: JointMotors) -> list[object]:
    """Return what of motors is not in the inverse dynamics, each after its name."""
    parts: list[object] = []
    if motors.has_coulomb_friction:
        parts += ["coulomb_friction", motors.backwards_friction, motors.forwards_friction]
    if motors.has_curve.any():
        parts += ["motor_curve", motors.saturation_effort, motors.no_load_velocity]
    if motors.has_friction and motors.friction_uncertainty:
        parts += ["friction_uncertainty", motors.friction_uncertainty]
    return parts


def _optional_parts(holder: Any) -> list[object]:
    """Return the fields with a default that have another value, each after its name.

    So that a file without a new field keeps its hash.
    """
    parts: list[object] = []
    for field in dataclasses.fields(holder):
        value = getattr(holder, field.name)
        if field.default is not dataclasses.MISSING and not np.array_equal(value, field.default):
            parts += [field.name, value]
    return parts


def shape_parts(shape: ConvexShape) -> list[object]:
    """Return what a shape is, whatever the order of its vertices."""
    return [np.sort(shape.vertices, axis=0), shape.radius]


def _collision_parts(problem: PlanningProblem) -> list[object]:
    """Return what may collide and how near it may come; the order of names does not matter."""
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
    """Return clearances of pairs and contacts, where there are any, whatever their order."""
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
    """Return what solids are called and were made from, whatever their order."""
    by_name = sorted(solids, key=lambda solid: solid.name)
    return [what, *(part for solid in by_name for part in (solid.name, *_solid_parts(solid)))]


def _solid_parts(solid: Obstacle | AttachedSolid) -> list[object]:
    """Return what a solid was made from: its contents, or shapes that were given as such."""
    if solid.contents is not None:
        return [*_contents_parts([solid.contents])]
    return ["shapes", *sorted(_text(shape_parts(shape)) for shape in solid.shapes)]


def _contents_parts(contents: Iterable[SolidContents]) -> list[str]:
    """Return what solids were made from, whatever their order."""
    return sorted(
        _text([one.kind, one.sizes, one.mesh_hash, *_placement_parts(one)]) for one in contents
    )


def _placement_parts(contents: SolidContents) -> list[object]:
    """Return where a solid is; a ball may be turned at will."""
    placement = contents.placement
    return [placement[:3, 3] if contents.kind == "sphere" else placement]


def _link_poses(robot: RobotModel, link: str) -> tuple[FloatArray, FloatArray]:
    """Return rotations and positions of a link in some configurations."""
    rotation, position = robot.body_poses(_sampled(robot)[0])
    body, placement = robot.link_body[link], robot.link_placement[link]
    moved = np.einsum("nij,j->ni", rotation[:, body], placement[:3, 3])
    return rotation[:, body] @ placement[:3, :3], position[:, body] + moved


def _sampled(robot: RobotModel) -> FloatArray:
    """Return positions, velocities and accelerations of some states, shape (3, N, n)."""
    shape = (3, _CONFIGURATIONS, robot.joint_count)
    return np.random.default_rng(_SEED).uniform(-1, 1, shape)


def hash_of(parts: Iterable[object], digits: int) -> str:
    """Return a hash of texts, None and numbers, in hexadecimal digits."""
    return hashlib.sha256(_text(parts).encode()).hexdigest()[:digits]


def _text(parts: Iterable[object]) -> str:
    known = (str, type(None))
    return "".join(f"{part if isinstance(part, known) else _digits(part)};" for part in parts)


def _digits(values: object) -> str:
    # Adding zero turns -0.0 into 0.0; what is smaller than rounding errors is zero.
    flat = np.round(np.asarray(values, dtype=np.float64).ravel(), 9) + 0.0
    return " ".join(f"{value:.8e}" for value in flat)


# ---- Hashes of the parts of a problem: what differs between the one a file was made for and
# another.
#
# They tell parts apart for a note; whether two problems are the same, `fingerprint` says.

CARRIED = "carried solids"
_DIGITS = 8


def part_hashes(problem: PlanningProblem) -> dict[str, str]:
    """Return a hash of each part of a problem, by what messages call it."""
    robot = problem.robot
    payload = [] if robot.payload is None else list(dataclasses.astuple(robot.payload))
    touching = sorted({tuple(sorted(pair)) for pair in problem.ignore_collisions})
    parts: dict[str, list[object]] = {
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
    }
    return {name: hash_of(values, _DIGITS) for name, values in parts.items()}


def differing_parts(problem: PlanningProblem, stated: Mapping[str, str]) -> list[str]:
    """Return the parts in which a problem is not the one with the stated hashes."""
    own = part_hashes(problem)
    return [name for name, value in own.items() if stated.get(name, value) != value]


# ---- Hashes of cycles: is a motion that of this cycle, and if not, in what do they differ?
#
# They are those of its moves' problems, each as it is before it is known where it begins, and of
# what happens between them.

_CYCLE_DIGITS, _PART_DIGITS = 32, 8
_STEPS = "order of steps or dwells"
_OF_MOVE = " of move "


def cycle_hash(cycle: Cycle) -> str:
    """Return a hash of all that the certificate of a cycle's motion depends on."""
    problems = [problem_hash(cycle.problem_from_anywhere(k)) for k in range(len(cycle.legs))]
    return hash_of([*_step_parts(cycle), *problems], _CYCLE_DIGITS)


def cycle_part_hashes(cycle: Cycle) -> dict[str, str]:
    """Return a hash of each part of a cycle, by what messages call it."""
    parts = {_STEPS: hash_of(_step_parts(cycle), _PART_DIGITS)}
    for k, leg in enumerate(cycle.legs):
        of_leg = part_hashes(cycle.problem_from_anywhere(k))
        parts |= {f"{part}{_OF_MOVE}'{leg.name}'": value for part, value in of_leg.items()}
    return parts


def differing_cycle_parts(cycle: Cycle, stated: Mapping[str, str]) -> list[str]:
    """Return the parts in which a cycle is not the one with the stated hashes.

    What differs in every move is named once.
    """
    own = cycle_part_hashes(cycle)
    differing = [name for name, value in own.items() if stated.get(name, value) != value]
    moves: dict[str, list[str]] = {}
    for name in differing:
        part, _, move = name.partition(_OF_MOVE)
        moves.setdefault(part, []).append(move)
    return [
        _OF_MOVE.join(filter(None, (part, name)))
        for part, names in moves.items()
        for name in ([""] if len(names) == len(cycle.legs) else names)
    ]


def _step_parts(cycle: Cycle) -> list[object]:
    """Return which steps follow each other, and what of them is in no move's problem."""
    parts: list[object] = ["cycle", "closed" if cycle.closed else "open"]
    for step in cycle.steps:
        parts += [type(step).__name__, step.name]
        if isinstance(step, Event):
            parts.append(step.dwell)
    return parts


# ---- What a trajectory file says of where it comes from.


def origin(problem: PlanningProblem, method: str | None = None) -> dict[str, Any]:
    """Return the origin that a trajectory file states, as JSON values.

    Args:
        problem: The planning problem.
        method: How the trajectory was made; None: not known, and not stated.
    """
    return {
        **({} if method is None else {"method": method}),
        "tubeplanner_version": __version__,
        "problem": problem.name,
        "problem_hash": problem_hash(problem),
        "robot_hash": robot_hash(problem.robot),
        "part_hashes": part_hashes(problem),
    }
