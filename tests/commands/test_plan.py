"""`tubeplanner plan` of whole cycles."""

import csv
import json

import pytest
import yaml
from small_cycle import SMALL

FAST = ("--quality", "fast", "--slack", "0")


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def test_a_cycle_is_planned_told_and_written(run, path):
    outputs = {option: path.with_name(f"t.{end}") for option, end in OUTPUTS.items()}
    given = [word for pair in outputs.items() for word in pair]
    status, text, _ = run("plan", path, *FAST, "--rate", "100", *given)
    assert status == 0
    assert text.splitlines()[0].endswith("/small: two_link, 2 joints to hand")
    for row in ("over", "at rest: gripper 'close' (0.05 s), attach part", "with down"):
        assert row in text
    assert "success: certified cycle of 1." in text
    assert "10 % more would save, over the cycle: effort of joint2: " in text
    assert all(file.stat().st_size > 1000 for file in outputs.values())
    assert len(list(yaml.safe_load_all(outputs["--ros"].read_text()))) == 3
    rows = list(csv.reader(outputs["--csv"].read_text().splitlines()))
    assert float(rows[2][0]) == pytest.approx(0.01)
    status, text, _ = run("check", path, outputs["-o"])
    assert status == 0
    assert text.rstrip().endswith("passes every condition.")


OUTPUTS = {"-o": "json", "--csv": "csv", "--ros": "yaml", "--plot": "png", "--html": "html"}


def test_the_object_has_moves_marks_and_prices(run, path):
    change = ("--set", "moves.back.tube.radius=0.2")
    status, text, _ = run("plan", path, *FAST, *change, "--json")
    answer = json.loads(text)
    assert (status, answer["status"]) == (0, "success")
    assert [move["name"] for move in answer["moves"]] == ["over", "down", "beside", "back"]
    assert answer["moves"][-1]["end"] == pytest.approx(answer["duration"] - 0.1)
    assert answer["marks"][2] == {"time": answer["moves"][1]["begin"], "attach": "part"}
    assert answer["duration"] <= answer["greedy_duration"] + 1e-9
    assert answer["certificate"]["moves"]["beside"]["conditions"]["tube"]["satisfied"]
    assert "closed" in answer["certificate"]["seams"]
    assert answer["tool_speed"]["value"] > 0.5
    assert answer["loading_time"] > 0
    assert {each["move"] for each in answer["sensitivities"] if each["segment"] is not None}


def test_a_blocked_move_is_told_and_nothing_is_written(run, path):
    blocks = ("--set", "moves.beside.tube.joint_signs.joint2='+'")
    output = path.with_name("t.json")
    status, text, _ = run("plan", path, *FAST, *blocks, "-o", output)
    assert status == 1
    assert "unreachable: moves 2 to 3 of 4, 'down', 'beside'" in text
    assert text.splitlines()[-1].startswith(
        "where: joint2, move 'down', segment 0, point 1, tool at ["
    )
    assert not output.exists()
    status, text, _ = run("plan", path, *FAST, *blocks, "--json")
    answer = json.loads(text)
    assert (status, answer["where"]["move"], answer["where"]["segment"]) == (1, "down", 0)
    assert answer["certificate"] is None
    assert answer["moves"] == []


def test_the_least_time_of_one_path_is_not_asked_of_a_cycle(run, path):
    status, _, said = run("plan", path, "--time-left")
    assert status == 2
    assert "--time-left is about the path of one motion" in said


@pytest.mark.parametrize(
    "words",
    [("measure",), ("links",), ("sweep", "--radius", "0.1"), ("compare",), ("route",)],
    ids=" ".join,
)
def test_what_takes_problems_alone_refuses_a_cycle(run, path, words):
    status, _, said = run(words[0], path, *words[1:])
    assert status == 2
    assert "this is a cycle, where one problem is needed; plan, check, info" in said


def test_an_unknown_move_is_refused_and_those_there_are_listed(run, path):
    status, _, said = run("plan", path, "--set", "moves.bak.tube.radius=0.1")
    assert status == 2
    assert "unknown name 'bak' (did you mean 'back'?); there is: over, down, beside, back" in said


def test_schema_and_names(run):
    _, text, _ = run("schema", "--cycle")
    assert json.loads(text)["title"] == "tubeplanner cycle"
    _, text, _ = run("robots", "--json")
    answer = json.loads(text)
    assert set(answer["cycles"]) & set(answer["problems"]) == set()
