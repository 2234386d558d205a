"""What a checkout computes of random shapes: asked and answered by pickles on standard streams.

`same_numbers.py` starts this with the sources of a checkout. Names that have changed are in
`Interface` alone; once nobody compares with checkouts older than that, `older_interface` can go.
"""

import pickle
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tubeplanner import (
    LimitOverrides,
    Obstacle,
    Payload,
    PlanningProblem,
    RobotModel,
    Tube,
    load_robot,
    placement_of,
)
from tubeplanner.constraints import time_scaling
from tubeplanner.outcome import Infeasible
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.spline_constraints import Iterate, SplineConstraints
from tubeplanner.refinement.spline_start import knot_grid
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, from_spline

# Arms with their tools and what they carry [kg].
ARMS = (
    ("two_link", "hand", None),
    ("ur5", "tool0", None),
    ("panda", "panda_hand_tcp", Payload(0.5)),
    ("ur10", "tool0", Payload(5.0)),
    ("xarm7", "link_eef", Payload(5.0)),  # too much in some configurations
)
ACCELERATION, JERK = 15.0, 400.0  # limits, where there are any [rad/s^2], [rad/s^3]
SAMPLES = 50
HEAVY = 10.0  # duration of what no motor holds, slow enough for moderate efforts [s]
SHORTEST = 0.02  # [m] that the tool moves from one phase's end to the next

Numbers = dict[str, Any]


@dataclass(frozen=True)
class Interface:
    """What goes by other names in some checkouts.

    Attributes:
        factor: Returns b(t) of each sample of positions, velocities and accelerations, shape (N,).
        minimum: Returns the shortest duration of a shape [s].
        estimate: Returns a quick estimate of it [s].
        names: Returns kind and joint or segment of every limit, in the order of their numbers.
    """

    factor: Callable[..., np.ndarray]
    minimum: Callable[[PlanningProblem, JointTrajectory], float]
    estimate: Callable[[PlanningProblem, JointTrajectory], float]
    names: Callable[[SplineConstraints], list[tuple[str, int]]]


def present_interface() -> Interface:
    """Return the names of this checkout: the limits are a problem's."""

    def names(constraints: SplineConstraints) -> list[tuple[str, int]]:
        keys = constraints.keys
        return [(key.kind, key.segment if key.joint is None else key.joint) for key in keys]

    return Interface(
        time_scaling.scaling_factor,
        time_scaling.minimum_duration,
        time_scaling.estimated_duration,
        names,
    )


def older_interface() -> Interface:
    """Return the names of checkouts before limits were polynomials: the limits are an arm's."""
    return Interface(
        lambda problem, *at: time_scaling.scaling_factor(problem.robot, *at).min(axis=1),
        lambda problem, shape: time_scaling.minimum_duration(problem.robot, shape),
        lambda problem, shape: time_scaling.estimated_duration(problem.robot, shape),
        lambda constraints: constraints.names,
    )


def interface() -> Interface:
    """Return the names of the checkout whose sources are run."""
    is_older = hasattr(SplineConstraints, "names")
    return older_interface() if is_older else present_interface()


@cache
def arm(number: int, limited: int) -> RobotModel:
    """Return an arm with limits of acceleration as well (1), and with some of jerk (2)."""
    name, tool, payload = ARMS[number]
    joints = load_robot(f"example:{name}", tool).joint_names
    limits = LimitOverrides(
        acceleration=dict.fromkeys(joints if limited else (), ACCELERATION),
        jerk=dict.fromkeys(joints[::2] if limited == 2 else (), JERK),
    )
    return load_robot(f"example:{name}", tool, payload=payload, limits=limits)


