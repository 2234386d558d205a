import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, rest_to_rest, with_motors
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import OptionError, load_problem
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.execution import executed
from tubeplanner.simulation.plant import Draw, drawn_plants

UR5 = "ur5/over_the_wall"


def plants_of(robot, runs=1, seed=0, **errors):
    return drawn_plants(robot, Robustness.exact(**errors), Draw(runs, seed))


def behind(trajectory, execution):
    planned = trajectory.position(np.minimum(execution.time, trajectory.duration))
    return abs(execution.position - planned)


@pytest.mark.parametrize("controller", ["computed-torque", "feedforward-pd"])
def test_a_perfect_plant_follows_a_plan(controller):
    problem = load_problem(f"example:{UR5}")
    planned = stored_trajectory(UR5, REFINEMENT).trajectory.reordered(problem.robot.joint_names)
    # The same ends, at about half the effort of the shortest motion, and no jump anywhere.
    motion = rest_to_rest(
        planned.joint_names, planned.position(0.0), planned.position(planned.duration), 1.2
    )
    execution = executed(problem, motion, plants_of(problem.robot), controller)
    assert behind(motion, execution).max() < 1e-5
    assert not execution.is_saturated.any()
    assert execution.time[-1] == pytest.approx(1.4)


def test_an_arm_under_the_weight_of_its_load_sags_as_far_as_feedback_is_soft(tmp_path):
    problem = anywhere(one_joint(tmp_path, mass=1.0, effort=50))
    plants = plants_of(problem.robot, runs=3, mass=0.3)
    motion = rest_to_rest(["turn"], 0.0, 1e-6, 3.0)
    found = behind(motion, executed(problem, motion, plants, "feedforward-pd"))[:, -1, 0]
    # At rest: feedback = the weight that the model does not have.
    lacking = np.array([abs(plant.bodies[1].mass - 1.0) * 9.81 * 0.5 for plant in plants])
    expected = lacking / ((INERTIA + 0.25) * 30.0**2)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


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


def test_the_same_seed_gives_the_same_runs_and_another_does_not():
    problem = load_problem("example:two_link/around_a_post")
    motion = stored_trajectory("two_link/around_a_post", REFINEMENT).trajectory
    first, again, other = (
        executed(problem, motion, drawn_plants(problem.robot, Robustness(), Draw(2, seed)))
        for seed in (1, 1, 2)
    )
    assert (first.position == again.position).all()
    assert (first.position[0] != first.position[1]).any()
    assert (first.position[:, 50] != other.position[:, 50]).any()


def test_noise_comes_through_and_delay_and_lag_make_it_worse(tmp_path):
    robot = one_joint(tmp_path, effort=100)
    motion = rest_to_rest(["turn"], 0.0, 1.0, 1.5)
    worst = [
        behind(motion, executed(anywhere(robot), motion, plants_of(robot, **errors))).max()
        for errors in ({}, {"noise": 1e-4}, {"delay": 0.004}, {"delay": 0.004, "lag": 0.004})
    ]
    assert worst[0] < 1e-5 < worst[1] < 1e-3
    assert 2e-5 < worst[2] < worst[3]


def test_an_arm_out_of_control_is_left_where_it_is(tmp_path):
    robot = one_joint(tmp_path, effort=1e6)
    motion = rest_to_rest(["turn"], 0.0, 1.0, 1.5)
    execution = executed(anywhere(robot), motion, plants_of(robot, delay=0.3))
    assert np.isfinite(execution.position).all()
    assert (execution.position[0, -1] == execution.position[0, -2]).all()


def test_options_that_make_no_sense_are_refused(tmp_path):
    problem = anywhere(one_joint(tmp_path))
    motion, plants = rest_to_rest(["turn"], 0.0, 1.0, 1.5), plants_of(problem.robot)
    with pytest.raises(OptionError, match="control_period is 0 s; give a number"):
        executed(problem, motion, plants, control_period=0.0)
    with pytest.raises(OptionError, match="control_period is 'fast' s"):
        executed(problem, motion, plants, control_period="fast")
    with pytest.raises(OptionError, match="unknown controller 'lqr'"):
        executed(problem, motion, plants, "lqr")
    with pytest.raises(OptionError, match="plants is empty"):
        executed(problem, motion, [])
