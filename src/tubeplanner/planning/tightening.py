"""Tightening: a problem with reserves in limits and tolerances; Survival of its plan in runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.error_contributions import Blame
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.geometry.tube.tube import Tube, narrowed_tube
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances, in_contact
from tubeplanner.text import short_repr

# ---- Problems with a little of every limit kept back, whose motions keep the limits themselves.

# At most this share of a radius, of a rotation tolerance or of a joint's range is kept back.
_MOST = 0.9
_ROUNDING = 1e-6  # [m or rad]: by which start and goal stay inside what is left
PARTS = ("effort", "velocity", "radius", "rotation", "clearance", "position")


@dataclass(frozen=True, eq=False)
class Tightening:
    """What is kept back of the limits of a problem with m segments and n joints.

    Attributes:
        effort: Share of the effort limits and of torque-speed lines that is left.
        velocity: Share of the velocity limits that is left.
        radius: Taken off every segment's region, at every side, shape (m,) [m].
        rotation: Taken off the rotation tolerances, shape (m,) [rad].
        clearance: Added to the clearance [m].
        position: Taken off the lower and the upper position limits, shape (2, n) [rad or m].
    """

    effort: float
    velocity: float
    radius: FloatArray
    rotation: FloatArray
    clearance: float
    position: FloatArray

    __repr__ = short_repr

    @classmethod
    def nothing(cls, problem: PlanningProblem) -> "Tightening":
        """Return the one that leaves a problem as it is."""
        segments, joints = problem.tube.segment_count, problem.robot.joint_count
        free = np.zeros(segments)
        return cls(1.0, 1.0, free, free, 0.0, np.zeros((2, joints)))

    def only(self, parts: Sequence[str]) -> "Tightening":
        """Return some of its parts, nothing of the others."""
        none: dict[str, Any] = {
            name: 1.0 if name in PARTS[:2] else 0.0 * getattr(self, name) for name in PARTS
        }
        return replace(self, **{name: none[name] for name in PARTS if name not in parts})

    def has(self, part: str) -> bool:
        """Return whether anything is kept back of one of `PARTS`."""
        value = getattr(self, part)
        return bool(value != 1.0) if part in PARTS[:2] else bool(np.any(value))

    def of_parts(self, tube: Tube) -> "Tightening":
        """Return it for the segments that were joined to those of a tube."""
        if tube.parts is None:
            return self
        joined = np.searchsorted(tube.numbers, tube.parts.numbers[:-1], side="right") - 1
        return replace(self, radius=self.radius[joined], rotation=self.rotation[joined])

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in PARTS}


def allowed_tightening(problem: PlanningProblem, asked: Tightening, ends: FloatArray) -> Tightening:
    """Return as much of a tightening as limits, start and goal leave room for.

    Args:
        problem: The planning problem.
        asked: What would be kept back.
        ends: Configurations in which the motion begins and, if that is given, ends: (1 or 2, n).
    """
    tube, limits = problem.tube, problem.robot.limits
    turned, tool = problem.robot.tool_pose(ends)
    angle = np.zeros(tube.segment_count)
    if tube.rotation is not None:
        tightest = tube.rotation.bounds.min(axis=1)
        angle = np.where(np.isfinite(tightest), tightest, 0.0)
    radius = np.minimum(asked.radius, _MOST * tube.effective_radius)
    rotation = np.minimum(asked.rotation, _MOST * angle)
    inside, straight = tube.margin(tool), tube.rotation_margin(turned, tool)
    for end, segment in enumerate((0, -1)[: len(ends)]):
        radius[segment] = min(radius[segment], inside[end, segment] - _ROUNDING)
        rotation[segment] = min(rotation[segment], straight[end, segment] - _ROUNDING)
    goal = problem.endpoints[1]
    if goal.kind == "position" and goal.region is not None:  # its position is to stay inside too
        inside = tube.margin(goal.region.position[None])
        radius[-1] = min(radius[-1], inside[0, -1] - _ROUNDING)
    room = np.array([ends - limits.lower_position, limits.upper_position - ends]).min(axis=1)
    spare = _spare_distance(problem, ends) - _ROUNDING
    return replace(
        asked,
        radius=radius.clip(min=0),
        rotation=rotation.clip(min=0),
        position=np.minimum(asked.position, room - _ROUNDING).clip(min=0),
        clearance=max(min(asked.clearance, spare), 0.0),
    )


def tightened_problem(problem: PlanningProblem, kept_back: Tightening) -> PlanningProblem:
    """Return a problem that asks more; geometry is shared.

    Args:
        problem: The planning problem.
        kept_back: As `allowed_tightening` has it.

    Raises:
        ProblemError: Start or goal break a limit that is left.
    """
    farther = problem.farther_apart(kept_back.clearance)
    return replace(
        farther,
        robot=_limited(problem.robot, kept_back),
        tube=narrowed_tube(farther.tube, kept_back.radius, kept_back.rotation),
    )


def _limited(robot: RobotModel, kept_back: Tightening) -> RobotModel:
    limits, motors, share = robot.limits, robot.motors, kept_back.effort
    limits = replace(
        limits,
        effort=share * limits.effort,
        effort_ranges=tuple(each.scaled(share) for each in limits.effort_ranges),
        velocity=kept_back.velocity * limits.velocity,
        lower_position=limits.lower_position + kept_back.position[0],
        upper_position=limits.upper_position - kept_back.position[1],
    )
    return robot.with_limits(
        limits, replace(motors, saturation_effort=share * motors.saturation_effort)
    )


def _spare_distance(problem: PlanningProblem, ends: FloatArray) -> float:
    """Return by how much links are farther from obstacles at start and goal than they must be [m].

    Pairs in contact there do not count: they may stay as near.
    """
    checker, poses = problem.collision, problem.robot.body_poses(ends)
    count = len(checker.obstacle_pairs)
    counts = ~in_contact(problem)[:count]
    segments = np.array([0, problem.tube.segment_count - 1])[: len(ends)]
    asked = RequiredDistances(problem, ends[0], ends[-1]).at(
        segments, problem.robot.tool_position(ends)
    )
    distances = [
        checker.distances(*pose, checker.obstacle_pairs) for pose in zip(*poses, strict=True)
    ]
    return float((np.array(distances) - asked[:, :count])[:, counts].min(initial=np.inf))


# ---- What a plan that is to survive errors keeps back, what that costs, and what was seen of it.

_UNITS = {"rotation": "rad", "position": "rad or mm"}


@dataclass(frozen=True, eq=False)
class Survival:
    """What became of a plan under errors. Seen in simulated runs; nothing of it is proved.

    Attributes:
        verdict: Of runs that were used for nothing else; None if planning was stopped before.
        reached: Whether all runs that it was planned with survive, errors 1.3 times as large.
        kept_back: What the plan leaves of the limits.
        duration_without: Of the plan that would be written without robustness [s].
        verdict_without: Of that plan, of the same runs; None if it is the answer, or likewise.
        costs: What keeping back each part costs, by name [s]; they sum up to what all costs.
        blame: Which errors do the most; None where the plan survives at little cost.
    """

    verdict: RunVerdict | None
    reached: bool
    kept_back: Tightening
    duration_without: float
    verdict_without: RunVerdict | None
    costs: Mapping[str, float]
    blame: Blame | None = None

    __repr__ = short_repr

    @property
    def added(self) -> float:
        """What surviving costs [s]."""
        return sum(self.costs.values())

    @property
    def seen(self) -> str:
        """What was seen of the plan, in words."""
        if self.verdict is None:
            return "its runs were not simulated to the end"
        return f"seen in simulation: {self.verdict}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What surviving costs and by what, and what is to blame, in words."""
        if not self.costs:
            return self._blamed
        parts = "; ".join(
            f"{_kept(self.kept_back, part)} ({1000 * cost:.1f} ms)"
            for part, cost in self.costs.items()
        )
        share = 100 * self.added / self.duration_without
        without = f"without robustness the plan takes {self.duration_without:.4f} s"
        if self.verdict_without is not None:
            without += f", and {self.verdict_without}"
        costs = (
            f"surviving takes {1000 * self.added:.1f} ms more, {share:.2g} %: {parts}; {without}"
        )
        return (costs, *self._blamed)

    @property
    def _blamed(self) -> tuple[str, ...]:
        if self.blame is None:
            return ()
        is_short = self.blame.short > 0
        if self.reached:
            return (f"the plan without robustness: {self.blame}",) if is_short else ()
        none = "no plan was found of which all runs survive, their errors enlarged"
        return (f"{none}: {self.blame}" if is_short else none,)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "reached": self.reached,
            "verdict": None if self.verdict is None else self.verdict.as_dict(),
            "verdict_without": None
            if self.verdict_without is None
            else self.verdict_without.as_dict(),
            "duration_without": self.duration_without,
            "kept_back": self.kept_back.as_dict(),
            "costs": dict(self.costs),
            "blame": None if self.blame is None else self.blame.as_dict(),
        }


def _kept(kept_back: Tightening, part: str) -> str:
    """Return how much of one part is kept back, in words."""
    value = getattr(kept_back, part)
    if part in ("effort", "velocity"):
        return f"{100 * value:.3g} % of the {part} limits"
    most = f"{1000 * float(np.max(value)):.2g} m{_UNITS.get(part, 'm')}"
    if part == "clearance":
        return f"{most} more clearance"
    return f"up to {most} less {part.replace('position', 'joint range')}"
