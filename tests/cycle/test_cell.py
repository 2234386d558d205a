"""The cell as it changes: where what was taken stands, against the tool's own placement."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PART, PICK, PLACE, ball, pick_and_place, planar_arm
from tubeplanner import (
    Attach,
    AttachedSolid,
    Detach,
    Event,
    Obstacle,
    ToolOffset,
    load_robot,
    placement_of,
)
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.cycle.cell import Cell

TAKE, LET_GO = Attach("part"), Detach("part")


def middle(solid):
    return np.mean([shape.center for shape in solid.shapes], axis=0)


@pytest.fixture(scope="module")
def arm():
    return planar_arm()


def test_what_is_taken_is_no_obstacle_until_it_is_let_go(arm):
    full = Cell((ball(arm), ball(arm, HOME, "other")), ())
    held = full.after(TAKE, arm, PICK)
    assert [each.name for each in held.obstacles] == ["other"]
    assert [each.name for each in held.attached] == ["part"]
    left = held.after(LET_GO, arm, PLACE)
    assert [each.name for each in left.obstacles] == ["other", "part"]
    assert left.attached == ()
    assert left.handed_over == ("part", "part")
    assert full.after(Event("gripper"), arm, PICK) is full


def test_what_is_put_down_elsewhere_stands_under_the_hand_there(arm):
    """It was 0.1 m above the hand when it was taken, and is where it is let go."""
    left = Cell((ball(arm),), ()).after(TAKE, arm, PICK).after(LET_GO, arm, PLACE)
    expected = arm.tool_position(PLACE) + np.array([0, 0, PART[1]])
    np.testing.assert_allclose(middle(left.obstacles[0]), expected, atol=1e-12)


def test_a_box_turns_with_the_hand(arm):
    """The hand of an arm in a plane is turned by the sum of its joints."""
    reach = 0.15
    start, end = np.array([0.3, 0.4]), np.array([-0.2, 1.5])
    ahead = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    where = arm.tool_position(start) + reach * ahead + np.array([0, 0, 0.1])
    box = Obstacle.box("part", [0.1, 0.02, 0.02], placement_of(where, rpy=[0, 0, 0.7]))
    left = Cell((box,), ()).after(TAKE, arm, start).after(LET_GO, arm, end)
    turned = np.array([np.cos(1.3), np.sin(1.3), 0.0])
    expected = arm.tool_position(end) + reach * turned + np.array([0, 0, 0.1])
    np.testing.assert_allclose(middle(left.obstacles[0]), expected, atol=1e-12)
    corners = left.obstacles[0].shapes[0].vertices - expected
    np.testing.assert_allclose(abs(corners @ turned), 0.05, atol=1e-12)


def test_a_tool_centre_point_moves_nothing_that_is_carried(arm):
    """Solids are in the tool frame, not at the centre point."""
    start, q = ball(arm), np.array([0.4, -0.2])
    shifted = planar_arm(tool_offset=ToolOffset((0.1, 0.0, 0.05)))
    plain = Cell((start,), ()).after(TAKE, arm, PICK).after(LET_GO, arm, q).obstacles[0]
    other = Cell((start,), ()).after(TAKE, shifted, PICK).after(LET_GO, shifted, q).obstacles[0]
    np.testing.assert_allclose(middle(other), middle(plain), atol=1e-12)


def test_what_does_not_stay_is_gone(arm):
    held = Cell((ball(arm),), ()).after(TAKE, arm, PICK)
    gone = held.after(Detach("part", leaves_obstacle=False), arm, PLACE)
    assert (gone.obstacles, gone.attached) == ((), ())


def test_a_shape_in_the_tool_frame_is_carried_from_then_on(arm):
    solid = AttachedSolid("tray", Obstacle.sphere("tray", 0.02, placement_of([0, 0, 0.3])).shapes)
    held = Cell((), ()).after(Attach("tray", solid=solid), arm, PICK)
    np.testing.assert_allclose(middle(held.attached[0]), [0, 0, 0.3])
    left = held.after(Detach("tray"), arm, HOME)
    expected = arm.tool_position(HOME) + np.array([0, 0, 0.3])
    np.testing.assert_allclose(middle(left.obstacles[0]), expected, atol=1e-12)


def test_a_mass_alone_changes_nothing_in_the_cell(arm):
    cell = Cell((ball(arm),), ())
    held = cell.after(Attach("weight"), arm, PICK)
    assert held is cell
    assert held.after(Detach("weight"), arm, PLACE).obstacles == cell.obstacles


@pytest.mark.parametrize(("gap", "touches"), [(0.0005, True), (0.002, False)])
def test_links_that_touch_what_is_taken_may(gap, touches):
    """A ball beside the forearm of a UR5 that the tool takes without being near it."""
    arm, q = load_robot("example:ur5", "tool0"), np.array([0.0, -1.2, 1.5, -0.3, 1.57, 0.0])
    rotation, position = (each[arm.link_body["forearm_link"]] for each in arm.body_poses(q))
    corners = [
        (part.shape.vertices @ rotation.T + position, part.shape.radius)
        for part in CollisionChecker(arm).shapes
        if part.owner == "forearm_link"
    ]
    tops = [placed[placed[:, 2].argmax()] + [0, 0, radius] for placed, radius in corners]
    highest = max(tops, key=lambda top: top[2])
    at = highest + np.array([0, 0, 0.02 + gap])
    held = Cell((Obstacle.sphere("part", 0.02, placement_of(at)),), ()).after(TAKE, arm, q)
    assert ("forearm_link" in held.attached[0].touch_links) == touches


def test_cells_begin_each_with_what_changed_hands_before_their_leg():
    cycle = pick_and_place()
    cells = cycle.cells([HOME, PICK, PLACE, HOME])
    assert [cell.handed_over for cell in cells] == [(), ("part",), ("part",)]
    assert [len(cell.attached) for cell in cells] == [0, 1, 0]


def test_what_changed_hands_before_the_leg_before_did_so_long_ago():
    cycle = pick_and_place()
    kept = [step for step in cycle.steps if not isinstance(step, Detach)]
    cells = replace(cycle, steps=kept, closed=False).cells([HOME, PICK, PLACE])
    assert [cell.handed_over for cell in cells] == [(), ("part",), ()]
