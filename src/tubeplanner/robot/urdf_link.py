"""Checks of a URDF's links: a physical inertia, geometry with a size."""

from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.errors import RobotError
from tubeplanner.robot.urdf_values import (
    MAX_LENGTH,
    read_attribute,
    read_child,
    read_numbers,
    require_origin,
    written,
)

_INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# The lengths that give each shape its size, and how many numbers each takes.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {},
}
# How negative a principal moment may be, by rounding in exported files: share of the largest, and
# [kg m^2].
_INERTIA_SHARE, _INERTIA_TOLERANCE = 1e-3, 1e-6


def require_valid_link(where: str, link: Element) -> None:
    """Raise unless a link's inertia and collision geometry can be used.

    Args:
        where: What messages call the link.
        link: The <link> element.

    Raises:
        RobotError: An inertia or a size is missing, negative or no number; the message says which.
    """
    if link.find("inertial") is not None:
        _require_inertia(where, read_child(where, link, "inertial"))
    for collision in link.findall("collision"):
        require_origin(f"{where}: <collision>", collision)
        _require_geometry(where, read_child(f"{where}: a <collision>", collision, "geometry"))


def _require_inertia(where: str, inertial: Element) -> None:
    require_origin(f"{where}: <inertial>", inertial)
    mass = read_numbers(where, read_child(f"{where}: <inertial>", inertial, "mass"), "value", 1)[0]
    if mass < 0:
        raise RobotError(f"{where}: mass {mass:g} kg must be >= 0")
    inertia = read_child(f"{where}: <inertial>", inertial, "inertia")
    xx, yy, zz, xy, xz, yz = (read_numbers(where, inertia, key, 1)[0] for key in _INERTIA)
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if moments[0] < -max(_INERTIA_SHARE * moments[-1], _INERTIA_TOLERANCE):
        raise RobotError(
            f"{where}: the inertia has a principal moment of {moments[0]:.3g} kg m^2; no body has "
            "a negative one"
        )


def _require_geometry(where: str, geometry: Element) -> None:
    shapes = list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in _SIZES:
        found = ", ".join(f"<{shape.tag}>" for shape in shapes) or "nothing"
        known = ", ".join(f"<{tag}>" for tag in _SIZES)
        raise RobotError(f"{where}: a <geometry> holds {found}; it must hold one of {known}")
    shape = shapes[0]
    for key, count in _SIZES[shape.tag].items():
        sizes = read_numbers(where, shape, key, count)
        if not ((sizes > 0) & (sizes <= MAX_LENGTH)).all():
            raise RobotError(
                f"{where}: <{shape.tag}> {written(key, str(shape.get(key)))} must be > 0 m and at "
                f"most {MAX_LENGTH:g} m"
            )
    if shape.tag == "mesh":
        read_attribute(where, shape, "filename")
        scale = shape.get("scale")
        if scale is not None and not read_numbers(where, shape, "scale", 3).all():
            raise RobotError(f"{where}: <mesh> {written('scale', scale)} must not be 0")
