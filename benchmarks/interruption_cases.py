"""The commands that `interruptions.py` interrupts: their words, their files, what is not computed.

What a command computes is kept from its first run and given back at once in later ones: `computed`
names the functions, and the writing stage begins when the last of them first returns.
"""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

PROBLEM = "example:two_link/around_a_post"
STUDY = f"""format: tubeplanner/study
study:
  problem: {PROBLEM}
  vary: {{tube.radius: [x0.5, x0.7, x0.9, x1]}}
  options: {{quality: fast, slack: 0}}
"""
CYCLE = """format: tubeplanner/cycle
robot: {urdf: "example:two_link", tool_frame: hand, gravity: [0, -3, 0]}
start: {seed: [0.0, -1.0]}
closed: true
moves:
  - {name: up, tube: {points: [[0.45, -0.3, 0], [0.45, 0.1, 0]], radius: 0.05}}
  - {event: gripper, set: close, dwell: 0.05}
  - {name: down, tube: {points: [[0.45, 0.1, 0], [0.45, -0.3, 0]], radius: 0.05}}
"""
SCENE = """world:
  collision_objects:
    - id: post
      primitives: [{type: box, dimensions: [0.05, 0.05, 0.4]}]
      primitive_poses: [{position: [0.2, 0.4, 0.0]}]
"""
BEAD = "G0 X0 Y0 Z0\nG1 X50 F3000\nG2 X100 Y50 R50\n"
MOTION, TRAIL = "motion.json", "trail.csv"  # what commands read
TEXTS = {
    "study.yaml": STUDY,
    "cycle.yaml": CYCLE,
    "scene.yaml": SCENE,
    "bead.gcode": BEAD,
}  # likewise
_EXECUTOR = "workers_of"  # of a command whose answers come from other processes


@dataclass(frozen=True)
class Case:
    """A command that writes files.

    Attributes:
        name: What the table calls it.
        words: Its arguments; {out} stands for the folder of its files, {inputs} for that of what it
            reads.
        files: The names of its files that are replaced whole.
        computed: Functions, as module:name.
        journal: The name of its journal, if it keeps one.
        late: The names of files of what is found last: an answer that Ctrl-C shortens lacks them.
    """

    name: str
    words: str
    files: tuple[str, ...]
    computed: tuple[str, ...]
    journal: str | None = None
    late: tuple[str, ...] = ()

    def arguments(self, inputs: Path, out: Path) -> list[str]:
        """Return its arguments."""
        return [word.format(inputs=inputs, out=out) for word in self.words.split()]


# Words, and names with spaces between; functions without the package's name.
_TABLE = """
plan: [plan PROBLEM ALL, a.json a.csv a.yaml a.png a.html, cli.plan:plan_problem]
plan cycle:
  - plan {inputs}/cycle.yaml ALL
  - a.json a.csv a.yaml a.png a.html
  - cli.plan:plan_cycle
view: [view PROBLEM MOTION HTML, a.html, cli.view:load_task_timed]
plot: [plot PROBLEM MOTION -o OUT/a.svg, a.svg, cli.view:load_task_timed]
info: [info PROBLEM PNG, a.png, cli.contents:problem_info]
simulate:
  - simulate PROBLEM MOTION --runs 3 PNG HTML
  - a.png a.html
  - cli.simulate:executed_cycle cli.simulate:judged_cycle
explain:
  - explain PROBLEM --quality fast --time-limit 4 --processes 1 HTML
  - a.html
  - cli.explain:search
study:
  - study {inputs}/study.yaml -o OUT/a.csv PNG --processes 1
  - a.csv a.png
  - studies.study:planned_answer
  - a.jsonl
sweep:
  - sweep PROBLEM --radius-scale 0.5,1 --quality fast -o OUT/a.csv --plot OUT/a.pdf
  - a.csv a.pdf
  - cli.sweep:sweep_problem
compare:
  - compare PROBLEM --methods refinement,bang-bang --quality fast -o OUT/a.json PNG
    --trajectories OUT/all
  - a.json a.png all/refinement.json all/bang-bang.json
  - studies.comparison:_row
measure: [measure PROBLEM -o OUT/a.yaml, a.yaml, cli.tubes:measure_tube]
place:
  - place PROBLEM --region=-0.02,0.02,0,0 --stands-on none --points 8 --quality fast --processes 1
    -o OUT/a.yaml PNG
  - a.yaml a.png
  - studies.placement:plan studies.placement:tried
  - a.jsonl
route:
  - route example:two_link/through_the_gap --edges 400 --samples 200 -o OUT/a.yaml
    --measured OUT/b.yaml
  - a.yaml b.yaml
  - cli.tubes:find_route
  - null
  - b.yaml
teach:
  - teach {inputs}/TRAIL --problem PROBLEM --samples 200 -o OUT/a.yaml
  - a.yaml
  - cli.tubes:teach_tube
import:
  - import {inputs}/scene.yaml --problem PROBLEM -o OUT/a.yaml
  - a.yaml
  - cli.imports:imported_problem
import nc:
  - import {inputs}/bead.gcode --urdf example:ur5 --tool-frame tool0 --frame 0.4,0,0.2 -o OUT/a.yaml
  - a.yaml
  - cli.imports:bead_problem
init: [init example:two_link -o OUT/a.yaml, a.yaml, cli.init:starter_problem]
reproduce:
  - reproduce -o OUT/all
  - all/the_paper.md all/figure_3.png all/figure_7.png all/figure_8.png all/figure_9.png
  - cli.reproduce:reproduce_tables
"""
_SHORT = {
    "ALL": "--quality fast -o OUT/a.json --csv OUT/a.csv --ros OUT/a.yaml PNG HTML",
    **{"PNG": "--plot OUT/a.png", "HTML": "--html OUT/a.html", "OUT": "{out}"},
    **{"PROBLEM": PROBLEM, "MOTION": f"{{inputs}}/{MOTION}", "TRAIL": TRAIL},
}


