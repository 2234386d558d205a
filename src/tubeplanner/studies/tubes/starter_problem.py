"""A starter problem for a robot: placeholder limits, typical configuration, short tube."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.geometry.collision_checker import CollisionChecker, CollisionScene
from tubeplanner.geometry.tube.segment_values import JointSign
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.robot.info import RobotInfo, robot_info
from tubeplanner.robot.loader import load_robot
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import LimitOverrides
from tubeplanner.studies.tubes.branch_neighbourhood import folding_joints
from tubeplanner.task.problem import PlanningProblem

# ---- Configurations in which an arm is seen and moves well: mid-range, bent, above ground.

_SAMPLES, _SEED = 500, 0
_SHARE = 0.6  # of the way from the middle of a range to its ends
_MOST = 1.5  # [rad or m] from the middle
_MIDDLE = 1.0  # the middle is at most so far from zero [rad or m]
_BELOW_GROUND = 0.2  # what a configuration below the base counts
_NO_GAIN = 1e-6


def typical_configurations(arm: RobotModel) -> FloatArray:
    """Return configurations (K, n) within limits, the best first.

    Good is where every direction in which the joints can move and turn the tool is easy, by the
    least singular values that are not always zero, of the Jacobian and of its first three rows, and
    no joint is below the base, however it stands.
    """
    arm = arm.in_root_frame()
    limits = arm.limits
    endless = np.isinf(limits.lower_position) | np.isinf(limits.upper_position)
    lower = np.where(endless, -np.pi, limits.lower_position)
    upper = np.where(endless, np.pi, limits.upper_position)
    middle = np.clip((lower + upper) / 2, np.maximum(lower, -_MIDDLE), np.minimum(upper, _MIDDLE))
    down = np.minimum(_SHARE * (middle - lower), _MOST)
    up = np.minimum(_SHARE * (upper - middle), _MOST)
    share = np.random.default_rng(_SEED).uniform(-1, 1, (_SAMPLES, arm.joint_count))
    q = middle + np.where(share < 0, share * down, share * up)
    return q[np.argsort(-_goodness(arm, q), kind="stable")]


def _goodness(arm: RobotModel, q: FloatArray) -> FloatArray:
    """Return how good configurations are, shape (K,)."""
    tool, jacobian = arm.tool_jacobian(q)
    _, origins = arm.body_poses(q)
    lowest = np.minimum(origins[..., 2].min(axis=1), tool[:, 2])
    ground = min(0.0, float(origins[:, 1, 2].min()))  # the first joint may hang below the base
    share = np.where(lowest < ground - _NO_GAIN, _BELOW_GROUND, 1.0)
    return share * _least_gain(jacobian[:, :3]) * _least_gain(jacobian)


def _least_gain(jacobian: FloatArray) -> FloatArray:
    """Return the least singular values of matrices (K, rows, n) that are not always zero."""
    gains = np.linalg.svd(jacobian, compute_uv=False)
    rank = int(np.median((gains > _NO_GAIN).sum(axis=1)))
    return np.asarray(gains[:, max(rank, 1) - 1], dtype=np.float64)


# ---- Limits that stand where a URDF has none, until the maker's replace them.

# By quantity and joint.
Placeholders: TypeAlias = dict[str, Any]

_VELOCITY = {"prismatic": 0.25}  # [m/s]
_TURNING_VELOCITY = 1.0  # [rad/s]
# Efforts are so many times what holds the arm still, and at least so much [N m or N].
_GRAVITY_TIMES, _LEAST_EFFORT = 2.5, 5.0


def placeholder_limits(info: RobotInfo) -> Placeholders:
    """Return limits for what a robot lacks; inf for every effort where masses are missing."""
    missing = {
        quantity: [joint for joint in info.joints if joint.limits[quantity].is_missing]
        for quantity in ("position", "velocity", "effort")
    }
    arm = info.arm
    column = {name: k for k, name in enumerate(arm.joint_names)}
    ranges = np.column_stack([arm.limits.lower_position, arm.limits.upper_position]).round(3)
    weightless = not all(inertia.mass > 0 for inertia in arm.inertias[1:])
    efforts = _efforts(info)
    given: dict[str, dict[str, Any]] = {
        "position": {j.name: ranges[column[j.name]].tolist() for j in missing["position"]},
        "velocity": {j.name: _VELOCITY.get(j.type, _TURNING_VELOCITY) for j in missing["velocity"]},
        "effort": {joint.name: efforts[joint.name] for joint in missing["effort"]},
    }
    if weightless:
        given["effort"] = {joint.name: np.inf for joint in info.joints}
    return {quantity: values for quantity, values in given.items() if values}


def _efforts(info: RobotInfo) -> dict[str, float]:
    """Return efforts that hold an arm in any typical configuration and move it, by joint."""
    held = abs(info.arm.gravity_effort(typical_configurations(info.arm))).max(axis=0)
    rough = np.maximum(_GRAVITY_TIMES * held, _LEAST_EFFORT)
    digits = 10.0 ** np.floor(np.log10(rough) - 1)
    rounded = (np.ceil(rough / digits) * digits).round(6)
    return dict(zip(info.arm.joint_names, rounded.tolist(), strict=True))


# ---- The configuration in which an arm is shown: a problem's start, or one that shows it well.


def shown_configuration(arm: RobotModel, problem: PlanningProblem | None) -> FloatArray:
    """Return a configuration (n,) in which to show an arm.

    Args:
        arm: The arm.
        problem: Whose start it is, if there is one, and its seed or pose leads there.
    """
    if problem is not None:
        try:
            return end_configuration(problem, problem.endpoints[0], 0)
        except Infeasible:
            pass
    best: FloatArray = typical_configurations(arm)[0]
    return best


# ---- Short routes of the tool that an arm can follow from a configuration: up, over and down.

_SHARES = (0.25, 0.15, 0.08)  # of the reach: how far up, and half of how far over
_TURN = 0.25  # [rad or m]: a tool that moves on a line or surface does so in steps of joints
_STRAIGHT = 0.3  # of a unit vector that must be left of it where the tool can move
_MIN_GAIN = 1e-3  # of the largest gain
_DIGITS = 4
_DIGITS_ON_A_SURFACE = 9  # where nothing reaches a point beside it


def starter_routes(robot: RobotModel, q: FloatArray, reach: float) -> Iterator[FloatArray]:
    """Yield reference points, shape (m+1, 3) [m], the longer routes first.

    Args:
        robot: The arm.
        q: The configuration where they begin, shape (n,).
        reach: How far from its first joint the tool gets [m].
    """
    tool, jacobian = robot.tool_jacobian(q)
    moved, gains, _ = np.linalg.svd(jacobian[:3])
    free = moved[:, : int((gains > _MIN_GAIN * gains[0]).sum())]
    if free.shape[1] < 2:
        yield from _in_steps(robot, q, jacobian[:3], 1)
        return
    digits = _DIGITS if free.shape[1] == 3 else _DIGITS_ON_A_SURFACE
    up = _nearest(free, np.array([0.0, 0.0, 1.0]))
    rest = free - np.outer(up, up @ free)
    over = _nearest(rest, np.cross([0.0, 0.0, 1.0], tool))
    for share in _SHARES:
        for along in (over, -over):
            for rise in (up, -up):
                steps = share * reach * np.array([0 * up, rise, rise + 2 * along, 2 * along])
                yield (tool + steps).round(digits)
    if free.shape[1] == 2:
        yield from _in_steps(robot, q, jacobian[:3], 2)


def _nearest(directions: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the unit vector (3,) nearest to a wanted one among what directions (3, k) span."""
    basis, gains, _ = np.linalg.svd(directions, full_matrices=False)
    basis = basis[:, gains > _MIN_GAIN]
    length = float(np.linalg.norm(wanted))
    found = basis @ basis.T @ (wanted / length) if length > 0 else np.zeros(3)
    size = float(np.linalg.norm(found))
    return found / size if size > _STRAIGHT else basis[:, 0]


