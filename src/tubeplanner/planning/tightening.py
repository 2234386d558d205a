"""Tightening of a problem's limits and tolerances, and the survival of a plan in runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import FormerName
from tubeplanner.execution.error_contributions import ErrorContribution
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.geometry.tube.tube import Tube, narrowed_tube
from tubeplanner.task.demands import Robustness
from tubeplanner.task.holding import rest_margins
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances, in_contact
from tubeplanner.text import short_repr

# ---- Tightened problems, whose motions keep the limits of the problem itself.

# Largest tightening, as a fraction of a radius or of a rotation tolerance.
_MAX_FRACTION = 0.9
_MIN_VELOCITY = 0.3  # of a velocity limit
_ROUNDING = 1e-6  # [m or rad]: margin of start and goal inside the tightened limits
PARTS = ("effort", "velocity", "radius", "rotation", "clearance", "position", "holding")


@dataclass(frozen=True, eq=False)
class Tightening:
    """The tightening of a problem with m segments and n joints.

    Attributes:
        effort: Remaining fraction of the effort limits and of torque-speed lines.
        velocity: Remaining fraction of each joint's velocity limit, shape (n,).
        radius: Taken off every segment's region, at every side, shape (m,) [m].
        rotation: Taken off the rotation tolerances, shape (m,) [rad].
        clearance: Added to the clearance [m].
        position: Taken off the lower and the upper position limits, shape (2, n) [rad or m].
        holding: Taken off the cones of held parts, as a share of the nominal.
    """

    effort: float
    velocity: FloatArray
    radius: FloatArray
    rotation: FloatArray
    clearance: float
    position: FloatArray
    holding: float = 0.0

    __repr__ = short_repr

    @classmethod
    def nothing(cls, problem: PlanningProblem) -> "Tightening":
        """Return the tightening that leaves a problem unchanged."""
        zero = np.zeros(problem.tube.segment_count)
        joints = problem.robot.joint_count
        return cls(1.0, np.ones(joints), zero, zero, 0.0, np.zeros((2, joints)))

    def only(self, parts: Sequence[str]) -> "Tightening":
        """Return the tightening of some parts alone."""
        others: dict[str, Any] = {
            name: 0.0 * getattr(self, name) + (name in PARTS[:2])
            for name in PARTS
            if name not in parts
        }
        return replace(self, **others)

    def has(self, part: str) -> bool:
        """Return True if a part is tightened."""
        value = getattr(self, part)
        return bool(np.any(value != 1.0)) if part in PARTS[:2] else bool(np.any(value))

    def of_parts(self, tube: Tube) -> "Tightening":
        """Return the tightening for the segments that were joined to a tube's."""
        if tube.parts is None:
            return self
        every = np.arange(tube.parts.segment_count)
        joined = np.searchsorted(tube.part_points, every, side="right") - 1
        return replace(self, radius=self.radius[joined], rotation=self.rotation[joined])

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in PARTS}


def allowed_tightening(
    problem: PlanningProblem, requested: Tightening, ends: FloatArray
) -> Tightening:
    """Return a tightening reduced to the slack of limits, start and goal.

    The ends are the first and, if given, the last configuration of the motion, (1 or 2, n).
    """
    tube, limits = problem.tube, problem.robot.limits
    rotations, tool = problem.robot.tool_pose(ends)
    angle = np.zeros(tube.segment_count)
    if tube.rotation is not None:
        tightest = tube.rotation.bounds.min(axis=1)
        angle = np.where(np.isfinite(tightest), tightest, 0.0)
    radius = np.minimum(requested.radius, _MAX_FRACTION * tube.effective_radius)
    rotation = np.minimum(requested.rotation, _MAX_FRACTION * angle)
    margin, rotation_margin = tube.margin(tool), tube.rotation_margin(rotations, tool)
    for end, segment in enumerate((0, -1)[: len(ends)]):
        radius[segment] = min(radius[segment], margin[end, segment] - _ROUNDING)
        rotation[segment] = min(rotation[segment], rotation_margin[end, segment] - _ROUNDING)
    goal = problem.endpoints[1]
    if goal.kind == "position" and goal.region is not None:  # its position is to stay inside too
        margin = tube.margin(goal.region.position[None])
        radius[-1] = min(radius[-1], margin[0, -1] - _ROUNDING)
    slack = np.array([ends - limits.lower_position, limits.upper_position - ends]).min(axis=1)
    # Distances to obstacles at the ends. Pairs in contact do not count: they may stay as near.
    checker, poses = problem.collision, problem.robot.body_poses(ends)
    count = len(checker.obstacle_pairs)
    counts = ~in_contact(problem)[:count]
    segments = np.array([0, problem.tube.segment_count - 1])[: len(ends)]
    required = RequiredDistances(problem, ends[0], ends[-1])
    least = required.at(segments, problem.robot.tool_position(ends))[:, :count]
    distances = [
        checker.distances(*pose, checker.obstacle_pairs) for pose in zip(*poses, strict=True)
    ]
    spare_distance = float((np.array(distances) - least)[:, counts].min(initial=np.inf))
    distance = spare_distance - _ROUNDING
    at_rest = rest_margins(problem.robot, problem.holding, ends).min(initial=np.inf) - _ROUNDING
    return replace(
        requested,
        radius=radius.clip(min=0),
        rotation=rotation.clip(min=0),
        velocity=np.clip(requested.velocity, _MIN_VELOCITY, 1.0),
        position=np.minimum(requested.position, slack - _ROUNDING).clip(min=0),
        clearance=max(min(requested.clearance, distance), 0.0),
        holding=max(min(requested.holding, float(at_rest)), 0.0),
    )


