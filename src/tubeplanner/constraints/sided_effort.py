"""Efforts as sides bound them: of each joint forwards and then backwards, with its friction.

Upwards bounded is the most that a joint may need, downwards the least: where friction is uncertain,
or its direction about to change, these differ.
"""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples


class SidedEffort:
    """The efforts of some joints on both sides, 2 I quantities [N m or N].

    Attributes:
        joints: Whose they are, twice, shape (2 I,).
        way: 1 forwards, -1 backwards, shape (2 I,).
    """

    def __init__(self, joints: IntArray) -> None:
        """Take I joints."""
        self.joints = np.tile(joints, 2)
        self.way = np.repeat([1.0, -1.0], len(joints))

    def terms(self, at: PathSamples) -> dict[int, FloatArray]:
        """Return them at any speed, by its powers: friction of the worse kind that it may have."""
        still, moving = at.gravity + at.viscous_effort, at.effort
        unsure = at.problem.robot.motors.friction_uncertainty * abs(at.viscous_effort)
        dry = self._dry(at, 0)
        return {
            0: self.way * (at.gravity[:, self.joints] + dry),
            1: self.way * at.viscous_effort[:, self.joints] + unsure[:, self.joints],
            2: self.way * (moving - still)[:, self.joints],
        }

    def by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return how they change with the path at a speed, (N, 2 I, n) each."""
        motors = at.problem.robot.motors
        blocks = enumerate(at.effort_derivatives(speed))
        change = {k: by[:, self.joints] * (speed**k * self.way[:, None]) for k, by in blocks}
        unsure = motors.friction_uncertainty * motors.viscous_friction * speed
        by_rate = (unsure * np.sign(at.by_path[1]))[:, self.joints] + self.way * self._dry(at, 1)
        every = np.arange(len(self.joints))
        change[1][:, every, self.joints] += by_rate
        return change

    def _dry(self, at: PathSamples, what: int) -> FloatArray:
        """Return Coulomb friction (0) or how it changes with dq/dx (1), shape (N, 2 I)."""
        half = len(self.joints) // 2
        sides = [at.coulomb_friction.side(way)[what][:, self.joints[:half]] for way in (1.0, -1.0)]
        return np.concatenate(sides, axis=1)
