"""Two documents to one: maps by key, named lists by name, all else from the upper one."""

import pytest

from tubeplanner.problem.merged_fields import merged_fields

WALL, POST = {"name": "wall", "box": [1, 1, 1]}, {"name": "post", "sphere": 0.1}


@pytest.mark.parametrize(
    ("below", "above", "merged"),
    [
        ({"a": 1, "b": 2}, {"b": 3, "c": 4}, {"a": 1, "b": 3, "c": 4}),
        ({"r": {"s": {"x": 1, "y": 2}}}, {"r": {"s": {"y": 3}}}, {"r": {"s": {"x": 1, "y": 3}}}),
        ({"r": {"x": 1}}, {"r": None}, {"r": None}),
        ({"r": 2}, {"r": {"x": 1}}, {"r": {"x": 1}}),
        ([1, 2, 3], [4], [4]),
        ([WALL, POST], [{"name": "post", "sphere": 0.2}], [WALL, {"name": "post", "sphere": 0.2}]),
        ([WALL], [{"name": "wall", "box": None}, POST], [{"name": "wall", "box": None}, POST]),
        ([POST], [{"name": "post", "position": [1, 0, 0]}], [{**POST, "position": [1, 0, 0]}]),
        ([WALL], [], [WALL]),
        ([], [WALL], [WALL]),
        ([WALL], [{"sphere": 1}], [{"sphere": 1}]),
        ([{"link": "l"}], [{"link": "m"}], [{"link": "m"}]),
        ([{"name": 3}], [WALL], [WALL]),
    ],
)
def test_the_upper_one_wins(below, above, merged):
    assert merged_fields(below, above) == merged


def test_a_name_that_is_there_twice_stays_twice():
    """The check of the problem refuses it; merging would hide it."""
    twice = [WALL, {"name": "wall", "sphere": 1}]
    for below, above in ((twice, [WALL]), ([WALL], twice), ([POST], twice)):
        names = [item["name"] for item in merged_fields(below, above)]
        assert names.count("wall") == 2


def test_neither_document_is_changed():
    below, above = {"r": {"x": 1}, "o": [dict(WALL)]}, {"r": {"y": 2}, "o": [{"name": "wall"}]}
    merged_fields(below, above)["r"]["z"] = 3
    assert (below, above) == (
        {"r": {"x": 1}, "o": [WALL]},
        {"r": {"y": 2}, "o": [{"name": "wall"}]},
    )
