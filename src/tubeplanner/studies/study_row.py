"""One point of a study as its table has it, made where it is planned, so that little travels."""

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from tubeplanner.cycle_planning.cycle_result import CycleResult
from tubeplanner.errors import TubePlannerError
from tubeplanner.many.plan_either import plan_either
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.answer_fields import require_fields
from tubeplanner.studies.json_values import json_value
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_HASH_DIGITS = 16


@dataclass(frozen=True, eq=False)
class StudyRow:
    """One point of a study, and what became of it.

    Attributes:
        point: Which one, from 0.
        values: By field path.
        status: How planning ended; bad_input where the problem cannot be posed, crashed where its
            process died or the program failed.
        duration: Of the certified motion [s]; None if there is none.
        shortest_duration: Of the shortest certified motion that was found [s]; likewise.
        planning_time: Wall time from the loaded problem to the certified result [s]; None where
            nothing was planned.
        loading_time: Wall time of reading the problem [s]; None if that did not come to an end.
        runs: How many runs were simulated; None unless robustness asks for it.
        runs_failed: How many of them failed.
        method: As of a `PlanResult`; None where nothing was planned.
        message: One sentence: the answer, or why there is none.
        where: In what place, if there is no answer.
        notes: What else is worth knowing about the answer.
        trajectory_hash: Of the motion's breakpoints and coefficients, bit by bit; None if there is
            none.
        key: Of what the point is: the contents of all its files, options, program; None if its
            values cannot be set together.
    """

    point: int
    values: Mapping[str, Any]
    status: PlanStatus
    duration: float | None = None
    shortest_duration: float | None = None
    planning_time: float | None = None
    loading_time: float | None = None
    runs: int | None = None
    runs_failed: int | None = None
    method: str | None = None
    message: str = ""
    where: Place = field(default_factory=Place)
    notes: tuple[str, ...] = ()
    trajectory_hash: str | None = None
    key: str | None = None

    __repr__ = short_repr

    @classmethod
    def of(
        cls, point: int, values: Mapping[str, Any], key: str | None, answer: Mapping[str, Any]
    ) -> "StudyRow":
        """Return the row of an answer.

        Args:
            point: Which one.
            values: By field path.
            key: Of what the point is.
            answer: The other fields, as JSON values.

        Raises:
            ValueError: The answer has other fields, or values of other types.
            TypeError: Likewise, its place.
        """
        require_fields(cls, {"point": point, "values": {}, **answer})
        place: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in answer["where"].items()
        }
        converted: dict[str, Any] = {
            "status": PlanStatus(answer["status"]),
            "where": Place(**place),
            "notes": tuple(answer["notes"]),
        }
        return cls(point, values, key=key, **{**answer, **converted})

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        plain = {each.name: getattr(self, each.name) for each in fields(self)}
        return {
            **plain,
            "values": json_value(self.values),
            "status": str(self.status),
            "where": self.where.as_dict(),
            "notes": list(self.notes),
        }


def planned_answer(posed: PosedProblem, options: PlanOptions) -> dict[str, Any]:
    """Plan a problem or a cycle, and return its row as JSON values, without point and values.

    Args:
        posed: Which one.
        options: How.

    Raises:
        KeyboardInterrupt: Ctrl-C, also where there was something certified already.
    """
    begin = time.perf_counter()
    loading_time = None
    try:
        loaded = posed.load()
        loading_time = time.perf_counter() - begin
        result = plan_either(loaded, options)
    except TubePlannerError as error:
        reason = str(error).removeprefix(f"{posed.name}: ")
        return {**refused_answer(reason), "loading_time": loading_time}
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    return {**_of_result(result), "loading_time": loading_time}


def refused_answer(reason: str) -> dict[str, Any]:
    """Return the answer of a point that cannot be posed, as JSON values."""
    return _without_plan(PlanStatus.BAD_INPUT, reason)


def crashed_answer(error: Exception) -> dict[str, Any]:
    """Return the answer of a point whose process died, or at which the program failed."""
    return _without_plan(PlanStatus.CRASHED, f"{type(error).__name__}: {error}")


def _without_plan(status: PlanStatus, message: str) -> dict[str, Any]:
    return {"status": str(status), "message": message, "where": Place().as_dict(), "notes": []}


def _of_result(result: PlanResult | CycleResult) -> dict[str, Any]:
    survival = result.survival if isinstance(result, PlanResult) else None
    verdict = None if survival is None else survival.verdict
    return {
        "status": str(result.status),
        "message": result.message,
        "where": result.place.as_dict(),
        "duration": result.duration,
        "shortest_duration": result.shortest_duration,
        "method": result.method,
        "planning_time": result.planning_time,
        "runs": None if verdict is None else verdict.runs,
        "runs_failed": None if verdict is None else verdict.failed,
        "notes": list(result.notes),
        "trajectory_hash": _hash_of(result),
    }


def _hash_of(result: PlanResult | CycleResult) -> str | None:
    """Return a hash of every bit of a motion: the same only if it is the same motion."""
    trajectory: JointTrajectory | None
    if isinstance(result, PlanResult):
        trajectory = result.trajectory
    else:
        trajectory = None if result.motion is None else result.motion.trajectory
    if trajectory is None:
        return None
    parts = (trajectory.breakpoints, trajectory.coefficients)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:_HASH_DIGITS]
