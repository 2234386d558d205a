"""Notes on solids that overlap where a motion begins or ends in contact."""

import numpy as np
import pytest

from tubeplanner import Contact, Obstacle, PlanningProblem, Tube, load_robot, placement_of
from tubeplanner.planning.contact_note import contact_notes
from tubeplanner.trajectory.parts import resting

Q = np.array([0.3, 0.8])


@pytest.mark.parametrize(
    ("lower", "ends", "told"),
    [
        (0.0, ("start", "goal"), []),
        (5e-5, ("start",), []),
        (3e-3, ("start",), ["start"]),
        (3e-3, ("start", "goal"), ["start", "goal"]),
        (-3e-3, ("goal",), []),
    ],
)
def test_an_overlap_is_told_with_its_end_and_depth(lower, ends, told):
    robot = load_robot("example:two_link", "hand", gravity=(0.0, 0.0, 0.0))
    hand = robot.tool_position(Q)
    # The link at the hand is 40 mm high above it, the ball has a radius of 20 mm.
    ball = Obstacle.sphere("ball", 0.02, placement_of(hand + np.array([0, 0, 0.06 - lower])))
    tube = Tube(np.array([hand, hand + np.array([0.1, 0, 0])]), 0.05)
    contacts = [Contact(("link2", "ball"), 0.1, ends)]
    problem = PlanningProblem(robot, tube, Q, obstacles=[ball], contacts=contacts)
    notes = contact_notes(problem, resting(robot.joint_names, Q, 1.0))
    assert [note.split()[2] for note in notes] == told
    for note in notes:
        assert "'link2' and 'ball' overlap by 3 mm" in note
