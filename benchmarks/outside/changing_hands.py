"""What may be near to what where something is taken or let go, if no contact is given."""

from dataclasses import replace

import numpy as np

from outside.distances import Contact
from outside.judge import Judge
from outside.nearest import Pair, Poses, owners_of, signed_distance
from outside.problem import Problem

WITHIN = 0.03  # [m]


def with_usual_contacts(
    judge: Judge, start: np.ndarray, goal: np.ndarray, taken: set[str], given: set[str]
) -> Problem:
    """Return a leg's problem with the contacts of what changes hands where it begins and ends.

    Args:
        judge: Of the leg.
        start: Configuration in which it begins, shape (n,).
        goal: In which it ends.
        taken: Names of what changed hands before it.
        given: Names of what changes hands after it.
    """
    problem = judge.problem
    contacts = problem.distances.contacts
    at_start = {contact.links for contact in contacts if contact.at_start}
    at_goal = {contact.links for contact in contacts if contact.at_goal}
    is_open = not {"joints", "seed", "pose"} & set(problem.goal)
    ending = _of_tool(judge, given) if is_open else _near(judge, given, goal)
    usual = [
        *(Contact(pair, WITHIN, True, False) for pair in _near(judge, taken, start) - at_start),
        *(Contact(pair, WITHIN, False, True) for pair in ending - at_goal),
    ]
    return replace(problem, distances=replace(problem.distances, contacts=[*contacts, *usual]))


def _near(judge: Judge, names: set[str], q: np.ndarray) -> set[frozenset[str]]:
    """Return the pairs of some names that are nearer than any segment asks."""
    distances = judge.problem.distances
    everywhere = float(distances.segments.max())
    poses = Poses(*judge.arm.poses(q[None]))
    found = set()
    for pair in _with_names(judge, names):
        asked = distances.pairs.get(owners_of(pair), everywhere)
        if signed_distance(pair, poses, 0) < asked:
            found.add(owners_of(pair))
    return found


def _of_tool(judge: Judge, names: set[str]) -> set[frozenset[str]]:
    """Return the pairs of some names that are of what moves with the tool."""
    joint = judge.arm.tool_joint
    return {owners_of(pair) for pair in _with_names(judge, names) if pair[0].joint == joint}


def _with_names(judge: Judge, names: set[str]) -> list[Pair]:
    pairs = judge.clearance.obstacle_pairs
    return [pair for pair in pairs if owners_of(pair) & names]
