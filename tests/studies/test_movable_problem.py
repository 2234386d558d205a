"""Problems whose robot may stand elsewhere: what becomes of their ends and of their base."""

import numpy as np
import pytest

from gantry import gantry
from tubeplanner import ProblemError, Seed, Stand, ToolPose
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.orientation import matrix_of_rpy
from tubeplanner.studies.movable_problem import MovableProblem

THERE = Stand(-0.2, -0.3, 0.0, -0.5)


def movable(path, **changes):
    return MovableProblem.of(PosedProblem.read(path).changed(changes))


def test_joints_become_seeds_and_the_tube_stays(tmp_path):
    problem = movable(gantry(tmp_path), **{"goal": {"joints": {"across": 0.0, "along": 0.5}}})
    assert problem.given == Stand(0, 0, 0, 0)
    assert problem.changes(THERE) == {
        "robot.base": {"position": [-0.2, -0.3, 0.0], "rpy": [0.0, 0.0, -0.5]},
        "start": {"seed": [0.0, 0.0]},
        "goal": {"seed": {"across": 0.0, "along": 0.5}},
    }
    loaded = problem.load(THERE)
    assert isinstance(loaded.start, Seed)
    np.testing.assert_array_equal(loaded.goal.joints, [0.5, 0.0])
    np.testing.assert_array_equal(loaded.tube.points[-1], [0.5, 0.0, 0.0])
    other = problem.load(THERE, {"start": [0.1, 0.2]})
    np.testing.assert_array_equal(other.start.joints, [0.1, 0.2])


def test_ends_that_are_of_the_tool_stay_as_they_are(tmp_path):
    pose = {"pose": {"position": [0.0, 0.0, 0.0], "rpy": [0, 0, 0]}}
    problem = movable(
        gantry(tmp_path, start=pose, goal={"position": [0.5, 0, 0], "tolerance": 0.001})
    )
    assert set(problem.changes(THERE)) == {"robot.base"}
    assert isinstance(problem.load(THERE).start, ToolPose)
    assert movable(gantry(tmp_path, start={"seed": [0.5, 0.5]})).seeds == {}


def test_a_base_keeps_its_roll_and_pitch(tmp_path):
    path = gantry(tmp_path)
    tilted = movable(path, **{"robot.base": {"position": [1, 2, 3], "rpy": [0.1, 0.2, 0.3]}})
    assert (tilted.given, tilted.tilt) == (Stand(1, 2, 3, 0.3), (0.1, 0.2))
    quaternion = [0.1, -0.2, 0.3, 0.9]
    turned = movable(path, **{"robot.base": {"quaternion": quaternion}})
    own = turned.load(turned.given).robot.base.placement
    as_given = turned.posed.changed({"start": {"seed": [0, 0]}}).load().robot.base.placement
    np.testing.assert_allclose(own, as_given, atol=1e-12)
    moved = turned.load(turned.given._replace(yaw=turned.given.yaw + 0.7)).robot.base.placement
    np.testing.assert_allclose(
        moved[:3, :3], matrix_of_rpy(0, 0, 0.7) @ as_given[:3, :3], atol=1e-12
    )


def test_ends_of_a_start_that_cannot_be_posed_as_given_are_seeds_too(tmp_path):
    path = gantry(tmp_path, start={"joints": [0.9, 0.9]})
    with pytest.raises(ProblemError, match="outside the capsule"):
        PosedProblem.read(path).load()
    np.testing.assert_array_equal(movable(path).load(THERE).start.joints, [0.9, 0.9])


def test_what_contradicts_itself_is_refused(tmp_path):
    with pytest.raises(ProblemError, match="gantry: start takes either joints or seed"):
        movable(gantry(tmp_path, start={"joints": [0, 0], "seed": [0, 0]}))
    with pytest.raises(ProblemError, match="this is a cycle"):
        movable("example:ur5/through_the_door")
