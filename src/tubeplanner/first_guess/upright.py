"""Leans at which held parts are held at rest, whatever the yaw; problems that keep the tool within.

A part is held at rest or not by the direction that is upright in the tool frame alone. Directions
that hold it are a convex set of forces; first guesses keep a cone of them, about one axis.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.geometry.tube.rotation import RotationalTube, RotationBound
from tubeplanner.orientation import quaternion_of_matrix, rotation_matrix, rpy_of_matrix
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import ToolOffset
from tubeplanner.task.holding import margins_against, rest_margins
from tubeplanner.task.problem import PlanningProblem

# Share of the nominal that first guesses keep back at rest: the optimizer begins inside.
KEPT_AT_REST = 5e-3
_DIRECTIONS = 1000  # all around: 0.12 rad apart
_APART = 0.03  # [rad]: a contact's normal is the axis unless another allows as much more lean
_AROUND, _LEANS = 32, 181  # directions of lean, and leans, at which a cone's angle is looked for
_KEPT_FRACTION = 0.9  # of that angle
_SHARES = np.linspace(1, 0.1, 10)  # of a rotation tolerance
# Of the yaw from start to goal: half a turn between two orientations would have no direction.
_YAW_FRACTION = 0.99
_INSIDE = 1e-6  # [rad]


def holds(problem: PlanningProblem, q: FloatArray) -> bool:
    """Return True if the held parts stay at rest in all configurations (N, n), with a margin."""
    return bool((rest_margins(problem.robot, problem.holding, q) >= KEPT_AT_REST).all())


@dataclass(frozen=True, eq=False)
class UprightCone:
    """Directions in the tool frame that hold the parts at rest when they are upright."""

    axis: FloatArray  # shape (3,)
    angle: float  # [rad] from the axis


def upright_cone(problem: PlanningProblem, q: FloatArray) -> UprightCone | None:
    """Return the widest cone that contains what is upright in configurations (E, n).

    None where every direction holds the parts, or no cone contains all.
    """
    robot, holdings = problem.robot, problem.holding
    size = float(np.linalg.norm(robot.gravity))
    count = np.arange(_DIRECTIONS) + 0.5
    height, around = 1 - 2 * count / _DIRECTIONS, np.pi * (1 + 5**0.5) * count
    level = np.sqrt(1 - height**2)[:, None] * np.column_stack([np.cos(around), np.sin(around)])
    sphere = np.column_stack([level, height])
    lost = margins_against(holdings, size * sphere).min(axis=1) < KEPT_AT_REST
    if not lost.any():
        return None
    rotation, _ = robot.tool_pose(q)
    up = -robot.gravity / size @ (rotation @ robot.tool_offset.placement[:3, :3].T)
    normals = np.array([each.axes[:, 2] for each in holdings])
    axes = np.vstack([normals, -normals, sphere, up])
    angle = _angles(axes @ sphere[lost].T).min(axis=1)
    angle[_angles(axes @ up.T).max(axis=1) >= angle] = 0.0
    best = int(angle.argmax())
    likely = int(angle[: 2 * len(normals)].argmax())
    best = likely if angle[likely] >= angle[best] - _APART else best
    if not angle[best] > 0:
        return None
    axis, leans = axes[best], np.linspace(0, min(angle[best] + _APART, np.pi), _LEANS)
    turns = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    sideways = np.column_stack([np.cos(turns), np.sin(turns)]) @ _frame(axis)[:, :2].T
    directions = np.cos(leans)[:, None, None] * axis + np.sin(leans)[:, None, None] * sideways
    margins = margins_against(holdings, size * directions.reshape(-1, 3)).min(axis=1)
    held = (margins.reshape(_LEANS, _AROUND) >= KEPT_AT_REST).all(axis=1)
    return UprightCone(axis, float(leans[max(int(held.argmin()) - 1, 0)]))


def _angles(cosine: FloatArray) -> FloatArray:
    angles: FloatArray = np.arccos(np.clip(cosine, -1.0, 1.0))
    return angles


def _frame(z: FloatArray) -> FloatArray:
    """Return axes as columns (3, 3), the last a unit vector (3,)."""
    x = np.eye(3)[int(abs(z).argmin())]
    y = np.cross(z, x) / np.linalg.norm(np.cross(z, x))
    return np.column_stack([np.cross(y, z), y, z])


def kept_upright(
    problem: PlanningProblem, start: FloatArray, goal: FloatArray | None = None
) -> PlanningProblem | None:
    """Return a problem whose rotation tolerance, its own or another, holds the parts at rest.

    Without tolerance, the tool has another centre frame, z along the axis of the `UprightCone` of
    start and goal (n,), and is free about z. None where nothing is to be narrowed.
    """
    if not problem.holding:
        return None
    if problem.rotation is not None:
        return _narrowed(problem)
    ends = np.array([start] if goal is None else [start, goal])
    cone = upright_cone(problem, ends)
    if cone is None:
        return None
    offset, up = problem.robot.tool_offset, -problem.robot.gravity
    turned = ToolOffset(offset.position, rpy_of_matrix(_frame(cone.axis)))
    robot, tube = problem.robot.with_tool_offset(turned), problem.tube
    upright, leans = _upright(robot, ends, up / np.linalg.norm(up))
    between = upright[0].T @ upright[-1]
    yaw = _YAW_FRACTION * np.arctan2(between[1, 0], between[0, 0])
    before = arc_lengths(tube.points)
    angles = yaw * before / max(before[-1], 1e-300)
    turns = rotation_matrix(np.outer(angles, [0.0, 0.0, 1.0]))
    bound = max(_KEPT_FRACTION * cone.angle, leans + _INSIDE)
    rotated = replace(
        tube,
        orientations=np.array([quaternion_of_matrix(upright[0] @ turn) for turn in turns]),
        rotation_tolerance=((bound, bound, np.inf),) * tube.segment_count,
    )
    end = problem.goal if goal is None else goal
    with suppress(ProblemError):
        return replace(problem, robot=robot, tube=rotated, start=start, goal=end)
    return None


def _upright(robot: RobotModel, q: FloatArray, up: FloatArray) -> tuple[FloatArray, float]:
    """Return the tool's orientations, turned until z is upright (E, 3, 3), and the largest lean."""
    rotation, _ = robot.tool_pose(q)
    lean = _angles(rotation[:, :, 2] @ up)
    about = np.cross(rotation[:, :, 2], up)
    size = np.linalg.norm(about, axis=1)
    about = about * (lean / np.maximum(size, 1e-300))[:, None]
    return rotation_matrix(about) @ rotation, float(lean.max())


