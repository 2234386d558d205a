"""Coulomb friction at samples of a path: what counts where efforts must not be more, or less.

It jumps where a joint reverses. Both one-sided limits count there, so that on its way to a reversal
the friction of the other direction must already be allowed for. Optimisers need to see that coming:
for them, it is blended in over a range of low velocities.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.joint_motors import JointMotors
from tubeplanner.trajectory.directed_stretches import STILL_SHARE

# So much of the range before a reversal has the other direction's friction whole: what is between
# samples there is covered.
_EARLY = 0.1


@dataclass(frozen=True, eq=False)
class CoulombFriction:
    """Coulomb friction of n joints at N samples, each (N, n) [N m or N].

    Attributes:
        most: The most that it may be.
        least: The least.
        most_by_rate: How `most` changes with the path's velocity dq/dx.
        least_by_rate: Likewise.
    """

    most: FloatArray
    least: FloatArray
    most_by_rate: FloatArray
    least_by_rate: FloatArray

    def side(self, way: float) -> tuple[FloatArray, FloatArray]:
        """Return what counts where efforts are bounded from above (1) or below, and its change."""
        upper = (self.most, self.most_by_rate)
        return upper if way > 0 else (self.least, self.least_by_rate)


def directed_friction(motors: JointMotors, direction: FloatArray) -> CoulombFriction:
    """Return the friction of joints that move in known directions.

    Args:
        motors: Of the joints.
        direction: Whose sign is the joints' direction, shape (N, n); 0: they stand still.
    """
    effort = motors.coulomb_effort(direction)
    unsure = motors.friction_uncertainty * abs(effort)
    none = np.zeros_like(effort)
    return CoulombFriction(effort + unsure, effort - unsure, none, none)


def blended_friction(
    motors: JointMotors, rate: FloatArray, end_direction: FloatArray, share: float
) -> CoulombFriction:
    """Return friction that bounds that of a whole path from both sides, and has derivatives.

    Args:
        motors: Of the joints.
        rate: Velocities dq/dx of the path at samples all over it, shape (N, n).
        end_direction: Whose sign is the direction in which a joint leaves the start or approaches
            the goal, at samples near these; nan at others, shape (N, n).
        share: Of a joint's largest velocity, below which the friction of both directions counts.
    """
    most = abs(rate).max(axis=0)
    moves = most > STILL_SHARE * most.max()
    width = np.where(moves, share * most, 1.0)
    forwards, backwards = motors.forwards_friction, -motors.backwards_friction
    more, less = 1 + motors.friction_uncertainty, 1 - motors.friction_uncertainty
    slope = 1 / (width * (1 - _EARLY))
    ahead, behind = (np.clip((width + way * rate) * slope, 0, 1) for way in (1.0, -1.0))
    rise, fall = forwards * more - backwards * less, forwards * less - backwards * more
    blended = CoulombFriction(
        backwards * less + rise * ahead,
        forwards * less - fall * behind,
        rise * slope * ((ahead < 1) & (ahead > 0)),
        fall * slope * ((behind < 1) & (behind > 0)),
    )
    known = ~np.isnan(end_direction) | ~moves
    direction = np.where(moves, np.nan_to_num(end_direction), 0.0)
    exact = directed_friction(motors, direction)
    names = CoulombFriction.__dataclass_fields__
    return CoulombFriction(
        *(np.where(known, getattr(exact, name), getattr(blended, name)) for name in names)
    )
