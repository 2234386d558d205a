"""Paths of a problem, moved from one folder to another."""

import copy
from pathlib import Path

import pytest

from tubeplanner.problem.path_fields import move_paths


def moved(fields):
    result = copy.deepcopy(fields)
    move_paths(result, Path("/cells/one"), Path("/plans"))
    return result


def test_every_path_is_moved():
    fields = {
        "include": ["table.yaml", "../rail.yaml"],
        "robot": {
            "urdf": "arm.urdf",
            "srdf": "arm.srdf",
            "limits_file": "limits.yaml",
            "package_dirs": ["packages", ".."],
            "preset": ["fr3", "mine.yaml"],
            "attached": [{"name": "part", "mesh": "part.stl"}],
        },
        "tube": {"points": "path.csv"},
        "start": {"trajectory": "last.json"},
        "goal": {"trajectory": "home.csv"},
        "obstacles": [{"name": "wall", "box": [1, 1, 1]}, {"name": "bin", "mesh": "m/bin.obj"}],
    }
    at = "../cells/one"
    assert moved(fields) == {
        "include": [f"{at}/table.yaml", "../cells/rail.yaml"],
        "robot": {
            "urdf": f"{at}/arm.urdf",
            "srdf": f"{at}/arm.srdf",
            "limits_file": f"{at}/limits.yaml",
            "package_dirs": [f"{at}/packages", "../cells"],
            "preset": ["fr3", f"{at}/mine.yaml"],
            "attached": [{"name": "part", "mesh": f"{at}/part.stl"}],
        },
        "tube": {"points": f"{at}/path.csv"},
        "start": {"trajectory": f"{at}/last.json"},
        "goal": {"trajectory": f"{at}/home.csv"},
        "obstacles": [
            {"name": "wall", "box": [1, 1, 1]},
            {"name": "bin", "mesh": f"{at}/m/bin.obj"},
        ],
    }


@pytest.mark.parametrize(
    ("path", "there"),
    [
        ("arm.urdf", "../cells/one/arm.urdf"),
        ("example:ur5", "example:ur5"),
        ("package://arms/arm.urdf", "package://arms/arm.urdf"),
        ("/arms/arm.urdf", "/arms/arm.urdf"),
        ("file:///arms/part.stl", "file:///arms/part.stl"),
        ("file://part.stl", "file://../cells/one/part.stl"),
    ],
)
def test_what_is_no_relative_path_stays(path, there):
    assert moved({"robot": {"urdf": path}}) == {"robot": {"urdf": there}}


@pytest.mark.parametrize(
    "fields",
    [
        {"include": "a.yaml"},
        {"robot": {"preset": "a.yaml"}},
    ],
)
def test_one_or_a_list_are_the_same(fields):
    assert "../cells/one/a.yaml" in str(moved(fields))


@pytest.mark.parametrize("preset", ["fr3", "frr3", "arm.2", ["fer", "fr3"]])
def test_a_preset_without_an_ending_is_a_name(preset):
    assert moved({"robot": {"preset": preset}}) == {"robot": {"preset": preset}}


@pytest.mark.parametrize(
    "fields",
    [
        [],
        {"robot": 3, "tube": [], "obstacles": "none", "include": 3},
        {"robot": {"urdf": 3, "attached": [3], "package_dirs": [None]}, "tube": {"points": [[1]]}},
        {"obstacles": [[], {"mesh": None}], "robot": {"preset": [3]}},
    ],
)
def test_what_is_no_path_where_one_should_be_stays(fields):
    assert moved(fields) == fields


def test_what_is_at_two_places_is_moved_once():
    part = {"mesh": "part.stl"}
    fields = {"obstacles": [part, part]}
    move_paths(fields, Path("/cells"), Path("/plans"))
    assert fields["obstacles"] == [{"mesh": "../cells/part.stl"}] * 2
