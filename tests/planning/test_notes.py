"""Notes on a plan: contact at its ends, least time of its path, jerk, gain of the second stage."""

import re
from dataclasses import replace

import numpy as np
import pytest
from cases import ANGLE, INERTIA, anywhere, one_joint, quintic

from tubeplanner import (
    Contact,
    JointTrajectory,
    LimitOverrides,
    Objective,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    ToolOffset,
    Tube,
    load_problem,
    load_robot,
    placement_of,
    plan,
)
from tubeplanner.cli.report import plan_text
from tubeplanner.planning.result import contact_notes, path_minimum
from tubeplanner.planning.second_stage import gain_note, jerk_note, largest_jerk
from tubeplanner.trajectory.parts import resting

# Notes on solids that overlap where a motion begins or ends in contact.

Q = np.array([0.3, 0.8])


@pytest.mark.parametrize(
    ("lower", "ends", "told"),
    [
        (5e-5, ("start",), []),
        (3e-3, ("start",), ["start"]),
        (3e-3, ("start", "goal"), ["start", "goal"]),
        (-3e-3, ("goal",), []),
    ],
)
def test_an_overlap_is_told_with_its_end_and_depth(lower, ends, told):
    robot = load_robot("example:two_link", "hand", gravity=(0.0, 0.0, 0.0))
    hand = robot.tool_position(Q)
    # The link at the hand is 40 mm high above it, the ball has a radius of 20 mm.
    ball = Obstacle.sphere("ball", 0.02, placement_of(hand + np.array([0, 0, 0.06 - lower])))
    tube = Tube(np.array([hand, hand + np.array([0.1, 0, 0])]), 0.05)
    contacts = [Contact(("link2", "ball"), 0.1, ends)]
    problem = PlanningProblem(robot, tube, Q, obstacles=[ball], contacts=contacts)
    notes = contact_notes(problem, resting(robot.joint_names, Q, 1.0))
    assert [note.split()[2] for note in notes] == told
    for note in notes:
        assert "'link2' and 'ball' overlap by 3 mm" in note


# The least time for a path against moves whose minimum is known, and against the optimiser.


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"velocity": np.inf}, 2 * np.sqrt(ANGLE * INERTIA / 5)),
        ({"velocity": np.inf, "effort": np.inf, "acceleration": 2.0}, 2 * np.sqrt(ANGLE / 2)),
        # Up to 1.5 rad/s in 0.5 s, and down again: the rest of the way at that speed.
        ({"velocity": 1.5, "effort": np.inf, "acceleration": 3.0}, ANGLE / 1.5 + 0.5),
    ],
    ids=["effort", "acceleration", "velocity"],
)
def test_one_joint_switches_once(tmp_path, limits, expected):
    robot = one_joint(tmp_path, **limits)
    for duration in (1.0, 20.0):
        found = path_minimum(anywhere(robot), quintic(duration=duration))
        assert found == pytest.approx(expected, rel=2e-3)


def test_a_straight_line_of_the_tool_takes_what_the_literature_says(planned):
    """The paper's first example, along its line: 0.72 s (Suh & Bishop 1988, table III)."""
    problem, result = planned("two_link/paper_1_10mm")
    assert path_minimum(problem, result.trajectory) == pytest.approx(0.72, abs=0.015)


def test_refinement_leaves_next_to_nothing_on_its_own_path(planned):
    _, result = planned("two_link/paper_3_50mm", "refinement")
    assert 0.99 * result.duration < result.path_minimum < 1.001 * result.duration
    _, stopping = planned("two_link/paper_3_50mm")
    assert stopping.path_minimum < 0.9 * stopping.duration


def test_a_limit_on_the_tools_speed_counts(tmp_path):
    """A lever of 0.5 m at 0.6 m/s turns at 1.2 rad/s, reached in 0.4 s."""
    values = {"velocity": 9.0, "effort": np.inf, "acceleration": 3.0}
    limits = {name: {"turn": value} for name, value in values.items()}
    bar, offset = one_joint(tmp_path), ToolOffset(position=(0.5, 0, 0))
    overrides = LimitOverrides(**limits)
    robot = load_robot(bar.urdf.path, "bar", tool_offset=offset, limits=overrides)
    problem = anywhere(robot)
    problem = problem.with_tube(replace(problem.tube, tool_speed=0.6))
    assert path_minimum(problem, quintic()) == pytest.approx(ANGLE / 1.2 + 0.4, rel=2e-3)


