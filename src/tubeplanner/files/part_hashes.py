"""Hashes of the parts of a problem: what differs between the one a file was made for and another.

They tell parts apart for a note; whether two problems are the same, `fingerprint` says.
"""

import dataclasses
from collections.abc import Mapping

from tubeplanner.files.fingerprint import (
    clearance_parts,
    endpoint_parts,
    hash_of,
    limit_parts,
    motion_parts,
    solids_parts,
    tube_parts,
)
from tubeplanner.problem.problem import PlanningProblem

CARRIED = "carried solids"
_DIGITS = 8


def part_hashes(problem: PlanningProblem) -> dict[str, str]:
    """Return a hash of each part of a problem, by what messages call it."""
    robot = problem.robot
    payload = [] if robot.payload is None else list(dataclasses.astuple(robot.payload))
    touching = sorted({tuple(sorted(pair)) for pair in problem.ignore_collisions})
    parts: dict[str, list[object]] = {
        "robot": motion_parts(robot),
        "payload": payload,
        "limits or motors": limit_parts(robot),
        "tube": tube_parts(problem.tube, robot.joint_names),
        "start or goal": endpoint_parts(problem),
        "obstacles": solids_parts("obstacles", problem.obstacles),
        CARRIED: solids_parts("attached", problem.attached),
        "clearance or collision": [
            problem.clearance,
            problem.self_collision,
            *(name for pair in touching for name in pair),
            *clearance_parts(problem),
        ],
    }
    return {name: hash_of(values, _DIGITS) for name, values in parts.items()}


def differing_parts(problem: PlanningProblem, stated: Mapping[str, str]) -> list[str]:
    """Return the parts in which a problem is not the one with the stated hashes."""
    own = part_hashes(problem)
    return [name for name, value in own.items() if stated.get(name, value) != value]
