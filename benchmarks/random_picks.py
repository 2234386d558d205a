"""Plan random picks off a table, in contact at start and goal, and have other code judge them.

    python benchmarks/random_picks.py [--count 30] [--seed 0] [--time-limit SECONDS]
        [--keep FOLDER]

A UR5 or a Panda carries a box from a table over a wall back to the table. Heights, sizes,
clearances of problem and segments, and how far contacts reach are drawn. Where contact reaches no
farther than the clearance it must end with, there is no motion: that must be refused. Every other
answer is judged by `outside_judge.py`. Exit status 1 if one is wrong.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from outside.trajectory import read_trajectory
from outside_judge import Judge, passes
from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.errors import TubePlannerError
from tubeplanner.files.export import trajectory_json

SLOW = 20.0  # [s] of planning: each is listed
UNLIMITED = float("inf")
DOWN = [0.7071068, -0.7071068, 0.0, 0.0]
ARMS: dict[str, dict[str, Any]] = {
    "ur5": {
        "tool_frame": "tool0",
        "touch_links": ["wrist_3_link"],
        "seed": [0.0, -1.312, 1.9, -2.159, -1.5708, 0.0],
        "joint_signs": {"elbow_joint": "+"},
    },
    "panda": {
        "tool_frame": "panda_hand_tcp",
        "touch_links": ["panda_hand", "panda_leftfinger", "panda_rightfinger"],
        "seed": [0.0, 0.1, 0.0, -2.2, 0.0, 2.3, 0.785],
        "joint_signs": {},
    },
}
SOLVED, WRONG, REFUSED, RIGHTLY_REFUSED = "solved", "WRONG", "refused", "refused, as it must be"


@dataclass(frozen=True)
class Outcome:
    """What became of a problem.

    Attributes:
        name: Arm and seed.
        state: One of the four.
        planning_time: [s].
        message: What the planner, or the judge, said.
    """

    name: str
    state: str
    planning_time: float
    message: str


def random_pick(arm: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return the fields of a random problem file."""
    fields = ARMS[arm]
    width, height = rng.uniform(0.03, 0.08), rng.uniform(0.04, 0.12)
    table, x, y = rng.uniform(-0.1, 0.15), rng.uniform(0.4, 0.5), rng.uniform(0.2, 0.3)
    low, wall = table + height, rng.uniform(0.05, 0.2)
    high = low + wall + rng.uniform(0.08, 0.12)
    points = [[x, -y, low], [x, -y, high], [x, y, high], [x, y, low]]
    seeds = [[side * np.arctan2(y, x), *fields["seed"][1:]] for side in (-1, 1)]
    clearance, across = np.round(rng.uniform(0.002, 0.015, 2), 4).tolist()
    turned = [0.0524, 0.0524, UNLIMITED]
    part = {"name": "part", "box": [width, width, height], "position": [0, 0, height / 2]}
    made = {
        "robot": {
            "urdf": f"example:{arm}",
            "tool_frame": fields["tool_frame"],
            "attached": [part | {"touch_links": fields["touch_links"]}],
        },
        "tube": {
            "points": points,
            "radius": rng.uniform(0.02, 0.06, 3).tolist(),
            "joint_signs": fields["joint_signs"],
            "orientations": [DOWN] * 4,
            "rotation_tolerance": [turned, [0.1, 0.1, UNLIMITED], turned],
        },
        "start": {"seed": seeds[0]},
        "goal": {"seed": seeds[1]},
        "obstacles": [
            {"name": "table", "box": [0.9, 1.6, 0.04], "position": [0.75, 0, table - 0.02]},
            {"name": "wall", "box": [0.6, 0.05, wall], "position": [0.65, 0, table + wall / 2]},
        ],
        "clearance": {"default": clearance, "segments": [None, across, None]},
        "contacts": [{"links": ["part", "table"], "within": float(rng.uniform(0.01, 0.06))}],
    }
    # As YAML has it: nothing of numpy's.
    return dict(yaml.safe_load(yaml.safe_dump(_plain(made))))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return float(value) if isinstance(value, np.floating) else value


def outcome(name: str, fields: dict[str, Any], path: Path, time_limit: float | None) -> Outcome:
    """Plan a problem, have its answer judged, and return what became of it."""
    path.write_text(yaml.safe_dump(fields))
    begin = time.perf_counter()
    can_leave = fields["contacts"][0]["within"] > fields["clearance"]["default"]
    refused = REFUSED if can_leave else RIGHTLY_REFUSED
    try:
        result = plan(load_problem(path), PlanOptions(slack=0.0, time_limit=time_limit))
    except TubePlannerError as error:
        return Outcome(name, refused, time.perf_counter() - begin, str(error))
    if result.trajectory is None:
        return Outcome(name, refused, result.planning_time, f"{result.status}: {result.message}")
    answer = path.with_suffix(".json")
    answer.write_text(trajectory_json(result.trajectory))
    found = Judge(path).judge(read_trajectory(answer))
    broken = {key: one.margin for key, one in found.items() if not one.holds(1e-5)}
    state = SOLVED if passes(found) and can_leave else WRONG
    message = f"{result.duration:.3f} s by {result.method}" + (f", {broken}" if broken else "")
    return Outcome(name, state, result.planning_time, message)


def outcomes(count: int, seed: int, folder: Path, time_limit: float | None) -> list[Outcome]:
    """Return what became of problems, each printed as soon as it is known."""
    found = []
    for k in range(seed, seed + count):
        arm = list(ARMS)[k % len(ARMS)]
        fields = random_pick(arm, np.random.default_rng(k))
        one = outcome(f"{arm}, seed {k}", fields, folder / f"{k}.yaml", time_limit)
        print(f"{one.name}: {one.state} after {one.planning_time:.1f} s: {one.message}", flush=True)
        found.append(one)
    return found


def main() -> int:
    """Print the table and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="of the first problem")
    parser.add_argument("--time-limit", type=float, help="of every plan [s]")
    parser.add_argument("--keep", type=Path, help="folder for problems and answers")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found = outcomes(options.count, options.seed, folder, options.time_limit)
    for state in (SOLVED, RIGHTLY_REFUSED, REFUSED, WRONG):
        print(f"{state}: {sum(one.state == state for one in found)}")
    slowest = max(found, key=lambda one: one.planning_time)
    print(f"longest planning: {slowest.planning_time:.1f} s ({slowest.name})")
    late = [one.name for one in found if one.planning_time > SLOW]
    print(f"over {SLOW:g} s: {'; '.join(late) or 'none'}")
    return 1 if any(one.state == WRONG for one in found) else 0


if __name__ == "__main__":
    sys.exit(main())
