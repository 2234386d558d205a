"""The used share of what contacts carry: closed forms, and agreement with the cones' margins."""

from dataclasses import replace

import numpy as np
import pytest
from cases import rest_to_rest
from gantry import gantry

from tubeplanner import load_problem
from tubeplanner.limits.holding_limit import holding_peaks
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray
from tubeplanner.task.motion import MotionSection

G = 9.81
PART = Payload(0.8, (0.0, 0.0, 0.03))
HANGING = Payload(0.8, (0.0, 0.0, -0.03))
CONTACTS = {
    "tray": Holding(Tray(0.5, (0.08, 0.08)), PART),
    "disc": Holding(Tray(0.5, 0.04), PART),
    "cup": Holding(Cup(42.4, 0.02, 0.5, normal=(0, 0, -1)), HANGING),
    "gripper": Holding(Gripper(60.0, 0.4, (0.02, 0.03)), Payload(0.8)),
    "liquid": Holding(Liquid(0.4)),
}


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """A motion of 0.5 m along a level line, and its largest acceleration [m/s^2]."""
    problem = load_problem(gantry(tmp_path_factory.mktemp("gantry")))
    trajectory = rest_to_rest(problem.robot.joint_names, [0.0, 0.0], [0.5, 0.0], 1.1)
    time = np.linspace(0, trajectory.duration, 20001)
    return problem, trajectory, float(abs(trajectory.acceleration(time)).max())


@pytest.mark.parametrize("name", CONTACTS)
def test_shares_on_a_level_line_are_closed_forms(moved, name):
    problem, trajectory, a = moved
    holding = CONTACTS[name]
    held = replace(problem, holding=(holding,))
    (peak,) = holding_peaks([MotionSection(held, trajectory, 2.0)])
    s = holding.contact.safety
    at_speed, at_rest, happens = {
        "tray": (a * s**2 / (0.5 * G), 0.0, "slides"),  # friction and pressing weight less by s
        "disc": (a * s**2 / (0.5 * G), 0.0, "slides"),
        # Schmalz's case: the force of the vacuum m (g + a / mu) s.
        "cup": (0.8 * (G + a / 0.5) * s / 42.4, 0.8 * G * s / 42.4, "slides"),
        # Closed along x: the acceleration presses on one finger, both carry the weight.
        "gripper": (
            0.8 * (G + 0.4 * a) * s / (2 * 0.4 * 60.0),
            0.8 * G * s / (2 * 0.4 * 60.0),
            "slides",
        ),
        "liquid": (a / (np.tan(0.4) * G), 0.0, "spills"),
    }[name]
    assert (peak.kind, peak.happens) == (holding.kind, happens)
    assert peak.share == pytest.approx(at_speed, rel=1e-5)
    assert peak.share_at_rest == pytest.approx(at_rest, abs=1e-9)
    assert min(abs(trajectory.acceleration(peak.time - 2.0))[0], a) == pytest.approx(a, rel=1e-5)
    assert str(peak).startswith(f"{holding.kind} at {100 * at_speed:.1f} % of what it carries")


@pytest.mark.parametrize("name", CONTACTS)
def test_a_share_is_above_1_where_a_margin_is_negative_alone(name):
    wrench = np.random.default_rng(1).normal(size=(2000, 6)) * [9, 9, 9, 0.2, 0.2, 0.1]
    cones = CONTACTS[name].cones
    margin = np.min([cone.margin(wrench) for cone in cones], axis=0)
    share = np.max([cone.share(wrench) for cone in cones], axis=0)
    np.testing.assert_array_equal(share > 1, margin < 0)
    assert (share >= 0).all() and 0.05 < (margin < 0).mean() < 1


def test_a_contact_of_two_sections_has_one_peak(moved):
    problem, trajectory, _ = moved
    held = replace(problem, holding=(CONTACTS["tray"], CONTACTS["liquid"]))
    slow = MotionSection(held, trajectory.scaled(2.0))
    fast = MotionSection(held, trajectory, slow.trajectory.duration)
    peaks = holding_peaks([slow, fast, MotionSection(problem, trajectory, 3.3)])
    assert [peak.kind for peak in peaks] == ["tray", "liquid"]
    assert all(peak.time > slow.trajectory.duration for peak in peaks)
    assert holding_peaks([MotionSection(problem, trajectory)]) == []
    lost = max(cone.share(np.zeros((1, 6)))[0] for cone in CONTACTS["tray"].cones)
    assert replace(peaks[0], share=lost).as_dict()["share"] == ".inf"
