"""Samples of cycles: times, rests, and efforts with what is carried then."""

import numpy as np
import pytest
from small_cycle import planned_cycle

from tubeplanner.files.cycle_samples import cycle_samples

RATE = 200.0


@pytest.fixture(scope="module")
def samples():
    return cycle_samples(planned_cycle().motion, RATE)


@pytest.fixture(scope="module")
def whole(samples):
    return samples.whole()


def test_times_increase_to_the_end_of_all_parts(samples, whole):
    table, effort = whole
    assert (np.diff(table.time) > 0).all()
    last = samples.begins[-1] + samples.legs[-1].samples.time[-1]
    assert table.time[-1] == pytest.approx(last + 0.1)
    assert np.diff(samples.begins) == pytest.approx(
        [samples.legs[0].samples.time[-1] + 0.05, samples.legs[1].samples.time[-1] + 0.06]
    )
    assert effort.shape == table.position.shape


def test_the_arm_stays_in_the_seams_while_it_dwells(samples, whole):
    table, _ = whole
    seams = planned_cycle().motion.seams
    for seam, begin, dwell in zip(seams[1:3], samples.begins[1:], (0.05, 0.06), strict=True):
        inside = (table.time > begin - dwell) & (table.time < begin)
        assert inside.sum() >= dwell * RATE - 2
        np.testing.assert_allclose(table.position[inside], seam[None].repeat(inside.sum(), 0))
        assert not table.velocity[inside].any()


def test_the_motors_hold_what_is_carried_then(samples, whole):
    """The gripper closes before the part is taken, and opens before it is let go."""
    table, effort = whole
    cycle, seams = planned_cycle().motion.cycle, planned_cycle().motion.seams
    empty, loaded = cycle.legs[0].robot, cycle.legs[1].robot
    for begin, q, arm in (
        (samples.begins[1], seams[1], empty),
        (samples.begins[2], seams[2], loaded),
    ):
        row = int(np.flatnonzero(table.time < begin - 1e-9)[-1])
        np.testing.assert_allclose(effort[row], arm.gravity_effort(q))
    first = int(np.flatnonzero(table.time > samples.begins[1] - 1e-9)[0])
    state = (table.position[first], table.velocity[first], table.acceleration[first])
    carried = loaded.inverse_dynamics(*(each[None] for each in state))[0]
    np.testing.assert_allclose(effort[first], carried)
    assert abs(loaded.gravity_effort(seams[1]) - empty.gravity_effort(seams[1])).max() > 0.1


def test_notes_tell_how_samples_differ_and_when_moves_begin(samples):
    *each, last = samples.notes
    assert [note.split(":")[0] for note in each] == [
        "move 'over'",
        "move 'down, beside'",
        "move 'back'",
    ]
    assert "longer than the trajectory" in each[0]
    assert last.startswith("in CSV, moves begin later than in the trajectory: over at 0.0000 s, ")


def test_with_a_period_samples_are_the_motion_itself():
    motion = planned_cycle(period=0.01).motion
    samples = cycle_samples(motion, 100.0)
    table, _ = samples.whole()
    assert samples.notes == ()
    np.testing.assert_allclose(table.time, np.arange(len(table.time)) * 0.01, atol=1e-9)
    np.testing.assert_allclose(table.position, motion.trajectory.position(table.time), atol=1e-9)
