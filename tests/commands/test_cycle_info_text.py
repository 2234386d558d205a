"""`tubeplanner info` of cycles."""

import json

import pytest

from small_cycle import SMALL


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def rows(text):
    """Return the cells of the rows of all tables, by the first."""
    cells = ([cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines())
    return {row[0]: row[1:] for row in cells if row}


def test_moves_rests_and_what_is_carried_are_told(run, path):
    status, text, _ = run("info", path)
    assert status == 0
    assert "4 moves in 3 legs (each without a stop); ends where it begins" in text
    table = rows(text)
    assert table["beside"] == ["1", "0.35 m", "in any configuration", "0.5 kg, part"]
    assert table["back"] == ["1", "0.7906 m", "as the cycle begins", "nothing"]
    assert "at rest: gripper 'open' (0.06 s), detach part" in table


def test_an_open_cycle_ends_in_any_configuration(run, path):
    _, text, _ = run("info", path, "--set", "closed=false")
    assert rows(text)["back"][2] == "in any configuration"


def test_what_does_not_load_is_told_with_the_reason(run, path):
    status, text, _ = run("info", path, "--set", "period=0.004")
    assert status == 0
    assert text.rstrip().endswith("no multiple of the period, 0.004 s; give 0.048 or 0.052")
    answer = json.loads(run("info", path, "--set", "period=0.004", "--json")[1])
    assert answer["cycle"] is None
    assert "dwell is 0.05 s" in answer["refused"]
