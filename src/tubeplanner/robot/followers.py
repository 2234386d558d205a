"""Joints that follow others by a URDF's <mimic>: whom, and how fast."""

from collections.abc import Iterable

from tubeplanner.errors import RobotError, unknown_name
from tubeplanner.robot.urdf import Mimic, UrdfDescription


def leader_of(description: UrdfDescription, name: str) -> Mimic:
    """Return the rule by which a joint follows the first of its chain of <mimic>.

    A joint without <mimic> follows itself.

    Raises:
        RobotError: It mimics an unknown joint, or joints mimic each other in a circle.
    """
    multiplier, offset = 1.0, 0.0
    followed = [name]
    while (mimic := description.joints[followed[-1]].mimic) is not None:
        where = f"{description.path}: joint '{followed[-1]}' mimics '{mimic.master}'"
        if mimic.master not in description.joints:
            names = unknown_name("joint", mimic.master, description.joints)
            raise RobotError(f"{where}: {names}")
        if mimic.master in followed:
            raise RobotError(f"{where}: joints mimic each other in a circle")
        offset += multiplier * mimic.offset
        multiplier *= mimic.multiplier
        followed.append(mimic.master)
    return Mimic(followed[-1], multiplier, offset)


def leaders(description: UrdfDescription, names: Iterable[str]) -> list[str]:
    """Return the movable joints that move some joints, in this order: themselves or their leaders.

    Raises:
        RobotError: As `leader_of`.
    """
    movable = set(description.movable())
    found = (leader_of(description, name).master for name in names)
    return [name for name in dict.fromkeys(found) if name in movable]


def followers_of(description: UrdfDescription, group: Iterable[str]) -> dict[str, Mimic]:
    """Return the joints outside a planning group that follow one of its joints, by name.

    One whose multiplier is 0 stands still and is none of them.

    Raises:
        RobotError: As `leader_of`.
    """
    planned = set(group)
    rules = {
        name: leader_of(description, name)
        for name in description.movable()
        if name not in planned and description.joints[name].mimic is not None
    }
    return {name: r for name, r in rules.items() if r.master in planned and r.multiplier != 0}
