"""Do the tests notice when a line that they run is wrong?

    python benchmarks/mutants.py --sample 150 --seed 1 [--folder geometry]
    python benchmarks/mutants.py --by-hand

Mutants are drawn from all changes that `mutant_operators.py` makes in lines that tests run, or
are those of `hand_mutants.py`. One at a time is put into a copy of the checkout, and the tests
that run its statement are run, cheapest first, until one fails: killed. A mutant that keeps them
busy for too long is noticed as well. Survivors are printed: each is a missing test, or no fault.

Which test runs which line is known from one run of all quick tests, `output/mutants`, which is
made where it is not; remove it once sources have changed. `--write` saves mutants, and `--read`
puts the same into another `--checkout`, by their function and their line, wherever that now is.
Exit status 1 if a test fails without any mutant, or if fewer than `--fail-under` are noticed.
"""

import argparse
import ast
import json
import math
import os
import random
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

from hand_mutants import HAND_MUTANTS
from mutant_copy import CRASH, TIMEOUT, Copy
from mutant_map import CoverageMap, bits_of, make_map
from mutant_operators import Fragment, Source

HERE = Path(__file__).resolve().parent.parent
BY_HAND = "by hand"
ANY = ""  # module of mutants by hand: functions may move
ONLY = -1


@dataclass(frozen=True)
class Mutant:
    """One wrong fragment of one function.

    Attributes:
        module: Path of its module below the package when it was drawn; `ANY`.
        line: Where it began then; 0: not known.
        operator: The kind of the change.
        where: Qualified name of the function.
        before: The fragment.
        after: What stands there instead.
        number: Which of the function's equal fragments it is; `ONLY`: there must be no other.
    """

    module: str
    line: int
    operator: str
    where: str
    before: str
    after: str
    number: int


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant: its place, the test that noticed it ("": none), and seconds."""

    mutant: Mutant
    place: str
    killer: str
    seconds: float

    def __str__(self) -> str:
        """Say it in a line."""
        is_test = self.killer not in ("", TIMEOUT, CRASH)
        state = "killed" if is_test else self.killer or "survived"
        by = f", by {self.killer}" if is_test else ""
        mutant = f"{self.mutant.operator} in {self.mutant.where}"
        return f"{state:8} {self.seconds:6.1f} s  {self.location} {mutant}{by}"


class Sources:
    """The modules of a package, by their paths below it."""

    def __init__(self, package: Path) -> None:
        paths = sorted(package.rglob("*.py"))
        self.modules = {p.relative_to(package).as_posix(): Source(p.read_text()) for p in paths}

    def place(self, mutant: Mutant) -> tuple[str, int]:
        """Return the module of a mutant's fragment, and its first character.

        Raises:
            ValueError: It is nowhere, or in several places.
        """
        places = []
        for module, source in self.modules.items():
            for begin, end in source.spans(mutant.where):
                at = list(_occurrences(source.text[begin:end], mutant.before))
                at = at if mutant.number == ONLY else at[mutant.number :][:1]
                places += [(module, begin + offset) for offset in at]
        places = [place for place in places if place[0] == mutant.module] or places
        if len(places) != 1:
            fragment = f"{mutant.where}: `{mutant.before}`"
            raise ValueError(f"{fragment}: the fragment is in {len(places)} places, not in one")
        return places[0]

    def mutated(self, mutant: Mutant) -> str:
        """Return the text of a mutant's module."""
        module, at = self.place(mutant)
        text = self.modules[module].text
        return text[:at] + mutant.after + text[at + len(mutant.before) :]

    def drawn(self, coverage: CoverageMap, folder: str, seed: int) -> Iterator[Mutant]:
        """Yield mutants of covered lines in a folder, each as likely as any other."""
        fragments = []
        for module, source in self.modules.items():
            if module.startswith(f"{folder}/" if folder else ""):
                covered = coverage.covered(module)
                own = [each for each in source.fragments() if bits_of(each.lines) & covered]
                fragments += [(module, fragment) for fragment in own]
        random.Random(seed).shuffle(fragments)
        for module, fragment in fragments:
            mutant = self._mutant(module, fragment)
            if _means_something_else(self.modules[module].text, self.mutated(mutant)):
                yield mutant

    def _mutant(self, module: str, fragment: Fragment) -> Mutant:
        source = self.modules[module]
        where, operator, at, before, after, _ = fragment
        begin, end = next(span for span in source.spans(where) if span[0] <= at < span[1])
        number = [*_occurrences(source.text[begin:end], before)].index(at - begin)
        return Mutant(module, source.line(at), operator, where, before, after, number)


