"""Why a problem cannot be solved, and which single changes help; or how much room there is."""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arguments import given_options, require_executor
from tubeplanner.errors import ProblemError
from tubeplanner.explanation.cell_changes import cell_changes
from tubeplanner.explanation.change import Change
from tubeplanner.explanation.end_changes import end_changes
from tubeplanner.explanation.explanation import Explanation
from tubeplanner.explanation.limit_changes import limit_changes
from tubeplanner.explanation.question import Question
from tubeplanner.explanation.relevance import in_order
from tubeplanner.explanation.remedy_search import RemedySearch
from tubeplanner.explanation.room_search import RoomSearch, worsening_changes
from tubeplanner.explanation.trials import Trials
from tubeplanner.explanation.tube_changes import tube_changes
from tubeplanner.explanation.unposed import Unposed
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.options import require_between
from tubeplanner.outcome import Place
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.planner import plan
from tubeplanner.progress import PlanningClock, ProgressCallback, StoppedBy, until_stopped

TIME_LIMIT = 60.0  # [s]
_FIRST_PLAN = 0.5  # the share of the time that the plan of the problem itself may take


def explain(
    problem: str | Path,
    *,
    changes: Mapping[str, Any] | None = None,
    options: PlanOptions | None = None,
    time_limit: float = TIME_LIMIT,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> Explanation:
    """Find out what makes a problem impossible, or how far it is from being so.

    Of a problem that cannot be solved, single changes that make it possible are looked for: wider
    tolerances, other joint signs, more effort, wider ranges of joints, a lighter payload, moved
    obstacles, reference points, starts and goals, smaller clearances. Each is planned with and
    narrowed down to 5 %. Of a problem that can be solved, single quantities are made worse until
    nothing is found any more.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        changes: Of fields of the problem, by path, as for `load_problem`; made first.
        options: How to plan; changes are planned with for the shortest motion, quality "fast".
        time_limit: After how long the search ends with what it has [s].
        executor: Processes of this machine that try changes side by side, such as
            `WorkerProcesses`; None: this process, one after the other. Answers are the same.
        progress: Called with what is tried.

    Returns:
        What was found. After Ctrl-C, what was found until then. Without the time limit's passing it
        depends on no clock but for plans that take a tenth of that time: they count as failed.

    Raises:
        ProblemError: The file cannot be read or contradicts its format, or has no tube.
        RobotError: The robot cannot be planned with.
        OptionError: An option is outside its range.
        KeyboardInterrupt: Ctrl-C before anything was known of the problem.
    """
    options = replace(given_options(options, PlanOptions), time_limit=time_limit)
    require_between(options, 0, None, "time_limit", unit="s")
    require_executor(executor)
    first = replace(options, time_limit=_FIRST_PLAN * time_limit)
    clock = PlanningClock(time_limit, progress)
    posed = PosedProblem.read(problem).changed(changes)
    question = Question.of(posed)
    try:
        loaded = question.load()
    except ProblemError as error:
        known = Explanation(posed.name, None, None, Unposed.of(question, error))
    else:
        known = Explanation(posed.name, loaded, plan(loaded, first, progress), None)
    if known.result is not None and known.result.stopped_by == "interrupt":
        return replace(known, stopped_by="interrupt")
    trials = Trials(question, options, clock, executor)
    return (_with_room if known.is_possible else _with_remedies)(known, question, trials)


def _with_remedies(known: Explanation, question: Question, trials: Trials) -> Explanation:
    tiers = in_order(_changes(question), known.status, _with_segment(known.place, question))
    search = RemedySearch(trials, tiers)
    stopped_by = _run(search)
    return replace(
        known,
        remedies=search.remedies,
        in_vain=search.in_vain,
        tried=trials.count,
        stopped_by=stopped_by,
    )


def _with_segment(place: Place, question: Question) -> Place:
    """Return a place with the segment that the tool is nearest to, if it is known where that is."""
    if place.position is None or place.segment is not None:
        return place
    return replace(place, segment=question.segment_near(np.array(place.position)))


def _with_room(known: Explanation, question: Question, trials: Trials) -> Explanation:
    search = RoomSearch(trials, worsening_changes(question))
    stopped_by = _run(search)
    return replace(known, rooms=search.rooms, tried=trials.count, stopped_by=stopped_by)


def _run(search: RemedySearch | RoomSearch) -> StoppedBy | None:
    """Search until it is done, the time has passed or Ctrl-C; return what stopped it."""
    return until_stopped(search.run)[1]


def _changes(question: Question) -> Iterator[Change]:
    yield from tube_changes(question)
    yield from limit_changes(question)
    yield from cell_changes(question)
    yield from end_changes(question)
