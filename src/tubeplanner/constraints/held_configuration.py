"""Whether the motors can hold an arm, and let it leave: at rest, gravity and friction count."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.coulomb_friction import directed_friction
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.problem.problem import PlanningProblem

_HALVINGS = 40  # of the payload's mass


def require_held(problem: PlanningProblem, q: FloatArray, *, is_given: bool = False) -> None:
    """Check that every joint can be moved slowly in one direction or the other, or is held at all.

    Args:
        problem: The planning problem.
        q: A configuration, shape (n,).
        is_given: Whether every trajectory has it: there is none for certain then, and the message
            says which payload would be held.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    gravity = problem.robot.gravity_effort(q[None])
    directions = _both_directions(problem, q, gravity)
    beyond = _beyond(directions)
    joint = int(beyond.min(axis=0).argmax())
    if (beyond[:, joint] <= 0).any():
        return
    needed, allowed = directions[int(beyond[:, joint].argmin())]
    side = int((needed - allowed)[:, joint].argmax())
    still = np.zeros_like(q)
    at = PathSamples(problem, np.stack([q, still, still])[:, None])
    needed_most, allowed_most = float(needed[side, joint]), float(allowed[side, joint])
    mass = _held_mass(problem, q, gravity) if is_given else None
    raise effort_refusal(at, 0, joint, needed_most, allowed_most, mass=mass, proved=is_given)


def _held_mass(problem: PlanningProblem, q: FloatArray, gravity: FloatArray) -> float | None:
    """Return the heaviest payload that all joints hold [kg], None if there is none.

    Efforts (1, n) against gravity are affine in its mass.
    """
    payload = problem.robot.payload
    if payload is None:
        return None
    empty = problem.robot.with_payload(None).gravity_effort(q[None])

    def is_held(share: float) -> bool:
        held = _both_directions(problem, q, empty + share * (gravity - empty))
        return bool((_beyond(held).min(axis=0) <= 0).all())

    if not is_held(0.0):
        return None
    held, not_held = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (held + not_held) / 2
        held, not_held = (middle, not_held) if is_held(middle) else (held, middle)
    return float(held * payload.mass)


_Efforts: TypeAlias = tuple[FloatArray, FloatArray]


def _both_directions(
    problem: PlanningProblem, q: FloatArray, gravity: FloatArray
) -> list[_Efforts]:
    return [_needed_and_allowed(problem, q, gravity, direction) for direction in (1.0, -1.0)]


def _beyond(directions: Sequence[_Efforts]) -> FloatArray:
    """Return by how much each joint needs more than it has in each direction, (2, n)."""
    return np.array([(needed - allowed).max(axis=0) for needed, allowed in directions])


def _needed_and_allowed(
    problem: PlanningProblem, q: FloatArray, gravity: FloatArray, direction: float
) -> _Efforts:
    """Return what joints need forwards and backwards when they creep in a direction, (2, n).

    And what motors have.
    """
    robot, stall = problem.robot, problem.robot.motors.saturation_effort
    friction = directed_friction(robot.motors, np.full_like(gravity, direction))
    sides = [robot.limits.effort_at(q[None], way) for way in (1.0, -1.0)]
    needed = np.concatenate([gravity + friction.most, -gravity - friction.least])
    return needed, np.minimum(np.concatenate(sides), stall)
