"""The parts of which problems and cycles are made in Python, once they are what they must be."""

from collections.abc import Iterable
from typing import Any

from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.errors import ProblemError, shown
from tubeplanner.problem.contact import Contact
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.robustness import Robustness
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube

_FLAG = (bool, "True or False")
_PARTS = {
    "robot": (RobotModel, "a RobotModel, as load_robot returns"),
    "tube": (Tube, "a Tube"),
    "objective": (Objective | None, "an Objective"),
    "robustness": (Robustness | None, "a Robustness"),
    "payload": (Payload | None, "a Payload"),
    "solid": (AttachedSolid | None, "an AttachedSolid"),
    "name": (str, "text"),
    "self_collision": _FLAG,
    "closed": _FLAG,
    "passes_through": _FLAG,
    "leaves_obstacle": _FLAG,
}
_MEMBERS = {
    "obstacles": (Obstacle, "Obstacle.box, .sphere, .cylinder, .capsule or .mesh"),
    "attached": (AttachedSolid, "AttachedSolid"),
    "ignore_collisions": (list | tuple, "pairs of names"),
    "contacts": (Contact, "Contact"),
}


def require_parts(holder: object, *names: str, called: str = "") -> None:
    """Raise ProblemError unless attributes of a problem, a cycle or a step are of their kind.

    Args:
        holder: It.
        *names: The attributes.
        called: What messages begin with.
    """
    for name in names:
        kind, remedy = _PARTS[name]
        if not isinstance(value := getattr(holder, name), kind):
            raise ProblemError(f"{called}{name} is {shown(value)}; give {remedy}")


def given_members(group: str, given: object, called: str = "") -> tuple[Any, ...]:
    """Return a group of solids, contacts or pairs of names as a tuple; one alone is taken as such.

    Args:
        group: What it is called in a `PlanningProblem`.
        given: The group.
        called: What messages begin with.

    Raises:
        ProblemError: A member is of another kind.
    """
    kind, remedy = _MEMBERS[group]
    members = tuple(given) if isinstance(given, Iterable) and _is_row(given) else (given,)
    for k, member in enumerate(members):
        is_pair = group == "ignore_collisions" and isinstance(member, kind)
        if not isinstance(member, kind) or (is_pair and not _is_pair(member)):
            raise ProblemError(f"{called}{group}[{k}] is {shown(member)}; give {remedy}")
    return members


def _is_row(given: object) -> bool:
    """Return whether what seems iterable is so: an array without a shape is not."""
    return getattr(given, "ndim", 1) > 0


def _is_pair(member: Any) -> bool:
    return len(member) == 2 and all(isinstance(name, str) for name in member)
