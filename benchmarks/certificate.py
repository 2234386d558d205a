"""The certificate of the bundled arm problems: times, and how many intervals it looks at.

    python benchmarks/certificate.py [--repeats 9]

Every problem is judged as it is and with ten obstacles: boxes added at random places that the
trajectory does not touch. The last column is the median time as a share of what is aimed at: 50 ms
for two joints, 200 ms for six and seven.
"""

import argparse
import time

import numpy as np

from cases import ARMS
from tubeplanner import (
    Certificate,
    JointTrajectory,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    load_problem,
    placement_of,
    plan,
    verify,
)
from tubeplanner.verification.asked_distances import AskedDistances
from tubeplanner.verification.closest_approach import closest_approach
from tubeplanner.verification.enclosed_efforts import enclosed_efforts
from tubeplanner.verification.enclosed_pose import enclosed_tool
from tubeplanner.verification.judged_condition import Tolerance
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.tube_visits import least_margin, tube_visits

OBSTACLES = 10
AIM = {2: 0.05, 6: 0.2, 7: 0.2}  # [s] by number of joints
SEED = 1


def with_obstacles(problem: PlanningProblem, trajectory: JointTrajectory) -> PlanningProblem:
    """Return the problem with boxes added near the arm until it has ten obstacles."""
    rng = np.random.default_rng(SEED)
    reach = float(np.linalg.norm(problem.tube.points, axis=1).max())
    obstacles = list(problem.obstacles)[:OBSTACLES]
    while True:
        found = PlanningProblem(
            problem.robot,
            problem.tube,
            problem.start,
            problem.goal,
            obstacles,
            problem.attached,
            problem.clearance,
            name=problem.name,
        )
        if verify(found, trajectory).conditions["obstacles"].margin < 0:
            obstacles.pop()
            continue
        if len(obstacles) == OBSTACLES:
            return found
        center = rng.uniform(-1, 1, 3) * reach
        name = f"box_{len(obstacles)}_{rng.integers(10**6)}"
        obstacles.append(Obstacle.box(name, rng.uniform(0.05, 0.3, 3), placement_of(center)))


def intervals(problem: PlanningProblem, trajectory: JointTrajectory) -> str:
    """Return how many intervals tool, efforts, tube, obstacles and links were looked at on."""
    robot, checker = problem.robot, problem.collision
    tool = enclosed_tool(robot, trajectory, 1e-7)
    efforts = enclosed_efforts(robot, trajectory, 1e-7 * robot.limits.effort)
    visits = tube_visits(problem, trajectory, tool)
    counts = [
        len(tool.width),
        len(efforts.width),
        least_margin(problem.tube, tool, visits).intervals,
    ]
    motion = JudgedMotion(problem, trajectory, Tolerance())
    asked, first = AskedDistances(motion).over, len(checker.obstacle_pairs)
    for columns in (np.arange(first), np.arange(first, len(checker.pairs))):
        nearest = closest_approach(checker, trajectory, columns, asked)
        counts.append(0 if nearest is None else nearest.intervals)
    return " / ".join(map(str, counts))


def timed(
    problem: PlanningProblem, trajectory: JointTrajectory, repeats: int
) -> tuple[Certificate, list[float]]:
    """Return the certificate and the times it took [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        certificate = verify(problem, trajectory)
        times.append(time.perf_counter() - begin)
    return certificate, times


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9, help="of each certificate")
    options = parser.parse_args()
    print("Intervals: tool / efforts / tube / link-obstacle pairs / link-link pairs\n")
    print("| problem | method | obstacles | pairs | passes | intervals | time [ms] | of the aim |")
    print("|---|---|---|---|---|---|---|---|")
    for name in (*ARMS, "ur5/level_tray"):
        problem = load_problem(f"example:{name}")
        aim = AIM[problem.robot.joint_count]
        for method in ("stop-at-corners", "branch-and-bound"):
            result = plan(problem, PlanOptions(method).shortest)
            if result.method != method:
                continue
            cases = [problem]
            if len(problem.obstacles) < OBSTACLES:
                cases.append(with_obstacles(problem, result.trajectory))
            for judged in cases:
                certificate, times = timed(judged, result.trajectory, options.repeats)
                pairs = len(judged.collision.obstacle_pairs) + len(judged.collision.link_pairs)
                median = float(np.median(times))
                print(
                    f"| {name} | {method} | {len(judged.obstacles)} | {pairs} | "
                    f"{'yes' if certificate.passed else 'NO'} | "
                    f"{intervals(judged, result.trajectory)} | {1000 * median:.0f} | "
                    f"{median / aim:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
