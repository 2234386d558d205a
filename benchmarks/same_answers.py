"""Whether two checkouts give the same answers: durations, trajectories and certificates.

    python benchmarks/same_answers.py OTHER_CHECKOUT [--tolerance 0] [--rows] [--in-turn]

Plans every bundled problem with the default method, and the paper's cells with the two phases of
Suh & Bishop (1988) as well, with the sources of this checkout and of another one, both in one run.
With tolerance 0 the trajectories' coefficients and all margins must be equal bit for bit; otherwise
durations and margins may differ by that much, relative or absolute. Exit status 1 if any differs.
Prints how durations and processor times compare; on a busy machine, compare times in turn.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from checkout import HERE, SHORTEST

PAPER_METHODS = ("branch-and-bound", "suh-bishop")
# Planned by either checkout's own package, through names that do not change.
DRIVER = """
from dataclasses import replace
import hashlib, json, sys, time
from tubeplanner import load_problem, plan
for name, method in json.load(sys.stdin):
    problem, begin = load_problem(f"example:{name}"), time.process_time()
    result = plan(problem, replace(SHORTEST, method=method))
    seconds = time.process_time() - begin
    margins = {} if result.certificate is None else {
        condition: judged.margin for condition, judged in result.certificate.conditions.items()}
    found = result.trajectory
    content = b"" if found is None else found.breakpoints.tobytes() + found.coefficients.tobytes()
    print(json.dumps({"name": name, "method": method, "status": result.status,
        "duration": result.duration, "margins": margins, "seconds": seconds,
        "trajectory": hashlib.sha256(content).hexdigest()}), flush=True)
"""


def bundled_plans() -> list[tuple[str, str]]:
    """Return every bundled problem that has a tube, with the methods it is planned by."""
    plans = []
    for path in sorted((HERE / "robots").glob("*/*.yaml")):
        text = path.read_text()
        if "tube:" not in text or "format: tubeplanner/cycle" in text:
            continue
        name = f"{path.parent.name}/{path.stem}"
        plans.append((name, "refinement"))
        if path.stem.startswith("paper_"):
            plans += [(name, method) for method in PAPER_METHODS]
    return plans


def answers(checkout: Path) -> list[dict]:
    """Return what the sources of a checkout plan."""
    environment = os.environ | {"PYTHONPATH": str(checkout / "src"), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", SHORTEST + DRIVER],
        input=json.dumps(bundled_plans()),
        env=environment,
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise SystemExit(f"{checkout}: {done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines()]


def difference(one: dict, other: dict, tolerance: float) -> str:
    """Say in what two answers differ; empty if in nothing that counts."""
    if one["status"] != other["status"]:
        return f"{one['status']}, the other {other['status']}"
    if tolerance == 0:
        same = one["trajectory"] == other["trajectory"] and one["margins"] == other["margins"]
        return "" if same else "not bit for bit"
    pairs = {"duration": (one["duration"], other["duration"])}
    pairs |= {name: (margin, other["margins"][name]) for name, margin in one["margins"].items()}
    wrong = [name for name, (a, b) in pairs.items() if not _close(a, b, tolerance)]
    return ", ".join(wrong)


def _close(a: float | None, b: float | None, tolerance: float) -> bool:
    if a is None or b is None:
        return a is b
    return abs(a - b) <= tolerance * max(1.0, abs(a), abs(b))


def main() -> int:
    """Plan with both checkouts and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--tolerance", type=float, default=0.0)
    parser.add_argument("--rows", action="store_true", help="print equal rows too")
    parser.add_argument("--in-turn", action="store_true", help="one checkout after the other")
    arguments = parser.parse_args()
    with ThreadPoolExecutor(1 if arguments.in_turn else 2) as pool:
        here, there = pool.map(answers, (HERE, arguments.other.resolve()))
    different = 0
    for one, other in zip(here, there, strict=True):
        found = difference(one, other, arguments.tolerance)
        different += bool(found)
        if found or arguments.rows:
            durations = f"{one['duration']!r} here, {other['duration']!r} there"
            print(f"{one['name']} ({one['method']}): {durations}; {found or 'equal'}")
    print(f"{len(here)} plans, {different} differ")
    print(*comparison(here, there), sep="\n")
    return 1 if different else 0


def comparison(here: list[dict], there: list[dict]) -> Iterator[str]:
    """Yield how durations and processor times here compare with those there."""
    ratios = [_ratio(one, other) for one, other in zip(here, there, strict=True)]
    mean = math.exp(math.fsum(map(math.log, ratios)) / len(ratios))
    least, most = min(ratios) - 1, max(ratios) - 1
    yield f"durations: {mean - 1:+.2g} in the mean, {least:+.2g} to {most:+.2g}"
    spent, other = (sum(row["seconds"] for row in rows) for rows in (here, there))
    yield f"processor time: {spent:.1f} s here, {other:.1f} s there, ratio {spent / other:.3f}"


def _ratio(one: dict, other: dict) -> float:
    if one["duration"] is None or other["duration"] is None:
        return 1.0 if one["duration"] == other["duration"] else math.inf
    return one["duration"] / other["duration"]


if __name__ == "__main__":
    raise SystemExit(main())
