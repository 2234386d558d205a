"""The Pinocchio model of the planned joints: base, payload, tool attached, other joints locked."""

import os
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import IO

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import BoolArray, FloatArray, read_only
from tubeplanner.checks import are_numbers, checked_row, in_figures, is_number
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.fields import Finite, Quaternion, Vector, declaration, declared, documented
from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy
from tubeplanner.robot.urdf import (
    UrdfDescription,
    UrdfJoint,
    followers_of,
    joint_id,
    leader_of,
    leaders,
    link_id,
)

_MAX_DISTANCE = 1e4  # [m], as of obstacles
_MIN_NORM, _MAX_NORM = 1e-9, 1e9  # of a quaternion that has a direction
_MAX_MASS = 1e6  # [kg]
_MAX_INERTIA = 1e14  # [kg m^2]: the largest mass at ten kilometres

# Standard error belongs to the whole process: a single parser at a time redirects it.
_STDERR_LOCK = threading.Lock()


@documented
@dataclass(frozen=True)
class BasePose:
    """The pose of a robot's root link in its cell; at most one of rpy, quaternion."""

    position: Vector = declared((0.0, 0.0, 0.0), "of its origin [m]")
    rpy: Vector | None = declared(None, "fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = declared(None, "x y z w, instead of rpy")

    def __post_init__(self) -> None:
        is_point = are_numbers(self.position, 3)
        if not is_point or not (np.abs(self.position) <= _MAX_DISTANCE).all():
            raise RobotError(
                f"robot.base: position {shown(self.position)} must be three finite numbers within "
                f"{_MAX_DISTANCE:g} m"
            )
        if self.rpy is not None and self.quaternion is not None:
            raise RobotError("robot.base takes rpy or quaternion, not both; remove one of them")
        if self.rpy is not None and not are_numbers(self.rpy, 3):
            raise RobotError(f"robot.base: rpy {shown(self.rpy)} must be three finite angles [rad]")
        if self.quaternion is not None:
            is_row = are_numbers(self.quaternion, 4)
            norm = float(np.linalg.norm(self.quaternion)) if is_row else 0.0
            if not _MIN_NORM < norm < _MAX_NORM:
                field = f"quaternion {shown(self.quaternion)}"
                raise RobotError(f"robot.base: {field} has no direction; give x, y, z, w")

    @cached_property
    def placement(self) -> FloatArray:
        """The pose as a homogeneous transform, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, 3] = self.position
        if self.rpy is not None:
            placement[:3, :3] = matrix_of_rpy(*self.rpy)
        if self.quaternion is not None:
            placement[:3, :3] = matrix_of_quaternion(np.array(self.quaternion, dtype=float))
        return read_only(placement)


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """Mass properties of a body, in its frame."""

    mass: float  # [kg]
    com: FloatArray  # centre of mass, shape (3,) [m]
    inertia: FloatArray  # about the centre of mass, shape (3, 3) [kg m^2]

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "com", read_only(self.com))
        object.__setattr__(self, "inertia", read_only(self.inertia))

    @cached_property
    def com_distance(self) -> float:
        """Distance of the centre of mass from the body's origin [m]."""
        return float(np.linalg.norm(self.com))

    @cached_property
    def moment(self) -> float:
        """Largest principal moment of inertia about the centre of mass [kg m^2]."""
        return float(np.linalg.eigvalsh(self.inertia).max())

    def scaled(self, factor: float) -> "BodyInertia":
        """Return the body with its density times a factor."""
        return BodyInertia(factor * self.mass, self.com, factor * self.inertia)

    def shifted(self, by: FloatArray) -> "BodyInertia":
        """Return the body with its mass moved by a vector (3,) [m]."""
        return BodyInertia(self.mass, self.com + by, self.inertia)

    def placed(self, placement: FloatArray) -> "BodyInertia":
        """Return the body's properties in another frame, in which its own has a pose (4, 4)."""
        rotation, origin = placement[:3, :3], placement[:3, 3]
        inertia = rotation @ self.inertia @ rotation.T
        return BodyInertia(self.mass, origin + rotation @ self.com, inertia)

    def plus(self, other: "BodyInertia") -> "BodyInertia":
        """Return the sum of two bodies (parallel axis theorem); a negative mass subtracts."""
        mass = self.mass + other.mass
        if mass == 0.0:
            return BodyInertia(0.0, self.com, self.inertia + other.inertia)
        com = (self.mass * self.com + other.mass * other.com) / mass
        inertia = sum(
            part.inertia + part.mass * (away @ away * np.eye(3) - np.outer(away, away))
            for part in (self, other)
            for away in [part.com - com]
        )
        return BodyInertia(mass, com, np.asarray(inertia))


@documented
@dataclass(frozen=True)
class Payload:
    """A mass carried in the tool frame."""

    mass: Finite = field(metadata=declaration("what is carried [kg]"))
    com: Vector = declared((0.0, 0.0, 0.0), "centre of mass in tool_frame [m]")
    inertia: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = declared(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "ixx iyy izz ixy ixz iyz about the com [kg m^2]"
    )

    def __post_init__(self) -> None:
        if not is_number(self.mass) or not 0 <= self.mass <= _MAX_MASS:
            raise RobotError(
                f"robot.payload: mass {in_figures(self.mass)} kg must be from 0 to {_MAX_MASS:g} kg"
            )
        for name, count, word in (("com", 3, "three"), ("inertia", 6, "six")):
            if not are_numbers(values := getattr(self, name), count):
                field = f"robot.payload: {name} {shown(values)}"
                raise RobotError(f"{field} must be {word} finite numbers")
        if (largest := float(np.abs(self.inertia).max())) > _MAX_INERTIA:
            raise RobotError(
                f"robot.payload: inertia {largest:g} kg m^2 must be at most {_MAX_INERTIA:g}"
            )
        least = np.linalg.eigvalsh(self.inertia_matrix()).min()
        if least < -1e-12 * max(1.0, largest):
            raise RobotError(f"robot.payload: inertia {self.inertia} is not positive semidefinite")

    def inertia_matrix(self) -> FloatArray:
        """Return the inertia as a matrix, shape (3, 3) [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def plus(self, other: "Payload") -> "Payload":
        """Return the sum of two payloads."""
        total = self._body.plus(other._body)
        x, y, z = total.com.tolist()
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = total.inertia.tolist()
        return Payload(total.mass, (x, y, z), (xx, yy, zz, xy, xz, yz))

    @property
    def _body(self) -> BodyInertia:
        return BodyInertia(self.mass, np.array(self.com), self.inertia_matrix())


@documented
@dataclass(frozen=True)
class ToolOffset:
    """The tool centre point in the tool frame."""

    position: Vector = declared((0.0, 0.0, 0.0), "where it is in tool_frame [m]")
    rpy: Vector = declared((0.0, 0.0, 0.0), "fixed x, y, z as in URDF [rad]")

    def __post_init__(self) -> None:
        for name in ("position", "rpy"):
            values = getattr(self, name)
            if not are_numbers(values, 3):
                field = f"{name} {shown(values)}"
                raise RobotError(f"robot.tool_offset: {field} must be three finite numbers")

    @cached_property
    def placement(self) -> FloatArray:
        """The pose as a homogeneous transform, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, 3] = self.position
        placement[:3, :3] = matrix_of_rpy(*self.rpy)
        return read_only(placement)


