"""Where the bodies of an arm are, in many configurations at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.native.kinematics import native_body_poses
from tubeplanner.native.library import LIBRARY


@dataclass(frozen=True, eq=False)
class BodyChain:
    """Bodies that hang from each other; body 0 stands still, joint k moves body k + 1.

    Attributes:
        parents: Which body carries each, shape (bodies,).
        rotation: Of each body in its parent, its joint at zero, shape (bodies, 3, 3).
        position: Of its origin there, shape (bodies, 3) [m].
        axes: Of the joints, in the frames of the bodies that they move, shape (M, 3).
        turns: Whether a joint turns (rather than slides), shape (M,).
    """

    parents: IntArray
    rotation: FloatArray
    position: FloatArray
    axes: FloatArray
    turns: BoolArray

    @staticmethod
    def of(
        parents: IntArray, placements: Sequence[FloatArray], axes: FloatArray, turns: BoolArray
    ) -> "BodyChain":
        """Return bodies whose poses in their parents, joints at zero, are transforms (4, 4)."""
        placed = np.array(placements)
        return BodyChain(parents, placed[:, :3, :3].copy(), placed[:, :3, 3].copy(), axes, turns)

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, bodies, 3, 3) and origins (N, bodies, 3) [m] at positions (N, M)."""
        if LIBRARY.functions is not None:
            return native_body_poses(self._own_table, q)
        shape = (len(q), len(self.parents))
        rotation, position = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        rotation[:, 0], position[:, 0] = np.eye(3), 0.0
        turned, moved = self._in_parents(q)
        for body, parent in enumerate(self.parents.tolist()):
            if body > 0:
                carrier = rotation[:, parent]
                np.matmul(carrier, turned[:, body - 1], out=rotation[:, body])
                shift = carrier @ moved[:, body - 1, :, None]
                np.add(position[:, parent], shift[:, :, 0], out=position[:, body])
        return rotation, position

    def line(self, bodies: IntArray, rotation: FloatArray, position: FloatArray) -> "BodyChain":
        """Return the chain of some bodies, each of which carries the next, and of a fixed frame.

        Args:
            bodies: Their indices, from the base on, shape (k,).
            rotation: Of the frame in the last of them, shape (3, 3).
            position: Likewise, shape (3,) [m].
        """
        kept = np.append(0, bodies)
        return BodyChain(
            parents=np.append(0, np.arange(len(kept))),
            rotation=np.concatenate([self.rotation[kept], [rotation]]),
            position=np.concatenate([self.position[kept], [position]]),
            axes=np.concatenate([self.axes[bodies - 1], np.zeros((1, 3))]),
            turns=np.append(self.turns[bodies - 1], True),
        )

    def joint_table(
        self, planned: IntArray, multiplier: FloatArray, offset: FloatArray
    ) -> FloatArray:
        """Return the joints as `native.kinematics` takes them, shape (M, 41).

        Args:
            planned: Which of n joints each is or follows, shape (M,).
            multiplier: How fast it follows, shape (M,).
            offset: Where it is when that joint is at 0, shape (M,) [rad or m].
        """
        across, twice, along = self._by_joint
        numbers = [self.parents[1:], planned, self.turns, multiplier, offset]
        vectors = [self.position[1:], self.axes, along]
        turned = [matrix.reshape(-1, 9) for matrix in (self.rotation[1:], across, twice)]
        return np.column_stack([*numbers, *vectors, *turned]).astype(np.float64)

    @cached_property
    def _own_table(self) -> FloatArray:
        joints = np.arange(len(self.turns))
        return self.joint_table(joints, np.ones(len(joints)), np.zeros(len(joints)))

    def _in_parents(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (N, M, 3, 3) and origins (N, M, 3) of bodies in their parents."""
        across, twice, along = self._by_joint
        angle, travel = np.where(self.turns, q, 0.0), np.where(self.turns, 0.0, q)
        sine, rest = np.sin(angle)[..., None, None], 1 - np.cos(angle)[..., None, None]
        turned = self.rotation[1:] + sine * across + rest * twice  # Rodrigues
        return turned, self.position[1:] + travel[..., None] * along

    @cached_property
    def _by_joint(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """By which a body's rotation changes with sine and 1 - cosine, and its origin by travel."""
        across = np.cross(self.axes[:, None], np.eye(3)).swapaxes(1, 2)
        placed = self.rotation[1:]
        along = np.einsum("mij,mj->mi", placed, self.axes)
        return placed @ across, placed @ across @ across, along
