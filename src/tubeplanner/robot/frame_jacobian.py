"""The pose of a frame that moves with an arm, and its Jacobian."""

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.model_joints import ModelJoints


def frame_jacobian(
    model: pin.Model, data: pin.Data, joints: ModelJoints, frame: int, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rotation, the position and the Jacobian of a frame.

    Args:
        model: The arm.
        data: Of the model; written to.
        joints: Those of the model.
        frame: Index of the frame in the model.
        q: Configurations, shape (N, n).

    Returns:
        Rotations (N, 3, 3), positions (N, 3) [m] and Jacobians (N, 6, n), linear rows first, in the
        base frame.
    """
    rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    shape = (6, model.nv)
    jacobian = np.empty((len(q), *shape))
    placement = data.oMf[frame]
    for i, q_i in enumerate(joints.positions(q)):
        columns = pin.computeFrameJacobian(model, data, q_i, frame, pin.LOCAL_WORLD_ALIGNED)
        jacobian[i] = columns.reshape(shape)  # one column comes back flat
        pin.updateFramePlacement(model, data, frame)
        rotation[i], position[i] = placement.rotation, placement.translation
    return rotation, position, joints.collected(jacobian)
