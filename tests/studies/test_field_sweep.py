"""Sweeps over a field: the answers of planning each value, reasons instead of crashes."""

import csv
import io
import json

import pytest

from cases import simulated_sweep
from tubeplanner import OptionError, PlanOptions, load_problem, plan, sweep, sweep_field
from tubeplanner.errors import ProblemError

PROBLEM = "example:two_link/paper_1_30mm"
FAST = PlanOptions(quality="fast")
STOPS = PlanOptions("stop-at-corners")


@pytest.fixture(scope="module")
def swept():
    values = [0.03, "x0.5", -1, [0.02], {"a": 1}, float("inf")]
    return sweep_field(PROBLEM, "tube.radius", values, options=FAST)


def test_rows_are_what_plan_answers_in_the_order_given(swept):
    assert [row.value for row in swept.rows[:2]] == [0.03, "x0.5"]
    radii = sweep(load_problem(PROBLEM), [0.015, 0.03], options=FAST)
    assert [row.duration for row in swept.rows[:2]] == [
        radii.rows[1].duration,
        radii.rows[0].duration,
    ]
    assert swept.rows[3].duration is not None
    assert all(row.result.certificate.passed for row in swept.rows[:2])
    assert swept.succeeded
    assert not swept.varies_objective
    assert (swept.name, swept.path) == ("two_link/paper_1_30mm", "tube.radius")


def test_a_value_that_cannot_be_posed_has_its_reason(swept):
    negative, other, infinite = (swept.rows[k] for k in (2, 4, 5))
    assert negative.message.startswith("tube.radius[0] is -1 m")
    assert other.message == "tube.radius is {'a': 1}; it must be a number"
    assert infinite.message == "tube.radius is inf; it must be a finite number"
    assert [str(row.status) for row in (negative, other)] == ["bad_input"] * 2
    assert negative.duration is negative.shortest_duration is None
    assert negative.notes == ()


def test_csv_and_json_say_the_same(swept):
    table = list(csv.DictReader(io.StringIO(swept.csv())))
    fields = json.loads(json.dumps(swept.as_dict(), allow_nan=False))
    assert fields["problem"] == "two_link/paper_1_30mm"
    assert fields["quantity"] == "tube.radius"
    assert [row["value"] for row in fields["rows"]] == [0.03, "x0.5", -1, [0.02], {"a": 1}, ".inf"]
    written = [line["tube.radius"] for line in table]
    assert written == ["0.03", "x0.5", "-1", "[0.02]", '{"a": 1}', ".inf"]
    for line, row in zip(table, fields["rows"], strict=True):
        for key in ("duration", "shortest_duration", "planning_time", "loading_time"):
            assert (float(line[key]) if line[key] else None) == row[key]
        assert line["message"] == row["message"]
        assert line["notes"] == "; ".join(row["notes"])


def test_rows_say_how_many_runs_failed(swept):
    simulated = simulated_sweep([0, 3, None])
    table = list(csv.DictReader(io.StringIO(simulated.csv())))
    seen = [(row["runs"], row["runs_failed"]) for row in simulated.as_dict()["rows"]]
    assert seen == [(200, 0), (200, 3), (None, None)]
    assert [line["runs"] for line in table] == ["200", "200", ""]
    assert [line["runs_failed"] for line in table] == ["0", "3", ""]
    assert (simulated.is_simulated, swept.is_simulated) == (True, False)


@pytest.mark.slow
def test_an_error_of_the_arm_is_varied_like_any_field():
    (row,) = sweep_field(PROBLEM, "robustness.mass", [0.02], options=FAST).rows
    robust = plan(load_problem(PROBLEM, changes={"robustness.mass": 0.02}), FAST.shortest)
    assert row.duration == robust.duration
    assert row.verdict == robust.survival.verdict
    assert row.duration > row.shortest_duration


def test_the_objective_counts_only_where_it_is_varied():
    slacks = sweep_field(PROBLEM, "objective.slack", [0, 0.05], options=FAST)
    tight, loose = slacks.rows
    assert slacks.varies_objective
    assert tight.duration == tight.shortest_duration == loose.shortest_duration
    assert tight.duration < loose.duration <= 1.05 * tight.duration * (1 + 1e-9)
    other = {"objective.slack": 0.05}
    (row,) = sweep_field(PROBLEM, "tube.radius", [0.03], changes=other, options=FAST).rows
    assert row.duration == tight.duration
    given = PlanOptions(quality="fast", slack=0.05)
    (row,) = sweep_field(PROBLEM, "tube.radius", [0.03], options=given).rows
    assert row.duration == loose.duration


def test_changes_of_other_fields_are_made_first():
    whole = {"robot.payload": {"mass": 1.0, "com": [0.1, 0, 0]}}
    (row,) = sweep_field(PROBLEM, "robot.payload.mass", ["x3"], changes=whole, options=STOPS).rows
    payload = {"robot.payload": {"mass": 3.0, "com": [0.1, 0, 0]}}
    assert row.duration == plan(load_problem(PROBLEM, changes=payload), STOPS).duration


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("nowhere.yaml", "tube.radius", [1]), ProblemError, "nowhere.yaml does not exist"),
        ((PROBLEM, "tube.raduis", [1]), ProblemError, "unknown key 'raduis'"),
        ((PROBLEM, "robot.tool_frame", ["hand", "x2"]), ProblemError, "x2 has no number to scale"),
        ((PROBLEM, "tube.radius", []), OptionError, "tube.radius: give at least one value"),
    ],
)
def test_what_concerns_all_values_is_refused_at_once(arguments, error, message):
    with pytest.raises(error, match=message):
        sweep_field(*arguments)


def test_a_field_has_one_master():
    with pytest.raises(OptionError, match=r"tube\.radius is both varied and changed"):
        sweep_field(PROBLEM, "tube.radius", [1], changes={"tube.radius": 2})
    with pytest.raises(OptionError, match=r"objective\.slack is varied and slack is given"):
        sweep_field(PROBLEM, "objective.slack", [1], options=PlanOptions(slack=0.1))


def test_progress_names_the_value():
    told = []
    sweep_field(PROBLEM, "tube.radius", [0.01, 0.03], options=STOPS, progress=told.append)
    assert told[0].startswith("value 1 of 2: loading")
    assert told[-1].startswith("value 2 of 2: ")


def test_ctrl_c_keeps_the_rows_that_are_done():
    def interrupt(what):
        if str(what).startswith(f"value {number}"):
            raise KeyboardInterrupt

    number = 2
    arguments = (PROBLEM, "tube.radius", [0.03, 0.05])
    result = sweep_field(*arguments, options=STOPS, progress=interrupt)
    assert [row.value for row in result.rows] == [0.03]
    assert result.as_dict()["stopped_by"] == "interrupt"
    number = 1
    with pytest.raises(KeyboardInterrupt):
        sweep_field(*arguments, options=STOPS, progress=interrupt)
