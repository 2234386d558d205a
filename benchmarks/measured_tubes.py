"""Does a measured tube survive another sampler and another library, and what does it save?

    python benchmarks/measured_tubes.py [PROBLEM ...]

For every problem: time to measure, radii and what ends them, collisions among 10,000 fresh random
configurations, and the planned durations, measured against as written.
"""

import argparse
from dataclasses import dataclass

import coal
import numpy as np

from shared import ARMS
from tubeplanner import PlanningProblem, PlanOptions, load_problem, measure_tube, plan
from tubeplanner.arrays import FloatArray

CONFIGURATIONS = 10_000
SEED = 1988
_PROJECTIONS, _WALK = 40, 6
_WALK_STEP = 0.15  # of the ranges


def main() -> None:
    """Measure, attack and plan every problem named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=[*ARMS, "ur5/level_tray"], metavar="PROBLEM")
    for name in parser.parse_args().names:
        problem = load_problem(f"example:{name}")
        result = measure_tube(problem)
        print(f"{name}: {result.status} in {result.measuring_time:.1f} s: {result.message}")
        if result.problem is None:
            continue
        for k, segment in enumerate(result.segments):
            ends = [str(each.location) for each in segment.bindings if each.bound == "radius"]
            print(f"  segment {k}: {1000 * segment.radius:.1f} mm, ended by {ends or 'nothing'}")
        rng = np.random.default_rng(SEED)
        count = problem.tube.segment_count
        fraction = [CONFIGURATIONS // count + (k < CONFIGURATIONS % count) for k in range(count)]
        attacks = [random_attack(result.problem, k, n, rng) for k, n in enumerate(fraction)]
        print(
            f"  attacked by {sum(attack.configurations for attack in attacks)} configurations: "
            f"{sum(attack.collisions for attack in attacks)} collisions, least clearance "
            f"{1000 * min(attack.least_clearance for attack in attacks):.2f} mm"
        )
        shortest = PlanOptions(slack=0.0)
        written, measured = plan(problem, shortest), plan(result.problem, shortest)
        print(f"  as written, radii {problem.tube.radius}: {written.message}")
        print(f"  measured: {measured.status}: {measured.message}", flush=True)


@dataclass(frozen=True)
class CounterexampleCount:
    """What an attack on one segment found.

    Attributes:
        configurations: How many were looked at.
        collisions: How many of them collide.
        least_clearance: The least distance beyond what is required [m].
    """

    configurations: int
    collisions: int
    least_clearance: float


def random_attack(
    problem: PlanningProblem, segment: int, count: int, rng: np.random.Generator
) -> CounterexampleCount:
    """Draw configurations that a segment allows and measure all distances in each.

    Args:
        problem: Its tube is attacked.
        segment: Index of the segment.
        count: How many configurations.
        rng: Random numbers.
    """
    q = random_configurations(problem, segment, count, rng)
    clearance = coal_clearance(problem, q)
    return CounterexampleCount(len(q), int((clearance < 0).sum()), float(clearance.min()))


def is_allowed(problem: PlanningProblem, segment: int, q: FloatArray) -> np.ndarray:
    """Return which configurations (N, n) a segment allows: bool, shape (N,)."""
    rotation, tool = problem.robot.tool_pose(q)
    inside = problem.tube.margin(tool)[:, segment] >= 0
    inside &= problem.tube.rotation_margin(rotation, tool)[:, segment] >= 0
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    return inside & ((q >= lower) & (q <= upper)).all(axis=1)


def random_configurations(
    problem: PlanningProblem, segment: int, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return `count` random configurations that a segment allows, shape (count, n)."""
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    lower = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))
    upper = np.minimum(upper, lower + 2 * np.pi)
    found: list[FloatArray] = []
    while sum(map(len, found)) < count:
        q = _projected(problem, segment, rng.uniform(lower, upper, (count, len(lower))), rng)
        q = q[is_allowed(problem, segment, q)]
        for _ in range(_WALK):  # away from where the projection likes to end
            step = rng.normal(scale=_WALK_STEP, size=q.shape) * (upper - lower)
            moved = _projected(problem, segment, np.clip(q + step, lower, upper), rng, steps=3)
            keep = is_allowed(problem, segment, moved)
            q[keep] = moved[keep]
        found.append(q)
    return np.concatenate(found)[:count]


