"""A starter problem for a robot: placeholder limits, typical configuration, short tube."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.geometry.collision_checker import CollisionChecker, CollisionScene
from tubeplanner.geometry.tube.points import JointSign
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.robot.info import RobotInfo, robot_info
from tubeplanner.robot.loader import load_robot
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import LimitOverrides
from tubeplanner.studies.tubes.segment_measurement import folding_joints
from tubeplanner.task.problem import PlanningProblem

# By quantity and joint.
Placeholders: TypeAlias = dict[str, Any]


# ---- A first problem for a robot: a start in the middle of the ranges, and a short tube.
#
# Everything is found by trying: the answer is planned before it is handed out.

_STARTS, _TRIES = 4, 24
_HELD = 0.7  # fraction of the effort limits that holding the arm still may take
_RADIUS_FRACTION = 0.15  # of the shortest segment
_MIN_RADIUS = 0.002  # [m]
_SIGN_FROM = 0.1  # a joint nearer to zero [rad or m] may change its sign
_TIME_LIMIT = 30.0  # of one try [s]


@dataclass(frozen=True)
class StarterProblem:
    """A problem with a plan."""

    info: RobotInfo  # the robot's description
    placeholders: Placeholders  # limits that the URDF lacks, to be replaced by the maker's
    problem: PlanningProblem  # the problem
    result: PlanResult  # its plan
    reach: float  # largest distance of the tool from the first joint in typical configurations [m]


def starter_problem(
    urdf: str | Path,
    tool_frame: str | None = None,
    *,
    package_dirs: tuple[str, ...] = (),
    xacro_args: Mapping[str, object] | None = None,
    progress: Callable[[object], None] | None = None,
) -> StarterProblem:
    """Return a first problem for a robot by a path, `package://PACKAGE/...`, or `example:NAME`.

    Without a tool frame the likely link carries the tool. Package folders and the arguments of a
    URDF that ends in .xacro are as of `load_robot`. Progress is called with a message per route.

    Raises:
        RobotError: The URDF is malformed, no joint can move, or a mesh is missing.
        ProblemError: No start or no route was found; the message says why.
    """
    files: dict[str, Any] = {"package_dirs": package_dirs, "xacro_args": xacro_args}
    info = robot_info(urdf, tool_frame, **files)
    placeholders = placeholder_limits(info)
    limits = LimitOverrides(**placeholders)
    robot = load_robot(urdf, info.tool_frame, limits=limits, **files)
    scene = CollisionScene(robot, (), (), True, ())
    q = typical_configurations(robot)
    _, origins = robot.body_poses(q)
    reach = float(np.linalg.norm(robot.tool_position(q) - origins[:, 1], axis=1).max())
    routes = (
        (start, points)
        for start in islice(_starts(robot, scene.checker), _STARTS)
        for points in starter_routes(robot, start, reach)
    )
    refusals = []
    for number, (start, points) in enumerate(islice(routes, _TRIES), 1):
        if progress is not None:
            progress(f"trying route {number} of at most {_TRIES}")
        shortest = float(np.linalg.norm(np.diff(points, axis=0), axis=1).min())
        radius = max(_MIN_RADIUS, round(_RADIUS_FRACTION * shortest, 3))
        signs: dict[str, JointSign] = {
            robot.joint_names[joint]: "+" if start[joint] > 0 else "-"
            for joint in folding_joints(robot)
            if abs(start[joint]) > _SIGN_FROM
        }
        tube = Tube(points, radius, joint_signs=signs)
        problem = PlanningProblem(robot, tube, start, name="first", _scene=scene)
        result = plan(problem, PlanOptions(quality="fast", time_limit=_TIME_LIMIT))
        if result.succeeded:
            return StarterProblem(info, placeholders, problem, result, reach)
        refusals.append(result.message)
    route = f"{info.name} to {info.tool_frame}"
    if not refusals:
        raise ProblemError(
            f"{route}: no configuration was found in which no links overlap and gravity takes at "
            f"most {_HELD:.0%} of the effort limits; give limits and collision.ignore by hand"
        )
    raise ProblemError(
        f"{route}: of {len(refusals)} short routes from the middle of the joints' ranges none was "
        f"planned; the last: {refusals[-1]}; choose another --tool-frame"
    )


def _starts(robot: RobotModel, checker: CollisionChecker) -> Iterator[FloatArray]:
    """Yield configurations without self-collision that take little effort to hold."""
    for q in typical_configurations(robot).round(_DIGITS):
        effort = robot.gravity_effort(q)
        by_sign = np.array([robot.limits.effort_at(q, sign) for sign in (1.0, -1.0)])
        is_held = bool((abs(effort) <= _HELD * by_sign.min(axis=0)).all())
        if is_held and not checker.any_overlap(*robot.body_poses(q), checker.pairs):
            yield q


# ---- Placeholders for limits that a URDF lacks, until the maker's replace them.

_VELOCITY = {"prismatic": 0.25}  # [m/s]
_TURNING_VELOCITY = 1.0  # [rad/s]
# Where no effort is limited [rad/s^2 or m/s^2], [rad/s^3 or m/s^3].
_ACCELERATION, _JERK = 10.0, 500.0
# Factor on the effort that holds the arm still, and the least effort [N m or N].
_GRAVITY_TIMES, _MIN_EFFORT = 2.5, 5.0


def placeholder_limits(info: RobotInfo) -> Placeholders:
    """Return limits that a robot lacks.

    Where masses are missing, every effort is inf, and acceleration and jerk are limited instead.
    """
    missing = {
        quantity: [joint for joint in info.joints if joint.limits[quantity].is_missing]
        for quantity in ("position", "velocity", "effort")
    }
    arm = info.arm
    column = {name: k for k, name in enumerate(arm.joint_names)}
    ranges = np.column_stack([arm.limits.lower_position, arm.limits.upper_position]).round(3)
    weightless = not all(inertia.mass > 0 for inertia in arm.inertias[1:])
    # Efforts that hold and move the arm in any typical configuration.
    gravity = abs(arm.gravity_effort(typical_configurations(arm))).max(axis=0)
    rough = np.maximum(_GRAVITY_TIMES * gravity, _MIN_EFFORT)
    digits = 10.0 ** np.floor(np.log10(rough) - 1)
    efforts = (np.ceil(rough / digits) * digits).round(6).tolist()
    limits: dict[str, dict[str, Any]] = {
        "position": {j.name: ranges[column[j.name]].tolist() for j in missing["position"]},
        "velocity": {j.name: _VELOCITY.get(j.type, _TURNING_VELOCITY) for j in missing["velocity"]},
        "effort": {j.name: efforts[column[j.name]] for j in missing["effort"]},
    }
    if weightless:
        limits["effort"] = {joint.name: np.inf for joint in info.joints}
        for quantity, value in (("acceleration", _ACCELERATION), ("jerk", _JERK)):
            shortfall = [joint for joint in info.joints if joint.limits[quantity].is_missing]
            limits[quantity] = {joint.name: value for joint in shortfall}
    return {quantity: values for quantity, values in limits.items() if values}


# ---- Short routes of the tool that an arm can follow from a configuration: up, over and down.

_FRACTIONS = (0.25, 0.15, 0.08)  # of the reach: the rise, and half of the way over
_TURN = 0.25  # [rad or m]: a tool that moves on a line or surface does so in steps of joints
_MAX_TRAVEL = 0.9  # of the distance to the end of a joint's range
_STRAIGHT = 0.3  # least length of a unit vector's projection on the directions of the tool
_MIN_GAIN = 1e-3  # of the largest gain
_DIGITS = 4
_DIGITS_ON_A_SURFACE = 9  # where nothing reaches a point beside it


def starter_routes(robot: RobotModel, q: FloatArray, reach: float) -> Iterator[FloatArray]:
    """Yield reference points (m+1, 3) [m] from a configuration (n,), the longer routes first."""
    tool, jacobian = robot.tool_jacobian(q)
    directions, gains, _ = np.linalg.svd(jacobian[:3])
    free = directions[:, : int((gains > _MIN_GAIN * gains[0]).sum())]
    if free.shape[1] < 2:
        yield from _in_steps(robot, q, jacobian[:3], 1)
        return
    digits = _DIGITS if free.shape[1] == 3 else _DIGITS_ON_A_SURFACE
    up = _nearest(free, np.array([0.0, 0.0, 1.0]))
    rest = free - np.outer(up, up @ free)
    over = _nearest(rest, np.cross([0.0, 0.0, 1.0], tool))
    for fraction in _FRACTIONS:
        for along in (over, -over):
            for rise in (up, -up):
                steps = fraction * reach * np.array([0 * up, rise, rise + 2 * along, 2 * along])
                yield (tool + steps).round(digits)
    if free.shape[1] == 2:
        yield from _in_steps(robot, q, jacobian[:3], 2)


def _nearest(directions: FloatArray, target: FloatArray) -> FloatArray:
    """Return the unit vector (3,) in the span of directions (3, k) that is nearest to a target."""
    basis, gains, _ = np.linalg.svd(directions, full_matrices=False)
    basis = basis[:, gains > _MIN_GAIN]
    length = float(np.linalg.norm(target))
    projection = basis @ basis.T @ (target / length) if length > 0 else np.zeros(3)
    size = float(np.linalg.norm(projection))
    return projection / size if size > _STRAIGHT else basis[:, 0]


def _in_steps(
    robot: RobotModel, q: FloatArray, jacobian: FloatArray, count: int
) -> Iterator[FloatArray]:
    """Yield positions of the tool as the `count` joints that move the tool most take two steps."""
    strongest = np.argsort(-np.linalg.norm(jacobian, axis=0))[:count]
    for step in (_TURN, -_TURN):
        q_steps, limits = np.tile(q, (3, 1)), robot.limits
        q_steps[1:, strongest[0]] += step
        q_steps[2:, strongest[-1]] += step
        lower = q - _MAX_TRAVEL * (q - limits.lower_position)
        upper = q + _MAX_TRAVEL * (limits.upper_position - q)
        q_steps = np.clip(q_steps, lower, upper)
        yield robot.tool_position(q_steps).round(_DIGITS_ON_A_SURFACE)


# ---- Configurations in which an arm is seen and moves well: mid-range, bent, above ground.

_SAMPLES, _SEED = 500, 0
_FRACTION = 0.6  # of the distance from the middle of a range to its ends
_MAX_OFFSET = 1.5  # [rad or m] from the middle
_MIDDLE = 1.0  # largest distance of the middle from zero [rad or m]
_BELOW_GROUND = 0.2  # factor on the goodness of a configuration below the base
_NO_GAIN = 1e-6


def shown_configuration(arm: RobotModel, problem: PlanningProblem | None) -> FloatArray:
    """Return a configuration (n,) in which to show an arm: the problem's start, if it has one."""
    if problem is not None:
        try:
            return end_configuration(problem, problem.endpoints[0], 0)
        except Infeasible:
            pass
    best: FloatArray = typical_configurations(arm)[0]
    return best


