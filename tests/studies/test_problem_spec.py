"""ProblemSpec: a document ready to travel; content hashes of problem, files, options, package."""

import os
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from small_cycle import SMALL

import tubeplanner
from tubeplanner import Cycle, PlanOptions, ProblemError, ProblemSpec, load_problem
from tubeplanner.documents import parse_yaml
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.resources import bundled_folder
from tubeplanner.studies import problem_spec as hashing
from tubeplanner.studies import problem_spec as posed_problem
from tubeplanner.studies.problem_spec import content_hash, document_hash, package_hash

URDF = """<robot name="arm">
  <link name="base"><collision><geometry><mesh filename="base.stl"/></geometry></collision></link>
  <link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="20" velocity="2"/></joint>
</robot>
"""
PROBLEM = """
robot:
  urdf: arm.urdf
  tool_frame: tip
  preset: motors.yaml
  attached: [{name: held, mesh: held.stl}]
obstacles: [{name: part, mesh: part.stl, position: [1, 0, 0]}]
tube: {points: points.csv, radius: 0.05}
start: {trajectory: before.json}
"""
FILES = {
    **{"arm.urdf": URDF, "base.stl": "solid base", "held.stl": "solid held"},
    **{"part.stl": "solid part", "points.csv": "0, 0, 0\n0, 1, 0\n", "before.json": "{}"},
    "motors.yaml": "limits: {effort: {turn: 3}}\n",
}
FAST = PlanOptions(quality="fast")
POST = "example:two_link/around_a_post"


@pytest.fixture(autouse=True)
def knows_none(monkeypatch):
    monkeypatch.setattr(posed_problem, "_cells", {})


@pytest.fixture
def folder(tmp_path):
    where = tmp_path / "problem"
    where.mkdir()
    for name, text in FILES.items():
        (where / name).write_text(text)
    return where


def document():
    return parse_yaml(PROBLEM)


def hash_in(folder, held=None):
    return content_hash(document() if held is None else held, folder, FAST)


@pytest.mark.parametrize("name", FILES)
def test_what_a_file_holds_counts_and_whether_it_is_there(folder, name):
    before, path = hash_in(folder), folder / name
    path.write_text(path.read_text().replace("0", "1").replace("solid", "SOLID") + " ")
    assert hash_in(folder) != before
    path.write_text(FILES[name].swapcase())  # of the same size
    os.utime(path, ns=(1, 1))
    if path.suffix not in {".urdf", ".csv", ".json"}:
        assert hash_in(folder) != before
    path.unlink()
    assert hash_in(folder) != before
    path.write_text(FILES[name])
    assert hash_in(folder) == before


def test_neither_folder_nor_date_nor_names_nor_the_order_of_keys_count(folder):
    before = hash_in(folder)
    for name in FILES:
        os.utime(folder / name, ns=(0, 0))
    assert hash_in(folder) == before
    moved = folder.with_name("elsewhere")
    shutil.move(folder, moved)
    assert hash_in(moved) == before
    turned = dict(reversed(document().items()))
    turned["robot"] = dict(reversed(turned["robot"].items()))
    assert hash_in(moved, turned) == before
    (moved / "part.stl").rename(moved / "other.stl")
    renamed = document()
    renamed["obstacles"][0]["mesh"] = "other.stl"
    assert hash_in(moved, renamed) == before


def test_every_field_counts_and_options_and_our_sources(folder, monkeypatch):
    before = hash_in(folder)
    for change in ({"clearance": 0.01}, {"tube": {"points": "points.csv", "radius": 0.06}}):
        assert hash_in(folder, document() | change) != before
    moved = document()
    moved["obstacles"][0]["position"] = [1, 0, 0.001]
    assert hash_in(folder, moved) != before
    assert content_hash(document(), folder, replace(FAST, slack=0.0)) != before
    assert document_hash(document(), folder) == document_hash(document(), folder)
    for held in (None, [], {"robot": 3}, {"robot": {"package_dirs": 7, "urdf": []}}):
        assert len(hash_in(folder, held)) == 32  # what is no problem has a hash too
    held = document()
    hash_in(folder, held)
    assert held == document()  # it is not changed
    monkeypatch.setattr(hashing, "package_hash", lambda: "another version")
    assert hash_in(folder) != before


def test_our_sources_and_presets_are_read(tmp_path, monkeypatch):
    copy = tmp_path / "tubeplanner"
    (copy / "many").mkdir(parents=True)
    (copy / "__init__.py").write_text("")
    (copy / "many" / "one.py").write_text("ONE = 1\n")
    monkeypatch.setattr(tubeplanner, "__file__", str(copy / "__init__.py"))
    presets = {"arm": tmp_path / "arm.yaml"}
    presets["arm"].write_text("limits: {}\n")
    monkeypatch.setattr(hashing, "bundled_presets", lambda: presets)
    found = [package_hash.__wrapped__()]
    for path, text in (
        (copy / "many" / "one.py", "ONE = 2\n"),
        (presets["arm"], "limits: {effort: 3}\n"),
        (copy / "many" / "one.pyc", "compiled"),
    ):
        path.write_text(text)
        found.append(package_hash.__wrapped__())
    assert len(set(found[:3])) == 3
    assert found[2] == found[3]


