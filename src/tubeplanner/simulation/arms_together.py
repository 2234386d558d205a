"""Arms that are moved by one call for all, in as many threads as there are processors."""

import os
from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.simulation.mujoco_model import MujocoArm


class ArmsTogether:
    """R arms, which move as each alone would, however many threads there are.

    Where joints rub, they differ from arms alone by rounding: MuJoCo's solver, which finds the
    friction, then begins anew in every call.
    """

    def __init__(self, arms: Sequence[MujocoArm]) -> None:
        """Take arms of one robot, at least one, where they are."""
        from mujoco import MjData, mjtState
        from mujoco.rollout import Rollout

        self._models = [arm.model for arm in arms]
        self._degrees, self._bias = arms[0].degrees, np.array([arm.bias for arm in arms])
        self._state = np.array([arm.state for arm in arms])
        self._given = int(mjtState.mjSTATE_QFRC_APPLIED)
        threads = min(len(arms), os.cpu_count() or 1)
        self._work_space = [MjData(arms[0].model) for _ in range(threads)]
        self._pool = Rollout(nthread=threads if threads > 1 else 0)

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    @property
    def position(self) -> FloatArray:
        """Positions of the joints, shape (R, n) [rad or m]."""
        return np.array(self._state[:, 1 + self._degrees])

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the joints, shape (R, n) [rad/s or m/s]."""
        return np.array(self._state[:, 1 + len(self._degrees) + self._degrees])

    def move(self, effort: FloatArray, runs: IntArray) -> None:
        """Move on some arms, as `MujocoArm.step` does, by S steps with efforts (S, R, n)."""
        if len(runs) == 0:
            return
        steps = len(effort)
        given = np.empty((len(runs), steps, len(self._degrees)))
        given[:, :, self._degrees] = (effort - self._bias)[:, runs].swapaxes(0, 1)
        moved = np.empty((len(runs), steps, self._state.shape[1]))
        self._pool.rollout(
            [self._models[run] for run in runs.tolist()],
            self._work_space,
            self._state[runs],
            given,
            control_spec=self._given,
            skip_checks=True,
            nstep=steps,
            state=moved,
            chunk_size=-(-len(runs) // len(self._work_space)),
        )
        self._state[runs] = moved[:, -1]
