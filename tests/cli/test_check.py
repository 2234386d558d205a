"""`check`: certificate of a trajectory file; controllers of `--for`."""

import re

import pytest
from small_cycle import SMALL
from stored_trajectories import REFINEMENT, stored_path, stored_trajectory

from tubeplanner import OptionError
from tubeplanner.cli.check import CONTROLLERS, judged_by
from tubeplanner.output.files.trajectory_writer import write_cycle_motion
from tubeplanner.task.motion import ProblemMotion

SHELVES = "panda/between_shelves"
PANDA = f"example:{SHELVES}"
FILE = stored_path(SHELVES, REFINEMENT)
NARROW = ("--set", "moves.beside.tube.radius=0.01")
NO_MARKS = (
    "has no marks, which say when the moves of a cycle begin.*give the JSON that plan -o writes"
)


def test_each_has_its_own_name_and_limits(bundled):
    problem, file = bundled(SHELVES), stored_trajectory(SHELVES, REFINEMENT)
    motion = ProblemMotion(problem, file.trajectory)
    verdicts = {each: judged_by(each, motion, file) for each in CONTROLLERS}
    assert [verdict.name for verdict in verdicts.values()] == list(CONTROLLERS)
    limits = {each.limit for each in verdicts["fr3"].findings if each.unit == "rad/s^3"}
    assert {abs(limit) for limit in limits} == {5000}
    assert "Panda" in verdicts["fer"].title
    assert (verdicts["fer"].summary, verdicts["jtc"].summary) == ("would abort", "accepted")
    with pytest.raises(OptionError, match=r"unknown controller 'fr4'.*there is: fer, fr3, jtc"):
        judged_by("fr4", motion, file)


def test_a_time_optimal_motion_is_certified_and_a_panda_would_abort_it(run):
    status, text, _ = run("check", PANDA, FILE, "--for", "fer")
    assert status == 1
    assert text.startswith("peaks: joint acceleration ")
    assert "nothing limits acceleration or jerk" in text.splitlines()[1]
    assert "would abort: joint_motion_generator_acceleration_discontinuity: panda_joint" in text
    assert "note: enforced for Cartesian commands only: tool speed" in text
    assert text.rstrip().endswith("passes every condition; fer: would abort.")
    line = next(line for line in text.splitlines() if line.startswith("brakes to rest within 0.0"))
    assert " mm of the tool's path (longest from t = 0." in line
    assert line.endswith("; slower runs keep all limits")


def test_the_object_has_the_findings(run_json):
    status, answer = run_json("check", PANDA, FILE, "--for", "fer")
    assert (status, answer["status"]) == (1, "certificate_failed")
    controller = answer["controller"]
    assert (controller["name"], controller["accepted"]) == ("fer", False)
    jerk = next(each for each in controller["findings"] if each["unit"] == "rad/s^3")
    assert abs(jerk["value"]) > abs(jerk["limit"])
    assert (
        jerk["first_time"] <= jerk["time"] <= answer["duration"] == pytest.approx(0.585, abs=0.01)
    )
    first = controller["findings"][0]
    assert answer["message"].endswith(f"; fer: would abort: {first['error']}: {first['message']}")
    assert answer["where"]["joint"] == first["joint"]
    assert answer["where"]["time"] == first["first_time"] < first["time"]
    assert answer["tool_speed"]["value"] > 1.7
    status, answer = run_json("check", PANDA, FILE)
    assert (status, answer["controller"]) == (0, None)


def test_an_export_is_accepted_and_one_that_still_moves_is_refused(run, stored, tmp_path):
    name = "two_link/around_a_post"
    problem, trajectory = stored(name)
    path = tmp_path / "t.yaml"
    trajectory.save(path, problem)
    status, text, _ = run("check", f"example:{name}", path, "--for", "jtc")
    assert status == 0
    assert text.rstrip().endswith("passes every condition; jtc: accepted.")
    lines = path.read_text().splitlines()
    last = max(k for k, line in enumerate(lines) if "velocities" in line)
    lines[last] = "  velocities: [0.0, 0.01]"
    path.write_text("\n".join(lines))
    status, text, _ = run("check", f"example:{name}", path, "--for", "jtc")
    assert status == 1
    assert (
        "would refuse: Velocity of last trajectory point of joint joint2 is not zero: "
        "joint2 0.01 rad/s at t = "
    ) in text


