"""Changes of single fields: tube, obstacles, clearances, limits, payload, start, goal, duration."""

from operator import attrgetter

import numpy as np
import pytest
from asked_problems import POINTS, POST, asked, made, text_of, the

from tubeplanner.studies.change_kinds import (
    band_changes,
    cell_changes,
    clearance_changes,
    effort_changes,
    end_changes,
    holding_changes,
    limit_changes,
    obstacle_changes,
    payload_changes,
    radius_changes,
    tube_changes,
)

BOX = {"box": [0.1, 0.06], "up": [0, 0, 1]}
TURN = [0.0, 0.0, 0.0, 1.0]
HELD = {"tube.orientations": [TURN] * 4}
MIXED = {"tube.radius": [0.03, 0.05, None], "tube.cross_section": [None, None, BOX]}
PAIR = {"links": ["link2", "post.1"], "clearance": 0.02}
BAR = {"name": "bar", "box": [0.02, 0.02, 0.02], "position": [0.1, 0.0, 0.1]}
EFFORT, POSITION = "robot.limits.effort", "robot.limits.position"
MARGIN, SOFT_TEXT = f"{POSITION}_margin", "joint2: margin from position limits"
SOFT = {MARGIN: 1.0}
TABLE = {"position": [-1.0, 1.0], "effort": [20.0, 30.0]}
PAYLOAD = {"mass": 5.0, "com": [0.0, 0.0, 0.0], "inertia": [0.01, 0.01, 0.01, 0, 0, 0]}
HERE = [0.1, -1.2]
AT_GOAL = {"position": POINTS[3], "quaternion": TURN}
LIMITED = {EFFORT: [float("inf"), 20.0], "robot.limits.velocity": 5.0}
REGION = {"goal": {"position": POINTS[3], "tolerance": 0.02}}
SMALL_TOOL, CLEAR = {"tube.tool_radius": 0.01236}, {"clearance": 0.01236}
TIMED = {"objective": {"duration": 0.5}}
IN_PERIODS = {**TIMED, "period": 0.1}


def all_of(question):
    """Return the changes of the tube."""
    return list(tube_changes(question))


def better(question):
    """Return all changes that may help."""
    kinds = tube_changes, limit_changes, cell_changes, end_changes
    return [change for kind in kinds for change in kind(question)]


def worse(question):
    """Return the changes of numbers that bound the motion the other way."""
    kinds = radius_changes, effort_changes
    changes = [change for kind in kinds for change in kind(question, -1)]
    return [*changes, *clearance_changes(question, 1)]


@pytest.mark.parametrize(
    ("changes", "given", "field", "size", "text", "value"),
    [
        (worse, {}, "tube.radius.0", 0.0123, "segment 0: 30 -> 17.7 mm", [0.0177, 0.05, 0.05]),
        (better, SMALL_TOOL, "tube.tool_radius", 0.0124, "tool_radius 12.36 -> 0 mm", 0),
        (better, CLEAR, "clearance", 0.0124, "clearance 12.36 -> 0 mm", 0),
        (worse, {}, "clearance", 0.05, "clearance 0 -> 50 mm", 0.05),
        (worse, {}, f"{EFFORT}.joint1", 12.3, "joint1: 95 -> 82.7 N m", [82.7, 27]),
        (better, LIMITED, f"{EFFORT}.joint2", 1, "joint2: 1 N m more (20 -> 21 N m)", [np.inf, 21]),
        (better, REGION, "goal.tolerance", 0.0125, "goal.tolerance 20 -> 32.5 mm", 0.0325),
        (better, TIMED, "objective.duration", 0.25, "objective.duration 500 -> 750 ms", 0.75),
        (better, TIMED, "objective.duration", 1.5, "objective.duration 0.5 -> 2 s", 2),
        (better, SOFT, f"{MARGIN}.joint2", 0.5, f"{SOFT_TEXT} 1 -> 0.5 rad", [1, 0.5]),
        (better, IN_PERIODS, "objective.duration", 0.21, "objective.duration 500 -> 800 ms", 0.8),
    ],
)
def test_a_number_is_changed_by_the_size_and_its_text_says_so(
    changes, given, field, size, text, value
):
    """The largest size is rounded up: nothing becomes negative."""
    question = asked(given)
    change = the(changes(question), field)
    loaded = made(question, change, size)
    parts = [part for part in field.split(".") if not part[-1].isdigit()]
    np.testing.assert_allclose(attrgetter(".".join(parts))(loaded), value, rtol=1e-12)
    assert change.propose(size).text == text


