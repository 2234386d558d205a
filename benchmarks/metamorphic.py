"""Are problems that are equal planned equally fast, and is a looser problem never slower?

    python benchmarks/metamorphic.py [--families 60] [--seed 0] [--seeds SEED ...] [--only VARIANT]
        [--best] [--against CHECKOUT] [--judge] [--processes 2] [--cpu-limit 120]
        [--journal F.jsonl] [--keep FOLDER]

A family is a problem of the campaign (`campaign_problems.py`), of a random chain and of a bundled
arm in turn, and its variants (`metamorphic_families.py`): equal ones (reversed, mirrored, with all
lengths and gravity scaled, moved with its cell, renamed, split on its lines, with a limit on jerks
that nothing reaches) and looser ones (wider, with higher limits, without obstacles, rotation or
signs, with a looser goal, visited in any order, of a better quality). All are planned at slack 0.
An answer's ratio is to the fastest of all that should be at least as slow: above 1, it is stuck.
The files lie in `--keep`, where `tubeplanner plan --slack 0` takes them; the journal is gone on
with. Exit status 1 if more than 2 % of ratios are above 1.01, a variant is refused where an equal
or tighter one is planned, or the outside judge (`--judge`) does not pass an answer.
"""

import argparse
import hashlib
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

from journals import journalled
from metamorphic_families import EQUAL, LOOSER, VARIANTS, Fields, Options, examine
from shared import HERE, geometric_mean

STUCK, MAX_STUCK = 1.01, 0.02
LEVELS = (1.001, 1.005, STUCK)


