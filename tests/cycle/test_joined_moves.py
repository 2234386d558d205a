"""Moves that pass through as one: against a tube that is given as one."""

from dataclasses import fields, replace

import numpy as np
import pytest

from cycles import HOME, PICK, PLACE, move, planar_arm
from tubeplanner import (
    Contact,
    GoalRegion,
    LimitOverrides,
    Objective,
    ProblemError,
    Tube,
    load_robot,
)
from tubeplanner.cycle.joined_moves import joined_moves
from tubeplanner.cycle.steps import Move

ARM = planar_arm()
POINTS = np.array([[0.5, 0, 0.1], [0.4, 0.2, 0.1], [0.2, 0.3, 0.2], [0, 0.4, 0.1], [-0.2, 0.4, 0]])
STILL, TURNED = [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sin(0.4), np.cos(0.4)]
BOX = {"box": [0.1, 0.06], "up": [0, 0, 1]}
# What a tube has by segment or by point, of the four segments of POINTS.
GIVEN = {
    "radius": {"radius": [0.1, 0.2, 0.05, 0.3]},
    "joint_signs": {"joint_signs": [{}, {"joint2": "+"}, {"joint2": [0.1, 0.4]}, {"joint1": "-"}]},
    "tool_speed": {"tool_speed": [0.5, None, 0.2, 0.4]},
    "clearance": {"clearance": [0.01, 0.02, 0.03, 0.04]},
    "cross_section": {"cross_section": [None, BOX, BOX, None], "radius": [0.1, None, None, 0.3]},
    "rotation": {
        "orientations": [STILL, TURNED, TURNED, STILL, STILL],
        "rotation_tolerance": [0.1, [0.1, 0.2, np.inf], 0.3, 0.4],
    },
    "visit": {"visit": "any"},
    "tool_radius": {"tool_radius": 0.01},
    "points": {"pass_through_points": "all"},
}
BY_POINT = ("orientations",)


def part(given, first, last):
    """Return a tube over some of the segments."""
    own = {}
    for name, value in given.items():
        end = last + (name in BY_POINT)
        own[name] = value[first:end] if isinstance(value, list) else value
    return Tube(POINTS[first : last + 1], own.pop("radius", 0.1), **own)


def assert_same_tubes(found, expected):
    for name in (field.name for field in fields(Tube)):
        mine, others = getattr(found, name), getattr(expected, name)
        if name in ("joint_signs", "joint_ranges", "rotation_tolerance"):
            assert str(mine) == str(others), name
        elif isinstance(others, np.ndarray):
            np.testing.assert_allclose(mine, others, err_msg=name)
        elif name not in ("rotation", "parts"):
            assert mine == others, name


@pytest.mark.parametrize("cuts", [[2], [1], [1, 3]])
@pytest.mark.parametrize("name", GIVEN)
def test_tubes_that_meet_are_one(name, cuts):
    spans = zip([0, *cuts], [*cuts, 4], strict=True)
    moves = [Move(f"move {k}", ARM, part(GIVEN[name], *span)) for k, span in enumerate(spans)]
    assert_same_tubes(joined_moves(moves).tube, part(GIVEN[name], 0, 4))


def test_where_one_tube_binds_nothing_the_other_binds_what_it_did():
    bound = {**GIVEN["rotation"], **GIVEN["tool_speed"], "clearance": [0.01, 0.02, 0.03, 0.04]}
    first = Move("first", ARM, part(bound, 0, 2), clearance=0.1)
    second = Move("second", ARM, part({}, 2, 4), clearance=0.3)
    tube = joined_moves([first, second]).tube
    np.testing.assert_allclose(tube.tool_speed, [0.5, np.inf, np.inf, np.inf])
    np.testing.assert_allclose(tube.clearance, [0.01, 0.02, 0.3, 0.3])
    bounds = [np.ravel(bound).max() for bound in tube.rotation_tolerance]
    np.testing.assert_allclose(bounds, [0.1, np.inf, np.inf, np.inf])
    np.testing.assert_allclose(tube.orientations, [STILL, *[TURNED] * 4])
    backwards = joined_moves([replace(second, tube=part({}, 0, 2)), after(first, bound)]).tube
    np.testing.assert_allclose(backwards.clearance, [0.3, 0.3, 0.03, 0.04])
    np.testing.assert_allclose(backwards.orientations, [*[TURNED] * 3, STILL, STILL])
    assert np.isinf(np.ravel(backwards.rotation_tolerance[0])).all()


def after(move, given):
    return replace(move, name="after", tube=part(given, 2, 4))


