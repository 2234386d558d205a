"""What helps nothing, in few words."""

import pytest

from tubeplanner.explanation.in_vain_text import in_vain_text


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        (["tube.radius"], "radius of the tube as a whole (up to eleven times)"),
        (["tube.radius.2"], "radius of segment 2 (up to eleven times)"),
        (
            ["tube.radius.3", "clearance", "tube.radius.0", "tube.radius.1", "tube.radius.2"],
            "radius of segments 0-3 (up to eleven times); clearance (down to 0)",
        ),
        (
            ["tube.points.0", "tube.points.2", "tube.points.3"],
            "reference points 0, 2-3 (moved by up to 1 m)",
        ),
        (["obstacles.post.1.position"], "obstacle post.1 (moved by up to 1 m)"),
        (
            [f"obstacles.{name}.position" for name in "abc"],
            "obstacles a, b, c (moved by up to 1 m)",
        ),
        (
            [f"robot.limits.effort.joint{k}" for k in range(4)],
            "effort of 4 joints (up to eleven times)",
        ),
        (["tube.joint_signs.elbow"], "sign of elbow (any other)"),
        (["clearance.default"], "clearance (down to 0)"),
        (["clearance.segments.1"], "clearance of segment 1 (down to 0)"),
        (["clearance.pairs.0.clearance"], "clearance of pair 0 (down to 0)"),
        (["tube.rotation_tolerance.0"], "rotation tolerance of segment 0 (up to 3 rad more)"),
        (["goal.joints", "start.joints"], "goal (each joint by up to 1 rad or m); start (each "
         "joint by up to 1 rad or m)"),
        (["some.other"], "some.other"),
        ([], ""),
    ],
)  # fmt: skip
def test_changes_of_one_kind_are_told_together(paths, text):
    assert in_vain_text(paths) == text
