"""Baselines by name, each judged: bang-bang control of a fixed path, its average, lines.

`verify` reports the conditions that a scheme violates: most are not smooth, and all ignore links
and obstacles. A path is stored as the trajectory that runs it at unit speed, a time
parameterization as the trajectory of a single joint: the arc length along the path.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from scipy.interpolate import PPoly
from scipy.ndimage import minimum_filter1d
from scipy.optimize import elementwise
from scipy.special import factorial

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.verification import Certificate, verify
from tubeplanner.errors import not_installed
from tubeplanner.first_guess.branches import (
    KnownBranches,
    ReferenceBranch,
    configured_ends,
    redundancy_rules,
)
from tubeplanner.first_guess.fastest_parameterization import NOT_PROVED, fastest_parameterization
from tubeplanner.first_guess.line_schemes import (
    PAPER,
    bounded_deviation,
    conventional_trajectory,
    largest_trapezoidal_speed,
)
from tubeplanner.first_guess.tool_paths import ToolPath, tool_paths
from tubeplanner.limits.speed_limits import (
    estimated_duration,
    minimum_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, ProgressCallback
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, averaged, concatenate

# ---- The schemes by name.

# Numbers of intervals of the average of each segment's time parameterization: the fastest counts.
# The finest is about as fine as refinement's knots.
_SMOOTHED_INTERVALS = (64, 32, 16)
# The conditions that a scheme whose acceleration jumps cannot satisfy.
_SMOOTHNESS = {"rest", "continuity", "jerk", "effort_rate"}


@dataclass(frozen=True, eq=False)
class Baseline:
    """The trajectory of a scheme."""

    trajectory: JointTrajectory
    note: str  # numbers of the scheme, for reports


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
    trajectory, knots = bounded_deviation(problem, tool_paths(problem, branch, arcs=False))
    return Baseline(trajectory, f"{knots} knots")


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
    """Return the trajectory of one of `BASELINES`, and its certificate, passed or not.

    Tries rules for redundant joints in turn until only smoothness is violated; if no rule gets that
    far, the first trajectory counts.

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
    least = sum(timing.duration for timing in timings)
    note = f"{arcs}slowed by {100 * slowed:.2g} % from {least:.4f} s, for what lies between samples"
    if problem.robot.motors.has_less_at_speed:
        note += f"; {NOT_PROVED}"
    return Baseline(trajectory, f"{note}; {_of_toppra(problem, paths)}")


def _of_toppra(problem: PlanningProblem, paths: list[ToolPath]) -> str:
    """Return the duration by TOPP-RA itself along the same paths [s], or the reason without it."""
    if find_spec("toppra") is None:
        return not_installed("compare", "a comparison with TOPP-RA itself", "toppra")
    try:
        timings = bang_bang_parameterizations(problem, paths, by_toppra=True)
    except Infeasible:
        return "TOPP-RA itself has no answer"
    return f"TOPP-RA itself: {sum(timing.duration for timing in timings):.4f} s"


def _smoothed(problem: PlanningProblem, paths: list[ToolPath]) -> Baseline:
    """Return the fastest smoothed trajectory; the note gives the costs of smoothness."""
    timings = bang_bang_parameterizations(problem, paths)
    switched, _ = bang_bang_trajectory(problem, paths, timings)
    pieces = [1 + int((path.curve.curvature > 0).sum()) for path in paths]
    smoothed = {
        count: concatenate(
            [
                _smoothed_run(problem, path.joints, timing, count * k)
                for path, timing, k in zip(paths, timings, pieces, strict=True)
            ]
        )
        for count in _SMOOTHED_INTERVALS
    }
    best = min(smoothed, key=lambda count: smoothed[count].duration)
    costs = ", ".join(
        f"{100 * (trajectory.duration / switched.duration - 1):.2g} % with {count}"
        for count, trajectory in smoothed.items()
    )
    note = f"{best} intervals per segment; smoothness costs {costs}"
    return Baseline(smoothed[best], note)


# ---- Paths composed with time parameterizations: polynomials of polynomials, exactly.

_SAME_TIME = 1e-9  # of the duration: pieces shorter than this are none


def run_along(path: JointTrajectory, timing: JointTrajectory) -> JointTrajectory:
    """Return the trajectory along a path with a time parameterization, which never falls.

    It is the composition, exactly; its degree is the product of both degrees.
    """
    reached = times_at(timing, path.breakpoints[1:-1])
    nearest = abs(reached[:, None] - timing.breakpoints).min(axis=1)
    times = np.append(timing.breakpoints, reached[nearest > _SAME_TIME * timing.duration])
    times = np.sort(times)
    times = times[np.append(True, np.diff(times) > _SAME_TIME * timing.duration)]
    times[-1] = timing.duration
    middle = timing.position((times[:-1] + times[1:]) / 2)[:, 0]
    piece = np.clip(np.searchsorted(path.breakpoints, middle) - 1, 0, len(path.widths) - 1)
    # Coefficients of the arc length, (r+1, P), in the pieces between the new times.
    polynomial = PPoly(timing.coefficients[:, :, 0], timing.breakpoints)
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    # Looked up at the middles, expanded about the starts: rounding cannot pick a neighbouring
    # piece.
    half = np.diff(times) / 2
    arc_length = np.array(
        [polynomial.derivative(p)(times[:-1] + half) / factorial(p) for p in powers]
    )
    for last in range(len(arc_length), 1, -1):  # repeated synthetic division
        for k in range(1, last):
            arc_length[k] += -half * arc_length[k - 1]
    # Horner's scheme in polynomials: coefficients of the composition, (degree*r+1, P, n).
    arc_length[-1] -= path.breakpoints[piece]
    rows = path.coefficients[:, piece]
    result = rows[:1]
    for row in rows[1:]:
        product = np.zeros((len(result) + len(arc_length) - 1, *row.shape))
        for power, factor in enumerate(arc_length):
            product[power : power + len(result)] += factor[:, None] * result
        product[-1] += row
        result = product
    return JointTrajectory(path.joint_names, times, result)


