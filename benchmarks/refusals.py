"""How long refusals take beside plans of the problems that they were made from.

    python benchmarks/refusals.py [OTHER_CHECKOUT] [--only SUBSTRING]

Plans every problem of `refusal_cases.py` and the bundled one behind it, with another checkout in
turns, if one is given. Prints processor times, the refusals' as multiples of the plans', and with
what status, reason and place they end. Exit status 1 if a refusal of this checkout takes more than
its share of a plan, ends with another status than it should, or names no place.
"""

import argparse
from pathlib import Path

from ruamel.yaml import YAML

from checkout import HERE, Checkout
from refusal_cases import RefusalCase, changed, refusal_cases

# Planned by either checkout's own package; the least of the times counts.
DRIVER = """
import json, sys, time
from tubeplanner import PlanOptions, parse_problem, plan
# Older checkouts plan the shortest motion always.
options = getattr(PlanOptions(), "shortest", PlanOptions())
for line in sys.stdin:
    question = json.loads(line)
    problem, times = parse_problem(question["data"]), []
    for _ in range(question["repeats"]):
        begun = time.process_time()
        result = plan(problem, options)
        times.append(time.process_time() - begun)
    answer = {"status": result.status, "message": result.message, "place": str(result.place)}
    print(json.dumps(answer | {"cpu": min(times)}), flush=True)
"""


class Planning:
    """A checkout that plans."""

    def __init__(self, folder: Path) -> None:
        """Start it in the folder of a checkout."""
        self._checkout = Checkout(folder, DRIVER)
        self._times: dict[str, float] = {}

    def plan(self, data: dict, repeats: int = 1) -> dict:
        """Return status, message, place and processor time [s] of a problem's plan."""
        return self._checkout.ask({"data": data, "repeats": repeats})

    def time_of(self, bundled: str) -> float:
        """Return the processor time [s] of a bundled problem's plan, measured once."""
        if bundled not in self._times:
            self._times[bundled] = self.plan(bundled_data(bundled), repeats=3)["cpu"]
        return self._times[bundled]


def bundled_data(name: str) -> dict:
    """Return the content of a bundled problem's file."""
    return YAML(typ="safe").load((HERE / "robots" / f"{name}.yaml").read_text())


def fault(case: RefusalCase, answer: dict, share: float) -> str:
    """Say what is wrong with a refusal; empty if nothing."""
    if answer["status"] != case.status:
        return f"ends with {answer['status']}, not {case.status}"
    if not answer["place"]:
        return "names no place"
    return f"more than {case.most:g}" if share > case.most else ""


def main() -> int:
    """Print the table and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", nargs="?", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="cases whose name or problem contains this")
    options = parser.parse_args()
    paths = [HERE] if options.other is None else [options.other.resolve(), HERE]
    checkouts = [Planning(path) for path in paths]
    columns = "".join(f"{name:>9}" for name in ("plan", "refusal", "share") * len(paths))
    print(f"{'case':22}{'problem':28}{columns}")
    faults = 0
    for case in refusal_cases():
        if options.only not in f"{case.name} {case.bundled}":
            continue
        data, row = changed(bundled_data(case.bundled), case.changes), ""
        for checkout in checkouts:
            planned = checkout.time_of(case.bundled)
            answer = checkout.plan(data, 2 if case.is_early else 1)
            share = answer["cpu"] / planned
            row += f"{planned:9.2f}{answer['cpu']:9.2f}{share:9.2f}"
        wrong = fault(case, answer, share)
        faults += bool(wrong)
        print(f"{case.name:22}{case.bundled:28}{row}  {wrong}")
        print(f"    {answer['status']}: {answer['message']} [{answer['place']}]", flush=True)
    return int(faults > 0)


if __name__ == "__main__":
    raise SystemExit(main())