# ---- From a URDF to the Pinocchio model of the planning group: other joints locked, payload added.


def planning_group(
    description: UrdfDescription, tool_frame: str, joints: Sequence[str] | None
) -> list[str]:
    """Return the planning group: the requested joints, or all joints that move the tool frame.

    These are the movable joints on its chain; a joint that mimics another is replaced by its
    leader.
    """
    if not isinstance(tool_frame, str) or tool_frame not in description.links:
        message = unknown_name("tool_frame", tool_frame, description.links)
        raise RobotError(f"{description.path}: {message}")
    chain = description.chain(tool_frame)
    movers = leaders(description, chain)
    group = list(movers) if joints is None else checked_row("robot.joints", joints, "names")
    for name in group:
        if not isinstance(name, str) or name not in description.movable():
            message = unknown_name("movable joint", name, description.movable())
            raise RobotError(f"{description.path}: robot.joints: {message}")
        if group.count(name) > 1:
            raise RobotError(f"robot.joints: '{name}' is listed {group.count(name)} times")
        mimic = description.joints[name].mimic
        if mimic is not None:
            leader = leader_of(description, name).master
            raise RobotError(
                f"{description.path}: robot.joints: joint '{name}' mimics '{mimic.master}' and "
                f"cannot be planned by itself; plan '{leader}', which moves it, or leave both out: "
                f"{', '.join(other for other in group if other not in (name, leader))}"
            )
    if not set(group) & set(movers):
        raise RobotError(
            f"{description.path}: no planned joint moves tool_frame '{tool_frame}'; the "
            f"joints that do are: {', '.join(movers) or 'none'}"
        )
    return group