def test_what_is_taken_from_stays_positive_and_what_is_not_there_is_not_changed():
    for field in ("tube.radius.0", f"{EFFORT}.joint1"):
        change = the(worse(asked()), field)
        assert 0 < change.propose(change.most).after < 0.02 * change.before
    fields = [change.field for change in better(asked())]
    assert not {"tube.tool_radius", "clearance", "objective.duration"} & set(fields)
    assert [each.field for each in effort_changes(asked(LIMITED), 1)] == [f"{EFFORT}.joint2"]
    assert the(worse(asked()), "clearance").scale == 0.1
    at_a_point = asked({"goal": {"position": POINTS[3], "tolerance": 0.0}})
    assert the(better(at_a_point), "goal.tolerance").scale == 0.1


@pytest.mark.parametrize(
    ("given", "others"),
    [({"tube.radius": 0.05}, (0.05, 0.05)), (MIXED, (0.03, 0.03))],
)
def test_the_radius_of_one_segment_is_wider(given, others):
    question = asked(given)
    change = the(all_of(question), "tube.radius.1")
    assert (change.before, change.unit, change.about) == (0.05, "m", {"segment 1"})
    assert change.scale == 0.05
    assert question.load().tube.radius.tolist() == [others[0], 0.05, others[1]]
    assert made(question, change, 0.0235).tube.radius.tolist() == [others[0], 0.0735, others[1]]
    proposal = change.propose(0.0235)
    assert (proposal.after, proposal.text) == (0.0735, "segment 1: 50 -> 73.5 mm")
    assert change.propose(change.most).after == pytest.approx(0.55)


def test_radii_in_a_file_of_points_are_wider_with_all_else_of_the_file(tmp_path):
    rows = [
        [*point, *TURN, radius] for point, radius in zip(POINTS, (0.03, 0.05, 0.04, 9), strict=True)
    ]
    header = "x,y,z,qx,qy,qz,qw,radius\n"
    lines = [",".join(map(str, row)) for row in rows]
    (tmp_path / "path.csv").write_text(header + "\n".join([*lines[:3], lines[3][:-1]]))
    others = {"tube.radius": None, "tube.rotation_tolerance": 3.0}
    question = asked({"tube.points": "path.csv", **others}, tmp_path)
    loaded = made(question, the(all_of(question), "tube.radius.2"), 0.01)
    assert loaded.tube.radius.tolist() == [0.03, 0.05, 0.05]
    np.testing.assert_array_equal(loaded.tube.orientations, question.load().tube.orientations)
    assert not [each for each in all_of(question) if each.kind == "point"]


def test_all_radii_are_wider_by_one_factor():
    question = asked()
    change = the(all_of(question), "tube.radius")
    assert (change.kind, change.before) == ("radii", [0.03, 0.05, 0.05])
    assert change.propose(0.123).text == "all radii times 1.123"
    np.testing.assert_allclose(made(question, change, 0.5).tube.radius, [0.045, 0.075, 0.075])
    mixed = asked(MIXED)
    wider = made(mixed, the(all_of(mixed), "tube.radius"), 1.0)
    assert wider.tube.radius.tolist() == [0.06, 0.1, 0.03]
    alone = asked({"tube.points": [[0.3, -0.5, 0], [0.3, 0.5, 0]], "tube.radius": 0.03})
    proposal = the(all_of(alone), "tube.radius").propose(0.03)  # one segment: the file's radius
    assert (proposal.changes, proposal.text) == ({"tube.radius": 0.06}, "segment 0: 30 -> 60 mm")


