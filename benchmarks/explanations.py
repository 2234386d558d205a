"""Is what `explain` says of problems without an answer true, and does it help?

    python benchmarks/explanations.py [--only SUBSTRING] [--cases 0,7] [--time-limit 60]

Explains every problem of `refusals.py` and prints what the command would print, to be read.
Then each remedy is planned with afresh, as `--set` would, and must have the duration that was told.
Exit status 1 if a problem has no remedy, or if a remedy is none.
"""

import argparse
import time
from collections.abc import Mapping
from typing import Any

from refusals import refusal_cases
from tubeplanner import load_problem, plan
from tubeplanner.commands.explanation_report import explanation_text
from tubeplanner.explanation.explain import explain
from tubeplanner.explanation.explanation import Explanation
from tubeplanner.explanation.remedy import Remedy
from tubeplanner.many.worker_processes import WorkerProcesses
from tubeplanner.planning.plan_options import PlanOptions

OPTIONS = PlanOptions(quality="fast", slack=0.0)


def faults(found: Explanation, bundled: str, changes: Mapping[str, Any]) -> list[str]:
    """Say what is wrong with an explanation; empty if nothing."""
    if not found.remedies:
        return ["no remedy"]
    wrong = [remedy_fault(remedy, bundled, changes) for remedy in found.remedies]
    return [fault for fault in wrong if fault]


def remedy_fault(remedy: Remedy, bundled: str, changes: Mapping[str, Any]) -> str:
    """Plan with a remedy, and say what does not hold of it; empty if all does."""
    planned = plan(load_problem(bundled, changes={**changes, **remedy.changes}), OPTIONS)
    if not planned.succeeded:
        return f"{remedy.text}: {planned.status}: {planned.message}"
    if abs(planned.duration / remedy.duration - 1) > 1e-6:
        return f"{remedy.text}: {planned.duration:.6f} s, not {remedy.duration:.6f} s"
    return ""


def main() -> int:
    """Print what is said of each, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases whose name or problem contains this")
    parser.add_argument("--cases", default="", help="their numbers, from 0, with commas")
    parser.add_argument("--time-limit", type=float, default=60.0, help="for each [s]")
    parser.add_argument("--processes", type=int, default=2, help="how many changes at a time")
    asked = parser.parse_args()
    numbers = {int(word) for word in asked.cases.split(",") if word}
    wrong = count = 0
    for number, case in enumerate(refusal_cases()):
        if asked.only not in f"{case.name} {case.bundled}" or (numbers and number not in numbers):
            continue
        bundled = f"example:{case.bundled}"
        changes, begun = case.field_changes(), time.monotonic()
        with WorkerProcesses(asked.processes) as executor:
            found = explain(
                bundled, changes=changes, time_limit=asked.time_limit, executor=executor
            )
        took = time.monotonic() - begun
        print(f"\n## {number}: {case.name}\n\n{explanation_text(found, took)}")
        said = faults(found, bundled, changes)
        print("\n".join(f"WRONG: {fault}" for fault in said), flush=True)
        count, wrong = count + 1, wrong + bool(said)
    print(f"{count} problems, {wrong} with something wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
