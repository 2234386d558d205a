"""Scenes of motions that were made for other problems."""

from tubeplanner import load_problem
from tubeplanner.views.scene import Layer
from tubeplanner.views.viewer import view


def test_given_notes_come_first_and_an_empty_hand_stays_empty(stored):
    trajectory = stored("ur5/over_the_wall")[1]
    part = {"name": "part", "sphere": 0.03, "touch_links": ["wrist_3_link"]}
    problem = load_problem("example:ur5/over_the_wall", changes={"robot.attached": [part]})
    scene = view(
        problem, trajectory, trajectory, names=["a", "b"], notes=["a: fails"], empty_handed=["b"]
    ).scene
    carried = [item.trajectory for item in scene.items if item.layer is Layer.CARRIED]
    assert carried == [0]
    assert scene.notes[0] == "a: fails"