def _cases() -> Iterator[Case]:
    """Yield the cases of the table."""
    for name, (words, files, computed, *more) in yaml.safe_load(_TABLE).items():
        for short, long in _SHORT.items():
            words = words.replace(short, long)
        functions = tuple(f"tubeplanner.{function}" for function in computed.split())
        journal, late = (*more, None, None)[:2]
        yield Case(
            name, words, tuple(files.split()), functions, journal, tuple((late or "").split())
        )


CASES = tuple(_cases())


class Kept:
    """Functions whose answers of a first run are given back in later ones, at once."""

    def __init__(self, case: Case) -> None:
        """Keep no answer yet."""
        self._case = case
        self._answers: dict[str, list[Any]] = {name: [] for name in case.computed}

    @contextmanager
    def recorded(self) -> Iterator[None]:
        """Let the functions compute, and keep their answers."""

        def recording(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
            def call(*values: Any, **named: Any) -> Any:
                answer = real(*values, **named)
                self._answers[name].append(answer)
                return answer

            return call

        with self._replaced(recording):
            yield

    @property
    def count(self) -> int:
        """How often the last function is called."""
        return len(self._answers[self._case.computed[-1]])

    @contextmanager
    def given_back(self, called: Callable[[int], None]) -> Iterator[None]:
        """Let the functions return what is kept.

        Args:
            called: Is told of each call of the last one, by its number from 0.
        """

        def giving(name: str, _: Callable[..., Any]) -> Callable[..., Any]:
            answers = enumerate(self._answers[name])

            def call(*values: Any, **named: Any) -> Any:
                number, answer = next(answers)
                if name == self._case.computed[-1]:
                    called(number)
                return answer

            return call

        with self._replaced(giving):
            yield

    @contextmanager
    def _replaced(
        self, make: Callable[[str, Callable[..., Any]], Callable[..., Any]]
    ) -> Iterator[None]:
        real = []
        places = [(name, *name.split(":")) for name in self._case.computed]
        module = import_module("tubeplanner.cli.console") if self._case.journal else None
        try:
            for name, where, attribute in places:
                import_module(where)
                holder = sys.modules[where]  # a package may have a function of the module's name
                real.append((holder, attribute, getattr(holder, attribute)))
                setattr(holder, attribute, make(name, real[-1][2]))
            if module is not None:
                real.append((module, _EXECUTOR, getattr(module, _EXECUTOR)))
                setattr(module, _EXECUTOR, _here)
            yield
        finally:
            for holder, attribute, function in real:
                setattr(holder, attribute, function)


class _Here(Executor):
    """Calls in this process, when they are sent."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Call a function."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def _here(*_: object) -> Iterator[Executor]:
    yield _Here()
