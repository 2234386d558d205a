"""From a URDF to the Pinocchio model of the planned joints: others locked, payload attached."""

import os
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import RobotError, unknown_name
from tubeplanner.robot.urdf import Mimic, UrdfDescription, UrdfJoint, joint_id, link_id

_HEAVIEST = 1e6  # [kg]
# The standard error is the process's: one reader at a time takes it.
_STDERR_LOCK = threading.Lock()


@dataclass(frozen=True)
class Payload:
    """A mass carried in the tool frame.

    Attributes:
        mass: [kg], >= 0.
        com: Centre of mass in the tool frame [m].
        inertia: ixx, iyy, izz, ixy, ixz, iyz about the centre of mass, axes of the tool frame
            [kg m^2].
    """

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 <= self.mass <= _HEAVIEST:
            raise RobotError(
                f"robot.payload: mass {self.mass:g} kg must be from 0 to {_HEAVIEST:g} kg"
            )
        if np.shape(self.com) != (3,) or not np.isfinite(self.com).all():
            raise RobotError(f"robot.payload: com {self.com} must be three finite numbers")
        if np.shape(self.inertia) != (6,) or not np.isfinite(self.inertia).all():
            raise RobotError(f"robot.payload: inertia {self.inertia} must be six finite numbers")
        if np.linalg.eigvalsh(self.inertia_matrix()).min() < -1e-12:
            raise RobotError(f"robot.payload: inertia {self.inertia} is not positive semidefinite")

    def inertia_matrix(self) -> FloatArray:
        """Return the inertia as a matrix, shape (3, 3) [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True)
class ToolOffset:
    """The tool centre point in the tool frame.

    Attributes:
        position: [m].
        rpy: Roll, pitch, yaw about fixed x, y, z, as in URDF [rad].
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("position", "rpy"):
            values = getattr(self, name)
            if np.shape(values) != (3,) or not np.isfinite(values).all():
                raise RobotError(f"robot.tool_offset: {name} {values} must be three finite numbers")


def planning_group(
    description: UrdfDescription, tool_frame: str, joints: Sequence[str] | None
) -> list[str]:
    """Return the joints to plan for: the requested ones, or the movable ones on the tool's chain.

    Raises:
        RobotError: A name does not exist or is doubled, a joint mimics another, or none of the
            joints moves the tool frame.
    """
    if tool_frame not in description.links:
        message = unknown_name("tool_frame", tool_frame, description.links)
        raise RobotError(f"{description.path}: {message}")
    chain = description.chain(tool_frame)
    group = list(chain if joints is None else joints)
    for name in group:
        if name not in description.movable():
            message = unknown_name("movable joint", name, description.movable())
            raise RobotError(f"{description.path}: robot.joints: {message}")
        if group.count(name) > 1:
            raise RobotError(f"robot.joints: '{name}' is listed {group.count(name)} times")
        mimic = description.joints[name].mimic
        if mimic is not None:
            raise RobotError(
                f"{description.path}: joint '{name}' mimics '{mimic.master}' and cannot be planned "
                "by itself; choose joints without it"
            )
    if not set(group) & set(chain):
        raise RobotError(
            f"{description.path}: no planned joint moves tool_frame '{tool_frame}'; the movable "
            f"joints on its chain are: {', '.join(chain) or 'none'}"
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
) -> pin.Model:
    """Return the Pinocchio model of the planning group; its limits are placeholders.

    Args:
        description: The robot.
        group: The joints to plan for.
        tool_frame: The link that carries the payload.
        locked_joints: Values of other joints, by name [rad or m].
        gravity: In the base frame [m/s^2].
        payload: Carried mass, if any.
        needs_masses: Whether efforts count, so that every moving body must have a mass.

    Raises:
        RobotError: Pinocchio rejects the robot, a locked joint is out of place, or a mass is
            missing.
    """
    model = _reduced_model(description, group, locked_joints)
    model.gravity = pin.Motion(np.array(gravity, dtype=float), np.zeros(3))
    if payload is not None:
        tool = model.frames[model.getFrameId(link_id(tool_frame), pin.FrameType.BODY)]
        inertia = pin.Inertia(payload.mass, np.array(payload.com), payload.inertia_matrix())
        model.appendBodyToJoint(tool.parentJoint, inertia, tool.placement)
    if needs_masses:
        _require_masses(description, model)
    return model


