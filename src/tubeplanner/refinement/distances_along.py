"""How far apart solids must be along a spline, as something that changes smoothly with it.

Where solids are in contact at start or goal, less is asked while the tool is near. That ends at
once; here it rises to what is asked farther away, late and steeply, so that a step sees it coming.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import NearEnd, RequiredDistances
from tubeplanner.refinement.phased_spline import KnotGrid, Samples, segments_of_pieces

# What is required rises with the square of the distance from the end, and is all there at this
# share of the way: between samples a path cuts the corner that is there. Higher powers cost less
# time, by .1 % where solids leave each other at a small angle, but steps do not find their way.
_RISEN_AT = 0.93
# They leave each other at once, by this share of the mean slope: motions along each other are not
# certain to stay clear between samples.
_LEAVING = 0.3


@dataclass(frozen=True, eq=False)
class AimedDistances:
    """What is aimed at for E pairs, each in a configuration of its own.

    Attributes:
        distance: Shape (E,) [m].
        change: Its derivative by the joints, shape (E, n) [m/rad or 1].
        strict: Added to the excess, shape (E,).
    """

    distance: FloatArray
    change: FloatArray
    strict: FloatArray


class DistancesAlong:
    """What is required of pairs at samples of a spline."""

    def __init__(self, problem: PlanningProblem, ends: FloatArray, room: float) -> None:
        """Take what a problem requires of motions from a configuration to another.

        Args:
            problem: The planning problem.
            ends: Both configurations, shape (2, n).
            room: What is required of obstacles in addition [m].
        """
        self._problem = problem
        self._required = RequiredDistances(problem, ends[0], ends[1], room)

    def at(self, grid: KnotGrid, samples: Samples, q: FloatArray) -> FloatArray:
        """Return what is required at samples in configurations (N, n), shape (N, P) [m]."""
        rows = self._required.by_segment
        if self._required.is_constant:
            return np.broadcast_to(rows[0], (len(q), rows.shape[1]))
        own, other = _segments(grid, samples)
        tool = self._problem.robot.tool_position(q)
        return np.maximum(self._risen(own, tool), self._risen(other, tool))

    def of_pairs(
        self, grid: KnotGrid, samples: Samples, q: FloatArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return what is required of a pair at each sample, and how that changes with the joints.

        Args:
            grid: Of the spline.
            samples: N samples.
            q: Configurations there, shape (N, n).
            pair: Of the P pairs, shape (N,).

        Returns:
            Distances (N,) [m] and their derivatives (N, n) [m/rad or 1].
        """
        change = np.zeros(q.shape)
        if self._required.is_constant:
            return self._required.by_segment[0, pair], change
        own, other = _segments(grid, samples)
        tool = self._problem.robot.tool_position(q)
        required = self._required.by_segment[self._required.row_of[own], pair]
        full, by_tool = required.copy(), np.zeros(tool.shape)
        for near in self._required.near_ends:
            here = near.holds(own, tool) & near.pair[pair]
            share, slope = _risen_share(near, tool)
            more = (full - near.distance).clip(min=0)
            risen = near.distance + more * share
            here &= risen < required
            required = np.where(here, risen, required)
            by_tool[here] = (more[:, None] * slope)[here]
        beside = other != own
        by_tool[beside] = 0.0
        every = self.at(grid, samples, q)[np.arange(len(pair)), pair]
        jacobian = self._problem.robot.tool_jacobian(q)[1][:, :3]
        change = np.einsum("ni,nij->nj", by_tool, jacobian)
        return np.where(beside, every, required), change

    def at_ends(self, ends: FloatArray) -> FloatArray:
        """Return what is required at start and, if it is given too, at goal, (1 or 2, P) [m]."""
        segments = np.array([0, self._problem.tube.segment_count - 1])[: len(ends)]
        return self._required.at(segments, self._problem.robot.tool_position(ends))

    def _risen(self, segment: IntArray, tool: FloatArray) -> FloatArray:
        """Return what is required in segments (N,) of tools (N, 3), shape (N, P) [m]."""
        full = self._required.by_segment[self._required.row_of[segment]]
        required = full.copy()
        for near in self._required.near_ends:
            place = np.ix_(near.holds(segment, tool), near.pair)
            share = _risen_share(near, tool[place[0][:, 0]])[0][:, None]
            more = (full[place] - near.distance).clip(min=0)
            required[place] = np.minimum(required[place], near.distance + more * share)
        return required


def _risen_share(near: NearEnd, tool: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return which share of what is more required farther away is required of tools (N, 3).

    From 0 at the end to 1, and more where all of it is required, shape (N,), and its derivative by
    the tool, shape (N, 3) [1/m].
    """
    away, length = tool - near.tool, _RISEN_AT * near.within
    distance = np.linalg.norm(away, axis=1)
    share = distance / length
    slope = (2 * share + _LEAVING * (1 - 2 * share)) / length
    onward = away / np.where(distance > 0, distance, 1.0)[:, None]
    return share**2 + _LEAVING * share * (1 - share), slope[:, None] * onward


def _segments(grid: KnotGrid, samples: Samples) -> tuple[IntArray, IntArray]:
    """Return each sample's segment, and at a hand-over the other one, else the same: both (N,)."""
    own = segments_of_pieces(grid)[samples.interval]
    first = np.array([chain.start for chain in grid.chains])
    moved = np.where(samples.share == 0, -1, np.where(samples.share == 1, 1, 0))
    beside = first[np.clip(samples.phase + moved, 0, len(first) - 1)]
    is_inner: BoolArray = (moved != 0) & (samples.phase + moved >= 0)
    is_inner &= samples.phase + moved < len(first)
    return own, np.where(is_inner, beside, own)