def build_model(
    description: UrdfDescription,
    group: Sequence[str],
    tool_frame: str,
    *,
    locked_joints: Mapping[str, float],
    gravity: Sequence[float],
    payload: Payload | None,
    needs_masses: bool,
    base: BasePose | None,
) -> pin.Model:
    """Return the Pinocchio model of a planning group and its followers.

    A follower is a joint of its own there; all limits are placeholders. If masses are needed, every
    moving body must have one.
    """
    model = _reduced_model(description, group, locked_joints)
    if base is not None:
        # The root link, and all bodies with it, move to their poses in the base frame.
        pose = pin.SE3(base.placement)
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                model.jointPlacements[joint] = pose * model.jointPlacements[joint]
        for frame in list(model.frames)[1:]:  # the first is the base frame itself
            if frame.parentJoint == 0:
                frame.placement = pose * frame.placement
    model.gravity = pin.Motion(np.array(gravity, dtype=float), np.zeros(3))
    if payload is not None:
        tool = model.frames[model.getFrameId(link_id(tool_frame), pin.FrameType.BODY)]
        inertia = pin.Inertia(payload.mass, np.array(payload.com), payload.inertia_matrix())
        model.appendBodyToJoint(tool.parentJoint, inertia, tool.placement)
    if needs_masses:
        for joint in range(1, model.njoints):
            if not model.inertias[joint].mass > 0:
                name = model.names[joint].removeprefix(joint_id(""))
                raise RobotError(
                    f"{description.path}: what joint '{name}' moves has mass "
                    f"{model.inertias[joint].mass:g} kg; efforts need the links' <inertial>"
                )
    return model


def _reduced_model(
    description: UrdfDescription, group: Sequence[str], locked: Mapping[str, float]
) -> pin.Model:
    """Return the Pinocchio model of a group and its followers, all other joints locked."""
    with _captured_c_stderr() as log:
        try:
            full = pin.buildModelFromXML(description.kinematic_xml())
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise RobotError(f"{description.path}: Pinocchio rejects it: {reason}") from error
        finally:
            log.seek(0)
            output = " ".join(log.read().decode(errors="replace").split())
    if "Error" in output:
        raise RobotError(f"{description.path}: Pinocchio rejects it: {output}")
    followers = followers_of(description, group)
    outside = [n for n in description.movable() if n not in group and n not in followers]
    for name in locked:
        if name in followers:
            raise RobotError(
                f"robot.locked_joints: '{name}' follows '{followers[name].master}', which is "
                "planned; remove it, or plan without that joint"
            )
        if name not in outside:
            raise RobotError(
                f"robot.locked_joints: {unknown_name('joint outside the group', name, outside)}"
            )
    q = pin.neutral(full)
    ids = [full.getJointId(joint_id(name)) for name in outside]
    for name, index in zip(outside, ids, strict=True):
        q[full.joints[index].idx_q] = locked_value(description, name, group, locked)
    return pin.buildReducedModel(full, ids, q)


@contextmanager
def _captured_c_stderr() -> Iterator[IO[bytes]]:
    """Send the C standard error to a file: the URDF parser gives its reasons there only."""
    with _STDERR_LOCK, tempfile.TemporaryFile() as log:
        try:
            original = os.dup(2)
        except OSError:  # there is no standard error
            yield log
            return
        os.dup2(log.fileno(), 2)
        try:
            yield log
        finally:
            os.dup2(original, 2)
            os.close(original)


def locked_value(
    description: UrdfDescription, name: str, group: Sequence[str], locked: Mapping[str, float]
) -> float:
    """Return the value of a joint outside the group [rad or m].

    It is the value in `locked`, else 0 clipped to the limits; of a mimic joint, the value that
    follows from its leader, at 0 if the leader is planned.
    """
    mimic = description.joints[name].mimic
    if mimic is None:
        return _free_value(description.joints[name], locked)
    rule = leader_of(description, name)
    leader = description.joints[rule.master]
    leader_value = 0.0 if rule.master in group else _free_value(leader, locked)
    value = rule.multiplier * leader_value + rule.offset
    if abs(locked.get(name, value) - value) > 1e-9:
        raise RobotError(
            f"robot.locked_joints: '{name}' at {locked[name]:g} contradicts the joint it mimics, "
            f"'{mimic.master}', which puts it at {value:g}"
        )
    return value


