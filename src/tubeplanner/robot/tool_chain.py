"""The tool centre point of an arm and its Jacobian, in many configurations."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.native.kinematics import native_last_jacobians, native_last_poses
from tubeplanner.native.library import LIBRARY
from tubeplanner.robot.body_chain import BodyChain
from tubeplanner.robot.cross_product import cross_product
from tubeplanner.robot.frame_jacobian import frame_jacobian
from tubeplanner.robot.model_joints import ModelJoints
from tubeplanner.robot.pinocchio_model import Scratch

# From so many configurations on, arrays are quicker than Pinocchio called for each of them.
_MANY = 64


@dataclass(frozen=True, eq=False)
class ToolChain:
    """What moves the tool centre point.

    Attributes:
        model: The arm.
        scratch: Of the model; written to.
        joints: Those of the model.
        chain: Its bodies.
        carries: Whether joints move bodies, shape (bodies, M).
        frame: Index of the tool centre point among the model's frames.
    """

    model: pin.Model
    scratch: Scratch
    joints: ModelJoints
    chain: BodyChain
    carries: BoolArray
    frame: int

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, 3, 3) and positions (N, 3) [m] in configurations (N, n)."""
        if LIBRARY.functions is not None:
            return native_last_poses(self.joint_table, q)
        if len(q) >= _MANY:
            return self._of_bodies(*self.chain.poses(self.joints.positions(q)))
        model, data, frame = self.model, self.scratch.data, self.frame
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        placement = data.oMf[frame]
        for i, q_i in enumerate(self.joints.positions(q)):
            pin.forwardKinematics(model, data, q_i)
            pin.updateFramePlacement(model, data, frame)
            rotation[i], position[i] = placement.rotation, placement.translation
        return rotation, position

    def jacobians(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rotations, positions and Jacobians (N, 6, n) in configurations (N, n)."""
        if LIBRARY.functions is not None:
            return native_last_jacobians(self.joint_table, q)
        if len(q) >= _MANY:
            return self._jacobians_of_many(q)
        return frame_jacobian(self.model, self.scratch.data, self.joints, self.frame, q)

    @cached_property
    def joint_table(self) -> FloatArray:
        """The joints that move it, as `native.kinematics` takes them; a fixed one is the last."""
        tool, joints = self.model.frames[self.frame], self.joints
        moving = np.flatnonzero(self.carries[tool.parentJoint])
        line = self.chain.line(moving + 1, tool.placement.rotation, tool.placement.translation)
        rules = (joints.planned, joints.multiplier, joints.offset)
        return line.joint_table(*(np.append(rule[moving], 0) for rule in rules))

    def _of_bodies(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `poses` from those of the bodies."""
        tool = self.model.frames[self.frame]
        turned = rotation[:, tool.parentJoint]
        placed = turned @ tool.placement.translation + position[:, tool.parentJoint]
        return turned @ tool.placement.rotation, placed

    def _jacobians_of_many(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        rotation, position = self.chain.poses(self.joints.positions(q))
        turned, tool = self._of_bodies(rotation, position)
        carried = self.carries[self.model.frames[self.frame].parentJoint]
        axis = (rotation[:, 1:] @ self.chain.axes[:, :, None])[..., 0] * carried[:, None]
        turns = self.joints.turns[:, None]
        linear = np.where(turns, cross_product(axis, tool[:, None] - position[:, 1:]), axis)
        columns = np.concatenate([linear, np.where(turns, axis, 0.0)], axis=2)
        return turned, tool, self.joints.collected(columns.swapaxes(1, 2))
