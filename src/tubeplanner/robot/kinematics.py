"""Poses, Jacobians, velocities of bodies, frames and tool at N configurations, native or NumPy.

A joint table (M, 41) has a row for each joint k, which moves body k + 1: the parent body (0 is the
base), the index among the n planned joints of the joint or its leader, 1 if the joint turns, its
multiplier and offset, the body's origin in the parent, the joint's axis in the body and in the
parent, and the three matrices of its rotation (Rodrigues).
"""

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_int, c_int64
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.native.library import Doubles, native_function
from tubeplanner.robot.pinocchio_model import Scratch
from tubeplanner.robot.urdf import Mimic, UrdfDescription

_TABLE = (Doubles, c_int64, Doubles, c_int64, c_int64, Doubles, Doubles)
_body_poses = native_function("tubeplanner_body_poses", *_TABLE)
_last_poses = native_function("tubeplanner_last_poses", *_TABLE, Doubles, returns=c_int)

# ---- The joints of a robot's model: n planned joints and their followers.
#
# A follower is at `multiplier * q + offset`, and its effort acts on its master: `tau_master +=
# multiplier * tau_follower`, by the principle of virtual work.


@dataclass(frozen=True, eq=False)
class ModelJoints:
    """M joints, in the order of the model; joint k moves body k + 1 and all bodies beyond."""

    planned: IntArray  # group index of the joint itself or of its leader, shape (M,)
    multiplier: FloatArray  # velocity over the leader's, shape (M,); 1 for a planned joint
    offset: FloatArray  # position at the leader's zero, shape (M,) [rad or m]
    is_revolute: BoolArray  # True if a joint turns, False if it slides, shape (M,)
    own: IntArray  # index of each planned joint among the M, shape (n,)

    def positions(self, q: FloatArray) -> FloatArray:
        """Return the positions of all joints, (N, M), from the group's (N, n)."""
        values = q if self._in_order else q[:, self.planned]
        if self._has_followers:
            values = values * self.multiplier + self.offset
        return np.ascontiguousarray(values, dtype=np.float64)

    def rates(self, v: FloatArray) -> FloatArray:
        """Return velocities or accelerations of all joints, (N, M), from the group's (N, n)."""
        values = v if self._in_order else v[:, self.planned]
        if self._has_followers:
            values = values * self.multiplier
        return np.ascontiguousarray(values, dtype=np.float64)

    @property
    def state_maps(self) -> tuple[Callable[[FloatArray], FloatArray], ...]:
        """Functions of positions, velocities and accelerations: the group's to all joints'."""
        return self.positions, self.rates, self.rates

    def collected(self, columns: FloatArray) -> FloatArray:
        """Return sums of columns (..., M) by planned joint, times multipliers, (..., n)."""
        return self._sums(columns, self.multiplier)

    def collected_bounds(self, columns: FloatArray) -> FloatArray:
        """Return bounds on absolute values (..., M) summed up by planned joint, (..., n)."""
        return self._sums(columns, abs(self.multiplier))

    def travel(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return the largest distance from zero within limits (n,), by joint, (M,) [rad or m]."""
        ends = self.positions(np.stack([lower, upper]))
        return abs(ends).max(axis=0)

    @cached_property
    def _has_followers(self) -> bool:
        return len(self.planned) > len(self.own)

    @cached_property
    def _in_order(self) -> bool:
        """True if the M joints are the planned joints, in the same order."""
        return np.array_equal(self.planned, np.arange(len(self.own)))

    def _sums(self, columns: FloatArray, multiplier: FloatArray) -> FloatArray:
        if not self._has_followers:
            return columns if self._in_order else columns[..., self.own]
        sums = np.zeros((*columns.shape[:-1], len(self.own)))
        for joint, (planned, factor) in enumerate(zip(self.planned, multiplier, strict=True)):
            sums[..., planned] += factor * columns[..., joint]
        return sums


def model_joints(
    description: UrdfDescription,
    names: Sequence[str],
    group: Sequence[str],
    followers: Mapping[str, Mimic],
) -> ModelJoints:
    """Return the joints of a model by their names, in its order; followers by their rules."""
    rules = [followers.get(name, Mimic(name, 1.0, 0.0)) for name in names]
    return ModelJoints(
        planned=np.array([group.index(rule.master) for rule in rules], dtype=np.int64),
        multiplier=read_only([rule.multiplier for rule in rules]),
        offset=read_only([rule.offset for rule in rules]),
        is_revolute=np.array([description.joints[name].type != "prismatic" for name in names]),
        own=np.array([list(names).index(name) for name in group], dtype=np.int64),
    )


# ---- Poses, Jacobians and velocities of bodies and frames.


@dataclass(frozen=True, eq=False)
class BodyChain:
    """The kinematic tree of an arm's bodies; body 0 is fixed, joint k moves body k + 1."""

    parents: IntArray  # index of the body that carries each body, shape (bodies,)
    rotation: FloatArray  # of each body in its parent, its joint at zero, shape (bodies, 3, 3)
    position: FloatArray  # of its origin there, shape (bodies, 3) [m]
    axes: FloatArray  # of the joints, in the frames of the bodies that they move, shape (M, 3)
    is_revolute: BoolArray  # True if a joint turns, False if it slides, shape (M,)

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, bodies, 3, 3) and origins (N, bodies, 3) [m] at positions (N, M)."""
        shape = (len(q), len(self.parents))
        rotation, position = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        if _body_poses is not None:
            own, q = self._own_table, np.ascontiguousarray(q)
            _body_poses(own, len(own), q, q.shape[1], len(q), rotation, position)
            return rotation, position
        rotation[:, 0], position[:, 0] = np.eye(3), 0.0
        # Of the bodies in their parents. Rodrigues: R = R0 (I + sin(q) K + (1 - cos(q)) K^2), K the
        # axis's cross-product matrix.
        across, twice, along = self._by_joint
        angle, travel = np.where(self.is_revolute, q, 0.0), np.where(self.is_revolute, 0.0, q)
        sine, versine = np.sin(angle)[..., None, None], 1 - np.cos(angle)[..., None, None]
        local_rotation = self.rotation[1:] + sine * across + versine * twice
        local_position = self.position[1:] + travel[..., None] * along
        for body, parent in enumerate(self.parents.tolist()):
            if body > 0:
                carrier = rotation[:, parent]
                np.matmul(carrier, local_rotation[:, body - 1], out=rotation[:, body])
                shift = carrier @ local_position[:, body - 1, :, None]
                np.add(position[:, parent], shift[:, :, 0], out=position[:, body])
        return rotation, position

    def line(self, bodies: IntArray, rotation: FloatArray, position: FloatArray) -> "BodyChain":
        """Return the chain of bodies (k,), each carrying the next, and of a frame in the last."""
        row = np.append(0, bodies)
        return BodyChain(
            parents=np.append(0, np.arange(len(row))),
            rotation=np.concatenate([self.rotation[row], [rotation]]),
            position=np.concatenate([self.position[row], [position]]),
            axes=np.concatenate([self.axes[bodies - 1], np.zeros((1, 3))]),
            is_revolute=np.append(self.is_revolute[bodies - 1], True),
        )

    def joint_table(
        self, planned: IntArray, multiplier: FloatArray, offset: FloatArray
    ) -> FloatArray:
        """Return the joint table of the native functions, (M, 41), with rules as `ModelJoints`."""
        across, twice, along = self._by_joint
        numbers = [self.parents[1:], planned, self.is_revolute, multiplier, offset]
        vectors = [self.position[1:], self.axes, along]
        matrices = [matrix.reshape(-1, 9) for matrix in (self.rotation[1:], across, twice)]
        return np.column_stack([*numbers, *vectors, *matrices]).astype(np.float64)

    @cached_property
    def _own_table(self) -> FloatArray:
        joints = np.arange(len(self.is_revolute))
        return self.joint_table(joints, np.ones(len(joints)), np.zeros(len(joints)))

    @cached_property
    def _by_joint(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """R0 K, R0 K^2 of Rodrigues' formula, each (M, 3, 3), and axes in the parents (M, 3)."""
        across = np.cross(self.axes[:, None], np.eye(3)).swapaxes(1, 2)
        rotation = self.rotation[1:]
        along = np.einsum("mij,mj->mi", rotation, self.axes)
        return rotation @ across, rotation @ across @ across, along


