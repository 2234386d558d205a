"""How long do refusals take, beside plans of the problems that they were made from?

    python benchmarks/refusals.py [OTHER_CHECKOUT] [--only SUBSTRING]

Plans every problem of `refusal_cases` and the bundled one behind it, with another checkout in
turns, if one is given. Prints processor times, the refusals' as multiples of the plans', and with
what status, reason and place they end. Exit status 1 if a refusal of this checkout takes more than
its share of a plan, ends with another status than it should, or names no place.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shared import HERE, Checkout
from tubeplanner.studies.problem_spec import PosedProblem

# How much of a plan's processor time a refusal may take: seen before anything is planned, or not.
MOST_EARLY, MOST_LATE = 0.3, 5.0
_WALL, _POST, _PAPER = "ur5/over_the_wall", "two_link/around_a_post", "two_link/paper_1_30mm"
_SHELF, _CRATE, _PALLET = (
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
    "ur10/onto_a_conveyor",
)
_TRAY = "ur5/level_tray"
_BLOCKED, _FAR, _HEAVY = "tube_blocked", "unreachable", "gravity_exceeds_effort"
# Planned by either checkout's own package; the least of the times counts.
DRIVER = """
import json, sys, time
from tubeplanner import load_problem, plan
for line in sys.stdin:
    name, changes, repeats = json.loads(line)
    problem, times = load_problem(name, changes=changes), []
    for _ in range(repeats):
        begun = time.process_time()
        result = plan(problem, SHORTEST)
        times.append(time.process_time() - begun)
    answer = {"status": result.status, "message": result.message, "place": str(result.place)}
    print(json.dumps(answer | {"cpu": min(times)}), flush=True)
"""


@dataclass(frozen=True)
class RefusalCase:
    """A bundled problem and what is changed so that it has no answer.

    Attributes:
        name: What makes it impossible.
        bundled: Name of the bundled problem.
        status: How planning must end.
        changes: Sections of the problem file whose keys are replaced; lists grow instead.
        is_early: Whether it can be known before anything is planned.
    """

    name: str
    bundled: str
    status: str
    changes: Mapping[str, Any]
    is_early: bool = False

    @property
    def most(self) -> float:
        """The largest share of a plan's processor time."""
        return MOST_EARLY if self.is_early else MOST_LATE

    def field_changes(self) -> dict[str, Any]:
        """Return the changes by field path, obstacles together with those of the bundled one."""
        obstacles = PosedProblem.read(f"example:{self.bundled}").document.get("obstacles") or []
        changes: dict[str, Any] = {}
        for section, value in self.changes.items():
            if section == "obstacles":
                changes[section] = [*obstacles, *value]
            elif isinstance(value, Mapping):
                changes |= {f"{section}.{key}": each for key, each in value.items()}
            else:
                changes[section] = value
        return changes


def refusal_cases() -> tuple[RefusalCase, ...]:
    """Return all of them."""
    return (*_early_cases(), *_blocked_cases(), *_other_cases())


class Planning:
    """A checkout that plans."""

    def __init__(self, folder: Path) -> None:
        """Start it in the folder of a checkout."""
        self._checkout = Checkout(folder, DRIVER)
        self._times: dict[str, float] = {}

    def plan(self, bundled: str, changes: dict[str, Any], repeats: int) -> dict[str, Any]:
        """Return status, message, place and processor time [s] of a changed problem's plan."""
        return self._checkout.ask((f"example:{bundled}", changes, repeats))

    def time_of(self, bundled: str) -> float:
        """Return the processor time [s] of a bundled problem's plan, measured once."""
        if bundled not in self._times:
            self._times[bundled] = self.plan(bundled, {}, repeats=3)["cpu"]
        return self._times[bundled]


def fault(case: RefusalCase, answer: dict, share: float) -> str:
    """Say what is wrong with a refusal; empty if nothing."""
    if answer["status"] != case.status:
        return f"ends with {answer['status']}, not {case.status}"
    if not answer["place"]:
        return "names no place"
    return f"more than {case.most:g}" if share > case.most else ""


