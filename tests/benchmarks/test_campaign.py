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


def pairs(*durations):
    return {"pairs": dict(zip(("forwards", "backwards", "narrower"), durations, strict=True))}


@pytest.mark.parametrize(
    ("line", "slow"),
    [
        (pairs(1.0, 1.005, 1.05), []),
        (pairs(1.02, 1.0, 1.05), ["forwards"]),
        (pairs(1.02, 1.02, 1.0), ["forwards", "backwards"]),
        (pairs(1.0, None, None), ["backwards"]),
        (pairs(None, None, None), []),
        ({"duration": 1.0, "baseline": 1.1}, []),
        ({"duration": 1.2, "baseline": 1.1}, ["beside a baseline"]),
        ({"duration": None, "baseline": 1.1}, ["beside a baseline"]),
    ],
)
def test_stuck_is_slower_than_the_best_or_a_baseline_by_a_hundredth(line, slow):
    assert campaign.stuck(line) == slow


def _line(seed, **more):
    return {"seed": seed, "arm": "ur5", "segments": 1, "scale": 0.01, "message": "", **more}


@pytest.fixture
def run_campaign(monkeypatch, capsys):
    """Return a function from arguments to the exit status, the table of marks and all output."""

    def of(*arguments, examine=campaign.examine):
        monkeypatch.setattr(campaign, "examine", examine)
        monkeypatch.setattr("sys.argv", ["campaign.py", *map(str, arguments)])
        status, printed = campaign.main(), capsys.readouterr().out
        rows = [line.partition(" ") for line in printed.splitlines()]
        return status, {name: rest.strip() for name, _, rest in rows}, printed

    return of


def test_what_is_wrong_is_listed_and_ends_with_status_1(run_campaign, tmp_path):
    answers = [
        _line(0, status="success", judged=True, duration=1.0, planning_time=1.0),
        _line(1, status="success", judged=False, worst="tube", duration=1.0, planning_time=1.0),
        _line(2, status="tube_blocked"),
    ]
    output = tmp_path / "lines.jsonl"
    arguments = ("--count", 3, "--output", output)
    status, marks, printed = run_campaign(*arguments, examine=lambda seed, options: answers[seed])
    assert status == 1
    assert marks["wrong"].split() == ["1", "of", "2", "solved", "0", "MISSED", "[seeds", "1]"]
    assert "2 of 3, 66.67%" in marks["solved"]
    assert "WRONG seed 1 (ur5" in printed
    assert len(output.read_text().splitlines()) == 3


def test_a_seed_that_raises_is_a_line_of_its_own(run_campaign):
    def examine(seed, options):
        if seed == 1:
            raise ZeroDivisionError("in a test")
        return _line(seed, status="tube_blocked")

    status, marks, printed = run_campaign("--count", 3, examine=examine)
    assert status == 0
    assert printed.count("3 problems with a witness") == 1
    assert "0 of 3, 0.00%" in marks["solved"]
    assert "   1  crash: ZeroDivisionError: in a test [seeds 1]" in printed


# It builds, plans and judges a random problem in processes: 12 s.
@pytest.mark.slow
@pytest.mark.study
def test_a_problem_is_planned_by_processes_and_its_answer_judged(run_campaign, tmp_path):
    output = tmp_path / "lines.jsonl"
    arguments = ("--seed", QUICK, "--count", 1, "--processes", 2, "--output", output)
    status, marks, _ = run_campaign(*arguments)
    assert status == 0
    assert "0 of 1 solved" in marks["wrong"]
    assert "1 of 1, 100.00%" in marks["solved"]
    line = json.loads(output.read_text())["row"]
    assert (line["seed"], line["status"], line["judged"]) == (QUICK, "success", True)


def test_seeds_that_are_done_are_skipped_unless_they_were_done_otherwise(run_campaign, tmp_path):
    output, done = tmp_path / "lines.jsonl", []

    def examine(seed, options):
        done.append(seed)
        return _line(seed, status="crash")

    def seeds_of(*arguments):
        done.clear()
        status, marks, _ = run_campaign(*arguments, "--output", output, examine=examine)
        assert status == 0
        return list(done), marks["solved"]

    assert seeds_of("--count", 1)[0] == [0]
    with output.open("a") as stream:
        stream.write('{"key": "torn')
    seeds, solved = seeds_of("--count", 2)
    assert seeds == [1] and "0 of 2, 0.00%" in solved
    assert seeds_of("--count", 2, "--slack", 0.005)[0] == [0, 1]
    assert seeds_of("--count", 2, "--keep", tmp_path)[0] == []