def frame_velocities(
    model: pin.Model,
    data: pin.Data,
    joints: ModelJoints,
    frames: Sequence[int],
    q: FloatArray,
    v: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the velocities (F, N, 3) [m/s] of the origins of F frames, and their derivatives.

    The derivatives are by positions and by velocities, each (F, N, 3, n), in the base frame. The
    model's data are written to.
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
    by_rotation = np.cross((rotation @ by_v[..., 3:, :]).swapaxes(2, 3), velocity[:, :, None])
    change += by_rotation.swapaxes(2, 3)
    return velocity, joints.collected(change), joints.collected(linear)


def frame_motion_derivatives(
    model: pin.Model,
    data: pin.Data,
    joints: ModelJoints,
    frame: int,
    states: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    """Return the derivatives of a frame's motion by the states, shape (3, N, 9, n).

    The states are positions, velocities and accelerations, (N, n) each; the motion is that of
    `ToolChain.motions`. The model's data are written to.
    """
    by = np.empty((3, len(states[0]), 9, model.nv))
    rows = zip(*(of(x) for of, x in zip(joints.state_maps, states, strict=True)), strict=True)
    for i, (q, v, a) in enumerate(rows):
        pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
        parts = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
        spin_by_q, by_q, by_v, by_a = (part.reshape(6, model.nv) for part in parts)
        velocity = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
        # The classical acceleration is the spatial one and w x v.
        turning, moving = pin.skew(velocity.angular), pin.skew(velocity.linear)
        for block, spatial, rate in ((by[0, i], by_q, spin_by_q), (by[1, i], by_v, by_a)):
            block[:3] = spatial[:3] + turning @ rate[:3] - moving @ rate[3:]
            block[3:6], block[6:] = rate[3:], spatial[3:]
        by[2, i, :3], by[2, i, 3:6], by[2, i, 6:] = by_a[:3], 0.0, by_a[3:]
    return joints.collected(by)


# ---- The tool centre point of an arm and its Jacobian, in many configurations.

# From this number of configurations on, arrays are quicker than a Pinocchio call for each.
_MANY = 64


@dataclass(frozen=True, eq=False)
class ToolChain:
    """The bodies and joints that move the tool centre point."""

    model: pin.Model  # the arm
    scratch: Scratch  # of the model; written to
    joints: ModelJoints  # of the model
    chain: BodyChain  # of the model
    carries: BoolArray  # True if joint k moves a body, shape (bodies, M)
    frame: int  # index of the tool centre point among the model's frames

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, 3, 3) and positions (N, 3) [m] in configurations (N, n)."""
        if _last_poses is not None:
            return self._compiled(q, None)
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
        """Return poses and Jacobians (N, 6, n), linear rows first, base frame, at (N, n)."""
        if _last_poses is not None:
            jacobian = np.empty((len(q), 6, q.shape[1]))
            return *self._compiled(q, jacobian), jacobian
        if len(q) >= _MANY:
            rotation, position = self.chain.poses(self.joints.positions(q))
            tool_rotation, tool = self._of_bodies(rotation, position)
            carried = self.carries[self.model.frames[self.frame].parentJoint]
            axis = (rotation[:, 1:] @ self.chain.axes[:, :, None])[..., 0] * carried[:, None]
            is_revolute = self.joints.is_revolute[:, None]
            linear = np.where(
                is_revolute, cross_product(axis, tool[:, None] - position[:, 1:]), axis
            )
            columns = np.concatenate([linear, np.where(is_revolute, axis, 0.0)], axis=2)
            return tool_rotation, tool, self.joints.collected(columns.swapaxes(1, 2))
        model, data, frame = self.model, self.scratch.data, self.frame
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        jacobian, placement = np.empty((len(q), 6, model.nv)), data.oMf[frame]
        for i, q_i in enumerate(self.joints.positions(q)):
            columns = pin.computeFrameJacobian(model, data, q_i, frame, pin.LOCAL_WORLD_ALIGNED)
            jacobian[i] = columns.reshape(jacobian.shape[1:])  # one column comes back flat
            pin.updateFramePlacement(model, data, frame)
            rotation[i], position[i] = placement.rotation, placement.translation
        return rotation, position, self.joints.collected(jacobian)

    def motions(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the tool's acceleration, angular velocity and acceleration, in tool axes: (N, 9).

        The acceleration is the tool centre point's, gravity not counted; q, v and a are (N, n).
        """
        positions, rates, changes = (
            of(x) for of, x in zip(self.joints.state_maps, (q, v, a), strict=True)
        )
        rotation, position = self.chain.poses(positions)
        tool_rotation, tool = self._of_bodies(rotation, position)
        spin, spin_rate, acceleration = np.zeros((3, len(q), 3))
        before = np.zeros((len(q), 3))
        moving = np.flatnonzero(self.carries[self.model.frames[self.frame].parentJoint])
        for joint in moving.tolist():
            body = joint + 1
            link = position[:, body] - before
            acceleration = acceleration + _carried(spin, spin_rate, link)
            axis = rotation[:, body] @ self.chain.axes[joint]
            rate, change = axis * rates[:, joint, None], axis * changes[:, joint, None]
            if self.joints.is_revolute[joint]:
                spin_rate = spin_rate + change + cross_product(spin, rate)
                spin = spin + rate
            else:
                acceleration = acceleration + change + 2 * cross_product(spin, rate)
            before = position[:, body]
        acceleration = acceleration + _carried(spin, spin_rate, tool - before)
        columns = np.stack([acceleration, spin, spin_rate], axis=1)
        return (columns @ tool_rotation).reshape(len(q), 9)

    @cached_property
    def joint_table(self) -> FloatArray:
        """Joint table of the joints that move the tool, and of a last joint that is fixed."""
        tool, joints = self.model.frames[self.frame], self.joints
        moving = np.flatnonzero(self.carries[tool.parentJoint])
        line = self.chain.line(moving + 1, tool.placement.rotation, tool.placement.translation)
        rules = (joints.planned, joints.multiplier, joints.offset)
        return line.joint_table(*(np.append(rule[moving], 0) for rule in rules))

    def _compiled(
        self, q: FloatArray, jacobian: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return `poses`, and write `jacobians` to an array if there is one."""
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        own, values = self.joint_table, np.ascontiguousarray(q)
        sizes = (q.shape[1], len(q))
        assert _last_poses is not None  # the caller asks first
        if _last_poses(own, len(own), values, *sizes, rotation, position, jacobian):
            raise MemoryError
        return rotation, position

    def _of_bodies(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return tool rotations (N, 3, 3) and positions (N, 3) [m] from poses of the bodies."""
        tool = self.model.frames[self.frame]
        carrier = rotation[:, tool.parentJoint]
        point = carrier @ tool.placement.translation + position[:, tool.parentJoint]
        return carrier @ tool.placement.rotation, point


def _carried(spin: FloatArray, spin_rate: FloatArray, link: FloatArray) -> FloatArray:
    """Return the acceleration of a link's end against its begin, (N, 3) each."""
    return cross_product(spin_rate, link) + cross_product(spin, cross_product(spin, link))


def cross_product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the vector product along the last axis; a third of the time of NumPy's."""
    x, y, z = np.moveaxis(first, -1, 0)
    u, v, w = np.moveaxis(second, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