def test_with_friction_the_least_is_said_to_be_a_bound(bundled):
    """TOPP-RA solves for tangents then: found, not proved."""
    name, friction = "two_link/paper_1_30mm", {"robot.motors.viscous_friction": [2.0, 1.0]}
    problem = load_problem(f"example:{name}", changes=friction)
    result = plan(problem, PlanOptions(quality="fast", slack=0.0))
    assert 0.98 * result.duration < result.path_minimum < 1.001 * result.duration
    text = plan_text(problem, result, 0.0, with_minimum=True)
    assert f"would take at most {result.path_minimum:.4f} s, at least" in text
    assert "nothing proves it the least" in text
    plain = bundled(name)
    text = plan_text(plain, result, 0.0, with_minimum=True)
    assert f"would take {result.path_minimum:.4f} s" in text
    assert "time left" not in plan_text(plain, result, 0.0)


# A note on jerk where nothing limits it.


def cubic(names, *jerks):
    """Return two pieces; jerks of the joints in the first, half of them in the second."""
    coefficients = np.zeros((4, 2, len(names)))
    coefficients[0] = np.array([jerks, np.array(jerks) / 2]) / 6
    return JointTrajectory(names, [0.0, 0.1, 0.2], coefficients)


LARGEST = "5.7e+04 rad/s^3 ('joint2')"


@pytest.mark.parametrize(
    ("limits", "named"),
    [
        ({}, LARGEST),
        ({"jerk": {"joint2": 1e9}}, "1.2e+03 rad/s^3 ('joint1')"),
        ({"effort_rate": {"joint2": 1e9}}, "1.2e+03 rad/s^3 ('joint1')"),
        ({"jerk": {"joint1": 1e9}, "effort_rate": {"joint2": 1e9}}, None),
    ],
)
def test_it_names_the_joint_with_the_largest_jerk_that_no_limit_holds(limits, named):
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(**limits))
    trajectory = cubic(robot.joint_names, 1234.0, -56789.0)
    assert largest_jerk(robot, trajectory) == (56789.0, LARGEST)
    notes = jerk_note(robot, trajectory)
    assert len(notes) == (named is not None)
    for note in notes:
        assert f"here up to {named}" in note and "number of knots (2)" in note
        assert largest_jerk(robot, trajectory, unlimited=True)[1] == named


def test_nor_is_there_one_of_joints_that_do_not_jerk(tmp_path):
    assert jerk_note(one_joint(tmp_path), cubic(["turn"], 0.0)) == ()


def test_sliding_joints_have_their_unit(slide):
    (note,) = jerk_note(slide, cubic(slide.joint_names, 1.0, 3.0, 2.0))
    assert "3 m/s^3 ('extend')" in note


# The gain of the second stage.


def gained(robot, objective):
    """Return the note on a bar that turns in five times the time."""
    problem = replace(anywhere(robot), objective=objective)
    before = JointTrajectory(["turn"], [0.0, 1.0], np.array([-2.0, 3.0, 0.0, 0.0])[:, None, None])
    return gain_note(problem, before, before.scaled(5.0))


def test_efforts_that_are_all_zero_are_not_told(tmp_path):
    light = one_joint(tmp_path, effort=np.inf)
    (tmp_path / "bar.urdf").write_text(
        re.sub("<inertial>.*</inertial>", "", (tmp_path / "bar.urdf").read_text(), flags=re.DOTALL)
    )
    massless = load_robot(
        tmp_path / "bar.urdf", "bar", limits=LimitOverrides(effort=np.inf, acceleration=5.0)
    )
    assert "; largest effort swing " in gained(light, None)
    assert gained(massless, None).endswith(
        " s (--slack 0); largest jerk 0.096 rad/s^3 ('turn') instead of 12 rad/s^3 ('turn')"
    )
    work = gained(massless, Objective(0.1, "work"))
    assert work.startswith("work not saved: ") and work.endswith(
        " zero, as the links have no masses"
    )


def test_energy_that_holding_the_arm_takes_is_not_called_saved(tmp_path):
    heavy = one_joint(tmp_path, mass=1.0)
    assert gained(heavy, Objective(0.1, "energy")).startswith("energy not saved: ")
    assert gained(heavy, Objective(0.1, "work")).startswith("work saved: ")


def test_a_motion_as_long_as_the_shortest_is_not_called_longer(tmp_path):
    """In whole periods there may be no time to give away."""
    robot = one_joint(tmp_path)
    before = JointTrajectory(["turn"], [0.0, 1.0], np.array([-2.0, 3.0, 0.0, 0.0])[:, None, None])
    note = gain_note(anywhere(robot), before, before)
    assert note.startswith("smoothed: 1.0000 s, as long as the shortest; ")