def _in_steps(
    robot: RobotModel, q: FloatArray, jacobian: FloatArray, count: int
) -> Iterator[FloatArray]:
    """Yield where the tool is as the joints that move it most, one or two, take two steps."""
    strongest = np.argsort(-np.linalg.norm(jacobian, axis=0))[:count]
    for step in (_TURN, -_TURN):
        moved = np.tile(q, (3, 1))
        moved[1:, strongest[0]] += step
        moved[2:, strongest[-1]] += step
        yield robot.tool_position(moved).round(_DIGITS_ON_A_SURFACE)


# ---- A first problem for a robot: a start in the middle of things, and a short tube that is
# planned.
#
# Everything is found by trying: the answer is planned before it is handed out.

_STARTS, _TRIES = 4, 24
_HELD = 0.7  # share of the effort limits that holding the arm still may take
_RADIUS_SHARE = 0.15  # of the shortest segment
_LEAST_RADIUS = 0.002  # [m]
_SIGN_FROM = 0.1  # a joint nearer to zero [rad or m] may change its sign
_TIME_LIMIT = 30.0  # of one try [s]


@dataclass(frozen=True)
class StarterProblem:
    """A problem that plans as it stands.

    Attributes:
        info: What is in its robot.
        placeholders: Limits that the URDF lacks, to be replaced by the maker's.
        problem: The problem.
        result: Its plan.
        reach: How far from its first joint the tool was seen [m].
    """

    info: RobotInfo
    placeholders: Placeholders
    problem: PlanningProblem
    result: PlanResult
    reach: float


