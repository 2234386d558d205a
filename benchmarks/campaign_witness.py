"""A slow smooth trajectory whose tool keeps to a tube of a drawn width: it solves a problem.

The trajectory is a spline of degree five through random configurations, at rest at both ends; some
go back some of their way. It is made smaller until its tool path strays no farther from the
reference points' lines than the drawn radius, and slower until no limit is near.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import factorial

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

from campaign_arms import Unsuitable
from outside.arm import Arm
from outside.conditions import judge_limits
from outside.trajectory import Trajectory
from outside.tube import distance

MIN_RADIUS, MAX_RADIUS = 5e-4, 0.3  # [m]
MAX_SEGMENTS = 199
MIN_LENGTH = 3e-4  # [m] of a segment
RADIUS_FACTOR = 1.2  # of the radius to what the witness needs
ROWS = 4001  # of the tool path that is looked at
LIMIT_MARGIN = 0.02  # [rad, m] that the walk begins away from position limits
SHARE = 0.1  # of each limit that the witness leaves, at least
MAX_SMALLER, MAX_SLOWER = 40, 14


@dataclass(frozen=True, eq=False)
class Witness:
    """A trajectory that solves a problem, and the tube's reference points on its tool path.

    Attributes:
        trajectory: Slow enough for all limits.
        q: Configurations along it, shape (ROWS, n).
        gates: Rows of `q` at which the tool is at the reference points, shape (m+1,).
        points: Reference points, shape (m+1, 3) [m].
        needed: How far the tool strays from each segment, shape (m,) [m].
        scale: The radius that was drawn [m].
    """

    trajectory: Trajectory
    q: np.ndarray
    gates: np.ndarray
    points: np.ndarray
    needed: np.ndarray
    scale: float


def random_witness(rng: np.random.Generator, arm: Arm) -> Witness:
    """Return a random witness.

    Raises:
        Unsuitable: The walk leaves the limits, its tool hardly moves, or the arm cannot be held.
    """
    scale = float(np.exp(rng.uniform(*np.log([MIN_RADIUS, MAX_RADIUS]))))
    segments = round(float(np.exp(rng.uniform(0, np.log(MAX_SEGMENTS)))))
    knots = _walk(rng, arm, steps=int(rng.integers(2, 7)))
    turn = None
    if rng.random() < 0.2:  # it goes back some of its way
        turn = len(knots) - 1
        knots = np.vstack([knots, knots[-2::-1][: int(rng.integers(1, len(knots)))]])
    shares = _shares(rng, segments)
    for _ in range(MAX_SMALLER):
        spline = _spline(knots)
        q = spline(np.linspace(0, 1, ROWS))
        position = arm.tool(q)[1]
        row = None if turn is None else round(turn / (len(knots) - 1) * (ROWS - 1))
        gates = _gates(position, shares, row)
        points = position[gates]
        spans = pairwise(gates)
        off = [distance(points, position[a : b + 1], k).max() for k, (a, b) in enumerate(spans)]
        if np.linalg.norm(np.diff(points, axis=0), axis=1).min() < MIN_LENGTH:
            if len(shares) == 2:
                raise Unsuitable("the tool hardly moves")
            shares = np.append(shares[:-1:2], 1.0)
        elif RADIUS_FACTOR * max(off) <= scale:
            inside = np.minimum(q - arm.limits.lower, arm.limits.upper - q).min()
            if inside < LIMIT_MARGIN / 4:
                raise Unsuitable("the walk leaves the position limits")
            trajectory = _slow(arm, spline)
            return Witness(trajectory, q, gates, points, np.array(off), scale)
        else:
            knots = knots[0] + 0.7 * (knots - knots[0])
    raise Unsuitable("the tool path does not become straight enough")


def _walk(rng: np.random.Generator, arm: Arm, steps: int) -> np.ndarray:
    lower, upper = arm.limits.lower + LIMIT_MARGIN, arm.limits.upper - LIMIT_MARGIN
    if not (lower < upper).all():
        raise Unsuitable("a joint can hardly move between its position limits")
    knots = [np.clip(arm.random(rng, 1)[0], lower, upper)]
    longest = rng.uniform(0.3, 1.2) * np.where(arm.slides, 0.3, 1.0)
    for _ in range(steps):
        step = rng.uniform(-longest, longest)
        knots.append(np.clip(knots[-1] + step, lower, upper))
    return np.array(knots)


def _spline(knots: np.ndarray) -> PPoly:
    """Return the spline through configurations (K, n), over 0 to 1."""
    rest = [(1, np.zeros(knots.shape[1])), (2, np.zeros(knots.shape[1]))]
    spline = make_interp_spline(np.linspace(0, 1, len(knots)), knots, k=5, bc_type=(rest, rest))
    at = np.unique(spline.t)
    orders = range(spline.k, -1, -1)
    return PPoly(np.array([spline(at[:-1], nu=k) / factorial(k) for k in orders]), at)


def _shares(rng: np.random.Generator, segments: int) -> np.ndarray:
    """Return the arc lengths of reference points as shares of the whole, equal parts or not."""
    if rng.random() < 0.7:
        return np.linspace(0, 1, segments + 1)
    parts = rng.dirichlet(np.full(segments, 0.5))
    return np.append(np.concatenate([[0.0], np.cumsum(parts)])[:-1], 1.0)


def _gates(position: np.ndarray, shares: np.ndarray, turn: int | None) -> np.ndarray:
    """Return rows at shares of the arc length of a path (N, 3), and the one where it turns."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    arc_length = np.concatenate([[0.0], np.cumsum(steps)])
    gates = np.searchsorted(arc_length, arc_length[-1] * shares)
    gates[-1] = len(position) - 1
    gates = np.minimum(gates, len(position) - 1)
    if turn is not None:
        gates = np.sort(np.append(gates, turn))
    return np.unique(gates)


def _slow(arm: Arm, spline: PPoly) -> Trajectory:
    """Return a spline over 0 to 1 as a trajectory that leaves a share of every limit.

    Raises:
        Unsuitable: However slow, it does not.
    """
    powers = np.arange(len(spline.c) - 1, -1, -1)[:, None, None]
    for doubling in range(MAX_SLOWER):
        duration = 0.5 * 2.0**doubling
        trajectory = Trajectory(
            list(arm.joint_names), spline.x * duration, spline.c / duration**powers
        )
        found = judge_limits(arm, trajectory, trajectory.samples(500))
        shares = [one.margin for one in found.values() if one.unit == "relative"]
        if min((share for share in shares if share is not None), default=1.0) >= SHARE:
            return trajectory
    raise Unsuitable("the motors cannot hold the arm")
