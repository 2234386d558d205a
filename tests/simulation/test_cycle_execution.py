import numpy as np
import pytest

from cases import anywhere
from simulated_cycle import DURATION, DWELL, LEVER, PART, SEAMS, motion_of, moves_of, picking, slide
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Event
from tubeplanner.problem.robustness import CONTROLLERS, PD, Robustness
from tubeplanner.simulation.cycle_execution import executed_cycle
from tubeplanner.simulation.cycle_stages import cycle_stages
from tubeplanner.simulation.execution import executed, executed_stages
from tubeplanner.simulation.plant import Draw, drawn_plants
from tubeplanner.simulation.stage import Stage
from tubeplanner.simulation.tracking_controllers import BANDWIDTH

ATTACH = DURATION + DWELL  # [s], when
LIFT = 2  # the joint at which the part pulls


def same(first, second):
    return all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("time", "position", "velocity", "effort", "is_saturated")
    )


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_cycle_of_one_move_is_executed_as_that_move_alone(tmp_path, controller):
    robot, errors = slide(tmp_path), Robustness(controller=controller)
    cycle = Cycle(SEAMS[0], moves_of(robot)[:1])
    motion = motion_of(cycle)
    alone = executed(
        cycle.problem(0, motion.seams),
        motion.trajectory,
        drawn_plants(robot, errors, Draw(2, 5)),
        controller,
    )
    assert same(executed_cycle(motion, errors, Draw(2, 5)), alone)


def test_where_the_load_stays_moves_are_executed_as_one_motion(tmp_path):
    robot = slide(tmp_path)
    reach, carry, back = moves_of(robot)
    motion = motion_of(Cycle(SEAMS[0], [reach, Event("look", dwell=DWELL), carry, back]))
    plants = drawn_plants(robot, Robustness(), Draw(2, 5))
    alone = executed(anywhere(robot), motion.trajectory, plants)
    assert same(executed_cycle(motion, Robustness(), Draw(2, 5)), alone)


def test_positions_velocities_and_what_is_on_its_way_are_handed_over(tmp_path):
    """A stage that changes nothing changes nothing, also in the middle of a motion."""
    errors = Robustness(lag=0.004, delay=0.005, noise=1e-4)
    robot = slide(tmp_path)
    motion = motion_of(Cycle(SEAMS[0], moves_of(robot)[:1])).trajectory
    stages = [Stage(t, robot, drawn_plants(robot, errors, Draw(2))) for t in (0.0, 0.3211, 0.7)]
    whole, parts = executed_stages(stages[:1], motion), executed_stages(stages, motion)
    np.testing.assert_allclose(parts.position, whole.position, atol=1e-12)
    np.testing.assert_allclose(parts.effort, whole.effort, atol=1e-8)
    assert (parts.time == whole.time).all()


def test_an_exact_arm_follows_through_what_it_takes_and_lets_go(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = executed_cycle(motion, Robustness.exact(), Draw(1))
    planned = motion.trajectory.position(np.minimum(execution.time, motion.trajectory.duration))
    assert abs(execution.position[0] - planned).max() < 1e-4
    assert not execution.is_saturated.any()


def test_the_effort_that_holds_the_arm_jumps_by_what_the_part_weighs(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = executed_cycle(motion, Robustness.exact(), Draw(1))
    before, after = (
        execution.effort[0, np.searchsorted(execution.time, ATTACH + away)]
        for away in (-0.02, 0.02)
    )
    jump = abs(after - before)
    assert jump[LIFT] == pytest.approx(PART.mass * 9.81 * LEVER, rel=1e-4)
    assert jump[:LIFT].max() < 1e-3


def test_a_part_that_is_heavier_than_thought_pulls_the_tool_down_where_it_is_taken(tmp_path):
    """At rest feedback holds what the model does not know, as soft as it is."""
    motion = motion_of(picking(tmp_path))
    errors = Robustness.exact(payload=0.5, controller="feedforward-pd")
    execution = executed_cycle(motion, errors, Draw(3))
    planned = motion.trajectory.position(np.minimum(execution.time, motion.trajectory.duration))
    away = abs(execution.position - planned)[:, :, LIFT]
    held, taken = (np.searchsorted(execution.time, ATTACH + late) for late in (-0.001, DWELL))
    assert away[:, held].max() < 1e-4
    loaded = cycle_stages(motion, errors, Draw(3))[1].plants
    wrong = np.array([abs(plant.bodies[3].mass - 1.0 - PART.mass) for plant in loaded])
    assert wrong.max() > 0.2
    # A critically damped oscillator of 30 rad/s under a constant force.
    inertia = 0.01 + 0.1**2 + PART.mass * LEVER**2
    settled = 1 - (1 + BANDWIDTH * DWELL) * np.exp(-BANDWIDTH * DWELL)
    expected = settled * wrong * 9.81 * LEVER / (inertia * BANDWIDTH**2)
    np.testing.assert_allclose(away[:, taken], expected, rtol=0.03)
    assert away[:, -1].max() < 1e-4


def test_a_position_controller_holds_the_weight_of_what_is_taken(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = executed_cycle(motion, Robustness.exact(controller=PD), Draw(1))
    taken = np.searchsorted(execution.time, ATTACH + DWELL)
    planned = motion.trajectory.position(ATTACH)
    assert abs(execution.position[0, taken] - planned)[LIFT] < 1e-4


def test_without_a_draw_fifty_arms_execute_it(tmp_path):
    cycle = Cycle(SEAMS[0], moves_of(slide(tmp_path))[:1])
    errors = Robustness(control_period=0.05)
    assert len(executed_cycle(motion_of(cycle), errors).plants) == 50
