"""A start or goal as a pose of the tool."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.collision.obstacle import MAX_SIZE
from tubeplanner.errors import ProblemError, shown
from tubeplanner.short_repr import short_repr

_ORTHONORMAL = 1e-6  # how far a rotation matrix may be from one, by rounding


@dataclass(frozen=True, eq=False)
class ToolPose:
    """A pose of the tool centre point, taken on the branch that the tube's joint ranges ask for.

    Attributes:
        placement: Shape (4, 4), base frame [m], as `placement_of` returns.
        seed: Where inverse kinematics begins, (n,) in group order or a map by joint name [rad or
            m]; None: at several configurations spread over the joint ranges.

    Raises:
        ProblemError: On construction, if the placement is none.
    """

    placement: FloatArray
    seed: FloatArray | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        try:
            placement = read_only(self.placement)
        except (TypeError, ValueError):
            raise _no_placement(self.placement) from None
        if placement.shape != (4, 4) or not (abs(placement) <= MAX_SIZE).all():
            raise _no_placement(self.placement)
        turn = placement[:3, :3]
        off = float(abs(turn @ turn.T - np.eye(3)).max())
        if off > _ORTHONORMAL or np.linalg.det(turn) < 0 or (placement[3] != (0, 0, 0, 1)).any():
            raise _no_placement(placement.tolist())
        object.__setattr__(self, "placement", placement)

    @property
    def position(self) -> FloatArray:
        """Where the tool centre point is, shape (3,) [m]."""
        return self.placement[:3, 3]

    @property
    def rotation(self) -> FloatArray:
        """How its frame is turned, shape (3, 3)."""
        return self.placement[:3, :3]

    def errors(self, rotation: FloatArray, position: FloatArray) -> tuple[float, float]:
        """Return how far a tool, turned by (3, 3) and at (3,), is from the pose: [m] and [rad]."""
        turn = self.rotation.T @ rotation
        # Of the angle, sine and cosine: either alone is blind somewhere.
        twice_sine = np.linalg.norm((turn - turn.T)[[2, 0, 1], [1, 2, 0]])
        angle = np.arctan2(twice_sine, np.trace(turn) - 1)
        return float(np.linalg.norm(position - self.position)), float(angle)


def _no_placement(value: object) -> ProblemError:
    return ProblemError(
        f"a tool pose's placement is {shown(value)}; give a rotation and translation (4, 4), at "
        f"most {MAX_SIZE:g} m away, made with placement_of"
    )
