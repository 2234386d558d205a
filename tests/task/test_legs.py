"""Leg: moves without a stop between them; open ends, rests and their labels."""

from dataclasses import fields, replace

import numpy as np
import pytest
from small_cycle import cycle_of, small_cycle
from small_cycle import move as move_fields

from cycles import HOME, PICK, PLACE, move, planar_arm, weight
from tubeplanner import (
    Attach,
    Contact,
    Detach,
    Event,
    GoalRegion,
    LimitOverrides,
    Move,
    Objective,
    ProblemError,
    Tube,
    load_robot,
)
from tubeplanner.outcome import Location
from tubeplanner.task.legs import ending_for, joined_moves, legs_of, step_text, stop_text

# An open end is turned as the next move begins.


POINTS = [[0.4, 0.0, 0.5], [0.5, 0.2, 0.4]]
DOWN, ASIDE = [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]
TILTED = [np.cos(0.3), np.sin(0.3), 0.0, 0.0]
FREE, UPRIGHT = [np.inf] * 3, [0.1, 0.1, np.inf]


def oriented(robot, name, orientation=None, tolerance=None, goal=None) -> Move:
    arguments = {}
    if orientation is not None:
        arguments = {"orientations": [orientation] * 2, "rotation_tolerance": [tolerance]}
    return Move(name, robot, Tube(POINTS, 0.05, **arguments), goal)


def test_a_tool_that_is_free_on_the_way_ends_turned_as_the_next_move_asks(ur5):
    joined = ending_for(oriented(ur5, "first"), oriented(ur5, "second", DOWN, UPRIGHT))
    assert joined.goal.rotation_tolerance == tuple(UPRIGHT)
    assert np.array_equal(joined.goal.position, POINTS[1])
    assert np.array_equal(joined.tube.orientations, [DOWN] * 2)
    assert joined.tube.rotation is None  # free on the way


def test_a_ball_keeps_its_tolerances(ur5):
    ball = GoalRegion(np.array(POINTS[1]), 0.02)
    first, second = oriented(ur5, "first", DOWN, 0.5, ball), oriented(ur5, "second", DOWN, 0.1)
    goal = ending_for(first, second).goal
    assert (goal.tolerance, goal.rotation_tolerance) == (0.02, 0.1)
    own = replace(ball, rotation_tolerance=0.03)
    assert ending_for(replace(first, goal=own), second).goal is own


def test_a_given_goal_another_orientation_and_a_free_tool_stay_as_they_are(ur5):
    second = oriented(ur5, "second", DOWN, UPRIGHT)
    fixed = oriented(ur5, "first", goal=np.zeros(6))
    assert ending_for(fixed, second) is fixed
    aside = oriented(ur5, "first", ASIDE, UPRIGHT)
    assert ending_for(aside, second) is aside
    opposite = oriented(ur5, "first", [-x for x in DOWN], UPRIGHT)  # the same rotation
    assert ending_for(opposite, second).goal.rotation_tolerance == tuple(UPRIGHT)
    first = oriented(ur5, "first")
    for free in (oriented(ur5, "second"), oriented(ur5, "second", DOWN, FREE)):
        assert ending_for(first, free) is first


def test_what_counts_is_where_the_moves_meet(ur5):
    """The last orientation of the first tube counts, and the first bound of the second tube."""
    turning = Tube(
        [*POINTS, [0.5, 0.3, 0.4]],
        0.05,
        orientations=[DOWN, DOWN, TILTED],
        rotation_tolerance=[0.1, 0.3],
    )
    second = Move("second", ur5, turning)
    joined = ending_for(oriented(ur5, "first"), second)
    assert np.array_equal(joined.tube.orientations, [DOWN] * 2)
    assert joined.goal.rotation_tolerance == 0.1
    ends_tilted = Move("first", ur5, turning)
    assert ending_for(ends_tilted, second) is ends_tilted


# Moves that pass through as one: against a tube that is given as one.


