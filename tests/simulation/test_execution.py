import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, rest_to_rest, with_motors
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import LimitOverrides, OptionError, load_problem, load_robot
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.execution import executed
from tubeplanner.simulation.plant import Draw, drawn_plants
from tubeplanner.simulation.tracking_controllers import BANDWIDTH

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


def gantry(tmp_path, **limits):
    """A carriage of 3 kg that slides up, and a wheel of 0.2 kg m^2 on it: no gravity."""
    (tmp_path / "gantry.urdf").write_text(
        """<robot name="gantry"><link name="base"/><link name="carriage"><inertial>
        <mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        </link><link name="wheel"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="lift" type="prismatic"><parent link="base"/><child link="carriage"/>
        <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e4" velocity="9"/></joint>
        <joint name="turn" type="revolute"><parent link="carriage"/><child link="wheel"/>
        <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e4" velocity="9"/></joint>
        </robot>"""
    )
    overrides = LimitOverrides(**limits)
    return load_robot(tmp_path / "gantry.urdf", "wheel", gravity=(0, 0, 0), limits=overrides)


def test_joints_may_come_in_another_order(tmp_path):
    robot = gantry(tmp_path)
    motion = rest_to_rest(["turn", "lift"], [0.0, 0.5], [1.0, -0.5], 1.0)
    found = executed(anywhere(robot), motion, plants_of(robot)).position[0, [0, -1]]
    np.testing.assert_allclose(found, [[0.5, 0.0], [-0.5, 1.0]], atol=1e-4)


def test_a_late_motor_holds_the_weight_until_it_is_told_to(tmp_path):
    problem = anywhere(one_joint(tmp_path, mass=1.0, effort=50))
    motion = rest_to_rest(["turn"], 0.3, 0.3 + 1e-6, 1.0)
    execution = executed(problem, motion, plants_of(problem.robot, delay=0.01))
    assert behind(motion, execution).max() < 1e-6


def test_time_covers_what_is_held_afterwards(tmp_path):
    problem = anywhere(one_joint(tmp_path))
    motion = rest_to_rest(["turn"], 0.0, 0.1, 1.234)
    time = executed(problem, motion, plants_of(problem.robot), control_period=0.01).time
    np.testing.assert_allclose(time, np.arange(145) * 0.01)


def test_measured_positions_and_their_differences_are_noisy(tmp_path):
    """What controllers answer, beside the real errors: white noise and its differences."""
    robot, period, count = gantry(tmp_path), 0.02, 1000
    sizes = (1e-4, 1e-4, 3e-4)
    plants = [plants_of(robot, runs=3, noise=noise)[run] for run, noise in enumerate(sizes)]
    motion = rest_to_rest(["lift", "turn"], [0.0, 0.0], [1e-12, 1e-12], period * count)
    made = executed(anywhere(robot), motion, plants, "feedforward-pd", period)
    inertia, stiffness, damping = np.array([3.0, 0.2]), BANDWIDTH**2, 2 * BANDWIDTH
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


def test_an_arm_of_which_one_joint_is_out_of_control_is_left_too(tmp_path):
    robot = gantry(tmp_path, effort={"lift": 0.1, "turn": 1e6})
    motion = rest_to_rest(["lift", "turn"], [0.0, 0.0], [0.01, 1.0], 1.5)
    execution = executed(anywhere(robot), motion, plants_of(robot, delay=0.3))
    assert abs(execution.velocity[0, -1, 0]) < 1.0
    assert abs(execution.velocity[0, -1, 1]) > 1e3
    assert (execution.position[0, -1] == execution.position[0, -2]).all()


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
    with pytest.raises(OptionError, match=r"control_period is 0\.2 s; give a number"):
        executed(problem, motion, plants, control_period=0.2)
    with pytest.raises(OptionError, match="control_period is 'fast' s"):
        executed(problem, motion, plants, control_period="fast")
    with pytest.raises(OptionError, match="unknown controller 'lqr'"):
        executed(problem, motion, plants, "lqr")
    with pytest.raises(OptionError, match="plants is empty"):
        executed(problem, motion, [])
