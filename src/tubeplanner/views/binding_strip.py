"""What binds when, of one motion or of several one after the other, as figures show it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.constraints.binding_limits import (
    Span,
    binding_rows,
    bound_share,
    clearance_use,
)
from tubeplanner.constraints.closest_pairs import ClosestPairs, closest_pairs
from tubeplanner.constraints.limit_use import LimitUses, limit_uses
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


@dataclass(frozen=True, eq=False)
class LimitedMotion:
    """A motion, how much of its limits it uses, and what it comes near.

    Attributes:
        problem: The planning problem.
        begin: When it begins [s].
        uses: How much of its limits it uses, its own time from zero on.
        closest: Its closest pairs at these samples.
    """

    problem: PlanningProblem
    begin: float
    uses: LimitUses
    closest: Sequence[ClosestPairs]

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.uses.samples.time[-1])


@dataclass(frozen=True)
class BindingStrip:
    """What binds when.

    Attributes:
        rows: By the names of joints, "tool" and "links": when which limit binds.
        shares: By kind of limit, in which share of the time one binds anywhere; those that do.
        speed_share: In which share of the time some limit on the speed does.
        duration: Of all [s].
        joint_count: How many of the rows are joints; they come first.
    """

    rows: Mapping[str, Sequence[Span]]
    shares: Mapping[str, float]
    speed_share: float
    duration: float
    joint_count: int


def limited_motion(
    problem: PlanningProblem, trajectory: JointTrajectory, begin: float = 0.0
) -> LimitedMotion:
    """Return what there is to say of a trajectory of a problem's joints, in any order."""
    uses = limit_uses(problem, trajectory)
    return LimitedMotion(
        problem, begin, uses, closest_pairs(problem, trajectory, uses.samples.time)
    )


def binding_strip(motions: Sequence[LimitedMotion], duration: float) -> BindingStrip:
    """Return what binds when in motions one after the other; between them, nothing.

    Args:
        motions: The motions, of the same joints.
        duration: From the beginning of the first to the end of all [s].
    """
    names = motions[0].problem.robot.joint_names
    rows: dict[str, list[Span]] = {}
    shares: dict[str, float] = {}
    speed_share = 0.0
    for motion in motions:
        weight = motion.duration / duration
        for row in binding_rows(names, motion.uses, motion.closest):
            shifted = [
                Span(span.kind, motion.begin + span.begin, motion.begin + span.end)
                for span in row.spans
            ]
            rows.setdefault(row.name, []).extend(shifted)
        uses = [*motion.uses.uses, *map(clearance_use, motion.closest)]
        for kind in dict.fromkeys(use.kind for use in uses):
            own = bound_share(motion.uses, [use for use in uses if use.kind == kind])
            shares[kind] = shares.get(kind, 0.0) + weight * own
        speed_share += weight * bound_share(motion.uses)
    binding = {kind: share for kind, share in shares.items() if share > 0}
    ordered = {name: rows[name] for name in (*names, *rows) if name in rows}
    joint_count = int(np.isin(list(ordered), names).sum())
    return BindingStrip(ordered, binding, speed_share, duration, joint_count)