def _occurrences(text: str, fragment: str) -> Iterator[int]:
    at = text.find(fragment)
    while at >= 0:
        yield at
        at = text.find(fragment, at + 1)


def _means_something_else(before: str, after: str) -> bool:
    try:
        return ast.dump(ast.parse(before)) != ast.dump(ast.parse(after))
    except SyntaxError:
        return False


class Run:
    """The tests of mutants, in copies of a checkout.

    Attributes:
        broken: Tests that fail without any mutant; they notice nothing.
    """

    def __init__(
        self, sources: Sources, coverage: CoverageMap, budget: float, time_limit: float
    ) -> None:
        self.broken: set[str] = set()
        self._passing: set[str] = set()
        self._sources, self._coverage = sources, coverage
        self._budget, self._time_limit = budget, time_limit

    def outcomes(
        self, mutants: list[Mutant], checkout: Path, processes: int, seconds: float = math.inf
    ) -> list[Outcome]:
        """Return the outcomes of the mutants begun within a budget [s]; each is printed at once."""
        copies: SimpleQueue[Copy] = SimpleQueue()
        deadline = time.monotonic() + seconds

        def outcome(mutant: Mutant) -> Outcome | None:
            copy, begin = copies.get(), time.perf_counter()
            if time.monotonic() > deadline:
                copies.put(copy)
                return None
            try:
                module, at = self._sources.place(mutant)
                killer = self._killer(copy, mutant, module, at)
            finally:
                copies.put(copy)
            place = f"{module}:{self._sources.modules[module].line(at)}"
            result = Outcome(mutant, place, killer, time.perf_counter() - begin)
            print(result, flush=True)
            return result

        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(processes) as pool:
            for number in range(processes):
                copies.put(Copy(Path(folder, str(number)), checkout))
            return [each for each in pool.map(outcome, mutants) if each is not None]

    def _killer(self, copy: Copy, mutant: Mutant, module: str, at: int) -> str:
        lines = self._sources.modules[module].statement(at)
        covering = self._coverage.tests(module, lines)
        while tests := self._coverage.within(covering - self.broken, self._budget):
            with copy.changed(module, self._sources.mutated(mutant)):
                killer = copy.failure(tests, self._limit(*tests))
            suspect = next((test for test in tests if killer and test.startswith(killer)), tests[0])
            if killer in ("", TIMEOUT) or self._passes(copy, suspect):
                return killer
        return ""

    def _passes(self, copy: Copy, test: str) -> bool:
        """Return whether a test passes without any mutant."""
        if test not in self._passing | self.broken:
            if copy.failure([test], self._limit(test)):
                print(f"{test} fails without any mutant:\n{copy.log}", flush=True)
                self.broken.add(test)
            else:
                self._passing.add(test)
        return test in self._passing

    def _limit(self, *tests: str) -> float:
        return self._time_limit + 3 * self._coverage.cost(*tests)


