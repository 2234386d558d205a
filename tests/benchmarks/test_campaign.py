"""The campaign: problems that are the same every time, and what counts as wrong and as stuck."""

import json

import pytest
import yaml

import campaign
import campaign_examine
import campaign_problems
from campaign_problems import build
from outside_judge import passes

# A two-link arm, and a random chain with a sliding joint and obstacles: quick to build.
QUICK, WITH_OBSTACLES = 2, 10


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return build(WITH_OBSTACLES, tmp_path_factory.mktemp("built"))


@pytest.mark.dear("builds a problem twice")
def test_a_seed_is_always_the_same_problem_and_its_witness_solves_it(built, tmp_path):
    again = build(WITH_OBSTACLES, tmp_path)
    assert again.path.read_text() == built.path.read_text()
    assert yaml.safe_load(built.path.read_text()) == built.fields
    assert passes(built.judge.judge(built.witness.trajectory, 500), 1e-9)


def test_the_other_way_round_twice_is_the_same(built):
    fields = built.fields | {"goal": {"joints": [0.0] * 4}}
    turned = campaign_problems.reversed_problem(fields)
    assert turned["start"] == fields["goal"]
    assert turned["tube"]["points"] == fields["tube"]["points"][::-1]
    assert campaign_problems.reversed_problem(turned) == fields


def test_narrower_is_all_the_same_but_for_the_radii(built):
    fields = built.fields
    narrower = campaign_examine.narrower_problem(fields)
    assert narrower["tube"]["radius"] == [0.9 * radius for radius in fields["tube"]["radius"]]
    assert narrower["tube"]["points"] == fields["tube"]["points"]


@pytest.mark.parametrize(
    "forwards, backwards, narrower, slow",
    [
        (1.0, 1.005, 1.05, []),
        (1.02, 1.0, 1.05, ["forwards"]),
        (1.02, 1.02, 1.0, ["forwards", "backwards"]),
        (1.0, None, None, ["backwards"]),
        (None, None, None, []),
    ],
)
def test_stuck_is_slower_than_the_best_by_a_hundredth(forwards, backwards, narrower, slow):
    pairs = {"forwards": forwards, "backwards": backwards, "narrower": narrower}
    assert campaign.stuck({"pairs": pairs}) == slow


@pytest.mark.parametrize(
    ("duration", "baseline", "slow"),
    [(1.0, 1.1, []), (1.2, 1.1, ["beside a baseline"]), (None, 1.1, ["beside a baseline"])],
)
def test_nor_may_a_baseline_be_faster(duration, baseline, slow):
    assert campaign.stuck({"duration": duration, "baseline": baseline}) == slow


def _line(seed, **more):
    return {"seed": seed, "arm": "ur5", "segments": 1, "scale": 0.01, "message": "", **more}


def marks(printed):
    """Return the rows of the table of marks by their names."""
    rows = [line.partition(" ") for line in printed.splitlines()]
    return {name: rest.strip() for name, _, rest in rows}


def test_what_is_wrong_is_listed_and_ends_with_status_1(tmp_path, monkeypatch, capsys):
    answers = [
        _line(0, status="success", judged=True, duration=1.0, planning_time=1.0),
        _line(1, status="success", judged=False, worst="tube", duration=1.0, planning_time=1.0),
        _line(2, status="tube_blocked"),
    ]
    monkeypatch.setattr(campaign, "examine", lambda seed, options: answers[seed])
    output = tmp_path / "lines.jsonl"
    monkeypatch.setattr("sys.argv", ["campaign.py", "--count", "3", "--output", str(output)])
    assert campaign.main() == 1
    printed = capsys.readouterr().out
    wrong = marks(printed)["wrong"].split()
    assert wrong == ["1", "of", "2", "solved", "0", "MISSED", "[seeds", "1]"]
    assert "2 of 3, 66.67%" in marks(printed)["solved"]
    assert "WRONG seed 1 (ur5" in printed
    assert len(output.read_text().splitlines()) == 3


def test_a_seed_that_raises_is_a_line_of_its_own(tmp_path, monkeypatch, capsys):
    def examine(seed, options):
        if seed == 1:
            raise ZeroDivisionError("in a test")
        return _line(seed, status="tube_blocked")

    monkeypatch.setattr(campaign, "examine", examine)
    monkeypatch.setattr("sys.argv", ["campaign.py", "--count", "3"])
    assert campaign.main() == 0
    printed = capsys.readouterr().out
    assert printed.count("3 problems with a witness") == 1
    assert "0 of 3, 0.00%" in marks(printed)["solved"]
    assert "   1  crash: ZeroDivisionError: in a test [seeds 1]" in printed


# It builds, plans and judges a random problem in processes: 12 s.
@pytest.mark.slow
def test_a_problem_is_planned_by_processes_and_its_answer_judged(tmp_path, monkeypatch, capsys):
    output = tmp_path / "lines.jsonl"
    arguments = ["--seed", str(QUICK), "--count", "1", "--processes", "2", "--output", str(output)]
    monkeypatch.setattr("sys.argv", ["campaign.py", *arguments])
    assert campaign.main() == 0
    found = marks(capsys.readouterr().out)
    assert "0 of 1 solved" in found["wrong"]
    assert "1 of 1, 100.00%" in found["solved"]
    line = json.loads(output.read_text())["row"]
    assert (line["seed"], line["status"], line["judged"]) == (QUICK, "success", True)


def test_seeds_that_are_done_are_skipped_unless_they_were_done_otherwise(
    tmp_path, monkeypatch, capsys
):
    output, done = tmp_path / "lines.jsonl", []
    monkeypatch.setattr(
        campaign, "examine", lambda seed, options: done.append(seed) or _line(seed, status="crash")
    )

    def seeds_of(*arguments):
        done.clear()
        monkeypatch.setattr("sys.argv", ["campaign.py", *arguments, "--output", str(output)])
        assert campaign.main() == 0
        return list(done)

    assert seeds_of("--count", "1") == [0]
    with output.open("a") as stream:
        stream.write('{"key": "torn')
    assert seeds_of("--count", "2") == [1]
    assert "0 of 2, 0.00%" in marks(capsys.readouterr().out)["solved"]
    assert seeds_of("--count", "2", "--slack", "0.005") == [0, 1]
    assert seeds_of("--count", "2", "--keep", str(tmp_path)) == []
