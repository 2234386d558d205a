"""What is said of a motion under the problem it was made for, and under another."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import JointTrajectory, load_problem
from tubeplanner.errors import TrajectoryError
from tubeplanner.files.export import trajectory_csv, trajectory_json
from tubeplanner.files.motion_notes import has_other_part, motion_notes
from tubeplanner.files.origin import origin
from tubeplanner.trajectory.trajectory_file import TrajectoryFile, read_trajectory_file

NAME = "ur5/over_the_wall"
PART = {"name": "part", "sphere": 0.02, "position": [0, 0, 0.03], "touch_links": ["wrist_3_link"]}
CHANGES = {
    "robot": {"robot.tool_offset": {"position": [0, 0, 0.01]}},
    "payload": {"robot.payload": {"mass": 0.5}},
    "limits or motors": {"robot.limits.jerk": 1e9},
    "tube": {"tube.radius": [0.03, 0.081, 0.03]},
    "start or goal": {"goal": {"joints": [0.0] * 6}},
    "obstacles": {"obstacles.wall.position": [0.6, 0.0, 0.12]},
    "carried solids": {"robot.attached": [PART]},
    "clearance or collision": {"clearance": 1e-4},
}


@pytest.fixture
def file(stored, tmp_path):
    """A file of a motion that was made for the problem."""
    problem, trajectory = stored(NAME)
    (tmp_path / "t.json").write_text(trajectory_json(trajectory, **origin(problem)))
    return read_trajectory_file(tmp_path / "t.json")


def test_a_motion_of_the_problem_passes_and_that_is_all(stored, file):
    assert motion_notes(stored(NAME)[0], "t", file) == ["t: passes every condition"]


@pytest.mark.parametrize("part", CHANGES)
def test_the_part_that_differs_is_named(file, part):
    changes = CHANGES[part]
    if part == "start or goal":
        changes = {"goal": {"joints": file.trajectory.position(file.trajectory.duration).tolist()}}
    problem = load_problem(f"example:{NAME}", changes=changes)
    other = "the trajectory was made for another problem; what differs: "
    notes = [note for note in motion_notes(problem, "t", file) if other in note]
    assert notes == [f"t: {other}{part}"]
    assert has_other_part(problem, file) == (part == "carried solids")


def test_a_motion_that_fails_says_where(file):
    problem = load_problem(f"example:{NAME}", changes={"robot.limits.velocity": 1.0})
    assert motion_notes(problem, "t", file)[0].startswith("t: fails: velocity")


def test_samples_are_judged_as_check_judges_them(stored, file, tmp_path):
    problem, trajectory = stored(NAME)
    path = tmp_path / "t.csv"
    path.write_text(trajectory_csv(trajectory.joint_names, trajectory.sample(2000)))
    (verdict, joined) = motion_notes(problem, "t", read_trajectory_file(path))
    assert verdict == "t: passes every condition"
    assert joined.startswith("t: samples are joined by quintics")


def test_a_file_that_does_not_say_is_drawn_as_before(file):
    problem = load_problem(f"example:{NAME}", changes=CHANGES["carried solids"])
    assert not has_other_part(problem, TrajectoryFile(file.trajectory))


def test_hashes_of_parts_that_are_none_are_left_out(file, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"part_hashes": [1]}))
    assert read_trajectory_file(path).part_hashes == {}


def test_other_joints_are_refused_with_the_motions_name(stored, file):
    motion = file.trajectory
    strange = JointTrajectory(list("abcdef"), motion.breakpoints, motion.coefficients)
    with pytest.raises(TrajectoryError, match=r"^t: "):
        motion_notes(stored(NAME)[0], "t", TrajectoryFile(strange))


def test_a_file_of_ours_is_held_to_what_plans_are(stored, file):
    """One part in 20,000 faster: samples made elsewhere may be that far off, polynomials not."""
    problem, trajectory = stored(NAME)
    share = 1 - 5e-5
    powers = np.arange(len(trajectory.coefficients))[::-1, None, None]
    fast = JointTrajectory(
        trajectory.joint_names,
        trajectory.breakpoints * share,
        trajectory.coefficients / share**powers,
    )
    assert motion_notes(problem, "t", replace(file, trajectory=fast))[0].startswith("t: fails")


def test_samples_may_be_rounded(stored, file):
    problem, trajectory = stored(NAME)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1] += 1e-5
    rounded = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    for interpolation, said in ((None, "t: fails: start"), ("cubic", "t: passes")):
        one = replace(file, trajectory=rounded, interpolation=interpolation)
        assert motion_notes(problem, "t", one)[0].startswith(said)
