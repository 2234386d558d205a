"""What is said of a trajectory file: made for another problem, robot or cycle; likely mistakes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_cycle import small_cycle

from tubeplanner import JointTrajectory, Seed, load_problem
from tubeplanner.errors import TrajectoryError
from tubeplanner.output.files.file_notes import (
    has_other_part,
    motion_notes,
    notes_on_file,
    unit_guesses,
)
from tubeplanner.output.files.fingerprint import origin, problem_hash, robot_hash
from tubeplanner.output.files.trajectory_writer import (
    trajectory_csv,
    trajectory_json,
    write_cycle_motion,
)
from tubeplanner.trajectory.reader import (
    GivenSamples,
    TrajectoryFile,
    joined_samples,
    read_trajectory_file,
)

NAME = "ur5/over_the_wall"


def notes_of(problem, name, file):
    return motion_notes(problem, Path(name), name, file)[2]


def with_coefficients(trajectory, coefficients):
    return JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)


def shifted(trajectory, distance):
    """Return a trajectory all of whose positions are larger by a distance [rad]."""
    coefficients = trajectory.coefficients.copy()
    coefficients[-1] += distance
    return with_coefficients(trajectory, coefficients)


# A file that says by hashes of the whole what it was made for.


def test_another_problem_and_another_robot_are_told_apart(stored):
    problem, trajectory = stored(NAME)
    hashes = {"problem_hash": problem_hash(problem), "robot_hash": robot_hash(problem.robot)}
    file = TrajectoryFile(trajectory, **hashes)
    assert notes_on_file(problem, file, failed=True) == []
    assert notes_on_file(problem, TrajectoryFile(trajectory), failed=True) == []
    wider = replace(problem, tube=problem.tube.with_radius(0.09))
    assert notes_on_file(wider, file, failed=False) == [
        "the trajectory was made for another problem with this robot"
    ]
    weaker = load_problem(f"example:{NAME}", changes={"robot.limits.effort.elbow_joint": 100.0})
    assert notes_on_file(weaker, file, failed=False) == [
        "the trajectory was made for another robot, payload, limits or motors"
    ]


def test_how_samples_were_joined_is_told(stored):
    problem, trajectory = stored(NAME)
    file = TrajectoryFile(trajectory, interpolation="cubics that meet every sample")
    assert notes_on_file(problem, file, failed=False) == [
        "samples are joined by cubics that meet every sample"
    ]


def test_degrees_and_swapped_joints_are_guessed_and_another_start_is_not(stored):
    problem, trajectory = stored(NAME)
    degrees = with_coefficients(trajectory, np.degrees(trajectory.coefficients))
    (note,) = notes_on_file(problem, TrajectoryFile(degrees), failed=True)
    assert note == "degrees? its positions fit the problem when divided by 57.3; give radians"
    names = list(problem.robot.joint_names)
    names[0], names[2] = names[2], names[0]
    swapped = JointTrajectory(names, trajectory.breakpoints, trajectory.coefficients)
    (note,) = notes_on_file(problem, TrajectoryFile(swapped), failed=True)
    assert note.startswith("its joints look to be in another order: ")
    assert "'elbow_joint' starts where 'shoulder_pan_joint' should" in note
    assert "'shoulder_pan_joint' starts where 'elbow_joint' should" in note
    assert "wrist" not in note
    assert notes_on_file(problem, TrajectoryFile(shifted(trajectory, 0.1)), failed=True) == []


def test_units_are_guessed_from_tube_limits_and_speeds(stored):
    problem, trajectory = stored(NAME)
    seeded = replace(problem, start=Seed(problem.start))
    t = np.arange(0, trajectory.duration, 0.008)

    def guesses(unit, slower, samples=True):
        q = [unit * trajectory.position(t), unit * trajectory.velocity(t) / slower]
        motion = joined_samples(trajectory.joint_names, t * slower, q)
        values = GivenSamples(0.0, ("position", "velocity")) if samples else None
        notes = unit_guesses(seeded, TrajectoryFile(motion, samples=values))
        return [note.partition("?")[0] for note in notes]

    degree = np.degrees(1.0)
    assert guesses(1, 1) == guesses(1, 50) == guesses(1, 1e3, samples=False) == []
    assert guesses(degree, 1) == ["degrees"]
    assert guesses(1, 1e3) == ["milliseconds"]
    assert guesses(degree, 1e6) == ["degrees", "microseconds"]


def test_joints_that_stand_still_are_named_and_compared_with_the_locked_values(stored):
    problem, trajectory = stored("panda/between_shelves", "refinement")
    finger = "panda_finger_joint1"
    named, other = notes_on_file(
        problem, TrajectoryFile(trajectory, still={finger: 0.02, "cup": 1.0}), failed=False
    )
    assert named == f"joints that stand still and are not planned: '{finger}' at 0.02, 'cup' at 1"
    assert other == (
        f"'{finger}' stands at 0.02 rad or m in the file, at 0 in the problem, for which it is "
        "judged; give it in robot.locked_joints"
    )
    changes = {"robot.locked_joints": {finger: 0.02, "panda_finger_joint2": 0.02}}
    problem = load_problem("example:panda/between_shelves", changes=changes)
    file = TrajectoryFile(trajectory, still={finger: 0.02})
    assert len(notes_on_file(problem, file, failed=False)) == 1


def test_columns_that_are_not_read_are_named(stored):
    problem, trajectory = stored(NAME)
    ignored = tuple(f"/diag/{k}" for k in range(21))
    listed = ", ".join(map(repr, ignored[:20]))
    for count, more in ((20, ""), (21, " and 1 more")):
        file = TrajectoryFile(trajectory, ignored=ignored[:count])
        (note,) = notes_on_file(problem, file, failed=False)
        assert note == f"columns that are not read: {listed}{more}"


# A motion under the problem that it was made for, and under another.


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
    assert notes_of(stored(NAME)[0], "t", file) == ["t: passes every condition"]


@pytest.mark.parametrize("part", CHANGES)
def test_the_part_that_differs_is_named(file, part):
    changes = CHANGES[part]
    if part == "start or goal":
        changes = {"goal": {"joints": file.trajectory.position(file.trajectory.duration).tolist()}}
    problem = load_problem(f"example:{NAME}", changes=changes)
    other = "the trajectory was made for another problem; what differs: "
    notes = [note for note in notes_of(problem, "t", file) if other in note]
    assert notes == [f"t: {other}{part}"]
    assert has_other_part(problem, file) == (part == "carried solids")
    assert not has_other_part(problem, TrajectoryFile(file.trajectory))


def test_a_motion_that_fails_says_where(file):
    problem = load_problem(f"example:{NAME}", changes={"robot.limits.velocity": 1.0})
    assert notes_of(problem, "t", file)[0].startswith("t: fails: velocity")


def test_samples_are_judged_as_check_judges_them(stored, tmp_path):
    problem, trajectory = stored(NAME)
    path = tmp_path / "t.csv"
    path.write_text(trajectory_csv(trajectory.joint_names, trajectory.sample(2000)))
    (verdict, joined) = notes_of(problem, "t", read_trajectory_file(path))
    assert verdict == "t: passes every condition"
    assert joined.startswith("t: samples are joined by quintics")


def test_samples_may_be_rounded_polynomials_not(stored, file):
    rounded = replace(file, trajectory=shifted(file.trajectory, 1e-5))
    for interpolation, begin in ((None, "t: fails: start"), ("cubic", "t: passes")):
        one = replace(rounded, interpolation=interpolation)
        assert notes_of(stored(NAME)[0], "t", one)[0].startswith(begin)


def test_a_file_of_ours_is_held_to_what_plans_are(stored, file):
    """One part in 20,000 faster: samples made elsewhere may be that far off, polynomials not."""
    fast = replace(file, trajectory=file.trajectory.scaled(1 - 5e-5))
    assert notes_of(stored(NAME)[0], "t", fast)[0].startswith("t: fails")


def test_hashes_of_parts_that_are_none_are_left_out(file, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"part_hashes": [1]}))
    assert read_trajectory_file(path).part_hashes == {}


def test_other_joints_are_refused_with_the_motions_name(stored, file):
    motion = file.trajectory
    strange = JointTrajectory(list("abcdef"), motion.breakpoints, motion.coefficients)
    with pytest.raises(TrajectoryError, match=r"^t: "):
        notes_of(stored(NAME)[0], "t", TrajectoryFile(strange))


# The file of a cycle's motion.


@pytest.fixture(scope="module")
def cycle_file(small_plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "t.json"
    write_cycle_motion(path, small_plan.motion)
    return read_trajectory_file(path)


def test_nothing_is_said_of_what_was_made_for_the_cycle_or_does_not_say(cycle_file):
    assert notes_on_file(small_cycle(), cycle_file) == []
    assert notes_on_file(small_cycle(), TrajectoryFile(cycle_file.trajectory)) == []


def test_what_differs_in_a_cycle_is_named(cycle_file):
    (note,) = notes_on_file(small_cycle(moves__back__tube__radius=0.2), cycle_file)
    assert note == "the trajectory was made for another cycle; what differs: tube of move 'back'"


def test_without_hashes_of_parts_it_is_known_that_a_cycle_or_its_robot_differs(cycle_file):
    alone = replace(cycle_file, part_hashes={})
    (note,) = notes_on_file(small_cycle(closed=False), alone)
    assert note == "the trajectory was made for another cycle with this robot"
    for cycle, file in (
        (small_cycle(robot__limits__acceleration=500.0), alone),
        (small_cycle(), TrajectoryFile(cycle_file.trajectory, robot_hash="0" * 16)),
    ):
        (note,) = notes_on_file(cycle, file)
        assert note == "the trajectory was made for another robot, payload, limits or motors"
