"""Held parts: shares of what contacts carry in executed motions, and parts as free bodies."""

from dataclasses import replace

import numpy as np
import pytest
from cases import rest_to_rest
from gantry import gantry

from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.execution.held_parts import LOST, MOVED, executed_uses, most_used, parts_moved
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import judged_runs, run_verdict
from tubeplanner.execution.simulation import AFTERWARDS, Execution
from tubeplanner.output.execution_curves import holding_band
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.demands import Robustness
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray

FRICTION, GRAVITY = 0.3, 9.81
SLIDES = FRICTION * GRAVITY  # [m/s^2], of what stands on a tray
PEAK = 10 / np.sqrt(3)  # acceleration of a quintic of 1 m in 1 s
PART = Payload(0.8, (0.0, 0.0, 0.001), (1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
LOW_TRAY = Tray(FRICTION, (0.1, 0.1))


def held_by(tmp_path, contact, part=PART, **changes):
    """A gantry that holds a part."""
    problem = load_problem(gantry(tmp_path, **changes))
    return replace(problem, holding=(Holding(contact, part),))


def along(peak, length=0.5):
    """A motion along x with a peak of acceleration [m/s^2]."""
    return rest_to_rest(["along", "across"], [0, 0], [length, 0], np.sqrt(PEAK * length / peak))


def executed_by(problem, motion, runs=1, period=0.001, speed=1.0, **errors):
    """The run of arms that follow a motion exactly at a speed, with errors of contacts alone."""
    time = np.arange(0.0, motion.duration / speed + AFTERWARDS, period)
    at = np.minimum(speed * time, motion.duration)
    plants = drawn_plants(problem.robot, Robustness.exact(**errors), Draw(runs))
    rows = motion.position(at), speed * motion.velocity(at)
    q, v = (np.array([each] * runs) for each in rows)
    return Execution(plants, time, q, v, 0 * q, np.zeros(q.shape, dtype=bool))


def slid(motion):
    """The largest slide of a block that only Coulomb friction moves, in small steps [m]."""
    step, speed, way, most = 1e-5, 0.0, 0.0, 0.0
    for time in np.arange(0.0, motion.duration + AFTERWARDS, step):
        tool = motion.acceleration(min(time, motion.duration))[0] * (time < motion.duration)
        friction = step * SLIDES
        free = speed - step * tool
        speed = free - np.clip(free, -friction, friction)
        way += step * speed
        most = max(most, abs(way))
    return most


@pytest.mark.slow
@pytest.mark.parametrize(("fraction", "stays"), [(0.95, True), (1.3, False)])
def test_a_part_on_a_tray_slides_as_far_as_coulomb_friction_lets_it(tmp_path, fraction, stays):
    problem, motion = held_by(tmp_path, LOW_TRAY), along(fraction * SLIDES)
    (extreme,) = parts_moved(problem, executed_by(problem, motion))
    assert extreme.value == pytest.approx(slid(motion), rel=0.03, abs=1e-4)
    assert (extreme.value <= MOVED) == stays


def test_a_high_part_tips_over_the_edge_of_its_foot(tmp_path):
    part = replace(PART, com=(0.0, 0.0, 0.1))
    for fraction, lost in ((0.95, False), (1.6, True)):
        problem = held_by(tmp_path, Tray(3.0, (0.04, 0.04)), part)
        motion = along(fraction * GRAVITY * 0.02 / 0.1)
        (extreme,) = parts_moved(problem, executed_by(problem, motion))
        assert (extreme.value > LOST) == lost
        assert extreme.value < MOVED or lost


@pytest.mark.parametrize(
    "contact",
    [
        Cup(20.0, 0.03, 0.5, normal=(0.0, 0.0, -1.0)),
        Gripper(20.0, 0.5, (0.04, 0.04), closing=(0.0, 1.0, 0.0)),
    ],
)
def test_cups_and_grippers_hold_as_much_as_their_friction_carries(tmp_path, contact):
    part = replace(PART, com=(0.0, 0.0, 0.0))
    weight = part.mass * GRAVITY
    if contact.kind == "cup":  # the part hangs below it
        most = 0.5 * (20.0 - weight) / part.mass
    else:
        most = np.sqrt((2 * 0.5 * 20.0) ** 2 - weight**2) / part.mass
    problem = held_by(tmp_path, contact, part)
    for fraction, stays in ((0.9, True), (1.2, False)):
        execution = executed_by(problem, along(fraction * most))
        (extreme,) = parts_moved(problem, execution)
        assert (extreme.value <= MOVED) == stays
        assert (most_used(problem, execution, 0).value <= 1.0) == stays


def test_a_cup_that_is_torn_off_is_lost(tmp_path):
    low = replace(PART, com=(0.0, 0.0, -0.1))
    problem = held_by(tmp_path, Cup(20.0, 0.03, 3.0, normal=(0.0, 0.0, -1.0)), low)
    tears = 0.03 * (20.0 - PART.mass * GRAVITY) / (0.1 * PART.mass)
    for fraction, lost in ((0.8, False), (2.0, True)):
        (extreme,) = parts_moved(problem, executed_by(problem, along(fraction * tears)))
        assert extreme.value == 1.0 if lost else extreme.value < MOVED


def test_the_share_is_that_of_the_real_friction_at_safety_1(tmp_path):
    problem, motion = held_by(tmp_path, LOW_TRAY, replace(PART, inertia=6 * (0.0,))), along(2.0)
    execution = executed_by(problem, motion, runs=4, friction=0.2)
    shares = [most_used(problem, execution, run) for run in range(4)]
    for share, plant in zip(shares, execution.plants, strict=True):
        expected = 2.0 / (plant.contact_friction * SLIDES)
        assert share.value == pytest.approx(expected, rel=2e-3)
        assert share.location.contact == "tray slides"
    assert execution.plants[0].contact_friction in (pytest.approx(0.8), pytest.approx(1.2))
    assert execution.plants[1].contact_friction == 1.0
    (use,) = executed_uses(problem, execution, 1, safety=None)
    assert use.share.max() > shares[1].value * LOW_TRAY.safety * 0.99


def test_runs_fail_for_shares_and_for_parts_that_move_each_with_its_words(tmp_path):
    problem = held_by(tmp_path, LOW_TRAY)
    for fraction, broken in ((0.5, 0), (1.5, 1)):
        motion = along(fraction * SLIDES)
        execution = executed_by(problem, motion)
        runs = judged_runs(problem, motion, execution, follow_parts=True)
        verdict = run_verdict(runs)
        assert verdict.broken["holding"] == verdict.broken["part"] == broken
        assert ("lost the held part or moved it by more than 1 mm" in str(verdict)) == bool(broken)
        assert runs[0].loses_part == (runs[0].part.value > LOST)
        assert judged_runs(problem, motion, execution)[0].part is None


def test_a_liquid_on_its_cone_all_the_way_is_spilt_at_a_larger_speed_alone():
    problem = load_problem("example:panda/between_shelves")
    rotation, _ = problem.robot.tool_pose(problem.endpoints[0].joints[None])
    up = tuple((rotation[0] @ problem.robot.tool_offset.placement[:3, :3].T)[2].tolist())
    problem = replace(problem, holding=(Holding(Liquid(0.34, normal=up), None),))
    result = plan(problem, PlanOptions(slack=0.0))
    assert result.succeeded
    for speed, largest in ((0.99, 0.999), (1.0, 1.0), (1.01, np.inf)):
        share = most_used(problem, executed_by(problem, result.trajectory, speed=speed), 0).value
        assert share <= largest
    assert share > 1.0


def test_liquids_are_no_bodies_and_nothing_held_has_no_share(tmp_path):
    problem = held_by(tmp_path, Liquid(0.2), None)
    execution = executed_by(problem, along(1.0))
    assert parts_moved(problem, execution) is None
    assert most_used(problem, execution, 0).value == pytest.approx(
        1.0 / (GRAVITY * np.tan(0.2)), rel=2e-3
    )
    assert most_used(replace(problem, holding=()), execution, 0) is None


def test_the_same_seed_moves_the_part_by_the_same(tmp_path):
    problem, motion = held_by(tmp_path, LOW_TRAY), along(1.1 * SLIDES)
    one, other = (
        [each.value for each in parts_moved(problem, executed_by(problem, motion, 3, friction=0.2))]
        for _ in range(2)
    )
    assert one == other
    assert len(set(one)) == 3


def test_the_figures_band_is_what_plan_and_runs_leave_of_the_contact(tmp_path):
    problem, motion = held_by(tmp_path, LOW_TRAY, replace(PART, inertia=6 * (0.0,))), along(1.5)
    execution = executed_by(problem, motion, runs=2, friction=0.2)
    band = holding_band(problem, motion, execution)
    assert band.plan.min() == pytest.approx(1 - 1.5 / SLIDES, abs=2e-3)
    assert band.runs.shape == (2, len(execution.time))
    np.testing.assert_allclose(band.runs[1], band.plan, atol=1e-2)
    assert holding_band(replace(problem, holding=()), motion, execution) is None