def starter_problem(
    urdf: str | Path,
    tool_frame: str | None = None,
    *,
    package_dirs: tuple[str, ...] = (),
    progress: Callable[[object], None] | None = None,
) -> StarterProblem:
    """Return a first problem for a robot.

    Args:
        urdf: A path, `package://PACKAGE/...`, or `example:NAME`.
        tool_frame: The link that carries the tool; None: the likely one.
        package_dirs: Further folders that hold the packages of `package://` names.
        progress: Called with what is being tried.

    Raises:
        RobotError: The URDF is malformed, no joint can move, or a mesh is missing.
        ProblemError: No start or no route was found; the message says why.
    """
    info = robot_info(urdf, tool_frame, package_dirs=package_dirs)
    placeholders = placeholder_limits(info)
    limits = LimitOverrides(**placeholders)
    robot = load_robot(urdf, info.tool_frame, limits=limits, package_dirs=package_dirs)
    scene = CollisionScene(robot, (), (), True, ())
    reach = _reach(robot)
    refusals = []
    for number, (q, points) in enumerate(_tries(robot, scene.checker, reach), 1):
        if progress is not None:
            progress(f"trying route {number} of at most {_TRIES}")
        problem = PlanningProblem(robot, _tube(robot, q, points), q, name="first", _scene=scene)
        result = plan(problem, PlanOptions(quality="fast", time_limit=_TIME_LIMIT))
        if result.succeeded:
            return StarterProblem(info, placeholders, problem, result, reach)
        refusals.append(result.message)
    raise ProblemError(_nothing_found(info, refusals))


def _reach(robot: RobotModel) -> float:
    """Return how far from its first joint the tool is in any typical configuration [m]."""
    q = typical_configurations(robot)
    _, origins = robot.body_poses(q)
    return float(np.linalg.norm(robot.tool_position(q) - origins[:, 1], axis=1).max())


def _tries(
    robot: RobotModel, checker: CollisionChecker, reach: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield starts with routes from there, the most promising first."""
    every = (
        (q, points)
        for q in islice(_starts(robot, checker), _STARTS)
        for points in starter_routes(robot, q, reach)
    )
    yield from islice(every, _TRIES)


def _starts(robot: RobotModel, checker: CollisionChecker) -> Iterator[FloatArray]:
    """Yield configurations that are free of the arm itself and held with ease."""
    for q in typical_configurations(robot).round(_DIGITS):
        effort = robot.gravity_effort(q)
        ways = np.array([robot.limits.effort_at(q, way) for way in (1.0, -1.0)])
        is_held = bool((abs(effort) <= _HELD * ways.min(axis=0)).all())
        if is_held and not checker.any_overlap(*robot.body_poses(q), checker.pairs):
            yield q


def _tube(robot: RobotModel, q: FloatArray, points: FloatArray) -> Tube:
    """Return the tube along a route, in the configuration of its start."""
    shortest = float(np.linalg.norm(np.diff(points, axis=0), axis=1).min())
    radius = max(_LEAST_RADIUS, round(_RADIUS_SHARE * shortest, 3))
    signs: dict[str, JointSign] = {
        robot.joint_names[joint]: "+" if q[joint] > 0 else "-"
        for joint in folding_joints(robot)
        if abs(q[joint]) > _SIGN_FROM
    }
    return Tube(points, radius, joint_signs=signs)


def _nothing_found(info: RobotInfo, refusals: Sequence[str]) -> str:
    what = f"{info.name} to {info.tool_frame}"
    if not refusals:
        return (
            f"{what}: no configuration was found in which no links overlap and gravity takes at "
            f"most {_HELD:.0%} of the effort limits; give limits and collision.ignore by hand"
        )
    return (
        f"{what}: of {len(refusals)} short routes from the middle of the joints' ranges none was "
        f"planned; the last: {refusals[-1]}; choose another --tool-frame"
    )