def coal_clearance(problem: PlanningProblem, q: FloatArray) -> FloatArray:
    """Return the least distance beyond what is required, by coal, for (N, n): (N,) [m]."""
    checker = problem.collision
    solids = [_solid(shape.shape) for shape in checker.shapes]
    pairs = [(i, j, problem.clearance) for i, j in checker.obstacle_pairs]
    pairs += [(i, j, 0.0) for i, j in checker.link_pairs]
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    clearance = np.empty(len(q))
    for row, (rotation, position) in enumerate(zip(*problem.robot.body_poses(q), strict=True)):
        placed = [
            coal.Transform3s(rotation[shape.body], position[shape.body]) for shape in checker.shapes
        ]
        grown = [shape.shape.radius for shape in checker.shapes]
        clearance[row] = min(
            coal.distance(
                solids[i], placed[i], solids[j], placed[j], request, coal.DistanceResult()
            )
            - grown[i]
            - grown[j]
            - required
            for i, j, required in pairs
        )
    return clearance


def _projected(
    problem: PlanningProblem,
    segment: int,
    q: FloatArray,
    rng: np.random.Generator,
    steps: int = _PROJECTIONS,
) -> FloatArray:
    """Move configurations by pseudo-inverse steps until tools are at random points of a capsule.

    Turned as a rotation tolerance allows, by random shares of it.
    """
    begin, end = problem.tube.points[segment : segment + 2]
    radius = problem.tube.effective_radius[segment]
    offset = rng.normal(size=(len(q), 3))
    offset *= (rng.uniform(0, 1, len(q)) ** (1 / 3) / np.linalg.norm(offset, axis=1))[:, None]
    wanted = begin + rng.uniform(0, 1, (len(q), 1)) * (end - begin) + radius * offset
    fraction = rng.uniform(0, 1, (len(q), 1))
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    for _ in range(steps):
        residual, jacobian = _residual(problem, segment, q, wanted, fraction)
        inverse = np.linalg.pinv(jacobian, rcond=1e-2)
        step = np.clip(np.einsum("nij,nj->ni", inverse, residual), -0.3, 0.3)
        q = np.clip(q + step, lower, upper)
    return q


def _residual(
    problem: PlanningProblem, segment: int, q: FloatArray, wanted: FloatArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what is missing to wanted points and turns, shape (N, c), and its Jacobian."""
    rotation, tool, jacobian = problem.robot.tool_pose_jacobian(q)
    rotational = problem.tube.rotation
    if rotational is None:
        return wanted - tool, jacobian[:, :3]
    where = np.full(len(q), segment)
    error, turning = rotational.error_jacobian(rotation, tool, jacobian, where)
    # The last bound is that of the whole angle.
    most = fraction * np.minimum(rotational.bounds[segment][:3], rotational.bounds[segment][3])
    missing = np.clip(error, -most, most) - error
    return np.hstack([wanted - tool, missing]), np.concatenate([jacobian[:, :3], turning], axis=1)


def _solid(shape: object) -> object:
    """Return coal's solid of a convex shape, not grown."""
    vertices = shape.vertices
    if len(vertices) == 1:
        vertices = vertices + 1e-9 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    if len(vertices) == 2:
        beside = np.array([[1e-9, 0, 0], [0, 1e-9, 0]])
        vertices = np.concatenate([vertices, vertices + beside[0], vertices + beside[1]])
    model = coal.BVHModelOBBRSS()
    model.beginModel(0, len(vertices))
    model.addVertices(np.asfortranarray(vertices))
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex


if __name__ == "__main__":
    main()
