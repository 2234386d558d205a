from dataclasses import replace

import numpy as np
import pytest

from simulated_cycle import DURATION, DWELL, PART, SEAMS, motion_of, moves_of, picking, slide
from tubeplanner import LimitOverrides
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Attach, Detach, Event
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.cycle_stages import cycle_stages
from tubeplanner.simulation.plant import Draw, drawn_plants

RUNS = Draw(200, 3)
TIP = 3  # the body that carries


def tip_masses(stage):
    return np.array([plant.bodies[TIP].mass for plant in stage.plants])


def stages_of(cycle, draw=RUNS, **errors):
    return cycle_stages(motion_of(cycle), Robustness.exact(**errors), draw)


def test_a_stage_begins_where_something_changes_hands(tmp_path):
    cycle = picking(tmp_path)
    stages = stages_of(cycle, Draw(1))
    taken = DURATION + DWELL
    times = [0.0, taken, taken + DWELL + DURATION + DWELL]
    assert [stage.begin for stage in stages] == pytest.approx(times)
    robots = [cycle.legs[k].robot for k in range(3)]
    assert all(stage.robot is robot for stage, robot in zip(stages, robots, strict=True))
    masses = [stage.plants[0].bodies[TIP].mass for stage in stages]
    np.testing.assert_allclose(masses, [1.0, 3.0, 1.0], rtol=1e-12)


def test_without_errors_the_plant_is_the_model_with_what_it_carries(tmp_path):
    for stage in stages_of(picking(tmp_path), Draw(1)):
        for found, expected in zip(stage.plants[0].bodies, stage.robot.inertias, strict=True):
            assert found.mass == pytest.approx(expected.mass)
            np.testing.assert_allclose(found.com, expected.com, atol=1e-12)
            np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-12)


def test_a_run_is_one_arm_all_along(tmp_path):
    cycle = picking(tmp_path)
    stages = cycle_stages(motion_of(cycle), Robustness(), Draw(3, 1))
    alone = drawn_plants(slide(tmp_path), Robustness(), Draw(3, 1))
    for stage in stages:
        for plant, one in zip(stage.plants, alone, strict=True):
            for name in ("motors", "tool", "base", "noise_seed", "lag", "delay", "noise"):
                expected = getattr(one, name)
                assert repr(getattr(plant, name)) == repr(expected)
            for body in range(TIP):
                assert plant.bodies[body].mass == one.bodies[body].mass
                np.testing.assert_array_equal(plant.bodies[body].com, one.bodies[body].com)
    loaded = tip_masses(stages[1]) - tip_masses(stages[0])
    assert abs(loaded - PART.mass).max() <= 0.1 * PART.mass


def test_each_part_has_an_error_of_its_own_and_keeps_it(tmp_path):
    own = slide(tmp_path, payload=replace(PART, mass=1.0))
    first, second, third = moves_of(own)
    steps = [
        Attach("part", PART),
        first,
        Detach("part"),
        Attach("other", PART),
        second,
        Detach("other"),
        Attach("part", PART),
        third,
    ]
    stages = stages_of(Cycle(SEAMS[0], steps), payload=0.2)
    empty = tip_masses(stages[0])
    assert 0.15 < abs(empty - 2.0).max() <= 0.2  # of the tool, which is a kilogram of it
    carrying = [tip_masses(stage) - empty for stage in stages]
    loads = [load for load in carrying if load.min() > 1.0]
    assert len(loads) == 3
    for load in loads:
        assert 0.3 < abs(load - PART.mass).max() <= 0.4
        assert abs(load.mean() - PART.mass) < 0.05
    np.testing.assert_allclose(loads[0], loads[2], rtol=1e-12)
    assert abs(np.corrcoef([loads[0], loads[1], empty]) - np.eye(3)).max() < 0.2


def test_another_part_of_the_same_weight_is_another_stage(tmp_path):
    first, second, _ = moves_of(slide(tmp_path))
    steps = [Attach("part", PART), first, Detach("part"), Attach("other", PART), second]
    stages = stages_of(Cycle(SEAMS[0], steps), payload=0.2)
    loads = [tip_masses(stage) for stage in stages if tip_masses(stage).min() > 1.5]
    assert len(loads) == 2
    assert abs(loads[0] - loads[1]).max() > 0.1


def test_friction_that_nobody_gave_is_that_of_the_widest_limits(tmp_path):
    """A move that is to be slow does not make motors of another kind."""
    slow = slide(tmp_path, limits=LimitOverrides(velocity={"lift": 0.3}, effort={"lift": 9.0}))
    robot, errors = slide(tmp_path), Robustness.exact(unmodelled_friction=0.1)
    slowly, fast = moves_of(slow)[0], moves_of(robot)[1]
    stages = stages_of(Cycle(SEAMS[0], [slowly, fast]), Draw(2), unmodelled_friction=0.1)
    assert [stage.robot for stage in stages] == [slow, robot]
    expected = drawn_plants(robot, errors, Draw(2))
    for stage in stages:
        for plant, one in zip(stage.plants, expected, strict=True):
            found = plant.motors.viscous_friction
            np.testing.assert_allclose(found, one.motors.viscous_friction)


def test_events_change_nothing(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    steps = [Event("wait", dwell=DWELL), Attach("part", PART), reach]
    steps += [Event("part", dwell=DWELL), Attach("other", PART), carry]  # called as the part is
    stages = stages_of(Cycle(SEAMS[0], steps), Draw(1))
    taken = DWELL + DURATION + DWELL
    assert [stage.begin for stage in stages] == pytest.approx([0.0, DWELL, taken])
    np.testing.assert_allclose([tip_masses(stage)[0] for stage in stages], [1.0, 3.0, 5.0])


def test_of_two_parts_the_other_stays(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    heavy = replace(PART, mass=4.0)
    steps = [Attach("part", PART), Attach("other", heavy), reach, Detach("part"), carry]
    stages = stages_of(Cycle(SEAMS[0], steps), Draw(1))
    masses = [tip_masses(stage)[0] for stage in stages]
    np.testing.assert_allclose(masses, [1.0, 3.0, 7.0, 5.0])


def test_what_a_part_weighs_says_nothing_of_the_arm(tmp_path):
    stages = stages_of(picking(tmp_path), mass=0.1, payload=0.1)
    loads = tip_masses(stages[1]) - tip_masses(stages[0])
    arms = np.array([[body.mass for body in plant.bodies[1:]] for plant in stages[0].plants])
    assert abs(np.corrcoef(np.vstack([loads, arms.T])) - np.eye(4)).max() < 0.2
