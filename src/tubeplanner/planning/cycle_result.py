"""CycleResult: plans of the legs, sensitivities per move."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.verification import CycleCertificate
from tubeplanner.errors import FormerName
from tubeplanner.native.library import LIBRARY
from tubeplanner.outcome import Location, PlanStatus, StoppedBy
from tubeplanner.planning.result import PlanResult
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import CycleMotion, move_rows
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import in_milliseconds


@dataclass(frozen=True, eq=False)
class LegPlan:
    """The plan of one leg of a cycle.

    Attributes:
        problem: The leg's problem.
        result: The certified answer, the shortest or the written motion.
    """

    problem: PlanningProblem
    result: PlanResult

    @property
    def duration(self) -> float:
        """Duration of the answer [s]."""
        assert self.result.duration is not None
        return self.result.duration

    @property
    def begin(self) -> FloatArray:
        """First configuration, shape (n,) [rad or m]."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(0.0)

    @property
    def end(self) -> FloatArray:
        """Last configuration, shape (n,) [rad or m]."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(self.result.trajectory.duration)

    def between(self, problem: PlanningProblem) -> "LegPlan":
        """Return the plan as a plan of a problem whose given ends are the plan's."""
        motion = self.result.motion
        if motion is not None and not motion.is_smoother:
            motion = replace(motion, problem=problem.joined)
        return LegPlan(problem, replace(self.result, motion=motion))


class BlockedLeg(Exception):
    """A leg has no answer.

    Attributes:
        leg: The leg's index.
        result: The refusal.
    """

    def __init__(self, leg: int, result: PlanResult) -> None:
        super().__init__(result.message)
        self.leg, self.result = leg, result


@dataclass(frozen=True, eq=False)
class CycleResult:
    """The result of planning a cycle: a certified motion of all moves, or the reason without it.

    Attributes:
        status: Success means that the certificate passed.
        message: One sentence: the answer, or the reason without an answer.
        location: Place of that reason, with the move.
        method: As of a `PlanResult`.
        motion: The answer; None unless successful.
        certificate: Certificate of the answer, or of a failed attempt; None without an attempt.
        legs: The plan of every leg of the answer.
        greedy_duration: Duration of the moves planned alone, each from the end of the last one,
            dwells included [s]; None if that led nowhere.
        planning_time: Wall time from the loaded cycle to the certified result [s].
        certificate_time: Part of the planning time for the answer's certificate [s].
        stopped_by: "time_limit" or "interrupt" if planning was stopped early; None otherwise.
        sensitivities: Cost of every limit over the cycle, largest first; limits of segments name
            their move.
        notes: Further information about the answer.
        proved: As of a `PlanResult`.
        starts_tried: As of a `PlanResult`.
    """

    status: PlanStatus
    message: str
    location: Location
    method: str
    motion: CycleMotion | None = None
    certificate: CycleCertificate | None = None
    legs: tuple[LegPlan, ...] = ()
    greedy_duration: float | None = None
    planning_time: float = 0.0
    certificate_time: float = 0.0
    stopped_by: StoppedBy | None = None
    sensitivities: tuple["CycleSensitivity", ...] = ()
    notes: tuple[str, ...] = ()
    proved: bool | None = None
    starts_tried: int | None = None

    place = FormerName("location")

    def __repr__(self) -> str:
        return f"<CycleResult {self.status.value} by {self.method}: {self.message[:200]}>"

    @property
    def succeeded(self) -> bool:
        """True if there is a certified motion."""
        return self.status is PlanStatus.SUCCESS

    @property
    def duration(self) -> float | None:
        """Duration of the cycle, dwells included [s]; None without a motion."""
        return None if self.motion is None else self.motion.trajectory.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration by the shortest motions, dwells included [s]; None without a motion."""
        if self.duration is None:
            return None
        excess = [leg.duration - (leg.result.shortest_duration or 0.0) for leg in self.legs]
        return self.duration - sum(excess)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        motion = self.motion
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "proved": self.proved,
            "starts_tried": self.starts_tried,
            "duration": self.duration,
            "shortest_duration": self.shortest_duration,
            "greedy_duration": self.greedy_duration,
            "phase1_duration": None,
            "planning_time": self.planning_time,
            "certificate_time": self.certificate_time,
            "stopped_by": self.stopped_by,
            "method": self.method,
            "build": LIBRARY.build,
            "moves": [] if motion is None else move_rows(motion),
            "marks": [] if motion is None else [mark.as_dict() for mark in motion.marks],
            "notes": list(self.notes),
            "sensitivities": [asdict(each) for each in self.sensitivities],
            "certificate": None if self.certificate is None else self.certificate.as_dict(),
        }


@dataclass(frozen=True)
class CycleSensitivity:
    """The cost of one limit over a cycle, with the ends of all moves fixed.

    Attributes:
        limit: As of a `Sensitivity`.
        joint: As of a `Sensitivity`.
        move: The move of a tolerance; None for limits of joints, which count in all moves.
        segment: The segment of that move, or the first of joined ones; None for others.
        saved: Time saved by 10 % more [s], to first order.
        last_segment: The last of joined segments; None for others.
    """

    limit: str
    joint: str | None
    move: str | None
    segment: int | None
    saved: float
    last_segment: int | None = None

    def __str__(self) -> str:
        location = self.joint or f"move '{self.move}'"
        if self.last_segment not in (None, self.segment):
            location = f"segments {self.segment} to {self.last_segment} of {location}"
        elif self.segment is not None:
            location = f"segment {self.segment} of {location}"
        return f"{self.limit} of {location}: {in_milliseconds(self.saved)}"


def cycle_sensitivities(cycle: Cycle, plans: Sequence[LegPlan]) -> tuple[CycleSensitivity, ...]:
    """Return the costs of all limits over a cycle, largest first: sums over its moves."""
    saved: dict[tuple[str, str | None, str | None, int | None, int | None], float] = {}
    for leg, plan in zip(cycle.legs, plans, strict=True):
        for each in plan.result.sensitivities:
            if each.joint is not None:  # a limit of all moves
                location: tuple[str | None, int | None, int | None] = None, None, None
            elif each.segment is None:
                location = leg.name, None, None
            else:
                move, first, last = leg.segments_of_move(each.segment, each.last_segment)
                location = move.name, first, last
            key = (each.limit, each.joint, *location)
            saved[key] = saved.get(key, 0.0) + each.saved
    sums = [CycleSensitivity(*key[:4], value, key[4]) for key, value in saved.items()]
    return tuple(sorted(sums, key=lambda each: -each.saved))
