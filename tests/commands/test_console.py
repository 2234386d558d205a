"""What reaches a terminal: one line, harmless and of bounded length."""

import json

import pytest

from tubeplanner.commands.console import printable

EVIL = "a\x1b[31mred\n\x9b31m FAKE: passes\u202e"


def trajectory(names):
    return {
        "format": "tubeplanner/trajectory",
        "version": 1,
        "joint_names": names,
        "breakpoints": [0, 1.0],
        "coefficients": [[[0.1, 0.2]]],
    }


def test_a_message_is_one_printable_line():
    assert printable("a 'b' \u00e4\u95a2") == "a 'b' \u00e4\u95a2"
    assert printable(EVIL) == "a\\x1b[31mred\\n\\x9b31m FAKE: passes\\u202e"
    assert len(printable("x" * 10**6)) < 6000


@pytest.mark.parametrize("as_json", [False, True])
def test_names_of_a_trajectory_cannot_speak_for_the_program(run, tmp_path, as_json):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(trajectory([EVIL, "b"])))
    arguments = ["check", "example:two_link/around_a_post", path]
    status, out, err = run(*arguments, *(["--json"] if as_json else []))
    assert status == 2
    text = json.loads(out)["message"] if as_json else err.removesuffix("\n")
    assert text.isprintable()
    assert "rename it" in text


@pytest.mark.parametrize("section", ["obstacles", "attached"])
def test_names_of_solids_cannot_speak_for_the_program(run, tmp_path, section):
    solids = [{"name": EVIL, "sphere": 0.1, "position": [0.45, 0, 0]}]
    robot = {"urdf": "example:two_link", "tool_frame": "hand"}
    fields = {
        "robot": {**robot, "attached": solids} if section == "attached" else robot,
        "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
        "start": {"seed": [0.0, -1.0]},
        "obstacles": solids if section == "obstacles" else [],
    }
    path = tmp_path / "p.json"
    path.write_text(json.dumps(fields))
    status, out, err = run("plan", path)
    assert (status, out) == (2, "")
    assert err.removesuffix("\n").isprintable()
    assert "the name of an obstacle is 'a\\x1b[31mred" in err


def test_a_key_of_a_megabyte_is_shown_short(run, tmp_path):
    path = tmp_path / "p.json"
    path.write_text(json.dumps({"x" * 10**6: 1}))
    status, _, err = run("plan", path)
    assert status == 2
    assert len(err) < 500 + len(str(path))


def test_an_answer_that_is_not_kept_says_what_keeps_it(run, tmp_path):
    problem, path = "example:two_link/around_a_post", tmp_path / "t.json"
    options = ["--method", "stop-at-corners"]
    _, out, _ = run("plan", problem, *options)
    assert out.splitlines()[-1] == (
        "nothing written; to keep the answer, give -o T.json or --csv or --ros or --plot or --html"
    )
    _, out, _ = run("plan", problem, *options, "-o", path)
    assert out.splitlines()[-1] == f"trajectory: {path}"
    assert "nothing written" not in out
    _, out, _ = run("sweep", problem, "--radius", "0.05", "--quality", "fast")
    assert out.endswith("give -o TABLE.csv or --plot\n")
