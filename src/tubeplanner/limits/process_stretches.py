"""Stretches of a process in a motion: times, speeds against the band; marks of events on the way.

Times are the judge's: a stretch lasts from the switching time into its first segment to the one out
of its last segment. An event is where the projection of the tool onto its segment passes the
event's distance, during the visit of that segment.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.tube_visits import Visit
from tubeplanner.certificate.verification import judged_visits
from tubeplanner.geometry.tube.bands import BEST
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.task.motion import MotionSection
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import EVENT, PROCESS_OFF, PROCESS_ON, Mark

# Instants of a stretch and of a visit; those of events are then bisected.
_SAMPLES = 2001
_HALVINGS = 40
_ROUNDING = 1e-6  # of a speed
_AT_PLACE = 1e-9  # [m]
_NAME = "bead"


@dataclass(frozen=True)
class StretchRun:
    """The speed of the tool along a stretch of constant speed.

    Attributes:
        name: "bead", with a number if there are several.
        first_segment: Number of its first segment.
        last_segment: Number of its last segment.
        on: Time at which the tool passes into it [s].
        off: Time at which the tool passes out of it [s].
        length: Of the way of the tool in it [m].
        mean_speed: Length over time [m/s].
        speeds: Least and largest upper end of its bands, for which is planned [m/s].
        least_deviation: Of the speed from the upper end of its segment's band, as a fraction.
        largest_deviation: Likewise.
        in_band: Share of the length in which the speed is in the band.
        is_required: True if the band is a condition, False with `process.steady: best`.
    """

    name: str
    first_segment: int
    last_segment: int
    on: float
    off: float
    length: float
    mean_speed: float
    speeds: tuple[float, float]
    least_deviation: float
    largest_deviation: float
    in_band: float
    is_required: bool

    def __str__(self) -> str:
        low, high = (f"{speed:g}" for speed in self.speeds)
        speeds = f"{low} m/s" if low == high else f"{low} to {high} m/s"
        least, most = 100 * min(self.least_deviation, 0.0), 100 * max(self.largest_deviation, 0.0)
        inside = "" if self.is_required else f"; {100 * self.in_band:.1f} % of it in its band"
        return (
            f"{self.name}: {self.mean_speed:.4f} m/s mean, +{abs(most):.1f}/-{abs(least):.1f} % of "
            f"{speeds} over {self.length:.3f} m, on at t = {self.on:.3f} s, off at "
            f"{self.off:.3f} s{inside}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)


def stretch_runs(sections: Sequence[MotionSection]) -> list[StretchRun]:
    """Return the runs of all stretches of a motion's sections, in order of time.

    Speeds are taken at 2,001 instants of each visit.
    """
    runs: list[StretchRun] = []
    count = sum(len(section.problem.joined.tube.stretches) for section in sections)
    for section in sections:
        problem = section.problem.joined
        visits = _visits(section) if problem.tube.stretches else []
        for first, last in problem.tube.stretches:
            name = f"{_NAME} {len(runs) + 1}" if count > 1 else _NAME
            numbers = (_place(section, first)[0], _place(section, last, at_end=True)[0])
            parts = visits[first : last + 1]
            runs.append(_run(name, numbers, problem, section, parts))
    return runs


def _run(
    name: str,
    numbers: tuple[int, int],
    problem: PlanningProblem,
    section: MotionSection,
    visits: Sequence[Visit],
) -> StretchRun:
    tube, inside, length, deviations = problem.tube, 0.0, 0.0, []
    assert tube.tool_speed is not None and tube.least_tool_speed is not None
    motion = section.trajectory.reordered(problem.robot.joint_names)
    for visit in visits:
        lower, upper = tube.least_tool_speed[visit.segment], tube.tool_speed[visit.segment]
        time = np.linspace(visit.begin, visit.end, _SAMPLES)
        speed = tool_speeds(problem, motion, time)
        is_in = (speed >= lower * (1 - _ROUNDING)) & (speed <= upper * (1 + _ROUNDING))
        deviations.append(speed / upper - 1)
        length += float(np.trapezoid(speed, time))
        inside += float(np.trapezoid(speed * is_in, time))
    on, off = visits[0].begin, visits[-1].end
    speeds = tube.tool_speed[[visit.segment for visit in visits]]
    return StretchRun(
        name,
        *numbers,
        section.begin + on,
        section.begin + off,
        length,
        length / (off - on) if off > on else 0.0,
        (float(speeds.min()), float(speeds.max())),
        float(np.min(deviations)),
        float(np.max(deviations)),
        inside / length if length else 1.0,
        tube.process.steady != BEST,
    )


def tool_speeds(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray:
    """Return the tool's speeds at times (K,) of a trajectory in the robot's joint order, (K,)."""
    at = trajectory.at(time)
    velocity = problem.robot.tool_velocity(at.position, at.velocity)[0]
    speeds: FloatArray = np.linalg.norm(velocity, axis=1)
    return speeds


# ---- Marks on the way.


def passed_marks(sections: Sequence[MotionSection]) -> list[Mark]:
    """Return the marks of stretches and of events on the way, in the order of time.

    They come earlier by their leads, not before the motion begins.
    """
    marks: list[Mark] = []
    runs = iter(stretch_runs(sections))
    for section in sections:
        tube = section.problem.joined.tube
        for stretch in tube.stretches:
            run = next(runs)
            ends = (PROCESS_ON, run.on - tube.process.lead_on, stretch.first, False)
            other = (PROCESS_OFF, run.off - tube.process.lead_off, stretch.last, True)
            for kind, time, segment, at_end in (ends, other):
                place = _place(section, segment, at_end=at_end)
                marks.append(Mark(max(time, 0.0), kind, run.name, None, *place))
        marks += _events(section) if tube.events else ()
    return sorted(marks, key=lambda mark: mark.time)


def all_marks(step_marks: Sequence[Mark], sections: Sequence[MotionSection]) -> list[Mark]:
    """Return the marks of steps and on the way together, in the order of time."""
    return sorted([*step_marks, *passed_marks(sections)], key=lambda mark: mark.time)


def _events(section: MotionSection) -> Iterator[Mark]:
    """Yield the marks of a section's events."""
    problem, joined = section.problem, section.problem.joined.tube
    visits, lengths, whole = _visits(section), arc_lengths(joined.points), joined.parts or joined
    motion = section.trajectory.reordered(problem.robot.joint_names)
    for event in whole.events:
        length = whole.event_length(event)
        k = int(np.clip(np.searchsorted(lengths, length, "right") - 1, 0, len(lengths) - 2))
        along = (joined.points[k + 1] - joined.points[k]) / (lengths[k + 1] - lengths[k])
        place = joined.points[k] + (length - lengths[k]) * along

        def beyond(time: FloatArray, place: FloatArray = place, along: FloatArray = along) -> Any:
            q = motion.position(time)
            return (joined.tool_pose(problem.robot, q, time)[1] - place) @ along >= -_AT_PLACE

        time = np.linspace(visits[k].begin, visits[k].end, _SAMPLES)
        is_beyond = beyond(time)
        # Behind it all the time, or beyond it: the tool cuts the corner.
        row = int(is_beyond.argmax()) if is_beyond.any() else _SAMPLES - 1
        low, high = time[max(row - 1, 0)], time[row]
        for _ in range(_HALVINGS if is_beyond[row] else 0):
            middle = (low + high) / 2
            low, high = (low, middle) if beyond(np.array([middle]))[0] else (middle, high)
        segment = event.segment if section.leg is None else section.leg.move_of(event.segment)[1]
        instant = max(float(section.begin + high - event.lead), 0.0)
        yield Mark(instant, EVENT, event.name, None, segment, event.distance)


def _visits(section: MotionSection) -> list[Visit]:
    return judged_visits(section.problem.joined, section.trajectory)


def _place(section: MotionSection, k: int, *, at_end: bool = False) -> tuple[int, float]:
    """Return the number of joined segment k, in its move, and the distance along it to an end."""
    tube: Tube = section.problem.joined.tube
    number = int(tube.numbers[k + 1]) - 1 if at_end else int(tube.numbers[k])
    whole = tube.parts or tube
    distance = 0.0
    if at_end:
        first = np.flatnonzero(whole.numbers == number)[-1]
        end = np.flatnonzero(whole.numbers == number + 1)[0]
        distance = float(np.linalg.norm(whole.points[end] - whole.points[first]))
    return number if section.leg is None else section.leg.move_of(number)[1], distance
