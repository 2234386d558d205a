"""Problems as their files hold them: read, changed, loaded with what this process knows."""

import pickle
import shutil

import numpy as np
import pytest
import trimesh

from small_cycle import SMALL
from tubeplanner import Cycle, PosedProblem, ProblemError, load_problem
from tubeplanner.files.fingerprint import problem_hash
from tubeplanner.many import posed_problem
from tubeplanner.resources import bundled_folder

POST = "example:two_link/around_a_post"


@pytest.fixture(autouse=True)
def knows_none(monkeypatch):
    monkeypatch.setattr(posed_problem, "_known", {})


def test_it_poses_what_load_problem_reads():
    posed = PosedProblem.read(POST)
    assert problem_hash(posed.load()) == problem_hash(load_problem(POST))
    assert posed.load().name == posed.name == "two_link/around_a_post"
    assert posed == pickle.loads(pickle.dumps(posed))


def test_a_cycle_is_loaded_as_one_and_changed_as_one(tmp_path):
    (tmp_path / "small.yaml").write_text(SMALL)
    posed = PosedProblem.read("small.yaml", tmp_path)
    cycle = posed.load()
    assert isinstance(cycle, Cycle)
    assert cycle.name == posed.name == f"{tmp_path.name}/small"
    with pytest.raises(ProblemError, match=r"unknown key 'widths'.*radius"):
        posed.changed({"moves.over.tube.widths": 0.06})
    wider = posed.changed({"moves.over.tube.radius": 0.06}).load()
    np.testing.assert_array_equal(wider.steps[0].tube.radius, 0.06)


def test_what_a_file_includes_is_read_too(tmp_path):
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "cell.yaml").write_text("include: example:two_link/around_a_post\n")
    (tmp_path / "mine.yaml").write_text("include: below/cell.yaml\ntube: {radius: 0.02}\n")
    problem = PosedProblem.read("mine.yaml", tmp_path).load()
    np.testing.assert_array_equal(problem.tube.radius, 0.02)
    assert len(problem.obstacles) == 1


def test_changes_are_those_of_set():
    posed = PosedProblem.read(POST)
    narrow = posed.changed({"tube.radius": "x0.5", "obstacles.post.position": [0.5, 0.3, 0]})
    expected = load_problem(
        POST, changes={"tube.radius": "x0.5", "obstacles.post.position": [0.5, 0.3, 0]}
    )
    assert problem_hash(narrow.load()) == problem_hash(expected)
    assert problem_hash(posed.load()) == problem_hash(load_problem(POST))


def test_a_change_that_leads_nowhere_is_named():
    with pytest.raises(ProblemError, match=r"tube\.width"):
        PosedProblem.read(POST).changed({"tube.width": 1.0})


def test_what_contradicts_its_format_is_named():
    with pytest.raises(ProblemError, match=r"two_link/around_a_post.*radius"):
        PosedProblem.read(POST).changed({"tube.radius": -1.0}).load()


def test_robot_and_solids_are_built_once():
    posed = PosedProblem.read(POST)
    one, other = posed.load(), posed.changed({"tube.radius": "x0.5"}).load()
    assert one.robot is other.robot
    assert one.scene is other.scene
    moved = posed.changed({"obstacles.post.position": [0.5, 0.3, 0]}).load()
    assert moved.scene is not one.scene
    effort = one.robot.limits.effort
    given = dict(zip(one.robot.joint_names, (2 * effort).tolist(), strict=True))
    stronger = posed.changed({"robot.limits.effort": given}).load()
    np.testing.assert_array_equal(stronger.robot.limits.effort, 2 * effort)


def test_of_many_cells_those_used_last_are_kept(monkeypatch):
    monkeypatch.setattr(posed_problem, "_KEPT", 2)
    posed = PosedProblem.read(POST)
    moved = [posed.changed({"obstacles.post.position": [0.5, y, 0]}) for y in (0.3, 0.4)]
    robot = posed.load().robot
    moved[0].load()
    assert posed.load().robot is robot  # used again: the other is the oldest now
    moved[1].load()
    assert posed.load().robot is robot
    assert len(posed_problem._known) == 2


def test_a_mesh_that_changes_is_read_again(tmp_path, bundled):
    shutil.copy(bundled_folder() / "ur5" / "part.stl", tmp_path / "part.stl")
    (tmp_path / "mine.yaml").write_text(
        f"include: {POST}\nobstacles: [{{name: part, mesh: part.stl, position: [0, 0, -1]}}]\n"
    )
    posed = PosedProblem.read(tmp_path / "mine.yaml")
    before = posed.load()
    assert posed.load().scene is before.scene
    smaller(tmp_path / "part.stl")
    after = posed.load()
    assert after.scene is not before.scene
    extent = [np.ptp(solid_of(p).shapes[0].vertices, axis=0) for p in (before, after)]
    np.testing.assert_allclose(extent[1], 0.5 * extent[0])


def solid_of(problem):
    return next(each for each in problem.obstacles if each.name == "part")


def smaller(path):
    mesh = trimesh.load(path)
    mesh.apply_scale(0.5)
    mesh.export(path)
