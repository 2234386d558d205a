"""Plan random two-segment tubes for many arms: share planned, times, and every failure's reason.

    python benchmarks/any_arm.py [--seeds 10] [ARM ...]

A tube is made so that a solution is known to exist: a random walk of three configurations, free of
self-collision and holdable by the motors along the straight joint lines between them; the
reference points are the tool's positions at the three, the radius covers the walk's distance from
the straight lines. No problem is left out because the planner fails.
"""

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from tubeplanner import (
    LimitOverrides,
    Payload,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    RobotModel,
    ToolOffset,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.collision.collision_checker import CollisionChecker

MIN_RADIUS = 0.03  # [m]
MAX_STEP = 0.6  # [rad or m] of a joint from one configuration of the walk to the next
EFFORT_SHARE = 0.8  # of a motor's effort that holding still may need
WALK_SAMPLES = 41
MAX_TRIES = 20_000

GANTRY = """<robot name="gantry"><link name="base"/>
<link name="carriage"><inertial><mass value="20"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="column"><inertial><origin xyz="0 0 -0.2"/><mass value="8"/>
  <inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="4"/>
  <inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.06 0.06"/></geometry></collision>
</link><link name="tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/>
  <origin xyz="0 0 1"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="300" velocity="1.5"/></joint>
<joint name="lift" type="prismatic"><parent link="carriage"/><child link="column"/>
  <axis xyz="0 0 1"/><limit lower="-0.6" upper="0" effort="400" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="column"/><child link="arm"/>
  <origin xyz="0 0 -0.4"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="60" velocity="3"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.4 0 0"/>
</joint></robot>"""


def gantry() -> RobotModel:
    """Return an arm with two sliding joints and a turning one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gantry.urdf"
        path.write_text(GANTRY)
        return load_robot(path, "tip")


def two_link() -> RobotModel:
    """Return the paper's arm, without gravity and velocity limits."""
    unlimited = LimitOverrides(velocity={"joint1": math.inf, "joint2": math.inf})
    return load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=unlimited)


def double_pendulum() -> RobotModel:
    """Return example-robot-data's pendulum, given the limits and the tool that it lacks."""
    both = ("joint1", "joint2")
    limits = LimitOverrides(
        effort=dict.fromkeys(both, 5.0),
        velocity=dict.fromkeys(both, 6.0),
        position=dict.fromkeys(both, (-3.0, 3.0)),
    )
    offset = ToolOffset(position=(0.0, 0.0, 0.2))
    return load_robot("example:double_pendulum", "link2", limits=limits, tool_offset=offset)


ARMS: dict[str, Callable[[], RobotModel]] = {
    "two_link": two_link,
    "ur3": lambda: load_robot("example:ur3", "tool0"),
    "ur5": lambda: load_robot("example:ur5", "tool0"),
    "ur10, 5 kg": lambda: load_robot("example:ur10", "tool0", payload=Payload(5.0, (0, 0, 0.1))),
    "ur10, on a wall": lambda: load_robot("example:ur10", "tool0", gravity=(-9.81, 0, 0)),
    "panda": lambda: load_robot("example:panda", "panda_hand_tcp"),
    "xarm7": lambda: load_robot("example:xarm7", "link_eef"),
    "z1": lambda: load_robot("example:z1", "link06"),
    "kinova": lambda: load_robot("example:kinova", "j2s6s200_end_effector"),
    "talos_arm": lambda: load_robot("example:talos_arm", "arm_left_7_link"),
    "baxter, left": lambda: load_robot("example:baxter", "left_gripper"),
    "so101": lambda: load_robot("example:so101", "gripper_link"),
    "asr_twodof": lambda: load_robot("example:asr_twodof", "Tip"),
    "double_pendulum": double_pendulum,
    "gantry": gantry,
}


def random_problem(robot: RobotModel, seed: int) -> PlanningProblem:
    """Return a two-segment tube around a random walk that is itself a solution."""
    rng = np.random.default_rng(seed)
    checker = CollisionChecker(robot)
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, low + 2 * np.pi)
    for _ in range(MAX_TRIES):
        knots = [rng.uniform(low, high)]
        for _ in range(2):
            step = rng.uniform(-MAX_STEP, MAX_STEP, len(low))
            knots.append(np.clip(knots[-1] + step, low, high))
        share = np.linspace(0, 1, WALK_SAMPLES)[:, None]
        legs = [(1 - share) * a + share * b for a, b in pairwise(knots)]
        if _is_sound(robot, checker, np.vstack(legs)):
            return _around(robot, knots, legs, checker)
    raise RuntimeError(f"{robot.name}: no sound walk in {MAX_TRIES} tries")


def _is_sound(robot: RobotModel, checker: CollisionChecker, q: np.ndarray) -> bool:
    if (abs(robot.gravity_effort(q)) > EFFORT_SHARE * robot.limits.effort).any():
        return False
    tool = robot.tool_position(q[[0, WALK_SAMPLES - 1, -1]])
    if np.linalg.norm(np.diff(tool, axis=0), axis=1).min() < 0.02:
        return False
    poses = robot.body_poses(q[::4])
    pairs = checker.link_pairs
    return all(
        checker.distances(rotation, position, pairs).min(initial=1.0) > 0
        for rotation, position in zip(*poses, strict=True)
    )


def _around(
    robot: RobotModel, knots: list[np.ndarray], legs: list[np.ndarray], checker: CollisionChecker
) -> PlanningProblem:
    points = robot.tool_position(np.array(knots))
    centre = Tube(points, 1.0)
    off = [centre.distance(robot.tool_position(leg))[:, k].max() for k, leg in enumerate(legs)]
    radius = np.maximum(1.2 * np.array(off), MIN_RADIUS)
    return PlanningProblem(robot, Tube(points, radius), knots[0])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("arms", nargs="*", metavar="ARM", help=f"of {', '.join(ARMS)}")
    parser.add_argument("--seeds", type=int, default=10, help="problems per arm")
    options = parser.parse_args()
    print("| arm | joints | load [s] | planned | duration [s] | planning [s] | certificate [s] |")
    print("|---|---|---|---|---|---|---|")
    failures = []
    for name in options.arms or ARMS:
        begin = time.perf_counter()
        robot = ARMS[name]()
        CollisionChecker(robot)
        loading = time.perf_counter() - begin
        problems = [random_problem(robot, seed) for seed in range(options.seeds)]
        for problem in problems:
            _ = problem.collision  # geometry is built before planning begins
        results = [plan(problem, PlanOptions().shortest) for problem in problems]
        print(_row(name, robot, loading, results), flush=True)
        failures += [
            f"{name}, seed {seed}: {result.status}: {result.message}"
            for seed, result in enumerate(results)
            if not result.succeeded
        ]
    print("\n".join(["", "Not planned:", *(failures or ["none"])]))


def _row(name: str, robot: RobotModel, loading: float, results: list[PlanResult]) -> str:
    good = [result for result in results if result.succeeded]
    planned = f"{len(good)} of {len(results)}"
    medians = [
        f"{np.median(values):.2f}" if values else ""
        for values in (
            [result.duration for result in good],
            [result.planning_time for result in good],
            [result.certificate_time for result in good],
        )
    ]
    return f"| {name} | {robot.joint_count} | {loading:.2f} | {planned} | {' | '.join(medians)} |"


if __name__ == "__main__":
    main()
