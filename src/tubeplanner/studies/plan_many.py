"""Plan_many: problems and cycles on any executor, in order, packed for other processes."""

import hashlib
import io
import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic, perf_counter
from typing import Any, Generic, TypeAlias, TypeVar

from tubeplanner.checks import checked_options, require_executor
from tubeplanner.errors import OptionError, TubePlannerError, shown
from tubeplanner.geometry.collision_checker import CollisionScene
from tubeplanner.outcome import (
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    TimeLimitReached,
    require_callback,
)
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import CycleResult, PlanResult
from tubeplanner.planning.strategy import plan, plan_cycle
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- Many problems planned in processes of this machine, or by any executor.

Plannable: TypeAlias = PlanningProblem | Cycle | ProblemSpec | str | Path


@dataclass(frozen=True, eq=False)
class PlannedItem:
    """The plan of one of many problems.

    Attributes:
        index: Index of the problem.
        result: Result of planning; None where the problem is invalid, or its plan crashed.
        message: One sentence: the answer, or the reason for its absence.
        crashed: True if planning raised an unexpected exception, or its process died twice.
        loading_time: Time of reading the problem [s].
    """

    index: int
    result: PlanResult | CycleResult | None
    message: str
    crashed: bool = False
    loading_time: float = 0.0

    __repr__ = short_repr

    @property
    def status(self) -> PlanStatus:
        """Status of the plan; bad_input where the problem is invalid."""
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
        options: Planning options.
        executor: Any `concurrent.futures` executor, such as that of a Dask client; it stays open.
            None: as many `WorkerProcesses` as there are processors.

    Yields:
        The plan of each problem, in the order of completion. A problem that is invalid, raises or
        kills its process costs its own item alone.

    Raises:
        OptionError: Options or executor are invalid, problems are a single problem, or the executor
            broke.
        KeyboardInterrupt: Ctrl-C; processes of this machine are ended.
    """
    options = checked_options(options, PlanOptions)
    require_executor(executor)
    if not isinstance(problems, Iterable) or isinstance(problems, str | Path):
        raise OptionError(f"problems are {shown(problems)}; give a list or a generator of them")
    return _planned_many(problems, options, executor)


def plan_either(
    problem: PlanningProblem | Cycle, options: PlanOptions, progress: ProgressCallback | None = None
) -> PlanResult | CycleResult:
    """Plan a problem or a cycle, with the arguments and exceptions of `plan`."""
    if isinstance(problem, Cycle):
        return plan_cycle(problem, options, progress)
    return plan(problem, options, progress)


# Apart from `plan_many`, which checks its arguments before the first item is taken.
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
            problem = sent.pop(done.index)
            if done.value is None:
                reason = f"{type(done.error).__name__}: {done.error}"
                yield PlannedItem(done.index, None, reason, crashed=True)
                continue
            answer, seconds = done.value
            if isinstance(answer, bytes) and isinstance(problem, PlanningProblem):
                answer = read_reply(answer, problem)
            if isinstance(answer, str):
                yield PlannedItem(done.index, None, answer, loading_time=seconds)
            else:
                yield PlannedItem(done.index, answer, answer.message, loading_time=seconds)


def _packed(problem: Plannable, packer: "Packer") -> Any:
    if isinstance(problem, PlanningProblem):
        return packer.pack(problem)
    if isinstance(problem, str | Path):
        is_bundled = str(problem).startswith(EXAMPLE_PREFIX)
        return str(problem) if is_bundled else str(Path(problem).absolute())
    return problem


def _answer(call: tuple[Any, PlanOptions]) -> tuple[Any, float]:
    """Return the answer about a packed problem, or its fault, and the loading time [s]."""
    packed, options = call
    begin = perf_counter()
    try:
        problem = ProblemSpec.read(packed) if isinstance(packed, str) else packed
        if isinstance(problem, Parcel):
            problem = problem.unpacked()
        elif isinstance(problem, ProblemSpec):
            problem = problem.load()
        loading_time = perf_counter() - begin
        result = plan_either(problem, options)
    except TubePlannerError as error:
        return str(error), perf_counter() - begin
    if isinstance(packed, Parcel) and isinstance(problem, PlanningProblem):
        return reply(result, problem), loading_time
    return result, loading_time


# ---- Calls of one function with many items, by any executor.

_T = TypeVar("_T")
_R = TypeVar("_R")
# More would hold more in memory; fewer would leave some of a large cluster without work.
_SUBMITTED = 4000


@dataclass(frozen=True)
class Done(Generic[_R]):
    """The result of the call with one item.

    Attributes:
        index: Index of the item.
        value: The returned value; None if the call failed.
        error: The exception of the call or of its worker; None if the call returned.
    """

    index: int
    value: _R | None = None
    error: Exception | None = None


def run_many(
    work: Callable[[_T], _R],
    items: Iterable[_T],
    executor: Executor | None = None,
    until: float | None = None,
) -> Iterator[Done[_R]]:
    """Call a function with each item, and yield each result in the order of completion.

    Args:
        work: The function; it must be importable by name for executors that pickle.
        items: Its arguments; taken a few thousand at most ahead of the finished calls.
        executor: Executor of the calls, by `submit` alone; None: this process, one after the other.
        until: Time by `time.monotonic` after which no call of an executor is waited for; None:
            all are waited for.

    Raises:
        OptionError: The executor broke, or dropped items: unfinished calls are lost.
        TimeLimitReached: `until` has passed.
        KeyboardInterrupt: Ctrl-C; calls that have not begun are dropped.
    """
    if executor is None:
        for index, item in enumerate(items):
            try:
                result = Done(index, work(item))
            except Exception as error:
                result = Done(index, error=error)
            yield result
        return
    waiting: dict[Future[_R], int] = {}
    finished: SimpleQueue[Future[_R]] = SimpleQueue()
    numbered = enumerate(items)
    try:
        while True:
            if finished.empty() and len(waiting) < _SUBMITTED and (entry := next(numbered, None)):
                index, item = entry
                try:
                    future = executor.submit(work, item)
                except BrokenExecutor as error:
                    raise _broken(error) from error
                waiting[future] = index
                future.add_done_callback(finished.put)
            elif waiting:
                try:
                    future = finished.get(
                        timeout=None if until is None else max(until - monotonic(), 0.0)
                    )
                except Empty:
                    raise TimeLimitReached from None
                index = waiting.pop(future)
                try:
                    result = Done(index, future.result())
                except (BrokenExecutor, CancelledError) as error:
                    raise _broken(error) from error
                except Exception as error:
                    result = Done(index, error=error)
                yield result
            else:
                return
    finally:
        for future in waiting:
            future.cancel()


def _broken(error: BaseException) -> OptionError:
    return OptionError(
        f"the executor broke ({type(error).__name__}: {error}); WorkerProcesses goes on where a "
        "process dies, and so does a Dask cluster"
    )


_Row = TypeVar("_Row")


def swept_rows(
    work: Callable[..., _Row],
    items: Iterable[Any],
    label: Callable[[int], str],
    executor: Executor | None,
    progress: Callable[[object], None] | None,
) -> tuple[list[_Row], StoppedBy | None]:
    """Return the rows of a sweep in the order of the items, and "interrupt" after Ctrl-C.

    Args:
        work: Function from an item to its row; in this process it gets `progress`, by that name.
        items: The items.
        label: Function from the number of an item, from 1, to its name in messages.
        executor: Executor of the calls; None: this process, item by item.
        progress: Called with the stages in this process, or else with the number of finished items.

    Raises:
        OptionError: Executor or progress is invalid.
        KeyboardInterrupt: Ctrl-C before the first row.
        Exception: Any exception of `work`.
    """
    require_callback(progress)
    require_executor(executor)
    rows: dict[int, _Row] = {}
    stopped_by: StoppedBy | None = None
    report = progress or (lambda what: None)

    def work_here(item: Any) -> _Row:
        name = label(len(rows) + 1)
        return work(item, progress=lambda what: report(f"{name}: {what}"))

    try:
        for done in run_many(work_here if executor is None else work, items, executor):
            if done.error is not None:
                raise done.error
            assert done.value is not None
            rows[done.index] = done.value
            if executor is not None:
                report(f"{label(len(rows))}: done")
    except KeyboardInterrupt:
        if not rows:
            raise
        stopped_by = "interrupt"
    return [rows[index] for index in sorted(rows)], stopped_by


# ---- Parcels: problems and answers pickled for another process, without the scene they share.
#
# Most of a pickled problem is its robot and its collision geometry, which many problems have in
# common. They travel as a separate part, which a process that has it does not unpack again; an
# answer refers to them, and gets those of the sender.

_ROBOT, _SCENE = "robot", "scene"
_MAX_SCENES = 16
_scenes: dict[str, CollisionScene] = {}  # of parcels, by hash, the latest last


@dataclass(frozen=True)
class Parcel:
    """A pickled problem.

    Attributes:
        content: The problem, pickled with references to robot and scene.
        scene: Robot and scene, pickled.
        scene_hash: Hash of `scene`.
    """

    content: bytes
    scene: bytes
    scene_hash: str

    def unpacked(self) -> PlanningProblem:
        """Return the problem, with robot and scene of an earlier parcel of the same hash."""
        scene = _scenes.pop(self.scene_hash, None) or pickle.loads(self.scene)
        _scenes[self.scene_hash] = scene
        for oldest in list(_scenes)[:-_MAX_SCENES]:
            _scenes.pop(oldest, None)
        problem: PlanningProblem = _read(self.content, scene)
        return problem


class Packer:
    """A packer of problems, which pickles each scene once."""

    def __init__(self) -> None:
        self._packed: dict[int, tuple[CollisionScene, bytes, str]] = {}

    def pack(self, problem: PlanningProblem) -> Parcel:
        """Return the parcel of a problem."""
        scene = problem.scene
        packed = self._packed.get(id(scene))
        if packed is None:
            pickled = pickle.dumps(scene)
            packed = scene, pickled, hashlib.sha256(pickled).hexdigest()
            self._packed[id(scene)] = packed  # holds the scene, so that its id is not used again
        return Parcel(_pickled(problem, scene), *packed[1:])


def reply(answer: Any, problem: PlanningProblem) -> bytes:
    """Return an answer about a problem of a parcel, pickled."""
    return _pickled(answer, problem.scene)


def read_reply(packed: bytes, problem: PlanningProblem) -> Any:
    """Return the answer pickled by `reply`."""
    return _read(packed, problem.scene)


def _pickled(thing: Any, scene: CollisionScene) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream, scene).dump(thing)
    return stream.getvalue()


def _read(pickled: bytes, scene: CollisionScene) -> Any:
    return _Unpickler(io.BytesIO(pickled), scene).load()


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, scene: CollisionScene) -> None:
        super().__init__(stream)
        self._scene = scene

    def persistent_id(self, thing: Any) -> str | None:
        if thing is self._scene:
            return _SCENE
        return _ROBOT if thing is self._scene.robot else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, scene: CollisionScene) -> None:
        super().__init__(stream)
        self._scene = scene

    def persistent_load(self, name: str) -> Any:
        return {_SCENE: self._scene, _ROBOT: self._scene.robot}[name]
