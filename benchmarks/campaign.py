"""Are certified answers right, by other code, on random problems for arms of every kind?

    python benchmarks/campaign.py --count 2000 [--seed 0] [--output F.jsonl] [--pairs]
        [--motors] [--baselines] [--processes 1] [--time-limit 60] [--slack 0] [--keep FOLDER]
    python benchmarks/campaign.py --report F.jsonl

Every problem is built round a slow trajectory that solves it by the outside judge's own verdict
(`campaign_problems.py`): bundled arms, any chain of example-robot-data, random chains of 1 to 10
joints with sliding ones and side branches, radii from 0.5 mm to 0.3 m, 1 to 200 segments, long and
tiny, some that turn back; now and then payloads, attached solids, obstacles with concave meshes,
joint signs, rotation tolerances, boxes, tool speeds, jerk limits, motors, open goals; every
twelfth seed is a cycle there and back, if it has a goal and no motors. It is planned through the
public API in a process of its own. An answer is wrong if the planner certifies it and the outside
judge, at 5,000 samples and more where it is near a limit, at 100,000 every twentieth seed, does
not to 1e-6.
With --pairs, every fifth problem with a goal and without motors is planned backwards and with radii
of 90 % as well: forwards and backwards the least duration is the same, and the narrower tube's
trajectory is one of the wider's, so whichever of the first two is more than 1 % slower than the
best of the three is stuck. With --motors, all arms have random rotors, friction, torque-speed lines
and efforts each way. With --baselines, what is slower than a smoothed scheme that passes the
certificate is stuck too.
The output file is a study's journal: what it has by the same seed, options and sources is not
done again; --report prints what one has. Exit status 1 if an answer is wrong.
"""

import argparse
import hashlib
import math
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from campaign_examine import UNBUILT, Fields, Options, examine, is_wrong
from journals import journalled, recorded
from shared import cause
from tubeplanner.studies.problem_spec import package_hash

STUCK = 1.01  # times the best of the three
MAX_SHOWN = 12  # seeds of a cause
# Marks: shares, and processor times in those of the reference.
MIN_SOLVED, MAX_STUCK, SUCCESSES, REFUSALS = 0.995, 0.01, 20.0, 60.0
_BY_JOINTS = ((1, 2), (3, 4), (5, 6), (7, 8), (9, 10))
_BY_SEGMENTS = ((1, 3), (4, 10), (11, 30), (31, 80), (81, 200))


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
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after these")
    parser.add_argument("--time-limit", type=float, default=60.0, help="of every plan [s]")
    parser.add_argument("--slack", type=float, default=0.0, help="of every plan, to be smooth")
    parser.add_argument("--keep", type=Path, help="folder for problems that are wrong or refused")
    parser.add_argument("--report", type=Path, help="print the report of such a file, plan nothing")
    options = parser.parse_args()
    if options.report is not None:
        return _answered(recorded(options.report))
    seeds = range(options.seed, options.seed + options.count)
    how = Options(
        options.pairs,
        options.baselines,
        options.motors,
        options.time_limit,
        options.keep,
        options.slack,
    )
    keys = {seed: _key(seed, how) for seed in seeds}
    deadline = time.monotonic() + options.seconds
    lines = []
    work = partial(examine, options=how)
    for line, is_new in journalled(keys, work, options.output, options.processes):
        lines.append(line)
        if is_new:
            print(_progress(line), flush=True)
        if time.monotonic() > deadline:
            break
    return _answered(lines)


def stuck(line: Fields) -> list[str]:
    """Return what shows that an answer is needlessly slow, or missing."""
    baseline, duration = line.get("baseline"), line.get("duration")
    slower = baseline is not None and (duration is None or duration > baseline)
    return ["beside a baseline"] * slower + _stuck_of_pair(line.get("pairs"))


def report(lines: Iterable[Fields]) -> str:
    """Return the whole report of the lines of a campaign."""
    lines = sorted(lines, key=lambda line: line["seed"])
    built = [line for line in lines if line["status"] != UNBUILT]
    if not built:
        return "no problem was built"
    parts = [_marks(lines, built), _kinds(built), _times(built), _causes(built), _lists(built)]
    return "\n\n".join(part for part in parts if part)


def _key(seed: int, options: Options) -> str:
    """Return a hash of all that the line of a seed depends on."""
    folder = Path(__file__).parent
    sources = sorted([*folder.glob("campaign_*.py"), *folder.glob("outside*/*.py")])
    ours = b"".join(path.read_bytes() for path in sources)
    how = repr((seed, replace(options, keep=None), package_hash())).encode()
    return hashlib.sha256(how + ours).hexdigest()


def _progress(line: Fields) -> str:
    duration, judged = line.get("duration"), line.get("judged")
    verdict = {True: "judged good", False: "WRONG", None: line.get("message", "")[:90]}[judged]
    took = "" if duration is None else f" {duration:.3f} s in {line['planning_time']:.1f} s"
    return f"{line['seed']} {line.get('arm', '')}: {line['status']}{took}: {verdict}"


def _answered(lines: list[Fields]) -> int:
    """Print the report of lines; return the exit status."""
    print(report(lines))
    return 1 if any(map(is_wrong, lines)) else 0


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