@pytest.mark.parametrize("dirs", [["share"], {"cell": "share/cell"}], ids=["list", "map"])
def test_a_mesh_in_a_package_is_found(folder, dirs):
    held = document()
    held["robot"]["package_dirs"] = dirs
    held["obstacles"][0]["mesh"] = "package://cell/part.stl"
    (folder / "share" / "cell").mkdir(parents=True)
    (folder / "share" / "cell" / "part.stl").write_text(FILES["part.stl"])
    before = hash_in(folder, held)
    assert before == hash_in(folder)
    (folder / "share" / "cell" / "part.stl").write_text("solid other")
    assert hash_in(folder, held) != before


def test_the_files_of_a_cycle_count(folder):
    held = parse_yaml(SMALL)
    held["moves"][0]["tube"]["points"] = "points.csv"
    held["moves"][2]["shape"] = {"mesh": "part.stl"}
    for name in ("points.csv", "part.stl"):
        before = hash_in(folder, held)
        (folder / name).write_text("another")
        assert hash_in(folder, held) != before


def test_bundled_problems_differ():
    names = ("two_link/around_a_post", "two_link/paper_1_30mm", "ur5/over_the_wall")
    assert len({ProblemSpec.read(f"example:{n}").content_hash(FAST) for n in names}) == 3


def test_a_cycle_is_loaded_as_one_and_changed_as_one(tmp_path):
    (tmp_path / "small.yaml").write_text(SMALL)
    spec = ProblemSpec.read("small.yaml", tmp_path)
    cycle = spec.load()
    assert isinstance(cycle, Cycle)
    assert cycle.name == spec.name == f"{tmp_path.name}/small"
    with pytest.raises(ProblemError, match=r"unknown key 'widths'.*radius"):
        spec.changed({"moves.over.tube.widths": 0.06})
    wider = spec.changed({"moves.over.tube.radius": 0.06}).load()
    np.testing.assert_array_equal(wider.steps[0].tube.radius, 0.06)


def test_what_a_file_includes_is_read_too(tmp_path):
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "cell.yaml").write_text("include: example:two_link/around_a_post\n")
    (tmp_path / "mine.yaml").write_text("include: below/cell.yaml\ntube: {radius: 0.02}\n")
    problem = ProblemSpec.read("mine.yaml", tmp_path).load()
    np.testing.assert_array_equal(problem.tube.radius, 0.02)
    assert len(problem.obstacles) == 1


def test_it_poses_what_load_problem_reads_with_the_same_changes(bundled):
    spec = ProblemSpec.read(POST)
    assert spec == pickle.loads(pickle.dumps(spec))
    assert spec.load().name == spec.name == "two_link/around_a_post"
    changes = {"tube.radius": "x0.5", "obstacles.post.position": [0.5, 0.3, 0]}
    expected = load_problem(POST, changes=changes)
    assert problem_hash(spec.changed(changes).load()) == problem_hash(expected)
    assert problem_hash(spec.load()) == problem_hash(bundled("two_link/around_a_post"))
    with pytest.raises(ProblemError, match=r"tube\.width"):
        spec.changed({"tube.width": 1.0})
    with pytest.raises(ProblemError, match=r"two_link/around_a_post.*radius"):
        spec.changed({"tube.radius": -1.0}).load()


def test_robot_and_solids_are_built_once():
    spec = ProblemSpec.read(POST)
    one, other = spec.load(), spec.changed({"tube.radius": "x0.5"}).load()
    assert one.robot is other.robot
    assert one.scene is other.scene
    moved = spec.changed({"obstacles.post.position": [0.5, 0.3, 0]}).load()
    assert moved.scene is not one.scene
    effort = one.robot.limits.effort
    given = dict(zip(one.robot.joint_names, (2 * effort).tolist(), strict=True))
    stronger = spec.changed({"robot.limits.effort": given}).load()
    np.testing.assert_array_equal(stronger.robot.limits.effort, 2 * effort)


def test_of_many_cells_those_used_last_are_kept(monkeypatch):
    monkeypatch.setattr(posed_problem, "_MAX_CELLS", 2)
    spec = ProblemSpec.read(POST)
    moved = [spec.changed({"obstacles.post.position": [0.5, y, 0]}) for y in (0.3, 0.4)]
    robot = spec.load().robot
    moved[0].load()
    assert spec.load().robot is robot  # used again: the other is the oldest now
    moved[1].load()
    assert spec.load().robot is robot
    assert len(posed_problem._cells) == 2


def test_a_mesh_that_changes_is_read_again(tmp_path, bundled):
    shutil.copy(bundled_folder() / "ur5" / "part.stl", tmp_path / "part.stl")
    (tmp_path / "mine.yaml").write_text(
        f"include: {POST}\nobstacles: [{{name: part, mesh: part.stl, position: [0, 0, -1]}}]\n"
    )
    spec = ProblemSpec.read(tmp_path / "mine.yaml")
    before = spec.load()
    assert spec.load().scene is before.scene
    trimesh.load(tmp_path / "part.stl").apply_scale(0.5).export(tmp_path / "part.stl")
    after = spec.load()
    assert after.scene is not before.scene
    parts = [next(s for s in p.obstacles if s.name == "part") for p in (before, after)]
    extent = [np.ptp(part.shapes[0].vertices, axis=0) for part in parts]
    np.testing.assert_allclose(extent[1], 0.5 * extent[0])
