"""The velocities of frames that move with an arm, and how they change with its joints."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.model_joints import ModelJoints


def frame_velocities(
    model: pin.Model,
    data: pin.Data,
    joints: ModelJoints,
    frames: Sequence[int],
    q: FloatArray,
    v: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the velocities of the origins of F frames, and their derivatives.

    Args:
        model: The arm.
        data: Of the model; written to.
        joints: Those of the model.
        frames: Indices of the frames in the model.
        q: Configurations, shape (N, n).
        v: Velocities, shape (N, n).

    Returns:
        Velocities (F, N, 3) [m/s], and their derivatives by positions and by velocities, each
        (F, N, 3, n); in the base frame.
    """
    still, rates = np.zeros(model.nv), joints.rates(v)
    by_q, by_v = np.empty((2, len(frames), len(q), 6, model.nv))
    rotation = np.empty((len(frames), len(q), 3, 3))
    for i, (q_i, v_i) in enumerate(zip(joints.positions(q), rates, strict=True)):
        pin.computeForwardKinematicsDerivatives(model, data, q_i, v_i, still)
        for f, frame in enumerate(frames):
            # In LOCAL_WORLD_ALIGNED, Pinocchio's derivative leaves out that the frame turns.
            blocks = pin.getFrameVelocityDerivatives(model, data, frame, pin.LOCAL)
            by_q[f, i], by_v[f, i] = np.reshape(blocks, (2, 6, model.nv))
            rotation[f, i] = pin.updateFramePlacement(model, data, frame).rotation
    change, linear = rotation @ by_q[..., :3, :], rotation @ by_v[..., :3, :]
    velocity = np.einsum("fnij,nj->fni", linear, rates)
    turned = np.cross((rotation @ by_v[..., 3:, :]).swapaxes(2, 3), velocity[:, :, None])
    change += turned.swapaxes(2, 3)
    return velocity, joints.collected(change), joints.collected(linear)