def typical_configurations(arm: RobotModel) -> FloatArray:
    """Return configurations (K, n) within limits, the best first.

    A configuration is good if the tool moves and turns easily in every direction that the joints
    have: by the least singular values that are not always zero, of the Jacobian and of its first
    three rows. No joint should be below the base, in the frame of the root link.
    """
    arm = arm.in_root_frame()
    limits = arm.limits
    endless = np.isinf(limits.lower_position) | np.isinf(limits.upper_position)
    lower = np.where(endless, -np.pi, limits.lower_position)
    upper = np.where(endless, np.pi, limits.upper_position)
    middle = np.clip((lower + upper) / 2, np.maximum(lower, -_MIDDLE), np.minimum(upper, _MIDDLE))
    down = np.minimum(_FRACTION * (middle - lower), _MAX_OFFSET)
    up = np.minimum(_FRACTION * (upper - middle), _MAX_OFFSET)
    fraction = np.random.default_rng(_SEED).uniform(-1, 1, (_SAMPLES, arm.joint_count))
    q = middle + np.where(fraction < 0, fraction * down, fraction * up)
    tool, jacobian = arm.tool_jacobian(q)
    _, origins = arm.body_poses(q)
    lowest = np.minimum(origins[..., 2].min(axis=1), tool[:, 2])
    ground = min(0.0, float(origins[:, 1, 2].min()))  # the first joint may hang below the base
    factor = np.where(lowest < ground - _NO_GAIN, _BELOW_GROUND, 1.0)
    goodness = factor * _least_gain(jacobian[:, :3]) * _least_gain(jacobian)
    return q[np.argsort(-goodness, kind="stable")]


def _least_gain(jacobian: FloatArray) -> FloatArray:
    """Return the least singular values of matrices (K, rows, n) that are not always zero."""
    gains = np.linalg.svd(jacobian, compute_uv=False)
    rank = int(np.median((gains > _NO_GAIN).sum(axis=1)))
    return np.asarray(gains[:, max(rank, 1) - 1], dtype=np.float64)
