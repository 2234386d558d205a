"""What is inside what, where a motion begins or ends in contact."""

import numpy as np

from tubeplanner.problem.contact import START
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_DEEP = 1e-4  # [m]: less is what rough geometry and rounding make


def contact_notes(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return notes on solids that contacts let overlap at start or goal, by more than 0.1 mm.

    Args:
        problem: The planning problem.
        trajectory: Its answer.
    """
    checker = problem.collision
    times = {True: 0.0, False: trajectory.duration}
    notes = {}
    for contact in problem.contacts:
        pairs = checker.pairs[checker.between(*contact.links)]
        for end in contact.ends:
            q = trajectory.position(times[end == START])
            rotation, position = problem.robot.body_poses(q[None])
            depth = -float(np.min(checker.distances(rotation[0], position[0], pairs)))
            if depth > _DEEP:
                first, second = contact.links
                key = (end, frozenset(contact.links))
                notes[key] = (
                    f"at the {end} '{first}' and '{second}' overlap by {1000 * depth:.3g} mm, as "
                    "their contact allows; if that is not meant, move one of them"
                )
    return tuple(notes.values())
