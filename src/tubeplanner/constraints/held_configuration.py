"""Whether the motors can hold an arm, and let it leave: at rest, gravity and friction count."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.coulomb_friction import directed_friction
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.problem.problem import PlanningProblem


def require_held(problem: PlanningProblem, q: FloatArray) -> None:
    """Check that every joint can be moved slowly in one direction or the other, or is held at all.

    Args:
        problem: The planning problem.
        q: A configuration, shape (n,).

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    directions = [_needed_and_allowed(problem, q, direction) for direction in (1.0, -1.0)]
    beyond = np.array([(needed - allowed).max(axis=0) for needed, allowed in directions])
    joint = int(beyond.min(axis=0).argmax())
    if (beyond[:, joint] <= 0).any():
        return
    needed, allowed = directions[int(beyond[:, joint].argmin())]
    side = int((needed - allowed)[:, joint].argmax())
    still = np.zeros_like(q)
    at = PathSamples(problem, np.stack([q, still, still])[:, None])
    raise effort_refusal(at, 0, joint, float(needed[side, joint]), float(allowed[side, joint]))


def _needed_and_allowed(
    problem: PlanningProblem, q: FloatArray, direction: float
) -> tuple[FloatArray, FloatArray]:
    """Return what joints need forwards and backwards when they creep in a direction, (2, n).

    And what motors have.
    """
    robot, stall = problem.robot, problem.robot.motors.saturation_effort
    gravity = robot.gravity_effort(q[None])
    friction = directed_friction(robot.motors, np.full_like(gravity, direction))
    sides = [robot.limits.effort_at(q[None], way) for way in (1.0, -1.0)]
    needed = np.concatenate([gravity + friction.most, -gravity - friction.least])
    return needed, np.minimum(np.concatenate(sides), stall)
