"""`tubeplanner plan` of whole cycles."""

import csv

import pytest
import yaml

from tubeplanner.cli import plan as planned

FAST = ("--quality", "fast", "--slack", "0")
OUTPUTS = {"-o": "json", "--csv": "csv", "--ros": "yaml", "--plot": "png", "--html": "html"}


@pytest.fixture
def answered(small_plan, monkeypatch):
    """The small cycle is planned already."""
    monkeypatch.setattr(planned, "plan_cycle", lambda *_: small_plan)


@pytest.mark.dear("makes a figure and a page of a cycle")
def test_a_cycle_is_told_and_written(run, answered, cycle_path):
    outputs = {option: cycle_path.with_name(f"t.{end}") for option, end in OUTPUTS.items()}
    words = [word for pair in outputs.items() for word in pair]
    status, text, _ = run("plan", cycle_path, *FAST, "--rate", "100", *words)
    assert status == 0
    assert text.splitlines()[0].endswith("/small: two_link, 2 joints to hand")
    for row in ("over", "at rest: gripper 'close' (0.05 s), attach part", "with down"):
        assert row in text
    assert "success: certified cycle of 1." in text
    assert "raising a limit by 10 % would save, over the cycle: effort of joint2: " in text
    assert all(file.stat().st_size > 1000 for file in outputs.values())
    assert len(list(yaml.safe_load_all(outputs["--ros"].read_text()))) == 3
    rows = list(csv.reader(outputs["--csv"].read_text().splitlines()))
    assert float(rows[2][0]) == pytest.approx(0.01)


@pytest.mark.slow  # plans a cycle
def test_a_changed_cycle_is_planned_and_its_file_passes_check(run_json, cycle_path):
    change, path = ("--set", "moves.back.tube.radius=0.2"), cycle_path.with_name("t.json")
    status, answer = run_json("plan", cycle_path, *FAST, *change, "-o", path)
    assert (status, answer["duration"] <= answer["greedy_duration"] + 1e-9) == (0, True)
    assert run_json("check", cycle_path, path, *change)[0] == 0


def test_the_object_has_moves_marks_and_prices(run_json, answered, cycle_path):
    status, answer = run_json("plan", cycle_path, *FAST, "--time-left")
    assert (status, answer["status"]) == (0, "success")
    assert 0.5 * answer["duration"] < answer["path_minimum"] <= answer["duration"]
    assert [move["name"] for move in answer["moves"]] == ["over", "down", "beside", "back"]
    assert answer["moves"][-1]["end"] == pytest.approx(answer["duration"] - 0.1)
    assert answer["marks"][2] == {"time": answer["moves"][1]["begin"], "attach": "part"}
    assert answer["certificate"]["moves"]["beside"]["conditions"]["tube"]["satisfied"]
    assert "closed" in answer["certificate"]["seams"]
    assert answer["tool_speed"]["value"] > 0.5
    assert answer["loading_time"] > 0
    assert {each["move"] for each in answer["sensitivities"] if each["segment"] is not None}


@pytest.mark.dear("plans a cycle up to its second leg")
def test_a_blocked_move_is_told_and_nothing_is_written(run, run_json, cycle_path, monkeypatch):
    results = []

    def once(*arguments, plan_cycle=planned.plan_cycle):
        results[:] = results or [plan_cycle(*arguments)]
        return results[0]

    monkeypatch.setattr(planned, "plan_cycle", once)
    blocks = ("--set", "moves.beside.tube.joint_signs.joint2='+'")
    output = cycle_path.with_name("t.json")
    status, text, _ = run("plan", cycle_path, *FAST, *blocks, "-o", output)
    assert status == 1
    assert "unreachable: moves 2 to 3 of 4, 'down', 'beside'" in text
    assert text.splitlines()[-1].startswith(
        "where: joint2, move 'down', segment 0, point 1, tool at ["
    )
    assert not output.exists()
    status, answer = run_json("plan", cycle_path, *FAST, *blocks)
    assert (status, answer["where"]["move"], answer["where"]["segment"]) == (1, "down", 0)
    assert (answer["certificate"], answer["moves"]) == (None, [])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("plan", "--set", "moves.bak.tube.radius=0.1"),
            "unknown name 'bak' (did you mean 'back'?); there is: over, down, beside, back",
        ),
        *(
            ((command,), "this is a cycle, where one problem is needed; plan, check, info")
            for command in ("measure", "links", "compare", "route")
        ),
    ],
)
def test_what_is_not_for_a_cycle_is_refused(run, cycle_path, words, message):
    status, _, error = run(words[0], cycle_path, *words[1:])
    assert status == 2
    assert message in error
