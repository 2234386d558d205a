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


def simulated_runs(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    errors: Robustness,
    draw: Draw,
    checkpoint: Callable[[], None] = lambda: None,
) -> list[JudgedRun]:
    """Return the judged runs of a trajectory, executed by arms drawn at random.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    plants = drawn_plants(problem.robot, errors, draw)
    controlled = (errors.controller, errors.control_period)
    execution = executed(problem, trajectory, plants, *controlled, checkpoint, errors.bandwidth)
    return judged_runs(problem, trajectory, execution, checkpoint, errors)


# ---- Shortfall: additional tolerance that a plan would have to leave free for its executed runs.

# A few runs stand for so many: of so many the largest lies about so many standard deviations from
# the mean, if normal.
_MANY, _DEVIATIONS = 96, 2.5
_NOTHING = -1e3  # [m or rad]: the shortfall where nothing is required
# Of what a contact carries: beyond, nothing presses the part any more, and shares say little.
_MAX_HOLDING = 0.5


@dataclass(frozen=True, eq=False)
class Shortfall:
    """The shortfall of a plan's runs, or the expected one of more runs; negative: slack."""

    radius: FloatArray  # of each joined segment, shape (m,) [m]
    rotation: FloatArray  # of each joined segment, shape (m,) [rad]
    clearance: float  # from obstacles [m]
    position: FloatArray  # at the lower and upper position limits, shape (2, n) [rad or m]
    self_collision: float  # between links [m]; no backoff helps there
    # relative, of the stops of the controller:
    velocity: FloatArray  # by the velocity of each joint, shape (n,)
    tracking: FloatArray  # by the distance of each joint from the plan, shape (n,)
    tool_tracking: float  # by the distance of the tool from the plan
    holding: float = _NOTHING  # of the cones of held parts, as a share of the nominal

    def most(self, kind: str) -> float:
        """Return the largest shortfall of a kind, such as "radius" [m or rad]."""
        return float(np.max(getattr(self, kind)))


def shown_shortfall(problem: PlanningProblem, runs: Sequence[JudgedRun]) -> Shortfall:
    """Return the shortfall of a plan of joined segments in its judged runs, at least one."""
    tube = [run.tube_by_segment for run in runs]
    rotation = [run.rotation_by_segment for run in runs]
    position = [run.position_by_joint for run in runs]
    velocity = [run.velocity_by_joint / run.stops["velocity"] - 1 for run in runs]
    tool = [run.tool_tracking.value / run.stops.get("tool_tracking", np.inf) - 1 for run in runs]
    near = [
        _NOTHING if run.obstacles is None else run.clearance - run.obstacles.value for run in runs
    ]
    held = [
        _NOTHING if run.holding is None else min(run.holding.value - 1, _MAX_HOLDING)
        for run in runs
    ]
    folded = [_NOTHING if run.self_collision is None else -run.self_collision.value for run in runs]
    return Shortfall(
        radius=_with_points(problem, _expected_most(tube), runs),
        rotation=_expected_most(rotation),
        clearance=float(_expected_most(near)),
        position=_expected_most(position),
        self_collision=float(max(folded)),
        velocity=_expected_most(velocity),
        tracking=_expected_most([run.tracking_by_joint - 1 for run in runs]),
        tool_tracking=float(_expected_most(tool)),
        holding=float(_expected_most(held)),
    )


def _expected_most(run_values: Sequence[FloatArray] | Sequence[float]) -> FloatArray:
    """Return the largest value of the runs, or the expected largest of more runs if larger."""
    values = np.array(run_values)
    most: FloatArray = values.max(axis=0)
    if len(values) >= _MANY:
        return most
    return np.maximum(most, values.mean(axis=0) + _DEVIATIONS * values.std(axis=0))


def _with_points(
    problem: PlanningProblem, radius: FloatArray, runs: Sequence[JudgedRun]
) -> FloatArray:
    """Return the radii's shortfall (m,), raised beside the worst compulsory point to its own."""
    points = [run.points for run in runs if run.points is not None]
    if not points:
        return radius
    shortfall = radius.copy()
    most = float(_expected_most([extreme.value for extreme in points]))
    worst = max(points, key=lambda extreme: extreme.value)
    assert worst.location.point is not None
    k = int(np.searchsorted(problem.tube.numbers, worst.location.point))
    shortfall[k - 1 : k + 1] = np.maximum(shortfall[k - 1 : k + 1], most)
    return shortfall


# ---- Contribution of each error to the largest shortfall: one after the other is left out.

_KINDS = (
    *("radius", "rotation", "clearance", "position", "self_collision"),
    *("velocity", "tracking", "tool_tracking", "holding"),
)
_RELATIVE = _KINDS[-4:]
_UNITS = {"rotation": "rad", "position": "rad or m"} | dict.fromkeys(_RELATIVE, "")
_DRAW = Draw(16, seed=0)
_MUCH_TRAVEL = 0.1  # [rad or m], of a joint beyond its position limits


@dataclass(frozen=True)
class BlamedError:
    """The contribution of an error."""

    error: str  # the error's name in the field robustness
    size: float  # the error's size there
    short: float  # the shortfall without the error, in the unit of `ErrorContribution`


@dataclass(frozen=True)
class ErrorContribution:
    """The contributions of all errors to the largest shortfall of a motion.

    Attributes:
        kind: The quantity that falls short: a field of `Shortfall`.
        unit: Its unit.
        short: The shortfall with all errors.
        without_any: The shortfall without any error, under the same control.
        errors: The contribution of each error, the largest first.
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
        many = f"{self._in_words(self.short)} of {self.kind.replace('_', ' ')} short"
        if self.without_any > 0:
            alone = self._in_words(self.without_any)
            return f"{many}, and {alone} without any error: the controller cannot follow"
        most = self.errors[0]
        return (
            f"{many}; {most.error} of {most.size:g} is to blame most: {self._in_words(most.short)} "
            "without it"
        )

    def _in_words(self, short: float) -> str:
        if not self.unit:
            return f"{float(f'{100 * short:.3g}'):g} %"  # 9550, not 9.55e+03
        return f"{1000 * short:.3g} m{self.unit}"


def blamed_errors(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    errors: Robustness,
    checkpoint: Callable[[], None],
) -> ErrorContribution:
    """Return the contribution of each error, at least one, to a motion's largest shortfall.

    The problem's segments are joined.
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
    without.sort(key=lambda error: error.short)
    return ErrorContribution(
        kind, _UNITS.get(kind, "m"), with_all.most(kind), without_any, tuple(without)
    )


def _without(errors: Robustness, *names: str) -> Robustness:
    none: dict[str, Any] = dict.fromkeys(names, 0.0)
    return replace(errors, **none)


def _relative(problem: PlanningProblem, shortfall: Shortfall, kind: str) -> float:
    """Return the shortfall of a kind over its tolerance; of lengths, over the smallest radius."""
    rotation = problem.tube.rotation
    if kind == "rotation" and rotation is not None:
        return shortfall.most(kind) / float(rotation.bounds.min())
    if kind in _RELATIVE:
        return shortfall.most(kind)
    if kind == "position":
        return shortfall.most(kind) / _MUCH_TRAVEL
    return shortfall.most(kind) / float(problem.tube.effective_radius.min())
