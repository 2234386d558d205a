"""Poses, Jacobians, velocities of bodies, frames and tool at N configurations, native or NumPy.

A table of joints (M, 41) says how each moves the body after it: what carries the body (0 is the
base, joint k moves body k + 1), which of n joints it is or follows, whether it turns, its
multiplier and offset, the body's origin in the parent, the joint's axis in the body and in the
parent, and the three matrices of its rotation (Rodrigues).
"""

from collections.abc import Mapping, Sequence
from ctypes import c_int, c_int64
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.robot.pinocchio_model import Scratch
from tubeplanner.robot.urdf import Mimic, UrdfDescription

# ---- Poses and Jacobians of bodies that hang from each other, compiled.

_TABLE = (Doubles, c_int64)
_POSES = native_function(
    "tubeplanner_body_poses", *_TABLE, Doubles, c_int64, c_int64, Doubles, Doubles
)
_LAST_POSES = native_function(
    "tubeplanner_last_poses",
    *(*_TABLE, Doubles, c_int64, c_int64, Doubles, Doubles, Doubles),
    returns=c_int,
)
_POINT_JACOBIANS = native_function(
    "tubeplanner_point_jacobians",
    *(*_TABLE, Doubles, Doubles, Integers, Doubles, c_int64, c_int64, Doubles),
)


