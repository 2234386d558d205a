"""Which configurations of an arm are reachable and free along each segment of a tube.

The signs of the joints that fold distinguish configurations: elbow up or down, and the like.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from tubeplanner.arguments import given_options
from tubeplanner.arrays import FloatArray
from tubeplanner.branches.reference_branch import RedundancyRule, reference_branch
from tubeplanner.errors import ProblemError
from tubeplanner.measurement.branch_neighbourhood import BranchNeighbourhood
from tubeplanner.measurement.configuration_set import ConfigurationSet
from tubeplanner.measurement.folding_joints import folding_joints
from tubeplanner.measurement.measured_tube import MeasureOptions
from tubeplanner.measurement.pair_clearance import PairClearance
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.progress import Progress, ProgressCallback, require_callback
from tubeplanner.short_repr import short_repr

_SEEDS = 24  # configurations, of this many samples, from which to search for a branch
_SAMPLES = 600
_NEAR_LINE = 0.01  # [m]
_FREE_BRANCHES = 2  # so many free branches are measured; the best counts


@dataclass(frozen=True, eq=False)
class PatternRow:
    """One sign pattern in one segment.

    Attributes:
        segment: Index of the segment.
        signs: "+" or "-" by joint name.
        reachable: Whether the arm can follow the centre line with these signs.
        free: Whether it can without a collision.
        radius: The best radius found, as far as a rough measurement tells [m]; None unless free.
        message: Why not, where it is not free.
    """

    segment: int
    signs: Mapping[str, str]
    reachable: bool
    free: bool
    radius: float | None
    message: str

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**vars(self), "signs": dict(self.signs)}


@dataclass(frozen=True, eq=False)
class PatternSurvey:
    """Sign patterns of all segments.

    Attributes:
        rows: One for every segment and pattern.
        suggested: The pattern, the same in all segments, whose smallest radius is largest; None if
            none is free in all of them.
    """

    rows: tuple[PatternRow, ...]
    suggested: Mapping[str, str] | None

    __repr__ = short_repr

    @property
    def message(self) -> str:
        """The suggestion, in one sentence."""
        if self.suggested is None:
            return "no sign pattern is free in all segments"
        if not self.suggested:
            return "no joint of this arm folds: there are no signs to choose"
        signs = ", ".join(f'{name}: "{sign}"' for name, sign in self.suggested.items())
        return f"suggested joint_signs: {{{signs}}}"

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        found = self.suggested is not None
        return {
            "status": str(PlanStatus.SUCCESS if found else PlanStatus.TUBE_BLOCKED),
            "message": self.message,
            "suggested": None if self.suggested is None else dict(self.suggested),
            "configurations": [row.as_dict() for row in self.rows],
        }


def survey_patterns(
    problem: PlanningProblem,
    options: MeasureOptions | None = None,
    progress: ProgressCallback | None = None,
) -> PatternSurvey:
    """Find out which sign patterns are reachable and free in each segment of a tube.

    Ignores the file's signs of folding joints, its start and its goal; its ranges of other joints
    count.

    Args:
        problem: The planning problem.
        options: How to measure.
        progress: Called as each pattern begins.

    Raises:
        OptionError: There are too many segments, or an argument is of another kind.
        ProblemError: The problem is none, or a segment has a box.
    """
    PlanningProblem.require(problem)
    options = given_options(options, MeasureOptions)
    require_callback(progress)
    problem.tube.require_discs("measuring, which gives radii", "leave out tube.cross_section")
    options.require_few(problem.tube.segment_count)
    names = [problem.robot.joint_names[joint] for joint in folding_joints(problem.robot)]
    patterns = [dict(zip(names, signs, strict=True)) for signs in product("+-", repeat=len(names))]
    rows = []
    for k in range(problem.tube.segment_count):
        of_all = f"segment {k + 1} of {problem.tube.segment_count}"
        for number, signs in enumerate(patterns, start=1):
            if progress is not None:
                progress(Progress(f"{of_all}, sign pattern {number} of {len(patterns)}"))
            rows.append(_row(problem, k, signs, options))
    return PatternSurvey(tuple(rows), _suggested(rows, patterns))


def _suggested(rows: list[PatternRow], patterns: list[dict[str, str]]) -> Mapping[str, str] | None:
    def least(signs: Mapping[str, str]) -> float:
        return min(row.radius or 0.0 for row in rows if row.signs == signs)

    best = max(patterns, key=least)
    return best if least(best) > 0 else None


def _row(
    problem: PlanningProblem, k: int, signs: Mapping[str, str], options: MeasureOptions
) -> PatternRow:
    reachable, why, radii = False, "", []
    for alone in _posed(problem, k, signs, options):
        try:
            branch = reference_branch(alone, RedundancyRule.AS_NEEDED)
            reachable = True
            found = BranchNeighbourhood(alone, branch, options).first_search(0)
            radii.append(found.allowed.radius + problem.tube.tool_radius)
        except Infeasible as reason:
            if reachable or not why:
                why = f"{reason.status}: {replace(reason.place, segment=k)}"
        if len(radii) == _FREE_BRANCHES:
            break
    radius = max(radii, default=None)
    return PatternRow(k, signs, reachable, bool(radii), radius, "" if radii else why)


def _posed(
    problem: PlanningProblem, k: int, signs: Mapping[str, str], options: MeasureOptions
) -> Iterator[PlanningProblem]:
    """Yield the problem of one segment alone, with a pattern's signs, from random seeds.

    Seeds are near the centre line; those that are free come first.
    """
    tube, rng = problem.tube, np.random.default_rng([options.seed, k])
    asked = ({**tube.joint_ranges[k], **signs},)
    widest = tube.with_points([k, k + 1], [k]).with_radius(options.max_radius)
    try:
        alone = problem.along(
            replace(widest, joint_signs=asked),
            Seed(problem.robot.limits.clip(np.zeros(problem.robot.joint_count))),
        )
    except ProblemError:  # the position limits leave no value with such a sign
        return
    lower, upper = _one_turn(alone.joint_lower[0], alone.joint_upper[0])
    q = ConfigurationSet(alone, 0, lower, upper, _NEAR_LINE).sample(_SAMPLES, rng)
    free = PairClearance(alone, 0.0).least(q, 0.0).clearance > 0
    order = np.argsort(~free, kind="stable")  # the free ones first
    for seed in q[order[:_SEEDS]]:
        yield problem.along(alone.tube, Seed(seed))


def _one_turn(lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return joint bounds narrowed to one turn about zero, as far as they have it."""
    low = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))
    return low, np.minimum(upper, low + 2 * np.pi)