def random_shape(seed: int) -> tuple[PlanningProblem, PhasedSpline, np.random.Generator]:
    """Return a problem and a spline through 1 to 3 phases; always the same of a seed.

    The tube is laid along the tool's way, an obstacle beside it; nothing need be kept.
    """
    rng = np.random.default_rng(seed)
    robot = arm(seed % len(ARMS), seed // len(ARMS) % 3)
    while True:
        spline = _random_spline(rng, robot)
        at_ends = spline.bspline()(spline.switching_times)
        rotation, tool = robot.tool_pose(at_ends)
        if np.linalg.norm(np.diff(tool, axis=0), axis=1).min() >= SHORTEST:
            break
    tolerance: dict[str, Any] = {}
    if rng.random() < 0.6:
        bounds = [0.3, [0.2, np.inf, 0.4], 0.5][: len(tool) - 1]
        turned = Rotation.from_matrix(rotation).as_quat()
        tolerance = {"orientations": turned, "rotation_tolerance": bounds}
    tube = Tube(tool, rng.uniform(0.02, 0.2, len(tool) - 1), **tolerance)
    beside = robot.tool_position(spline.bspline()(np.array([0.5])))[0] + rng.uniform(-0.1, 0.1, 3)
    ball = Obstacle.sphere("ball", 0.05, placement_of(beside))
    problem = PlanningProblem(robot, tube, at_ends[0], obstacles=[ball], clearance=0.01)
    return problem, spline, rng


def _random_spline(rng: np.random.Generator, robot: RobotModel) -> PhasedSpline:
    inner = np.sort(rng.uniform(0.2, 0.8, rng.integers(0, 3)))
    switching_times = np.concatenate([[0.0], inner, [1.0]])
    grid = knot_grid(switching_times, int(rng.integers(6, 15)))
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, np.pi)
    start = low + (high - low) * rng.uniform(0.3, 0.7, len(low))
    shape = grid.control_point_count, len(low)
    points = start + np.cumsum(rng.uniform(-0.15, 0.15, shape), axis=0)
    points[:3], points[-3:] = points[0], points[-1]
    return PhasedSpline(grid, switching_times, points)


def numbers(seed: int, names: Interface) -> Numbers:
    """Return what the sources compute of a shape, by kind."""
    problem, spline, rng = random_shape(seed)
    shape = from_spline(problem.robot.joint_names, spline.bspline())
    at = shape.at(np.linspace(0, 1, SAMPLES))
    links = LinkConstraints(problem)
    times = spline.switching_times
    links.look_at(spline, spline.grid.samples_at(times, np.linspace(0.2, 0.8, 9)))
    constraints = SplineConstraints(problem, spline.grid, links, problem.tube.effective_radius)
    return {
        "factors": names.factor(problem, at.position, at.velocity, at.acceleration),
        "spare": _spare(problem.robot, at.position),
        "minimum duration": _duration(names.minimum, problem, shape),
        "estimated duration": _duration(names.estimate, problem, shape),
        "names": names.names(constraints),
        **_of_the_optimiser(constraints, spline, rng),
    }


def _spare(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Return the share of its motor that gravity leaves, or lacks, of the tightest joint: (N,)."""
    share: np.ndarray = abs(1 - abs(robot.gravity_effort(q)) / robot.limits.effort).min(axis=1)
    return np.minimum(share, 1.0)


def _duration(
    compute: Callable[[PlanningProblem, JointTrajectory], float],
    problem: PlanningProblem,
    shape: JointTrajectory,
) -> float:
    """Return a duration [s], inf where gravity is too strong."""
    try:
        return compute(problem, shape)
    except Infeasible:
        return np.inf


def _of_the_optimiser(
    constraints: SplineConstraints, spline: PhasedSpline, rng: np.random.Generator
) -> Numbers:
    """Return rows at a spline, and their slacks at another one in another duration."""
    current = constraints.at(spline)
    least = current.squared_duration
    drawn = (least if np.isfinite(least) else HEAVY**2) * rng.uniform(0.5, 2.0)
    trial = constraints.at(_moved(spline, rng))
    squared_duration = float(rng.uniform(0.8, 1.2))
    current = replace(current, squared_duration=drawn)
    rows, elastic = constraints.rows(current, None)
    return {
        "squared duration": least,
        "excess": current.excess,
        "rows": vars(rows) | {"elastic": elastic},
        "second slack": constraints.slack(current, trial, squared_duration),
        "regions": [_region_rows(region) for region in _regions(current)],
    }


def _moved(spline: PhasedSpline, rng: np.random.Generator) -> PhasedSpline:
    points = spline.control_points + rng.uniform(-0.02, 0.02, spline.control_points.shape)
    points[:3], points[-3:] = spline.control_points[0], spline.control_points[-1]
    times = spline.switching_times.copy()
    times[1:-1] += rng.uniform(-0.01, 0.01, len(times) - 2)
    return PhasedSpline(spline.grid, np.sort(times), points)


def _regions(current: Iterate) -> Any:
    """Return the constraints that the tool is in regions; older checkouts have capsules."""
    return current.regions if hasattr(current, "regions") else current.capsules


def _region_rows(region: Any) -> Numbers:
    """Return the rows of a region's planes."""
    return vars(region.rows(region.planes))


def main() -> None:
    """Answer seeds until there are no more."""
    names = interface()
    for line in sys.stdin:
        pickle.dump(numbers(int(line), names), sys.stdout.buffer)
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
