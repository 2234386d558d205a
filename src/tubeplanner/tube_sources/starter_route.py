"""Short routes of the tool that an arm can follow from a configuration: up, over and down."""

from collections.abc import Iterator

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel

_SHARES = (0.25, 0.15, 0.08)  # of the reach: how far up, and half of how far over
_TURN = 0.25  # [rad or m]: a tool that moves on a line or surface does so in steps of joints
_STRAIGHT = 0.3  # of a unit vector that must be left of it where the tool can move
_NO_GAIN = 1e-3  # of the largest gain
_DIGITS = 4
_DIGITS_ON_A_SURFACE = 9  # where nothing reaches a point beside it


def starter_routes(robot: RobotModel, q: FloatArray, reach: float) -> Iterator[FloatArray]:
    """Yield reference points, shape (m+1, 3) [m], the longer routes first.

    Args:
        robot: The arm.
        q: The configuration where they begin, shape (n,).
        reach: How far from its first joint the tool gets [m].
    """
    tool, jacobian = robot.tool_jacobian(q)
    moved, gains, _ = np.linalg.svd(jacobian[:3])
    free = moved[:, : int((gains > _NO_GAIN * gains[0]).sum())]
    if free.shape[1] < 2:
        yield from _in_steps(robot, q, jacobian[:3], 1)
        return
    digits = _DIGITS if free.shape[1] == 3 else _DIGITS_ON_A_SURFACE
    up = _nearest(free, np.array([0.0, 0.0, 1.0]))
    rest = free - np.outer(up, up @ free)
    over = _nearest(rest, np.cross([0.0, 0.0, 1.0], tool))
    for share in _SHARES:
        for along in (over, -over):
            for rise in (up, -up):
                steps = share * reach * np.array([0 * up, rise, rise + 2 * along, 2 * along])
                yield (tool + steps).round(digits)
    if free.shape[1] == 2:
        yield from _in_steps(robot, q, jacobian[:3], 2)


def _nearest(directions: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the unit vector (3,) nearest to a wanted one among what directions (3, k) span."""
    basis, gains, _ = np.linalg.svd(directions, full_matrices=False)
    basis = basis[:, gains > _NO_GAIN]
    length = float(np.linalg.norm(wanted))
    found = basis @ basis.T @ (wanted / length) if length > 0 else np.zeros(3)
    size = float(np.linalg.norm(found))
    return found / size if size > _STRAIGHT else basis[:, 0]


def _in_steps(
    robot: RobotModel, q: FloatArray, jacobian: FloatArray, count: int
) -> Iterator[FloatArray]:
    """Yield where the tool is as the joints that move it most, one or two, take two steps."""
    strongest = np.argsort(-np.linalg.norm(jacobian, axis=0))[:count]
    for step in (_TURN, -_TURN):
        moved = np.tile(q, (3, 1))
        moved[1:, strongest[0]] += step
        moved[2:, strongest[-1]] += step
        yield robot.tool_position(moved).round(_DIGITS_ON_A_SURFACE)
