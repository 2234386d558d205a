"""Does a motion lose the part that it carries, planned with and without `holding`?

    python benchmarks/held_parts.py [--count 100] [--seed 0] [--output F.jsonl]

Bundled problems of four arms, with random radii and a random cup, tray, gripper or open vessel.
Each is planned with its contact and without it. Both motions are run exactly; the part is a free
body in MuJoCo. Trays and vessels are upright where the motion begins. A liquid is spilt
where its cone is left.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from journals import Fields, journalled
from tubeplanner import PlanningProblem, PlanOptions, load_problem, plan
from tubeplanner.errors import TubePlannerError
from tubeplanner.execution.held_parts import LOST, MOVED, most_used, parts_moved
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.simulation import AFTERWARDS, Execution
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.demands import Robustness
from tubeplanner.task.holding import ContactKind, Cup, Gripper, Holding, Liquid, Tray
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

ARMS = (
    "ur5/over_the_wall",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
KINDS = ("cup", "tray", "gripper", "liquid")
PERIOD = 1e-3  # [s]


def held_problem(seed: int) -> tuple[PlanningProblem, Holding]:
    """Return a problem without holding, and what is to be held."""
    random = np.random.default_rng(seed)
    name, kind = ARMS[seed % len(ARMS)], KINDS[seed // len(ARMS) % len(KINDS)]
    problem = load_problem(f"example:{name}")
    radius = random.uniform(0.8, 1.3) * problem.tube.radius
    problem = load_problem(f"example:{name}", changes={"tube.radius": radius.tolist()})
    rotation, _ = problem.robot.tool_pose(problem.endpoints[0].joints[None])
    up = tuple((rotation[0] @ problem.robot.tool_offset.placement[:3, :3].T)[2].tolist())
    mass, high = float(random.uniform(0.2, 1.0)), float(random.uniform(0.02, 0.06))
    friction, size = float(random.uniform(0.3, 0.6)), float(random.uniform(0.04, 0.08))
    is_up = kind in ("tray", "liquid")
    com = high * np.array(up) if is_up else np.array([0.0, 0.0, 0.0 if kind == "gripper" else high])
    inertia = mass * 0.06**2 / 6
    x, y, z = com.tolist()
    part = Payload(mass, (x, y, z), (inertia, inertia, inertia, 0.0, 0.0, 0.0))
    contacts: dict[str, ContactKind] = {
        "cup": Cup(float(random.uniform(40, 90)), size / 4, friction),
        "tray": Tray(friction, (size, size), normal=up),
        "gripper": Gripper(float(random.uniform(30, 80)), friction, (size / 2, size / 2)),
        "liquid": Liquid(float(random.uniform(0.2, 0.4)), normal=up),
    }
    return problem, Holding(contacts[kind], None if kind == "liquid" else part)


def exact_run(problem: PlanningProblem, trajectory: JointTrajectory) -> Execution:
    """Return the planned motion as the run of an arm without errors."""
    time = np.arange(0.0, trajectory.duration + AFTERWARDS, PERIOD)
    at = np.minimum(time, trajectory.duration)
    q, v = trajectory.position(at)[None], trajectory.velocity(at)[None]
    plants = drawn_plants(problem.robot, Robustness.exact(), Draw(1))
    return Execution(plants, time, q, v, 0 * q, np.zeros(q.shape, dtype=bool))


def planned_and_run(problem: PlanningProblem, held: PlanningProblem) -> Fields:
    """Return duration of a plan, how far its part moved [m], and the share of its contact."""
    result = plan(problem, PlanOptions(slack=0.0))
    fields: Fields = {"status": str(result.status), "message": result.message}
    if result.trajectory is None or not result.succeeded:
        return fields
    execution = exact_run(held, result.trajectory)
    moved, used = parts_moved(held, execution), most_used(held, execution, 0)
    assert used is not None
    return fields | {
        "duration": result.duration,
        "share": used.value,
        "moved": None if moved is None else moved[0].value,
    }


def line_of(seed: int) -> Fields:
    """Return the line of a seed."""
    free, holding = held_problem(seed)
    line: Fields = {"seed": seed, "arm": ARMS[seed % len(ARMS)], "kind": holding.kind}
    try:
        held = replace(free, holding=(holding,))
    except TubePlannerError as error:
        return line | {"status": "refused", "message": str(error)}
    for label, problem in (("without", free), ("with", held)):
        line[label] = planned_and_run(problem, held)
    return line | {"status": line["with"]["status"]}


def is_beyond(run: Fields, most: float) -> bool:
    """Return True if a part moved farther than a distance [m], or a liquid was spilt."""
    moved = run["moved"]
    return bool(run["share"] > 1 if moved is None else moved > most)


def report(lines: list[Fields]) -> None:
    """Print a row for each kind of contact and for each arm, and one for all."""
    print(
        "| | problems | planned with | without: moved > 1 mm | lost | with: moved > 1 mm | lost |"
    )
    print("|---" * 7 + "|")
    for name in (*KINDS, *ARMS, "all"):
        rows = [line for line in lines if name in (line["kind"], line["arm"], "all")]
        runs = {how: [line.get(how, {}) for line in rows] for how in ("without", "with")}
        cells = [str(len(rows)), str(sum("moved" in run for run in runs["with"]))]
        for of_how in runs.values():
            done = [run for run in of_how if "moved" in run]
            for most in (MOVED, LOST):
                cells.append(f"{sum(is_beyond(run, most) for run in done)} of {len(done)}")
        print(f"| {name} | {' | '.join(cells)} |")
    moved = [line["with"]["moved"] for line in lines if line.get("with", {}).get("moved")]
    print(f"\nwith holding: moved by at most {1000 * max(moved, default=np.nan):.3g} mm")


def main() -> None:
    """Plan, run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="problems")
    parser.add_argument("--seed", type=int, default=0, help="of the first problem")
    parser.add_argument("--output", type=Path, help="journal, gone on with")
    options = parser.parse_args()
    keys = {seed: f"held {seed}" for seed in range(options.seed, options.seed + options.count)}
    lines = []
    for line, is_new in journalled(keys, line_of, options.output):
        lines.append(line)
        if is_new:
            cells = [line.get(how, {}) for how in ("without", "with")]
            print(line["seed"], line["arm"], line["kind"], line["status"], flush=True)
            for cell in cells:
                print("   ", {name: cell[name] for name in cell if name != "message"}, flush=True)
    report(lines)


if __name__ == "__main__":
    main()
