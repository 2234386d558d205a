"""Where something stands: the pose that a file gives it, and a robot that is fixed to its cell."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from outside.urdf import Description

_CELL = "the cell in which the robot stands"


def placement_of(fields: dict[str, Any]) -> pin.SE3:
    """Return the pose of something with `position` and `rpy` (as in URDF) or `quaternion`."""
    position = np.array(fields.get("position") or [0.0] * 3, dtype=float)
    if fields.get("quaternion") is not None:
        x, y, z, w = fields["quaternion"]
        turn = pin.Quaternion(float(w), float(x), float(y), float(z)).normalized()
        return pin.SE3(turn.matrix(), position)
    roll, pitch, yaw = fields.get("rpy") or [0.0] * 3
    return pin.SE3(pin.rpy.rpyToMatrix(float(roll), float(pitch), float(yaw)), position)


def standing(description: Description, base: dict[str, Any]) -> Description:
    """Return a robot whose root link hangs from one more, the cell's, by a fixed joint."""
    tree = ElementTree.fromstring(description.xml)
    roots = description.links - description.parents.keys()
    place = placement_of(base)
    joint = ElementTree.Element("joint", name=f"to {_CELL}", type="fixed")
    rpy = pin.rpy.matrixToRpy(place.rotation)
    origin = {"xyz": _written(place.translation), "rpy": _written(rpy)}
    ElementTree.SubElement(joint, "origin", origin)
    ElementTree.SubElement(joint, "parent", link=_CELL)
    ElementTree.SubElement(joint, "child", link=next(iter(roots)))
    tree.extend([ElementTree.Element("link", name=_CELL), joint])
    return replace(description, xml=ElementTree.tostring(tree, encoding="unicode"))


def _written(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
