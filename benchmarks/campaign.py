"""Plan random problems that have a solution, and let the outside judge look at every answer.

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
import json
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

from campaign_examine import Fields, Options, examine, is_wrong
from campaign_report import report
from tubeplanner import WorkerProcesses
from tubeplanner.many.content_hash import package_hash
from tubeplanner.many.run_many import run_many
from tubeplanner.studies.journal import Journal


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
    sources = sorted([*folder.glob("campaign_*.py"), *folder.glob("outside*/*.py")])
    sources = [path for path in sources if path.name != "campaign_report.py"]
    ours = b"".join(path.read_bytes() for path in sources)
    how = repr((seed, replace(options, keep=None), package_hash())).encode()
    return hashlib.sha256(how + ours).hexdigest()


def _progress(line: Fields) -> str:
    duration, judged = line.get("duration"), line.get("judged")
    verdict = {True: "judged good", False: "WRONG", None: line.get("message", "")[:90]}[judged]
    took = "" if duration is None else f" {duration:.3f} s in {line['planning_time']:.1f} s"
    return f"{line['seed']} {line.get('arm', '')}: {line['status']}{took}: {verdict}"


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
    with nullcontext() if options.output is None else Journal(options.output) as journal:
        known = {seed: journal[key] for seed, key in keys.items() if journal and key in journal}
        lines = list(known.values())
        for line in _lines([seed for seed in seeds if seed not in known], how, options.processes):
            lines.append(line)
            print(_progress(line), flush=True)
            if journal is not None:
                journal.add(keys[line["seed"]], {"seed": line["seed"]}, line)
    return _answered(lines)


def recorded(path: Path) -> list[Fields]:
    """Return the lines of a journal, whatever sources made them; of a seed the last one."""
    rows = path.read_text().splitlines(keepends=True)
    whole = [row for row in rows if row.endswith("\n")]  # another one is being written
    done = [json.loads(row)["row"] for row in whole]
    return list({line["seed"]: line for line in done}.values())


def _answered(lines: list[Fields]) -> int:
    """Print the report of lines; return the exit status."""
    print(report(lines))
    return 1 if any(map(is_wrong, lines)) else 0


if __name__ == "__main__":
    sys.exit(main())
