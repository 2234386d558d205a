"""What is handed out travels: pickled and copied by content, whatever becomes of the files."""

import copy
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from arms import INERTIAL, joint, link, written

import tubeplanner as t
from tubeplanner.errors import RobotError
from tubeplanner.output.files.fingerprint import problem_hash, robot_hash
from tubeplanner.resources import bundled_folder

STOPS = t.PlanOptions("stop-at-corners", slack=0.0)
COPIES = {"pickled": lambda kept: pickle.loads(pickle.dumps(kept)), "copied": copy.deepcopy}


@pytest.fixture(params=COPIES)
def again(request):
    return COPIES[request.param]


@pytest.fixture
def post(planned):
    return planned("two_link/around_a_post")


def test_a_robot_is_what_it_was(again):
    options = {"locked_joints": {"panda_finger_joint1": 0.03}, "gravity": (0.1, 0, -9)}
    robot = t.load_robot("example:panda", "panda_hand_tcp", **options)
    other = again(robot)
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 5, 7))
    np.testing.assert_array_equal(other.inverse_dynamics(q, v, a), robot.inverse_dynamics(q, v, a))
    np.testing.assert_array_equal(other.tool_position(q), robot.tool_position(q))
    assert robot_hash(other) == robot_hash(robot)


def test_a_problem_plans_the_same(post, again):
    problem, result = post
    other = again(problem)
    assert problem_hash(other) == problem_hash(problem)
    found = t.plan(other, STOPS)
    np.testing.assert_array_equal(found.trajectory.coefficients, result.trajectory.coefficients)
    assert found.certificate == result.certificate


def test_a_result_is_what_it_was(post, again):
    problem, result = post
    other = again(result)
    assert other.certificate == result.certificate
    assert other.as_dict() == result.as_dict()
    assert other.sensitivities == result.sensitivities
    assert other.path_minimum == result.path_minimum
    assert t.verify(problem, other.trajectory) == result.certificate
    with pytest.raises(TypeError):
        other.certificate.conditions["effort"] = None


MESH = '<geometry><mesh filename="arm.stl"/></geometry>'
INNER = f"{INERTIAL}<visual>{MESH}</visual><collision>{MESH}</collision>"


def test_without_its_files_a_problem_is_planned_and_a_view_names_what_is_missing(tmp_path, again):
    """The collision geometry travels with the problem, the visual meshes do not."""
    folder = tmp_path / "robot"
    folder.mkdir()
    turn = joint("turn", "base", "arm")
    end = joint("end", "arm", "tip", "fixed", xyz="0.5 0 0")
    urdf = written(folder, link("base", ""), link("arm", INNER), link("tip", ""), turn, end)
    shutil.copy(bundled_folder() / "ur5" / "part.stl", folder / "arm.stl")
    data = {
        "robot": {"urdf": str(urdf), "tool_frame": "tip"},
        "tube": {"points": [[0.5, 0, 0], [0.3, 0.4, 0]], "radius": 0.2},
        "start": {"joints": [0.0]},
        "obstacles": [{"name": "post", "sphere": 0.05, "position": [-0.5, 0, 0]}],
    }
    problem = t.parse_problem(data)
    packed = again(problem)
    before = t.plan(problem, STOPS)
    assert before.succeeded
    shutil.rmtree(folder)
    after = t.plan(packed, STOPS)
    np.testing.assert_array_equal(after.trajectory.coefficients, before.trajectory.coefficients)
    assert t.verify(packed, before.trajectory) == before.certificate
    with pytest.raises(RobotError, match=r"mesh .*arm.stl.* does not exist"):
        t.view(packed, after.trajectory)


def run_together(*calls):
    """Return the results of calls made at the same time."""
    with ThreadPoolExecutor(len(calls)) as threads:
        return [future.result() for future in [threads.submit(call) for call in calls]]


def test_two_threads_judge_against_one_problem_as_one_does(post):
    """A thread must not measure link poses of another thread."""
    problem, result = post
    motions = (result.trajectory, result.trajectory.scaled(1.5))
    alone = [[t.verify(problem, motion)] * 5 for motion in motions]
    calls = (lambda m=motion: [t.verify(problem, m) for _ in range(5)] for motion in motions)
    assert run_together(*calls) == alone


def test_two_threads_plan_one_problem_as_one_does(post):
    problem, result = post
    for other in run_together(*[lambda: t.plan(problem, STOPS)] * 2):
        np.testing.assert_array_equal(other.trajectory.coefficients, result.trajectory.coefficients)
        assert other.certificate == result.certificate
