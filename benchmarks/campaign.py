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
The output file is a study's journal: what it has by the same seed, options and sources is not
done again. Exit status 1 if an answer is wrong.
"""

import argparse
import hashlib
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from campaign_examine import UNBUILT, Fields, Options, examine, is_wrong
from tubeplanner import WorkerProcesses
from tubeplanner.many.content_hash import package_hash
from tubeplanner.many.run_many import run_many
from tubeplanner.studies.journal import Journal

STUCK = 1.01  # times the best of the three


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


def _lines(seeds: list[int], options: Options, processes: int) -> Iterator[Fields]:
    """Yield what comes of every seed; one whose process dies costs its own line alone."""
    work = partial(examine, options=options)
    with nullcontext() if processes == 1 else WorkerProcesses(processes) as workers:
        for done in run_many(work, seeds, workers):
            message = f"{type(done.error).__name__}: {done.error}"
            crashed = {"seed": seeds[done.index], "status": "crash", "message": message}
            yield crashed if done.value is None else done.value


def _key(seed: int, options: Options) -> str:
    """Return a hash of all that the line of a seed depends on."""
    folder = Path(__file__).parent
    sources = sorted([*folder.glob("campaign*.py"), *folder.glob("outside*/*.py")])
    ours = b"".join(path.read_bytes() for path in sources)
    how = repr((seed, replace(options, keep=None), package_hash())).encode()
    return hashlib.sha256(how + ours).hexdigest()


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
    if "arm" not in line:
        return f"seed {line['seed']}"
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
    how = Options(
        options.pairs,
        options.baselines,
        options.motors,
        options.time_limit,
        options.keep,
        options.slack,
    )
    keys = {seed: _key(seed, how) for seed in seeds}
    with nullcontext() if options.output is None else Journal(options.output) as journal:
        known = {seed: journal[key] for seed, key in keys.items() if journal and key in journal}
        lines = list(known.values())
        for line in _lines([seed for seed in seeds if seed not in known], how, options.processes):
            lines.append(line)
            print(_progress(line), flush=True)
            if journal is not None:
                journal.add(keys[line["seed"]], {"seed": line["seed"]}, line)
    print(summary(lines))
    return 1 if any(map(is_wrong, lines)) else 0


if __name__ == "__main__":
    sys.exit(main())