def native_body_poses(table: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations (N, M + 1, 3, 3) and origins (N, M + 1, 3) [m] at positions (N, n)."""
    assert _POSES is not None
    q, shape = np.ascontiguousarray(q), (len(q), len(table) + 1)
    rotation, position = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    _POSES(table, len(table), q, q.shape[1], len(q), rotation, position)
    return rotation, position


def native_last_poses(table: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (N, 3, 3) and origin (N, 3) [m] of the last body at positions (N, n).

    Every body must carry the next.
    """
    rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    _set_last_poses(table, q, rotation, position, None)
    return rotation, position


def native_last_jacobians(
    table: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `native_last_poses` and their Jacobians (N, 6, n), linear rows first, base frame."""
    rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    jacobian = np.empty((len(q), 6, q.shape[1]))
    _set_last_poses(table, q, rotation, position, jacobian)
    return rotation, position, jacobian


def native_point_jacobians(
    table: FloatArray,
    joint_count: int,
    poses: tuple[FloatArray, FloatArray],
    body: IntArray,
    point: FloatArray,
) -> FloatArray:
    """Return how points move with n joints, shape (N, 3, n).

    Args:
        table: The joints.
        joint_count: Their number n.
        poses: From `native_body_poses`.
        body: Which carries each point, shape (N,).
        point: In the base frame, shape (N, 3) [m].
    """
    assert _POINT_JACOBIANS is not None
    rotation, position, point = (np.ascontiguousarray(values) for values in (*poses, point))
    jacobian = np.empty((len(point), 3, joint_count))
    body = np.ascontiguousarray(body, dtype=np.int64)
    _POINT_JACOBIANS(
        *(table, len(table), rotation, position, body, point, joint_count, len(point), jacobian)
    )
    return jacobian


def _set_last_poses(
    table: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    position: FloatArray,
    jacobian: FloatArray | None,
) -> None:
    assert _LAST_POSES is not None
    q = np.ascontiguousarray(q)
    if _LAST_POSES(table, len(table), q, q.shape[1], len(q), rotation, position, jacobian):
        raise MemoryError


# ---- Vector products of many vectors.


def cross_product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the vector product along the last axis; a third of the time of NumPy's."""
    x, y, z = np.moveaxis(first, -1, 0)
    u, v, w = np.moveaxis(second, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


# ---- The joints of a robot's model: the n that are planned, and those that follow one of them.
#
# A follower is at `multiplier * q + offset`; what it takes goes to its master: `tau_master +=
# multiplier * tau_follower`, by the principle of virtual work.


@dataclass(frozen=True, eq=False)
class ModelJoints:
    """M joints, in the order of the model; joint k moves body k + 1 and all that hangs from it.

    Attributes:
        planned: Which planned joint each is or follows, as group index, shape (M,).
        multiplier: How fast it follows, shape (M,); 1 for a planned joint.
        offset: Where it is when the planned joint is at 0, shape (M,) [rad or m].
        turns: Whether it turns (rather than slides), shape (M,).
        own: Which of the M joints each planned joint is, shape (n,).
    """

    planned: IntArray
    multiplier: FloatArray
    offset: FloatArray
    turns: BoolArray
    own: IntArray

    def positions(self, q: FloatArray) -> FloatArray:
        """Return the positions of all joints, shape (N, M), from those of the group (N, n)."""
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

    def collected(self, columns: FloatArray) -> FloatArray:
        """Return what all joints do or take together (..., M) by planned joint, (..., n)."""
        return self._sums(columns, self.multiplier)

    def collected_bounds(self, columns: FloatArray) -> FloatArray:
        """Return bounds on absolute values (..., M) summed up by planned joint, (..., n)."""
        return self._sums(columns, abs(self.multiplier))

    def of_own(self, values: FloatArray) -> FloatArray:
        """Return values (n,) of the planned joints among those of all joints, (M,); others 0."""
        among = np.zeros(len(self.planned))
        among[self.own] = values
        return among

    def travel(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return how far from zero the joints get within limits (n,), shape (M,) [rad or m]."""
        ends = self.positions(np.stack([lower, upper]))
        return abs(ends).max(axis=0)

    @cached_property
    def _has_followers(self) -> bool:
        return len(self.planned) > len(self.own)

    @cached_property
    def _in_order(self) -> bool:
        """Whether the M joints are the planned ones, in the same order."""
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
    """Return the joints of a model.

    Args:
        description: The robot.
        names: Their names, in the order of the model.
        group: Those that are planned.
        followers: The rules of the others, by name.
    """
    rules = [followers.get(name, Mimic(name, 1.0, 0.0)) for name in names]
    return ModelJoints(
        planned=np.array([group.index(rule.master) for rule in rules], dtype=np.int64),
        multiplier=read_only([rule.multiplier for rule in rules]),
        offset=read_only([rule.offset for rule in rules]),
        turns=np.array([description.joints[name].type != "prismatic" for name in names]),
        own=np.array([list(names).index(name) for name in group], dtype=np.int64),
    )


# ---- Where the bodies of an arm are, in many configurations at once.


@dataclass(frozen=True, eq=False)
class BodyChain:
    """Bodies that hang from each other; body 0 stands still, joint k moves body k + 1.

    Attributes:
        parents: Which body carries each, shape (bodies,).
        rotation: Of each body in its parent, its joint at zero, shape (bodies, 3, 3).
        position: Of its origin there, shape (bodies, 3) [m].
        axes: Of the joints, in the frames of the bodies that they move, shape (M, 3).
        turns: Whether a joint turns (rather than slides), shape (M,).
    """

    parents: IntArray
    rotation: FloatArray
    position: FloatArray
    axes: FloatArray
    turns: BoolArray

    @staticmethod
    def of(
        parents: IntArray, placements: Sequence[FloatArray], axes: FloatArray, turns: BoolArray
    ) -> "BodyChain":
        """Return bodies whose poses in their parents, joints at zero, are transforms (4, 4)."""
        placed = np.array(placements)
        return BodyChain(parents, placed[:, :3, :3].copy(), placed[:, :3, 3].copy(), axes, turns)

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, bodies, 3, 3) and origins (N, bodies, 3) [m] at positions (N, M)."""
        if LIBRARY.functions is not None:
            return native_body_poses(self._own_table, q)
        shape = (len(q), len(self.parents))
        rotation, position = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        rotation[:, 0], position[:, 0] = np.eye(3), 0.0
        turned, moved = self._in_parents(q)
        for body, parent in enumerate(self.parents.tolist()):
            if body > 0:
                carrier = rotation[:, parent]
                np.matmul(carrier, turned[:, body - 1], out=rotation[:, body])
                shift = carrier @ moved[:, body - 1, :, None]
                np.add(position[:, parent], shift[:, :, 0], out=position[:, body])
        return rotation, position

    def line(self, bodies: IntArray, rotation: FloatArray, position: FloatArray) -> "BodyChain":
        """Return the chain of some bodies, each of which carries the next, and of a fixed frame.

        Args:
            bodies: Their indices, from the base on, shape (k,).
            rotation: Of the frame in the last of them, shape (3, 3).
            position: Likewise, shape (3,) [m].
        """
        kept = np.append(0, bodies)
        return BodyChain(
            parents=np.append(0, np.arange(len(kept))),
            rotation=np.concatenate([self.rotation[kept], [rotation]]),
            position=np.concatenate([self.position[kept], [position]]),
            axes=np.concatenate([self.axes[bodies - 1], np.zeros((1, 3))]),
            turns=np.append(self.turns[bodies - 1], True),
        )

    def joint_table(
        self, planned: IntArray, multiplier: FloatArray, offset: FloatArray
    ) -> FloatArray:
        """Return the joints as `native.kinematics` takes them, shape (M, 41).

        Args:
            planned: Which of n joints each is or follows, shape (M,).
            multiplier: How fast it follows, shape (M,).
            offset: Where it is when that joint is at 0, shape (M,) [rad or m].
        """
        across, twice, along = self._by_joint
        numbers = [self.parents[1:], planned, self.turns, multiplier, offset]
        vectors = [self.position[1:], self.axes, along]
        turned = [matrix.reshape(-1, 9) for matrix in (self.rotation[1:], across, twice)]
        return np.column_stack([*numbers, *vectors, *turned]).astype(np.float64)

    @cached_property
    def _own_table(self) -> FloatArray:
        joints = np.arange(len(self.turns))
        return self.joint_table(joints, np.ones(len(joints)), np.zeros(len(joints)))

    def _in_parents(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, M, 3, 3) and origins (N, M, 3) of bodies in their parents."""
        across, twice, along = self._by_joint
        angle, travel = np.where(self.turns, q, 0.0), np.where(self.turns, 0.0, q)
        sine, rest = np.sin(angle)[..., None, None], 1 - np.cos(angle)[..., None, None]
        turned = self.rotation[1:] + sine * across + rest * twice  # Rodrigues
        return turned, self.position[1:] + travel[..., None] * along

    @cached_property
    def _by_joint(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """By which a body's rotation changes with sine and 1 - cosine, and its origin by travel."""
        across = np.cross(self.axes[:, None], np.eye(3)).swapaxes(1, 2)
        placed = self.rotation[1:]
        along = np.einsum("mij,mj->mi", placed, self.axes)
        return placed @ across, placed @ across @ across, along


# ---- The pose of a frame that moves with an arm, and its Jacobian.


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


# ---- The velocities of frames that move with an arm, and how they change with its joints.


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


# ---- The tool centre point of an arm and its Jacobian, in many configurations.

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
