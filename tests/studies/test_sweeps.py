"""Sweeps: duration against tolerance, or against any field of a file."""

import csv
import io
import json
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from cases import SHORTEST, simulated_sweep
from small_cycle import SMALL, planned_cycle
from studied import Here

from tubeplanner import (
    OptionError,
    PlanningProblem,
    PlanOptions,
    Seed,
    Tube,
    load_problem,
    plan,
    sweep,
    sweep_field,
    verify,
)
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.planning.result import refused_result
from tubeplanner.studies import rows

PROBLEM = "example:two_link/paper_1_30mm"
FAST = PlanOptions(quality="fast")
STOPS = PlanOptions("stop-at-corners")


@pytest.fixture(scope="module")
def swept(bundled):
    return sweep(bundled("two_link/paper_1_30mm"), [0.03, 0.01, 0.02, 0.01])


def test_rows_come_sorted_once_each_and_are_what_plan_answers(swept, bundled):
    assert [row.value for row in swept.rows] == [0.01, 0.02, 0.03]
    alone = plan(bundled("two_link/paper_1_30mm"), SHORTEST)
    assert swept.rows[2].duration == alone.duration
    for row in swept.rows:
        assert row.result.certificate.passed
        assert (row.problem.tube.radius == row.value).all()


def test_what_is_gained_lies_between_the_slopes_at_both_ends(swept):
    rows = swept.rows
    for near, far in pairwise(rows):
        gained = (far.duration - near.duration) / (far.value - near.value)
        assert 1.1 * near.slope < gained < 0.9 * far.slope < 0


def test_scales_keep_the_segments_apart(bundled):
    problem = bundled("two_link/around_a_post")
    (row,) = sweep(problem, scales=[0.5], options=STOPS).rows
    np.testing.assert_allclose(row.problem.tube.radius, problem.tube.radius / 2)
    assert row.problem.tube.joint_ranges == problem.tube.joint_ranges
    assert row.problem.collision is problem.collision


def test_a_tolerance_that_cannot_be_posed_or_planned_has_its_reason(two_link):
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0]]
    tube = Tube(points, 0.05, tool_radius=0.02)
    problem = PlanningProblem(two_link, tube, np.array([-0.118, -1.0]))
    off = float(tube.distance(two_link.tool_position(problem.start[None]))[0, 0])
    assert 0.001 < off < 0.03
    result = sweep(problem, [0.01, 0.02 + off / 2, 0.05])
    thin, outside, _ = result.rows
    assert "tool_radius 0.02 m" in thin.message
    assert "start: the tool is at" in outside.message
    assert [str(row.status) for row in result.rows] == ["bad_input", "bad_input", "success"]
    assert (thin.duration, thin.slope, result.succeeded) == (None, None, True)
    assert not sweep(problem, [0.01]).succeeded


def table_of(result):
    """Return the rows of the CSV, and the object that is written as JSON."""
    table = list(csv.DictReader(io.StringIO(result.csv())))
    return table, json.loads(json.dumps(result.as_dict(), allow_nan=False))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either radii or scales"),
        ({"radii": []}, "radius: give at least one number"),
        ({"radii": [0.1, -1]}, "radius is -1; it must be > 0"),
        ({"scales": [float("inf")]}, "radius_scale is inf"),
    ],
)
def test_what_cannot_be_swept_is_refused_by_name(arguments, message, bundled):
    with pytest.raises(OptionError, match=message):
        sweep(bundled("two_link/paper_1_30mm"), **arguments)


@pytest.fixture
def slow_when_wide(monkeypatch):
    """Plans of radii above 15 mm stop at corners, or find nothing above 35 mm."""

    def planned(problem, options, progress):
        radius = problem.tube.radius[0]
        if radius > 0.035:
            return refused_result(Infeasible(PlanStatus.NO_TRAJECTORY, "none", Location()), "m")
        return plan(problem, STOPS if radius > 0.015 else options, progress)

    monkeypatch.setattr(rows, "plan_task", planned)


@pytest.mark.parametrize("executor", [None, Here()])
def test_a_wider_tube_has_the_faster_motion_of_the_narrower(slow_when_wide, bundled, executor):
    problem = bundled("two_link/paper_1_30mm")
    result = sweep(problem, [0.04, 0.01, 0.02, 0.03], options=FAST, executor=executor)
    narrow, *wider = result.rows
    slow = plan(wider[1].problem, STOPS).duration
    assert narrow.note is None
    assert wider[0].note.startswith("the motion of radius 0.01, which is faster than the ")
    assert f"than the {slow:.4f} s planned here" in wider[1].note
    assert wider[2].note.endswith("faster than none, but no_trajectory, planned here")
    for row in wider:
        assert row.duration == narrow.duration
        assert row.result.certificate.passed
        assert verify(row.problem, row.result.trajectory).passed
        assert (row.elasticity, row.slope, row.result.notes[-1]) == (None, None, row.note)
    slacked = sweep(problem, [0.01, 0.02], options=replace(FAST, slack=0.01)).rows
    assert slacked[1].note is None


