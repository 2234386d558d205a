"""What is handed out travels: pickled and copied by content, whatever becomes of the files."""

import copy
import pickle
import shutil
import threading

import numpy as np
import pytest

from tubeplanner import load_problem, load_robot, parse_problem, plan, verify, view
from tubeplanner.errors import RobotError
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.resources import find_description

COPIES = {"pickled": lambda kept: pickle.loads(pickle.dumps(kept)), "copied": copy.deepcopy}


@pytest.fixture(params=COPIES)
def again(request):
    return COPIES[request.param]


@pytest.fixture(scope="module")
def post():
    problem = load_problem("example:two_link/around_a_post")
    return problem, plan(problem)


def test_a_robot_is_what_it_was(again):
    options = {"locked_joints": {"panda_finger_joint1": 0.03}, "gravity": (0.1, 0, -9)}
    robot = load_robot("example:panda", "panda_hand_tcp", **options)
    other = again(robot)
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 5, 7))
    np.testing.assert_array_equal(other.inverse_dynamics(q, v, a), robot.inverse_dynamics(q, v, a))
    np.testing.assert_array_equal(other.tool_position(q), robot.tool_position(q))
    assert robot_hash(other) == robot_hash(robot)


def test_a_problem_plans_the_same(post, again):
    problem, result = post
    other = again(problem)
    assert problem_hash(other) == problem_hash(problem)
    found = plan(other)
    np.testing.assert_array_equal(found.trajectory.coefficients, result.trajectory.coefficients)
    assert found.certificate == result.certificate


def test_a_result_is_what_it_was(post, again):
    problem, result = post
    other = again(result)
    assert other.certificate == result.certificate
    assert other.as_dict() == result.as_dict()
    assert other.sensitivities == result.sensitivities
    assert other.path_minimum == result.path_minimum
    assert verify(problem, other.trajectory) == result.certificate
    with pytest.raises(TypeError):
        other.certificate.conditions["effort"] = None


def test_without_its_files_a_problem_is_planned_and_a_view_names_what_is_missing(tmp_path, again):
    """One with a mesh per link; the collision geometry travels, the visual meshes do not."""
    folder = find_description("example:xarm7", tmp_path).parents[1]
    shutil.copytree(folder, tmp_path / folder.name)
    urdf = next((tmp_path / folder.name).rglob("xarm7.urdf"))
    q = [0, -0.3, 0, 1.0, 0, 1.2, 0]
    robot = load_robot(urdf, "link7")
    tool = robot.tool_position(np.array([q]))[0]
    end = tool + np.array([0, 0.1, 0.05])
    data = {
        "robot": {"urdf": str(urdf), "tool_frame": "link7"},
        "tube": {"points": [tool.tolist(), end.tolist()], "radius": 0.05},
        "start": {"joints": q},
    }
    problem = parse_problem(data)
    packed = again(problem)
    before = plan(problem)
    shutil.rmtree(tmp_path / folder.name)
    after = plan(packed)
    np.testing.assert_array_equal(after.trajectory.coefficients, before.trajectory.coefficients)
    assert verify(packed, before.trajectory).passed
    with pytest.raises(RobotError, match=r"mesh .* does not exist"):
        view(packed, after.trajectory)


def test_two_threads_judge_against_one_problem_as_one_does(post):
    """Poses that one thread gives to links must not be measured by the other."""
    problem, result = post
    good = result.trajectory
    slow = plan(problem, progress=None).trajectory.scaled(1.5)
    alone = {"good": verify(problem, good), "slow": verify(problem, slow)}
    found = {"good": [], "slow": []}

    def judge(name, trajectory):
        for _ in range(15):
            found[name].append(verify(problem, trajectory))

    threads = [
        threading.Thread(target=judge, args=pair) for pair in (("good", good), ("slow", slow))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name, certificates in found.items():
        assert certificates == [alone[name]] * 15


def test_two_threads_plan_one_problem_as_one_does(post):
    problem, result = post
    found = []
    threads = [threading.Thread(target=lambda: found.append(plan(problem))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for other in found:
        np.testing.assert_array_equal(other.trajectory.coefficients, result.trajectory.coefficients)
        assert other.certificate == result.certificate
