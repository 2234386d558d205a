"""The verdict of a page: certificate, peaks, facts on robot and plan."""

import re
from dataclasses import replace

import pytest
from cases import changed
from shown_cycle import data_of, motion_of, shown_cycle
from stored_trajectories import REFINEMENT

from tubeplanner import LimitOverrides, Payload, load_robot, verify
from tubeplanner.certificate.verification import verify_cycle
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.output.page.panel import limit_sources
from tubeplanner.output.page.viewer import view, view_cycle
from tubeplanner.robot.joint_limits import LimitLayer

WALL = "ur5/over_the_wall"


@pytest.fixture
def page(stored, monkeypatch):
    """The page of a certified motion, as of a day in 2001."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    problem, trajectory = stored(WALL, REFINEMENT)
    judged = [verify(problem, trajectory)]
    costs = [Sensitivity("effort", "a", None, -0.1, 0.003)] * 4
    names = ["planned motion"]
    return view(problem, trajectory, names=names, certificates=judged, sensitivities=costs)


def test_the_verdict_counts_the_conditions_that_hold_for_all_t(page):
    (stated,) = data_of(page.html)["trajectories"]
    assert stated["verdict"] == {
        "passed": True,
        "text": "10 conditions hold for all t, 1 where it applies (goal)",
    }
    assert re.fullmatch(r"0\.\d{3} s", stated["lasts"])
    assert stated["top"].endswith(" m/s")
    assert stated["acceleration"].endswith(" m/s\u00b2")
    assert stated["gravities"].endswith(" g")


def test_facts_name_payload_limits_savings_and_version(page):
    facts = {what: value for what, value, _ in page.panel["facts"]}
    assert facts["bound"].startswith("nothing is faster than 0.")
    assert facts["raising a limit by 10 % would save"] == "; ".join(["effort of a: 3 ms"] * 3)
    assert (facts["payload"], facts["limits"]) == (
        "none",
        "velocity, effort: URDF; acceleration, jerk: none",
    )
    assert re.fullmatch(r"2001-09-09 by tubeplanner \d+\.\d+\.\d+", facts["made"])


def test_what_fails_is_told_with_its_margin(stored):
    problem, trajectory = stored(WALL, REFINEMENT)
    narrow = changed(problem, tube=replace(problem.tube, radius=0.03))
    shown = view(narrow, trajectory, certificates=[verify(narrow, trajectory)])
    verdict = shown.panel["trajectories"][0]["verdict"]
    assert not verdict["passed"]
    assert verdict["text"].startswith("tube: margin -0.0")


def test_without_a_certificate_or_a_motion_there_is_no_verdict(stored):
    problem, trajectory = stored(WALL, REFINEMENT)
    assert "verdict" not in view(problem, trajectory).panel["trajectories"][0]
    assert view(problem).panel["facts"] == []


def test_a_cycle_has_its_number_per_hour(tmp_path):
    cycle = shown_cycle(tmp_path)
    motion = motion_of(cycle)
    judged = verify_cycle(cycle, motion)
    panel = view_cycle(cycle, [motion], certificates=[judged]).panel
    assert panel["facts"][0] == ("cycles per hour", "1091", False)  # 3.3 s each
    assert panel["trajectories"][0]["verdict"]["passed"] == judged.passed


def test_sources_of_limits_are_grouped_and_mixed_ones_named():
    layers = [
        LimitLayer("preset p: ", LimitOverrides(effort=50.0), source="preset p"),
        LimitLayer("robot.", LimitOverrides(acceleration={"elbow_joint": 5.0})),
    ]
    robot = load_robot("example:ur5", "tool0", limits=layers, payload=Payload(mass=1.0))
    assert limit_sources(robot) == (
        "velocity: URDF; effort: preset p; acceleration: none and problem file; jerk: none"
    )
