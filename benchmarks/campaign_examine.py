"""What processes of `campaign.py` do: plan a random problem, have it judged, tell it in a line."""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from campaign_arms import Unsuitable
from campaign_problems import Built, build, write
from outside.trajectory import read_trajectory
from outside.verdict import Condition
from outside_judge import TOLERANCE, Judge, passes

NARROWER = 0.9
GRACE = 60.0  # [s] beyond the time limit before a planning process is ended
UNBUILT = "not built"
EQUATIONS = ("start", "goal", "rest", "continuity")  # their margins are zero at best
Fields = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How every problem is planned.

    Attributes:
        pairs: Whether backwards and narrower as well.
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


def examine(seed: int, options: Options) -> Fields:
    """Return one line of the output: what came of the problem of a seed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            built = build(seed, folder, motors=options.motors)
        except Unsuitable as error:
            return {"seed": seed, "status": UNBUILT, "message": str(error)}
        line = {"seed": seed, **_features(built), **_planned(built.path, options, built.judge)}
        if options.pairs and "goal" in built.fields:
            line["pairs"] = {"forwards": line["duration"], **_pairs(built, options)}
        if line["status"] != "success" or is_wrong(line):
            _keep(folder, options.keep, seed)
        return line


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
        "obstacles": len(built.fields.get("obstacles", [])),
        "rotation": "orientations" in tube,
        "signs": any(tube.get("joint_signs", [])),
    }


def _planned(path: Path, options: Options, judge: Judge | None = None) -> Fields:
    """Plan a problem file and judge the answer."""
    trajectory = path.with_suffix(".json")
    line = _answer(path, trajectory, options)
    if line["status"] != "success":
        return line
    begin = time.perf_counter()
    found = (judge or Judge(path)).judge(read_trajectory(trajectory))
    line |= {"judged": passes(found), **_worst(found)}
    line["judging_time"] = round(time.perf_counter() - begin, 3)
    return line


def _answer(path: Path, trajectory: Path, options: Options) -> Fields:
    script, time_limit = Path(__file__).with_name("campaign_plan.py"), options.time_limit
    command = [sys.executable, str(script), str(path), str(trajectory)]
    command += ["--time-limit", str(time_limit), "--slack", str(options.slack)]
    command += ["--baselines"] if options.baselines else []
    line: Fields = {"status": "crash", "message": "", "duration": None, "planning_time": None}
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=time_limit + GRACE,
        )
    except subprocess.TimeoutExpired:
        return line | {"status": "timeout", "message": f"ended after {time_limit + GRACE:g} s"}
    if done.returncode != 0:
        return line | {"message": " | ".join(done.stderr.strip().splitlines()[-2:])}
    return line | json.loads(done.stdout.splitlines()[-1])


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
        found = _planned(path, replace(options, baselines=False))
        line[name] = found["duration"]
        if found.get("judged") is False:
            line["wrong"].append({name: found["worst"]})
    return line


def reversed_problem(fields: Fields) -> Fields:
    """Return a problem the other way round: a trajectory run backwards needs the same efforts."""
    per_segment = ("points", "radius", "joint_signs", "orientations", "rotation_tolerance")
    tube = {
        key: value[::-1] if key in per_segment and isinstance(value, list) else value
        for key, value in fields["tube"].items()
    }
    return fields | {"tube": tube, "start": fields["goal"], "goal": fields["start"]}


def narrower_problem(fields: Fields) -> Fields:
    """Return a problem with 90 % of the radii; its witness still fits."""
    tube = fields["tube"]
    return fields | {"tube": tube | {"radius": [NARROWER * radius for radius in tube["radius"]]}}


def _keep(folder: Path, where: Path | None, seed: int) -> None:
    if where is not None:
        shutil.copytree(folder, where / f"seed_{seed}", dirs_exist_ok=True)