def main() -> int:
    """Print the table and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", nargs="?", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="cases whose name or problem contains this")
    options = parser.parse_args()
    paths = [HERE] if options.other is None else [options.other.resolve(), HERE]
    checkouts = [Planning(path) for path in paths]
    columns = "".join(f"{name:>9}" for name in ("plan", "refusal", "share") * len(paths))
    print(f"{'case':22}{'problem':28}{columns}")
    faults = 0
    for case in refusal_cases():
        if options.only not in f"{case.name} {case.bundled}":
            continue
        changes, row = case.field_changes(), ""
        for checkout in checkouts:
            planned = checkout.time_of(case.bundled)
            answer = checkout.plan(case.bundled, changes, 2 if case.is_early else 1)
            share = answer["cpu"] / planned
            row += f"{planned:9.2f}{answer['cpu']:9.2f}{share:9.2f}"
        wrong = fault(case, answer, share)
        faults += bool(wrong)
        print(f"{case.name:22}{case.bundled:28}{row}  {wrong}")
        print(f"    {answer['status']}: {answer['message']} [{answer['place']}]", flush=True)
    return int(faults > 0)


def _box(size: list[float], position: list[float]) -> dict[str, Any]:
    return {"obstacles": [{"name": "block", "box": size, "position": position}]}


def _ball(radius: float, position: list[float]) -> dict[str, Any]:
    return {"obstacles": [{"name": "block", "sphere": radius, "position": position}]}


def _early_cases() -> tuple[RefusalCase, ...]:
    bar = {"name": "bar", "box": [0.05, 0.05, 0.2], "position": [0, 0, -0.15]}
    far = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [1.5, 0.3, 0.5], [0.45, 0.3, 0.2]]
    far_goal = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [1.2, 0.3, 0.2]]
    far_post = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0], [0.2, 0.95, 0]]
    return (
        RefusalCase("start in an obstacle", _WALL, _BLOCKED, _ball(0.1, [0.45, -0.3, 0.2]), True),
        RefusalCase("start in an obstacle", _POST, _BLOCKED, _ball(0.1, [0.45, -0.3, 0]), True),
        RefusalCase(
            "start in an obstacle", _CRATE, _BLOCKED, _ball(0.1, [0.38, -0.24, 0.12]), True
        ),
        RefusalCase("goal in an obstacle", _SHELF, _BLOCKED, _ball(0.1, [0.6, 0, 0.72]), True),
        RefusalCase("goal in an obstacle", _CRATE, _BLOCKED, _ball(0.1, [0.38, 0.24, 0.12]), True),
        RefusalCase("goal in an obstacle", _PALLET, _BLOCKED, _ball(0.1, [0.7, 0.45, 0.43]), True),
        RefusalCase("start in itself", _WALL, _BLOCKED, {"robot": {"attached": [bar]}}, True),
        RefusalCase("start too near", _SHELF, _BLOCKED, {"clearance": 0.2}, True),
        RefusalCase("heavy at start", _WALL, _HEAVY, {"robot": {"payload": {"mass": 60.0}}}, True),
        RefusalCase("heavy at start", _SHELF, _HEAVY, {"robot": {"payload": {"mass": 60.0}}}, True),
        RefusalCase("middle out of reach", _WALL, _FAR, {"tube": {"points": far}}, True),
        RefusalCase("goal out of reach", _WALL, _FAR, {"tube": {"points": far_goal}}, True),
        RefusalCase("goal out of reach", _POST, _FAR, {"tube": {"points": far_post}}, True),
    )


def _blocked_cases() -> tuple[RefusalCase, ...]:
    return (
        RefusalCase("plate", _WALL, _BLOCKED, _box([0.3, 0.02, 0.3], [0.45, 0, 0.5])),
        RefusalCase("plate", _POST, _BLOCKED, _box([0.02, 0.12, 0.4], [0.33, 0.1, 0])),
        RefusalCase("plate", _PAPER, _BLOCKED, _box([0.02, 0.02, 0.4], [0.3, 0, 0])),
        RefusalCase("plate", _SHELF, _BLOCKED, _box([0.08, 0.14, 0.02], [0.38, 0, 0.6])),
        RefusalCase("plate", _CRATE, _BLOCKED, _box([0.14, 0.02, 0.14], [0.38, 0, 0.38])),
        RefusalCase("plate", _PALLET, _BLOCKED, _box([0.2, 0.02, 0.2], [0.7, 0, 0.65])),
        RefusalCase("plate", _TRAY, _BLOCKED, _box([0.3, 0.02, 0.3], [0.45, 0, 0.525])),
        RefusalCase("corner", _WALL, _BLOCKED, _ball(0.12, [0.45, -0.3, 0.5])),
        RefusalCase("corner", _POST, _BLOCKED, _ball(0.06, [0.2, 0.1, 0])),
        RefusalCase("open goal", _WALL, _BLOCKED, _ball(0.08, [0.45, 0.3, 0.2])),
        RefusalCase("open goal", _POST, _BLOCKED, _ball(0.05, [0.2, 0.45, 0])),
        RefusalCase("clearance", _POST, _BLOCKED, {"clearance": 0.15}),
    )


def _other_cases() -> tuple[RefusalCase, ...]:
    kept = {"elbow_joint": "+", "shoulder_pan_joint": [-1.2, -0.2]}
    weak = {"limits": {"effort": {"shoulder_lift_joint": 25.0}}}
    to_one_side, wrist = {"shoulder_pan_joint": [-1.2, 0.0]}, {"wrist_1_joint": [-2.3, -1.5]}
    far = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.525], [0.78, 0.5, 0.525], [0.45, 0.3, 0.2]]
    return (
        RefusalCase("joint signs", _WALL, _FAR, {"tube": {"joint_signs": kept}}),
        RefusalCase("heavy on the way", _WALL, _HEAVY, {"robot": weak}),
        RefusalCase("joint limit", _TRAY, _FAR, {"robot": {"limits": {"position": to_one_side}}}),
        RefusalCase("limit of the wrist", _TRAY, _FAR, {"robot": {"limits": {"position": wrist}}}),
        RefusalCase("middle out of reach", _TRAY, _FAR, {"tube": {"points": far}}),
    )


if __name__ == "__main__":
    raise SystemExit(main())
