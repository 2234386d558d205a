"""How many plans a minute do many workers make, beside processes that each loop over `plan`?

    python benchmarks/studies.py [--count 200] [--chunk 30] [--workers 2] [--without-dask]
        [--costs]

Problems of the bundled two-link arm and UR5 in turns, with tubes of many widths, quality fast,
slack 0: short plans, for which what is around them weighs most. Planned by as many plain loops as
there are workers (a robot is loaded once), by `plan_many` in its own processes,
and by `plan_many` through a Dask cluster of this machine, chunk by chunk in turns, so that other
work on the machine slows all of them. Processes are started and have planned each problem before
time counts; how long that takes is printed apart. The loops do not wait for each other at the end
of a chunk, the others do. `plan_many` gets problems as their files hold them, changed by field
path, as studies do. Processor times are those of all processes together: they tell work apart from
what else the machine does. Exit status 1 if answers differ in a bit, or if `plan_many` makes less
than 0.9 of the plans that the loops make.
With --costs, what one plan costs beside
planning: bytes, and milliseconds of the parent, of Dask's scheduler and of the journal's disk.
"""

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import psutil
from distributed import LocalCluster

from tubeplanner import (
    PlanningProblem,
    PlanOptions,
    ProblemSpec,
    WorkerProcesses,
    dask_executor,
    load_problem,
    plan_many,
)
from tubeplanner.studies.plan_many import Packer, _answer
from tubeplanner.studies.rows import run_many

# One of the processes that a user would start by hand.
LOOP = """
import json, sys, time
from studies import OPTIONS, problem_of
from tubeplanner import plan
for line in sys.stdin:
    begin = time.perf_counter()
    durations = [plan(problem_of(*point), OPTIONS).duration for point in json.loads(line)]
    print(json.dumps({"seconds": time.perf_counter() - begin, "durations": durations}), flush=True)
"""
OPTIONS = PlanOptions(quality="fast", slack=0.0)
NAMES = (
    "example:two_link/paper_1_50mm",
    "example:two_link/around_a_post",
    "example:ur5/over_the_wall",
)
LEAST = 0.9  # of what the loops make
NARROWEST = 0.8  # fraction of the bundled tubes' widths
TASKS, LINES = 2000, 200  # that do nothing; of a journal
Point = tuple[str, float]
Ways = dict[str, Callable[[list[Point]], "Chunk"]]


@dataclass
class Chunk:
    """What came of some points.

    Attributes:
        seconds: How long each of the loops took, or all together.
        durations: Of their motions [s].
        processor: Time of all processes together [s].
    """

    seconds: list[float]
    durations: list[float | None]
    processor: float = 0.0

    def __add__(self, other: "Chunk") -> "Chunk":
        """Return both, one after the other."""
        before = self.seconds or [0.0] * len(other.seconds)
        return Chunk(
            [a + b for a, b in zip(before, other.seconds, strict=True)],
            self.durations + other.durations,
            self.processor + other.processor,
        )


@cache
def _loaded(name: str) -> PlanningProblem:
    return load_problem(name)


def problem_of(name: str, fraction: float) -> PlanningProblem:
    """Return a bundled problem, loaded once, with another width of its tube."""
    problem = _loaded(name)
    return problem.with_tube(replace(problem.tube, radius=fraction * problem.tube.radius))


def points(count: int) -> list[Point]:
    """Return problems and the widths of their tubes."""
    fractions = (1 - (1 - NARROWEST) * k / count for k in range(count))
    return [(NAMES[k % len(NAMES)], fraction) for k, fraction in enumerate(fractions)]


