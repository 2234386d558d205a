"""Parts stand, move with the tool, and stand where the cell of the next move has them."""

from dataclasses import replace

import numpy as np
import pytest

from shown_cycle import at, motion_of, shown_cycle
from tubeplanner.collision.obstacle import Obstacle
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Attach, Detach
from tubeplanner.trajectory.marks import Mark
from tubeplanner.views.moved_parts import moved_parts

TOLERANCE = 1e-12  # [m]


@pytest.fixture
def cycle(tmp_path):
    return shown_cycle(tmp_path)


def times_of(motion):
    instants = {mark.time for mark in motion.marks}
    return np.array(sorted({*np.linspace(0, motion.trajectory.duration, 100), *instants}))


def tool_frame(cycle, q):
    """Return poses of the tool frame, which is the last body's."""
    rotation, position = cycle.robot.body_poses(q)
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation[:, -1], position[:, -1]
    return poses @ cycle.robot.link_placement["tip"]


@pytest.fixture
def seen(cycle):
    """Motion, times, tool frames, and the parts by name."""
    motion = motion_of(cycle)
    time = times_of(motion)
    tool = tool_frame(cycle, motion.trajectory.position(time))
    parts = moved_parts(cycle, motion.marks, time, tool)
    return motion, time, tool, {part.name: part for part in parts}


def test_a_part_stands_where_it_is_until_it_is_taken(cycle, seen):
    motion, time, _, parts = seen
    taken = motion.move_times["carry"][0]
    assert (parts["part"].poses[time < taken] == np.eye(4)).all()
    assert abs(parts["part"].poses[time == taken] - np.eye(4)).max() < TOLERANCE
    np.testing.assert_array_equal(
        parts["part"].surface.vertices, cycle.obstacles[0].shapes[0].vertices
    )


def test_it_keeps_its_place_in_the_tool_while_it_is_carried(seen):
    motion, time, tool, parts = seen
    begin, end = motion.move_times["carry"][0], motion.marks[7].time
    during = (time >= begin) & (time <= end)
    grips = np.linalg.inv(tool[during]) @ parts["part"].poses[during]
    assert abs(grips - grips[0]).max() < TOLERANCE
    assert np.ptp(parts["part"].poses[during], axis=0).max() > 0.3


def test_it_stands_in_the_end_where_the_next_cell_has_it(cycle, seen):
    motion, time, _, parts = seen
    (left,) = [each for each in cycle.cells(motion.seams)[2].obstacles if each.name == "part"]
    after = np.flatnonzero(time >= motion.marks[7].time)
    for step in (after[0], after[-1]):
        placed = parts["part"].surface.moved(parts["part"].poses[step]).vertices
        np.testing.assert_allclose(placed, left.shapes[0].vertices, atol=TOLERANCE)
    assert parts["part"].present.all()


def test_what_comes_and_goes_is_there_only_while_it_is_carried(seen):
    motion, time, tool, parts = seen
    begin, end = motion.marks[3].time, motion.marks[8].time
    carried = (time >= begin) & (time < end)
    np.testing.assert_array_equal(parts["cap"].present, carried)
    assert abs(parts["cap"].poses[carried] - tool[carried]).max() < TOLERANCE
    assert len(parts["cap"].seen_at(0)) == 0
    assert len(parts["cap"].seen_at(np.flatnonzero(carried)[0])) == 8


def test_a_part_may_be_taken_again(cycle):
    part = Obstacle.box("part", (0.1, 0.1, 0.1), at(0.6, 0.4, 0.05))
    moves = [replace(leg.moves[0], passes_through=False) for leg in cycle.legs]
    steps = [Attach("part"), moves[0], Detach("part"), moves[1], Attach("part"), moves[2]]
    again = Cycle(cycle.start, steps, [part])
    time, tool = np.arange(4.0), np.array([at(x, 0, 0) for x in (0, 1, 3, 7)])
    marks = [Mark(t, "event", "any") for t in (0, 0, 1, 1, 2, 2)]
    (found,) = moved_parts(again, marks, time, tool)
    np.testing.assert_allclose(found.poses[:, 0, 3], [0, 1, 1, 5])


def test_nothing_is_handed_over_before_there_is_a_motion(cycle):
    (part,) = moved_parts(cycle, (), np.zeros(1), np.eye(4)[None])
    assert part.name == "part"
    assert part.present.all()