@pytest.mark.parametrize("given", [BOX, [BOX, BOX, BOX]])
def test_both_sides_of_a_box_grow_by_one_share(given):
    question = asked({"tube.cross_section": given, "tube.radius": None})
    change = the(all_of(question), "tube.cross_section.1.box")
    assert (change.before, change.scale, change.unit) == ([0.1, 0.06], 0.06, "m")
    proposal = change.propose(0.03)
    assert proposal.after == [0.15, 0.09]
    assert proposal.text == "box of segment 1: 100 -> 150 mm by 60 -> 90 mm"
    half_sides = made(question, change, 0.03).tube.reach
    before = question.load().tube.reach
    np.testing.assert_allclose(half_sides / before, [1, 1.5, 1])


@pytest.mark.parametrize(
    ("given", "segment"),
    [(0.2, 1), ([0.2, 0.3, 0.4], 1), ([[0.2, 0.3, 9.0]], 0), ([[0.2, 0.3, np.inf]] * 3, 2)],
)
def test_a_rotation_tolerance_is_wider_where_it_binds(given, segment):
    question = asked({**HELD, "tube.rotation_tolerance": given})
    change = the(all_of(question), f"tube.rotation_tolerance.{segment}")
    bounds = question.load().tube.rotation_tolerance
    assert change.before == np.min(bounds[segment])
    wider = made(question, change, 0.3).tube.rotation_tolerance
    least = change.before + 0.3
    np.testing.assert_allclose(wider[segment], np.maximum(bounds[segment], least))
    if given != [[0.2, 0.3, 9.0]]:  # which is for all segments
        others = [k for k in range(3) if k != segment]
        assert [wider[k] for k in others] == [bounds[k] for k in others]
    assert "rotation tolerance of segment" in text_of(change)


def test_three_bounds_for_other_than_three_segments_are_one_triple():
    given = {"tube.points": POINTS[:3], "tube.radius": 0.05, "tube.orientations": [TURN] * 3}
    question = asked({**given, "tube.rotation_tolerance": [0.2, 0.3, 0.4]})
    change = the(all_of(question), "tube.rotation_tolerance.1")
    wider = made(question, change, 0.15).tube.rotation_tolerance
    np.testing.assert_allclose(wider, [[0.2, 0.3, 0.4], [0.35, 0.35, 0.4]])
    question = asked({**HELD, "tube.rotation_tolerance": [0.2, float("inf"), 0.2]})
    fields = [each.field for each in all_of(question) if each.kind == "rotation_tolerance"]
    assert fields == ["tube.rotation_tolerance.0", "tube.rotation_tolerance.2"]  # one is free


@pytest.mark.parametrize(
    ("given", "words", "read"),
    [
        ({}, "2-3 together", {}),
        ({"goal": {"position": POINTS[3]}}, "2-3 together", {"goal.position": [0.2, 0.35, 0.0]}),
        ({"goal": {"pose": AT_GOAL}}, "2-3 together", {"goal.pose.position": [0.2, 0.35, 0.0]}),
        ({"goal": {"joints": HERE}}, "2-3 together", {"goal": {"seed": HERE}}),
        ({"start": {"joints": HERE}}, "0-1 together", {"start": {"seed": HERE}}),
        ({"start": {"joints": HERE}}, "whole tube", {"start": {"seed": HERE}}),
    ],
)
def test_points_of_an_end_move_together_and_the_end_with_them(given, words, read):
    question = asked(given)
    moves = [each for each in all_of(question) if each.field == "tube.points"]
    (change,) = [each for each in moves if words in text_of(each) and "in -y" in text_of(each)]
    proposal = change.propose(0.1)
    moved = question.spec.changed(proposal.changes).document["tube"]["points"]
    shift = np.subtract(POINTS, moved)[:, 1]
    run = {"2-3": [0, 0, 1, 1], "0-1": [1, 1, 0, 0], "who": [1, 1, 1, 1]}[words[:3]]
    np.testing.assert_allclose(shift, 0.1 * np.array(run))
    ends = {k: v for k, v in proposal.changes.items() if not k.startswith("tube.")}
    assert ends == read
    assert ("as a seed" in proposal.text) == any("seed" in value for value in read.values())
    assert change.kind == ("points" if words == "whole tube" else "point")


