"""Verdict over a cycle's runs: legs, hand-over errors."""

import json
from dataclasses import replace

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

from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import (
    executed_legs,
    handover_errors,
    judged_cycle,
    judged_runs,
)
from tubeplanner.execution.simulation import executed_cycle
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import Robustness
from tubeplanner.task.steps import Attach, Detach, Event

PERIOD = 0.007
TAKEN = DURATION + DWELL
LEFT = TAKEN + DWELL + DURATION + DWELL


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    return motion_of(picking(tmp_path_factory.mktemp("slide")))


def test_a_leg_counts_while_the_tool_has_in_its_hand_what_it_has(motion):
    """It has the motion and the runs of its own time."""
    execution = followed_cycle(motion, period=PERIOD)
    execution.velocity[:] = execution.time[:, None]
    execution.effort[:] = 2 * execution.time[:, None]
    execution.is_saturated[:] = (execution.time > TAKEN)[:, None]
    legs = executed_legs(motion, execution)
    assert [leg.begin for leg in legs] == pytest.approx([0.0, TAKEN, LEFT])
    lasts = [leg.begin + leg.execution.time[-1] for leg in legs]
    np.testing.assert_allclose(lasts, [TAKEN, LEFT, execution.time[-1]], atol=PERIOD + 1e-9)
    assert lasts[0] <= TAKEN + 1e-9
    assert lasts[1] <= LEFT + 1e-9
    assert [leg.leg.name for leg in legs] == ["reach", "carry", "back"]
    for leg in legs:
        time = leg.execution.time
        assert 0 <= time[0] < PERIOD
        planned = leg.trajectory.position(np.minimum(time, leg.trajectory.duration))
        np.testing.assert_allclose(leg.execution.position[0], planned, atol=1e-9)
        np.testing.assert_allclose(leg.execution.velocity[0, :, 0], leg.begin + time)
        np.testing.assert_allclose(leg.execution.effort[0, :, 0], 2 * (leg.begin + time))
        assert leg.execution.is_saturated.any() == (leg.begin > 0)


def test_the_part_stands_where_the_motion_leaves_it(motion):
    before, with_it, after = executed_legs(motion, followed_cycle(motion))
    assert [len(leg.problem.obstacles) for leg in (before, with_it, after)] == [1, 0, 1]
    assert [len(leg.problem.attached) for leg in (before, with_it, after)] == [0, 1, 0]
    base_placements = after.problem.obstacles[0].shapes[0].vertices.mean(axis=0)
    turned, tool = motion.cycle.robot.tool_pose(SEAMS[1:3])
    in_hand = turned[0].T @ (PLACE - tool[0])
    np.testing.assert_allclose(base_placements, tool[1] + turned[1] @ in_hand, atol=1e-9)
    assert with_it.problem.robot.payload is not None


