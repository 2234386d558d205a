"""Inverse kinematics of one tool position, optionally of its rotation, within joint bounds.

Damped least squares with the damping of Sugihara, "Solvability-unconcerned inverse kinematics by
the Levenberg-Marquardt method" (IEEE T-RO 27(5), 2011): it converges at a fully stretched arm, and
comes as near as possible to a point out of reach. The rotation comes second: it uses what the
position leaves, in the null space of its Jacobian. A third task pulls redundant joints towards a
preferred configuration, in the null space of both.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotations import inverse_right_jacobian, nearest_branch, rotation_vector

_DAMPING = 1e-10  # added to half the squared error [m^2]
_POSITION_TOLERANCE = 1e-10  # [m]
# The last step [rad or m]: the remaining error is of the order of its square.
_POSTURE_TOLERANCE = 1e-6
_MAX_ITERATIONS = 100
# Near full stretch a joint is all but redundant, and a pull on it would keep the tool from its
# target: later iterations go for the target alone.
_PULLED_ITERATIONS = 40
_MAX_STEP = 0.2  # [rad or m] of any joint
# Directions in which a joint moves the tool by less than this count as redundant [m/rad].
_REDUNDANT_GAIN = 1e-4
# A stretched arm cannot feel which way to fold: it is bent this much, one way, then the other.
_BENDS = (0.05, -0.05)  # [rad or m], its sign alternating from joint to joint


@dataclass(frozen=True, eq=False)
class WantedRotation:
    """The wanted orientation of the tool.

    Attributes:
        reference: Reference orientation, shape (3, 3), base frame.
        vector: Rotation vector wanted, in the reference's frame, shape (3,) [rad].
        components: Which of its components count: bool, shape (3,).
    """

    reference: FloatArray
    vector: FloatArray
    components: BoolArray


@dataclass(frozen=True, eq=False)
class PositionSolution:
    """The nearest the tool gets to a position.

    Attributes:
        q: Configuration within the bounds, shape (n,) [rad or m].
        error: Distance of the tool from the position [m].
        rotation_error: Distance of the rotation vector from the one wanted, in the components that
            count [rad].
    """

    q: FloatArray
    error: float
    rotation_error: float = 0.0


def solve_position(
    robot: RobotModel,
    target: FloatArray,
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray | None = None,
    rotation: WantedRotation | None = None,
) -> PositionSolution:
    """Move a configuration until the tool is at a position.

    Args:
        robot: The arm.
        target: Tool position, shape (3,), base frame [m].
        seed: Where to start, shape (n,) [rad or m].
        lower: Lower joint bounds, shape (n,).
        upper: Upper joint bounds, shape (n,).
        preferred: Where redundant joints go, shape (n,); default: back to the seed.
        rotation: Wanted orientation of the tool there; default: any.

    Returns:
        The solution; its errors say whether the target was reached.
    """
    descent = _Descent(robot, target, rotation, lower, upper)
    preferred = seed if preferred is None else preferred
    solution = descent.run(seed, preferred)
    pattern = (-1.0) ** np.arange(len(seed))
    for bend in _BENDS:
        if solution.error < _POSITION_TOLERANCE**0.5:
            break
        other = descent.run(solution.q + bend * pattern, preferred)
        solution = min(solution, other, key=lambda found: found.error)
    return solution


# Jacobian (c, n) and error (c,) of what a step should do.
_Task: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Descent:
    """From a seed to the target, by damped steps."""

    robot: RobotModel
    target: FloatArray
    rotation: WantedRotation | None
    lower: FloatArray
    upper: FloatArray

    def run(self, seed: FloatArray, preferred: FloatArray) -> PositionSolution:
        q = last = np.clip(seed, self.lower, self.upper)
        least = np.inf
        for iteration in range(_MAX_ITERATIONS):
            tasks = self._tasks(q)
            off, turned = _length(tasks[:1]), _length(tasks[1:])
            pulled = iteration < _PULLED_ITERATIONS
            if not pulled and off > max(least, _POSITION_TOLERANCE):
                q = (last + q) / 2  # a step beyond a target out of reach
                continue
            least, last = off, q
            pull = preferred - q if pulled else np.zeros_like(q)
            step = _step(tasks, pull, q, self.lower, self.upper)
            step *= min(1.0, _MAX_STEP / max(float(abs(step).max()), 1e-300))
            moved = np.clip(q + step, self.lower, self.upper) - q
            q = q + moved
            if abs(moved).max() < _POSTURE_TOLERANCE:
                break
            if not pulled and max(off, turned) < _POSITION_TOLERANCE:
                break
        tasks = self._tasks(q)
        return PositionSolution(q, _length(tasks[:1]), _length(tasks[1:]))

    def _tasks(self, q: FloatArray) -> list[_Task]:
        """Return the tasks at a configuration (n,), the position first."""
        rotation, position, jacobian = (part[0] for part in self.robot.tool_pose_jacobian(q[None]))
        tasks = [(jacobian[:3], self.target - position)]
        wanted = self.rotation
        if wanted is not None and wanted.components.any():
            vector = rotation_vector(wanted.reference.T @ rotation)
            vector = nearest_branch(vector, wanted.vector, wanted.components)
            turned = inverse_right_jacobian(vector) @ rotation.T @ jacobian[3:]
            error = wanted.vector - vector
            tasks.append((turned[wanted.components], error[wanted.components]))
        return tasks


def _length(tasks: list[_Task]) -> float:
    """Return the length of the errors of at most one task [m or rad]."""
    return float(np.sqrt(sum(float(error @ error) for _, error in tasks)))


def _step(
    tasks: list[_Task],
    pull: FloatArray,
    q: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> FloatArray:
    """Return a joint step; joints at a bound that it would push outwards are held still."""
    free = np.ones(len(q), dtype=bool)
    while True:
        step = np.zeros_like(q)
        step[free] = _free_step(
            [(jacobian[:, free], error) for jacobian, error in tasks], pull[free]
        )
        outward = free & (((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0)))
        if not outward.any():
            return step
        free &= ~outward


def _free_step(tasks: list[_Task], pull: FloatArray) -> FloatArray:
    """Return the step of joints without bounds: each task in the null space of those before."""
    if len(pull) == 0:
        return np.zeros(0)
    step = np.zeros_like(pull)
    used = np.zeros((0, len(pull)))
    for jacobian, error in tasks:
        remaining = jacobian - (jacobian @ used.T) @ used
        rest = error - jacobian @ step
        u, gain, v = np.linalg.svd(remaining, full_matrices=False)
        damping = 0.5 * float(error @ error) + _DAMPING
        step = step + v.T @ (gain / (gain**2 + damping) * (u.T @ rest))
        used = np.vstack([used, v[gain > _REDUNDANT_GAIN]])
    return step + pull - used.T @ (used @ pull)
