"""Notes on a plan: contact at its ends, least time of its path, jerk, gain of the second stage."""

import numpy as np

from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.limits.motor_costs import EffortCosts, effort_variation
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import ENERGY, SMOOTHNESS, START, Objective
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Overlaps where a motion begins or ends in contact.

_MIN_DEPTH = 1e-4  # [m]: less comes of rough geometry and rounding


def contact_notes(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return notes on solids that overlap in contact at start or goal by more than 0.1 mm.

    Args:
        problem: The planning problem.
        trajectory: The problem's answer.
    """
    checker = problem.collision
    times = {True: 0.0, False: trajectory.duration}
    notes = {}
    for contact in problem.contacts:
        pairs = checker.pairs[checker.between(*contact.links)]
        for end in contact.ends:
            q = trajectory.position(times[end == START])
            rotation, position = problem.robot.body_poses(q[None])
            depth = -float(np.min(checker.distances(rotation[0], position[0], pairs)))
            if depth > _MIN_DEPTH:
                first, second = contact.links
                key = (end, frozenset(contact.links))
                notes[key] = (
                    f"at the {end} '{first}' and '{second}' overlap by {1000 * depth:.3g} mm, as "
                    "their contact allows; if that is not meant, move one of them"
                )
    return tuple(notes.values())


# ---- The least time of a path by motors that switch instantly.
#
# Libraries that plans do not need are imported on first use.

_GRID_POINTS = 1600
# Points of the path nearer to each other than this fraction of its length count as one: rounding
# errors between them would look like curvature.
_APART = 1e-6


def path_minimum(problem: PlanningProblem, trajectory: JointTrajectory) -> float | None:
    """Return the least time [s] for the path of a trajectory, from rest to rest.

    Under the limits of velocity, acceleration, effort, motors and tool speed at up to 1,600 points
    of the path, jerk and effort rate unlimited: good to about 0.1 %; less where segments with
    different tool speeds overlap, since the loosest counts. With viscous friction or torque-speed
    lines it is an upper bound on the least time; on the paths of bundled problems, a fine search of
    the phase plane has no time that is 0.2 % less.

    Args:
        problem: The planning problem.
        trajectory: The path's trajectory, of the problem's joints in their order.

    Returns:
        The time, or None if the path has no length or the solver no solution.
    """
    from tubeplanner.first_guess.fastest_parameterization import fastest_parameterization

    if not trajectory.coefficients[:-1].any():
        return None
    from scipy.interpolate import CubicSpline

    # Points at equal times are close together wherever the trajectory rests: there the path begins,
    # ends, or has a corner.
    q = trajectory.position(np.linspace(0, trajectory.duration, _GRID_POINTS))
    arc_length = arc_lengths(q)
    _, apart = np.unique(np.floor(arc_length / (_APART * arc_length[-1])), return_index=True)
    spline = CubicSpline(arc_length[apart] / arc_length[apart[-1]], q[apart])
    path = JointTrajectory(trajectory.joint_names, spline.x, spline.c)
    timing = fastest_parameterization(problem, path, path.breakpoints, at_both_ends=False)
    return None if timing is None else timing.duration


# ---- The largest jerk, and the gain of the second stage.


def largest_jerk(
    robot: RobotModel, trajectory: JointTrajectory, *, unlimited: bool = False
) -> tuple[float, str]:
    """Return a trajectory's largest jerk [rad/s^3 or m/s^3], and its message with the joint.

    Args:
        robot: The arm.
        trajectory: A cubic of the arm's joints, in their order.
        unlimited: True: only joints without limits of jerk and effort rate count.
    """
    peak = abs(trajectory.derivative_coefficients(3)).max(axis=(0, 1))
    if unlimited:
        limit = np.minimum(robot.limits.jerk, robot.limits.effort_rate)
        peak = np.where(np.isfinite(limit), 0.0, peak)
    joint = int(peak.argmax())
    unit = "rad/s^3" if robot.revolute[joint] else "m/s^3"
    return float(peak[joint]), f"{peak[joint]:.2g} {unit} ('{robot.joint_names[joint]}')"


def jerk_note(robot: RobotModel, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return a note on a shortest motion's jerk, if some joint has no limit of jerk or effort rate.

    Args:
        robot: The arm.
        trajectory: A cubic of the arm's joints, in their order.
    """
    peak, words = largest_jerk(robot, trajectory, unlimited=True)
    if not peak > 0:
        return ()
    return (
        "without a jerk limit, the shortest motion's jerk grows with the square of the number of "
        f"knots ({len(trajectory.widths)}): here up to {words}",
    )


def gain_note(problem: PlanningProblem, before: JointTrajectory, after: JointTrajectory) -> str:
    """Return the note on the gain of the second stage, by the problem's objective.

    Args:
        problem: The planning problem.
        before: The shortest motion.
        after: The second stage's motion.
    """
    objective, robot = problem.objective or Objective(), problem.robot
    if objective.minimise == SMOOTHNESS:
        done = "smoothed"
        jerks = [largest_jerk(robot, trajectory)[1] for trajectory in (after, before)]
        gain = f"largest jerk {jerks[0]}"
        gain += "" if jerks[0] == jerks[1] else f" instead of {jerks[1]}"
        if effort_variation(robot, before, before).any():  # none: the links have no masses
            swings = []
            for trajectory in (after, before):
                variation = effort_variation(robot, trajectory, before)
                joint = int(variation.argmax())
                is_limited = bool(np.isfinite(robot.limits.effort[joint]))
                unit = "limits" if is_limited else "times the largest effort of the shortest motion"
                swings.append(f"{variation[joint]:.1f} {unit} ('{robot.joint_names[joint]}')")
            gain = f"largest effort swing {swings[0]} instead of {swings[1]}, {gain}"
    else:
        costs = [EffortCosts(robot, trajectory) for trajectory in (after, before)]
        if objective.minimise == ENERGY:
            weights = objective.energy_weights(robot)
            values = [cost.energy(weights) for cost in costs]
            unit = "with the given weights" if objective.weights else "limits^2 s"
            what = "integral of the squared efforts"
        else:
            values, unit, what = [cost.work() for cost in costs], "J", "work of the motors"
        is_less = values[0] < values[1]
        gain = f"{what} {values[0]:.4g} instead of {values[1]:.4g} {unit}"
        if not any(values):
            is_less, gain = False, f"{what} zero, as the links have no masses"
        done = f"{objective.minimise} {'saved' if is_less else 'not saved'}"
    takes, least = f"{after.duration:.4f} s", f"{before.duration:.4f} s"
    times = f"{takes}, as long as the shortest"
    if takes != least:
        times = f"{takes}; the shortest is {least} (--slack 0)"
    return f"{done}: {times}; {gain}"
