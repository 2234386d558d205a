"""A motion of a thousandth of the size takes as long, if the limits shrink with it."""

import numpy as np
import pytest

from cases import SHORTEST
from gantry import gantry
from tubeplanner import load_problem, plan

# To and fro past corners nearer to each other than the tube is wide, then away: a path with phases
# of very different lengths [m].
POINTS = 0.1 + np.array(
    [[0.0, 0.0, -0.1], [0.2, 0.01, -0.1], [0.16, 0.03, -0.1], [0.24, 0.05, -0.1], [0.3, 0.3, -0.1]]
)
ACCELERATION, JERK = 4.0, np.array([30.0, 60.0])  # [m/s^2], [m/s^3]


def problem(folder, scale, points=POINTS):
    """Return the problem of that size: all lengths times the scale, from the same first point."""
    limits = {
        "effort": dict.fromkeys(("along", "across"), float("inf")),
        "velocity": dict.fromkeys(("along", "across"), float("inf")),
        "acceleration": dict.fromkeys(("along", "across"), ACCELERATION * scale),
        "jerk": dict(zip(("along", "across"), (JERK * scale).tolist(), strict=True)),
    }
    points = POINTS[0] + scale * (points - POINTS[0])
    fields = {
        "robot": {"urdf": "gantry.urdf", "tool_frame": "head", "limits": limits},
        "tube": {"points": points.tolist(), "radius": 0.05 * scale},
        "start": {"joints": points[0, :2].tolist()},
        "goal": {"joints": points[-1, :2].tolist()},
    }
    return load_problem(gantry(folder, **fields))


@pytest.mark.parametrize("scale", [0.1, 0.01, 0.001])
def test_it_takes_as_long(tmp_path, scale):
    large, small = (plan(problem(tmp_path, size), SHORTEST) for size in (1.0, scale))
    assert large.succeeded and small.succeeded
    assert small.duration == pytest.approx(large.duration, rel=5e-3)


def test_it_takes_as_long_backwards(tmp_path):
    there, back = (
        plan(problem(tmp_path, 0.001, points), SHORTEST) for points in (POINTS, POINTS[::-1])
    )
    assert there.duration == pytest.approx(back.duration, rel=5e-3)
