"""How much more of its tolerances a plan would have to leave free for its executed runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.judged_runs import JudgedRun

# Few runs stand for more: the mean and so many standard deviations of them.
_DEVIATIONS = 2.5
_NOTHING = -1e3  # [m or rad]: how much is short where nothing is asked


@dataclass(frozen=True, eq=False)
class Shortfall:
    """What runs of a plan lack, and runs like them are expected to; below zero: have to spare.

    Attributes:
        radius: In each of the joined segments, shape (m,) [m].
        rotation: Likewise [rad].
        clearance: [m].
        position: At the lower and upper position limits, shape (2, n) [rad or m].
        self_collision: Between links [m]; nothing that is kept back helps there.
    """

    radius: FloatArray
    rotation: FloatArray
    clearance: float
    position: FloatArray
    self_collision: float

    @property
    def is_none(self) -> bool:
        """Whether nothing is short."""
        single = (self.clearance, self.self_collision)
        groups = (self.radius, self.rotation, self.position, np.array(single))
        return all(bool((group <= 0).all()) for group in groups)

    def most(self, kind: str) -> float:
        """Return the most that is short of one kind, such as "radius" [m or rad]."""
        return float(np.max(getattr(self, kind)))


def shown_shortfall(problem: PlanningProblem, runs: Sequence[JudgedRun]) -> Shortfall:
    """Return what some runs show to be short.

    Args:
        problem: The planning problem, of joined segments.
        runs: At least one.
    """
    tube = [run.tube_by_segment for run in runs]
    rotation = [run.rotation_by_segment for run in runs]
    position = [run.position_by_joint for run in runs]
    near = [
        _NOTHING if run.obstacles is None else run.clearance - run.obstacles.value for run in runs
    ]
    folded = [_NOTHING if run.self_collision is None else -run.self_collision.value for run in runs]
    return Shortfall(
        radius=_with_points(problem, _expected_most(tube), runs),
        rotation=_expected_most(rotation),
        clearance=float(_expected_most(near)),
        position=_expected_most(position),
        self_collision=float(max(folded)),
    )


def _expected_most(values: Sequence[FloatArray] | Sequence[float]) -> FloatArray:
    """Return the most of values of some runs, or what is expected of more if that is larger."""
    given = np.array(values)
    expected: FloatArray = given.mean(axis=0) + _DEVIATIONS * given.std(axis=0)
    return np.maximum(given.max(axis=0), expected)


def _with_points(
    problem: PlanningProblem, radius: FloatArray, runs: Sequence[JudgedRun]
) -> FloatArray:
    """Return what radii lack, also beside compulsory points that are missed, (m,)."""
    found = [run.points for run in runs if run.points is not None]
    if not found:
        return radius
    lacking = radius.copy()
    most = float(_expected_most([extreme.value for extreme in found]))
    worst = max(found, key=lambda extreme: extreme.value)
    assert worst.place.point is not None
    k = int(np.searchsorted(problem.tube.numbers, worst.place.point))
    lacking[k - 1 : k + 1] = np.maximum(lacking[k - 1 : k + 1], most)
    return lacking
