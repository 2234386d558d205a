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
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.spline_start import knot_grid

SWITCHING_TIMES = np.array([0.0, 0.4, 1.0])


def limited(robot_name):
    """Return an arm with every kind of limit."""
    tool = {"two_link": "hand", "ur5": "tool0", "panda": "panda_hand_tcp"}[robot_name]
    plain = load_robot(f"example:{robot_name}", tool)
    names = plain.joint_names
    return load_robot(
        f"example:{robot_name}",
        tool,
        gravity=(0, 0, -9.81) if robot_name != "two_link" else (0, 0, 0),
        limits=LimitOverrides(
            acceleration=dict.fromkeys(names, 15.0),
            jerk=dict.fromkeys(names[:1], 400.0),
            effort_rate=dict.fromkeys(names[1:], 300.0),
            velocity_by_position={
                name: {"deceleration": 3.0 + k, "offset": 0.1 * k, "lower": -4.0, "upper": 3.5}
                for k, name in enumerate(names)
            },
            point_speed=[
                PointSpeed(tool, (0.1, -0.2, 0.05), 0.7),
                PointSpeed(plain.urdf.joints[names[1]].child, (0.0, 0.1, 0.3), 0.4),
            ],
        ),
    )


@pytest.fixture(scope="module", params=["ur5"])
def case(request):
    robot = limited(request.param)
    grid = knot_grid(SWITCHING_TIMES, 10)
    rng = np.random.default_rng(1)
    start = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])[: robot.joint_count]
    points = start + np.cumsum(
        rng.uniform(-0.1, 0.15, (grid.control_point_count, robot.joint_count)), axis=0
    )
    points[:3], points[-3:] = points[0], points[-1]
    tool = robot.tool_position(points[[0, 6, -1]])
    middle = robot.tool_position(points[[5]])[0] + np.array([0.0, 0.0, 0.06])
    ball = Obstacle.sphere("ball", 0.05, placement_of(middle))
    turned = Rotation.from_matrix(robot.tool_pose(points[[0, 6, -1]])[0]).as_quat()
    bounds = [0.3, [0.2, np.inf, 0.4]]
    tube = Tube(
        tool, [0.1, 0.2], orientations=turned, rotation_tolerance=bounds, tool_speed=[0.6, 0.9]
    )
    problem = PlanningProblem(robot, tube, points[0], obstacles=[ball], clearance=0.01)
    return (
        problem,
        PhasedSpline(grid, SWITCHING_TIMES, points),
        grid.samples(np.array([0.2, 0.7])),
    )
