"""Contribution of each model error to failed runs; missing tolerance."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import JudgedRun, judged_runs
from tubeplanner.execution.simulation import executed
from tubeplanner.task.demands import ERRORS, Robustness
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Trajectories executed by arms that are drawn at random, and judged.


def simulated_runs(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    errors: Robustness,
    draw: Draw,
    checkpoint: Callable[[], None] = lambda: None,
) -> list[JudgedRun]:
    """Return what becomes of a trajectory in each run.

    Args:
        problem: The planning problem.
        trajectory: Of its joints, in any order.
        errors: Sizes of the errors, and the controller.
        draw: How many arms, and which.
        checkpoint: Called often; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    plants = drawn_plants(problem.robot, errors, draw)
    controlled = (errors.controller, errors.control_period)
    execution = executed(problem, trajectory, plants, *controlled, checkpoint)
    return judged_runs(problem, trajectory, execution, checkpoint)


# ---- How much more of its tolerances a plan would have to leave free for its executed runs.

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


# ---- Which error takes runs out of what they are to keep: one after the other is left out.

_KINDS = ("radius", "rotation", "clearance", "position", "self_collision")
_UNITS = {"rotation": "rad", "position": "rad or m"}
_DRAW = Draw(16, seed=0)
_MUCH_TRAVEL = 0.1  # [rad or m], of a joint beyond its position limits


@dataclass(frozen=True)
class BlamedError:
    """What one error does.

    Attributes:
        error: Its name in the field robustness.
        size: Its size there.
        short: What is short without it.
    """

    error: str
    size: float
    short: float


@dataclass(frozen=True)
class Blame:
    """What errors do to a motion.

    Attributes:
        kind: Of what is short the most: a part of what may be kept back, or "self_collision".
        unit: Of that.
        short: How much of it is short, with all errors.
        without_any: Without any error, under the same control.
        errors: What each does, that which does the most first.
    """

    kind: str
    unit: str
    short: float
    without_any: float
    errors: tuple[BlamedError, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        many = f"{self._shown(self.short)} of {self.kind.replace('_', ' ')} short"
        if self.without_any > 0:
            alone = self._shown(self.without_any)
            return f"{many}, and {alone} without any error: the controller cannot follow"
        most = self.errors[0]
        return (
            f"{many}; {most.error} of {most.size:g} is to blame most: {self._shown(most.short)} "
            "without it"
        )

    def _shown(self, short: float) -> str:
        return f"{1000 * short:.3g} m{self.unit}"


def blamed_errors(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    errors: Robustness,
    checkpoint: Callable[[], None],
) -> Blame:
    """Return which errors do most to a motion.

    Args:
        problem: The planning problem, of joined segments.
        trajectory: The motion.
        errors: All errors; at least one is not zero.
        checkpoint: Called often; may raise to end the work.
    """

    def shortfall(present: Robustness) -> Shortfall:
        runs = simulated_runs(problem, trajectory, present, _DRAW, checkpoint)
        return shown_shortfall(problem, runs)

    with_all = shortfall(errors)
    kind = max(_KINDS, key=lambda kind: _relative(problem, with_all, kind))
    present = [name for name in ERRORS if getattr(errors, name) > 0]
    without = [
        BlamedError(name, getattr(errors, name), shortfall(_without(errors, name)).most(kind))
        for name in present
    ]
    without_any = shortfall(_without(errors, *present)).most(kind)
    return Blame(
        kind,
        _UNITS.get(kind, "m"),
        with_all.most(kind),
        without_any,
        tuple(sorted(without, key=lambda error: error.short)),
    )


def _without(errors: Robustness, *names: str) -> Robustness:
    none: dict[str, Any] = dict.fromkeys(names, 0.0)
    return replace(errors, **none)


def _relative(problem: PlanningProblem, found: Shortfall, kind: str) -> float:
    """Return how much is short, in shares of the tolerance, of lengths of the smallest radius."""
    rotation = problem.tube.rotation
    if kind == "rotation" and rotation is not None:
        return found.most(kind) / float(rotation.bounds.min())
    if kind == "position":
        return found.most(kind) / _MUCH_TRAVEL
    return found.most(kind) / float(problem.tube.effective_radius.min())
