"""A first problem for a robot: a start in the middle of things, and a short tube that is planned.

Everything is found by trying: the answer is planned before it is handed out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.collision_scene import CollisionScene
from tubeplanner.errors import ProblemError
from tubeplanner.measurement.folding_joints import folding_joints
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.robot_info import RobotInfo, robot_info
from tubeplanner.robot.robot_loader import load_robot
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.typical_configurations import typical_configurations
from tubeplanner.tube.joint_ranges import JointSign
from tubeplanner.tube.tube import Tube
from tubeplanner.tube_sources.placeholder_limits import Placeholders, placeholder_limits
from tubeplanner.tube_sources.starter_route import starter_routes

_STARTS, _TRIES = 4, 24
_HELD = 0.7  # share of the effort limits that holding the arm still may take
_RADIUS_SHARE = 0.15  # of the shortest segment
_LEAST_RADIUS = 0.002  # [m]
_SIGN_FROM = 0.1  # a joint nearer to zero [rad or m] may change its sign
_TIME_LIMIT = 30.0  # of one try [s]
_DIGITS = 4


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