def test_moves_of_other_clearances_keep_their_own():
    first, second = (
        Move(f"move {k}", ARM, part({}, 2 * k, 2 * k + 2), clearance=0.01 * (k + 1))
        for k in range(2)
    )
    joined = joined_moves([first, second])
    np.testing.assert_allclose(joined.tube.clearance, [0.01, 0.01, 0.02, 0.02])
    same = joined_moves([first, replace(second, clearance=0.01)])
    assert (same.clearance, same.tube.clearance) == (0.01, None)


def test_points_that_repeat_keep_their_numbers():
    """Places in the second tube are told by where the first one ends as it was given."""
    first = Tube(POINTS[[0, 0, 1, 2]], 0.1)
    joined = joined_moves([Move("a", ARM, first), Move("b", ARM, Tube(POINTS[2:], 0.1))])
    assert first.segment_count == 2
    assert joined.tube.numbers.tolist() == [*first.numbers, 4, 5]


def test_the_last_move_ends_it_and_contacts_hold_at_its_ends():
    ends = [Contact(("a", name), 0.1, when) for name, when in CONTACTS]
    goal = GoalRegion(POINTS[4], 0.01)
    first = Move("first", ARM, part({}, 0, 2), contacts=ends)
    second = Move("second", ARM, part({}, 2, 4), goal=goal, contacts=ends)
    joined = joined_moves([first, second])
    assert joined.goal is goal
    found = [(contact.links[1], contact.ends) for contact in joined.contacts]
    assert found == [("b", ("start",)), ("d", ("start",)), ("c", ("goal",)), ("d", ("goal",))]


CONTACTS = [("b", ("start",)), ("c", ("goal",)), ("d", ("start", "goal"))]
SLOW = load_robot("example:two_link", "hand", limits=LimitOverrides(tool_speed=0.5))
PAIR = ("link1", "hand")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"robot": SLOW}, "limits"),
        ({"objective": Objective(slack=0.1)}, "objective"),
        ({"ignore_collisions": [PAIR]}, "collision.ignore"),
        ({"pair_clearances": {PAIR: 0.1}}, "clearance.pairs"),
        ({"tube": part({"tool_radius": 0.01}, 2, 4)}, "tube.tool_radius"),
        ({"tube": part({"visit": "any"}, 2, 4)}, "tube.visit"),
        ({"tube": part({"pass_through_points": "none"}, 2, 4)}, "tube.pass_through_points"),
    ],
)
def test_what_holds_all_along_must_be_the_same(change, field):
    first, second = Move("first", ARM, part({}, 0, 2)), Move("second", ARM, part({}, 2, 4))
    joined_moves([first, second])
    message = f"move 'second': pass_through: {field} differs from the move's before; it must be"
    with pytest.raises(ProblemError, match=message):
        joined_moves([first, replace(second, **change)])


@pytest.mark.parametrize("goal", [PICK, GoalRegion(POINTS[2], 0.01)])
def test_where_the_arm_would_stop_it_does_not_pass(goal):
    first, second = Move("first", ARM, part({}, 0, 2)), Move("second", ARM, part({}, 2, 4))
    with pytest.raises(ProblemError, match="move 'second': pass_through: the move before it has a"):
        joined_moves([replace(first, goal=goal), second])
    joined_moves([replace(first, goal=GoalRegion(POINTS[2])), second])


def test_tubes_that_do_not_meet_are_refused():
    first = Move("first", ARM, part({}, 0, 2))
    for gap, meets in ((5e-7, True), (2e-6, False)):
        second = Move("second", ARM, Tube(POINTS[2:] + np.array([gap, 0, 0]), 0.1))
        if meets:
            joined_moves([first, second])
            continue
        with pytest.raises(
            ProblemError, match="its tube begins 2e-06 m from where the tube before"
        ):
            joined_moves([first, second])


def test_tools_that_turn_at_once_are_refused():
    given = GIVEN["rotation"]
    first, second = Move("first", ARM, part(given, 0, 2)), Move("second", ARM, part(given, 2, 4))
    flipped = replace(second, tube=turned(given, [-number for number in TURNED]))
    joined_moves([first, flipped])  # one quaternion and its negative are one rotation
    with pytest.raises(
        ProblemError, match=r"move 'second': pass_through: tube.orientations begins"
    ):
        joined_moves([first, replace(second, tube=turned(given, STILL))])


def turned(given, begin):
    orientations = [begin, STILL, TURNED]
    tolerances = given["rotation_tolerance"][2:]
    return Tube(POINTS[2:], 0.1, orientations=orientations, rotation_tolerance=tolerances)


def test_one_move_is_itself():
    only = move(ARM, "a", HOME, PLACE)
    assert joined_moves([only]) is only
