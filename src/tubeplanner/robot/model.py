"""RobotModel: kinematics, dynamics, limits of an arm at N samples; effort rates."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from ctypes import c_int64
from functools import cached_property, partial, wraps
from typing import Any, TypeVar, cast

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.errors import FormerName, RobotError, shown
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.resources import PackageDirs
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.kinematics import (
    BodyChain,
    ToolChain,
    cross_product,
    frame_motion_derivatives,
    frame_velocities,
    model_joints,
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

_Method = TypeVar("_Method", bound=Callable[..., Any])

_point_jacobians = native_function(
    "tubeplanner_point_jacobians",
    *(Doubles, c_int64, Doubles, Doubles, Integers, Doubles, c_int64, c_int64, Doubles),
)
_SPREAD = 8  # configurations: a rank below the largest is an accident at none or few of them
_INDEPENDENT = 1e-6  # of the largest singular value


def one_or_many(axis: int = 0) -> Callable[[_Method], _Method]:
    """Decorate a method of an arm that takes configurations (N, n), and rates, to take (n,) too.

    Arrays returned for (n,) lack the axis of the samples. Another shape raises RobotError.

    Args:
        axis: Index of the axis of the samples in the arrays that the method returns.
    """

    def decorated(method: _Method) -> _Method:
        signature = inspect.signature(method)

        @wraps(method)
        def wrapper(self: Any, *arguments: FloatArray, **named: FloatArray) -> Any:
            if named:
                arguments = signature.bind(self, *arguments, **named).args[1:]
            # Inner loops pass arrays of many samples: for them this test is the only cost.
            if _are_many(arguments, self.joint_count):
                return method(self, *arguments)
            arrays = [np.asarray(values, dtype=np.float64) for values in arguments]
            names = list(signature.parameters)[1:]
            _require_shapes(names, arrays, self.joint_count)
            if arrays[0].ndim == 2:
                return method(self, *arrays)
            result = method(self, *(values[None] for values in arrays))
            if isinstance(result, tuple):
                return tuple(values.squeeze(axis) for values in result)
            return result.squeeze(axis)

        return cast(_Method, wrapper)

    return decorated


def _are_many(arguments: tuple[FloatArray, ...], joint_count: int) -> bool:
    """Return True if all arguments are arrays of the same shape (N, n)."""
    if not arguments or type(arguments[0]) is not np.ndarray:
        return False
    shape = arguments[0].shape
    return (
        len(shape) == 2
        and shape[1] == joint_count
        and all(type(values) is np.ndarray and values.shape == shape for values in arguments[1:])
    )


def _require_shapes(names: list[str], arrays: list[FloatArray], joint_count: int) -> None:
    """Raise RobotError unless all arrays have the same shape, (n,) or (N, n)."""
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


# ---- A robot arm for N samples at once: kinematics, dynamics, limits.
#
# The base frame, in which every position, rotation and Jacobian is expressed, is the cell's; it is
# the frame of the URDF's root link unless a base gives that link another pose. A configuration is a
# plain vector of n joint values in group order; continuous joints are not wrapped.


class RobotModel:
    """An arm of n joints and its bodies; made by `load_robot`.

    Methods that take configurations (N, n) take (n,) too, and then return arrays without N.

    A body is a set of links that move as one: body 0 is fixed to the base, body j > 0 is moved by
    one of the n joints or of their followers (joints that mimic them), M joints in all. Several
    threads may use one model; it pickles by content, with the URDF's text.

    Attributes:
        name: The robot's name.
        urdf: Its description.
        package_dirs: Folders searched for `package://` meshes.
        joint_names: The n joints, in group order.
        tool_frame: Name of the tool frame.
        gravity: Shape (3,), base frame [m/s^2].
        payload: The carried mass, if any.
        limits: Limits of the joints.
        motors: Motors of the joints.
        base: Pose of the root link; None: its frame is the base frame.
        link_body: Body of every link of the URDF, by name.
        link_placement: Pose of every link in its body's frame, by name, shape (4, 4).
    """

    body_turns = FormerName("body_is_revolute")

    def __init__(
        self,
        urdf: UrdfDescription,
        joint_names: tuple[str, ...],
        tool_frame: str,
        tool_offset: ToolOffset,
        limits: JointLimits,
        package_dirs: PackageDirs,
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
        armature = np.zeros(len(self._joints.planned))
        armature[self._joints.own] = self.motors.armature
        model.armature = armature
        # A Data made before the last edit of its model corrupts memory without a word.
        self._scratch = Scratch(model)

    @staticmethod
    def require(robot: object) -> None:
        """Raise RobotError unless an object is a RobotModel."""
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
        """Return this arm with other limits and motors.

        Position limits must be no wider, or a cached `lever_arm` is no bound any more; rotor
        inertias must be the same, as the dynamics hold them.
        """
        limited = RobotModel.__new__(RobotModel)
        vars(limited).update(vars(self), limits=limits, motors=motors)
        return limited

    def with_payload(self, payload: Payload | None) -> "RobotModel":
        """Return this arm with another payload."""
        return RobotModel(**self._given() | {"payload": payload})

    def with_motors(self, motors: JointMotors) -> "RobotModel":
        """Return this arm with other motors, rotor inertias included."""
        return RobotModel(**self._given() | {"motors": motors})

    def with_tool_offset(self, tool_offset: ToolOffset) -> "RobotModel":
        """Return this arm with another tool centre point."""
        return RobotModel(**self._given() | {"tool_offset": tool_offset})

    def in_root_frame(self) -> "RobotModel":
        """Return this arm with the frame of its root link as base frame; itself if without base."""
        if self.base is None:
            return self
        gravity = self.gravity @ self.base.placement[:3, :3]
        return RobotModel(**self._given() | {"base": None, "gravity": gravity})

    def _given(self) -> dict[str, Any]:
        """Return the arguments of the constructor."""
        names = ("urdf", "joint_names", "tool_frame", "limits", "package_dirs", "gravity")
        more = ("payload", "motors", "base")
        return {name: getattr(self, name) for name in (*names, *more)} | self._others

    def moves_as(self, other: "RobotModel") -> bool:
        """Return True if another model is this arm, limits and motors apart."""
        return self._model is other._model

    @property
    def tool_offset(self) -> ToolOffset:
        """The tool centre point in the tool frame."""
        return cast(ToolOffset, self._others["tool_offset"])

    @property
    def locked_joints(self) -> Mapping[str, float]:
        """The values of joints outside the group that the user gave, by name [rad or m]."""
        return cast(Mapping[str, float], self._others["locked_joints"])

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
        """Return rotation (N, 3, 3), position (N, 3) [m] and Jacobian (N, 6, n) of the tool."""
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

    @one_or_many()
    def tool_motion(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the motion of the tool centre point in its own axes, shape (N, 9).

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n).
            a: Accelerations, shape (N, n).

        Returns:
            Acceleration, gravity not counted [m/s^2], angular velocity [rad/s], angular
            acceleration [rad/s^2].
        """
        return self._tool.motions(q, v, a)

    @one_or_many(axis=1)
    def tool_motion_derivatives(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the derivatives of `tool_motion` by q, v and a, shape (3, N, 9, n)."""
        arm = self._model, self._scratch.data, self._joints
        return frame_motion_derivatives(*arm, self._tool_id, (q, v, a))

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
        """Return the Jacobians of points that move with bodies.

        Args:
            rotation: From `body_poses`, shape (N, bodies, 3, 3).
            position: From `body_poses`, shape (N, bodies, 3) [m].
            body: Index of the body that carries each point, shape (N,).
            point: In the base frame, shape (N, 3) [m].

        Returns:
            Shape (N, 3, n) [m/rad or 1]. (Siciliano et al., "Robotics", 2009, equation 3.30.)
        """
        if _point_jacobians is not None:
            reals = [np.ascontiguousarray(part) for part in (rotation, position, point)]
            carrier = np.ascontiguousarray(body, dtype=np.int64)
            jacobian = np.empty((len(point), 3, self.joint_count))
            table, sizes = self.joint_table, (self.joint_count, len(point))
            _point_jacobians(table, len(table), *reals[:2], carrier, reals[2], *sizes, jacobian)
            return jacobian
        axis = np.einsum("njab,jb->nja", rotation[:, 1:], self.chain.axes)
        by_turning = cross_product(axis, point[:, None] - position[:, 1:])
        columns: FloatArray = np.where(self.body_is_revolute[1:, None], by_turning, axis)
        columns = columns * self.carries[body][:, :, None]
        return self._joints.collected(columns.transpose(0, 2, 1))

    @one_or_many()
    def inverse_dynamics(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the joint efforts [N m or N] that a trajectory needs (recursive Newton-Euler).

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n).
            a: Accelerations, shape (N, n).

        Returns:
            Shape (N, n). The inertia of rotors and viscous friction are included; Coulomb friction,
            which jumps, is not: see `JointMotors.coulomb_effort`.
        """
        joints = self._joints
        columns = [joints.positions(q).T, joints.rates(v).T, joints.rates(a).T]
        # A single thread: two were measured up to 50 times slower on a machine with a busy core.
        tau = pin.rneaInParallel(1, self._scratch.pool, *columns)
        # A single row or column comes back one-dimensional.
        tau = np.reshape(tau, (self._model.nv, len(q)))
        efforts = np.ascontiguousarray(joints.collected(tau.T))
        return efforts + self.motors.viscous_friction * v

    @one_or_many()
    def gravity_effort(self, q: FloatArray) -> FloatArray:
        """Return the joint efforts (N, n) [N m or N] that hold the arm at rest against gravity."""
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
        """True if model joint k, which moves body k + 1, moves a body, shape (bodies, M)."""
        return carried_bodies(self._model)

    @cached_property
    def joint_moves_body(self) -> BoolArray:
        """True if a planned joint or its follower moves a body, shape (bodies, n)."""
        counts: BoolArray = self._joints.collected_bounds(self.carries.astype(float)) > 0
        return counts

    @cached_property
    def revolute(self) -> BoolArray:
        """True if a joint turns, False if it slides, shape (n,)."""
        return self._joints.is_revolute[self._joints.own]

    def approach_rates(
        self, bodies: tuple[IntArray, IntArray], reach: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Return bounds on the rates of distances between points of two bodies, by joint.

        Args:
            bodies: First and second bodies of P pairs, each (P,).
            reach: Distances of the points from the bodies' origins, each (P,) [m].

        Returns:
            Shape (P, n) [m per rad or m]. Joints that move both bodies as one do not count.
        """
        first, second = (self.carries[body] for body in bodies)
        rates = [
            np.where(self._joints.is_revolute, self.lever_arm[body] + radius[:, None], 1.0)
            for body, radius in zip(bodies, reach, strict=True)
        ]
        relative = np.where(first, rates[0], rates[1])
        return self._joints.collected_bounds(np.where(first != second, relative, 0.0))

    @cached_property
    def lever_arm(self) -> FloatArray:
        """Upper bound on the distance from a model joint's axis to a body's origin [m].

        Shape (bodies, M), 0 where the joint does not move the body; the sum of the distances
        between consecutive joint origins, and of the whole travel of sliding joints between.
        """
        joints, limits = self._joints, self.limits
        travel = joints.travel(limits.lower_position, limits.upper_position)
        return lever_arms(self._model, np.where(joints.is_revolute, 0.0, travel))

    @cached_property
    def arm_length(self) -> float:
        """Largest bound on the distance of the tool from a turning joint's axis [m].

        Without turning joints, the sum of the joints' travel and of the distances between their
        origins; 1 where that is 0 or infinite.
        """
        lever = self.lever_arm[self._model.frames[self._tool_id].parentJoint]
        turning = lever[self._joints.is_revolute & (lever > 0)]
        length = float((turning if len(turning) else lever).max(initial=0.0)) + self.tool_reach
        return length if 0 < length < np.inf else 1.0

    @cached_property
    def joint_units(self) -> FloatArray:
        """The unit of each joint's changes, 1 rad or the arm's length, shape (n,) [rad or m]."""
        return read_only(np.where(self.revolute, 1.0, self.arm_length))

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
        """Multiplier and offset of each body's joint, each (bodies,); 1 and 0 without a master."""
        joints = self._joints
        return np.append(1.0, joints.multiplier), np.append(0.0, joints.offset)

    @cached_property
    def body_is_revolute(self) -> BoolArray:
        """True if a body turns about its parent, False if it slides, shape (bodies,)."""
        return np.append(False, self._joints.is_revolute)

    @cached_property
    def body_offsets(self) -> FloatArray:
        """Distance of each body's origin from its parent's, joints at zero, shape (bodies,) [m]."""
        return read_only(np.linalg.norm(self.chain.position, axis=1))

    @cached_property
    def inertias(self) -> tuple[BodyInertia, ...]:
        """Mass properties of all bodies, the base's zero."""
        return body_inertias(self._model)

    @cached_property
    def tool_directions(self) -> int:
        """Number of independent directions in which the joints move the tool, 0 to 3.

        The largest rank of the tool's Jacobian at configurations spread over the joint ranges.
        """
        low, high = self.limits.lower_position, self.limits.upper_position
        low = np.where(np.isfinite(low), low, np.minimum(high, np.pi) - 2 * np.pi)
        high = np.where(np.isfinite(high), high, low + 2 * np.pi)
        q = np.random.default_rng(0).uniform(low, high, (_SPREAD, self.joint_count))
        jacobian = self.tool_jacobian(q)[1][:, :3] * (high > low)
        singular = np.linalg.svd(jacobian, compute_uv=False)
        moves = singular > _INDEPENDENT * max(float(singular.max()), 1e-300)
        return int(moves.sum(axis=1).max())

    @cached_property
    def tool_reach(self) -> float:
        """Distance of the tool centre point from its body's origin [m]."""
        return float(np.linalg.norm(self._model.frames[self._tool_id].placement.translation))

    @cached_property
    def chain(self) -> BodyChain:
        """The kinematic tree of the bodies."""
        poses = np.array([each.homogeneous for each in self._model.jointPlacements])
        rotation, position = poses[:, :3, :3].copy(), poses[:, :3, 3].copy()
        joints = joint_axes(self._model), self._joints.is_revolute
        return BodyChain(self.body_parents, rotation, position, *joints)

    @property
    def tool_joints(self) -> FloatArray:
        """Joint table (k, 41) of the joints that move the tool, a fixed last joint included."""
        return self._tool.joint_table

    @cached_property
    def tool_joints_in_units(self) -> FloatArray:
        """`tool_joints` with lengths measured by the arm's: of joints in their units."""
        table, length = self.tool_joints.copy(), self.arm_length
        own = np.where(table[:, 2], 1.0, length)
        table[:, 3] *= self.joint_units[table[:, 1].astype(int)] / own
        table[:, 4] /= own
        table[:, 5:8] /= length
        return read_only(table)

    @cached_property
    def _tool(self) -> ToolChain:
        arm = self._model, self._scratch, self._joints
        return ToolChain(*arm, self.chain, self.carries, self._tool_id)

    @cached_property
    def joint_table(self) -> FloatArray:
        """Joint table (M, 41) of all joints, as the native functions take it."""
        joints = self._joints
        return self.chain.joint_table(joints.planned, joints.multiplier, joints.offset)


# ---- The rate of joint efforts along a motion, and its derivatives.
#
# The efforts are a function tau(q, v, a), so that d tau / dt is by_q v + by_v a + by_a jerk with
# its derivatives by_q, by_v and by_a (Carpentier & Mansard, "Analytical derivatives of rigid body
# dynamics algorithms", 2018).

# Fraction of the time in which the motion changes by one radian or metre: the differences are good
# to 1e-8.
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
    """Return the rate of the efforts against gravity, as `effort_rate`."""
    still = np.zeros_like(q)
    if not robot.gravity.any():
        return still
    by_q, _, _ = robot.inverse_dynamics_derivatives(q, still, still)
    rate: FloatArray = (by_q @ v[:, :, None])[:, :, 0]
    return rate


def effort_rate_derivatives(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of `effort_rate` by q, v, a and jerk, each (N, effort joint, n).

    The time derivatives of by_q, by_v and by_a are central differences along the motion, which cost
    two evaluations for any number of joints. The derivatives by v, a and jerk add by_q, by_v and
    by_a themselves, as means of both evaluations.
    """
    pace = [abs(rate).max(axis=1) ** (1 / k) for k, rate in enumerate((v, a, jerk), start=1)]
    fastest = np.sum(pace, axis=0)[:, None]  # [1/s]
    step = np.divide(_STEP, fastest, out=np.full_like(fastest, _STEP), where=fastest > 0)  # [s]
    changes = [step * rate for rate in (v, a, jerk)]
    state = list(zip((q, v, a), changes, strict=True))
    after = robot.inverse_dynamics_derivatives(*(now + change for now, change in state))
    before = robot.inverse_dynamics_derivatives(*(now - change for now, change in state))
    pairs = list(zip(after, before, strict=True))
    mean = [(late + early) / 2 for late, early in pairs]
    change = [(late - early) / (2 * step[:, :, None]) for late, early in pairs]
    return change[0], change[1] + mean[0], change[2] + mean[1], mean[2]
