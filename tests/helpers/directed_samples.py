"""Efforts with friction at dense samples of random motions, written out."""

import numpy as np
from cases import with_motors

from tubeplanner import JointTrajectory
from tubeplanner.robot.effort_range import EffortRange

SHARES = np.linspace(0, 1, 2001)


def random_motors(robot, rng):
    """Return the robot with motors of all kinds, some of its joints with tables and pairs."""
    n, effort = robot.joint_count, robot.limits.effort
    tables = [
        EffortRange(0, np.sort(rng.uniform(-2, 2, 4)), *(effort[0] * rng.uniform(1, 5, (2, 4)))),
        EffortRange(1, np.zeros(1), *(effort[1] * rng.uniform(1, 5, (2, 1)))),
    ]
    return with_motors(
        robot,
        effort_ranges=tables,
        armature=rng.uniform(0, 0.1, n),
        viscous_friction=rng.uniform(0, 0.1, n) * effort,
        backwards_friction=rng.uniform(0, 0.5, n) * effort,
        forwards_friction=rng.uniform(0, 0.5, n) * effort,
        saturation_effort=rng.uniform(1, 3, n) * effort,
        no_load_velocity=rng.uniform(2, 5, n),
        friction_uncertainty=rng.uniform(0, 0.3),
    )


def random_motion(robot, rng, breakpoints=(0.0, 0.2, 0.4, 0.6, 0.8)):
    """Return quintics that jump at breakpoints; joints reverse inside the pieces."""
    scale = np.array([60.0, 30.0, 20.0, 8.0, 1.0, 1.5])[:, None, None]
    rows = scale * rng.uniform(-1, 1, (6, len(breakpoints) - 1, robot.joint_count))
    return JointTrajectory(robot.joint_names, breakpoints, rows)


def samples(robot, trajectory):
    """Return positions, velocities, efforts and what friction may change, dense, both sides.

    Beside the even samples of every piece, both one-sided limits where a joint reverses, and the
    instants at which one passes a corner of its table: at an instant, directions are those of
    just before and just after.
    """
    motors, states = robot.motors, [[] for _ in range(5)]
    for piece, width in enumerate(trajectory.widths):
        rows = trajectory.coefficients[:, piece]
        at = [SHARES * width]
        for joint in range(robot.joint_count):
            polynomials = [np.polyder(np.poly1d(rows[:, joint]))]
            polynomials += [
                np.poly1d(rows[:, joint]) - corner
                for table in robot.limits.effort_ranges
                if table.joint == joint
                for corner in table.position
            ]
            roots = np.concatenate([polynomial.roots for polynomial in polynomials])
            real = roots[abs(roots.imag) < 1e-9].real
            at.append(real[(real > 0) & (real < width)])
        time = np.sort(np.concatenate(at))
        values = []
        for order in range(3):
            column = [np.poly1d(rows[:, j]).deriv(order)(time) for j in range(robot.joint_count)]
            values.append(np.array(column).T)
        beside = np.clip(time[:, None] + np.array([-1e-7, 1e-7]), 0, width)
        smooth = robot.inverse_dynamics(*values)
        for side in beside.T:
            ahead = np.array(
                [np.poly1d(rows[:, j]).deriv()(side) for j in range(robot.joint_count)]
            ).T
            dry = np.where(ahead > 0, motors.forwards_friction, -motors.backwards_friction)
            friction = motors.viscous_friction * values[1] + dry
            unsure = motors.friction_uncertainty * abs(friction)
            new = (values[0], values[1], smooth + dry, unsure)
            for state, value in zip(states, new, strict=False):
                state.append(value)
    return [np.concatenate(state) for state in states[:4]]


def worst_use(robot, trajectory):
    """Return the largest share of the effort limits that a sample uses."""
    q, _, effort, unsure = samples(robot, trajectory)
    most = robot.limits.effort
    used = []
    for way in (1, -1):
        allowed = np.broadcast_to(most, q.shape).copy()
        for table in robot.limits.effort_ranges:
            side = table.forwards if way > 0 else table.backwards
            allowed[:, table.joint] = np.interp(q[:, table.joint], table.position, side)
        used.append(1 + (way * effort + unsure - allowed) / most)
    return float(np.max(used))


def worst_curve_use(robot, trajectory):
    """Return the largest share of the torque-speed lines that a sample uses."""
    _, v, effort, unsure = samples(robot, trajectory)
    motors = robot.motors
    share = v / motors.no_load_velocity
    return float(
        max(
            np.max((way * effort + unsure) / motors.saturation_effort + way * share)
            for way in (1, -1)
        )
    )
