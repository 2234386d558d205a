"""A robot arm for N samples at once: kinematics, dynamics, limits.

Frames: the base frame is the frame of the URDF's root link; every position, rotation and Jacobian
is expressed in it. A configuration is a plain vector of n joint values in group order; continuous
joints are not wrapped.
"""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_description
from tubeplanner.robot.joint_limits import JointLimits, LimitOverrides, resolve_limits
from tubeplanner.robot.pinocchio_model import (
    Payload,
    ToolOffset,
    add_tool_centre_point,
    build_model,
    link_placements,
    planning_group,
)
from tubeplanner.robot.urdf import UrdfDescription, joint_id, read_urdf

EARTH_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2]


def load_robot(
    urdf: str | Path,
    tool_frame: str,
    *,
    joints: Sequence[str] | None = None,
    locked_joints: Mapping[str, float] | None = None,
    tool_offset: ToolOffset | None = None,
    gravity: Sequence[float] = EARTH_GRAVITY,
    payload: Payload | None = None,
    limits: LimitOverrides | None = None,
    package_dirs: Sequence[str | Path] = (),
    directory: str | Path = ".",
) -> "RobotModel":
    """Load the arm that ends at a link of a URDF.

    Args:
        urdf: A path, `package://PACKAGE/...`, or `example:NAME`.
        tool_frame: Any link; with the tool offset it gives the point that must stay in the tube.
        joints: Planning group, in the order wanted; default: the movable joints from the root to
            the tool frame, in chain order.
        locked_joints: Values of joints outside the group, by name [rad or m]; default 0, moved
            into the limits. A mimic joint follows its master.
        tool_offset: Tool centre point in the tool frame; default: its origin.
        gravity: In the base frame [m/s^2].
        payload: Carried mass; default: none.
        limits: What replaces the URDF's limits; default: nothing.
        package_dirs: Further folders that hold the packages of `package://` names.
        directory: Where relative paths start.

    Raises:
        RobotError: The description cannot be planned with; the message says why.
    """
    if np.shape(gravity) != (3,) or not np.isfinite(gravity).all():
        raise RobotError(f"robot.gravity {list(gravity)} must be three finite numbers [m/s^2]")
    directory = Path(directory)
    folders = tuple(directory / folder for folder in package_dirs)
    description = read_urdf(find_description(urdf, directory, folders))
    group = planning_group(description, tool_frame, joints)
    return RobotModel(
        description,
        tuple(group),
        tool_frame,
        tool_offset or ToolOffset(),
        resolve_limits(description, group, limits or LimitOverrides()),
        folders,
        dict(locked_joints or {}),
        tuple(gravity),
        payload,
    )


@dataclass(frozen=True)
class BodyInertia:
    """Mass properties of a body that bounds on norms need.

    Attributes:
        mass: [kg].
        com_distance: Distance of the centre of mass from the body's origin [m].
        moment: Largest principal moment about the centre of mass [kg m^2].
    """

    mass: float
    com_distance: float
    moment: float


class _Scratch(threading.local):
    """What Pinocchio writes its results into, one for every thread."""

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()
        self.pool = pin.ModelPool(model, 1)