def main() -> int:
    """Plan the families, print the table and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0, help="of the first family")
    parser.add_argument("--seeds", type=int, nargs="+", help="of single families, instead")
    parser.add_argument("--only", help="one variant beside the base")
    parser.add_argument("--best", action="store_true", help="quality best as well")
    parser.add_argument("--against", type=Path, help="another checkout, plan by plan in turns")
    parser.add_argument("--judge", action="store_true", help="have every answer judged outside")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--cpu-limit", type=float, default=120.0, help="of every plan [s]")
    parser.add_argument("--journal", type=Path, help="one JSON line per family; is gone on with")
    parser.add_argument("--keep", type=Path, default=HERE / "output/metamorphic")
    arguments = parser.parse_args()
    usual = [variant.name for variant in VARIANTS if arguments.best or variant.quality != "best"]
    names = tuple(usual if arguments.only is None else ("base", arguments.only))
    if unknown := set(names) - {variant.name for variant in VARIANTS}:
        parser.error(f"{unknown.pop()} is none of {', '.join(v.name for v in VARIANTS)}")
    against = arguments.against and arguments.against.resolve()
    options = Options(
        names, arguments.keep.resolve(), arguments.cpu_limit, against, arguments.judge
    )
    seeds = arguments.seeds or list(range(arguments.seed, arguments.seed + arguments.families))
    keys = {seed: _key(seed, options) for seed in seeds}
    lines, work = [], partial(examine, options=options)
    for line, is_new in journalled(keys, work, arguments.journal, arguments.processes):
        lines.append(line)
        if is_new:
            print(f"{line['seed']} {line.get('arm', '')}: {line['status']}", flush=True)
            for text in _faults(line, options.keep):
                print(text, flush=True)
    print(report(lines, options))
    return int(not is_good(lines))


def ratios(answers: Fields) -> dict[str, float]:
    """Return each answer's duration in those of the fastest that should be at least as slow.

    It is infinite where there is no answer though one of those has one. Answers for which the time
    did not suffice have none.
    """
    durations = {
        name: math.inf if answer["duration"] is None else answer["duration"]
        for name, answer in answers.items()
        if answer["status"] != "timeout"
    }
    variants = [variant for variant in VARIANTS if variant.name in durations]
    equals = [durations[each.name] for each in variants if each.relation == EQUAL]
    result: dict[str, float] = {}
    for each in variants:
        own, least = durations[each.name], min(equals, default=math.inf)
        if each.relation == LOOSER:
            least = min([least, *(durations.get(name, math.inf) for name in each.beyond)])
        elif each.relation != EQUAL:
            own, least = durations.get("base", math.inf), own
        if math.isfinite(least) and (each.relation != EQUAL or len(equals) > 1):
            result[each.name] = own / least
    return result


def is_good(lines: list[Fields]) -> bool:
    """Return whether few answers are stuck, none is missing, and none fails outside."""
    planned = [line["answers"] for line in lines if line["status"] == "planned"]
    values = [value for answers in planned for value in ratios(answers).values()]
    few = sum(value > STUCK for value in values) <= MAX_STUCK * len(values)
    judged = [answer.get("judged") is not False for each in planned for answer in each.values()]
    ended = [line["status"] != "crash" for line in lines]
    return few and all(map(math.isfinite, values)) and all(judged) and all(ended)


def report(lines: list[Fields], options: Options) -> str:
    """Return the table of ratios by variant, and lists of what is stuck, slow or wrong."""
    lines = sorted(lines, key=lambda line: line["seed"])
    planned = [line["answers"] for line in lines if line["status"] == "planned"]
    rows = [f"{len(planned)} families"]
    titles = ("pairs", "> 0.1 %", "> 0.5 %", "> 1 %", "mean", "largest", "CPU [s]")
    compared = ("other > 1 %", "T / other", "largest", "CPU / other") if options.against else ()
    rows.append(f"{'variant':16}" + "".join(f"{title:>12}" for title in (*titles, *compared)))
    everything: list[tuple[list[Fields], str]] = [(planned, name) for name in options.names]
    for chosen, name in [*everything, (planned, "")]:
        rows.append(f"{name or 'all':16}" + "".join(f"{x:>12}" for x in _row(chosen, name)))
    rows += [text for line in lines for text in _faults(line, options.keep)]
    return "\n".join(rows)


def _row(planned: list[Fields], name: str) -> list[str]:
    """Return the cells of a variant, or, without a name, of all."""

    def of(all_ratios: list[dict[str, float]]) -> list[float]:
        return [x for one in all_ratios for key, x in one.items() if name in ("", key)]

    values = of([ratios(answers) for answers in planned])
    answers = [x for each in planned for key, x in each.items() if name in ("", key)]
    finite = [value for value in values if math.isfinite(value)]
    shares = [_share(values, level) for level in LEVELS]
    cpu = math.fsum(x["cpu"] or 0.0 for x in answers)
    largest = max(values, default=math.nan)
    cells = [str(len(values)), *shares, f"{geometric_mean(finite):.4f}", f"{largest:.4f}"]
    cells.append(f"{cpu:.1f}")
    if any("other" in x for x in answers):
        others = [{key: x["other"] for key, x in each.items()} for each in planned]
        both = [x for x in answers if x["duration"] and x["other"]["duration"]]
        compared = [x["duration"] / x["other"]["duration"] for x in both]
        times = geometric_mean(x["cpu"] / x["other"]["cpu"] for x in both)
        cells.append(_share(of([ratios(each) for each in others]), STUCK))
        cells.append(f"{geometric_mean(compared):.4f}")
        cells += [f"{max(compared, default=math.nan):.4f}", f"{times:.2f}"]
    return cells


def _share(values: list[float], level: float) -> str:
    above = sum(value > level for value in values)
    return f"{above} {above / max(len(values), 1):.1%}"


def _faults(line: Fields, folder: Path) -> list[str]:
    """Return a family's answers that are stuck, missing, ended or wrong, a line each."""
    rows = [] if "answers" in line else [f"{line['seed']}: {line['status']}: {line['message']}"]
    answers = line.get("answers", {})
    values = ratios(answers)
    for name, answer in answers.items():
        ratio, duration = values.get(name, 1.0), answer["duration"]
        if answer.get("judged") is False:
            what = "WRONG outside"
        elif answer["status"] != "success":
            what = f"{answer['status']}: {answer['message'][:90]}"
        elif ratio > STUCK:
            what = f"{ratio:.4f} ({duration:.6g} s)"
        else:
            continue
        path = folder / f"family_{line['seed']}" / name.replace(" ", "_")
        rows.append(f"{line['seed']} {line['arm']}: {name}: {what} {path}.yaml")
    return rows


def _key(seed: int, options: Options) -> str:
    """Return a hash of all that the line of a family depends on."""
    sources = [*(HERE / "benchmarks").rglob("*.py")]
    for checkout in filter(None, (HERE, options.against)):
        sources += [*(checkout / "src").rglob("*.py"), *(checkout / "src").rglob("*.so")]
    content = b"".join(path.read_bytes() for path in sorted(sources))
    how = repr((seed, replace(options, keep=Path())))
    return hashlib.sha256(how.encode() + content).hexdigest()


if __name__ == "__main__":
    raise SystemExit(main())