def link_placements(
    description: UrdfDescription, model: pin.Model
) -> tuple[dict[str, int], dict[str, FloatArray]]:
    """Return the body of every link, and its pose in that body's frame, shape (4, 4), by name."""
    body, placement = {}, {}
    for name in description.links:
        frame = model.frames[model.getFrameId(link_id(name), pin.FrameType.BODY)]
        body[name] = int(frame.parentJoint)
        placement[name] = read_only(frame.placement.homogeneous)
    return body, placement


def add_tool_centre_point(model: pin.Model, tool_frame: str, offset: ToolOffset) -> int:
    """Add the tool centre point to a model; return the index of its frame."""
    tool = model.frames[model.getFrameId(link_id(tool_frame), pin.FrameType.BODY)]
    placement = tool.placement * pin.SE3(
        pin.rpy.rpyToMatrix(*offset.rpy), np.array(offset.position, dtype=float)
    )
    frame = pin.Frame(
        "tool centre point", tool.parentJoint, tool.parentFrame, placement, pin.FrameType.OP_FRAME
    )
    return int(model.addFrame(frame))


def _reduced_model(
    description: UrdfDescription, group: Sequence[str], locked: Mapping[str, float]
) -> pin.Model:
    """Return the Pinocchio model of the group alone, all other joints locked."""
    full = _parse(description)
    outside = [name for name in description.movable() if name not in group]
    for name in locked:
        if name not in outside:
            raise RobotError(
                f"robot.locked_joints: {unknown_name('joint outside the group', name, outside)}"
            )
    q = pin.neutral(full)
    ids = [full.getJointId(joint_id(name)) for name in outside]
    for name, index in zip(outside, ids, strict=True):
        q[full.joints[index].idx_q] = _locked_value(description, name, group, locked)
    return pin.buildReducedModel(full, ids, q)


def _locked_value(
    description: UrdfDescription, name: str, group: Sequence[str], locked: Mapping[str, float]
) -> float:
    """Return the value of a joint outside the group: given, zero, or what its master makes it."""
    factor, offset, leader = 1.0, 0.0, description.joints[name]
    followed = [name]
    while leader.mimic is not None:
        factor, offset = factor * leader.mimic.multiplier, offset + factor * leader.mimic.offset
        leader = _master(description, leader.mimic, followed, group)
        followed.append(leader.name)
    if len(followed) == 1:
        return _free_value(leader, locked)
    value = factor * _free_value(leader, locked) + offset
    if abs(locked.get(name, value) - value) > 1e-9:
        raise RobotError(
            f"robot.locked_joints: '{name}' at {locked[name]:g} contradicts the joint it mimics, "
            f"'{followed[1]}', which puts it at {value:g}"
        )
    return value


def _master(
    description: UrdfDescription, mimic: Mimic, followed: list[str], group: Sequence[str]
) -> UrdfJoint:
    where = f"{description.path}: joint '{followed[-1]}' mimics '{mimic.master}'"
    if mimic.master not in description.joints:
        names = unknown_name("joint", mimic.master, description.joints)
        raise RobotError(f"{where}: {names}")
    if mimic.master in followed:
        raise RobotError(f"{where}: joints mimic each other in a circle")
    if mimic.master in group:
        raise RobotError(
            f"{where}, which is planned: a joint that moves along with a planned one is not "
            "supported; lock the master or remove the <mimic>"
        )
    return description.joints[mimic.master]


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


def _parse(description: UrdfDescription) -> pin.Model:
    """Return the whole robot as a Pinocchio model; its C++ errors become RobotError."""
    with _captured_c_stderr() as log:
        try:
            model = pin.buildModelFromXML(description.kinematic_xml())
        except ValueError as error:
            raise RobotError(f"{description.path}: Pinocchio rejects it: {error}") from error
        finally:
            log.seek(0)
            complaints = log.read().decode(errors="replace").strip()
    if "Error" in complaints:
        raise RobotError(f"{description.path}: Pinocchio rejects it: {complaints}")
    return model


@contextmanager
def _captured_c_stderr() -> Iterator[IO[bytes]]:
    """Send the C standard error to a file: the URDF parser gives its reasons there only."""
    with _STDERR_LOCK, tempfile.TemporaryFile() as log:
        try:
            kept = os.dup(2)
        except OSError:  # there is no standard error
            yield log
            return
        os.dup2(log.fileno(), 2)
        try:
            yield log
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _require_masses(description: UrdfDescription, model: pin.Model) -> None:
    for joint in range(1, model.njoints):
        if not model.inertias[joint].mass > 0:
            name = model.names[joint].removeprefix(joint_id(""))
            raise RobotError(
                f"{description.path}: what joint '{name}' moves has mass "
                f"{model.inertias[joint].mass:g} kg; efforts need the links' <inertial>"
            )
