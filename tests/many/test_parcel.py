"""Problems packed for other processes: robot and scene apart, and unpacked once."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner.files.fingerprint import problem_hash
from tubeplanner.many import parcel as parcel_module
from tubeplanner.many.parcel import Packer, read_reply, reply


@pytest.fixture
def post(bundled):
    return bundled("two_link/around_a_post")


@pytest.fixture(autouse=True)
def knows_none(monkeypatch):
    monkeypatch.setattr(parcel_module, "_known", {})


def narrower(problem, share):
    return replace(problem, tube=replace(problem.tube, radius=share * problem.tube.radius))


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def test_what_is_unpacked_is_what_was_packed(post):
    packed = sent(Packer().pack(post))
    assert problem_hash(packed.unpacked()) == problem_hash(post)
    assert packed.unpacked().name == post.name


def test_problems_of_one_scene_share_it_there_too(post):
    packer = Packer()
    one, other = (sent(packer.pack(narrower(post, share))).unpacked() for share in (0.9, 0.8))
    assert one.scene is other.scene
    assert one.robot is other.robot is one.scene.robot
    np.testing.assert_array_equal(other.tube.radius, 0.8 * post.tube.radius)


def test_the_scene_is_pickled_once_and_apart(post, bundled):
    packer = Packer()
    one, other = packer.pack(post), packer.pack(narrower(post, 0.9))
    assert one.scene is other.scene
    assert len(one.content) < len(one.scene)
    assert packer.pack(bundled("ur5/over_the_wall")).scene_hash != one.scene_hash


def test_other_solids_are_another_scene(post):
    packer = Packer()
    one = sent(packer.pack(post)).unpacked()
    other = sent(packer.pack(replace(post, obstacles=()))).unpacked()
    assert len(one.scene.obstacles) == 1
    assert len(other.scene.obstacles) == 0


def test_of_many_scenes_the_latest_are_kept(post, monkeypatch):
    monkeypatch.setattr(parcel_module, "_KEPT", 2)
    packer = Packer()
    first, second, third = (packer.pack(replace(post, clearance=c)) for c in (0.0, 0.001, 0.002))
    packs = [replace(first, scene_hash=name) for name in "abc"]
    scene = packs[0].unpacked().scene
    packs[1].unpacked()
    assert packs[0].unpacked().scene is scene  # used again: the other is the oldest now
    packs[2].unpacked()
    assert list(parcel_module._known) == ["a", "c"]
    assert {second.scene_hash, third.scene_hash} == {first.scene_hash}


def test_an_answer_gets_robot_and_scene_of_the_sender(post):
    there = sent(Packer().pack(post)).unpacked()
    packed = reply({"problem": there, "robot": there.robot, "more": [1]}, there)
    answer = read_reply(packed, post)
    assert answer["robot"] is post.robot
    assert answer["problem"].scene is post.scene
    assert answer["more"] == [1]
    assert len(packed) < len(pickle.dumps(there)) / 2
