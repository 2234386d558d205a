"""All baselines by name, each judged.

`verify` reports the conditions that a scheme violates: most are not smooth, and all ignore links
and obstacles.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tubeplanner.certificate.verification import Certificate, verify
from tubeplanner.first_guess.bang_bang import (
    bang_bang_parameterizations,
    bang_bang_trajectory,
    smoothed_trajectory,
)
from tubeplanner.first_guess.branches import (
    KnownBranches,
    ReferenceBranch,
    configured_ends,
    redundancy_rules,
)
from tubeplanner.first_guess.fastest_parameterization import NOT_PROVED
from tubeplanner.first_guess.line_schemes import (
    PAPER,
    bounded_deviation,
    conventional_trajectory,
    largest_trapezoidal_speed,
)
from tubeplanner.first_guess.tool_paths import ToolPath, tool_paths
from tubeplanner.outcome import Infeasible, PlanningClock, ProgressCallback
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# Numbers of intervals of the average of each segment's time parameterization: the fastest counts.
# The finest is about as fine as refinement's knots.
_SMOOTHED_INTERVALS = (64, 32, 16)
# The conditions that a scheme whose acceleration jumps cannot satisfy.
_SMOOTHNESS = {"rest", "continuity", "jerk", "effort_rate"}


@dataclass(frozen=True, eq=False)
class Baseline:
    """The trajectory of a scheme.

    Attributes:
        trajectory: The trajectory.
        note: Further information about it.
    """

    trajectory: JointTrajectory
    note: str


def conventional(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """Straight lines of the tool at trapezoidal speed, as fast as the limits allow, with stops."""
    lines = tool_paths(problem, branch, arcs=False)
    speed = largest_trapezoidal_speed(problem, lines)
    by_paper = sum(PAPER.duration(line.curve.length) for line in lines)
    note = (
        f"{speed.speed:.3g} m/s, {speed.acceleration:.3g} m/s^2; {by_paper:.2f} s at the paper's "
        f"{PAPER.speed:g} m/s, {PAPER.acceleration:g} m/s^2"
    )
    return Baseline(conventional_trajectory(problem.robot, lines, speed), note)


def bang_bang(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """The least time for the tool's straight lines, with stops, if motors switch instantly."""
    return _switched(problem, tool_paths(problem, branch, arcs=False), "")


def arc_corners(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """The same with corners cut by arcs inside the tube, without stops."""
    paths = tool_paths(problem, branch, arcs=True)
    radii = [1 / c for path in paths for c in path.curve.curvature if c > 0]
    note = f"arcs of {', '.join(f'{1000 * radius:.3g}' for radius in radii)} mm radius; "
    return _switched(problem, paths, note if radii else "")


def smoothed_bang_bang(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """Bang-bang on straight lines, with stops, averaged until it is C2 and starts at rest."""
    return _smoothed(problem, tool_paths(problem, branch, arcs=False))


def smoothed_arc_corners(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """The same with corners cut by arcs inside the tube, without stops."""
    return _smoothed(problem, tool_paths(problem, branch, arcs=True))


def taylor(problem: PlanningProblem, branch: ReferenceBranch) -> Baseline:
    """Joint lines within the tolerance of the tool's lines, joined by quadratic transitions."""
    result = bounded_deviation(problem, tool_paths(problem, branch, arcs=False))
    return Baseline(result.trajectory, f"{result.knots} knots")


BASELINES: Mapping[str, Callable[[PlanningProblem, ReferenceBranch], Baseline]] = MappingProxyType(
    {
        "conventional": conventional,
        "bang-bang": bang_bang,
        "smoothed-bang-bang": smoothed_bang_bang,
        "arc-corners": arc_corners,
        "smoothed-arc-corners": smoothed_arc_corners,
        "bounded-deviation": taylor,
    }
)


def judged_baseline(
    problem: PlanningProblem, name: str, progress: ProgressCallback | None = None
) -> tuple[Baseline, Certificate]:
    """Return a scheme's trajectory for a problem, and its certificate, passed or not.

    Tries rules for redundant joints in turn until only smoothness is violated; if no rule gets that
    far, the first trajectory counts.

    Args:
        problem: The planning problem.
        name: One of `BASELINES`.
        progress: Called as each stage begins.

    Raises:
        Infeasible: The scheme has no answer; the reason is that of the most natural rule.
    """
    problem, _ = configured_ends(problem.joined)
    branches = KnownBranches(problem, PlanningClock(None, progress))
    first: tuple[Baseline, Certificate] | None = None
    reasons: list[Infeasible] = []
    for rule in redundancy_rules(problem):
        try:
            baseline = BASELINES[name](problem, branches.by_rule(rule))
        except Infeasible as reason:
            reasons.append(reason)
            continue
        certificate = verify(problem, baseline.trajectory)
        if set(certificate.failures()) <= _SMOOTHNESS:
            return baseline, certificate
        first = first or (baseline, certificate)
    if first is None:
        raise reasons[0]
    return first


def _switched(problem: PlanningProblem, paths: list[ToolPath], arcs: str) -> Baseline:
    timings = bang_bang_parameterizations(problem, paths)
    trajectory, slowed = bang_bang_trajectory(problem, paths, timings)
    note = f"{arcs}slowed by {100 * slowed:.2g} % for what lies between TOPP-RA's grid points"
    if problem.robot.motors.has_less_at_speed:
        note += f"; {NOT_PROVED}"
    return Baseline(trajectory, note)


def _smoothed(problem: PlanningProblem, paths: list[ToolPath]) -> Baseline:
    """Return the fastest smoothed trajectory; the note gives the costs of smoothness."""
    timings = bang_bang_parameterizations(problem, paths)
    switched, _ = bang_bang_trajectory(problem, paths, timings)
    pieces = [1 + int((path.curve.curvature > 0).sum()) for path in paths]
    smoothed = {
        count: smoothed_trajectory(problem, paths, timings, [count * k for k in pieces])
        for count in _SMOOTHED_INTERVALS
    }
    best = min(smoothed, key=lambda count: smoothed[count].duration)
    costs = ", ".join(
        f"{100 * (trajectory.duration / switched.duration - 1):.2g} % with {count}"
        for count, trajectory in smoothed.items()
    )
    note = f"{best} intervals per segment; smoothness costs {costs}"
    return Baseline(smoothed[best], note)