class Loops:
    """Processes that each loop over `plan`."""

    def __init__(self, count: int) -> None:
        command = [sys.executable, "-c", LOOP]
        folders = (str(Path(__file__).parent), os.environ.get("PYTHONPATH", ""))
        path = os.pathsep.join(filter(None, folders))
        self._loops = [
            subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": path},
                # As worker processes: the kernel may share processors out by session.
                start_new_session=True,
            )
            for _ in range(count)
        ]

    def planned(self, asked: list[Point]) -> Chunk:
        """Plan points: pairs of both problems go to the processes in turns."""
        count, durations = len(self._loops), [None] * len(asked)
        fractions = [
            [k for k in range(len(asked)) if k // len(NAMES) % count == loop]
            for loop in range(count)
        ]
        for loop, fraction in zip(self._loops, fractions, strict=True):
            print(json.dumps([asked[k] for k in fraction]), file=loop.stdin, flush=True)
        found = [json.loads(loop.stdout.readline()) for loop in self._loops]
        for fraction, answer in zip(fractions, found, strict=True):
            for k, duration in zip(fraction, answer["durations"], strict=True):
                durations[k] = duration
        return Chunk([answer["seconds"] for answer in found], durations)

    def end(self) -> None:
        """End the processes."""
        for loop in self._loops:
            loop.stdin.close()
            loop.wait()


class Many:
    """`plan_many` by an executor."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._posed = {name: ProblemSpec.read(name) for name in NAMES}

    def planned(self, asked: list[Point]) -> Chunk:
        """Plan points."""
        durations: list[float | None] = [None] * len(asked)
        begin = time.perf_counter()
        problems = (self._posed[name].changed({"tube.radius": f"x{x!r}"}) for name, x in asked)
        for item in plan_many(problems, OPTIONS, self._executor):
            durations[item.index] = item.duration
        return Chunk([time.perf_counter() - begin], durations)


@contextmanager
def cluster(workers: int) -> Iterator[Executor]:
    """Yield the executor of a Dask cluster of processes of this machine."""
    options: dict[str, Any] = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, **options) as made,
        dask_executor(made.scheduler_address) as executor,
    ):
        yield executor


def in_turns(ways: Ways, asked: list[Point], size: int) -> dict[str, Chunk]:
    """Plan all points in every way, chunk by chunk; return the sums."""
    totals = {name: Chunk([], []) for name in ways}
    for begin in range(0, len(asked), size):
        for name, planned in ways.items():
            before = processor_time()
            chunk = planned(asked[begin : begin + size])
            totals[name] += replace(chunk, processor=processor_time() - before)
        so_far = ", ".join(
            f"{name} {max(total.seconds):.1f} s ({total.processor:.1f} s of processors)"
            for name, total in totals.items()
        )
        print(f"  {min(begin + size, len(asked))} points: {so_far}", flush=True)
    return totals


def processor_time() -> float:
    """Return the time of this process and all that it started [s]."""
    here = psutil.Process()
    times = [each.cpu_times() for each in (here, *here.children(recursive=True))]
    return sum(each.user + each.system for each in times)


def warm(name: str, planned: Callable[[list[Point]], Chunk], workers: int) -> None:
    """Have every worker plan each problem, and print how long that takes from nothing."""
    begin = time.perf_counter()
    planned([(each, 1.0) for each in NAMES for _ in range(2 * workers)])
    print(f"  {name}: {time.perf_counter() - begin:.1f} s", flush=True)


def beside_loops(count: int, size: int, workers: int, with_dask: bool) -> bool:
    """Print plans a minute in every way; return whether `plan_many` keeps up."""
    print(f"{workers} workers, {count} points; from nothing until all are warm:")
    with ExitStack() as stack:
        loops = Loops(workers)
        stack.callback(loops.end)
        ways: Ways = {
            "loops over plan": loops.planned,
            "plan_many": Many(stack.enter_context(WorkerProcesses(workers))).planned,
        }
        if with_dask:
            ways["plan_many, Dask"] = Many(stack.enter_context(cluster(workers))).planned
        for name, planned in ways.items():
            warm(name, planned, workers)
        totals = in_turns(ways, points(count), size)
    return _is_as_good(totals, count)


def _is_as_good(totals: dict[str, Chunk], count: int) -> bool:
    """Print the table; return whether answers are the same and `plan_many` keeps up."""
    first = totals["loops over plan"]
    same = all(each.durations == first.durations for each in totals.values())
    heading = ("way", "seconds", "plans/min", "of the loops", "CPU s/plan")
    print("{:16s} {:>8s} {:>10s} {:>13s} {:>11s}".format(*heading))
    for name, total in totals.items():
        seconds, fraction = max(total.seconds), max(first.seconds) / max(total.seconds)
        rate, processor = 60 * count / seconds, total.processor / count
        print(f"{name:16s} {seconds:8.1f} {rate:10.1f} {fraction:13.3f} {processor:11.3f}")
    print(f"answers are {'the same bits' if same else 'NOT THE SAME'}")
    return same and max(first.seconds) >= LEAST * max(totals["plan_many"].seconds)


def costs() -> None:
    """Print what one plan costs beside planning."""
    for name in NAMES:
        _print_costs_of(name)
    with WorkerProcesses(2) as workers:
        print(f"a call of WorkerProcesses that does nothing: {_idle(workers)}")
    with cluster(2) as executor:
        print(f"a call through Dask that does nothing: {_idle(executor)}, scheduler included")
    print(f"a line of 1 kB in a journal, on the disk: {_journal():.2f} ms")


def _print_costs_of(name: str) -> None:
    spec, problem = ProblemSpec.read(name), problem_of(name, 0.9)
    parcel = Packer().pack(problem)
    answers = [_answer((each, OPTIONS)) for each in (spec, spec, parcel)]
    sizes = [len(pickle.dumps(answer)) for answer in answers]
    planning = answers[1][0].planning_time
    print(f"{name}: planned in {planning:.2f} s")
    print(
        f"  as its file holds it: {len(pickle.dumps(spec)) / 1e3:.1f} kB there, "
        f"{sizes[1] / 1e3:.0f} kB back; as a PlanningProblem "
        f"{len(pickle.dumps(parcel)) / 1e3:.0f} kB there, {sizes[2] / 1e3:.0f} kB back"
    )
    again = spec.changed({"tube.radius": "x0.9"})
    print(
        f"  loaded in {1e3 * answers[0][1]:.0f} ms, {_spent([again] * 20, ProblemSpec.load):.2f} "
        f"ms where its cell is known; changed in "
        f"{_spent([spec] * 20, lambda each: each.changed({'tube.radius': 'x0.9'})):.2f} ms; hash "
        f"{_spent([spec] * 20, lambda each: each.content_hash(OPTIONS)):.2f} ms; answer unpickled "
        f"in {_spent([pickle.dumps(answers[1])] * 20, pickle.loads):.2f} ms"
    )


def _spent(things: Iterable[Any], work: Callable[[Any], Any]) -> float:
    """Return the processor time of this process per thing [ms]."""
    things = list(things)
    begin = time.process_time()
    for thing in things:
        work(thing)
    return 1e3 * (time.process_time() - begin) / len(things)


def _idle(executor: Executor) -> str:
    """Return the time per call that does nothing, and the processor time of this process."""
    list(run_many(abs, range(20), executor))
    begin, processor = time.perf_counter(), time.process_time()
    list(run_many(abs, range(TASKS), executor))
    spent, worked = time.perf_counter() - begin, time.process_time() - processor
    return f"{1e3 * spent / TASKS:.2f} ms, {1e3 * worked / TASKS:.2f} ms of them here"


def _journal() -> float:
    """Return the time per line that is on the disk before the next one [ms]."""
    with tempfile.NamedTemporaryFile("w") as stream:
        begin = time.perf_counter()
        for _ in range(LINES):
            stream.write("x" * 1000 + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        return 1e3 * (time.perf_counter() - begin) / LINES


def main() -> int:
    """Print the tables asked for, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="points")
    parser.add_argument("--chunk", type=int, default=30, help="points before the next way's turn")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--without-dask", action="store_true")
    parser.add_argument("--costs", action="store_true", help="what one plan costs instead")
    asked = parser.parse_args()
    if asked.costs:
        costs()
        return 0
    keeps_up = beside_loops(asked.count, asked.chunk, asked.workers, not asked.without_dask)
    return 0 if keeps_up else 1


if __name__ == "__main__":
    sys.exit(main())
