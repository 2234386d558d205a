"""`tubeplanner check`: the certificate, the peaks, and what a controller makes of a file."""

import json

import pytest

from stored_trajectories import REFINEMENT, stored_path

PANDA = "example:panda/between_shelves"
FILE = stored_path("panda/between_shelves", REFINEMENT)


@pytest.fixture
def ros_file(stored, tmp_path):
    problem, trajectory = stored("panda/between_shelves", REFINEMENT)
    path = tmp_path / "t.yaml"
    trajectory.save(path, problem)
    return path


def test_a_time_optimal_motion_is_certified_and_a_panda_would_abort_it(run):
    status, text, _ = run("check", PANDA, FILE, "--for", "fer")
    assert status == 1
    assert text.startswith("peaks: joint acceleration ")
    assert "nothing limits acceleration or jerk" in text.splitlines()[1]
    assert "would abort: joint_motion_generator_acceleration_discontinuity: panda_joint" in text
    assert "note: enforced for Cartesian commands only: tool speed" in text
    assert text.rstrip().endswith("passes every condition; fer: would abort.")


def test_the_object_has_the_findings(run):
    status, text, _ = run("check", PANDA, FILE, "--for", "fer", "--json")
    answer = json.loads(text)
    assert (status, answer["status"]) == (1, "certificate_failed")
    assert answer["certificate"]["passed"]
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


def test_without_a_controller_there_is_no_verdict(run):
    status, text, _ = run("check", PANDA, FILE, "--json")
    assert status == 0
    assert json.loads(text)["controller"] is None


def test_an_export_is_accepted_and_one_that_still_moves_is_refused(run, ros_file):
    status, text, _ = run("check", PANDA, ros_file, "--for", "jtc")
    assert status == 0
    assert text.rstrip().endswith("passes every condition; jtc: accepted.")
    lines = ros_file.read_text().splitlines()
    last = max(k for k, line in enumerate(lines) if "velocities" in line)
    lines[last] = "  velocities: [0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0]"
    ros_file.write_text("\n".join(lines))
    status, text, _ = run("check", PANDA, ros_file, "--for", "jtc")
    assert status == 1
    assert (
        "would refuse: Velocity of last trajectory point of joint panda_joint2 is not zero: "
        "panda_joint2 0.01 rad/s at t = "
    ) in text


def test_what_does_not_fit_is_bad_input(run):
    status, _, error = run("check", PANDA, FILE, "--for", "kuka")
    assert status == 2
    assert "unknown controller 'kuka'" in error
    ur5 = stored_path("ur5/over_the_wall", REFINEMENT)
    status, _, error = run("check", "example:ur5/over_the_wall", ur5, "--for", "fr3")
    assert status == 2
    assert "the Franka Research 3 has 7 joints; the problem plans 6" in error


def test_one_line_says_how_it_brakes_and_whether_it_can_be_slower(run):
    _, text, _ = run("check", PANDA, FILE)
    line = next(line for line in text.splitlines() if line.startswith("brakes to rest within 0.0"))
    assert " mm of the tool's path (longest from t = 0." in line
    assert line.endswith("; slower runs keep all limits")


def test_what_cannot_be_slower_is_said_with_its_place(run):
    status, text, _ = run("check", PANDA, FILE, "--set", "robot.limits.velocity=1.0")
    assert status == 1
    assert "\nslower runs break limits: velocity, margin -" in text
    assert " % at 100 % of the speed (panda_joint" in text
    assert "brakes to rest" not in text
