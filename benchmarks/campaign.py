"""Plan random problems that have a solution, and let the outside judge look at every answer.

    python benchmarks/campaign.py --count 40 [--seed 0] [--output F.jsonl] [--pairs]
        [--motors] [--baselines] [--processes 1] [--time-limit 60] [--slack 0] [--keep FOLDER]

Every problem is built round a slow trajectory that solves it by the outside judge's own verdict
(`campaign_problems.py`): bundled arms, any chain of example-robot-data, random chains with sliding
joints, radii from 0.5 mm to 0.3 m, up to 60 segments. It is planned through the public API in a
process of its own. An answer is wrong if the planner certifies it and the outside judge does not.
With --pairs, problems with a goal are planned backwards and with radii of 90 % as well: forwards
and backwards the least duration is the same, and the narrower tube's trajectory is one of the
wider's, so whichever of the first two is more than 1 % slower than the best of the three is stuck.
With --motors, arms have random rotors, friction, torque-speed lines and efforts each way.
With --baselines, so is what is slower than a smoothed scheme that passes the certificate.
Seeds that the output file already has are skipped. Exit status 1 if an answer is wrong.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from campaign_arms import Unsuitable
from campaign_problems import Built, build, write
from outside.trajectory import read_trajectory
from outside.verdict import Condition
from outside_judge import TOLERANCE, Judge, passes

STUCK = 1.01  # times the best of the three
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


def stuck(line: Fields) -> list[str]:
    """Return what shows that an answer is needlessly slow, or missing."""
    baseline, duration = line.get("baseline"), line.get("duration")
    slower = baseline is not None and (duration is None or duration > baseline)
    return ["beside a baseline"] * slower + _stuck_of_pair(line.get("pairs"))


def _stuck_of_pair(pairs: Fields | None) -> list[str]:
    """Return which of the plans forwards and backwards are needlessly slow, or missing."""
    if not pairs:
        return []
    durations = {name: pairs[name] for name in ("forwards", "backwards", "narrower")}
    best = min((each for each in durations.values() if each is not None), default=None)
    if best is None:
        return []
    limit = STUCK * best
    return [n for n in ("forwards", "backwards") if durations[n] is None or durations[n] > limit]


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


def _lines(seeds: list[int], options: Options, processes: int) -> Iterator[Fields]:
    work = partial(examine, options=options)
    if processes == 1:
        yield from map(work, seeds)
        return
    with get_context("spawn").Pool(processes) as pool:
        yield from pool.imap_unordered(work, seeds)


def _read(output: Path | None) -> list[Fields]:
    if output is None or not output.is_file():
        return []
    return [json.loads(line) for line in output.read_text().splitlines() if line.strip()]


def _progress(line: Fields) -> str:
    duration, judged = line.get("duration"), line.get("judged")
    verdict = {True: "judged good", False: "WRONG", None: line.get("message", "")[:90]}[judged]
    took = "" if duration is None else f" {duration:.3f} s in {line['planning_time']:.1f} s"
    return f"{line['seed']} {line.get('arm', '')}: {line['status']}{took}: {verdict}"


def summary(lines: Iterable[Fields]) -> str:
    """Return counts, and lists of what is wrong, refused, stuck or could not be built."""
    lines = sorted(lines, key=lambda line: line["seed"])
    built = [line for line in lines if line["status"] != UNBUILT]
    solved = [line for line in built if line["status"] == "success"]
    wrong = [line for line in built if is_wrong(line)]
    paired = [line for line in built if "pairs" in line]
    slow = [line for line in built if stuck(line)]
    refused = [line for line in built if line["status"] != "success"]
    counted = Counter(line["status"] for line in refused)
    parts = [
        f"{len(built)} problems with a witness: {len(solved)} solved, {len(refused)} refused, "
        f"{len(wrong)} wrong; {len(paired)} paired, {len(slow)} stuck; "
        f"{len(lines) - len(built)} not built",
        f"refused: {', '.join(f'{n} {status}' for status, n in counted.most_common()) or 'none'}",
    ]
    parts += [f"WRONG {_what(x)}: {x['worst']} {x.get('pairs', {}).get('wrong')}" for x in wrong]
    parts += [f"refused {_what(x)}: {x['status']}: {x['message']}" for x in refused]
    parts += [
        f"stuck {_what(x)}: {' and '.join(stuck(x))}: {x.get('pairs', x.get('baseline'))}"
        for x in slow
    ]
    parts += [f"not built, seed {x['seed']}: {x['message']}" for x in lines if x not in built]
    return "\n".join(parts)


def _what(line: Fields) -> str:
    return (
        f"seed {line['seed']} ({line['arm']}, {line['segments']} segments, {line['scale']:.2g} m)"
    )


def main() -> int:
    """Run the campaign, print its summary, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=40, help="problems")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--output", type=Path, help="one JSON line per problem; is gone on with")
    parser.add_argument("--pairs", action="store_true", help="backwards and narrower as well")
    parser.add_argument("--baselines", action="store_true", help="smoothed schemes as well")
    parser.add_argument("--motors", action="store_true", help="random motors")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--time-limit", type=float, default=60.0, help="of every plan [s]")
    parser.add_argument("--slack", type=float, default=0.0, help="of every plan, to be smooth")
    parser.add_argument("--keep", type=Path, help="folder for problems that are wrong or refused")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.count)
    lines = [line for line in _read(options.output) if line["seed"] in seeds]
    done = {line["seed"] for line in lines}
    how = Options(
        options.pairs,
        options.baselines,
        options.motors,
        options.time_limit,
        options.keep,
        options.slack,
    )
    for line in _lines([seed for seed in seeds if seed not in done], how, options.processes):
        lines.append(line)
        print(_progress(line), flush=True)
        if options.output is not None:
            with options.output.open("a") as stream:
                stream.write(json.dumps(line) + "\n")
    print(summary(lines))
    return 1 if any(map(is_wrong, lines)) else 0


if __name__ == "__main__":
    sys.exit(main())
