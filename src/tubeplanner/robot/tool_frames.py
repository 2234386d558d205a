"""The links of a robot that a tool may be fixed to, and the likeliest of them."""

from collections.abc import Iterator

from tubeplanner.errors import RobotError
from tubeplanner.robot.urdf import MOVABLE_TYPES, UrdfDescription


def leaf_links(description: UrdfDescription) -> tuple[str, ...]:
    """Return the links from which no other hangs, in the order of the file."""
    parents = {joint.parent for joint in description.joints.values()}
    return tuple(link for link in description.links if link not in parents)


def likely_tool_frame(description: UrdfDescription) -> str:
    """Return the link where the longest chain of movable joints ends, above its fingers.

    Fingers are what hangs from a link where the chain parts, if it has fewer joints than the chain
    up to there. What hangs rigidly from the end is preferred, the last of the longest row; of equal
    ones a link that is a frame alone, without collision geometry or inertia.

    Raises:
        RobotError: No joint can move.
    """
    leaves = leaf_links(description)
    longest = max(leaves, key=lambda link: len(description.chain(link)))
    if not description.chain(longest):
        raise RobotError(f"{description.path}: no joint can move; there is nothing to plan")
    end = _above_fingers(description, longest)
    ways = dict(_rigid_ways(description, end, 0))
    deepest = max(ways.values())
    found = [link for link, depth in ways.items() if depth == deepest]
    return next((link for link in found if _is_frame(description, link)), found[0])


def _above_fingers(description: UrdfDescription, tip: str) -> str:
    """Return the highest link on the way to a tip at which fingers part; the tip if none do."""
    by_child = {joint.child: joint for joint in description.joints.values()}
    below, link, end = 0, tip, tip
    total = len(description.chain(tip))
    while link in by_child:
        joint = by_child[link]
        below += joint.type in MOVABLE_TYPES
        link = joint.parent
        branches = [own for own in _children(description, link) if _moves(description, own)]
        if len(branches) > 1 and 0 < below < total - below:
            end = link
    return end


def _children(description: UrdfDescription, link: str) -> list[str]:
    return [joint.name for joint in description.joints.values() if joint.parent == link]


def _moves(description: UrdfDescription, joint: str) -> bool:
    """Return whether a joint or one below it can move."""
    own = description.joints[joint]
    below = _children(description, own.child)
    return own.type in MOVABLE_TYPES or any(_moves(description, name) for name in below)


def _rigid_ways(description: UrdfDescription, link: str, depth: int) -> Iterator[tuple[str, int]]:
    """Yield a link and all that hang rigidly from it, each with how many joints below it."""
    yield link, depth
    for name in _children(description, link):
        joint = description.joints[name]
        if joint.type not in MOVABLE_TYPES:
            yield from _rigid_ways(description, joint.child, depth + 1)


def _is_frame(description: UrdfDescription, link: str) -> bool:
    """Return whether a link has neither geometry that collides nor mass."""
    element = description.link_element(link)
    return element.find("collision") is None and element.find("inertial") is None
