"""compare: one problem by every method and baseline; smoothness, use of motors and tube."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from cases import ANGLE, PEAK_JERK, quintic
from stored_trajectories import STOP

from tubeplanner import JointTrajectory, OptionError, PlanOptions, Tube, compare, load_problem, plan
from tubeplanner.first_guess.baselines import BASELINES, judged_baseline
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.output.figures import figure_files
from tubeplanner.planning.options import METHODS
from tubeplanner.studies import comparison as module
from tubeplanner.studies import rows
from tubeplanner.studies.comparison import smoothness_class, trajectory_measures
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.trajectory.reader import read_trajectory

PROBLEM, LINE = "example:two_link/paper_5_50mm", "example:two_link/paper_1_30mm"
KEYS = (
    *("method", "kind", "status", "certified", "answered_by", "duration", "planning_time"),
    *("failures", "smoothness", "peak_jerk", "peak_jerk_joint", "at_limit", "tube_use", "in_band"),
    "message",
)


def push(*rows, widths):
    """Return the trajectory of the slider with some accelerations, one after the other."""
    velocity = position = 0.0
    columns = []
    for acceleration, width in zip(rows, widths, strict=True):
        columns.append((acceleration / 2, velocity, position))
        position += velocity * width + acceleration / 2 * width**2
        velocity += acceleration * width
    times = np.concatenate([[0.0], np.cumsum(widths)])
    return JointTrajectory(["slide"], times, np.array(columns).T[:, :, None])


def test_smoothness_counts_what_does_not_jump():
    smooth = quintic()
    assert smoothness_class(smooth) == "C2"
    assert smoothness_class(smooth.between(0.0, 0.5)) == "C0"  # does not end at rest
    assert smoothness_class(push(5.0, -5.0, widths=(0.2, 0.2))) == "C1"
    away = JointTrajectory(["turn"], [0, 1], smooth.coefficients + np.eye(6)[5][:, None, None])
    assert smoothness_class(concatenate([smooth, away.scaled(2.0)])) == "none"


def test_the_peak_of_the_jerk_is_exact(slider):
    measures = trajectory_measures(slider, quintic(duration=2.0, joint="slide"))
    assert measures.peak_jerk == pytest.approx(PEAK_JERK * ANGLE / 8, rel=1e-9)
    assert measures.peak_jerk_joint == "slide"


def test_shares_of_time_at_limits(slider):
    """At 5 m/s^2 the force is at its limit, at 4.94 below 99 % of it."""
    full = trajectory_measures(slider, push(5.0, -5.0, widths=(0.3, 0.3)))
    assert (full.at_limit, full.smoothness, full.peak_jerk) == (1.0, "C1", None)
    half = trajectory_measures(slider, push(5.0, -4.94, -5.06, widths=(0.3, 0.15, 0.15)))
    assert half.at_limit == pytest.approx(0.75, abs=1e-3)
    idle = trajectory_measures(slider, push(4.9, -4.9, widths=(0.3, 0.3)))
    assert idle.at_limit == 0.0


def test_a_tool_beside_the_axis_uses_its_share_of_the_tube_averaged_over_time(slider):
    points, trajectory = [[0, 0.03, 0], [0.6, 0.03, 0]], push(5.0, -5.0, widths=(0.3, 0.3))
    for tool_radius, expected in ((0.0, 0.3), (0.04, 0.5)):
        beside = slider.with_tube(Tube(points, 0.1, tool_radius=tool_radius))
        use = trajectory_measures(beside, trajectory).tube_use
        assert use == pytest.approx(expected, abs=1e-12)
    # At rest half of the time on the axis, then the axis ends and the tool goes on at 1 m/s.
    short = slider.with_tube(Tube([[-0.5, 0, 0], [0.0, 0, 0]], 0.1))
    trajectory = JointTrajectory(["slide"], [0, 0.1, 0.2], [[[0], [1.0]], [[0], [0]]])
    assert trajectory_measures(short, trajectory).tube_use == pytest.approx(0.25, abs=1e-9)


@pytest.fixture(scope="module")
def compared(shared):
    """All methods; what stops at corners stands for the searching methods."""

    def quick(problem, options, progress):
        searches = options.method in ("branch-and-bound", "suh-bishop")
        return plan(problem, replace(options, method=STOP) if searches else options, progress)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows, "plan_task", quick)
        problem, options = load_problem(PROBLEM), PlanOptions(quality="fast")
        return shared("comparison.of_all", lambda: compare(problem, options=options))


@pytest.mark.dear("plans by every method")
def test_every_method_and_baseline_has_its_row(compared):
    assert [row.method for row in compared.rows] == [*METHODS, *BASELINES]
    assert compared.succeeded
    for row in compared.rows:
        assert tuple(row.as_dict()) == KEYS
        assert row.certified == row.certificate.passed
        assert (row.measures.peak_jerk is None) == (row.measures.smoothness != "C2")
    by_name = {row.method: row for row in compared.rows}
    assert min(by_name.values(), key=lambda row: row.duration).method == "refinement"
    assert set(by_name["bang-bang"].failures) == {"rest", "continuity"}
    switching = by_name["bang-bang"].measures
    assert switching.at_limit > 0.9
    assert (switching.smoothness, switching.tube_use < 1e-4) == ("C1", True)
    assert 0.05 < by_name["arc-corners"].measures.tube_use < by_name["refinement"].measures.tube_use
    for row, fields in zip(compared.rows, csv.DictReader(compared.csv().splitlines()), strict=True):
        assert (tuple(fields), float(fields["duration"])) == (KEYS, row.duration)
        assert fields["failures"].count("=") == len(row.failures)
    assert json.loads(json.dumps(compared.as_dict(), allow_nan=False))["problem"].endswith("50mm")


def test_one_that_fails_never_stops_the_others(slider, monkeypatch):
    def broken(problem, name, progress=None):
        if name == "conventional":
            raise Infeasible(PlanStatus.UNREACHABLE, "no way", Location())
        if name == "bang-bang":
            raise ZeroDivisionError("by zero")
        return judged_baseline(problem, name, progress)

    monkeypatch.setattr(module, "judged_baseline", broken)
    names = ["conventional", "bang-bang", "smoothed-bang-bang", "conventional"]
    rows = compare(slider, names).rows
    assert [row.method for row in rows] == names[:3]
    assert [str(row.status) for row in rows] == ["unreachable", "no_trajectory", "success"]
    assert rows[0].message == "no way"
    assert rows[1].message == "internal error, ZeroDivisionError: by zero"
    assert rows[0].as_dict()["duration"] is rows[0].as_dict()["smoothness"] is None
    assert not compare(slider, names[:2]).succeeded


def test_ctrl_c_keeps_the_rows_that_are_done_or_ends_the_comparison(slider):
    def interrupt(what):
        if what.stage.startswith("bang-bang"):
            raise KeyboardInterrupt

    result = compare(slider, ["conventional", "bang-bang"], progress=interrupt)
    assert [row.method for row in result.rows] == ["conventional"]
    assert result.as_dict()["stopped_by"] == "interrupt"
    with pytest.raises(KeyboardInterrupt):
        compare(slider, ["bang-bang"], progress=interrupt)


def test_a_wrong_name_lists_those_there_are(slider):
    with pytest.raises(OptionError, match=r"unknown method 'bang' \(did you mean .*refinement"):
        compare(slider, ["bang"])
    with pytest.raises(OptionError, match="give at least one method"):
        compare(slider, [])


@pytest.mark.dear("plans by three methods and checks two files")
def test_the_command_prints_writes_and_draws(run, tmp_path, monkeypatch):
    monkeypatch.setattr(figure_files, "figure_file", lambda figure, path: b"a figure")
    table, figure, folder = tmp_path / "c.csv", tmp_path / "c.png", tmp_path / "trajectories"
    methods = "stop-at-corners,bang-bang,smoothed-bang-bang"
    files = ("-o", table, "--plot", figure, "--trajectories", folder)
    status, out, err = run("compare", LINE, "--methods", methods, *files)
    assert (status, err) == (0, "")
    for words in ("passes", "FAILS: rest", "continuity", "C1", "unbounded", table, figure):
        assert str(words) in out
    assert "bang-bang: slowed by" in out
    assert len(table.read_text().splitlines()) == 4
    assert sorted(path.stem for path in folder.iterdir()) == sorted(methods.split(","))
    fields = json.loads((folder / "bang-bang.json").read_text())
    assert (fields["method"], fields["certified"]) == ("bang-bang", False)
    assert set(fields["failures"]) == {"rest", "continuity"}
    smooth = folder / "smoothed-bang-bang.json"
    assert f"{read_trajectory(smooth).duration:.4f} s" in out
    assert run("check", LINE, smooth)[0] == 0
    assert run("check", LINE, folder / "bang-bang.json")[0] == 1


def test_the_command_as_json_and_its_exit_status(run, tmp_path):
    path = tmp_path / "c.json"
    status, out, _ = run("compare", LINE, "--methods", "bang-bang", "-o", path, "--json")
    fields = json.loads(out)
    assert (status, fields["status"]) == (1, "no_trajectory")
    assert fields["message"] == "0 of 1 certified"
    assert fields["bound"]["reason"] == "nothing is known"  # only efforts are limited
    (row,) = fields["rows"]
    assert tuple(row) == KEYS
    assert row["failures"]["rest"]["unit"] == "relative"
    assert fields["rows"] == json.loads(path.read_text())["rows"]