def test_where_only_time_passes_a_leg_counts_until_the_next_begins(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    motion = motion_of(Cycle(SEAMS[0], [reach, Event("look", dwell=DWELL), carry]))
    first, second = executed_legs(motion, followed_cycle(motion))
    assert second.begin == pytest.approx(TAKEN)
    assert first.execution.time[-1] == pytest.approx(TAKEN, abs=0.004)
    # Between two that change hands nothing is any leg's.
    steps = [Attach("one", PART), reach, Detach("one"), Event("change", dwell=DWELL)]
    motion = motion_of(Cycle(SEAMS[0], [*steps, Attach("two", PART), carry]))
    first, second = executed_legs(motion, followed_cycle(motion))
    assert first.execution.time[-1] == pytest.approx(DURATION, abs=0.0041)
    assert second.begin == pytest.approx(DURATION + DWELL)


def test_what_happens_before_the_first_leg_and_after_the_last_is_not_theirs(tmp_path):
    (reach, *_) = moves_of(slide(tmp_path))
    steps = [Event("wait", dwell=DWELL), Attach("part"), Event("settle", dwell=DWELL), reach]
    steps += [Event("open", dwell=DWELL), Detach("part"), Event("leave", dwell=DWELL)]
    motion = motion_of(Cycle(SEAMS[0], steps, picking(tmp_path).obstacles))
    (leg,) = executed_legs(motion, followed_cycle(motion))
    assert leg.begin == pytest.approx(DWELL)
    assert leg.execution.time[-1] == pytest.approx(DWELL + DURATION + DWELL, abs=0.0041)
    assert leg.trajectory.duration == pytest.approx(DWELL + DURATION + DWELL)


def test_tools_that_are_where_they_should_be_are_off_by_nothing(motion):
    found = list(handover_errors(motion, followed_cycle(motion, 2)))
    kinds = [(each.mark.kind, each.mark.name) for each in found]
    assert kinds == [("attach", "part"), ("detach", "part")]
    assert [each.mark.time for each in found] == pytest.approx([TAKEN, LEFT])
    for each in found:
        np.testing.assert_allclose([each.distance, each.angle, each.speed], 0.0, atol=1e-9)
    # The arm is seen before it goes on: the last control period that is no later.
    execution = followed_cycle(motion)
    execution.position[:, execution.time > LEFT + 1e-9] += 0.1
    assert all(each.distance.max() < 1e-9 for each in handover_errors(motion, execution))


def test_errors_of_base_and_tool_count(motion):
    execution = followed_cycle(motion, 2)
    bases = [np.array([3e-3, 4e-3, 0.0]), np.zeros(3)]
    tools = [np.zeros(3), np.array([0.0, 0.0, 2e-3])]
    plants = [
        replace(plant, base=base, tool=tool)
        for plant, base, tool in zip(execution.plants, bases, tools, strict=True)
    ]
    for each in handover_errors(motion, replace(execution, plants=plants)):
        np.testing.assert_allclose(each.distance, [5e-3, 2e-3], rtol=1e-6)


def test_a_joint_that_is_off_then_turns_the_tool(motion):
    execution = followed_cycle(motion, 3)
    at_attach = np.searchsorted(execution.time, TAKEN - 1e-9)
    execution.position[1, at_attach, 2] += 0.01
    execution.position[2, at_attach, 2] -= 3.0
    execution.velocity[1, at_attach, 1] = -0.02
    taken, left = handover_errors(motion, execution)
    np.testing.assert_allclose(taken.angle, [0.0, 0.01, 3.0], atol=1e-7)
    np.testing.assert_allclose(taken.speed, [0.0, 0.02, 0.0], atol=1e-9)
    np.testing.assert_allclose(taken.distance, 0.0, atol=1e-7)
    assert left.angle.max() < 1e-7


def test_the_worst_and_the_median_are_told(motion):
    execution = followed_cycle(motion, 3)
    for run, off in enumerate((0.004, 0.001, 0.002)):
        execution.position[run, :, 1] += off
    fields = json.loads(json.dumps(next(handover_errors(motion, execution)).as_dict()))
    assert fields["attach"] == "part"
    assert fields["time"] == pytest.approx(TAKEN)
    assert fields["distance"]["worst"] == pytest.approx(0.004)
    assert fields["distance"]["run"] == 0
    assert fields["distance"]["median"] == pytest.approx(0.002)


CARRIED = TAKEN + DWELL + DURATION / 2  # [s], in the middle of the second move
REACH, CARRY, BACK = ("reach",), ("carry",), ("back",)


@pytest.fixture
def case(motion):
    return motion, followed_cycle(motion, 2)


def without_places(run):
    return [
        value.value if isinstance(value, Extreme) else np.asarray(value).tolist()
        for value in vars(run).values()
        if value is not None
    ]


def test_a_cycle_of_one_move_is_judged_as_that_move_alone(tmp_path):
    cycle = Cycle(SEAMS[0], moves_of(slide(tmp_path), radius=0.05)[:1])
    motion = motion_of(cycle, 0.4)
    execution = executed_cycle(motion, Robustness(), Draw(1))
    problem = cycle.problem(0, motion.junctions, SEAMS[1])
    (alone,) = judged_runs(problem, motion.trajectory, execution)
    judged = judged_cycle(motion, execution)
    for (found,) in (judged.runs, judged.legs[REACH]):
        assert without_places(found) == without_places(alone)
        assert found.tube.location == replace(alone.tube.location, move="reach")
    assert judged.handovers == []


def test_a_run_that_leaves_a_moves_tube_fails_there_and_as_a_whole(case):
    """And a motion as planned keeps everything in every move."""
    motion, execution = case
    then = np.searchsorted(execution.time, CARRIED)
    execution.position[1, then, 1] += 0.7
    judged = judged_cycle(motion, execution)
    assert len(judged.handovers) == 2
    survive = {names: [run.survives for run in runs] for names, runs in judged.legs.items()}
    assert survive == {REACH: [True, True], CARRY: [True, False], BACK: [True, True]}
    assert [run.survives for run in judged.runs] == [True, False]
    assert judged.runs[0].tracking.value < 1e-9
    worst = judged.runs[1].tube
    assert (worst.location.move, worst.location.segment) == ("carry", 0)
    assert worst.location.time == pytest.approx(execution.time[then])
    assert worst.value == judged.legs[CARRY][1].tube.value > 0.3


@pytest.mark.parametrize("late", [-0.05, 0.05])
def test_a_hand_in_motion_beside_a_seam_counts_for_what_is_in_it(case, late):
    """What happens at rest counts for the move that has the same in its hand."""
    motion, execution = case
    then = np.searchsorted(execution.time, TAKEN + late)
    execution.position[0, then, 2] += 0.2
    judged = judged_cycle(motion, execution)
    off = {name: runs[0].tracking.value for name, runs in judged.legs.items()}
    assert off == pytest.approx({REACH: 0.2 * (late < 0), CARRY: 0.2 * (late > 0), BACK: 0.0})
    assert judged.runs[0].tracking.value == pytest.approx(0.2)


def test_obstacles_are_those_that_stand_there_then(case):
    """The same configuration hits the part where it stands, and not where it is carried."""
    motion, execution = case
    execution.position[0, 20] = [np.arctan2(0.4, 0.6), 0.1, 0.0]  # onto the part
    judged = judged_cycle(motion, execution)
    reach = judged.legs[REACH][0].obstacles
    assert reach.location.obstacle == "part"
    assert judged.legs[CARRY][0].obstacles is None
    assert judged.runs[0].obstacles == min(
        (judged.legs[name][0].obstacles for name in (REACH, BACK)), key=lambda one: one.value
    )


def test_of_the_whole_the_least_room_beside_what_is_asked_is_told(case):
    motion, execution = case
    judged = judged_cycle(motion, execution)
    found = {names[0]: judged.legs[names][0].obstacles.value for names in (REACH, BACK)}
    near, far = sorted(found, key=found.get)
    asked = found[far] - found[near] + 0.02
    cautious = [
        replace(step, clearance=asked) if step.name == far else step for step in motion.cycle.steps
    ]
    (run, _) = judged_cycle(motion_of(replace(motion.cycle, steps=cautious)), execution).runs
    assert judged.runs[0].obstacles.location.move == near
    assert run.obstacles.location.move == far
    assert run.obstacles.value == pytest.approx(found[far])
    assert run.clearance == asked


def test_of_the_whole_the_joint_is_told_that_is_farthest_from_the_plan_for_its_kind(case):
    """6 mm of the sliding joint are more than 40 mrad of another."""
    motion, execution = case
    execution.position[0, np.searchsorted(execution.time, 0.3), 2] += 0.04
    execution.position[0, np.searchsorted(execution.time, CARRIED), 1] += 0.006
    execution.velocity[0, np.searchsorted(execution.time, 0.3), 1] = 1.2
    run, other = judged_cycle(motion, execution).runs
    assert (run.tracking.value, run.tracking.location.joint) == (pytest.approx(0.006), "extend")
    assert run.stops["tracking"] == pytest.approx(0.005)
    assert (run.velocity.value, run.velocity.location.move) == (pytest.approx(1.2), "reach")
    np.testing.assert_allclose(run.tracking_by_joint, [0.0, 1.2, 0.8], atol=1e-9)
    np.testing.assert_allclose(run.velocity_by_joint, [0.0, 1.2, 0.0])
    assert (run.broken, other.broken) == (("velocity", "tracking"), ())
    tolerant = Robustness(velocity_tolerance=0.3, path_tolerance=0.07)
    assert judged_cycle(motion, execution, errors=tolerant).runs[0].survives


def test_motors_at_their_limit_count_from_first_to_last(case):
    motion, execution = case
    execution.is_saturated[1, execution.time < 0.25] = True
    runs = judged_cycle(motion, execution).runs
    assert runs[0].saturated == 0
    assert runs[1].saturated == (execution.time < 0.25).mean()