ARM = planar_arm()
CORNERS = np.array([[0.5, 0, 0.1], [0.4, 0.2, 0.1], [0.2, 0.3, 0.2], [0, 0.4, 0.1], [-0.2, 0.4, 0]])
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
    return Tube(CORNERS[first : last + 1], own.pop("radius", 0.1), **own)


FIRST, SECOND = Move("first", ARM, part({}, 0, 2)), Move("second", ARM, part({}, 2, 4))
SLOW = load_robot("example:two_link", "hand", limits=LimitOverrides(tool_speed=0.5))
PAIR = ("link1", "hand")


def assert_same_tubes(found, expected):
    for name in (field.name for field in fields(Tube)):
        mine, others = getattr(found, name), getattr(expected, name)
        if name in ("joint_signs", "joint_ranges", "rotation_tolerance"):
            assert str(mine) == str(others), name
        elif isinstance(others, np.ndarray):
            np.testing.assert_allclose(mine, others, err_msg=name)
        elif name not in ("rotation", "parts"):
            assert mine == others, name


@pytest.mark.parametrize("cuts", [[2], [1, 3]])
@pytest.mark.parametrize("name", GIVEN)
def test_tubes_that_meet_are_one(name, cuts):
    spans = zip([0, *cuts], [*cuts, 4], strict=True)
    moves = [Move(f"move {k}", ARM, part(GIVEN[name], *span)) for k, span in enumerate(spans)]
    assert_same_tubes(joined_moves(moves).tube, part(GIVEN[name], 0, 4))


def test_where_one_tube_binds_nothing_the_other_binds_what_it_did():
    bound = {**GIVEN["rotation"], **GIVEN["tool_speed"], "clearance": [0.01, 0.02, 0.03, 0.04]}
    first = replace(FIRST, tube=part(bound, 0, 2), clearance=0.1)
    second = replace(SECOND, clearance=0.3)
    tube = joined_moves([first, second]).tube
    np.testing.assert_allclose(tube.tool_speed, [0.5, np.inf, np.inf, np.inf])
    np.testing.assert_allclose(tube.clearance, [0.01, 0.02, 0.3, 0.3])
    bounds = [np.ravel(bound).max() for bound in tube.rotation_tolerance]
    np.testing.assert_allclose(bounds, [0.1, np.inf, np.inf, np.inf])
    np.testing.assert_allclose(tube.orientations, [STILL, *[TURNED] * 4])
    after = replace(first, name="after", tube=part(bound, 2, 4))
    backwards = joined_moves([replace(second, tube=part({}, 0, 2)), after]).tube
    np.testing.assert_allclose(backwards.clearance, [0.3, 0.3, 0.03, 0.04])
    np.testing.assert_allclose(backwards.orientations, [*[TURNED] * 3, STILL, STILL])
    assert np.isinf(np.ravel(backwards.rotation_tolerance[0])).all()


def test_moves_of_other_clearances_keep_their_own_and_points_that_repeat_their_numbers():
    first, second = replace(FIRST, clearance=0.01), replace(SECOND, clearance=0.02)
    joined = joined_moves([first, second])
    np.testing.assert_allclose(joined.tube.clearance, [0.01, 0.01, 0.02, 0.02])
    same = joined_moves([first, replace(second, clearance=0.01)])
    assert (same.clearance, same.tube.clearance) == (0.01, None)
    assert joined_moves([first]) is first
    # Places in the second tube are told by where the first one ends as it was given.
    repeated = replace(first, tube=Tube(CORNERS[[0, 0, 1, 2]], 0.1))
    joined = joined_moves([repeated, second])
    assert repeated.tube.segment_count == 2
    assert joined.tube.numbers.tolist() == [*repeated.tube.numbers, 4, 5]


