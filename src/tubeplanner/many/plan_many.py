"""Many problems planned at once: in processes of this machine, or by any executor."""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

from tubeplanner.arguments import given_options, require_executor
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle_planning.cycle_result import CycleResult
from tubeplanner.errors import OptionError, TubePlannerError, shown
from tubeplanner.many.parcel import Packer, Parcel, read_reply, reply
from tubeplanner.many.plan_either import plan_either
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.many.run_many import Done, run_many
from tubeplanner.many.worker_processes import WorkerProcesses
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.short_repr import short_repr

Plannable: TypeAlias = PlanningProblem | Cycle | PosedProblem | str | Path


@dataclass(frozen=True, eq=False)
class PlannedItem:
    """What came of one of many problems.

    Attributes:
        index: Which of them, from 0.
        result: Of planning; None where the problem cannot be posed, or its plan crashed.
        message: One sentence: the answer, or why there is none.
        crashed: Whether planning raised what it must not, or its process died, twice.
        loading_time: How long reading the problem took [s].
    """

    index: int
    result: PlanResult | CycleResult | None
    message: str
    crashed: bool = False
    loading_time: float = 0.0

    __repr__ = short_repr

    @property
    def status(self) -> PlanStatus:
        """How planning ended; bad_input where the problem cannot be posed."""
        if self.result is not None:
            return self.result.status
        return PlanStatus.CRASHED if self.crashed else PlanStatus.BAD_INPUT

    @property
    def duration(self) -> float | None:
        """Duration of the certified motion [s]; None if there is none."""
        return None if self.result is None else self.result.duration


def plan_many(
    problems: Iterable[Plannable],
    options: PlanOptions | None = None,
    executor: Executor | None = None,
) -> Iterator[PlannedItem]:
    """Plan many problems; each is planned as by `plan` or `plan_cycle` alone.

    Answers are those of one thread for linear algebra: worker processes have one, and so have
    Dask's; those of `plan` are the same bits where it has one (OPENBLAS_NUM_THREADS=1) on the same
    type of machine.

    Args:
        problems: Problems, cycles, or names of their files, which are read where they are planned.
            They are taken as needed: a generator may make a million.
        options: How to plan.
        executor: Any `concurrent.futures` executor, such as that of a Dask client; it stays open.
            None: as many `WorkerProcesses` as there are processors.

    Yields:
        What came of each, as it comes. A problem that cannot be posed, raises or kills its process
        costs its own item alone.

    Raises:
        OptionError: Options or executor are none, problems come one alone, or the executor broke.
        KeyboardInterrupt: Ctrl-C; processes of this machine are ended.
    """
    options = given_options(options, PlanOptions)
    require_executor(executor)
    if not isinstance(problems, Iterable) or isinstance(problems, str | Path):
        raise OptionError(f"problems are {shown(problems)}; give a list or a generator of them")
    return _planned_many(problems, options, executor)


def _planned_many(
    problems: Iterable[Plannable], options: PlanOptions, executor: Executor | None
) -> Iterator[PlannedItem]:
    sent: dict[int, Plannable] = {}

    def calls() -> Iterator[tuple[Any, PlanOptions]]:
        packer = Packer()
        for index, problem in enumerate(problems):
            sent[index] = problem
            yield _packed(problem, packer), options

    with WorkerProcesses() if executor is None else nullcontext(executor) as workers:
        for done in run_many(_answer, calls(), workers):
            yield _item(done, sent.pop(done.index))


def _packed(problem: Plannable, packer: Packer) -> Any:
    if isinstance(problem, PlanningProblem):
        return packer.pack(problem)
    if isinstance(problem, str | Path):
        is_bundled = str(problem).startswith(EXAMPLE_PREFIX)
        return str(problem) if is_bundled else str(Path(problem).absolute())
    return problem


def _answer(call: tuple[Any, PlanOptions]) -> tuple[Any, float]:
    """Return the answer about a packed problem, or what is wrong with it, and the loading time."""
    packed, options = call
    begin = perf_counter()
    try:
        problem = _loaded(packed)
        loading_time = perf_counter() - begin
        result = plan_either(problem, options)
    except TubePlannerError as error:
        return str(error), perf_counter() - begin
    if isinstance(packed, Parcel) and isinstance(problem, PlanningProblem):
        return reply(result, problem), loading_time
    return result, loading_time


def _loaded(packed: Any) -> PlanningProblem | Cycle:
    if isinstance(packed, Parcel):
        return packed.unpacked()
    if isinstance(packed, str):
        packed = PosedProblem.read(packed)
    if isinstance(packed, PosedProblem):
        return packed.load()
    return packed


def _item(done: Done[tuple[Any, float]], problem: Plannable) -> PlannedItem:
    if done.value is None:
        error = done.error
        return PlannedItem(done.index, None, f"{type(error).__name__}: {error}", crashed=True)
    answer, loading_time = done.value
    if isinstance(answer, bytes) and isinstance(problem, PlanningProblem):
        answer = read_reply(answer, problem)
    if isinstance(answer, str):
        return PlannedItem(done.index, None, answer, loading_time=loading_time)
    return PlannedItem(done.index, answer, answer.message, loading_time=loading_time)