def test_a_value_has_the_faster_motion_of_a_neighbour_if_it_passes_there(slow_when_wide):
    radii = sweep_field(PROBLEM, "tube.radius", [0.03, 0.02, 0.01, 0.005], options=FAST).rows
    assert radii[0].duration == radii[1].duration == radii[2].duration < radii[3].duration
    assert [row.notes[-1].startswith("the motion of tube.radius 0.01") for row in radii] == [
        *(True, True, False, False),
    ]


@pytest.mark.dear("plans a cycle twice")
def test_a_field_of_a_cycle_is_varied_too(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    result = sweep_field(path, "robot.limits.scale.effort", [1, 0.9, -1], options=FAST)
    strong, weak, none = result.rows
    assert strong.duration == planned_cycle().duration < weak.duration
    assert "effort" in none.message
    assert [row["status"] for row in result.as_dict()["rows"]] == [
        "success",
        "success",
        "bad_input",
    ]
    assert (strong.runs, strong.method) == (None, "refinement")


def boxed(two_link, tool_radius=0.0):
    """Return the two-link arm in a disc of 30 mm and a box of 60 x 100 mm, tool excluded."""
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    sides = [0.06 + 2 * tool_radius, 0.1 + 2 * tool_radius]
    sections = [None, {"box": sides, "up": [0, 0, 1]}]
    radii = [0.03 + tool_radius, None]
    tube = Tube(points, radii, cross_section=sections, tool_radius=tool_radius)
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])))


def test_factors_scale_boxes_too_and_slopes_count_their_sides(two_link):
    rows = sweep(boxed(two_link), scales=[1.0, 1.1]).rows
    np.testing.assert_allclose(rows[1].problem.tube.cross_section[1, :2], [0.066, 0.11])
    np.testing.assert_allclose(rows[1].problem.tube.radius, [0.033, 0.033])
    gained = (rows[1].duration - rows[0].duration) / 0.1
    assert 1.1 * rows[0].slope < gained < 0.9 * rows[1].slope < 0
    prices = {p.limit: p for p in rows[0].result.sensitivities if p.segment == 1}
    assert prices["width"].elasticity < -0.01
    own = [p.elasticity for p in rows[0].result.sensitivities if p.segment is not None]
    assert rows[0].elasticity == pytest.approx(sum(own))
    row = sweep(boxed(two_link, tool_radius=0.01), scales=[1.0]).rows[0]
    whole = {"radius": 0.04 / 0.03, "width": 0.04 / 0.03, "height": 0.06 / 0.05}
    prices = [p for p in row.result.sensitivities if p.segment is not None]
    expected = sum(whole[p.limit] * p.elasticity for p in prices)
    assert row.elasticity == pytest.approx(expected)
    assert row.elasticity < 1.1 * sum(p.elasticity for p in prices) < 0
    with pytest.raises(ProblemError, match=r"1 has a box, which .*radii; sweep over factors"):
        sweep(boxed(two_link), [0.02, 0.03])


@pytest.fixture(scope="module")
def field_swept():
    values = [0.03, "x0.5", -1, [0.02], {"a": 1}, float("inf")]
    return sweep_field(PROBLEM, "tube.radius", values, options=STOPS)


def test_rows_are_what_plan_answers_in_the_order_given(field_swept):
    assert [row.value for row in field_swept.rows[:2]] == [0.03, "x0.5"]
    radii = sweep(load_problem(PROBLEM), [0.015, 0.03], options=STOPS)
    durations = [row.duration for row in field_swept.rows]
    assert durations[:2] == [row.duration for row in radii.rows[::-1]]
    assert durations[3] is not None
    assert all(row.result.certificate.passed for row in field_swept.rows[:2])
    assert field_swept.succeeded
    assert not field_swept.varies_objective
    negative = field_swept.rows[2]
    assert negative.message.startswith("tube.radius[0] is -1 m")
    assert (negative.duration, negative.shortest_duration, negative.notes) == (None, None, ())