def _narrowed(problem: PlanningProblem) -> PlanningProblem | None:
    """Return the problem with its rotation tolerance narrowed until it holds the parts at rest.

    Segments whose reference orientation does not hold them keep theirs.
    """
    tube, rotation = problem.tube, problem.tube.rotation
    if rotation is None or tube.rotation_tolerance is None:
        return None
    shares = [_held_share(problem, rotation, k) for k in range(tube.segment_count)]
    if min(shares) == 1:
        return None
    bounds: list[RotationBound] = []
    for share, bound in zip(shares, tube.rotation_tolerance, strict=True):
        if isinstance(bound, tuple):
            x, y, z = (share * each for each in bound)
            bounds.append((x, y, z))
        else:
            bounds.append(share * bound)
    with suppress(ProblemError):
        return problem.with_tube(replace(tube, rotation_tolerance=tuple(bounds)))
    return None


def _held_share(problem: PlanningProblem, rotation: RotationalTube, segment: int) -> float:
    """Return the largest share of a segment's rotation tolerance that holds the parts at rest."""
    corners = np.array(list(np.ndindex(3, 3, 3))) - 1.0
    bounds = np.minimum(rotation.bounds[segment], np.pi)
    vectors = corners * bounds[:3]
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors = vectors * np.minimum(1, bounds[3] / np.maximum(size, 1e-300))
    references = rotation.reference_at(np.linspace(0, 1, 5), segment)
    offset = problem.robot.tool_offset.placement[:3, :3]
    for share in _SHARES.tolist():
        tools = references[:, None] @ rotation_matrix(share * vectors)
        up = (-problem.robot.gravity @ (tools @ offset.T)).reshape(-1, 3)
        if (margins_against(problem.holding, up) >= KEPT_AT_REST).all():
            return share
    return 1.0
