"""RobotModel: kinematics, dynamics, limits of an arm at N samples; effort rates."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.errors import RobotError, shown
from tubeplanner.native.library import LIBRARY
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.kinematics import (
    BodyChain,
    ToolChain,
    cross_product,
    frame_velocities,
    model_joints,
    native_point_jacobians,
)
from tubeplanner.robot.motors import JointMotors
from tubeplanner.robot.pinocchio_model import (
    BasePose,
    BodyInertia,
    Payload,
    Scratch,
    ToolOffset,
    add_frame,
    body_inertias,
    build_model,
    carried_bodies,
    effort_derivatives,
    joint_axes,
    lever_arms,
    link_placements,
)
from tubeplanner.robot.urdf import UrdfDescription, followers_of, joint_id

# ---- Configurations, one or many: methods that take (N, n) and, without the leading axis, (n,).

_Method = TypeVar("_Method", bound=Callable[..., Any])


def one_or_many(axis: int = 0) -> Callable[[_Method], _Method]:
    """Return a decorator of a method of an arm that takes configurations (N, n), and their rates.

    With (n,) the method then returns its arrays without the axis of the samples. What has another
    shape raises RobotError.

    Args:
        axis: Which axis of the arrays that the method returns is that of the samples.
    """

    def decorated(method: _Method) -> _Method:
        signature = inspect.signature(method)

        @wraps(method)
        def taking(self: Any, *given: FloatArray, **named: FloatArray) -> Any:
            if named:
                given = signature.bind(self, *given, **named).args[1:]
            # Inner loops call this with arrays of many samples: they cost no more than this test.
            if _are_many(given, self.joint_count):
                return method(self, *given)
            arrays = [np.asarray(values, dtype=np.float64) for values in given]
            names = list(signature.parameters)[1:]
            _require_shapes(names, arrays, self.joint_count)
            if arrays[0].ndim == 2:
                return method(self, *arrays)
            return _first(method(self, *(values[None] for values in arrays)), axis)

        return cast(_Method, taking)

    return decorated


def _are_many(given: tuple[FloatArray, ...], joint_count: int) -> bool:
    """Return whether all are arrays of one shape (N, n)."""
    if not given or type(given[0]) is not np.ndarray:
        return False
    shape = given[0].shape
    return (
        len(shape) == 2
        and shape[1] == joint_count
        and all(type(values) is np.ndarray and values.shape == shape for values in given[1:])
    )


def _require_shapes(names: list[str], arrays: list[FloatArray], joint_count: int) -> None:
    """Raise RobotError unless arrays have one shape, (n,) or (N, n)."""
    shape = arrays[0].shape if arrays else ()
    if shape != (joint_count,) and (len(shape) != 2 or shape[1] != joint_count):
        raise RobotError(
            f"{names[0]} has shape {shape}; the arm has {joint_count} joints: give "
            f"({joint_count},), or (N, {joint_count}) for N configurations"
        )
    for name, values in zip(names, arrays, strict=True):
        if values.shape != shape:
            raise RobotError(
                f"{name} has shape {values.shape}, and {names[0]} {shape}; give one shape"
            )


def _first(result: FloatArray | tuple[FloatArray, ...], axis: int) -> Any:
    """Return an array or several without an axis of length 1."""
    if isinstance(result, tuple):
        return tuple(values.squeeze(axis) for values in result)
    return result.squeeze(axis)


# ---- A robot arm for N samples at once: kinematics, dynamics, limits.
#
# The base frame, in which every position, rotation and Jacobian is expressed, is the cell's; it is
# the frame of the URDF's root link unless a base says where that stands. A configuration is a plain
# vector of n joint values in group order; continuous joints are not wrapped.


class RobotModel:
    """An arm of n joints and its bodies; made by `load_robot`.

    What takes configurations (N, n) takes one (n,) too, and returns its arrays without N.

    A body is everything that moves as one: body 0 is fixed to the base, body j > 0 is what hangs
    rigidly from one of the n joints, or from one of their followers (joints that mimic them); these
    are M in all. Several threads may use one model; it pickles by content, with the URDF's text.

    Attributes:
        name: The robot's name.
        urdf: Its description.
        package_dirs: Folders searched for `package://` meshes.
        joint_names: The n joints, in group order.
        tool_frame: Name of the tool frame.
        gravity: Shape (3,), base frame [m/s^2].
        payload: What it carries, if anything.
        limits: Limits of the joints.
        motors: Motors of the joints.
        base: Where the root link stands; None: its frame is the base frame.
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
        motors: JointMotors | None = None,
        base: BasePose | None = None,
    ) -> None:
        self.motors = motors or JointMotors.ideal(len(joint_names))
        bounds = [limits.effort, limits.effort_rate, self.motors.saturation_effort]
        model = build_model(
            urdf,
            joint_names,
            tool_frame,
            locked_joints=locked_joints,
            gravity=gravity,
            payload=payload,
            needs_masses=bool(np.isfinite(bounds).any()),
            base=base,
        )
        self._others = {"tool_offset": tool_offset, "locked_joints": locked_joints}
        self.payload, self.base = payload, base
        self.name, self.urdf, self.package_dirs = urdf.name, urdf, package_dirs
        self.joint_names, self.tool_frame = joint_names, tool_frame
        self.limits, self.gravity = limits, read_only(model.gravity.linear)
        self.link_body, self.link_placement = link_placements(urdf, model)
        self._model = model
        self._tool_id = add_frame(model, "tool centre point", tool_frame, tool_offset)
        self._point_ids = [
            add_frame(model, f"point {k}", point.link, ToolOffset(point.position))
            for k, point in enumerate(limits.point_speed)
        ]
        # Pinocchio orders joints its own way, and knows followers as joints of their own.
        self._joints = model_joints(
            urdf,
            [name.removeprefix(joint_id("")) for name in model.names[1:]],
            joint_names,
            followers_of(urdf, joint_names),
        )
        model.armature = self._joints.of_own(self.motors.armature)
        # A Data made before the last edit of its model corrupts memory without a word.
        self._scratch = Scratch(model)

    @staticmethod
    def require(robot: object) -> None:
        """Raise RobotError unless something is a robot."""
        if not isinstance(robot, RobotModel):
            raise RobotError(
                f"the robot is {shown(robot)}; give a RobotModel, as load_robot returns"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(RobotModel, **self._given()), ()

    def __repr__(self) -> str:
        joints, frame = ", ".join(self.joint_names), self.tool_frame
        return f"<RobotModel {self.name}: {self.joint_count} joints to {frame} ({joints})>"

    def with_limits(self, limits: JointLimits, motors: JointMotors) -> "RobotModel":
        """Return this arm with other limits, of positions no wider, and motors of like rotors."""
        limited = RobotModel.__new__(RobotModel)
        vars(limited).update(vars(self), limits=limits, motors=motors)
        return limited

    def with_payload(self, payload: Payload | None) -> "RobotModel":
        """Return this arm with another payload."""
        return RobotModel(**self._given() | {"payload": payload})

    def in_root_frame(self) -> "RobotModel":
        """Return this arm in the frame of its root link: itself if that is the base frame."""
        if self.base is None:
            return self
        gravity = self.gravity @ self.base.placement[:3, :3]
        return RobotModel(**self._given() | {"base": None, "gravity": gravity})

    def _given(self) -> dict[str, Any]:
        """Return the arguments of which this arm is made."""
        kept = ("urdf", "joint_names", "tool_frame", "limits", "package_dirs", "gravity", "payload")
        return {name: getattr(self, name) for name in (*kept, "motors", "base")} | self._others

    def moves_as(self, other: "RobotModel") -> bool:
        """Return whether another model is this arm, with whatever limits."""
        return self._model is other._model

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

    @one_or_many()
    def tool_pose(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (N, 3, 3) and position (N, 3) [m] of the tool centre point."""
        return self._tool.poses(q)

    def tool_jacobian(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tool centre point (N, 3) [m] and its Jacobian (N, 6, n).

        Rows 0-2 give the linear velocity of the point [m/s], rows 3-5 the angular velocity
        [rad/s], both in the base frame.
        """
        return self.tool_pose_jacobian(q)[1:]

    @one_or_many()
    def tool_pose_jacobian(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rotation (N, 3, 3), position (N, 3) [m] and Jacobian (N, 6, n) of that point."""
        return self._tool.jacobians(q)

    @one_or_many()
    def tool_velocity(
        self, q: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the velocity of the tool centre point (N, 3) [m/s], and its derivatives.

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n).

        Returns:
            The velocity, and its derivatives by positions and by velocities, each (N, 3, n); in the
            base frame.
        """
        arm = self._model, self._scratch.data, self._joints
        velocity, by_q, by_v = frame_velocities(*arm, [self._tool_id], q, v)
        return velocity[0], by_q[0], by_v[0]

    @one_or_many(axis=1)
    def point_velocities(
        self, q: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return `tool_velocity` of the P points of `limits.point_speed`: (P, N, 3), ..."""
        arm = self._model, self._scratch.data, self._joints
        return frame_velocities(*arm, self._point_ids, q, v)

    @one_or_many()
    def body_poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, bodies, 3, 3) and origins (N, bodies, 3) [m] of all bodies."""
        return self.chain.poses(self._joints.positions(q))

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
        if LIBRARY.functions is not None:
            table, poses = self._joint_table, (rotation, position)
            return native_point_jacobians(table, self.joint_count, poses, body, point)
        axis = np.einsum("njab,jb->nja", rotation[:, 1:], self.chain.axes)
        turned = cross_product(axis, point[:, None] - position[:, 1:])
        columns = np.where(self.body_turns[1:, None], turned, axis)
        moved: FloatArray = columns * self.carries[body][:, :, None]
        return self._joints.collected(moved.transpose(0, 2, 1))

    @one_or_many()
    def inverse_dynamics(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the joint efforts [N m or N] that a trajectory needs (recursive Newton-Euler).

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n).
            a: Accelerations, shape (N, n).

        Returns:
            Shape (N, n). With the inertia of rotors and viscous friction; Coulomb friction, which
            jumps, is `JointMotors.coulomb_effort`.
        """
        joints = self._joints
        columns = [joints.positions(q).T, joints.rates(v).T, joints.rates(a).T]
        # One thread: two were measured up to 50 times slower on a machine with a busy core.
        tau = pin.rneaInParallel(1, self._scratch.pool, *columns)
        # A single row or column comes back one-dimensional.
        tau = np.reshape(tau, (self._model.nv, len(q)))
        efforts = np.ascontiguousarray(joints.collected(tau.T))
        return efforts + self.motors.viscous_friction * v

    @one_or_many()
    def gravity_effort(self, q: FloatArray) -> FloatArray:
        """Return the joint efforts (N, n) [N m or N] that hold the arm still against gravity."""
        zero = np.zeros_like(q)
        return self.inverse_dynamics(q, zero, zero) if self.gravity.any() else zero

    @one_or_many()
    def inverse_dynamics_derivatives(
        self, q: FloatArray, v: FloatArray, a: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return d tau / d q, d tau / d v and d tau / d a, each (N, effort joint, n)."""
        joints = self._joints
        states = joints.positions(q), joints.rates(v), joints.rates(a)
        derivatives = effort_derivatives(self._model, self._scratch.data, states)
        by_effort = joints.collected(derivatives.swapaxes(2, 3)).swapaxes(2, 3)
        by_group = joints.collected(by_effort)
        by_group[1] += np.diag(self.motors.viscous_friction)
        return by_group[0], by_group[1], by_group[2]

    @cached_property
    def carries(self) -> BoolArray:
        """Whether what joins body k + 1 to what carries it moves a body, shape (bodies, M)."""
        return carried_bodies(self._model)

    @cached_property
    def joint_moves_body(self) -> BoolArray:
        """Whether a joint moves a body, itself or by a follower, shape (bodies, n)."""
        counts: BoolArray = self._joints.collected_bounds(self.carries.astype(float)) > 0
        return counts

    @cached_property
    def revolute(self) -> BoolArray:
        """Whether a joint turns (rather than slides), shape (n,)."""
        return self._joints.turns[self._joints.own]

    def approach_rates(
        self, bodies: tuple[IntArray, IntArray], reach: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Return how fast joints can change distances between points of two bodies.

        Args:
            bodies: Of P pairs, the first and the second, each (P,).
            reach: How far their points are from the bodies' origins, each (P,) [m].

        Returns:
            Shape (P, n) [m per rad or m]. What moves both bodies as one does not count.
        """
        first, second = (self.carries[body] for body in bodies)
        rates = [
            np.where(self._joints.turns, self.lever_arm[body] + away[:, None], 1.0)
            for body, away in zip(bodies, reach, strict=True)
        ]
        relative = np.where(first, rates[0], rates[1])
        return self._joints.collected_bounds(np.where(first != second, relative, 0.0))

    @cached_property
    def lever_arm(self) -> FloatArray:
        """Upper bound on the distance from a joint's or follower's axis to a body's origin [m].

        Shape (bodies, M), 0 where it does not move the body; the sum of the distances between
        consecutive joint origins, and of the whole travel of sliding joints between.
        """
        joints, limits = self._joints, self.limits
        travel = joints.travel(limits.lower_position, limits.upper_position)
        return lever_arms(self._model, np.where(joints.turns, 0.0, travel))

    @cached_property
    def body_parents(self) -> IntArray:
        """The body that carries each body, shape (bodies,); the base carries itself."""
        return np.array([self._model.parents[body] for body in range(self.body_count)])

    @cached_property
    def body_joints(self) -> IntArray:
        """The joint that moves each body, as group index, shape (bodies,); -1 for the base."""
        return np.concatenate([[-1], self._joints.planned])

    @cached_property
    def body_rules(self) -> tuple[FloatArray, FloatArray]:
        """By which multiplier and offset bodies follow their joints, each (bodies,); 1 and 0."""
        joints = self._joints
        return np.append(1.0, joints.multiplier), np.append(0.0, joints.offset)

    @cached_property
    def body_turns(self) -> BoolArray:
        """Whether each body turns about its parent (rather than slides), shape (bodies,)."""
        return np.append(False, self._joints.turns)

    @cached_property
    def body_offsets(self) -> FloatArray:
        """Distance of each body's origin from its parent's, joints at zero, shape (bodies,) [m]."""
        return read_only(np.linalg.norm(self.chain.position, axis=1))

    @cached_property
    def inertias(self) -> tuple[BodyInertia, ...]:
        """Mass properties of all bodies, the base's left at zero."""
        return body_inertias(self._model)

    @cached_property
    def tool_reach(self) -> float:
        """Distance of the tool centre point from the origin of the body that carries it [m]."""
        return float(np.linalg.norm(self._model.frames[self._tool_id].placement.translation))

    @cached_property
    def chain(self) -> BodyChain:
        """How the bodies hang from each other."""
        placements = [each.homogeneous for each in self._model.jointPlacements]
        axes = joint_axes(self._model)
        return BodyChain.of(self.body_parents, placements, axes, self._joints.turns)

    @property
    def tool_joints(self) -> FloatArray:
        """The joints that move the tool, as `native.kinematics` takes them."""
        return self._tool.joint_table

    @cached_property
    def _tool(self) -> ToolChain:
        arm = self._model, self._scratch, self._joints
        return ToolChain(*arm, self.chain, self.carries, self._tool_id)

    @cached_property
    def _joint_table(self) -> FloatArray:
        joints = self._joints
        return self.chain.joint_table(joints.planned, joints.multiplier, joints.offset)


# ---- How fast an arm's joint efforts change along a motion, and how that follows from the motion.
#
# The efforts are a function tau(q, v, a), so that d tau / dt is by_q v + by_v a + by_a jerk with
# its derivatives by_q, by_v and by_a (Carpentier & Mansard, "Analytical derivatives of rigid body
# dynamics algorithms", 2018).

# Of the times in which the motion changes by one radian or metre: the differences are good to 1e-8.
_STEP = 1e-4


def effort_rate(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray
) -> FloatArray:
    """Return d tau / dt, shape (N, n) [N m/s or N/s], exact.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
        a: Accelerations, shape (N, n).
        jerk: Shape (N, n).
    """
    blocks = robot.inverse_dynamics_derivatives(q, v, a)
    rates = np.concatenate([v, a, jerk], axis=1)[:, :, None]
    rate: FloatArray = (np.concatenate(blocks, axis=2) @ rates)[:, :, 0]
    return rate


def gravity_effort_rate(robot: RobotModel, q: FloatArray, v: FloatArray) -> FloatArray:
    """Return how fast the efforts against gravity change, shape (N, n) [N m/s or N/s], exact.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
    """
    still = np.zeros_like(q)
    if not robot.gravity.any():
        return still
    by_q, _, _ = robot.inverse_dynamics_derivatives(q, still, still)
    rate: FloatArray = (by_q @ v[:, :, None])[:, :, 0]
    return rate


def effort_rate_derivatives(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of d tau / dt by q, v, a and jerk, each (N, effort joint, n).

    Those of tau change by the time derivative of by_q, and so on: it is taken by differences along
    the motion, which cost two evaluations whatever the number of joints. What a derivative by v or
    a adds, the derivative by q or v itself, is their mean.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
        a: Accelerations, shape (N, n).
        jerk: Shape (N, n).
    """
    step = _steps(v, a, jerk)
    changes = [step * rate for rate in (v, a, jerk)]
    state = list(zip((q, v, a), changes, strict=True))
    after = robot.inverse_dynamics_derivatives(*(now + change for now, change in state))
    before = robot.inverse_dynamics_derivatives(*(now - change for now, change in state))
    pairs = list(zip(after, before, strict=True))
    mean = [(late + early) / 2 for late, early in pairs]
    change = [(late - early) / (2 * step[:, :, None]) for late, early in pairs]
    return change[0], change[1] + mean[0], change[2] + mean[1], mean[2]


def _steps(v: FloatArray, a: FloatArray, jerk: FloatArray) -> FloatArray:
    """Return for how long to follow motions, shape (N, 1) [s]."""
    pace = [abs(rate).max(axis=1) ** (1 / k) for k, rate in enumerate((v, a, jerk), start=1)]
    fastest = np.sum(pace, axis=0)[:, None]
    return np.divide(_STEP, fastest, out=np.full_like(fastest, _STEP), where=fastest > 0)
