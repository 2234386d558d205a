"""Execution of trajectories and cycles by plants under control."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, PROBLEMS, anywhere, one_joint, rest_to_rest, slow_but, with_motors
from simulated_cycle import DURATION, DWELL, LEVER, PART, SEAMS, motion_of, moves_of, picking, slide
from stored_trajectories import REFINEMENT

from tubeplanner import LimitOverrides, OptionError, load_robot
from tubeplanner.execution import tracking
from tubeplanner.execution.plants import Draw, Stage, drawn_plants
from tubeplanner.execution.simulation import (
    executed,
    executed_cycle,
    executed_stages,
    motion_stages,
)
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import CONTROLLERS, PD, Robustness
from tubeplanner.task.steps import Attach, Detach, Event

UR5 = "ur5/over_the_wall"
BANDWIDTH = 30.0  # [rad/s]


def plants_of(robot, runs=1, seed=0, **errors):
    return drawn_plants(robot, Robustness.exact(**errors), Draw(runs, seed))


def behind(trajectory, execution):
    planned = trajectory.position(np.minimum(execution.time, trajectory.duration))
    return abs(execution.position - planned)


@pytest.mark.dear("executes a motion of a UR5")
def test_a_perfect_plant_follows_a_plan(stored):
    problem, planned = stored(UR5, REFINEMENT)
    # The same ends, at about half the effort of the shortest motion, and no jump anywhere.
    motion = rest_to_rest(
        planned.joint_names, planned.position(0.0), planned.position(planned.duration), 1.2
    )
    execution = executed(problem, motion, plants_of(problem.robot), "computed-torque")
    assert behind(motion, execution).max() < 1e-5
    assert not execution.is_saturated.any()
    assert execution.time[-1] == pytest.approx(1.4)


@pytest.mark.dear("executes three motions")
@pytest.mark.parametrize("name", slow_but(["panda/between_shelves"], PROBLEMS))
def test_every_controller_follows_the_shortest_motions_of_a_perfect_plant(stored, name):
    problem, planned = stored(name, REFINEMENT)
    for controller in CONTROLLERS:
        execution = executed(problem, planned, plants_of(problem.robot), controller)
        assert behind(planned, execution).max() < 1e-3, controller


@pytest.mark.parametrize("effort", [10, 50])
def test_feedback_holds_a_weight_that_nobody_gave_beyond_a_tenth_of_the_effort_limit(
    tmp_path, effort
):
    """The integral takes as much, and softly the rest."""
    problem = anywhere(one_joint(tmp_path, mass=1.0, effort=effort))
    plants = plants_of(problem.robot, runs=3, mass=0.3)
    motion = rest_to_rest(["turn"], 0.0, 1e-6, 3.0)
    found = behind(motion, executed(problem, motion, plants, "feedforward-pd"))[:, -1, 0]
    # At rest: feedback = the weight that the model does not have.
    lacking = np.array([abs(plant.bodies[1].mass - 1.0) * 9.81 * 0.5 for plant in plants])
    expected = np.maximum(lacking - 0.1 * effort, 0) / (3 * (INERTIA + 0.25) * BANDWIDTH**2)
    assert expected.any() == (effort == 10)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=2e-6)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_wrist_of_no_inertia_stays_near_its_plan_in_spite_of_its_friction(tmp_path, controller):
    robot = gantry(tmp_path, wheel=1e-4, effort={"lift": 100.0, "turn": 10.0})
    motion = rest_to_rest(["lift", "turn"], [0.0, 0.0], [0.0, 1.0], 0.6)
    plants = plants_of(robot, unmodelled_friction=0.02, lag=1e-3, delay=1e-3)
    assert behind(motion, executed(anywhere(robot), motion, plants, controller)).max() < 0.02


def test_what_motors_do_not_have_they_do_not_give(tmp_path):
    robot = with_motors(one_joint(tmp_path), saturation_effort=6.0, no_load_velocity=4.0)
    motion = rest_to_rest(["turn"], 0.0, 2.0, 1.2)
    execution = executed(anywhere(robot), motion, plants_of(robot))
    effort, v = execution.effort[0, :, 0], execution.velocity[0, :, 0]
    assert execution.is_saturated.any()
    assert not execution.is_saturated.all()
    most, least = np.minimum(5.0, 6.0 - 1.5 * v), -np.minimum(5.0, 6.0 + 1.5 * v)
    assert (effort <= most + 1e-12).all()
    assert (effort >= least - 1e-12).all()
    cut = execution.is_saturated[0, :, 0]
    np.testing.assert_allclose(np.minimum(most - effort, effort - least)[cut], 0.0, atol=1e-12)
    given = np.diff(v) / 0.001 * INERTIA
    np.testing.assert_allclose(given, effort[:-1], atol=1e-9)


def test_the_same_seed_gives_the_same_runs_and_another_does_not(two_link):
    motion = rest_to_rest(["joint1", "joint2"], [0.0, -1.0], [0.1, -1.2], 0.1)
    first, again, other = (
        executed(anywhere(two_link), motion, drawn_plants(two_link, Robustness(), Draw(2, seed)))
        for seed in (1, 1, 2)
    )
    assert (first.position == again.position).all()
    assert (first.position[0] != first.position[1]).any()
    assert (first.position[:, 50] != other.position[:, 50]).any()


def test_noise_comes_through_and_delay_and_lag_make_it_worse(tmp_path):
    robot = one_joint(tmp_path, effort=100)
    motion = rest_to_rest(["turn"], 0.0, 0.3, 0.7)
    worst = [
        behind(motion, executed(anywhere(robot), motion, plants_of(robot, **errors))).max()
        for errors in ({}, {"noise": 1e-4}, {"delay": 0.004}, {"delay": 0.004, "lag": 0.004})
    ]
    assert worst[0] < 1e-5 < worst[1] < 1e-3
    assert 2e-5 < worst[2] < worst[3]


def gantry(tmp_path, wheel=0.2, **limits):
    """A carriage of 3 kg that slides up, and a wheel [kg m^2] on it: no gravity."""
    (tmp_path / "gantry.urdf").write_text(
        f"""<robot name="gantry"><link name="base"/><link name="carriage"><inertial>
        <mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        </link><link name="wheel"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="{wheel}" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="lift" type="prismatic"><parent link="base"/><child link="carriage"/>
        <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e4" velocity="9"/></joint>
        <joint name="turn" type="revolute"><parent link="carriage"/><child link="wheel"/>
        <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e4" velocity="9"/></joint>
        </robot>"""
    )
    overrides = LimitOverrides(**limits)
    return load_robot(tmp_path / "gantry.urdf", "wheel", gravity=(0, 0, 0), limits=overrides)


def test_a_late_motor_holds_the_weight_until_it_is_told_to(tmp_path):
    problem = anywhere(one_joint(tmp_path, mass=1.0, effort=50))
    motion = rest_to_rest(["turn"], 0.3, 0.3 + 1e-6, 1.0)
    execution = executed(problem, motion, plants_of(problem.robot, delay=0.01))
    assert behind(motion, execution).max() < 1e-6


def test_joints_may_come_in_another_order_and_what_is_held_afterwards_is_executed_too(tmp_path):
    robot = gantry(tmp_path, effort={"lift": 80.0, "turn": 8.0})
    motion = rest_to_rest(["turn", "lift"], [0.0, 0.1], [0.2, -0.1], 0.434)
    found = executed(anywhere(robot), motion, plants_of(robot), control_period=0.01)
    np.testing.assert_allclose(found.position[0, 0], [0.1, 0.0], atol=1e-4)
    np.testing.assert_allclose(found.position[0, -1], [-0.1, 0.2], atol=1e-4)
    np.testing.assert_allclose(found.time, np.arange(65) * 0.01)


def test_measured_positions_and_their_differences_are_noisy(tmp_path, monkeypatch):
    """What controllers answer, beside the real errors: white noise and its differences."""
    monkeypatch.setattr(tracking, "INTEGRAL_FRACTION", 0.0)
    robot, period, count = gantry(tmp_path, effort={"lift": 30.0, "turn": 4.0}), 0.02, 2000
    sizes, w = (1e-4, 1e-4, 3e-4), 20.0
    plants = [
        replace(plant, noise=noise)
        for plant, noise in zip(plants_of(robot, runs=3), sizes, strict=True)
    ]
    motion = rest_to_rest(["lift", "turn"], [0.0, 0.0], [1e-12, 1e-12], period * count)
    made = executed(anywhere(robot), motion, plants, "feedforward-pd", period, bandwidth=w)
    inertia, stiffness, damping = np.array([3.0, 0.2]), 3 * w**2, 3 * w
    back = inertia * (stiffness * made.position + damping * made.velocity)
    answered = -(made.effort + back) / inertia
    # Stiffness times the noise of now, and damping times its change in a period.
    now, before = stiffness + damping / period, damping / period
    expected = np.outer(sizes, [1.0, 1.0]) * np.hypot(now, before)
    np.testing.assert_allclose(answered.std(axis=1), expected, rtol=0.06)
    series = answered.transpose(0, 2, 1).reshape(6, -1)
    assert abs(np.corrcoef(series) - np.eye(6)).max() < 0.15
    neighbours = [np.corrcoef(one[1:], one[:-1])[0, 1] for one in series]
    np.testing.assert_allclose(neighbours, -now * before / (now**2 + before**2), atol=0.07)
    assert abs(series / expected.reshape(6, 1)).max() > 3  # no uniform distribution


def test_an_arm_of_which_one_joint_is_out_of_control_is_left_where_it_is(tmp_path):
    robot = gantry(tmp_path, effort={"lift": 0.1, "turn": 1e6})
    motion = rest_to_rest(["lift", "turn"], [0.0, 0.0], [0.01, 1.0], 1.5)
    execution = executed(anywhere(robot), motion, plants_of(robot, delay=0.3))
    assert abs(execution.velocity[0, -1, 0]) < 1.0
    assert abs(execution.velocity[0, -1, 1]) > 1e3
    assert np.isfinite(execution.position).all()
    assert (execution.position[0, -1] == execution.position[0, -2]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"control_period": 0.0}, "control_period is 0 s; give a number"),
        ({"control_period": 0.2}, r"control_period is 0\.2 s; give a number"),
        ({"control_period": "fast"}, "control_period is 'fast' s"),
        ({"controller": "lqr"}, "unknown controller 'lqr'"),
        ({"plants": []}, "plants is empty"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path, options, message):
    problem, motion = anywhere(one_joint(tmp_path)), rest_to_rest(["turn"], 0.0, 1.0, 1.5)
    with pytest.raises(OptionError, match=message):
        executed(problem, motion, **{"plants": plants_of(problem.robot), **options})


# Stages of a cycle: the arm with what it carries.


RUNS = Draw(200, 3)
TIP = 3  # the body that carries


def tip_masses(stage):
    return np.array([plant.bodies[TIP].mass for plant in stage.plants])


def stages_of(cycle, draw=RUNS, **errors):
    return motion_stages(motion_of(cycle), Robustness.exact(**errors), draw)


def test_a_stage_begins_where_something_changes_hands(tmp_path):
    """Without errors the plant is the model with what it carries."""
    cycle = picking(tmp_path)
    stages = stages_of(cycle, Draw(1))
    taken = DURATION + DWELL
    times = [0.0, taken, taken + DWELL + DURATION + DWELL]
    assert [stage.begin for stage in stages] == pytest.approx(times)
    np.testing.assert_allclose([tip_masses(stage)[0] for stage in stages], [1, 3, 1], rtol=1e-12)
    for stage, leg in zip(stages, cycle.legs, strict=True):
        assert stage.robot is leg.robot
        for body, expected in zip(stage.plants[0].bodies, leg.robot.inertias, strict=True):
            assert body.mass == pytest.approx(expected.mass)
            np.testing.assert_allclose(body.com, expected.com, atol=1e-12)
            np.testing.assert_allclose(body.inertia, expected.inertia, atol=1e-12)


def test_a_run_is_one_arm_all_along(tmp_path):
    cycle = picking(tmp_path)
    stages = motion_stages(motion_of(cycle), Robustness(), Draw(3, 1))
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
    assert abs(loaded - PART.mass).max() <= 0.1 * PART.mass + 1e-9


def test_each_part_has_an_error_of_its_own_and_keeps_it(tmp_path):
    own = slide(tmp_path, payload=replace(PART, mass=1.0))
    first, second, third = moves_of(own)
    steps = [
        *(Attach("part", PART), first, Detach("part")),
        *(Attach("other", PART), second, Detach("other"), Attach("part", PART), third),
    ]
    stages = stages_of(Cycle(SEAMS[0], steps), payload=0.2)
    empty = tip_masses(stages[0])
    assert 0.15 < abs(empty - 2.0).max() <= 0.2 + 1e-9  # of the tool, which is a kilogram of it
    carrying = [tip_masses(stage) - empty for stage in stages]
    loads = [load for load in carrying if load.min() > 1.0]
    assert len(loads) == 3
    for load in loads:
        assert 0.3 < abs(load - PART.mass).max() <= 0.4 + 1e-9
        assert abs(load.mean() - PART.mass) < 0.05
    np.testing.assert_allclose(loads[0], loads[2], rtol=1e-12)
    assert abs(np.corrcoef([loads[0], loads[1], empty]) - np.eye(3)).max() < 0.2


def test_parts_too_are_off_by_all_that_they_may_be_in_the_first_run_and_by_none_in_the_second(
    tmp_path,
):
    stages = stages_of(picking(tmp_path), Draw(3), payload=0.1)
    loads = tip_masses(stages[1]) - tip_masses(stages[0])
    assert abs(loads - PART.mass)[:2] == pytest.approx([0.1 * PART.mass, 0.0])
    assert 0 < abs(loads - PART.mass)[2] < 0.1 * PART.mass


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


def test_events_change_nothing_and_of_two_parts_the_other_stays(tmp_path):
    reach, carry, _ = moves_of(slide(tmp_path))
    steps = [Event("wait", dwell=DWELL), Attach("part", PART), reach]
    steps += [Event("part", dwell=DWELL), Attach("other", PART), carry]  # called as the part is
    stages = stages_of(Cycle(SEAMS[0], steps), Draw(1))
    taken = DWELL + DURATION + DWELL
    assert [stage.begin for stage in stages] == pytest.approx([0.0, DWELL, taken])
    np.testing.assert_allclose([tip_masses(stage)[0] for stage in stages], [1.0, 3.0, 5.0])
    heavy = replace(PART, mass=4.0)
    steps = [Attach("part", PART), Attach("other", heavy), reach, Detach("part"), carry]
    stages = stages_of(Cycle(SEAMS[0], steps), Draw(1))
    np.testing.assert_allclose([tip_masses(stage)[0] for stage in stages], [1.0, 3.0, 7.0, 5.0])


def test_what_a_part_weighs_says_nothing_of_the_arm(tmp_path):
    stages = stages_of(picking(tmp_path), mass=0.1, payload=0.1)
    loads = tip_masses(stages[1]) - tip_masses(stages[0])
    arms = np.array([[body.mass for body in plant.bodies[1:]] for plant in stages[0].plants])
    assert abs(np.corrcoef(np.vstack([loads, arms.T])) - np.eye(4)).max() < 0.2


ATTACH = DURATION + DWELL  # [s], when
LIFT = 2  # the joint at which the part pulls


def same(first, second):
    return all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("time", "position", "velocity", "effort", "is_saturated")
    )


@pytest.mark.dear("executes a move twice")
@pytest.mark.parametrize("controller", ["computed-torque", PD])
def test_a_cycle_of_one_move_is_executed_as_that_move_alone(tmp_path, controller):
    robot, errors = slide(tmp_path), Robustness(controller=controller)
    cycle = Cycle(SEAMS[0], moves_of(robot)[:1])
    motion = motion_of(cycle, 0.4)
    plants = drawn_plants(robot, errors, Draw(1, 5))
    alone = executed(cycle.problem(0, motion.junctions), motion.trajectory, plants, controller)
    assert same(executed_cycle(motion, errors, Draw(1, 5)), alone)


@pytest.mark.dear("executes two moves twice")
def test_where_the_load_stays_moves_are_executed_as_one_motion(tmp_path):
    robot = slide(tmp_path)
    reach, carry, _ = moves_of(robot)
    motion = motion_of(Cycle(SEAMS[0], [reach, Event("look", dwell=DWELL), carry]), 0.4)
    plants = drawn_plants(robot, Robustness(), Draw(1, 5))
    alone = executed(anywhere(robot), motion.trajectory, plants)
    assert same(executed_cycle(motion, Robustness(), Draw(1, 5)), alone)


@pytest.mark.dear("executes a motion twice")
def test_positions_velocities_and_what_is_on_its_way_are_handed_over(tmp_path):
    """A stage that changes nothing changes nothing, also in the middle of a motion."""
    errors = Robustness(lag=0.004, delay=0.005, noise=1e-4)
    robot = slide(tmp_path)
    motion = motion_of(Cycle(SEAMS[0], moves_of(robot)[:1])).trajectory
    stages = [Stage(t, robot, drawn_plants(robot, errors, Draw(1))) for t in (0.0, 0.3211, 0.7)]
    whole, parts = executed_stages(stages[:1], motion), executed_stages(stages, motion)
    np.testing.assert_allclose(parts.position, whole.position, atol=1e-12)
    np.testing.assert_allclose(parts.effort, whole.effort, atol=1e-8)
    assert (parts.time == whole.time).all()


@pytest.mark.dear("executes a cycle")
def test_an_exact_arm_follows_through_what_it_takes_and_lets_go(tmp_path):
    """The effort that holds it jumps by what the part weighs."""
    motion = motion_of(picking(tmp_path))
    execution = executed_cycle(motion, Robustness.exact(), Draw(1))
    assert behind(motion.trajectory, execution).max() < 1e-4
    assert not execution.is_saturated.any()
    before, after = (
        execution.effort[0, np.searchsorted(execution.time, ATTACH + away)]
        for away in (-0.02, 0.02)
    )
    jump = abs(after - before)
    assert jump[LIFT] == pytest.approx(PART.mass * 9.81 * LEVER, rel=1e-4)
    assert jump[:LIFT].max() < 1e-3


@pytest.mark.dear("executes a cycle")
def test_a_part_that_is_heavier_than_thought_pulls_the_tool_down_where_it_is_taken(tmp_path):
    """At rest feedback holds what the model does not know, and its integral takes it over."""
    motion = motion_of(picking(tmp_path))
    errors = Robustness.exact(payload=0.2, controller="feedforward-pd")
    execution = executed_cycle(motion, errors, Draw(1, 3))
    away = behind(motion.trajectory, execution)[:, :, LIFT]
    held, taken = (np.searchsorted(execution.time, ATTACH + late) for late in (-0.001, DWELL))
    assert away[:, held].max() < 1e-4
    loaded = motion_stages(motion, errors, Draw(1, 3))[1].plants
    wrong = abs(loaded[0].bodies[TIP].mass - 1.0 - PART.mass)
    assert wrong > 0.05
    # Three equal poles of 30 rad/s under a constant force.
    inertia = 0.01 + 0.1**2 + PART.mass * LEVER**2
    shape = DWELL**2 / 2 * np.exp(-BANDWIDTH * DWELL)
    expected = shape * wrong * 9.81 * LEVER / inertia
    np.testing.assert_allclose(away[:, taken], expected, rtol=0.03)
    assert away[:, -1].max() < 1e-4


@pytest.mark.dear("executes a cycle")
def test_a_position_controller_holds_the_weight_of_what_is_taken(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = executed_cycle(motion, Robustness.exact(controller=PD), Draw(1))
    taken = np.searchsorted(execution.time, ATTACH + DWELL)
    planned = motion.trajectory.position(ATTACH)
    assert abs(execution.position[0, taken] - planned)[LIFT] < 1e-4


def test_without_a_draw_fifty_arms_execute_it(tmp_path):
    cycle = Cycle(SEAMS[0], moves_of(slide(tmp_path))[:1])
    errors = Robustness(control_period=0.05)
    assert len(executed_cycle(motion_of(cycle, 0.2), errors).plants) == 50
