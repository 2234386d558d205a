"""PlanResult: certified, refused or stopped; proof or search behind a refusal."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import refusal
from tubeplanner.certificate.verification import Certificate
from tubeplanner.certificate.verification import quick_certificate as verify
from tubeplanner.errors import FormerName
from tubeplanner.first_guess.branch_and_bound import SearchStatistics
from tubeplanner.first_guess.suh_bishop import PhaseTwoStatistics
from tubeplanner.limits.peaks import TrajectoryPeaks, peaks_as_dict, trajectory_peaks
from tubeplanner.limits.speed_limits import unused_speed
from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, StoppedBy
from tubeplanner.planning.notes import contact_notes, path_minimum
from tubeplanner.planning.tightening import Survival
from tubeplanner.robot.notes import robot_notes, unlimited_notes
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_MAX_MESSAGE = 200  # [characters] in the representation
# The message names reference points at more than this distance from the tool's path.
_FAR_IN_RADII = 3.0
_SAMPLES_PER_PIECE = 20
# A larger unused fraction of the speed gets a note.
_MAX_UNUSED = 0.02


def _no_trajectory() -> None:
    return None


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The result of planning: a certified trajectory, or the reason why there is none.

    Attributes:
        status: Success means that the certificate passed.
        message: One sentence: the answer, or the reason without an answer.
        location: Place of that reason.
        method: The method of the answer: one of `METHODS`.
        trajectory: The answer; None unless successful.
        certificate: Certificate of the answer, or of the best attempt; None without an attempt.
        planning_time: Wall time from the loaded problem to the certified result [s].
        certificate_time: Part of the planning time for the answer's certificate [s].
        search: Statistics of branch and bound; None if it did not run.
        phase_two: Statistics of phase 2 of "suh-bishop"; None if it did not run.
        stopped_by: "time_limit" or "interrupt" if planning was stopped early; None otherwise.
        notes: Further information about the answer.
        sensitivities: Cost of every limit, largest first; empty unless the answer is refinement's.
        motion: Start of `Planner.replan`; None unless the answer is refinement's.
        shortest: The shortest certified trajectory, if the answer is another one that takes a
            little longer; None if the answer is the shortest.
        survival: Survival of the answer in simulation; None unless field robustness asks for it.
        proved: True if it is proved that there is no answer; False if no answer was found; None if
            there is an answer, or planning was stopped.
        starts_tried: Number of configurations or branches from which the search failed; None
            unless `proved` is False.
        configuration: Configuration of the arm at the place, shape (n,) [rad or m]; None if not
            known.
        path_minimum: The least time [s] in which motors that switch at once could run the answer's
            path; with viscous friction or torque-speed lines an upper bound on it. Computed on
            first use; None without an answer.
        peaks: The answer's largest joint acceleration, tool speed and tool acceleration. Computed
            on first use; None without an answer.
    """

    status: PlanStatus
    message: str
    location: Location
    method: str
    trajectory: JointTrajectory | None = None
    certificate: Certificate | None = None
    planning_time: float = 0.0
    certificate_time: float = 0.0
    search: SearchStatistics | None = None
    phase_two: PhaseTwoStatistics | None = None
    stopped_by: StoppedBy | None = None
    notes: tuple[str, ...] = ()
    sensitivities: tuple[Sensitivity, ...] = ()
    motion: RefinedMotion | None = None
    shortest: JointTrajectory | None = None
    survival: Survival | None = None
    proved: bool | None = None
    starts_tried: int | None = None
    configuration: FloatArray | None = None
    _path_minimum: Callable[[], float | None] = _no_trajectory
    _peaks: Callable[[], TrajectoryPeaks | None] = _no_trajectory

    place = FormerName("location")

    def __repr__(self) -> str:
        return f"<PlanResult {self.status.value} by {self.method}: {self.message[:_MAX_MESSAGE]}>"

    @cached_property
    def path_minimum(self) -> float | None:
        """Least time for the answer's path [s], if motors switch instantly."""
        return self._path_minimum()

    @cached_property
    def peaks(self) -> TrajectoryPeaks | None:
        """Largest joint acceleration, tool speed and tool acceleration of the answer."""
        return self._peaks()

    @property
    def succeeded(self) -> bool:
        """True if there is a certified trajectory."""
        return self.status is PlanStatus.SUCCESS

    @property
    def duration(self) -> float | None:
        """Duration of the trajectory [s], None without a trajectory."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration of the shortest certified trajectory [s], None without a trajectory."""
        return self.duration if self.shortest is None else self.shortest.duration

    @property
    def phase1_duration(self) -> float | None:
        """Duration of branch and bound's trajectory [s], None if no faster."""
        return None if self.search is None else self.search.best_duration

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time and path_minimum."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "proved": self.proved,
            "starts_tried": self.starts_tried,
            "duration": self.duration,
            "shortest_duration": self.shortest_duration,
            "phase1_duration": self.phase1_duration,
            "planning_time": self.planning_time,
            "certificate_time": self.certificate_time,
            "stopped_by": self.stopped_by,
            **peaks_as_dict(self.peaks),
            "method": self.method,
            "build": LIBRARY.build,
            "notes": list(self.notes),
            "sensitivities": [asdict(sensitivity) for sensitivity in self.sensitivities],
            "search": None if self.search is None else self.search.as_dict(),
            "phase_two": None if self.phase_two is None else self.phase_two.as_dict(),
            "certificate": None if self.certificate is None else self.certificate.as_dict(),
            "robustness": None if self.survival is None else self.survival.as_dict(),
        }


