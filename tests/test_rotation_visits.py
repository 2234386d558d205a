"""The rotation's least margin for all t, against dense evaluation and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tubeplanner import JointTrajectory, PlanningProblem, Seed, Tube, verify
from tubeplanner.enclosure import enclosed_pose
from tubeplanner.rotation_visits import least_rotation_margin
from tubeplanner.tube_visits import Visit, tube_visits

INF = np.inf


def pose_of(robot, motion):
    return enclosed_pose(robot, motion, 1e-8, 1e-9)


def wavy(robot, seed, pieces=4, width=0.1):
    """Return cubics that wander about, continuous in position only."""
    rng = np.random.default_rng(seed)
    n = robot.joint_count
    first = np.clip(rng.uniform(-1, 1, n), robot.limits.lower_position, robot.limits.upper_position)
    knots = first + np.cumsum(rng.uniform(-0.3, 0.35, (pieces + 1, n)), axis=0)
    bend = rng.uniform(-3, 3, (pieces, n))
    slope = np.diff(knots, axis=0) / width - bend * width
    coefficients = np.stack([bend, slope, knots[:-1]])
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), coefficients)


def margins(robot, tube, motion, t, segment):
    rotation, hand = robot.tool_pose(motion.position(t))
    return tube.rotation.margin(rotation, hand, segment)


def around(robot, motion, seed, tolerance, reach=0.2):
    """Return a tube near the hand whose reference turns along; its nearest points pass the ends."""
    rng = np.random.default_rng(seed)
    rotation, hand = robot.tool_pose(motion.position(np.array([0.0, 0.2, 0.4])))
    points = hand + rng.uniform(-reach, reach, (3, 3))
    off = Rotation.from_rotvec(rng.normal(scale=0.4, size=(3, 3)))
    quaternions = (Rotation.from_matrix(rotation) * off).as_quat()
    return Tube(points, 9.0, orientations=quaternions, rotation_tolerance=tolerance)


TOLERANCES = {
    "angles": [0.5, 1.2],
    "triples": [[0.4, 0.7, INF], [INF, INF, 0.3]],
    "wide": [[3.0, 2.0, 2.5], 3.0],
}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", TOLERANCES)
def test_the_least_margin_is_bracketed(name, seed, robot):
    motion = wavy(robot, seed)
    tube = around(robot, motion, seed, TOLERANCES[name])
    visits = [Visit(0, 0.0, 0.23), Visit(1, 0.23, motion.duration)]
    least = least_rotation_margin(tube.rotation, pose_of(robot, motion), visits)
    t = np.linspace(0, motion.duration, 40_001)
    early, late = t[t <= 0.23], t[t >= 0.23]
    true = min(
        margins(robot, tube, motion, early, 0).min(), margins(robot, tube, motion, late, 1).min()
    )
    assert least.lower_bound <= true + 1e-9
    assert least.attained >= true - 2e-5
    assert least.attained - least.lower_bound <= max(1e-6, 0.02 * abs(least.attained) + 3e-7)
    here = margins(robot, tube, motion, np.array([least.time]), least.segment)
    assert here[0] == pytest.approx(least.attained, abs=1e-6)
    assert least.intervals < 20_000


@pytest.mark.parametrize("seed", range(4))
def test_touching_a_bound_is_decided(seed, ur5):
    """The bound is set to the largest value the motion takes: contact without crossing."""
    motion = wavy(ur5, seed)
    wide = around(ur5, motion, seed, [[3.0, INF, INF], INF])
    visit = [Visit(0, 0.0, motion.duration)]
    pose, used = pose_of(ur5, motion), 3.0
    for _ in range(4):
        again = Tube(
            wide.points,
            9.0,
            orientations=wide.orientations,
            rotation_tolerance=[[used, INF, INF], INF],
        )
        least = least_rotation_margin(again.rotation, pose, visit)
        used -= least.attained
    assert -1e-6 < least.lower_bound <= least.attained < 1e-6
    assert least.intervals < 3000
