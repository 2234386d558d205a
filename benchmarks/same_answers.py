"""Does another checkout give the same answers, bit for bit, and how much quicker is this one?

    python benchmarks/same_answers.py OTHER_CHECKOUT [--tolerance 0] [--only SUBSTRING]
        [--random 0] [--rows]

Every bundled problem is planned by the default method, the paper's cells by the two phases of
Suh & Bishop (1988) as well, and with `--random` so many problems of the campaign
(`campaign_problems.py`). Both checkouts plan each in turns, in processes that live as long as the
run. With tolerance 0 the trajectories' coefficients and all margins must be equal bit for bit;
otherwise durations and margins may differ by that much, relative or absolute. Exit status 1 if any
differs. Durations and processor times, certificates included, are compared in the end.
"""

import argparse
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from campaign_problems import build
from campaign_witness import Unsuitable
from shared import HERE, Checkout, geometric_mean, names_with_tube

PAPER_METHODS = ("branch-and-bound", "suh-bishop")
DRIVER = """
from dataclasses import replace
import hashlib, json, sys, time
from tubeplanner import load_problem, plan
for line in sys.stdin:
    path, method = json.loads(line)
    problem = load_problem(path)
    problem.collision  # geometry is built before planning begins
    begin = time.process_time()
    result = plan(problem, replace(SHORTEST, method=method))
    seconds = time.process_time() - begin
    margins = {} if result.certificate is None else {
        condition: judged.margin for condition, judged in result.certificate.conditions.items()
        if judged.margin is not None}  # another checkout may not know a condition
    motion = result.trajectory
    parts = () if motion is None else (motion.breakpoints, motion.coefficients)
    content = b"".join(part.tobytes() for part in parts)
    print(json.dumps({"status": result.status, "duration": result.duration, "margins": margins,
        "seconds": seconds, "trajectory": hashlib.sha256(content).hexdigest()}), flush=True)
"""
Answer = dict[str, Any]


def bundled_plans() -> Iterator[tuple[str, str]]:
    """Yield every bundled problem that has a tube, with the methods it is planned by."""
    for name in names_with_tube():
        yield f"example:{name}", "refinement"
        if name.split("/")[1].startswith("paper_"):
            yield from ((f"example:{name}", method) for method in PAPER_METHODS)


def random_plans(count: int, folder: Path) -> Iterator[tuple[str, str]]:
    """Write random problems that have a solution, as many as can be built; yield their plans."""
    for seed in range(count):
        own = folder / f"seed_{seed}"
        own.mkdir()
        try:
            yield str(build(seed, own).path), "refinement"
        except Unsuitable as reason:
            print(f"seed {seed}: {reason}")


def difference(one: Answer, other: Answer, tolerance: float) -> str:
    """Return in what two answers differ; empty if in nothing that counts."""
    if one["status"] != other["status"]:
        return f"{one['status']}, the other {other['status']}"
    if tolerance == 0:
        same = one["trajectory"] == other["trajectory"] and one["margins"] == other["margins"]
        return "" if same else "not bit for bit"
    pairs = {"duration": (one["duration"], other["duration"])}
    pairs |= {
        name: (one["margins"].get(name), other["margins"].get(name))
        for name in one["margins"] | other["margins"]
    }
    return ", ".join(name for name, (a, b) in pairs.items() if not _close(a, b, tolerance))


def _close(a: float | None, b: float | None, tolerance: float) -> bool:
    if a is None or b is None:
        return a is b
    return abs(a - b) <= tolerance * max(1.0, abs(a), abs(b))


def comparison(pairs: list[tuple[Answer, Answer]]) -> Iterator[str]:
    """Yield how durations and processor times here compare with those there."""
    ratios = [_ratio(one, other) for one, other in pairs]
    least, most = min(ratios) - 1, max(ratios) - 1
    yield f"durations: {geometric_mean(ratios) - 1:+.2g} in the mean, {least:+.2g} to {most:+.2g}"
    here, there = (sum(pair[side]["seconds"] for pair in pairs) for side in (0, 1))
    gains = [one["seconds"] / other["seconds"] for one, other in pairs]
    yield (
        f"processor time: {here:.1f} s here, {there:.1f} s there, ratio {here / there:.3f}; "
        f"geometric mean of ratios {geometric_mean(gains):.3f}, largest {max(gains):.2f}"
    )


def _ratio(one: Answer, other: Answer) -> float:
    if one["duration"] is None or other["duration"] is None:
        return 1.0 if one["duration"] == other["duration"] else math.inf
    return one["duration"] / other["duration"]


def main() -> int:
    """Plan with both checkouts and compare; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--tolerance", type=float, default=0.0)
    parser.add_argument("--only", default="", help="bundled problems whose name contains this")
    parser.add_argument("--random", type=int, default=0, help="problems of the campaign as well")
    parser.add_argument("--rows", action="store_true", help="print equal rows too")
    options = parser.parse_args()
    checkouts = [Checkout(folder, DRIVER) for folder in (HERE, options.other.resolve())]
    for checkout in checkouts:  # libraries are loaded before time counts
        checkout.ask(("example:two_link/paper_1_30mm", "refinement"))
    pairs, different = [], 0
    with tempfile.TemporaryDirectory() as folder:
        plans = [plan for plan in bundled_plans() if options.only in plan[0]]
        for plan in (*plans, *random_plans(options.random, Path(folder))):
            one, other = (checkout.ask(plan) for checkout in checkouts)
            pairs.append((one, other))
            what = difference(one, other, options.tolerance)
            different += bool(what)
            if what or options.rows:
                durations = f"{one['duration']!r} here, {other['duration']!r} there"
                print(f"{plan[0]} ({plan[1]}): {durations}; {what or 'equal'}", flush=True)
    print(f"{len(pairs)} plans, {different} differ")
    if pairs:
        print(*comparison(pairs), sep="\n")
    return 1 if different else 0


if __name__ == "__main__":
    raise SystemExit(main())