def _free_value(joint: UrdfJoint, locked: Mapping[str, float]) -> float:
    if joint.lower == joint.upper == 0.0:  # the URDF gives no limits
        return locked.get(joint.name, 0.0)
    if not joint.lower <= joint.upper:
        raise RobotError(
            f"joint '{joint.name}' has reversed position limits [{joint.lower:g}, {joint.upper:g}]"
        )
    value = locked.get(joint.name, float(np.clip(0.0, joint.lower, joint.upper)))
    if not joint.lower <= value <= joint.upper:
        raise RobotError(
            f"robot.locked_joints: '{joint.name}' at {value:g} is outside its position limits "
            f"[{joint.lower:g}, {joint.upper:g}]"
        )
    return value


# ---- A Pinocchio model: frames, bodies, efforts.


class Scratch(threading.local):
    """Buffers of Pinocchio's results, one set for each thread."""

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()
        self.pool = pin.ModelPool(model, 1)


def add_frame(model: pin.Model, name: str, link: str, offset: ToolOffset) -> int:
    """Add a frame that moves with a link to a model; return the frame's index."""
    carrier = model.frames[model.getFrameId(link_id(link), pin.FrameType.BODY)]
    placement = carrier.placement * pin.SE3(
        pin.rpy.rpyToMatrix(*offset.rpy), np.array(offset.position, dtype=float)
    )
    frame = pin.Frame(
        name, carrier.parentJoint, carrier.parentFrame, placement, pin.FrameType.OP_FRAME
    )
    return int(model.addFrame(frame))


def link_placements(
    description: UrdfDescription, model: pin.Model
) -> tuple[dict[str, int], dict[str, FloatArray]]:
    """Return the body of each link, and the link's pose (4, 4) in the body's frame, by name."""
    body, placement = {}, {}
    for name in description.links:
        frame = model.frames[model.getFrameId(link_id(name), pin.FrameType.BODY)]
        body[name] = int(frame.parentJoint)
        placement[name] = read_only(frame.placement.homogeneous)
    return body, placement


def body_inertias(model: pin.Model) -> tuple[BodyInertia, ...]:
    """Return the mass properties of all bodies, the base's zero."""
    moving = [BodyInertia(own.mass, own.lever, own.inertia) for own in list(model.inertias)[1:]]
    return (BodyInertia(0.0, np.zeros(3), np.zeros((3, 3))), *moving)


def carried_bodies(model: pin.Model) -> BoolArray:
    """Return a mask, True if a joint of the model moves a body, shape (bodies, M)."""
    moves = np.zeros((model.njoints, model.njoints - 1), dtype=bool)
    for body in range(1, model.njoints):
        moves[body, [joint - 1 for joint in _supports(model, body)]] = True
    return moves


def effort_derivatives(
    model: pin.Model, data: pin.Data, states: tuple[FloatArray, FloatArray, FloatArray]
) -> FloatArray:
    """Return the derivatives of efforts by the states, shape (3, N, effort joint, M).

    The states are positions, velocities and accelerations, (N, M) each. The data of the model are
    written to.
    """
    count = model.nv
    derivatives = np.empty((3, len(states[0]), count, count))
    for q, v, a, *blocks in zip(*states, *derivatives, strict=True):
        # The result is a set of views into data, overwritten by the next call: copied here.
        views = pin.computeRNEADerivatives(model, data, q, v, a)
        for block, view in zip(blocks, views, strict=True):
            block[:] = view
    return derivatives


def joint_axes(model: pin.Model) -> FloatArray:
    """Return the axes of the joints in the frames of the bodies they move, shape (M, 3)."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    subspaces = [data.joints[joint].S.ravel() for joint in range(1, model.njoints)]
    return np.array([s[3:] if s[3:].any() else s[:3] for s in subspaces])


def lever_arms(model: pin.Model, travel: FloatArray) -> FloatArray:
    """Return upper bounds on the distances from joints' axes to bodies' origins, (bodies, M) [m].

    0 where a joint does not move the body; each joint slides by `travel` (M,) [m] at most.
    """
    lever = np.zeros((model.njoints, model.njoints - 1))
    for body in range(1, model.njoints):
        reach = 0.0
        for joint in _supports(model, body):
            reach += float(travel[joint - 1])
            lever[body, joint - 1] = reach
            reach += float(np.linalg.norm(model.jointPlacements[joint].translation))
    return read_only(lever)


def _supports(model: pin.Model, body: int) -> list[int]:
    """Return the joints that move a body, from the body to the base."""
    joints = []
    while body > 0:
        joints.append(body)
        body = model.parents[body]
    return joints