def _marks(lines: list[Fields], built: list[Fields]) -> str:
    """Return a table of the marks: what was found, what is asked, and whether it is kept."""
    solved = [line for line in built if line["status"] == "success"]
    paired = [line for line in built if "pairs" in line]
    slow, wrong = [line for line in paired if stuck(line)], [x for x in built if is_wrong(x)]
    fraction, fraction_stuck = len(solved) / len(built), len(slow) / max(len(paired), 1)
    seeds = f"seeds {lines[0]['seed']} to {lines[-1]['seed']}"
    missing = [line for line in built if line["status"] != "success"]
    rows = [
        f"{len(built)} problems with a witness, {seeds} ({len(lines) - len(built)} not built)",
        f"{'mark':<24}{'found':<28}{'asked':<12}",
        _mark("wrong", f"{len(wrong)} of {len(solved)} solved", "0", not wrong, wrong),
        _mark(
            "solved",
            f"{len(solved)} of {len(built)}, {fraction:.2%}",
            f"{MIN_SOLVED:.1%}",
            fraction >= MIN_SOLVED,
            missing,
        ),
        _mark(
            "stuck",
            f"{len(slow)} of {len(paired)} pairs, {fraction_stuck:.1%}",
            f"{MAX_STUCK:.0%}",
            fraction_stuck <= MAX_STUCK,
            slow,
        ),
    ]
    return "\n".join(rows + _marks_of_times(built))


def _mark(name: str, found: str, asked: str, kept: bool, beside: list[Fields]) -> str:
    verdict = "kept" if kept else "MISSED"
    return f"{name:<24}{found:<28}{asked:<12}{verdict:<8}{_seeds(beside)}".rstrip()


def _marks_of_times(built: list[Fields]) -> list[str]:
    """Return rows of processor times, in those of the reference; none if it was not planned."""
    reference = _reference(built)
    if not reference > 0:
        return ["processor times: the reference was not planned yet"]
    rows = [f"processor times in those of ur5/over_the_wall, {reference:.2f} s:"]
    for name, most in (("success", SUCCESSES), ("refused", REFUSALS)):
        chosen = [x for x in built if _ended(x) == name]
        times = _multiples(chosen, reference)
        if len(times):
            p50, p90, p99 = np.percentile(times, [50, 90, 99])
            beyond = [x for x in chosen if _counts(x) and x["cpu"] > most * reference]
            found = f"p50 {p50:.2g}, p90 {p90:.2g}, p99 {p99:.3g}"
            rows.append(_mark(name, found, f"p99 {most:g}", p99 <= most, beyond))
    return rows


def _ended(line: Fields) -> str:
    return "success" if line["status"] == "success" else "refused"


def _reference(lines: list[Fields]) -> float:
    """Return the median processor time of the reference [s]; nan if it was not planned."""
    times = [line["reference_cpu"] for line in lines if line.get("reference_cpu")]
    return float(np.median(times)) if times else float("nan")


def _multiples(lines: list[Fields], reference: float) -> "np.ndarray[Any, Any]":
    """Return processor times of lines, in those of the reference."""
    return np.array([line["cpu"] for line in lines if _counts(line)]) / reference


def _counts(line: Fields) -> bool:
    """Return whether a line has the processor time of one plan: cycles have two."""
    return bool(line.get("cpu")) and not line.get("cycle")


def _kinds(built: list[Fields]) -> str:
    counted: Counter[str] = Counter(kind for line in built for kind in line.get("kinds", []))
    counted["cycles of two moves"] = sum(bool(line.get("cycle")) for line in built)
    arms = len({line["arm"].split("/")[0] for line in built if "arm" in line})
    listed = ", ".join(f"{count} {kind}" for kind, count in counted.most_common() if count)
    return f"of them with: {listed}; {arms} kinds of arms"


def _times(built: list[Fields]) -> str:
    """Return a table of processor times of successes by joints and by segments."""
    reference = _reference(built)
    solved = [line for line in built if line["status"] == "success"]
    if not reference > 0 or not solved:
        return ""
    rows = [f"{'successes with':20}{'count':>7}{'p50':>8}{'p90':>8}{'p99':>8}"]
    for name, bands in (("joints", _BY_JOINTS), ("segments", _BY_SEGMENTS)):
        for low, high in bands:
            times = _multiples([x for x in solved if low <= x[name] <= high], reference)
            if len(times):
                p50, p90, p99 = np.percentile(times, [50, 90, 99])
                label = f"{low} to {high} {name}"
                rows.append(f"{label:20}{len(times):7}{p50:8.2g}{p90:8.2g}{p99:8.3g}")
    return "\n".join(rows)


def _causes(built: list[Fields]) -> str:
    """Return refusals by cause, the most frequent first."""
    by_cause: dict[str, list[Fields]] = defaultdict(list)
    for line in built:
        if line["status"] != "success":
            by_cause[f"{line['status']}: {cause(line['message'])}"].append(line)
    listed = sorted(by_cause.items(), key=lambda item: -len(item[1]))
    rows = [f"{len(found):4}  {name} {_seeds(found)}" for name, found in listed]
    return "\n".join(["refused, by cause:", *rows]) if rows else ""


def _lists(built: list[Fields]) -> str:
    rows = [
        f"WRONG {_what(x)}: {x['worst']} {x.get('pairs', {}).get('wrong')}"
        for x in built
        if is_wrong(x)
    ]
    rows += [
        f"stuck {_what(x)}: {' and '.join(stuck(x))}: {x.get('pairs', x.get('baseline'))}"
        for x in built
        if stuck(x)
    ]
    return "\n".join(rows)


def _seeds(lines: list[Fields]) -> str:
    seeds = [str(line["seed"]) for line in lines]
    more = f" and {len(seeds) - MAX_SHOWN} more" if len(seeds) > MAX_SHOWN else ""
    return f"[seeds {', '.join(seeds[:MAX_SHOWN])}{more}]" if seeds else ""


def _what(line: Fields) -> str:
    if "arm" not in line:
        return f"seed {line['seed']}"
    return (
        f"seed {line['seed']} ({line['arm']}, {line['segments']} segments, {line['scale']:.2g} m)"
    )


if __name__ == "__main__":
    sys.exit(main())
