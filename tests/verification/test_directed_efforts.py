"""Intervals in which joints move one way: they cover the motion, each with what holds there."""

import numpy as np
import pytest
from directed_samples import random_motion, random_motors

from tubeplanner.trajectory.directed_stretches import directed_stretches
from tubeplanner.verification.directed_efforts import directed_efforts
from tubeplanner.verification.enclosed_efforts import enclosed_efforts

INSIDE = np.linspace(0, 1, 23)


@pytest.fixture(params=range(4))
def known(request):
    """An arm, its motion in pieces of several widths, and the efforts of some joints."""
    robot = request.getfixturevalue(["two_link", "slide", "ur5", "panda"][request.param])
    rng = np.random.default_rng(request.param)
    arm = random_motors(robot, rng)
    motion = random_motion(arm, rng, breakpoints=(0.0, 0.35, 0.4, 0.62, 1.0))
    smooth = enclosed_efforts(arm, motion, 1e-8 * arm.limits.effort)
    joints = np.arange(request.param % 2, arm.joint_count)
    found = directed_efforts(arm, motion, smooth, directed_stretches(motion), joints)
    return arm, motion, joints, found


def values(rows):
    """Return polynomials (N, R) at places inside their intervals, shape (23, R)."""
    return np.array([np.polyval(rows, u) for u in INSIDE])


def states(motion, found):
    """Return position, velocity and acceleration of all joints there, each (23 R, n)."""
    middle = found.start + found.width / 2
    piece = np.tile(np.searchsorted(motion.breakpoints, middle) - 1, len(INSIDE))
    time = (found.start + INSIDE[:, None] * found.width).ravel()
    return [motion.within(piece, time - motion.breakpoints[piece], order) for order in range(3)]


def own(found, columns):
    """Return what belongs to the joint of each interval, (23, R), of values (23 R, n)."""
    rows = columns.reshape(len(INSIDE), len(found.joint), -1)
    return np.take_along_axis(rows, found.joint[None, :, None], axis=2)[:, :, 0]


def test_they_cover_the_motion_of_every_joint(known):
    _, motion, joints, found = known
    for joint in joints:
        mine = found.joint == joint
        start, end = found.start[mine], (found.start + found.width)[mine]
        np.testing.assert_allclose(end[:-1], start[1:], atol=1e-12)
        assert start[0] == 0
        assert end[-1] == pytest.approx(motion.duration)
    assert set(found.joint) == set(joints)


def test_each_has_what_holds_there(known):
    """Directions are those of the velocities, wherever these are not next to none."""
    arm, motion, _, found = known
    q, v, a = states(motion, found)
    np.testing.assert_allclose(values(found.position), own(found, q), atol=1e-9)
    np.testing.assert_allclose(values(found.velocity), own(found, v), atol=1e-8)
    velocity = values(found.velocity)
    clear = abs(velocity) > 1e-6
    lasting = found.width > 1e-9
    sign = np.sign(np.where(clear, velocity, 0.0))[:, lasting]
    way = np.sign(sign.sum(axis=0))
    np.testing.assert_array_equal(sign * way >= 0, True)
    motors, joint = arm.motors, found.joint[lasting]
    dry = np.where(way > 0, motors.forwards_friction[joint], -motors.backwards_friction[joint])
    smooth = own(found, arm.inverse_dynamics(q, v, a))[:, lasting]
    moving = way != 0
    effort, unsure = values(found.effort)[:, lasting], values(found.unsure)[:, lasting]
    scale = arm.limits.effort[joint]
    np.testing.assert_allclose((effort / scale)[:, moving], ((smooth + dry) / scale)[:, moving],
                               atol=2e-8)  # fmt: skip
    friction = abs(motors.viscous_friction[joint] * velocity[:, lasting] + dry)
    expected = motors.friction_uncertainty * friction
    np.testing.assert_allclose((unsure / scale)[:, moving], (expected / scale)[:, moving],
                               atol=1e-7)  # fmt: skip


def test_no_corner_of_a_table_is_inside_one(known):
    arm, _, _, found = known
    passed = 0
    for table in arm.limits.effort_ranges:
        q = values(found.position)[:, (found.joint == table.joint) & (found.width > 1e-9)]
        for corner in table.position:
            assert not ((q > corner + 1e-8).any(axis=0) & (q < corner - 1e-8).any(axis=0)).any()
            passed += ((q[0] < corner) & (abs(q[-1] - corner) < 1e-8)).sum()
    assert passed or 0 not in found.joint
