"""Notes on a trajectory file: other problem, other robot, failed certificate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small_cycle import planned_cycle, small_cycle

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    PlanningProblem,
    Tube,
    load_problem,
    load_robot,
)
from tubeplanner.errors import TrajectoryError
from tubeplanner.files.cycle_notes import notes_on_cycle_file
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.export import trajectory_csv, trajectory_json
from tubeplanner.files.file_notes import notes_on_file
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.files.motion_notes import has_other_part, motion_notes
from tubeplanner.files.origin import origin
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.trajectory.trajectory_file import TrajectoryFile, read_trajectory_file

UR5 = "ur5/over_the_wall"


def file_of(trajectory, **more):
    return TrajectoryFile(trajectory, **more)


def test_a_file_of_this_problem_needs_no_note(stored):
    problem, trajectory = stored(UR5)
    hashes = {"problem_hash": problem_hash(problem), "robot_hash": robot_hash(problem.robot)}
    assert notes_on_file(problem, file_of(trajectory, **hashes), failed=True) == []
    assert notes_on_file(problem, file_of(trajectory), failed=True) == []


def test_another_problem_and_another_robot_are_told_apart(stored):
    problem, trajectory = stored(UR5)
    file = file_of(
        trajectory,
        problem_hash=problem_hash(problem),
        robot_hash=robot_hash(problem.robot),
    )
    wider = Tube(problem.tube.points, 0.09, joint_signs=problem.tube.joint_ranges)
    other = PlanningProblem(problem.robot, wider, problem.start, obstacles=problem.obstacles)
    assert notes_on_file(other, file, failed=False) == [
        "the trajectory was made for another problem with this robot"
    ]
    weak = load_robot("example:ur5", "tool0", limits=LimitOverrides(effort={"elbow_joint": 100.0}))
    weaker = PlanningProblem(weak, problem.tube, problem.start, obstacles=problem.obstacles)
    assert notes_on_file(weaker, file, failed=False) == [
        "the trajectory was made for another robot, payload, limits or motors"
    ]


def test_how_samples_were_joined_is_told(stored):
    problem, trajectory = stored(UR5)
    file = file_of(trajectory, interpolation="cubics that meet every sample")
    assert notes_on_file(problem, file, failed=False) == [
        "samples are joined by cubics that meet every sample"
    ]


def test_degrees_are_guessed(stored):
    problem, trajectory = stored(UR5)
    degrees = JointTrajectory(
        trajectory.joint_names, trajectory.breakpoints, np.degrees(trajectory.coefficients)
    )
    (note,) = notes_on_file(problem, file_of(degrees), failed=True)
    assert note == "its positions look like degrees; radians are needed"


def test_swapped_joints_are_guessed_and_named(stored):
    problem, trajectory = stored(UR5)
    names = list(problem.robot.joint_names)
    names[0], names[2] = names[2], names[0]
    swapped = JointTrajectory(names, trajectory.breakpoints, trajectory.coefficients)
    (note,) = notes_on_file(problem, file_of(swapped), failed=True)
    assert note.startswith("its joints look to be in another order: ")
    assert "'elbow_joint' starts where 'shoulder_pan_joint' should" in note
    assert "'shoulder_pan_joint' starts where 'elbow_joint' should" in note
    assert "wrist" not in note


def test_another_start_is_no_misreading(stored):
    problem, trajectory = stored(UR5)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1] += 0.1
    moved = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    assert notes_on_file(problem, file_of(moved), failed=True) == []


def turned(tube, tolerance, quaternion=(0, 0, 0, 1)):
    return Tube(
        tube.points,
        tube.radius,
        joint_signs=tube.joint_ranges,
        orientations=[quaternion] * len(tube.points),
        rotation_tolerance=tolerance,
    )


HASHED = {
    "start": lambda p: {"start": np.asarray(p.start) + np.array([0, 0, 0, 0, 0, 1e-3])},
    "clearance": lambda p: {"clearance": 0.011},
    "an obstacle less": lambda p: {"obstacles": p.obstacles[:1]},
    "self-collision off": lambda p: {"self_collision": False},
    "signs": lambda p: {"tube": Tube(p.tube.points, p.tube.radius)},
    "visit": lambda p: {
        "tube": Tube(p.tube.points, p.tube.radius, joint_signs=p.tube.joint_ranges, visit="any")
    },
    "a rotation tolerance": lambda p: {"tube": turned(p.tube, 3.0)},
    "a wider one": lambda p: {"tube": turned(p.tube, 3.1)},
    "other orientations": lambda p: {"tube": turned(p.tube, 3.0, [0.1, 0, 0, 0.995])},
    "tool radius": lambda p: {
        "tube": Tube(
            p.tube.points, p.tube.radius, joint_signs=p.tube.joint_ranges, tool_radius=0.01
        )
    },
}


def rebuilt(problem, **changes):
    fields = {
        "start": problem.start,
        "obstacles": problem.obstacles,
        "clearance": problem.clearance,
        "tube": problem.tube,
        **changes,
    }
    return PlanningProblem(problem.robot, **fields)


@pytest.mark.parametrize("change", HASHED.values(), ids=HASHED)
def test_whatever_changes_the_verdict_changes_the_hash(change, bundled):
    problem = bundled(UR5)
    assert problem_hash(rebuilt(problem)) == problem_hash(problem)
    assert problem_hash(rebuilt(problem, **change(problem))) != problem_hash(problem)


def test_no_two_of_these_changes_have_the_same_hash(bundled):
    problem = bundled(UR5)
    hashes = {problem_hash(rebuilt(problem, **change(problem))) for change in HASHED.values()}
    assert len(hashes) == len(HASHED)


def test_the_hash_of_a_robot_knows_payload_gravity_and_tool():
    from tubeplanner import Payload, ToolOffset

    plain = robot_hash(load_robot("example:ur5", "tool0"))
    assert robot_hash(load_robot("example:ur5", "tool0")) == plain
    others = [
        load_robot("example:ur5", "tool0", payload=Payload(1.0)),
        load_robot("example:ur5", "tool0", gravity=(0, 0, 0)),
        load_robot("example:ur5", "tool0", tool_offset=ToolOffset(position=(0, 0, 0.01))),
        load_robot("example:ur5", "wrist_3_link"),
    ]
    assert len({plain, *(robot_hash(robot) for robot in others)}) >= 4


def test_columns_that_are_not_read_are_named(stored):
    problem, trajectory = stored(UR5)
    ignored = tuple(f"/diag/{k}" for k in range(21))
    (note,) = notes_on_file(problem, file_of(trajectory, ignored=ignored), failed=False)
    listed = ", ".join(map(repr, ignored[:20]))
    assert note == f"columns that are not read: {listed} and 1 more"
    (note,) = notes_on_file(problem, file_of(trajectory, ignored=ignored[:20]), failed=False)
    assert note == f"columns that are not read: {listed}"


# What is said of a motion under the problem it was made for, and under another.


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


# What is said of a cycle's file that was made for another.


@pytest.fixture(scope="module")
def cycle_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "t.json"
    contents, _ = cycle_contents(TrajectoryFiles(path), planned_cycle().motion, "refinement")
    path.write_bytes(contents[path])
    return read_trajectory_file(path)


def test_nothing_is_said_of_what_was_made_for_it_or_does_not_say(cycle_file):
    assert notes_on_cycle_file(small_cycle(), cycle_file) == []
    assert notes_on_cycle_file(small_cycle(), TrajectoryFile(cycle_file.trajectory)) == []


def test_what_differs_is_named(cycle_file):
    (note,) = notes_on_cycle_file(small_cycle(moves__back__tube__radius=0.2), cycle_file)
    assert note == "the trajectory was made for another cycle; what differs: tube of move 'back'"


def test_without_hashes_of_parts_it_is_known_that_it_differs(cycle_file):
    alone = TrajectoryFile(
        cycle_file.trajectory, None, cycle_file.problem_hash, cycle_file.robot_hash
    )
    (note,) = notes_on_cycle_file(small_cycle(closed=False), alone)
    assert note == "the trajectory was made for another cycle with this robot"
    (note,) = notes_on_cycle_file(small_cycle(robot__limits__acceleration=500.0), alone)
    assert note.startswith("the trajectory was made for another robot, payload")


def test_another_robot_is_told_without_a_hash_of_the_cycle(cycle_file):
    (note,) = notes_on_cycle_file(
        small_cycle(), TrajectoryFile(cycle_file.trajectory, None, None, "0" * 16)
    )
    assert note.startswith("the trajectory was made for another robot, payload")