def refused_result(reason: Infeasible, method: str) -> PlanResult:
    """Return the result of a refusal."""
    return PlanResult(
        reason.status,
        str(reason),
        reason.location,
        method,
        proved=reason.proved,
        starts_tried=None if reason.proved else reason.starts,
        configuration=reason.configuration,
    )


def stopped_result(clock: PlanningClock, stopped_by: StoppedBy, method: str) -> PlanResult:
    """Return the result of a method that was stopped before its first trajectory."""
    if stopped_by == "interrupt":
        status, message = PlanStatus.INTERRUPTED, "interrupted before anything was certified"
    else:
        status, message = PlanStatus.TIME_LIMIT, clock.past_limit
    return PlanResult(status, message, Location(), method, stopped_by=stopped_by)


def certified_result(
    problem: PlanningProblem, trajectory: JointTrajectory, method: str, clock: PlanningClock
) -> PlanResult:
    """Return the result of a method's trajectory: success if its certificate passes."""
    begin = clock.elapsed
    certificate = verify(problem, trajectory)
    return judged_result(problem, trajectory, certificate, clock.elapsed - begin, method)


def judged_result(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    certificate: Certificate,
    certificate_time: float,
    method: str,
) -> PlanResult:
    """Return the result of a method's trajectory with its certificate, passed or not."""
    reason = refusal(problem, certificate)
    if reason is not None:
        if reason.location.time is not None:
            q = trajectory.position(reason.location.time)
            location = reason.location.at(problem.robot.tool_position(q[None])[0])
            reason = reason.replaced(configuration=q, location=location)
        refused = refused_result(reason, method)
        return replace(refused, certificate=certificate, certificate_time=certificate_time)
    message = _success_message(problem, trajectory)
    notes = []
    unused = unused_speed(problem, trajectory)
    if unused > _MAX_UNUSED:
        notes.append(
            f"{unused:.1%} of the speed that the limits allow is unused on average: a faster "
            "trajectory may exist; --quality best searches from more starts"
        )
    robot = problem.robot
    on_robot = (*unlimited_notes(robot), *robot_notes(robot))
    notes += [*contact_notes(problem, trajectory), *on_robot]
    return PlanResult(
        PlanStatus.SUCCESS,
        message,
        Location(),
        method,
        trajectory,
        certificate,
        certificate_time=certificate_time,
        notes=tuple(notes),
        _path_minimum=partial(path_minimum, problem, trajectory),
        _peaks=partial(trajectory_peaks, problem.robot, trajectory),
    )


def _success_message(problem: PlanningProblem, trajectory: JointTrajectory) -> str:
    """Return the message about a certified trajectory."""
    message = f"certified trajectory of {trajectory.duration:.4f} s"
    if (region := problem.open_goal) is not None:
        last = trajectory.position(trajectory.duration)
        q = ", ".join(f"{value:.4f}" for value in last)
        if region.tolerance > 0:
            away = region.distance(problem.robot.tool_position(last[None])[0])
            message += f"; the tool ends {1000 * away:.3g} mm from the goal's position"
        message += f"; the goal was left open and became [{q}]"
    reach = _FAR_IN_RADII * (problem.tube.reach.max() + problem.tube.tool_radius)
    for count in (2, _SAMPLES_PER_PIECE):  # as a rule, 2 samples show that no point is far
        tool = problem.robot.tool_position(trajectory.per_piece(count).position)
        distances = [np.linalg.norm(tool - point, axis=1).min() for point in problem.tube.points]
        far = np.flatnonzero(np.array(distances) > reach)
        if len(far) == 0:
            return message
    return message + "".join(
        f"; it passes reference point {problem.tube.numbers[point]} at {distances[point]:.3g} "
        "m: the regions beside that point overlap elsewhere"
        for point in far
    )


def with_diagnosis(result: PlanResult) -> PlanResult:
    """Return a result; messages of refusals tell proof from search.

    The messages of stopped planning, and of plans that do not survive, stay as they are.
    """
    if result.proved is None or result.survival is not None:
        return result
    if result.proved:
        diagnosis = "proved: there is no motion"
    elif not result.starts_tried:
        diagnosis = "not found"
    else:
        plural = "s" if result.starts_tried > 1 else ""
        diagnosis = f"not found, {result.starts_tried} start{plural} tried"
    return replace(result, message=f"{result.message}; {diagnosis}")
