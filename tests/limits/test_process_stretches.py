"""Stretches of constant speed and events on the way: times, speeds, marks in files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tubeplanner import ProblemError, load_problem, plan
from tubeplanner.limits.process_stretches import passed_marks, stretch_runs
from tubeplanner.planning.result import PlanResult
from tubeplanner.task.motion import ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.reader import read_trajectory_file

_SEAM = """
robot: {urdf: "example:two_link", tool_frame: hand, gravity: [0, 0, 0]}
tube:
  points: [[0.25, -0.35, 0], [0.35, -0.3, 0], [0.35, 0, 0], [0.35, 0.3, 0], [0.25, 0.35, 0]]
  radius: [0.02, 0.005, 0.005, 0.02]
  joint_signs: {joint2: "-"}
  tool_speed: [null, {between: [0.01, 0.25]}, {between: [0.01, 0.25]}, null]
  process: {lead_on: 0.05, lead_off: 0.1}
  events:
    - {name: camera, segment: 2, distance: 0.1, lead: 0.03}
    - {name: blow, segment: 0, distance: 0.0}
    - {name: far, segment: 3, distance: 0.1118}
start: {seed: [0.0, -1.0]}
"""


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> PlanningProblem:
    """Return a seam in two segments between an approach and a retract."""
    path = tmp_path_factory.mktemp("seam") / "seam.yaml"
    path.write_text(f"format: tubeplanner/problem\nversion: 1\n{_SEAM}")
    return load_problem(path)


@pytest.fixture(scope="module")
def result(problem: PlanningProblem) -> PlanResult:
    """Return its plan."""
    result = plan(problem)
    assert result.succeeded and result.trajectory is not None
    return result


def test_mean_speed_is_length_over_time(problem: PlanningProblem, result: PlanResult) -> None:
    """The seam is one stretch, whose speed is length over time, from 0.01 to 0.25 m/s."""
    (run,) = result.stretches
    assert (run.name, run.first_segment, run.last_segment) == ("bead", 1, 2)
    assert run.mean_speed == pytest.approx(run.length / (run.off - run.on))
    assert run.length == pytest.approx(0.6, abs=0.05)
    assert run.in_band == pytest.approx(1.0)
    assert -1 <= run.least_deviation <= run.largest_deviation <= 1e-5
    assert result.trajectory is not None
    slower = ProblemMotion(problem, result.trajectory.scaled(1.25))
    (later,) = stretch_runs(slower.sections)
    assert later.mean_speed == pytest.approx(run.mean_speed / 1.25, rel=1e-2)


def test_marks_have_their_leads(problem: PlanningProblem, result: PlanResult) -> None:
    """The tool is at an event's place a lead after its mark; marks are in the order of time."""
    (run,), marks = result.stretches, result.marks
    by_name = {f"{mark.kind} {mark.name}": mark for mark in marks}
    assert by_name["process_on bead"].time == pytest.approx(run.on - 0.05)
    assert by_name["process_off bead"].time == pytest.approx(run.off - 0.1)
    assert by_name["event blow"].time == 0.0
    camera = by_name["event camera"]
    assert (camera.segment, camera.distance) == (2, 0.1)
    assert result.trajectory is not None
    tool = problem.robot.tool_position(result.trajectory.position(camera.time + 0.03)[None])[0]
    np.testing.assert_allclose(tool[1], 0.1, atol=1e-8)
    assert [mark.time for mark in marks] == sorted(mark.time for mark in marks)


def test_marks_are_in_all_files(
    problem: PlanningProblem, result: PlanResult, tmp_path: Path
) -> None:
    """JSON has the marks; CSV and ROS have them in their own times, and are read as before."""
    motion = result.trajectory
    assert motion is not None
    for name in ("m.json", "m.csv", "m.yaml"):
        motion.save(tmp_path / name, problem)
        file = read_trajectory_file(tmp_path / name, problem.robot.joint_names)
        assert file.ignored == ()
        read = passed_marks(ProblemMotion(problem, file.trajectory).sections)
        text = (tmp_path / name).read_text()
        if name == "m.json":
            assert file.marks == tuple(result.marks)
            assert json.loads(text)["marks"] == [mark.as_dict() for mark in read]
        else:
            assert all(str(mark) in text for mark in read)


def test_events_stay_where_they_are(problem: PlanningProblem) -> None:
    """Run-ins, and segments without length, leave places of events unchanged."""
    tube = problem.tube
    longer = replace(
        tube,
        tool_speed=[None, {"speed": 0.2, "tolerance": 0.1}, {"speed": 0.2, "tolerance": 0.1}, None],
        least_tool_speed=None,
        process={"run_in": 0.02, "run_out": 0.02},
    )
    assert longer.segment_count == tube.segment_count + 2
    assert longer.events == tube.events


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        ({"name": "a", "segment": 4}, "there is no segment 4; the last one is segment 3"),
        ({"name": "a", "segment": 3, "distance": 0.3}, "ends after 0.111"),
        ({"name": "a", "segment": 1, "lead": -1}, "lead is -1; it must be from 0 to 60 s"),
        ({"name": "a", "segment": 1.5}, "segment is 1.5"),
        ({"name": "", "segment": 1}, "must be text that is not empty"),
        ({"name": "a"}, r"tube.events\[0\].segment is required"),
        ({"name": "a", "segment": 1, "when": 2}, "unknown field 'when'"),
    ],
)
def test_wrong_events_are_refused(
    problem: PlanningProblem, event: dict[str, object], reason: str
) -> None:
    """A message names the event, the value and its bounds."""
    with pytest.raises(ProblemError, match=reason):
        replace(problem.tube, events=[event])


def test_events_need_an_order(problem: PlanningProblem) -> None:
    """Segments that are visited at will have no events."""
    with pytest.raises(ProblemError, match="does not go with visit: any"):
        replace(
            problem.tube, visit="any", events=[{"name": "a", "segment": 1}], least_tool_speed=None
        )
