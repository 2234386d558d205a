"""Joints moved until the tool is where it is wanted, in many configurations at once.

Damped least squares (Nakamura & Hanafusa, "Inverse kinematic solutions with singularity
robustness", 1986). Where a target is out of reach, the tool comes as near as its joints let it;
nothing pulls joints that are redundant.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.native.library import LIBRARY
from tubeplanner.native.tool_moves import native_moved_tools
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotations import inverse_right_jacobian, rotation_vector

_MAX_STEPS = 20
_MAX_STEP = 0.4  # [rad or m] of any joint
_STILL = 1e-5  # [rad or m]: joints that move less come no nearer
_DAMPING = 1e-6  # of squared metres and radians
_SETTINGS = read_only([_MAX_STEPS, _MAX_STEP, _STILL, _DAMPING])


@dataclass(frozen=True, eq=False)
class WantedTools:
    """Where the tools of N configurations are wanted.

    Attributes:
        position: Shape (N, 3) [m].
        reference: Orientations against which they are turned, shape (N, 3, 3); None: any rotation.
        vector: By which rotation vectors, in the frame of the reference, shape (N, 3) [rad].
        components: Which components of these count: bool, shape (3,).
    """

    position: FloatArray
    reference: FloatArray | None = None
    vector: FloatArray | None = None
    components: BoolArray | None = None


def moved_tools(
    robot: RobotModel,
    q: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    wanted: WantedTools,
    close: FloatArray,
) -> FloatArray:
    """Return configurations whose tools are where they are wanted, or as near as they come.

    Args:
        robot: The arm.
        q: Where to start, shape (N, n), within the bounds.
        bounds: Lower and upper, shape (n,) each.
        wanted: Where the tools are wanted.
        close: How near is near enough, to the position [m] and to the rotation [rad], shape (2,).

    Returns:
        Shape (N, n).
    """
    turned = None
    if wanted.reference is not None and wanted.vector is not None:
        assert wanted.components is not None
        turned = wanted.reference, wanted.vector, wanted.components
    if LIBRARY.functions is not None:
        table, joints = robot.tool_joints, (q, *bounds)
        return native_moved_tools(table, _SETTINGS, close, joints, wanted.position, turned)
    q, live = q.copy(), np.arange(len(q))
    for _ in range(_MAX_STEPS):
        error, jacobian = _task(robot, q[live], wanted, live)
        off = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        unsettled = (off[0] > close[0]) | (off[1] > close[1])
        live, error, jacobian = live[unsettled], error[unsettled], jacobian[unsettled]
        if len(live) == 0:
            break
        moved = _stepped(q[live], bounds, error, jacobian)
        still = abs(moved - q[live]).max(axis=1) < _STILL
        q[live] = moved
        live = live[~still]
    return q


def _task(
    robot: RobotModel, q: FloatArray, wanted: WantedTools, live: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far tools are from where they are wanted, (N, c), and the Jacobian."""
    rotation, tool, jacobian = robot.tool_pose_jacobian(q)
    error, linear = wanted.position[live] - tool, jacobian[:, :3]
    if wanted.reference is None or wanted.vector is None:
        return error, linear
    vector = rotation_vector(wanted.reference[live].transpose(0, 2, 1) @ rotation)
    spin = inverse_right_jacobian(vector) @ rotation.transpose(0, 2, 1) @ jacobian[:, 3:]
    asked = wanted.components
    error = np.hstack([error, (wanted.vector[live] - vector)[:, asked]])
    return error, np.concatenate([linear, spin[:, asked]], axis=1)


def _stepped(
    q: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    error: FloatArray,
    jacobian: FloatArray,
) -> FloatArray:
    """Return configurations after a damped step; joints at a bound are not pushed outwards."""
    lower, upper = bounds
    for _ in range(2):
        gram = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(error.shape[1])
        pull = np.linalg.solve(gram, error[:, :, None])
        step = (jacobian.transpose(0, 2, 1) @ pull)[:, :, 0]
        outward = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
        jacobian = np.where(outward[:, None], 0.0, jacobian)
    largest = np.maximum(abs(step).max(axis=1, keepdims=True), _MAX_STEP)
    return np.clip(q + step * (_MAX_STEP / largest), lower, upper)
