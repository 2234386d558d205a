"""A file's own fields, changed so that with what it includes they say what is wanted."""

import copy

import pytest

from tubeplanner.files.own_fields import change_own
from tubeplanner.problem.field_paths import changed_fields
from tubeplanner.problem.merged_fields import merged_fields
from tubeplanner.problem.problem_format import ProblemFields
from tubeplanner.problem.schema_place import SchemaPlace

BELOW = {
    "robot": {"urdf": "a", "payload": {"mass": 1, "com": [0, 0, 1]}},
    "obstacles": [{"name": "a", "sphere": 1}, {"name": "b", "position": [1, 2, 3]}],
}
OWN = {"clearance": 0.1, "obstacles": [{"name": "b", "sphere": 2}, {"name": "c", "sphere": 3}]}


@pytest.mark.parametrize(
    ("path", "value", "written"),
    [
        ("clearance", 0.2, {"clearance": 0.2}),
        ("robot.payload.mass", 5, {"robot": {"payload": {"mass": 5}}}),
        ("robot.payload.com.1", 5, {"robot": {"payload": {"com": [0, 5, 1]}}}),
        ("robot.payload", None, {"robot": {"payload": None}}),
        ("robot.limits.velocity", 2, {"robot": {"limits": {"velocity": 2}}}),
        (
            "obstacles.a.sphere",
            "x2",
            {"obstacles": [*OWN["obstacles"], {"name": "a", "sphere": 2}]},
        ),
        (
            "obstacles.b.position.0",
            9,
            {
                "obstacles": [
                    {"name": "b", "sphere": 2, "position": [9, 2, 3]},
                    {"name": "c", "sphere": 3},
                ]
            },
        ),
        ("robot.urdf", "a", {}),
    ],
)
def test_only_what_is_changed_is_written(path, value, written):
    own, merged = copy.deepcopy(OWN), merged_fields(BELOW, OWN)
    wanted = changed_fields(merged, {path: value}, SchemaPlace.of(ProblemFields))
    change_own(own, merged, wanted)
    assert own == OWN | written
    assert merged_fields(BELOW, own) == wanted
