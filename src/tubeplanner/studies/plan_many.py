"""Plan_many: problems and cycles on any executor, in order, packed for other processes."""

import hashlib
import io
import pickle
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

from tubeplanner.checks import checked_options, require_executor
from tubeplanner.errors import OptionError, TubePlannerError, shown
from tubeplanner.geometry.collision_checker import CollisionScene
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import CycleResult, PlanResult
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import Row, plan_task, run_many
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- Many problems planned in processes of this machine, or by any executor.

Plannable: TypeAlias = PlanningProblem | Cycle | ProblemSpec | str | Path


@dataclass(frozen=True, eq=False)
class PlannedItem(Row):
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
        result = plan_task(problem, options)
    except TubePlannerError as error:
        return str(error), perf_counter() - begin
    if isinstance(packed, Parcel) and isinstance(problem, PlanningProblem):
        return reply(result, problem), loading_time
    return result, loading_time


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
    """A pickled problem."""

    content: bytes  # the problem, pickled with references to robot and scene
    scene: bytes  # robot and scene, pickled
    scene_hash: str  # hash of `scene`

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
