"""What a URDF says of the links: mass, and what their geometry is made of."""

from collections import Counter
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from tubeplanner.robot.tool_frames import leaf_links
from tubeplanner.robot.urdf import UrdfDescription
from tubeplanner.robot.urdf_values import read_child, read_numbers


@dataclass(frozen=True)
class LinkInfo:
    """One link.

    Attributes:
        name: Its name.
        parent: The joint that it hangs from; None for the root.
        mass: [kg]; None without <inertial>.
        collision: How many <collision> of each kind, such as "mesh" or "box"; empty: never checked.
        visual: How many <visual> of each kind.
        is_leaf: Whether no other link hangs from it.
    """

    name: str
    parent: str | None
    mass: float | None
    collision: dict[str, int]
    visual: dict[str, int]
    is_leaf: bool


def link_infos(description: UrdfDescription) -> tuple[LinkInfo, ...]:
    """Return what a URDF says of its links, in the order of the file."""
    leaves = leaf_links(description)
    parents = {joint.child: joint.name for joint in description.joints.values()}
    found = []
    for name in description.links:
        element = description.link_element(name)
        kinds = _kinds(element, "collision"), _kinds(element, "visual")
        mass = _mass(f"{description.path}: link '{name}'", element)
        found.append(LinkInfo(name, parents.get(name), mass, *kinds, name in leaves))
    return tuple(found)


def _kinds(link: Element, tag: str) -> dict[str, int]:
    shapes = [shape.tag for one in link.findall(tag) for shape in one.findall("geometry/*")]
    return dict(Counter(shapes))


def _mass(where: str, link: Element) -> float | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass = read_child(f"{where}: <inertial>", inertial, "mass")
    return float(read_numbers(where, mass, "value", 1)[0])