def test_a_reference_point_is_moved_along_axes_and_to_the_base():
    question = asked()
    changes = [each for each in all_of(question) if each.field == "tube.points.2"]
    assert len(changes) == 7
    up = the(changes, "tube.points.2", "in +z")
    assert (up.before, up.about) == (POINTS[2], {"point 2", "segment 1", "segment 2"})
    moved = made(question, up, 0.01).tube.points
    np.testing.assert_allclose(moved - POINTS, [[0] * 3, [0] * 3, [0, 0, 0.01], [0] * 3])
    nearer = the(changes, "tube.points.2", "towards the arm's base").propose(0.05)
    base = question.robot.body_poses(np.zeros((1, 2)))[1][0, 1]
    lengths = [np.linalg.norm(base - point) for point in (POINTS[2], nearer.after)]
    assert lengths[0] - lengths[1] == pytest.approx(0.05)
    assert nearer.text == "move reference point 2 by 50 mm towards the arm's base"


@pytest.mark.parametrize(
    ("given", "before", "others"),
    [
        ({"joint2": -1}, -1, {"+", "0"}),
        ({"joint2": 0}, 0, {"+", "-"}),
        ({"joint2": [-2.0, -0.1]}, [-2.0, -0.1], {"+", "-", "0"}),
    ],
)
def test_other_signs_of_a_joint_are_tried(given, before, others):
    question = asked({"tube.joint_signs": given})
    changes = [each for each in all_of(question) if each.kind == "sign"]
    assert {each.field for each in changes} == {"tube.joint_signs.joint2"}
    assert [each.before for each in changes] == [before] * len(others)
    assert {each.propose(1).after for each in changes} == others
    assert all(each.is_switch and each.about == {"joint2"} for each in changes)
    for each in changes:
        signs = made(question, each, 1).tube.joint_signs
        assert [dict(sign) for sign in signs] == [{"joint2": each.propose(1).after}] * 3


def test_the_sign_of_a_joint_is_changed_in_the_segments_that_have_one():
    question = asked({"tube.joint_signs": [{"joint2": "-"}, {"joint1": "+"}, {"joint2": "-"}]})
    change = the(all_of(question), "tube.joint_signs.joint2", "'+'")
    signs = [{"joint2": "+"}, {"joint1": "+"}, {"joint2": "+"}]
    assert change.propose(1).changes == {"tube.joint_signs": signs}
    assert change.propose(1).text == "joint_signs: '+' on joint2"


def test_points_need_not_be_passed():
    question = asked({"tube.pass_through_points": "all"})
    change = the(all_of(question), "tube.pass_through_points")
    assert question.load().tube.compulsory_points.tolist() == [1, 2]
    assert made(question, change, 1).tube.compulsory_points.tolist() == []
    assert change.propose(1).text == "pass_through_points: all -> none"
    none = [each.field for each in all_of(asked({"tube.pass_through_points": "none"}))]
    assert "tube.pass_through_points" not in none


def test_an_obstacle_is_moved_along_each_axis_whatever_its_name():
    """Where a file does not say, it is at the origin."""
    question = asked({"obstacles": [POST, {"name": "ball", "sphere": 0.05}]})
    changes = list(obstacle_changes(question))
    assert len(changes) == 12
    change = the(changes, "obstacles.post.1.position", "in -y")
    assert (change.before, change.about) == (POST["position"], {"obstacle post.1"})
    assert change.propose(0.15).text == "move obstacle 'post.1' by 150 mm in -y"
    assert change.propose(0.15).after == [0.4, 0.07, 0.0]
    before, after = (each.obstacles for each in (question.load(), made(question, change, 0.15)))
    moved = [b.shapes[0].center - a.shapes[0].center for a, b in zip(before, after, strict=True)]
    np.testing.assert_allclose(moved, [[0, -0.15, 0], [0, 0, 0]], atol=1e-12)
    other = the(changes, "obstacles.ball.position", "in +z")
    assert made(question, other, 0.2).obstacles[1].shapes[0].center.tolist() == [0, 0, 0.2]


