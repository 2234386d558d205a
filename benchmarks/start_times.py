"""Where does the time of a command go before its work begins, here and in another checkout?

    python benchmarks/start_times.py OTHER_CHECKOUT [--repeats 10]

Whole processes, in turns: those of Python, of the libraries, of the modules that a command loads,
and of commands. The least and the middle wall time of each [s], and the ratio of the least ones;
then the parts of `plan`. Modules are compiled before, as in an installation.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shared import HERE, environment

PROBLEM = "example:ur5/over_the_wall"
LIBRARIES = "import numpy, pinocchio, coal, pydantic, click, yaml, rich.console, rich.table"
RUN = "from tubeplanner.cli.start import run; run()"
PROCESSES = {
    "python": ("pass",),
    "import tubeplanner": ("import tubeplanner",),
    "libraries of plan": (LIBRARIES,),
    "modules of plan": ("import tubeplanner.cli.plan",),
    "tubeplanner --help": (RUN, "--help"),
    f"tubeplanner info {PROBLEM}": (RUN, "info", PROBLEM),
    f"tubeplanner plan {PROBLEM}": (RUN, "plan", PROBLEM),
}


def wall_time(folder: Path, arguments: tuple[str, ...]) -> float:
    """Return the wall time of a Python process that imports the package of a checkout [s]."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", *arguments],
        env=environment(folder),
        stdout=subprocess.DEVNULL,
        check=True,
    )
    return time.perf_counter() - begin


def parts_of_plan(folder: Path) -> tuple[float, float]:
    """Return the times of loading the problem and of planning it, as `plan --json` has them [s]."""
    command = [sys.executable, "-c", RUN, "plan", PROBLEM, "--json"]
    output = subprocess.run(command, env=environment(folder), stdout=subprocess.PIPE, check=True)
    report = json.loads(output.stdout)
    return report["loading_time"], report["planning_time"]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="Root of the other checkout, with its library.")
    parser.add_argument("--repeats", type=int, default=10, help="Of every process [10].")
    options = parser.parse_args()
    folders = {"other": options.other.resolve(), "here": HERE}
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory() as away:
        os.chdir(away)
        for folder in folders.values():  # compiles modules and measures meshes
            wall_time(folder, (RUN, "plan", PROBLEM))
        rows = {name: {each: list[float]() for each in folders} for name in PROCESSES}
        parts = {each: list[tuple[float, float]]() for each in folders}
        for _ in range(options.repeats):
            for each, folder in folders.items():
                for name, arguments in PROCESSES.items():
                    rows[name][each].append(wall_time(folder, arguments))
                parts[each].append(parts_of_plan(folder))
    print("| process | other, least | middle | here, least | middle | here / other |")
    print("|---|---|---|---|---|---|")
    for name, times in rows.items():
        cells = [f"{min(own):.3f} | {statistics.median(own):.3f}" for own in times.values()]
        print(f"| {name} | {' | '.join(cells)} | {min(times['here']) / min(times['other']):.2f} |")
    print("\n| of plan | other, least | here, least |\n|---|---|---|")
    for k, name in enumerate(("loading", "planning")):
        cells = [f"{min(pair[k] for pair in own):.3f}" for own in parts.values()]
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
