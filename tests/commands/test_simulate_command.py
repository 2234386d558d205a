"""`tubeplanner simulate` says what was seen in some runs."""

import json

import pytest

from stored_trajectories import REFINEMENT, stored_path

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
