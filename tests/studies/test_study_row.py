"""One point: its row is what `plan` answers, and reasons instead of exceptions."""

import json

import numpy as np
import pytest

from studied import PROBLEM, QUICK, RADIUS
from tubeplanner import PlanOptions, ProblemError, load_problem, plan
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.studies import study_row
from tubeplanner.studies.study_row import (
    StudyRow,
    crashed_answer,
    planned_answer,
    refused_answer,
)


def row_of(options=QUICK, **changes):
    named = {name.replace("__", "."): value for name, value in changes.items()}
    posed = PosedProblem.read(PROBLEM).changed(named)
    answer = json.loads(json.dumps(planned_answer(posed, options), allow_nan=False))
    return StudyRow.of(0, named, "key", answer)


def test_a_row_is_what_plan_answers_to_the_last_bit():
    row, result = row_of(), plan(load_problem(PROBLEM), QUICK)
    assert (row.status, row.duration, row.message) == ("success", result.duration, result.message)
    assert (row.shortest_duration, row.method) == (result.shortest_duration, result.method)
    assert (row.notes, row.where, row.key) == (result.notes, Place(), "key")
    assert row.planning_time > 0
    assert row.loading_time > 0
    assert row.runs is row.runs_failed is None
    assert row.trajectory_hash == row_of().trajectory_hash
    assert len(row.trajectory_hash) == 16


def test_the_hash_is_of_every_bit(monkeypatch):
    result = plan(load_problem(PROBLEM), QUICK)
    before = row_of().trajectory_hash
    coefficients = result.trajectory.coefficients.copy()
    coefficients[0, 0, 0] = np.nextafter(coefficients[0, 0, 0], np.inf)
    kind = type(result.trajectory)
    other = kind(result.trajectory.joint_names, result.trajectory.breakpoints, coefficients)
    answer = PlanResult(PlanStatus.SUCCESS, "", Place(), "m", other)
    monkeypatch.setattr(study_row, "plan_either", lambda *_: answer)
    assert row_of().trajectory_hash != before


def test_the_slack_of_the_file_counts_as_in_plan():
    usual = row_of(PlanOptions(quality="fast"))
    assert usual.shortest_duration < usual.duration
    shortest = row_of(PlanOptions(quality="fast", slack=0.0))
    assert shortest.duration == shortest.shortest_duration == usual.shortest_duration


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"tube__radius": -1}, "tube.radius[0] is -1 m"),
        ({"tube__radius": "wide"}, "tube.radius is 'wide'; it must be a number"),
        ({"robot__payload": {"mass": -1.0}}, "robot.payload: mass -1 kg must be from 0"),
        ({"robot__tool_frame": "nose"}, "nose"),
    ],
)
def test_what_cannot_be_posed_has_its_reason(changes, reason):
    row = row_of(**changes)
    assert row.status is PlanStatus.BAD_INPUT
    assert reason in row.message
    assert row.duration is row.trajectory_hash is row.method is row.loading_time is None


def test_an_option_that_the_method_refuses_is_bad_input_of_a_problem_that_loads():
    row = row_of(PlanOptions("stop-at-corners", slack=0.1))
    assert row.status is PlanStatus.BAD_INPUT
    assert "slack" in row.message
    assert row.loading_time > 0


def test_a_place_travels():
    row = row_of(robot__payload={"mass": 1e5, "com": [0.5, 0.0, 0.0]}, robot__gravity=[0, -9.81, 0])
    assert row.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert row.where.joint == "joint1"
    assert isinstance(row.where.position, tuple)


def test_ctrl_c_is_no_answer(monkeypatch):
    stopped = PlanResult(PlanStatus.SUCCESS, "", Place(), "m", stopped_by="interrupt")
    monkeypatch.setattr(study_row, "plan_either", lambda *_: stopped)
    with pytest.raises(KeyboardInterrupt):
        row_of()


def test_a_bug_is_not_taken_for_bad_input(monkeypatch):
    def bug(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(study_row, "plan_either", bug)
    with pytest.raises(ZeroDivisionError):
        row_of()


def test_rows_without_a_plan_say_why():
    values = {RADIUS: float("inf")}
    crashed = StudyRow.of(3, values, "k", crashed_answer(ValueError("too small")))
    assert (crashed.status, crashed.message) == (PlanStatus.CRASHED, "ValueError: too small")
    refused = StudyRow.of(3, values, None, refused_answer(str(ProblemError("no"))))
    assert (refused.status, refused.message, refused.key) == (PlanStatus.BAD_INPUT, "no", None)
    fields = json.loads(json.dumps(refused.as_dict(), allow_nan=False))
    assert fields["values"] == {RADIUS: ".inf"}
    assert (fields["status"], fields["where"]["joint"], fields["notes"]) == ("bad_input", None, [])