def test_what_does_not_fit_is_bad_input(run):
    ur5 = stored_path("ur5/over_the_wall", REFINEMENT)
    status, _, error = run("check", "example:ur5/over_the_wall", ur5, "--for", "fr3")
    assert status == 2
    assert "the Franka Research 3 has 7 joints; the problem plans 6" in error


def test_what_cannot_be_slower_is_said_with_its_place(run):
    status, text, _ = run("check", PANDA, FILE, "--set", "robot.limits.velocity=1.0")
    assert status == 1
    assert "\nslower runs break limits: velocity, margin -" in text
    assert " % at 100 % of the speed (panda_joint" in text
    assert "brakes to rest" not in text


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_plan):
    """A folder with a cycle and the files of its motion."""
    folder = tmp_path_factory.mktemp("cycle")
    (folder / "small.yaml").write_text(SMALL)
    for name in ("t.json", "t.csv", "t.yaml"):
        write_cycle_motion(folder / name, small_plan.motion, rate=200)
    return folder


def test_every_move_has_its_verdict_and_what_fails_its_rows(run, folder):
    narrow_too = ("--set", "moves.back.tube.radius=0.001")
    words = ("check", folder / "small.yaml", folder / "t.json", *NARROW, *narrow_too)
    status, text, _ = run(*words)
    assert status == 1
    verdicts = {
        cells[3].strip(): cells[4].strip()
        for cells in (line.split("│") for line in text.splitlines())
        if len(cells) == 6
    }
    assert verdicts["over"] == "passes"
    assert verdicts["down"].startswith("FAILS: tube")
    assert verdicts["beside"] == "with down"
    assert verdicts["back"].startswith("FAILS: tube")
    failing = [line for line in text.splitlines() if line.startswith("│ tube ") and "NO" in line]
    assert ["'beside'" in line for line in failing] == [True, False]
    assert "'back'" in failing[1]
    assert "what differs: tube of move 'down, beside'" in text
    assert "fails: down: tube: margin -0.0" in text.splitlines()[-1]


@pytest.mark.dear("plans the small cycle, which others look at, and judges it twice")
def test_the_object_has_the_first_failure_and_the_whole_certificate(run_json, folder, small_plan):
    status, answer = run_json("check", folder / "small.yaml", folder / "t.json", *NARROW)
    assert (status, answer["status"]) == (1, "certificate_failed")
    assert (answer["where"]["move"], answer["where"]["segment"]) == ("beside", 0)
    assert list(answer["certificate"]["moves"]) == ["over", "down", "beside", "back"]
    assert not answer["certificate"]["moves"]["beside"]["passed"]
    assert answer["certificate"]["seams"]["closed"]["continuity"]["satisfied"]
    assert answer["message"].count("tube: margin") == 1
    assert answer["duration"] == small_plan.duration
    tolerant = ("--tolerance", "0.5")
    assert run_json("check", folder / "small.yaml", folder / "t.json", *NARROW, *tolerant)[0] == 0


def test_a_controller_judges_the_motion_of_a_cycle(run, folder):
    status, text, _ = run("check", folder / "small.yaml", folder / "t.json", "--for", "jtc")
    assert status == 0
    assert text.endswith("passes every condition; jtc: accepted.\n")


@pytest.mark.parametrize(
    ("name", "words", "message"),
    [
        ("t.csv", (), f"t.csv {NO_MARKS}"),
        ("t.json", ("--set", "moves.back.name=home"), "t.json: marks are move over, .* move home"),
    ],
)
def test_what_is_no_motion_of_the_cycle_is_refused(run, folder, name, words, message):
    status, _, error = run("check", folder / "small.yaml", folder / name, *words)
    assert status == 2
    assert re.search(message, error)
