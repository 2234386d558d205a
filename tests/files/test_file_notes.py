import numpy as np
import pytest

from tubeplanner import JointTrajectory, LimitOverrides, PlanningProblem, Tube, load_robot
from tubeplanner.files.file_notes import notes_on_file
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.trajectory.trajectory_file import TrajectoryFile

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