def test_what_the_tool_carries_is_moved_in_its_frame():
    question = asked({"robot.attached": [BAR]})
    change = the(cell_changes(question), "robot.attached.bar.position", "in +x")
    assert (change.kind, change.about) == ("attached", {"link bar"})
    text = "move attached solid 'bar' by 30 mm in +x of the tool frame"
    assert change.propose(0.03).text == text
    (solid,) = made(question, change, 0.03).attached
    np.testing.assert_allclose(solid.shapes[0].center, [0.13, 0, 0.1])


def test_each_number_of_a_map_of_clearances_is_changed_alone():
    given = {"default": 0.01, "pairs": [PAIR], "segments": [0.03, None, 0.0]}
    question = asked({"clearance": given})
    default, pair, first = clearance_changes(question, -1)
    assert (default.field, made(question, default, 0.004).clearance) == ("clearance.default", 0.006)
    assert {"link link2", "obstacle post.1"} <= pair.about
    assert list(made(question, pair, 0.004).pair_clearances.values()) == [0.016]
    assert pair.propose(0.004).text == "clearance of link2 and post.1 20 -> 16 mm"
    assert (first.field, first.about) == ("clearance.segments.0", {"segment 0"})
    narrower = made(question, first, 0.004)
    np.testing.assert_allclose(narrower.tube.clearance, [0.026, np.inf, 0])
    assert narrower.clearance == 0.01
    assert first.propose(0.004).text == "clearance of segment 0 30 -> 26 mm"
    assert len(list(clearance_changes(question, 1))) == 4  # the last segment has none to lose


def sides(robot, joint=1, q=0.5):
    """Return what a joint's motor has each way at a position."""
    for each in robot.limits.effort_ranges:
        if each.joint == joint:
            return [each.allowed(np.array([q]), way)[0] for way in (-1, 1)]
    return [robot.limits.effort[joint]] * 2


@pytest.mark.parametrize(
    ("given", "before", "value", "scale"),
    [
        ({}, 27.0, 36.0, 1.0),
        ({"joint1": 80.0}, 27.0, 36.0, 0.5),
        (30.0, 30.0, {"joint1": 30.0, "joint2": 39.0}, 1.0),
        ([80.0, 20.0], 20.0, {"joint1": 80.0, "joint2": 29.0}, 0.5),
        ({"joint2": [20.0, 30.0]}, 30.0, [26.0, 39.0], 0.5),
        ({"joint2": TABLE}, 30.0, TABLE | {"effort": [26.0, 39.0]}, 0.5),
    ],
)
def test_one_joint_has_more_effort(given, before, value, scale):
    question = asked({EFFORT: given, "robot.limits.scale": {"effort": scale}})
    change = the(effort_changes(question, 1), f"{EFFORT}.joint2")
    assert (change.before, change.unit, change.about) == (before, "N m", {"joint2"})
    proposal = change.propose(9.0)
    assert list(proposal.changes.values()) == [value]
    assert proposal.after == before + 9
    assert proposal.text == f"joint2: 9 N m more ({before:g} -> {before + 9:g} N m)"
    less, more = question.robot, made(question, change, 9.0).robot
    np.testing.assert_allclose(sides(more), np.multiply(sides(less), (before + 9) / before))
    assert more.limits.effort[0] == less.limits.effort[0]


@pytest.mark.parametrize("margin", [0.0, 0.125])
@pytest.mark.parametrize("given", [{"joint2": [-3.0, 0.5]}, [[-6.0, 6.0], [-3.0, 0.5]]])
def test_one_end_of_a_range_is_moved_outwards(given, margin):
    question = asked({POSITION: given, f"{POSITION}_margin": {"joint1": margin}})
    for end, sign in (("lower", -1), ("upper", 1)):
        change = the(limit_changes(question), f"{POSITION}.joint2", end)
        both = [-3.0, 0.5]
        assert (change.before, change.unit, change.about) == (both, "rad", {"joint2"})
        wider = made(question, change, 0.25).robot.limits
        expected = [both[0] - 0.25 * (sign < 0), both[1] + 0.25 * (sign > 0)]
        np.testing.assert_allclose([wider.lower_position[1], wider.upper_position[1]], expected)
        assert wider.lower_position[0] == question.robot.limits.lower_position[0]