class RobotModel:
    """An arm of n joints and its bodies; made by `load_robot`.

    A body is everything that moves as one: body 0 is fixed to the base, body j > 0 is what hangs
    rigidly from one of the n joints. Several threads may use one model; it pickles by content, the
    URDF's text included.

    Attributes:
        name: The robot's name.
        urdf: Its description.
        package_dirs: Folders searched for `package://` meshes.
        joint_names: The n joints, in group order.
        tool_frame: Name of the tool frame.
        gravity: Shape (3,), base frame [m/s^2].
        limits: Limits of the joints.
        link_body: Body of every link of the URDF, by name.
        link_placement: Pose of every link in its body's frame, by name, shape (4, 4).
    """

    def __init__(
        self,
        urdf: UrdfDescription,
        joint_names: tuple[str, ...],
        tool_frame: str,
        tool_offset: ToolOffset,
        limits: JointLimits,
        package_dirs: tuple[Path, ...],
        locked_joints: Mapping[str, float],
        gravity: Sequence[float],
        payload: Payload | None,
    ) -> None:
        model = build_model(
            urdf,
            joint_names,
            tool_frame,
            locked_joints=locked_joints,
            gravity=gravity,
            payload=payload,
            needs_masses=bool(np.isfinite(limits.effort).any()),
        )
        self._others = (tool_offset, locked_joints, payload)
        self.name = urdf.name
        self.urdf = urdf
        self.package_dirs = package_dirs
        self.joint_names = joint_names
        self.tool_frame = tool_frame
        self.gravity = read_only(model.gravity.linear)
        self.limits = limits
        self.link_body, self.link_placement = link_placements(urdf, model)
        self._model = model
        self._tool_id = add_tool_centre_point(model, tool_frame, tool_offset)
        # A Data made before the last edit of its model corrupts memory without a word.
        self._scratch = _Scratch(model)
        # Pinocchio orders joints its own way: q_model = q[:, to_model], q = q_model[:, to_group].
        self._to_model = np.array(
            [self.joint_names.index(name.removeprefix(joint_id(""))) for name in model.names[1:]]
        )
        self._to_group = np.argsort(self._to_model)

    def __reduce__(self) -> tuple[Any, ...]:
        tool_offset, locked_joints, payload = self._others
        return RobotModel, (
            self.urdf,
            self.joint_names,
            self.tool_frame,
            tool_offset,
            self.limits,
            self.package_dirs,
            locked_joints,
            tuple(self.gravity.tolist()),
            payload,
        )

    @property
    def joint_count(self) -> int:
        """Number n of joints."""
        return len(self.joint_names)

    @property
    def body_count(self) -> int:
        """Number of bodies, the fixed base included."""
        return int(self._model.njoints)

    def tool_position(self, q: FloatArray) -> FloatArray:
        """Return the tool centre point [m]: q of shape (N, n) gives (N, 3)."""
        return self.tool_pose(q)[1]

    def tool_pose(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (N, 3, 3) and position (N, 3) [m] of the tool centre point."""
        model, data, tool_id = self._model, self._scratch.data, self._tool_id
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        placement = data.oMf[tool_id]
        for i, q_i in enumerate(self._model_order(q)):
            pin.forwardKinematics(model, data, q_i)
            pin.updateFramePlacement(model, data, tool_id)
            rotation[i], position[i] = placement.rotation, placement.translation
        return rotation, position

    def tool_jacobian(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tool centre point (N, 3) [m] and its Jacobian (N, 6, n).

        Rows 0-2 give the linear velocity of the point [m/s], rows 3-5 the angular velocity
        [rad/s], both in the base frame.
        """
        return self.tool_pose_jacobian(q)[1:]

    def tool_pose_jacobian(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rotation (N, 3, 3), position (N, 3) [m] and Jacobian (N, 6, n) of that point."""
        model, data, tool_id = self._model, self._scratch.data, self._tool_id
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        shape = (6, self.joint_count)
        jacobian = np.empty((len(q), *shape))
        placement = data.oMf[tool_id]
        for i, q_i in enumerate(self._model_order(q)):
            columns = pin.computeFrameJacobian(model, data, q_i, tool_id, pin.LOCAL_WORLD_ALIGNED)
            jacobian[i] = columns.reshape(shape)  # one column comes back flat
            pin.updateFramePlacement(model, data, tool_id)
            rotation[i], position[i] = placement.rotation, placement.translation
        return rotation, position, jacobian[:, :, self._to_group]

    def body_poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, bodies, 3, 3) and origins (N, bodies, 3) [m] of all bodies."""
        model, data = self._model, self._scratch.data
        rotation = np.empty((len(q), self.body_count, 3, 3))
        position = np.empty((len(q), self.body_count, 3))
        placements = list(enumerate(data.oMi))
        for i, q_i in enumerate(self._model_order(q)):
            pin.forwardKinematics(model, data, q_i)
            for j, placement in placements:
                rotation[i, j], position[i, j] = placement.rotation, placement.translation
        return rotation, position

    def point_jacobian(
        self, rotation: FloatArray, position: FloatArray, body: IntArray, point: FloatArray
    ) -> FloatArray:
        """Return how points that move with bodies move with the joints.

        Args:
            rotation: From `body_poses`, shape (N, bodies, 3, 3).
            position: Likewise, shape (N, bodies, 3) [m].
            body: Which body carries each point, shape (N,).
            point: In the base frame, shape (N, 3) [m].

        Returns:
            Shape (N, 3, n) [m/rad or 1]. (Siciliano et al., "Robotics", 2009, equation 3.30.)
        """
        carrier = self._to_group + 1  # the body that each joint moves
        axis = np.einsum("njab,jb->nja", rotation[:, carrier], self._joint_axes)
        turned = np.cross(axis, point[:, None] - position[:, carrier])
        columns = np.where(self.revolute[:, None], turned, axis)
        moved: FloatArray = columns * self.joint_moves_body[body][:, :, None]
        return moved.transpose(0, 2, 1)

    def inverse_dynamics(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the joint efforts [N m or N] that a trajectory needs (recursive Newton-Euler).

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n).
            a: Accelerations, shape (N, n).

        Returns:
            Shape (N, n). Friction and damping of the URDF are not included.
        """
        columns = [self._model_order(array).T for array in (q, v, a)]
        # One thread: two were measured up to 50 times slower on a machine with a busy core.
        tau = pin.rneaInParallel(1, self._scratch.pool, *columns)
        # A single row or column comes back one-dimensional.
        tau = np.reshape(tau, (self.joint_count, len(q)))
        return np.ascontiguousarray(tau[self._to_group].T)

    def gravity_effort(self, q: FloatArray) -> FloatArray:
        """Return the joint efforts (N, n) [N m or N] that hold the arm still against gravity."""
        zero = np.zeros_like(q)
        if not self.gravity.any():
            return zero
        return self.inverse_dynamics(q, zero, zero)

    def inverse_dynamics_derivatives(
        self, q: FloatArray, v: FloatArray, a: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return d tau / d q, d tau / d v and d tau / d a, each (N, effort joint, n)."""
        model, data = self._model, self._scratch.data
        derivatives = np.empty((3, len(q), self.joint_count, self.joint_count))
        for i, (q_i, v_i, a_i) in enumerate(
            zip(*(self._model_order(array) for array in (q, v, a)), strict=True)
        ):
            # The result is a set of views into data, overwritten by the next call: copied here.
            blocks = pin.computeRNEADerivatives(model, data, q_i, v_i, a_i)
            derivatives[:, i] = np.reshape(blocks, (3, self.joint_count, self.joint_count))
        by_group = derivatives[:, :, self._to_group][:, :, :, self._to_group]
        return by_group[0], by_group[1], by_group[2]

    @cached_property
    def joint_moves_body(self) -> BoolArray:
        """Whether a joint moves a body, shape (bodies, n)."""
        moves = np.zeros((self.body_count, self.joint_count), dtype=bool)
        for body in range(1, self.body_count):
            for joint in self._supports(body):
                moves[body, self._to_model[joint - 1]] = True
        return moves

    @cached_property
    def revolute(self) -> BoolArray:
        """Whether a joint turns (rather than slides), shape (n,)."""
        kinds = [self.urdf.joints[name].type != "prismatic" for name in self.joint_names]
        return np.array(kinds)

    @cached_property
    def lever_arm(self) -> FloatArray:
        """Upper bound on the distance from a joint's axis to a body's origin [m].

        Shape (bodies, n), 0 where the joint does not move the body; the sum of the distances
        between consecutive joint origins, and of the whole travel of sliding joints between.
        """
        lever = np.zeros((self.body_count, self.joint_count))
        for body in range(1, self.body_count):
            reach = 0.0
            for joint in self._supports(body):
                group_index = self._to_model[joint - 1]
                if not self.revolute[group_index]:
                    reach += float(self._travel[group_index])
                lever[body, group_index] = reach
                reach += float(np.linalg.norm(self._model.jointPlacements[joint].translation))
        return read_only(lever)

    @cached_property
    def body_parents(self) -> IntArray:
        """The body that carries each body, shape (bodies,); the base carries itself."""
        return np.array([self._model.parents[body] for body in range(self.body_count)])

    @cached_property
    def body_joints(self) -> IntArray:
        """The joint that moves each body, as group index, shape (bodies,); -1 for the base."""
        return np.concatenate([[-1], self._to_model])

    @cached_property
    def body_offsets(self) -> FloatArray:
        """Distance of each body's origin from its parent's, joints at zero, shape (bodies,) [m]."""
        placements = [self._model.jointPlacements[body] for body in range(self.body_count)]
        return read_only([np.linalg.norm(placement.translation) for placement in placements])

    @cached_property
    def inertias(self) -> tuple[BodyInertia, ...]:
        """Mass properties of all bodies, the base's left at zero."""
        found = [BodyInertia(0.0, 0.0, 0.0)]
        for body in range(1, self.body_count):
            inertia = self._model.inertias[body]
            moment = float(np.linalg.eigvalsh(inertia.inertia).max())
            found.append(
                BodyInertia(float(inertia.mass), float(np.linalg.norm(inertia.lever)), moment)
            )
        return tuple(found)

    @cached_property
    def tool_reach(self) -> float:
        """Distance of the tool centre point from the origin of the body that carries it [m]."""
        return float(np.linalg.norm(self._model.frames[self._tool_id].placement.translation))

    @cached_property
    def _joint_axes(self) -> FloatArray:
        """Axes of the joints in the frames of the bodies they move, shape (n, 3)."""
        data = self._model.createData()
        pin.forwardKinematics(self._model, data, pin.neutral(self._model))
        subspaces = [data.joints[int(j) + 1].S.ravel() for j in self._to_group]
        return np.array([s[3:] if s[3:].any() else s[:3] for s in subspaces])

    @property
    def _travel(self) -> FloatArray:
        """Largest distance of a joint value from zero, shape (n,)."""
        return np.maximum(abs(self.limits.lower_position), abs(self.limits.upper_position))

    def _supports(self, body: int) -> list[int]:
        """Return the Pinocchio joints that move a body, from the body to the base."""
        joints = []
        while body > 0:
            joints.append(body)
            body = self._model.parents[body]
        return joints

    def _model_order(self, values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(values[:, self._to_model], dtype=np.float64)