def report(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield the survivors with their lines, and how many of each operator are noticed."""
    for each in outcomes:
        if not each.killer:
            yield f"survived: {each.location} in {each.mutant.where} ({each.mutant.operator})"
            yield from (f"  - {line}" for line in each.mutant.before.splitlines())
            yield from (f"  + {line}" for line in each.mutant.after.splitlines())
    yield f"{'operator':20}{'mutants':>8}{'noticed':>8}{'survived':>9}"
    every = Counter(each.mutant.operator for each in outcomes)
    noticed = Counter(each.mutant.operator for each in outcomes if each.killer)
    for operator, count in sorted(every.items()):
        yield f"{operator:20}{count:8}{noticed[operator]:8}{count - noticed[operator]:9}"
    late = sum(each.killer == TIMEOUT for each in outcomes)
    fraction = f"{noticed.total()} of {len(outcomes)} mutants ({noticed_fraction(outcomes):.1%})"
    yield f"{fraction} are noticed, {late} of them by the time limit"


def noticed_fraction(outcomes: list[Outcome]) -> float:
    """Return the fraction of mutants that are noticed."""
    return sum(each.killer != "" for each in outcomes) / max(len(outcomes), 1)


def hand_mutants() -> list[Mutant]:
    """Return the mutants by hand."""
    return [
        Mutant(ANY, 0, BY_HAND, where, old, new, ONLY)
        for where, changes in HAND_MUTANTS.items()
        for old, new in changes
    ]


def _placed(sources: Sources, mutants: list[Mutant]) -> Iterator[Mutant]:
    """Yield the mutants of another checkout whose fragment is in this one; print the others."""
    for mutant in mutants:
        try:
            sources.place(mutant)
        except ValueError as error:
            print(f"left out: {error}")
        else:
            yield mutant


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, help="how many; 150, with --read all")
    parser.add_argument("--seed", type=int, default=0, help="of the drawing")
    parser.add_argument("--folder", default="", help="one of src/tubeplanner; else all")
    parser.add_argument("--by-hand", action="store_true", help="those of hand_mutants.py")
    parser.add_argument("--write", type=Path, help="write them to this file; run nothing")
    parser.add_argument("--read", type=Path, help="those that --write wrote")
    parser.add_argument("--checkout", type=Path, default=HERE, help="whose tests are run")
    parser.add_argument("--coverage", type=Path, help="its map of coverage")
    parser.add_argument("--processes", type=int, default=2, help="how many at a time")
    parser.add_argument("--budget", type=float, default=60.0, help="of a mutant's tests [s]")
    parser.add_argument(
        "--time-limit", type=float, default=30.0, help="and 3 times its tests [s, cpu]"
    )
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin none after these")
    parser.add_argument("--fail-under", type=float, default=0.0, help="least share noticed")
    return parser


def main() -> int:
    """Make the mutants and run their tests."""
    arguments = _parser().parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    checkout = arguments.checkout.resolve()
    coverage_file = arguments.coverage or checkout / "output" / "mutants" / "coverage.sqlite"
    if not coverage_file.exists():
        make_map(coverage_file, checkout, arguments.processes)
    sources, coverage = Sources(checkout / "src" / "tubeplanner"), CoverageMap(coverage_file)
    if arguments.by_hand:
        mutants = hand_mutants()
        for mutant in mutants:
            sources.place(mutant)
    elif arguments.read:
        rows = json.loads(arguments.read.read_text())[: arguments.sample]
        mutants = list(_placed(sources, [Mutant(**row) for row in rows]))
    else:
        draw = sources.drawn(coverage, arguments.folder, arguments.seed)
        mutants = list(islice(draw, arguments.sample or 150))
    if arguments.write:
        arguments.write.write_text(json.dumps([asdict(mutant) for mutant in mutants], indent=1))
        return 0
    run = Run(sources, coverage, arguments.budget, arguments.time_limit)
    outcomes = run.outcomes(mutants, checkout, arguments.processes, arguments.seconds)
    print(*report(outcomes), sep="\n")
    return int(bool(run.broken) or noticed_fraction(outcomes) < arguments.fail_under)


if __name__ == "__main__":
    raise SystemExit(main())
