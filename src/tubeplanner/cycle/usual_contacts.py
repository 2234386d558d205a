"""What may be near to what where something is taken or let go, unless a cycle says otherwise."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.problem.contact import GOAL, START, Contact
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import required_everywhere

WITHIN = 0.03  # [m]
# What overlaps deeper than rough geometry does was not meant to touch.
_DEEPEST = 1e-3  # [m]


def usual_contacts(
    problem: PlanningProblem,
    begins_with: Sequence[str],
    ends_with: Sequence[str],
    end: FloatArray | None = None,
) -> tuple[Contact, ...]:
    """Return contacts of what changes hands, for pairs that are given none at that end.

    Something carried may be as near to obstacles, and links to something that stands, as they are
    where the motion begins or ends, if they do not overlap there. Where it is not known in which
    configuration it ends, links that move with the tool may be, and any obstacle.

    Args:
        problem: A motion.
        begins_with: What was taken or let go before it.
        ends_with: What is taken or let go after it.
        end: In which configuration it ends, shape (n,); None: as its goal says, if that does.
    """
    found = []
    goal = problem.given_goal if end is None else end
    for side, names in ((START, begins_with), (GOAL, ends_with)):
        q = problem.start if side == START else goal
        known = {frozenset(each.links) for each in problem.contacts if side in each.ends}
        for name in names:
            pairs = _near(problem, name, q if isinstance(q, np.ndarray) else None)
            fresh = [pair for pair in pairs if frozenset(pair) not in known]
            found += [Contact(pair, WITHIN, (side,)) for pair in fresh]
    return tuple(found)


def _near(problem: PlanningProblem, name: str, q: FloatArray | None) -> list[tuple[str, str]]:
    """Return the names of pairs with obstacles that something is in, and that may be near.

    Args:
        problem: The motion.
        name: The solid.
        q: The configuration there, shape (n,); None: it is open.
    """
    checker = problem.collision
    count = len(checker.obstacle_pairs)
    owners = np.array([shape.owner for shape in checker.shapes])[checker.obstacle_pairs]
    owners = owners.reshape(-1, 2)
    own = (owners == name).any(axis=1)
    if q is None:
        own &= _of_tool(problem)
    elif own.any():
        rotation, position = problem.robot.body_poses(q[None])
        distances = checker.distances(rotation[0], position[0], checker.obstacle_pairs[own])
        required = required_everywhere(problem)[:count][own]
        own[own] = (distances < required) & (distances > -_DEEPEST)
    return [(str(first), str(second)) for first, second in dict.fromkeys(map(tuple, owners[own]))]


def _of_tool(problem: PlanningProblem) -> BoolArray:
    """Return which pairs with obstacles are of what moves with the tool, shape (P,)."""
    robot, checker = problem.robot, problem.collision
    body = np.array([shape.body for shape in checker.shapes])
    is_tool: BoolArray = body[checker.obstacle_pairs[:, 0]] == robot.link_body[robot.tool_frame]
    return is_tool
