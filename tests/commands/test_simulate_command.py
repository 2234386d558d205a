"""`tubeplanner simulate` says what was seen in some runs."""

import json

import pytest

from stored_trajectories import REFINEMENT, stored_path
from tubeplanner import OutputError

NAME = "two_link/around_a_post"
CASE = (f"example:{NAME}", str(stored_path(NAME, REFINEMENT)))


def test_what_was_seen_is_printed_with_when_and_where(run):
    status, text, _ = run("simulate", *CASE, "--runs", "2")
    assert status == 0
    assert "seen in 2 runs" in text
    assert "beyond the tube [m]" in text
    assert "left the tube" in text


def test_the_same_as_json_and_for_the_same_seed(run):
    words = ("simulate", *CASE, "--runs", "3", "--seed", "4", "--json")
    report, again = (json.loads(run(*words)[1]) for _ in range(2))
    assert report["seen"] == again["seen"]
    assert (report["status"], report["verdict"]["runs"]) == ("success", 3)
    assert report["seen"]["tube"]["worst"]["value"] == max(report["excursions"])
    assert report["seen"]["rotation"] is None
    assert report["verdict"]["broken"]["tube"] == sum(value > 0 for value in report["excursions"])


def test_errors_are_those_that_are_given(run):
    exact = ["mass", "com", "payload", "unmodelled-friction", "lag", "delay", "noise", "tool"]
    words = [word for name in exact for word in (f"--{name}", "0")]
    shifted = ("simulate", *CASE, "--runs", "4", "--base", "0.02", *words, "--json")
    seen = json.loads(run(*shifted)[1])["seen"]
    assert seen["tracking"]["worst"]["value"] < 1e-3
    assert 0.005 < seen["tool_tracking"]["worst"]["value"] < 0.021


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--mass", "2"], "robustness.mass is 2; give a number from 0 to 0.9"),
        (["--controller", "lqr"], "unknown controller 'lqr'"),
        (["--runs", "0"], "runs is 0"),
    ],
)
def test_what_makes_no_sense_is_refused(run, words, message):
    status, _, error = run("simulate", *CASE, *words)
    assert status == 2
    assert message in error


def test_figure_and_page_are_written_and_named(run, tmp_path):
    figure, page = tmp_path / "runs.png", tmp_path / "runs.html"
    words = ("simulate", *CASE, "--runs", "2", "--plot", figure, "--html", page)
    status, text, _ = run(*words)
    assert status == 0
    assert text.endswith(f"plot: {figure}\nview: {page}\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Executed paths of the tool: 2 runs" in page.read_text()
    report = json.loads(run(*words[:-2], "--json")[1])
    assert (report["plot"], report["html"]) == (str(figure), None)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--plot", "runs.jpg"], "--plot runs.jpg: name a file that ends in .png"),
        (["--html", "runs.png"], "--html runs.png: a page is written"),
        (["--plot", "nowhere/runs.png"], "nowhere does not exist"),
        (["--plot", "runs.png", "--html", "nowhere/runs.html"], "nowhere does not exist"),
    ],
)
def test_files_that_could_not_be_written_are_refused_before_any_work(
    run, tmp_path, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    missing = ("simulate", "example:no/such", "no.json")  # else that would be the message
    status, _, error = run(*missing, *words)
    assert status == 2
    assert message in error
    assert list(tmp_path.iterdir()) == []


def test_inputs_are_not_overwritten(run, tmp_path):
    trajectory = tmp_path / "motion.png"
    trajectory.write_bytes(stored_path(NAME, REFINEMENT).read_bytes())
    before = trajectory.read_bytes()
    status, _, error = run("simulate", f"example:{NAME}", trajectory, "--plot", trajectory)
    assert status == 2
    assert "is the same file as" in error
    assert trajectory.read_bytes() == before


def test_nothing_is_written_on_failure(run, tmp_path, monkeypatch):
    """Of two files that are asked for, the one that could be made neither."""

    def failing(*_, **__):
        raise OutputError("no page today")

    monkeypatch.setattr("tubeplanner.views.viewer.view", failing)
    files = ("--plot", tmp_path / "runs.png", "--html", tmp_path / "runs.html")
    status, text, error = run("simulate", *CASE, "--runs", "1", *files)
    assert (status, text) == (2, "")
    assert "no page today" in error
    assert list(tmp_path.iterdir()) == []
    other = stored_path("ur5/over_the_wall", REFINEMENT)
    assert run("simulate", CASE[0], other, *files)[0] == 2
    assert list(tmp_path.iterdir()) == []
