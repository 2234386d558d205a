"""Any arguments make an object of the public API or raise one of our errors, never another's."""

import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from any_values import VALUES, accepted, examples
from tubeplanner import (
    BasePose,
    Contact,
    GoalRegion,
    JointTrajectory,
    LimitOverrides,
    MotorOverrides,
    Objective,
    Obstacle,
    Payload,
    PlanOptions,
    PointSpeed,
    Tolerance,
    ToolOffset,
    ToolPose,
    Tube,
    placement_of,
)

STRAIGHT = Tube(np.array([[0.3, -0.3, 0], [0.3, 0.3, 0]]), np.array([0.03]))
EYE = placement_of()
WALL = Obstacle.box("wall", [0.1, 0.1, 0.1], EYE)
RIGHT = {
    "Tube": (Tube, {"points": [[0.3, 0, 0], [0.3, 0.3, 0]], "radius": [0.03]}),
    "box": (Obstacle.box, {"name": "wall", "size": [0.1, 0.1, 0.1], "placement": EYE}),
    "sphere": (Obstacle.sphere, {"name": "ball", "radius": 0.1, "placement": EYE}),
    "cylinder": (
        Obstacle.cylinder,
        {"name": "post", "radius": 0.1, "length": 1.0, "placement": EYE},
    ),
    "mesh": (Obstacle.mesh, {"name": "part", "path": "no.stl", "placement": EYE}),
    "Obstacle": (Obstacle, {"name": "wall", "shapes": WALL.shapes}),
    "placement_of": (placement_of, {"position": [0, 0, 0], "rpy": [0, 0, 0]}),
    "Contact": (Contact, {"links": ("a", "b"), "within": 0.03}),
    "GoalRegion": (GoalRegion, {"position": np.zeros(3), "tolerance": 0.01}),
    "ToolPose": (ToolPose, {"placement": EYE}),
    "Objective": (Objective, {"slack": 0.1, "minimise": "energy"}),
    "PlanOptions": (PlanOptions, {}),
    "JointTrajectory": (
        JointTrajectory,
        {
            "joint_names": ["joint1"],
            "breakpoints": [0.0, 1.0],
            "coefficients": np.zeros((6, 1, 1)),
        },
    ),
    "Payload": (Payload, {"mass": 1.0}),
    "ToolOffset": (ToolOffset, {}),
    "BasePose": (BasePose, {}),
    "PointSpeed": (PointSpeed, {"link": "hand", "position": (0.0, 0.0, 0.0), "speed": 1.0}),
    "LimitOverrides": (LimitOverrides, {"velocity": {"joint1": 3.0}}),
    "MotorOverrides": (MotorOverrides, {}),
    "Tolerance": (Tolerance, {}),
}


def names_of(make):
    return sorted(inspect.signature(make).parameters)


@pytest.mark.parametrize("what", RIGHT)
@examples(150)
@given(data=st.data())
def test_any_value_makes_an_object_or_is_refused(what, data):
    make, right = RIGHT[what]
    names = data.draw(st.lists(st.sampled_from(names_of(make)), min_size=1, max_size=2))
    arguments = {**right, **{name: data.draw(VALUES) for name in names}}
    repr(accepted(make, **arguments))
