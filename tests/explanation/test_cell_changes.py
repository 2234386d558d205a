"""Changes of obstacles, of what the tool carries, and of clearances load and do what they say."""

import numpy as np
import pytest

from asked_problems import POST, asked, made, the
from tubeplanner.explanation.cell_changes import cell_changes, clearance_changes, obstacle_changes

PAIR = {"links": ["link2", "post.1"], "clearance": 0.02}
BAR = {"name": "bar", "box": [0.02, 0.02, 0.02], "position": [0.1, 0.0, 0.1]}


def test_an_obstacle_is_moved_along_each_axis_whatever_its_name():
    ball = {"name": "ball", "sphere": 0.05}
    question = asked({"obstacles": [POST, ball]})
    changes = list(obstacle_changes(question))
    assert len(changes) == 12
    change = the(changes, "obstacles.post.1.position", "in -y")
    assert (change.before, change.about) == (POST["position"], {"obstacle post.1"})
    assert change.propose(0.15).text == "move obstacle 'post.1' by 150 mm in -y"
    assert change.propose(0.15).after == [0.4, 0.07, 0.0]
    before, after = (each.obstacles for each in (question.load(), made(question, change, 0.15)))
    moved = [b.shapes[0].center - a.shapes[0].center for a, b in zip(before, after, strict=True)]
    np.testing.assert_allclose(moved, [[0, -0.15, 0], [0, 0, 0]], atol=1e-12)
    # Where a file does not say, it is at the origin.
    other = the(changes, "obstacles.ball.position", "in +z")
    assert other.before == [0, 0, 0]
    assert made(question, other, 0.2).obstacles[1].shapes[0].center.tolist() == [0, 0, 0.2]


def test_what_the_tool_carries_is_moved_in_its_frame():
    question = asked({"robot.attached": [BAR]})
    change = the(cell_changes(question), "robot.attached.bar.position", "in +x")
    assert (change.kind, change.about) == ("attached", {"link bar"})
    text = "move attached solid 'bar' by 30 mm in +x of the tool frame"
    assert change.propose(0.03).text == text
    (solid,) = made(question, change, 0.03).attached
    np.testing.assert_allclose(solid.shapes[0].center, [0.13, 0, 0.1])


@pytest.mark.parametrize("way", [-1, 1])
def test_the_clearance_is_one_number(way):
    question = asked({"clearance": 0.01236})
    (change,) = clearance_changes(question, way)
    assert (change.field, change.before, change.about) == ("clearance", 0.01236, frozenset())
    assert made(question, change, 0.005).clearance == pytest.approx(0.01236 + way * 0.005)
    if way < 0:
        assert made(question, change, 0.0124).clearance == 0  # the largest size, rounded up


def test_each_number_of_a_map_of_clearances_is_changed_alone():
    given = {"default": 0.01, "pairs": [PAIR], "segments": [0.03, None, 0.0]}
    question = asked({"clearance": given})
    changes = {each.field: each for each in clearance_changes(question, -1)}
    default, pair, first = changes.values()
    assert list(changes) == [
        *("clearance.default", "clearance.pairs.0.clearance", "clearance.segments.0"),
    ]
    assert made(question, default, 0.004).clearance == 0.006
    assert {"link link2", "obstacle post.1"} <= pair.about
    assert list(made(question, pair, 0.004).pair_clearances.values()) == [0.016]
    assert pair.propose(0.004).text == "clearance of link2 and post.1 20 -> 16 mm"
    assert first.about == {"segment 0"}
    narrower = made(question, first, 0.004)
    np.testing.assert_allclose(narrower.tube.clearance, [0.026, np.inf, 0])
    assert narrower.clearance == 0.01
    assert first.propose(0.004).text == "clearance of segment 0 30 -> 26 mm"
    assert [each.field for each in clearance_changes(question, 1)] == [
        *(*changes, "clearance.segments.2"),
    ]


def test_a_clearance_of_nothing_can_only_grow():
    assert list(clearance_changes(asked(), -1)) == []
    (change,) = clearance_changes(asked(), 1)
    assert change.scale == 0.1
    assert made(asked(), change, 0.05).clearance == 0.05
