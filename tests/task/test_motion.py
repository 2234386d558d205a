"""CycleMotion: one trajectory with marks, planned or read from a file."""

from dataclasses import replace

import numpy as np
import pytest
from cases import rest_to_rest
from small_cycle import three_moves

from cycles import DWELL, HOME, PICK, PLACE, move, pick_and_place, planar_arm, slow_motion
from tubeplanner import (
    Cycle,
    CycleMotion,
    Event,
    JointTrajectory,
    Mark,
    TrajectoryError,
    read_cycle_motion,
    write_cycle_motion,
)
from tubeplanner.task.motion import LegMotion, cycle_motion

CYCLE = pick_and_place()
MOTION = slow_motion(CYCLE)
TIMES = [0.0, 2.0, 2.0 + DWELL, 2.0 + DWELL, 4.0 + DWELL, 4.0 + 2 * DWELL, 4.0 + 2 * DWELL]


def test_every_step_has_a_mark_when_it_begins():
    assert [mark.time for mark in MOTION.marks] == pytest.approx(TIMES)
    kinds = ["move", "event", "attach", "move", "event", "detach", "move"]
    assert [mark.kind for mark in MOTION.marks] == kinds
    assert MOTION.marks[1] == Mark(2.0, "event", "gripper", "close")
    assert MOTION.trajectory.duration == pytest.approx(6.0 + 2 * DWELL)


def test_the_arm_stays_where_it_is_while_events_take_time():
    for begin, q in ((2.0, PICK), (4.0 + DWELL, PLACE)):
        time = np.linspace(begin, begin + DWELL, 20)
        np.testing.assert_allclose(MOTION.trajectory.position(time), [q] * 20, atol=1e-12)


def test_legs_are_what_they_were_made_of():
    for (begin, end), leg, ends in zip(
        MOTION.leg_times, MOTION.legs, [(HOME, PICK), (PICK, PLACE), (PLACE, HOME)], strict=True
    ):
        assert end - begin == pytest.approx(2.0)
        expected = rest_to_rest(CYCLE.robot.joint_names, *ends, 2.0)
        np.testing.assert_allclose(leg.coefficients, expected.coefficients)
    np.testing.assert_allclose(MOTION.junctions, [HOME, PICK, PLACE, HOME], atol=1e-12)


def test_moves_are_known_by_name():
    assert MOTION.move_times["to_place"] == pytest.approx((2.0 + DWELL, 4.0 + DWELL))
    assert list(MOTION.move_times) == ["to_pick", "to_place", "back"]


def test_moves_that_pass_through_have_a_mark_within_their_leg():
    robot = planar_arm()
    on = replace(move(robot, "on", PICK, PLACE), passes_through=True)
    steps = [Event("begin", None, 0.1), move(robot, "go", HOME, PICK), on, Event("end", None, 0.2)]
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PLACE, 2.0), (0.75,))
    motion = cycle_motion(Cycle(HOME, steps), [leg])
    assert motion.leg_times == [pytest.approx((0.1, 2.1))]
    assert motion.move_times == {
        "go": pytest.approx((0.1, 0.85)),
        "on": pytest.approx((0.85, 2.1)),
    }
    assert motion.trajectory.duration == pytest.approx(2.3)
    np.testing.assert_allclose(motion.junctions, [HOME, PLACE])
    # Where tubes overlap, hand-overs may share an instant.
    motion = cycle_motion(Cycle(HOME, steps), [replace(leg, passed=(0.0,))])
    assert motion.move_times["go"] == pytest.approx((0.1, 0.1))


def test_joints_are_put_into_the_cycles_order():
    swapped = JointTrajectory(
        MOTION.trajectory.joint_names[::-1],
        MOTION.trajectory.breakpoints,
        MOTION.trajectory.coefficients[:, :, ::-1],
    )
    motion = CycleMotion(CYCLE, swapped, MOTION.marks)
    assert motion.trajectory.joint_names == CYCLE.robot.joint_names
    np.testing.assert_allclose(motion.junctions, MOTION.junctions)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({3: {"name": "to_plce"}}, "marks are move to_pick, .*; the cycle has move to_pick, "),
        ({2: {"time": 1.9}}, "marks: event 'gripper' is from 2 to 1.9 s of a trajectory of 6.5"),
        ({0: {"time": -0.1}}, "marks: move 'to_pick' is from -0.1 to 2 s of a trajectory"),
        ({6: {"time": 7.0}}, "marks: move 'back' is from 7 to 6.5 s of a trajectory of 6.5 s"),
        ({6: {"time": 6.5}}, "marks: move 'back' is from 6.5 to 6.5 s"),
        ({1: {"time": 0.0}}, "'to_pick' is from 0 to 0 s .* and every move from stop to stop some"),
        ({3: {"time": np.nan}}, "marks: attach 'part' is from 2.25 to nan s"),
        # Whoever runs the motion would open the gripper where the cycle closes it.
        ({1: {"setting": "open"}}, "event gripper open.*; the cycle has .*event"),
    ],
)
def test_marks_of_something_else_are_refused(change, message):
    marks = [replace(mark, **change.get(k, {})) for k, mark in enumerate(MOTION.marks)]
    with pytest.raises(TrajectoryError, match=message):
        CycleMotion(CYCLE, MOTION.trajectory, tuple(marks))


def test_marks_of_no_steps_are_refused():
    with pytest.raises(TrajectoryError, match="marks are none; the cycle has move to_pick"):
        CycleMotion(CYCLE, MOTION.trajectory, ())


def test_an_event_that_takes_no_time_adds_nothing():
    motion = slow_motion(pick_and_place(dwell=1e-12))
    assert motion.trajectory.duration == pytest.approx(6.0)
    assert len(motion.trajectory.widths) == 3
    assert [mark.time for mark in motion.marks] == [0.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0]


def test_a_file_without_marks_or_of_another_cycle_is_refused(tmp_path):
    MOTION.trajectory.save(tmp_path / "bare.json")
    with pytest.raises(TrajectoryError, match=r"bare.json has no marks.*plan -o"):
        read_cycle_motion(tmp_path / "bare.json", CYCLE)
    write_cycle_motion(tmp_path / "t.json", MOTION)
    with pytest.raises(TrajectoryError, match=r"t.json: marks are .*; the cycle has"):
        read_cycle_motion(tmp_path / "t.json", three_moves())