def test_the_payload_is_lighter_or_heavier():
    question = asked({"robot.payload": PAYLOAD, "robot.gravity": [0, -9.81, 0]})
    q = np.array([[0.3, 0.2]])
    efforts = []
    for way, mass in ((-1, 3.8), (1, 6.2)):
        (change,) = payload_changes(question, way)
        proposal = change.propose(1.2)
        assert (proposal.after, proposal.text) == (mass, f"payload at most {mass} kg")
        efforts.append(made(question, change, 1.2).robot.gravity_effort(q))
        assert change.propose(change.most).after > 0
    np.testing.assert_allclose(np.mean(efforts, axis=0), question.robot.gravity_effort(q))
    assert abs(efforts[1] - efforts[0]).min() > 1
    assert list(payload_changes(asked(), -1)) == []


def around(joints, **others):
    """Return the question with a start, about whose tool the first reference point is."""
    tool = asked().robot.tool_position([HERE])[0].tolist()
    return asked({"start": {"joints": joints}, "tube.points.0": tool, **others})


@pytest.mark.parametrize("joints", [HERE, {"joint2": HERE[1], "joint1": HERE[0]}])
def test_one_joint_of_the_start_is_turned(joints):
    question = around(joints)
    changes = list(end_changes(question))
    change = the(changes, "start.joints", "start: -0.05 rad on joint2")
    assert (change.before, change.about) == (HERE, {"start", "joint2"})
    assert change.propose(0.0123).text == "start: -0.0123 rad on joint2"
    assert made(question, change, 0.0123).start.tolist() == [0.1, -1.2123]
    fields = ["start.joints"] * 4 + ["start", "goal.tolerance"]
    assert [each.field for each in changes] == fields


def test_joints_that_are_given_may_be_left_to_inverse_kinematics():
    question = around(HERE, goal={"joints": [0.5, -1.0]})
    start, goal = (the(end_changes(question), end) for end in ("start", "goal"))
    assert start.is_switch and goal.is_switch
    assert start.propose(1).changes == {"start": {"seed": HERE}}
    assert made(question, goal, 1).goal is None
    turned = the(end_changes(question), "goal.joints", "goal: 0.05 rad on joint1")
    assert (turned.propose(0.02).after, turned.about) == ([0.52, -1.0], {"goal", "joint1"})
    beyond = asked({"start": {"joints": [0.1, 5.0]}})
    assert the(end_changes(beyond), "start").propose(1).after["seed"][1] == pytest.approx(np.pi)
    (typo,) = end_changes(asked({"start": {"joints": {"joint1": 0, "jiont2": 0}}}))
    assert typo.field == "goal.tolerance"


@pytest.mark.parametrize("goal", [None, {"seed": [0.5, -1.0]}, {"pose": AT_GOAL}])
def test_loose_ends_are_a_start_by_joints_and_a_goal_within_a_tolerance(goal):
    question = asked({"goal": goal})
    start, near, both = end_changes(question)
    q = made(question, start, 1).start
    tool = question.robot.tool_position(q[None])[0]
    np.testing.assert_allclose(tool, POINTS[0], atol=1e-6)
    assert start.propose(1).text.startswith("start: joints [")
    region = made(question, near, 0.02).goal
    np.testing.assert_array_equal([*region.position, region.tolerance], [*POINTS[3], 0.02])
    name = "its position" if goal and "pose" in goal else "reference point 3"
    assert near.propose(0.02).text == f"goal: within 20 mm of {name}, in any configuration"
    loose = made(question, both, 0.02)
    assert (loose.start.tolist(), loose.goal.tolerance) == (q.tolist(), 0.02)
    assert both.kind == "ends"