def test_csv_and_json_say_the_same_of_any_field(field_swept):
    table, fields = table_of(field_swept)
    assert (fields["problem"], fields["quantity"]) == ("two_link/paper_1_30mm", "tube.radius")
    assert [row["value"] for row in fields["rows"]] == [0.03, "x0.5", -1, [0.02], {"a": 1}, ".inf"]
    written = [line["tube.radius"] for line in table]
    assert written == ["0.03", "x0.5", "-1", "[0.02]", '{"a": 1}', ".inf"]
    for line, row in zip(table, fields["rows"], strict=True):
        for key in ("duration", "shortest_duration", "planning_time", "loading_time"):
            assert (float(line[key]) if line[key] else None) == row[key]
        assert (line["message"], line["notes"]) == (row["message"], "; ".join(row["notes"]))


def test_csv_and_json_say_the_same_of_radii(swept):
    table, fields = table_of(swept)
    assert (fields["quantity"], len(table), len(fields["rows"])) == ("radius", 3, 3)
    assert [float(line["radius"]) for line in table] == [row["value"] for row in fields["rows"]]
    assert [float(line["slope"]) for line in table] == [row["slope"] for row in fields["rows"]]
    assert table[0]["radii"].split() == [str(radius) for radius in fields["rows"][0]["radii"]]


def test_rows_say_how_many_runs_failed(field_swept):
    simulated = simulated_sweep([0, 3, None])
    table, fields = table_of(simulated)
    seen = [(row["runs"], row["runs_failed"]) for row in fields["rows"]]
    assert seen == [(200, 0), (200, 3), (None, None)]
    written = [(line["runs"], line["runs_failed"]) for line in table]
    assert written == [("200", "0"), ("200", "3"), ("", "")]
    assert (simulated.is_simulated, field_swept.is_simulated) == (True, False)


@pytest.mark.slow  # plans motions that survive errors of the arm, twice
@pytest.mark.study
def test_an_error_of_the_arm_is_varied_like_any_field():
    (row,) = sweep_field(PROBLEM, "robustness.mass", [0.02], options=FAST).rows
    robust = plan(load_problem(PROBLEM, changes={"robustness.mass": 0.02}), FAST.shortest)
    assert row.duration == robust.duration
    assert row.verdict == robust.survival.verdict
    assert row.duration > row.shortest_duration


@pytest.mark.dear("smooths motions")
def test_the_objective_counts_only_where_it_is_varied():
    slacks = sweep_field(PROBLEM, "objective.slack", [0, 0.05], options=FAST)
    tight, loose = slacks.rows
    assert slacks.varies_objective
    assert tight.duration == tight.shortest_duration == loose.shortest_duration
    assert tight.duration < loose.duration <= 1.05 * tight.duration * (1 + 1e-9)
    for others, expected in (
        ({"changes": {"objective.slack": 0.05}, "options": FAST}, tight),
        ({"options": PlanOptions(quality="fast", slack=0.05)}, loose),
    ):
        (row,) = sweep_field(PROBLEM, "tube.radius", [0.03], **others).rows
        assert row.duration == expected.duration


def test_changes_of_other_fields_are_made_first():
    whole = {"robot.payload": {"mass": 1.0, "com": [0.1, 0, 0]}}
    (row,) = sweep_field(PROBLEM, "robot.payload.mass", ["x3"], changes=whole, options=STOPS).rows
    payload = {"robot.payload": {"mass": 3.0, "com": [0.1, 0, 0]}}
    assert row.duration == plan(load_problem(PROBLEM, changes=payload), STOPS).duration


@pytest.mark.parametrize(
    ("path", "values", "message"),
    [
        ("robot.tool_frame", ["hand", "x2"], "x2 has no number to scale"),
        ("tube.radius", [], "tube.radius: give at least one value"),
    ],
)
def test_what_concerns_all_values_is_refused_at_once(path, values, message):
    with pytest.raises((ProblemError, OptionError), match=message):
        sweep_field(PROBLEM, path, values)


@pytest.mark.parametrize(
    ("swept_over", "first", "name"),
    [
        (lambda values, **others: sweep(load_problem(PROBLEM), values, **others), "", "tolerances"),
        (partial(sweep_field, PROBLEM, "tube.radius"), "loading", "values"),
    ],
    ids=["radii", "field"],
)
def test_ctrl_c_keeps_what_is_done_and_progress_has_the_stage(swept_over, first, name):
    told = []

    def interrupt(progress):
        told.append(progress)
        if progress.done == done and progress.stage:
            raise KeyboardInterrupt

    done = 1
    result = swept_over([0.03, 0.05], options=STOPS, progress=interrupt)
    assert [row.value for row in result.rows] == [0.03]
    assert result.as_dict()["stopped_by"] == "interrupt"
    assert str(told[0]) == f"0 of 2 {name}"
    assert str(told[1]).startswith(f"0 of 2 {name}; {first}")
    done = 0
    with pytest.raises(KeyboardInterrupt):
        swept_over([0.03, 0.05], options=STOPS, progress=interrupt)