def times_at(timing: JointTrajectory, arc_length: FloatArray) -> FloatArray:
    """Return the times (N,) [s] at which a time parameterization reaches arc lengths (N,)."""
    if len(arc_length) == 0:
        return np.zeros(0)
    arc_length = np.clip(arc_length, timing.position(0.0), timing.position(timing.duration))
    times: FloatArray = elementwise.find_root(
        lambda t, arc_length: timing.position(t)[:, 0] - arc_length,
        (np.zeros(len(arc_length)), np.full(len(arc_length), timing.duration)),
        args=(arc_length,),
    ).x
    return times


def averaged_parameterization(timing: JointTrajectory, intervals: int) -> JointTrajectory:
    """Return the average over equal intervals, at least 3: a C2 cubic spline that never falls.

    Its duration is longer by two of them.
    """
    return averaged(timing, intervals, timing.duration * intervals / (intervals - 2))


# ---- Bang-bang control on given paths: the least time from rest to rest.
#
# At every instant some motor or velocity is at its limit, and motors switch instantly: the
# acceleration jumps. (Bobrow, Dubowsky & Gibson, "Time-optimal control of robotic manipulators
# along specified paths", 1985; Shin & McKay, 1985.)

# Steps between the points where limits are judged: of a whole path, and of each line or arc in it.
_PATH_STEPS, _PIECE_STEPS = 800, 400


def bang_bang_parameterizations(
    problem: PlanningProblem, paths: Sequence[ToolPath], *, by_toppra: bool = False
) -> list[JointTrajectory]:
    """Return the fastest time parameterization of each path, from rest to rest.

    With `by_toppra` the library toppra solves, which takes no cones.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or no time parameterization is found.
    """
    timings = []
    for path in paths:
        breakpoints, length = path.joints.breakpoints, path.joints.duration
        least = max(_PATH_STEPS, _PIECE_STEPS * len(path.curve.start))
        counts = np.ceil(least * path.joints.widths / length).astype(int)
        parts = [
            np.linspace(begin, end, count, endpoint=False)
            for (begin, end), count in zip(pairwise(breakpoints), counts, strict=True)
        ]
        grid = np.append(np.concatenate(parts), length)
        timing = fastest_parameterization(problem, path.joints, grid, by_toppra=by_toppra)
        if timing is None:
            raise Infeasible(
                PlanStatus.NO_TRAJECTORY,
                f"segment {path.segment}: there is no speed at which the arm can run the tool's "
                "curve from rest to rest; move the reference points",
                Location(segment=path.segment),
            )
        timings.append(timing)
    return timings


def bang_bang_trajectory(
    problem: PlanningProblem, paths: Sequence[ToolPath], timings: Sequence[JointTrajectory]
) -> tuple[JointTrajectory, float]:
    """Return the trajectory along paths with time parameterizations: degree 6, within limits.

    The time parameterizations keep the limits at points of their paths. All are slowed uniformly
    until limits hold in between too. Limits of jerk are left out, since the acceleration jumps.

    Returns:
        The trajectory, and the fraction by which it is slowed.
    """
    runs = [run_along(path.joints, timing) for path, timing in zip(paths, timings, strict=True)]
    trajectory = concatenate(runs)
    ratio = minimum_duration(problem, trajectory, with_jerk=False) / trajectory.duration
    return trajectory.scaled(ratio), ratio - 1


# ---- Smoothed bang-bang control: the same path with an average of its time parameterization.
#
# The average is C2 and begins and ends at rest without acceleration. Where that violates a limit,
# the time parameterization is slowed locally before it is averaged again; the rest is slowed
# uniformly. Finer averages cost ever less: the allowed jerk sets the price of smoothness.

_ROUNDS = 8
_SAMPLES_PER_INTERVAL = 8  # at the limits, per interval
# A round's slowing is spread over neighbouring intervals too, in steps.
_WINDOW, _POWER, _MAX_GAIN = 2 * _SAMPLES_PER_INTERVAL + 1, 0.6, 1.2


def _smoothed_run(
    problem: PlanningProblem, path: JointTrajectory, timing: JointTrajectory, intervals: int
) -> JointTrajectory:
    """Return a path run by the average of its time parameterization, at its limits: C2, degree 9.

    It is the fastest of all rounds.
    """
    factor, shortest, best = np.ones(len(timing.widths)), np.inf, path
    middle = timing.position((timing.breakpoints[:-1] + timing.breakpoints[1:]) / 2)[:, 0]
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    for _ in range(_ROUNDS):
        stretched = np.concatenate([[0.0], np.cumsum(factor * timing.widths)])
        rows = timing.coefficients / (factor ** powers[:, None])[:, :, None]
        stretched_timing = JointTrajectory(timing.joint_names, stretched, rows)
        smooth = averaged_parameterization(stretched_timing, intervals)
        trajectory = run_along(path, smooth)
        duration = estimated_duration(problem, trajectory)
        if duration < shortest:
            shortest, best = duration, trajectory
        times = np.linspace(0, trajectory.duration, _SAMPLES_PER_INTERVAL * intervals + 1)
        samples = trajectory.at(times)
        allowed = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
        least = minimum_filter1d(allowed, _WINDOW)
        speed_factor = np.interp(middle, smooth.position(samples.time)[:, 0], least)
        factor = factor / np.minimum(speed_factor, _MAX_GAIN) ** _POWER
    return scaled_to_limits(problem, best)
