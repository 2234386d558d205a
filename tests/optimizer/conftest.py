"""An arm with every kind of limit, a spline of it, and samples: what constraints are tested on."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tubeplanner import (
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    PointSpeed,
    Tube,
    load_robot,
    placement_of,
)
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.starts import knot_grid

SWITCHING_TIMES = np.array([0.0, 0.4, 1.0])


@pytest.fixture(scope="module")
def limited(ur5):
    """An arm with every kind of limit."""
    names = ur5.joint_names
    laws = {
        name: {"deceleration": 3.0 + k, "offset": 0.1 * k, "lower": -4.0, "upper": 3.5}
        for k, name in enumerate(names)
    }
    points = [
        PointSpeed("tool0", (0.1, -0.2, 0.05), 0.7),
        PointSpeed(ur5.urdf.joints[names[1]].child, (0.0, 0.1, 0.3), 0.4),
    ]
    limits = LimitOverrides(
        acceleration=dict.fromkeys(names, 15.0),
        jerk=dict.fromkeys(names[:1], 400.0),
        effort_rate=dict.fromkeys(names[1:], 300.0),
        velocity_by_position=laws,
        point_speed=points,
    )
    return load_robot("example:ur5", "tool0", limits=limits)


@pytest.fixture(scope="module")
def case(limited):
    grid, rng = knot_grid(SWITCHING_TIMES, 10), np.random.default_rng(1)
    start = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0])
    steps = rng.uniform(-0.1, 0.15, (grid.control_point_count, 6))
    points = start + np.cumsum(steps, axis=0)
    points[:3], points[-3:] = points[0], points[-1]
    rotation, tool = limited.tool_pose(points[[0, 6, -1]])
    middle = limited.tool_position(points[[5]])[0] + np.array([0.0, 0.0, 0.06])
    ball = Obstacle.sphere("ball", 0.05, placement_of(middle))
    turns = {
        "orientations": Rotation.from_matrix(rotation).as_quat(),
        "rotation_tolerance": [0.3, [0.2, np.inf, 0.4]],
    }
    tube = Tube(tool, [0.1, 0.2], tool_speed=[0.6, 0.9], tool_acceleration=[7.0, 5.0], **turns)
    problem = PlanningProblem(limited, tube, points[0], obstacles=[ball], clearance=0.01)
    samples = grid.samples(np.array([0.2, 0.7]))
    return problem, PhasedSpline(grid, SWITCHING_TIMES, points), samples