def test_limits_of_the_tool_are_changed_where_a_duration_is_required():
    fields = {"robot.limits.tool_acceleration": 20}
    assert not [c for c in limit_changes(asked(fields)) if c.kind.startswith("tool_")]
    question = asked({**fields, "objective": {"minimise": "smoothness", "duration": 2.0}})
    change = the(limit_changes(question), "robot.limits.tool_acceleration")
    assert change.propose(5.0).text == "robot.limits.tool_acceleration: 20 -> 25 m/s^2"
    assert made(question, change, 5.0).robot.limits.tool_acceleration == 25.0


PART = {"mass": 1.2, "com": [0.0, 0.0, 0.03]}
CUP = {"part": PART, "cup": {"force": 42.4, "radius": 0.015, "friction": 0.5}}
TRAY = {"part": PART, "tray": {"friction": 0.3, "foot": [0.04, 0.06]}}


def test_a_part_is_held_better_or_worse_by_one_number_of_its_contact_but_never_less_safely():
    question = asked({"holding": CUP, "robot.payload": PAYLOAD})
    change = the(limit_changes(question), "holding.cup.force")
    assert change.propose(8.6).text == "holding.cup.force 42.4 -> 51 N"
    (cup,) = made(question, change, 8.6).holding
    assert (cup.contact.force, cup.contact.safety) == (51.0, 1.5)
    lighter = the(holding_changes(question, 1), "holding.part.mass")
    assert lighter.propose(0.2).text == "holding.part.mass 1.2 -> 1 kg"
    after = made(question, lighter, 0.2)
    assert after.holding[0].mass_properties.mass == 1.0
    assert after.robot.payload.mass == 4.8  # the arm carries the part too
    fields = {change.field for change in holding_changes(question, -1)}
    assert fields == {"holding.part.mass"} | {
        f"holding.cup.{name}" for name in ("force", "friction", "radius")
    }
    question = asked({"holding": [CUP, TRAY, {"liquid": {"tilt": 0.26}}]})
    foot = the(holding_changes(question, 1), "holding.1.tray.foot")
    assert foot.propose(0.01).text == "holding.1.tray.foot 40 -> 50 mm"
    assert foot.propose(0.01).changes == {"holding.1.tray.foot": [0.05, 0.075]}
    for field in ("holding.2.liquid.tilt", "holding.1.tray.friction"):
        change = the(holding_changes(question, 1), field)
        assert change.propose(change.most).after == 1.5


BANDED = [{"speed": 0.2, "tolerance": 0.05}, {"between": [0.1, 0.3]}, 0.5]


def test_bands_are_slowed_left_to_the_joints_or_bend_wider():
    """An upper limit beside them stays; of both segments at a point the radius is widened."""
    question = asked({"tube.tool_speed": BANDED, "tube.radius": [0.03, 0.05, 0.05]})
    slower, wider, best, bend = band_changes(question)
    assert (slower.field, best.field) == ("tube.tool_speed", "tube.process.steady")
    proposal = slower.propose(0.25)
    assert proposal.text == "bands of tool_speed times 0.75"
    after = [{"speed": 0.15, "tolerance": 0.05}, {"between": [0.075, 0.225]}, 0.5]
    assert proposal.changes == {"tube.tool_speed": after}
    assert best.propose(1.0).changes == {"tube.process.steady": "best"}
    lower = [{"between": [0.08, 0.2]}, {"between": [0.08, 0.3]}, 0.5]
    assert wider.propose(0.02).changes == {"tube.tool_speed": lower}
    assert wider.propose(0.02).text == "bands of tool_speed from 0.08 m/s"
    assert bend.about == {"point 1"}
    assert bend.propose(0.03).text == "segments 0 and 1: radius 30 -> 60 mm"
    assert bend.propose(0.03).changes == {"tube.radius": [0.06, 0.06, 0.05]}
    assert bend.propose(0.01).changes == {"tube.radius": [0.04, 0.05, 0.05]}


def test_without_bands_nothing_is_steadier():
    assert list(band_changes(asked({"tube.tool_speed": [0.5, None, 0.5]}))) == []
