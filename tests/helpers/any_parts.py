"""Parts of which problems and cycles are made: right ones, and ones that do not fit each other."""

from functools import cache

import numpy as np
from any_values import NAMES, NUMBERS, VALUES
from hypothesis import strategies as st

from tubeplanner import (
    AttachedSolid,
    Contact,
    GoalRegion,
    LimitOverrides,
    Objective,
    Obstacle,
    Payload,
    Robustness,
    Seed,
    ToolPose,
    Tube,
    load_robot,
    placement_of,
)

LINE = [[0.3, -0.3, 0], [0.3, 0.3, 0]]
EYE = placement_of()
WALL = Obstacle.box("wall", [0.1, 0.1, 0.1], placement_of([0, -0.6, 0]))
NAMED_AS_A_LINK = Obstacle.sphere("link1", 0.1, EYE)
PEN = AttachedSolid("pen", WALL.shapes)
FLAGS = st.booleans() | VALUES


@cache
def arm(**changes):
    """Return the two-link arm, loaded once, with other arguments of `load_robot`."""
    given = {"gravity": (0, 0, 0), "limits": LimitOverrides(velocity=50.0)}
    return load_robot("example:two_link", "hand", **given, **changes)


def robots():
    """Return a strategy for arms of which some do not fit the others' tubes, and for any value."""
    arms = [arm(), arm(joints=("joint2", "joint1")), arm(payload=Payload(1.0))]
    return st.sampled_from(arms) | VALUES


TUBES = VALUES | st.sampled_from(
    [
        Tube(LINE, 0.03),
        Tube(LINE, 0.03, joint_signs={"joint2": "-"}),
        Tube(LINE, 0.03, joint_signs={"nothing": "-"}),
        Tube(LINE, 0.03, joint_signs={"joint2": [1e5, 1e6]}),
        Tube([*LINE, [0.4, 0.3, 0]], [0.03, 0.1], tool_speed=[1, None], clearance=[0.1, None]),
        Tube(LINE, 0.03, orientations=[[0, 0, 0, 1]] * 2, rotation_tolerance=0.1),
        Tube(LINE, None, cross_section={"box": [0.1, 0.2], "up": [0, 0, 1]}),
        Tube([[9, 9, 9], [9, 9, 10]], 0.1),
        Tube(LINE, 0.5, visit="any"),
    ]
)
ENDS = VALUES | st.sampled_from(
    [
        np.array([-0.2, -1.0]),
        [-0.2, -1.0],
        np.zeros(3),
        np.zeros((1, 2)),
        {"joint1": 0, "joint2": -1.0},
        {"joint1": 0},
        Seed(np.array([0.0, -1.0])),
        Seed({"joint1": 0, "joint2": -1}),
        Seed(None),
        Seed("a"),
        Seed(np.zeros(5)),
        ToolPose(placement_of([0.3, -0.3, 0])),
        ToolPose(placement_of([0.3, 0.3, 0]), np.array([0, -1.0])),
        ToolPose(placement_of([0.3, 0.3, 0]), "a"),
        GoalRegion(np.array([0.3, 0.3, 0])),
        GoalRegion(np.array([0.3, 0.3, 0]), 0.01, 0.1),
        GoalRegion(np.array([9, 9, 9])),
        None,
    ]
)
SOLIDS = (
    VALUES | st.just(WALL) | st.lists(st.sampled_from([WALL, NAMED_AS_A_LINK, PEN]), max_size=3)
)
PAIRS = st.sampled_from(
    [
        ("wall", "link1"),
        ("wall", "wall"),
        ("wall", "hand"),
        ("a", "b"),
        ("pen", "link1"),
        "ab",
        (1,),
    ]
)
CONTACTS = st.sampled_from(
    [
        Contact(("wall", "link1"), 0.1),
        Contact(("a", "b"), 0.1),
        Contact(("wall", "hand"), 0.1, ("goal",)),
    ]
)
OBJECTIVES = st.sampled_from(
    [
        Objective(minimise="energy"),
        Objective(minimise="energy", weights={"a": 1}),
        Objective(minimise="energy", weights={"joint1": 0, "joint2": 0}),
        Objective(duration=1.0),
    ]
)
OF_PROBLEMS = {
    "robot": st.deferred(robots),
    "tube": TUBES,
    "start": ENDS,
    "goal": ENDS,
    "obstacles": SOLIDS,
    "attached": SOLIDS,
    "clearance": NUMBERS | VALUES,
    "pair_clearances": VALUES | st.dictionaries(PAIRS, NUMBERS | VALUES, max_size=2),
    "contacts": VALUES | st.lists(CONTACTS, max_size=2),
    "self_collision": FLAGS,
    "ignore_collisions": VALUES | st.lists(PAIRS, max_size=2),
    "objective": VALUES | OBJECTIVES,
    "period": NUMBERS | VALUES,
    "robustness": VALUES | st.just(Robustness()),
    "name": NAMES | VALUES,
}
OF_MOVES = {
    **{name: OF_PROBLEMS[name] for name in ("robot", "tube", "goal", "clearance", "objective")},
    **{name: OF_PROBLEMS[name] for name in ("pair_clearances", "contacts", "ignore_collisions")},
    "name": NAMES | VALUES,
    "passes_through": FLAGS,
}


def some(parts, most):
    """Return a strategy for a few of these arguments, by name."""
    names = st.lists(st.sampled_from(list(parts)), min_size=1, max_size=most, unique=True)
    return names.flatmap(lambda names: st.fixed_dictionaries({name: parts[name] for name in names}))
