"""Which error takes runs out of what they are to keep: one after the other is left out."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.robustness import ERRORS, Robustness
from tubeplanner.simulation.plant import Draw
from tubeplanner.simulation.shortfall import Shortfall, shown_shortfall
from tubeplanner.simulation.simulated_runs import simulated_runs
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

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
