"""What processes of `campaign.py` do: plan a random problem, have it judged, tell it in a line."""

import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from campaign_planner import PlannerProcess
from campaign_problems import Built, build, reversed_problem, two_moves, write
from campaign_witness import Unsuitable
from outside.conditions import Condition
from outside.cycle_judge import judge_cycle
from outside.judge import PARTS, SAMPLES
from outside.trajectory import read_trajectory
from outside_judge import Judge, passes

NARROWER = 0.9
TOLERANCE = 1e-6  # relative, of the outside judge
PAIRS_EVERY, CYCLES_EVERY, DENSE_EVERY, REFERENCE_EVERY = 5, 12, 20, 25  # seeds
REFERENCE = "example:ur5/over_the_wall"
GRACE = 60.0  # [s] beyond the time limit before a planning process is ended
UNBUILT = "not built"
EQUATIONS = ("start", "goal", "rest", "continuity")  # their margins are zero at best
Fields = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How every problem is planned.

    Attributes:
        pairs: Whether every fifth one is planned backwards and narrower as well.
        baselines: Whether smoothed schemes as well.
        motors: Whether arms have random motors.
        time_limit: Of every plan [s].
        keep: Where folders of problems that are wrong or refused are kept; None: nowhere.
        slack: By which share longer than the shortest motions answers may be, to be smooth.
    """

    pairs: bool
    baselines: bool
    motors: bool
    time_limit: float
    keep: Path | None
    slack: float = 0.0


_planner = PlannerProcess()


def examine(seed: int, options: Options) -> Fields:
    """Return one line of the output: what came of the problem of a seed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            built = build(seed, folder, motors=options.motors)
        except Unsuitable as error:
            return {"seed": seed, "status": UNBUILT, "message": str(error)}
        line = {"seed": seed, **_features(built), **_planned_either(seed, built, options)}
        has_pairs = options.pairs and seed % PAIRS_EVERY == 0 and _may_be_reversed(built)
        if has_pairs and not line["cycle"]:
            line["pairs"] = {"forwards": line["duration"], **_pairs(built, options)}
        if seed % REFERENCE_EVERY == 0:
            line["reference_cpu"] = _answer(REFERENCE, folder / "reference.json", options)["cpu"]
        if line["status"] != "success" or is_wrong(line):
            _keep(folder, options.keep, seed)
        return line


def _planned_either(seed: int, built: Built, options: Options) -> Fields:
    """Plan the problem of a seed, or now and then the cycle through its tube and back.

    With friction, what solves the way there may be too weak for the way back.
    """
    is_cycle = seed % CYCLES_EVERY == 1 and _may_be_reversed(built)
    samples = PARTS * SAMPLES if seed % DENSE_EVERY == 0 else SAMPLES
    if is_cycle:
        found = _planned(two_moves(built), options)
    else:
        found = _planned(built.path, options, built.judge, samples)
    return {"cycle": is_cycle, **found}


def _may_be_reversed(built: Built) -> bool:
    return "goal" in built.fields and "motors" not in built.kinds


def is_wrong(line: Fields) -> bool:
    """Return whether the planner certified what the outside judge does not."""
    return line.get("judged") is False or bool(line.get("pairs", {}).get("wrong"))


def _features(built: Built) -> Fields:
    tube = built.fields["tube"]
    return {
        "arm": built.arm,
        "joints": len(built.judge.arm.joint_names),
        "segments": len(tube["radius"]),
        "scale": built.witness.scale,
        "kinds": list(built.kinds),
    }


def _planned(
    path: Path, options: Options, judge: Judge | None = None, samples: int = SAMPLES
) -> Fields:
    """Plan a problem file and judge the answer, a cycle's without a judge of its own."""
    trajectory = path.with_suffix(".json")
    line = _answer(str(path), trajectory, options)
    if line["status"] != "success":
        return line
    begin = time.perf_counter()
    if judge is None:
        found = judge_cycle(path, trajectory)
    else:
        found = judge.judge(read_trajectory(trajectory), samples)
    line |= {"judged": passes(found, TOLERANCE), **_worst(found)}
    line["judging_time"] = round(time.perf_counter() - begin, 3)
    return line


def _answer(problem: str, trajectory: Path, options: Options) -> Fields:
    asked = {
        "problem": problem,
        "trajectory": str(trajectory),
        "time_limit": options.time_limit,
        "slack": options.slack,
        "baselines": options.baselines,
    }
    known = dict.fromkeys(("duration", "planning_time", "cpu", "memory"))
    return known | _planner.plan(asked, options.time_limit + GRACE)


def _worst(found: dict[str, Condition]) -> Fields:
    """Return the worst of the broken conditions, or else the tightest that is not an equation."""
    asked = {name: one for name, one in found.items() if one.margin is not None}
    broken = {name: one for name, one in asked.items() if not one.holds(TOLERANCE)}
    rest = {name: one for name, one in asked.items() if name not in EQUATIONS}
    name, one = min((broken or rest or asked).items(), key=lambda item: item[1].margin or 0.0)
    where = {"time": one.time, "where": one.where}
    return {"worst": {"condition": name, "margin": one.margin, "unit": one.unit, **where}}


def _pairs(built: Built, options: Options) -> Fields:
    """Return the durations backwards and with narrower radii, and which of them are wrong."""
    line: Fields = {"wrong": []}
    changes = {"backwards": reversed_problem, "narrower": narrower_problem}
    for name, change in changes.items():
        path = built.path.with_name(f"{name}.yaml")
        write(change(built.fields), path)
        found = _planned(path, replace(options, baselines=False), Judge(path))
        line[name] = found["duration"]
        if found.get("judged") is False:
            line["wrong"].append({name: found["worst"]})
    return line


def narrower_problem(fields: Fields) -> Fields:
    """Return a problem with 90 % of the radii; its witness still fits."""
    tube = fields["tube"]
    narrower = [None if radius is None else NARROWER * radius for radius in tube["radius"]]
    changed = {"radius": narrower}
    if "cross_section" in tube:
        changed["cross_section"] = [
            box and box | {"box": [NARROWER * side for side in box["box"]]}
            for box in tube["cross_section"]
        ]
    return fields | {"tube": tube | changed}


def _keep(folder: Path, where: Path | None, seed: int) -> None:
    if where is not None:
        shutil.copytree(folder, where / f"seed_{seed}", dirs_exist_ok=True)
