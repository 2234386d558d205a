from dataclasses import replace

import numpy as np
import pytest

from simulated_cycle import (
    DURATION,
    DWELL,
    SEAMS,
    followed_cycle,
    motion_of,
    moves_of,
    picking,
    slide,
)
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.cycle_execution import executed_cycle
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.judged_cycle import judged_cycle
from tubeplanner.simulation.judged_runs import judged_runs
from tubeplanner.simulation.plant import Draw

TAKEN = DURATION + DWELL
CARRIED = TAKEN + DWELL + DURATION / 2  # [s], in the middle of the second move
REACH, CARRY, BACK = ("reach",), ("carry",), ("back",)


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return picking(tmp_path_factory.mktemp("slide"))


@pytest.fixture
def case(cycle):
    motion = motion_of(cycle)
    return motion, followed_cycle(motion, 2)


def without_places(run):
    return [
        value.value if isinstance(value, Extreme) else np.asarray(value).tolist()
        for value in vars(run).values()
        if value is not None
    ]


def test_a_cycle_of_one_move_is_judged_as_that_move_alone(tmp_path):
    cycle = Cycle(SEAMS[0], moves_of(slide(tmp_path), radius=0.05)[:1])
    motion = motion_of(cycle)
    execution = executed_cycle(motion, Robustness(), Draw(2))
    problem = cycle.problem(0, motion.seams, SEAMS[1])
    alone = judged_runs(problem, motion.trajectory, execution)
    judged = judged_cycle(motion, execution)
    for found in (judged.runs, judged.legs[REACH]):
        assert [without_places(run) for run in found] == [without_places(run) for run in alone]
        for run, expected in zip(found, alone, strict=True):
            assert run.tube.place == replace(expected.tube.place, move="reach")
    assert judged.handovers == []


def test_a_motion_as_planned_keeps_everything_in_every_move(case):
    judged = judged_cycle(*case)
    assert list(judged.legs) == [REACH, CARRY, BACK]
    assert all(run.survives for runs in (judged.runs, *judged.legs.values()) for run in runs)
    assert all(run.tracking.value < 1e-9 for run in judged.runs)
    assert len(judged.handovers) == 2


def test_a_run_that_leaves_a_moves_tube_fails_there_and_as_a_whole(case):
    motion, execution = case
    then = np.searchsorted(execution.time, CARRIED)
    execution.position[1, then, 1] += 0.7
    judged = judged_cycle(motion, execution)
    assert [run.survives for run in judged.legs[CARRY]] == [True, False]
    for name in (REACH, BACK):
        assert all(run.survives for run in judged.legs[name])
    assert [run.survives for run in judged.runs] == [True, False]
    worst = judged.runs[1].tube
    assert (worst.place.move, worst.place.segment) == ("carry", 0)
    assert worst.place.time == pytest.approx(execution.time[then])
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
    onto_the_part = np.array([np.arctan2(0.4, 0.6), 0.1, 0.0])
    down = replace(execution, position=execution.position.copy())
    down.position[0, 20] = onto_the_part
    judged = judged_cycle(motion, down)
    reach = judged.legs[REACH][0].obstacles
    assert reach.place.obstacle == "part"
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
    assert judged.runs[0].obstacles.place.move == near
    assert run.obstacles.place.move == far
    assert run.obstacles.value == pytest.approx(found[far])
    assert run.clearance == asked


def test_motors_at_their_limit_count_from_first_to_last(case):
    motion, execution = case
    execution.is_saturated[1, execution.time < 0.25] = True
    runs = judged_cycle(motion, execution).runs
    assert runs[0].saturated == 0
    assert runs[1].saturated == (execution.time < 0.25).mean()
