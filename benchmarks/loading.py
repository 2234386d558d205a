"""Processor times of whole commands beside another checkout's, with the cache in every state.

    python benchmarks/loading.py OTHER_CHECKOUT [PROBLEM ...] [--repeats 5] [--most 0.5]

Runs `tubeplanner plan` and `tubeplanner check` in processes of their own, both checkouts in turns,
with the cache warm, cold, broken (every entry cut in half) and off. Times are those of the
processor, the least of the repeats: of the whole process, and of all but planning or judging, which
is starting, importing, loading and writing. Exit status 1 if `plan` with a warm cache takes more
than the share `--most` of the other checkout's, as the geometric mean of the problems.
"""

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
PROBLEMS = (
    "two_link/paper_1_10mm",
    "ur5/over_the_wall",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
STATES = ("warm", "cold", "broken", "off")
# Runs the command line and prints the processor time of the process, and of the step named last.
DRIVER = """
import importlib, sys, time
from tubeplanner.commands.cli import main
*arguments, module, name = sys.argv[1:]
if arguments[0] == "plan":
    from tubeplanner import PlanOptions
    arguments += ["--slack", "0"] if hasattr(PlanOptions, "slack") else []
module, taken = importlib.import_module(module), []
real = getattr(module, name)
def timed(*values, **named):
    begin = time.process_time()
    try:
        return real(*values, **named)
    finally:
        taken.append(time.process_time() - begin)
setattr(module, name, timed)
status = main(arguments)
print("TIMES", time.process_time(), sum(taken))
sys.exit(status)
"""
STEPS = {
    "plan": ("tubeplanner.planning.planner", "plan"),
    "check": ("tubeplanner.verification.verification", "verify"),
}


@dataclass(frozen=True)
class Times:
    """Processor times of a command [s]: the whole process, and all but planning or judging."""

    whole: float
    loading: float


@dataclass(frozen=True)
class Checkout:
    """A checkout and its folder for compiled modules, caches and trajectories."""

    path: Path
    folder: Path

    def run(self, command: str, problem: str, state: str) -> Times:
        """Return the times of a command with the cache in a state."""
        cache = self._cache(state)
        trajectory = str(self.folder / f"{problem.replace('/', '.')}.json")
        names = [f"example:{problem}", *(["-o"] if command == "plan" else []), trajectory]
        done = subprocess.run(
            [sys.executable, "-c", DRIVER, command, *names, *STEPS[command]],
            env=self._environment(cache),
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise SystemExit(f"{self.path}: {command} {problem} failed: {done.stderr[-500:]}")
        whole, step = map(float, done.stdout.rsplit("TIMES", 1)[1].split())
        return Times(whole, whole - step)

    def _cache(self, state: str) -> str:
        """Bring the cache into a state; return what the command is to be told of it."""
        warm, other = self.folder / "warm", self.folder / "other"
        if state in ("warm", "off"):
            return str(warm) if state == "warm" else state
        shutil.rmtree(other, ignore_errors=True)
        if state == "broken":
            shutil.copytree(warm, other)
            for entry in other.iterdir():
                entry.write_bytes(entry.read_bytes()[: entry.stat().st_size // 2])
        return str(other)

    def _environment(self, cache: str) -> dict[str, str]:
        environment = os.environ | {
            "PYTHONPATH": str(self.path / "src"),
            "PYTHONPYCACHEPREFIX": str(self.folder / "compiled"),
            "OPENBLAS_NUM_THREADS": "1",
            "TUBEPLANNER_CACHE": cache,
        }
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled
        return environment


def least_times(
    checkouts: list[Checkout], command: str, problem: str, state: str, repeats: int
) -> list[Times]:
    """Return the least times of both checkouts, run in turns."""
    runs = [
        [checkout.run(command, problem, state) for checkout in checkouts] for _ in range(repeats)
    ]
    return [
        Times(min(run.whole for run in own), min(run.loading for run in own))
        for own in zip(*runs, strict=True)
    ]


def main() -> int:
    """Print the table and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path)
    parser.add_argument("problems", nargs="*", default=PROBLEMS)
    parser.add_argument("--repeats", type=int, default=5, help="with a warm cache; else at most 2")
    parser.add_argument("--most", type=float, default=0.5)
    options = parser.parse_args()
    print(f"{'problem':28}{'command':8}{'cache':8}{'whole [s]':>18}{'ratio':>7}", end="")
    print(f"{'loading [s]':>18}{'ratio':>7}  share of loading")
    logs = []
    with tempfile.TemporaryDirectory() as scratch:
        paths = (options.other.resolve(), HERE)
        checkouts = [Checkout(path, Path(scratch) / str(k)) for k, path in enumerate(paths)]
        for problem in options.problems:
            for command in STEPS:
                for checkout in checkouts:  # compiles, fills the cache
                    checkout.run(command, problem, "warm")
                for state in STATES:
                    repeats = options.repeats if state == "warm" else min(options.repeats, 2)
                    was, now = least_times(checkouts, command, problem, state, repeats)
                    if (command, state) == ("plan", "warm"):
                        logs.append(math.log(now.whole / was.whole))
                    print(
                        f"{problem:28}{command:8}{state:8}"
                        f"{was.whole:9.2f}{now.whole:9.2f}{now.whole / was.whole:7.2f}"
                        f"{was.loading:9.2f}{now.loading:9.2f}{now.loading / was.loading:7.2f}"
                        f"{was.loading / was.whole:8.2f}{now.loading / now.whole:6.2f}",
                        flush=True,
                    )
    mean = math.exp(sum(logs) / len(logs))
    print(f"plan with a warm cache: {mean:.2f} of before, geometric mean; goal {options.most:g}")
    return int(mean > options.most)


if __name__ == "__main__":
    sys.exit(main())
