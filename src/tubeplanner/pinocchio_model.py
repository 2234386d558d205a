"""From a URDF to the Pinocchio model of the planned joints: others locked, payload attached."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, unknown_name
from tubeplanner.urdf import UrdfDescription


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
        if not 0 <= self.mass < np.inf:
            raise RobotError(f"payload: mass {self.mass:g} kg must be >= 0 and finite")
        if np.linalg.eigvalsh(self.inertia_matrix()).min() < -1e-12:
            raise RobotError(f"payload: inertia {self.inertia} is not positive semidefinite")

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


def planning_group(
    description: UrdfDescription, tool_frame: str, joints: Sequence[str] | None
) -> list[str]:
    """Return the joints to plan for: those asked for, or the movable ones on the tool's chain.

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
            raise RobotError(f"{description.path}: joints: {message}")
        if group.count(name) > 1:
            raise RobotError(f"joints: '{name}' is listed {group.count(name)} times")
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
        tool = model.frames[model.getFrameId(tool_frame, pin.FrameType.BODY)]
        inertia = pin.Inertia(payload.mass, np.array(payload.com), payload.inertia_matrix())
        model.appendBodyToJoint(tool.parentJoint, inertia, tool.placement)
    if needs_masses:
        _require_masses(description, model)
    return model


def _reduced_model(
    description: UrdfDescription, group: Sequence[str], locked: Mapping[str, float]
) -> pin.Model:
    """Return the Pinocchio model of the group alone, all other joints locked."""
    full = _parse(description)
    outside = [name for name in description.movable() if name not in group]
    for name in locked:
        if name not in outside:
            raise RobotError(
                f"locked_joints: {unknown_name('joint outside the group', name, outside)}"
            )
    values = {name: _locked_value(description, name, locked) for name in outside}
    q = pin.neutral(full)
    for name, value in values.items():
        q[full.joints[full.getJointId(name)].idx_q] = value
    return pin.buildReducedModel(full, [full.getJointId(name) for name in outside], q)


def _locked_value(description: UrdfDescription, name: str, locked: Mapping[str, float]) -> float:
    joint = description.joints[name]
    if joint.mimic is None:
        value = locked.get(name, float(np.clip(0.0, joint.lower, joint.upper)))
        if not joint.lower <= value <= joint.upper:
            raise RobotError(
                f"locked_joints: '{name}' at {value:g} is outside its position limits "
                f"[{joint.lower:g}, {joint.upper:g}]"
            )
        return value
    if joint.mimic.master not in description.joints:
        message = unknown_name("joint", joint.mimic.master, description.joints)
        raise RobotError(f"{description.path}: joint '{name}' mimics: {message}")
    master = _locked_value(description, joint.mimic.master, locked)
    value = joint.mimic.multiplier * master + joint.mimic.offset
    if abs(locked.get(name, value) - value) > 1e-9:
        raise RobotError(
            f"locked_joints: '{name}' at {locked[name]:g} contradicts the joint it mimics, "
            f"'{joint.mimic.master}', which puts it at {value:g}"
        )
    return value


def _parse(description: UrdfDescription) -> pin.Model:
    """Return the whole robot as a Pinocchio model, its C++ complaints turned into ours."""
    with tempfile.TemporaryFile() as log:
        kept = os.dup(2)
        os.dup2(log.fileno(), 2)  # the URDF parser gives its reasons on the C stderr only
        try:
            return pin.buildModelFromXML(description.kinematic_xml())
        except ValueError as error:
            log.seek(0)
            reason = log.read().decode(errors="replace").strip() or str(error)
            raise RobotError(f"{description.path}: Pinocchio rejects it: {reason}") from error
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _require_masses(description: UrdfDescription, model: pin.Model) -> None:
    for joint in range(1, model.njoints):
        if not model.inertias[joint].mass > 0:
            raise RobotError(
                f"{description.path}: what joint '{model.names[joint]}' moves has mass "
                f"{model.inertias[joint].mass:g} kg; efforts need the links' <inertial>"
            )