def tightened_problem(problem: PlanningProblem, tightening: Tightening) -> PlanningProblem:
    """Return the problem with a tightening that is allowed; geometry is shared.

    Raises:
        ProblemError: Start or goal break a tightened limit.
    """
    farther = problem.farther_apart(tightening.clearance)
    limits, motors, ratio = problem.robot.limits, problem.robot.motors, tightening.effort
    limits = replace(
        limits,
        effort=ratio * limits.effort,
        effort_ranges=tuple(each.scaled(ratio) for each in limits.effort_ranges),
        velocity=tightening.velocity * limits.velocity,
        lower_position=limits.lower_position + tightening.position[0],
        upper_position=limits.upper_position - tightening.position[1],
    )
    motors = replace(motors, saturation_effort=ratio * motors.saturation_effort)
    return replace(
        farther,
        robot=problem.robot.with_limits(limits, motors),
        holding=[
            replace(each, backoff=each.backoff + tightening.holding) for each in problem.holding
        ],
        tube=narrowed_tube(farther.tube, tightening.radius, tightening.rotation),
    )


_UNITS = {"rotation": "rad", "position": "rad or mm"}


@dataclass(frozen=True, eq=False)
class Survival:
    """The survival of a plan under errors, as seen in simulated runs; it is not proved.

    Attributes:
        errors: The errors and the controller.
        verdict: Verdict of runs used for nothing else; None if planning was stopped before.
        reached: Whether all runs of the plan's search survive, with errors 1.3 times as large.
        tightening: The plan's tightening.
        duration_without: Duration of the plan without robustness [s].
        verdict_without: Verdict of the same runs with that plan; None if that plan is the answer,
            or planning was stopped before.
        costs: Cost of each part of the tightening, by name [s]; their sum is the whole cost.
        contribution: Contributions of errors; None where the plan survives at little cost.
    """

    errors: Robustness
    verdict: RunVerdict | None
    reached: bool
    tightening: Tightening
    duration_without: float
    verdict_without: RunVerdict | None
    costs: Mapping[str, float]
    contribution: ErrorContribution | None = None

    __repr__ = short_repr

    blame = FormerName("contribution")
    kept_back = FormerName("tightening")

    @property
    def added(self) -> float:
        """Cost of survival [s]."""
        return sum(self.costs.values())

    @property
    def seen(self) -> str:
        """Message on the verdict."""
        if self.verdict is None:
            return "its runs were not simulated to the end"
        return self.verdict.survived(self.errors)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the cost of survival, by parts, and on the errors to blame."""
        if not self.costs:
            return self._blamed
        parts = []
        for part, cost in self.costs.items():
            value = getattr(self.tightening, part)
            most = f"{1000 * float(np.max(value)):.2g} m{_UNITS.get(part, 'm')}"
            if part in PARTS[:2]:
                least = "as little as " * (part == "velocity")
                words = f"{least}{100 * float(np.min(value)):.3g} % of the {part} limits"
            elif part == "clearance":
                words = f"{most} more clearance"
            elif part == "holding":
                words = f"{100 * value:.3g} % of what contacts carry is kept back"
            else:
                words = f"up to {most} less {part.replace('position', 'joint range')}"
            parts.append(f"{words} ({1000 * cost:.1f} ms)")
        percent = 100 * self.added / self.duration_without
        without = f"without robustness the plan takes {self.duration_without:.4f} s"
        if self.verdict_without is not None:
            without += f", and {self.verdict_without}"
        costs = (
            f"surviving takes {1000 * self.added:.1f} ms more, {percent:.2g} %: "
            f"{'; '.join(parts)}; {without}"
        )
        return (costs, *self._blamed)

    @property
    def _blamed(self) -> tuple[str, ...]:
        if self.contribution is None:
            return ()
        is_short = self.contribution.short > 0
        if self.reached:
            return (f"the plan without robustness: {self.contribution}",) if is_short else ()
        none = "no plan was found that survives errors 1.3 times as large"
        return (f"{none}: {self.contribution}" if is_short else none,)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "reached": self.reached,
            "verdict": None if self.verdict is None else self.verdict.as_dict(),
            "verdict_without": None
            if self.verdict_without is None
            else self.verdict_without.as_dict(),
            "duration_without": self.duration_without,
            "kept_back": self.tightening.as_dict(),
            "costs": dict(self.costs),
            "blame": None if self.contribution is None else self.contribution.as_dict(),
        }