def test_the_last_move_ends_it_and_contacts_hold_at_its_ends():
    ends = (("b", ("start",)), ("c", ("goal",)), ("d", ("start", "goal")))
    contacts = [Contact(("a", name), 0.1, when) for name, when in ends]
    goal = GoalRegion(CORNERS[4], 0.01)
    first, second = (replace(each, contacts=contacts) for each in (FIRST, SECOND))
    joined = joined_moves([first, replace(second, goal=goal)])
    assert joined.goal is goal
    found = [(contact.links[1], contact.ends) for contact in joined.contacts]
    assert found == [("b", ("start",)), ("d", ("start",)), ("c", ("goal",)), ("d", ("goal",))]


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
    message = f"move 'second': pass_through: {field} differs from the move's before; it must be"
    with pytest.raises(ProblemError, match=message):
        joined_moves([FIRST, replace(SECOND, **change)])


def shifted(gap):
    return replace(SECOND, tube=Tube(CORNERS[2:] + np.array([gap, 0, 0]), 0.1))


def turned(begin):
    orientations, tolerances = [begin, STILL, TURNED], GIVEN["rotation"]["rotation_tolerance"][2:]
    tube = Tube(CORNERS[2:], 0.1, orientations=orientations, rotation_tolerance=tolerances)
    return replace(SECOND, tube=tube)


STOPS, PASSES = (
    replace(FIRST, goal=goal) for goal in (GoalRegion(CORNERS[2], 0.01), GoalRegion(CORNERS[2]))
)
TURNING = replace(FIRST, tube=part(GIVEN["rotation"], 0, 2))


@pytest.mark.parametrize(
    ("good", "bad", "message"),
    [
        ((PASSES, SECOND), (STOPS, SECOND), "the move before it has a"),
        ((FIRST, SECOND), (replace(FIRST, goal=PICK), SECOND), "the move before it has a"),
        ((FIRST, shifted(5e-7)), (FIRST, shifted(2e-6)), "its tube begins 2e-06 m from where the"),
        # One quaternion and its negative are one rotation.
        (
            (TURNING, turned([-number for number in TURNED])),
            (TURNING, turned(STILL)),
            "tube.orientations begins",
        ),
    ],
)
def test_where_the_arm_would_stop_jump_or_turn_at_once_it_does_not_pass(good, bad, message):
    joined_moves(good)
    with pytest.raises(ProblemError, match=f"move 'second': pass_through: {message}"):
        joined_moves(bad)


# Steps as legs and rests: what runs without a stop, and what the arm carries when.


GRAVITY = (0.0, -9.81, 0.0)
HEAVY_ARM = planar_arm(GRAVITY)
GO, ON, BACK = (
    move(HEAVY_ARM, name, *ends)
    for name, ends in (("go", (HOME, PICK)), ("on", (PICK, PLACE)), ("back", (PLACE, HOME)))
)
THROUGH = replace(ON, passes_through=True)


def test_moves_that_pass_through_are_one_leg():
    legs, after = legs_of([GO, THROUGH, Event("a"), BACK, Event("b")])
    assert [leg.name for leg in legs] == ["go, on", "back"]
    assert [len(leg.before.steps) for leg in legs] == [0, 1]
    assert [step.name for step in after.steps] == ["b"]


def test_a_segment_of_a_leg_is_one_of_a_move():
    points = HEAVY_ARM.tool_position(np.linspace(HOME, PICK, 4))
    leg = legs_of([replace(GO, tube=Tube(points, 0.2)), THROUGH])[0][0]
    assert leg.first_segments == (0, 3)
    found = [(found.name, k) for found, k in map(leg.move_of, range(4))]
    assert found == [("go", 0), ("go", 1), ("go", 2), ("on", 0)]


def test_what_begins_at_rest_passes_through_nothing():
    before = {"nothing": [], "event": [GO, Event("a")], "attach": [GO, Attach("a")]}
    before["detach"] = [GO, Detach("a")]
    for kind, steps in before.items():
        with pytest.raises(
            ProblemError, match=f"move 'on': pass_through: {kind}.* comes before it"
        ):
            legs_of([*steps, THROUGH])


def gravity_efforts(arms, q=PICK):
    return np.array([arm.gravity_effort(q) for arm in arms])


