import numpy as np
import pytest

from simulated_cycle import (
    DURATION,
    DWELL,
    PART,
    PLACE,
    SEAMS,
    followed_cycle,
    motion_of,
    moves_of,
    picking,
    slide,
)
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Attach, Detach, Event
from tubeplanner.simulation.executed_legs import executed_legs

PERIOD = 0.007
TAKEN = DURATION + DWELL
LEFT = TAKEN + DWELL + DURATION + DWELL


def test_a_leg_counts_while_the_tool_has_in_its_hand_what_it_has(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = followed_cycle(motion, period=PERIOD)
    legs = executed_legs(motion, execution)
    assert [leg.begin for leg in legs] == pytest.approx([0.0, TAKEN, LEFT])
    lasts = [leg.begin + leg.execution.time[-1] for leg in legs]
    np.testing.assert_allclose(lasts, [TAKEN, LEFT, execution.time[-1]], atol=PERIOD + 1e-9)
    assert lasts[0] <= TAKEN + 1e-9
    assert lasts[1] <= LEFT + 1e-9
    assert all(0 <= leg.execution.time[0] < PERIOD for leg in legs)
    names = [leg.leg.name for leg in legs]
    assert names == ["reach", "carry", "back"]


def test_a_leg_has_the_motion_and_the_runs_of_its_own_time(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = followed_cycle(motion, period=PERIOD)
    execution.velocity[:] = execution.time[:, None]
    execution.effort[:] = 2 * execution.time[:, None]
    execution.is_saturated[:] = (execution.time > TAKEN)[:, None]
    for leg in executed_legs(motion, execution):
        time = leg.execution.time
        planned = leg.trajectory.position(np.minimum(time, leg.trajectory.duration))
        np.testing.assert_allclose(leg.execution.position[0], planned, atol=1e-9)
        np.testing.assert_allclose(leg.execution.velocity[0, :, 0], leg.begin + time)
        np.testing.assert_allclose(leg.execution.effort[0, :, 0], 2 * (leg.begin + time))
        assert leg.execution.is_saturated.any() == (leg.begin > 0)


def test_the_part_stands_where_the_motion_leaves_it(tmp_path):
    motion = motion_of(picking(tmp_path))
    before, with_it, after = executed_legs(motion, followed_cycle(motion))
    assert [len(leg.problem.obstacles) for leg in (before, with_it, after)] == [1, 0, 1]
    assert [len(leg.problem.attached) for leg in (before, with_it, after)] == [0, 1, 0]
    stands = after.problem.obstacles[0].shapes[0].vertices.mean(axis=0)
    turned, tool = motion.cycle.robot.tool_pose(SEAMS[1:3])
    in_hand = turned[0].T @ (PLACE - tool[0])
    np.testing.assert_allclose(stands, tool[1] + turned[1] @ in_hand, atol=1e-9)
    assert with_it.problem.robot.payload is not None


def test_where_only_time_passes_a_leg_counts_until_the_next_begins(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    motion = motion_of(Cycle(SEAMS[0], [reach, Event("look", dwell=DWELL), carry]))
    first, second = executed_legs(motion, followed_cycle(motion))
    assert second.begin == pytest.approx(TAKEN)
    assert first.execution.time[-1] == pytest.approx(TAKEN, abs=0.004)


def test_what_happens_before_the_first_leg_and_after_the_last_is_not_theirs(tmp_path):
    (reach, *_) = moves_of(slide(tmp_path))
    steps = [Event("wait", dwell=DWELL), Attach("part"), Event("settle", dwell=DWELL), reach]
    steps += [Event("open", dwell=DWELL), Detach("part"), Event("leave", dwell=DWELL)]
    motion = motion_of(Cycle(SEAMS[0], steps, picking(tmp_path).obstacles))
    (leg,) = executed_legs(motion, followed_cycle(motion))
    assert leg.begin == pytest.approx(DWELL)
    assert leg.execution.time[-1] == pytest.approx(DWELL + DURATION + DWELL, abs=0.0041)
    assert leg.trajectory.duration == pytest.approx(DWELL + DURATION + DWELL)


def test_between_two_that_change_hands_nothing_is_any_legs(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    steps = [Attach("one", PART), reach, Detach("one"), Event("change", dwell=DWELL)]
    steps.append(Attach("two", PART))
    motion = motion_of(Cycle(SEAMS[0], [*steps, carry]))
    first, second = executed_legs(motion, followed_cycle(motion))
    assert first.execution.time[-1] == pytest.approx(DURATION, abs=0.0041)
    assert second.begin == pytest.approx(DURATION + DWELL)
