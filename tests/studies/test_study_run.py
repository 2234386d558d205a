"""run_study: each point once, journaled; rows, table."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from studied import EFFORT, MASS, PROBLEM, QUICK, RADIUS, Here, Together, small_study, some_result

from tubeplanner import JointTrajectory, PlanOptions, ProblemError, load_problem, plan, run_study
from tubeplanner.errors import OptionError, OutputError
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies import rows
from tubeplanner.studies import study as study_run
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import StudyProgress
from tubeplanner.studies.study import (
    Levels,
    Study,
    StudyResult,
    StudyRow,
    crashed_answer,
    planned_answer,
    refused_answer,
)

GRID = {RADIUS: [0.02, -1, 0.03], EFFORT: [1, 0.5]}


def row_of(options=QUICK, **changes):
    named = {name.replace("__", "."): value for name, value in changes.items()}
    spec = ProblemSpec.read(PROBLEM).changed(named)
    answer = json.loads(json.dumps(planned_answer(spec, options), allow_nan=False))
    return StudyRow.of(0, named, "key", answer)


def test_a_row_is_what_plan_answers_to_the_last_bit():
    row, result = row_of(), plan(load_problem(PROBLEM), QUICK)
    assert (row.status, row.duration, row.message) == ("success", result.duration, result.message)
    assert (row.shortest_duration, row.method) == (result.shortest_duration, result.method)
    assert row.bound == result.bound.duration
    assert (row.notes, row.where, row.key) == (result.notes, Location(), "key")
    assert (row.runs, row.runs_failed) == (None, None)
    assert min(row.planning_time, row.loading_time) > 0
    assert row.trajectory_hash == row_of().trajectory_hash
    assert len(row.trajectory_hash) == 16


def test_the_hash_is_of_every_bit(monkeypatch):
    result = plan(load_problem(PROBLEM), QUICK)
    before = row_of().trajectory_hash
    coefficients = result.trajectory.coefficients.copy()
    coefficients[0, 0, 0] = np.nextafter(coefficients[0, 0, 0], np.inf)
    other = JointTrajectory(["joint1", "joint2"], result.trajectory.breakpoints, coefficients)
    answer = PlanResult(PlanStatus.SUCCESS, "", Location(), "m", other)
    monkeypatch.setattr(rows, "plan_task", lambda *_: answer)
    assert row_of().trajectory_hash != before


def test_the_slack_of_the_file_counts_as_in_plan():
    usual = row_of(PlanOptions(quality="fast"))
    assert usual.shortest_duration < usual.duration
    shortest = row_of(PlanOptions(quality="fast", slack=0.0))
    assert shortest.duration == shortest.shortest_duration == usual.shortest_duration


def test_what_cannot_be_posed_has_its_reason():
    row = row_of(tube__radius=-1)
    assert row.status is PlanStatus.BAD_INPUT
    assert "tube.radius[0] is -1 m" in row.message
    assert row.duration is row.trajectory_hash is row.method is row.loading_time is None
    loaded = row_of(PlanOptions("stop-at-corners", slack=0.1))  # the method refuses the slack
    assert (loaded.status, "slack" in loaded.message) == ("bad_input", True)
    assert loaded.loading_time > 0


def test_a_place_travels():
    row = row_of(robot__payload={"mass": 1e5, "com": [0.5, 0.0, 0.0]}, robot__gravity=[0, -9.81, 0])
    assert row.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert row.where.joint == "joint1"
    assert isinstance(row.where.position, tuple)


def test_ctrl_c_is_no_answer_and_a_bug_not_taken_for_bad_input(monkeypatch):
    stopped = PlanResult(PlanStatus.SUCCESS, "", Location(), "m", stopped_by="interrupt")
    monkeypatch.setattr(rows, "plan_task", lambda *_: stopped)
    with pytest.raises(KeyboardInterrupt):
        row_of()
    monkeypatch.setattr(rows, "plan_task", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        row_of()


def test_rows_without_a_plan_say_why():
    values = {RADIUS: float("inf")}
    crashed = StudyRow.of(3, values, "k", crashed_answer(ValueError("too small")))
    assert (crashed.status, crashed.message) == (PlanStatus.CRASHED, "ValueError: too small")
    refused = StudyRow.of(3, values, None, refused_answer(str(ProblemError("no"))))
    assert (refused.status, refused.message, refused.key) == (PlanStatus.BAD_INPUT, "no", None)
    fields = json.loads(json.dumps(refused.as_dict(), allow_nan=False))
    assert (fields["values"], fields["notes"]) == ({RADIUS: ".inf"}, [])


def test_the_table_as_csv_and_as_json_say_the_same():
    values = {RADIUS: [0.02, "x2", [0.01]], EFFORT: [1, float("inf")]}
    result = some_result(values, blocked=lambda each: each[EFFORT] != 1)
    table = list(csv.DictReader(io.StringIO(result.csv())))
    fields = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert (fields["study"], fields["points"]) == ("small", 6)
    assert fields["counts"] == {"success": 3, "tube_blocked": 3}
    assert [line[RADIUS] for line in table] == ["0.02", "0.02", "x2", "x2", "[0.01]", "[0.01]"]
    assert [line[EFFORT] for line in table] == ["1", ".inf"] * 3
    for line, row in zip(table, fields["rows"], strict=True):
        told = (int(line["point"]), line["status"], line["message"])
        assert told == (row["point"], row["status"], row["message"])
        assert (float(line["duration"]) if line["duration"] else None) == row["duration"]
    assert list(table[0])[:5] == ["point", RADIUS, EFFORT, "status", "duration"]
    noted = some_result({RADIUS: [0.02]}, fields={"notes": ("one", "two")})
    (line,) = csv.DictReader(io.StringIO(noted.csv()))
    assert (line["notes"], line["where"]) == ("one; two", "")


def test_the_shortest_and_whether_there_is_any():
    result = some_result({RADIUS: [0.02, 0.03, 0.04]}, blocked=lambda each: each[RADIUS] < 0.03)
    assert result.succeeded
    assert result.shortest.values == {RADIUS: 0.03}
    nothing = some_result({RADIUS: [0.02]}, blocked=lambda _: True)
    assert (nothing.succeeded, nothing.shortest) == (False, None)
    assert StudyResult(small_study(), ()).counts == {}


@pytest.fixture
def journal(tmp_path):
    return tmp_path / "t.jsonl"


def lines(journal):
    return [json.loads(line) for line in journal.read_text().splitlines()]


def failing_at(monkeypatch, failures):
    """Let planning end otherwise: by the number of the call, from 1, what is raised."""
    count, plan_one = 0, study_run.planned_answer

    def planned(spec, options):
        nonlocal count
        count += 1
        if count in failures:
            raise failures[count]
        return plan_one(spec, options)

    monkeypatch.setattr(study_run, "planned_answer", planned)


def test_rows_are_those_of_plan_in_the_order_of_points(journal):
    study = small_study(GRID)
    result = run_study(study, journal=journal, executor=Here())
    expected = [(point.index, point.values) for point in study.points]
    assert [(row.point, row.values) for row in result.rows] == expected
    assert [row.duration is None for row in result.rows] == [False] * 2 + [True] * 2 + [False] * 2
    problem = load_problem(PROBLEM, changes=result.rows[5].values)
    assert result.rows[5].duration == plan(problem, study.options).duration
    kept = lines(journal)
    assert [line["key"] for line in kept] == [row.key for row in result.rows]
    assert [line["values"] for line in kept] == [row.as_dict()["values"] for row in result.rows]
    assert result.stopped_by is None


@pytest.mark.slow  # processes load the libraries
def test_worker_processes_give_the_same_bits():
    hashes = [
        [row.trajectory_hash for row in run_study(small_study(), executor=executor).rows]
        for executor in (None, Here())
    ]
    assert hashes[0] == hashes[1]


def test_what_is_in_the_journal_is_not_planned_again(journal):
    first, second = Here(), Here()
    before = run_study(small_study({RADIUS: [0.02, -1]}), journal=journal, executor=first)
    wider = small_study({RADIUS: [0.02, -1, 0.03]})
    result = run_study(wider, journal=journal, executor=second)
    assert (first.calls, second.calls) == (2, 1)
    assert [row.as_dict() for row in result.rows[:2]] == [row.as_dict() for row in before.rows]
    assert [row.values for row in result.rows] == [{RADIUS: value} for value in (0.02, -1, 0.03)]
    assert len(lines(journal)) == 3


def test_points_that_are_the_same_are_planned_once():
    executor, study = Here(), small_study({RADIUS: [0.03, 0.02, "x1"]})
    first, _, third = run_study(study, executor=executor).rows
    assert (executor.calls, third.values) == (2, {RADIUS: "x1"})
    assert (first.key, first.trajectory_hash) == (third.key, third.trajectory_hash)


def test_a_point_waits_for_the_same_that_is_being_planned(journal):
    executor, told = Together(2), []
    study = small_study({RADIUS: [0.03, "x1", 0.02]})
    result = run_study(study, journal=journal, executor=executor, progress=told.append)
    assert executor.calls == len(lines(journal)) == 2
    assert result.rows[0].trajectory_hash == result.rows[1].trajectory_hash
    assert [each.done for each in told] == [0, 2, 3]


def test_values_that_cannot_be_set_together_cost_their_row(journal):
    payload = {"mass": 1, "com": [0, 0, 0]}
    study = small_study({"robot.payload": [payload, None], MASS: [1, "x2"]})
    executor = Here()
    result = run_study(study, journal=journal, executor=executor)
    assert [str(row.status) for row in result.rows] == ["success"] * 3 + ["bad_input"]
    assert result.rows[3].message.startswith("robot.payload.mass: nothing is given there")
    assert executor.calls == len(lines(journal)) == 3


def test_a_bug_costs_its_row_and_is_kept(journal, monkeypatch):
    failing_at(monkeypatch, {2: ZeroDivisionError("division by zero")})
    study = small_study({RADIUS: [0.01, 0.02, 0.03]})
    result = run_study(study, journal=journal, executor=Here())
    assert [row.status for row in result.rows] == ["success", PlanStatus.CRASHED, "success"]
    assert result.rows[1].message == "ZeroDivisionError: division by zero"
    assert lines(journal)[1]["row"]["status"] == "crashed"


def test_ctrl_c_keeps_what_is_done_and_the_next_run_goes_on(journal, monkeypatch):
    study = small_study({RADIUS: [0.01, 0.02, 0.03]})
    with monkeypatch.context() as patched:
        failing_at(patched, {1: KeyboardInterrupt()})
        with pytest.raises(KeyboardInterrupt):
            run_study(study, journal=journal, executor=Here())
    assert lines(journal) == []

    def interrupt(progress):
        if progress.done == 2:
            raise KeyboardInterrupt

    result = run_study(study, journal=journal, executor=Here(), progress=interrupt)
    assert result.stopped_by == "interrupt"
    assert [row.point for row in result.rows] == [0, 1]
    executor = Here()
    result = run_study(study, journal=journal, executor=executor)
    assert (executor.calls, len(result.rows), result.stopped_by) == (1, 3, None)


def test_a_point_is_posed_when_it_is_its_turn(monkeypatch):
    spec, seen = [], []

    def noted(self, changes, changed=ProblemSpec.changed):
        spec.append(changes)
        return changed(self, changes)

    study = small_study({RADIUS: [0.01, 0.02, 0.03]})
    monkeypatch.setattr(ProblemSpec, "changed", noted)
    run_study(study, executor=Here(), progress=lambda told: seen.append((told.done, len(spec))))
    assert seen == [(0, 0), (1, 1), (2, 2), (3, 3)]


def test_whoever_plans_has_the_files_that_the_key_is_of(journal, tmp_path):
    """A file that is changed while a study runs, or is another one elsewhere, ends it."""
    points = tmp_path / "points.csv"
    points.write_text("x,y,z\n1.2,0.4,0\n0.8,0.9,0\n")
    spec = ProblemSpec.read(PROBLEM).changed({"tube.points": str(points)})
    spec = replace(spec, folder=tmp_path)

    class Elsewhere(Here):
        def submit(self, fn, /, *args, **kwargs):
            if self.calls == 1:
                points.write_text(points.read_text().replace("0.8", "0.85"))
            return super().submit(fn, *args, **kwargs)

    axes = [Levels(RADIUS, (0.02, 0.03, 0.04))]
    study = Study("s", {"arm": spec}, axes, None, PlanOptions("stop-at-corners"))
    with pytest.raises(OptionError, match="its files, or tubeplanner's own, are not what they"):
        run_study(study, journal=journal, executor=Elsewhere())
    assert [line["values"] for line in lines(journal)] == [{RADIUS: 0.02}]


def test_progress_has_count_rate_and_time_left(journal):
    told = []
    study = small_study({RADIUS: [0.02, 0.03, "x1"]})
    run_study(study, journal=journal, executor=Here(), progress=told.append)
    assert (told[0].done, told[-1].done, told[-1].count, told[-1].planned) == (0, 3, 3, 2)
    told.clear()
    run_study(study, journal=journal, executor=Here(), progress=told.append)
    assert (told[-1].done, told[-1].planned, told[-1].rate) == (3, 0, None)


@pytest.mark.parametrize(
    ("progress", "text"),
    [
        (StudyProgress(5, 9, 0, 1.0), "5 of 9 points"),
        (StudyProgress(10, 40, 10, 5.0), "10 of 40 points, 2 per second, 15 s left"),
        (StudyProgress(30, 40, 10, 40.0), "30 of 40 points, 4 s each, 40 s left"),
        (StudyProgress(1, 301, 1, 2.0), "1 of 301 points, 2 s each, 10 min left"),
        (StudyProgress(1, 6001, 1, 2.0), "1 of 6001 points, 2 s each, 3 h 20 min left"),
    ],
)
def test_progress_in_words(progress, text):
    assert str(progress) == text


def test_an_answer_that_was_edited_is_refused_with_its_file(journal):
    run_study(small_study(), journal=journal, executor=Here())
    text = journal.read_text()
    journal.write_text(text.replace('"duration": ', '"duration": "long", "long": ', 1))
    with pytest.raises(OutputError, match=r"t\.jsonl: the line of key .* holds no answer"):
        run_study(small_study(), journal=journal, executor=Here())
