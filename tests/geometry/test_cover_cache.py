"""The cache changes times, never answers, and nothing that happens to it is an error."""

import io
from pathlib import Path

import numpy as np
import platformdirs
import pytest
import trimesh
from arms import axle

from tubeplanner.geometry.collision_checker import CollisionChecker, link_covers
from tubeplanner.geometry.meshes import MeshFile
from tubeplanner.resources import CACHE_VARIABLE, cache_folder


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder for the cache."""
    position = tmp_path / "cache"
    monkeypatch.setenv(CACHE_VARIABLE, str(position))
    return position


@pytest.fixture
def ring(tmp_path):
    """A mesh file; each access is a new object, so that nothing is remembered."""
    path = tmp_path / "ring.stl"
    trimesh.creation.annulus(0.1, 0.2, 0.05, sections=40).export(path)
    return lambda: MeshFile("link 'ring'", path)


@pytest.fixture
def uncomputed(monkeypatch):
    """Makes covering a mesh an error."""

    def fail(mesh):
        raise AssertionError("computed again")

    return lambda: monkeypatch.setattr("tubeplanner.geometry.meshes.cover_mesh", fail)


def assert_same(first, second):
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_array_equal(one.faces, other.faces)
        np.testing.assert_array_equal(one.thinning.corners, other.thinning.corners)
        assert (one.radius, one.thinning.growth) == (other.radius, other.thinning.growth)


def spoiled(entry):
    """Yield an entry's content cut short, with a bit turned, as plain arrays, and as noise."""
    whole = entry.read_bytes()
    yield from (b"", b"noise", whole[: len(whole) // 2], whole[:40])
    yield whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:]
    foreign = io.BytesIO()
    np.savez(foreign, vertices=np.zeros((1, 3)), counts=np.array([10**15]))
    yield foreign.getvalue()
    pickled = io.BytesIO()
    np.savez(pickled, vertices=np.array([Path.unlink], dtype=object))
    yield pickled.getvalue()


def test_what_is_read_back_is_what_was_computed(folder, ring, uncomputed):
    cold, error = ring().cover(), ring().outer_error()
    assert len(list(folder.glob("cover-*"))) == 1
    uncomputed()
    assert_same(ring().cover(), cold)
    assert ring().outer_error() == error > 0


def test_an_arm_is_the_same_with_a_cold_warm_broken_and_no_cache(folder, tmp_path, monkeypatch):
    arm = axle(tmp_path, sections=8)
    cold, warm = CollisionChecker(arm), CollisionChecker(arm)
    for entry in folder.iterdir():
        entry.write_bytes(entry.read_bytes()[:-1])
    broken = CollisionChecker(arm)
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert cold.closer_covers
    for other in (warm, broken, CollisionChecker(arm)):
        assert_same([each.shape for each in cold.shapes], [each.shape for each in other.shapes])
        np.testing.assert_array_equal(cold.pairs, other.pairs)
        assert cold.left_out == other.left_out
        assert link_covers(cold) == link_covers(other)


def test_an_entry_that_is_not_as_it_was_written_is_replaced(folder, ring):
    cold = ring().cover()
    (entry,) = folder.glob("cover-*")
    whole = entry.read_bytes()
    for content in spoiled(entry):
        entry.write_bytes(content)
        assert_same(ring().cover(), cold)
        assert entry.read_bytes() == whole


def test_a_folder_or_an_entry_of_something_else_in_the_place_of_an_entry_is_no_error(folder, ring):
    """A whole entry under another's name: what it holds is not what is asked for."""
    cold = ring().cover()
    (entry,) = folder.glob("cover-*")
    MeshFile("link 'ring'", ring().path, 2.0).cover()
    (other,) = set(folder.glob("cover-*")) - {entry}
    entry.write_bytes(other.read_bytes())
    assert_same(ring().cover(), cold)
    entry.unlink()
    entry.mkdir()
    assert_same(ring().cover(), cold)


def test_the_folder_is_the_users_unless_there_is_none_or_it_is_switched_off(
    ring, monkeypatch, tmp_path
):
    monkeypatch.delenv(CACHE_VARIABLE)
    for path, expected in ((tmp_path / "none", tmp_path / "none"), (Path("~/.cache"), None)):
        monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, path=path, **__: path)
        assert cache_folder() == expected
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path / "none")
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert cache_folder() is None
    ring().cover()
    assert not (tmp_path / "none").exists()


def test_another_mesh_or_scale_is_another_entry_and_a_moved_mesh_is_the_same(
    folder, ring, tmp_path, uncomputed
):
    first = ring().cover()
    MeshFile("link 'ring'", ring().path, 2.0).cover()
    target = ring().path.rename(tmp_path / "moved.stl")
    trimesh.creation.box([0.1, 0.1, 0.1]).export(ring().path)
    assert len(ring().cover()[0].vertices) == 8 != len(first[0].vertices)
    assert len(list(folder.glob("cover-*"))) == 3
    uncomputed()
    assert_same(MeshFile("another link", target).cover(), first)


def test_what_a_killed_process_or_a_write_that_fails_left_is_removed(folder, ring, monkeypatch):
    cold = ring().cover()
    (entry,) = folder.glob("*")
    entry.rename(entry.with_name(f".{entry.name}.tmp"))
    assert_same(ring().cover(), cold)
    assert list(folder.iterdir()) == [entry]
    entry.unlink()

    def full(self, target):
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert_same(ring().cover(), cold)
    assert not list(folder.iterdir())


def test_a_folder_that_cannot_be_made_is_no_error(ring, monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv(CACHE_VARIABLE, str(blocked / "cache"))
    assert ring().cover()