def test_the_arm_feels_what_it_carries_when_it_carries_it():
    """Gravity efforts are the empty arm's plus the weight of each load through the Jacobian."""
    first, second = weight(1.5, (0.1, 0.0, 0.0)), weight(0.5, (-0.2, 0.1, 0.0))
    steps = [GO, Attach("a", first), Attach("b", second), ON, Detach("a"), BACK, Detach("b")]
    legs, after = legs_of(steps)
    alone = {
        load: gravity_efforts([load_robot("example:two_link", "hand", gravity=GRAVITY, payload=p)])
        for load, p in (("", None), ("a", first), ("b", second))
    }
    both = alone["a"] + alone["b"] - alone[""]
    efforts = gravity_efforts(leg.robot for leg in legs)
    np.testing.assert_allclose(efforts, np.vstack([alone[""], both, alone["b"]]), atol=1e-10)
    at_pick = gravity_efforts(legs[1].before.arms)
    np.testing.assert_allclose(at_pick, np.vstack([alone[""], alone["a"], both]), atol=1e-10)
    at_end = gravity_efforts(after.arms)
    np.testing.assert_allclose(at_end, np.vstack([alone["b"], alone[""]]), atol=1e-10)


def test_what_is_attached_adds_to_the_robots_own_payload():
    own, added = weight(0.8, (0.05, 0.0, 0.0)), weight(1.5, (0.1, 0.0, 0.0))
    loaded = planar_arm(GRAVITY, payload=own)
    go, on = (replace(each, robot=loaded) for each in (GO, ON))
    legs, _ = legs_of([go, Attach("a", added), on])
    expected = load_robot("example:two_link", "hand", gravity=GRAVITY, payload=own.plus(added))
    np.testing.assert_allclose(
        gravity_efforts([legs[1].robot]), gravity_efforts([expected]), atol=1e-12
    )
    assert legs[0].robot is loaded


def test_arms_that_carry_the_same_are_one_and_a_rest_names_what_changes_hands():
    """Legs with the same payload share one arm."""
    load = weight(1.0)
    legs, after = legs_of([Attach("a", load), GO, Event("x"), ON, Detach("a"), BACK])
    assert legs[0].robot is legs[1].robot is legs[2].before.arms[0]
    assert legs[2].robot is after.arms[0] is HEAVY_ARM
    legs, _ = legs_of([GO, Event("x"), Attach("a", load), Detach("a"), BACK])
    assert legs[1].before.handed_over == ("a", "a")


def test_a_place_in_a_leg_is_told_as_one_of_its_moves_in_the_cycle():
    passing = {**move_fields("second", "cd"), "pass_through": True}
    cycle = cycle_of(move_fields("first", "abc"), passing, move_fields("third", "dc"))
    leg = cycle.legs[0]
    in_cycle = [leg.in_cycle(Location(segment=segment, time=1.0), 2.0) for segment in range(3)]
    assert [(location.move, location.segment, location.time) for location in in_cycle] == [
        ("first", 0, 3.0),
        ("first", 1, 3.0),
        ("second", 0, 3.0),
    ]
    whole = leg.in_cycle(Location(joint="joint1"), 2.0)
    assert whole == Location(move="first, second", joint="joint1")
    assert [cycle.label(k) for k in (0, 1)] == [
        "moves 1 to 2 of 3, 'first', 'second'",
        "move 3 of 3, 'third'",
    ]


def test_a_rest_lists_its_steps_in_order_and_an_event_stays_on_one_line():
    cycle = small_cycle()
    assert stop_text(cycle.legs[0].before) == "nothing"
    assert stop_text(cycle.legs[1].before) == "gripper 'close' (0.05 s), attach part"
    assert stop_text(cycle.legs[2].before) == "gripper 'open' (0.06 s), detach part"
    assert stop_text(cycle.after) == "pause (0.1 s)"
    assert step_text(Event("weld")) == "weld"
    assert step_text(Event("weld", 3)) == "weld 3"
    assert "\n" not in step_text(Event("weld", "on\noff"))
