"""Samples at a given rate, smoothed until joining polynomials keep the limits.

The acceleration of a time-optimal trajectory has kinks between samples, the sharpest at its ends,
where it rises to a limit within a fraction of a period. Polynomials through samples cannot follow:
they exceed the limit, by up to a third of it. Such trajectories are averaged over about a period
to either side: a uniform cubic spline whose control points lie on the trajectory (Schoenberg's
operator; de Boor, "A Practical Guide to Splines", chapter XI). Its velocities, accelerations and
jerks are means of the trajectory's, so that they keep its limits, and between samples it is a
cubic, so that joined samples reproduce the spline. It begins and ends a period late. The limits of
effort, which means keep only nearly, are checked, and more periods are taken until they hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE
from tubeplanner.certificate.verification import verify
from tubeplanner.limits.peaks import motor_effort
from tubeplanner.limits.process_stretches import passed_marks
from tubeplanner.limits.speed_limits import minimum_duration
from tubeplanner.outcome import Infeasible
from tubeplanner.task.legs import Stop
from tubeplanner.task.motion import Motion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Event
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples, averaged
from tubeplanner.trajectory.parts import Mark, resting
from tubeplanner.trajectory.reader import joined_samples

# Averaging begins with at least `_MIN_PERIODS` periods; averaging and slowing down end at
# `_MAX_SLOWED` times the trajectory's periods or duration.
_MIN_PERIODS, _MAX_SLOWED = 6, 2.0
# Limits hold when the joined samples need no more than this fraction of their time more.
_RUN_OVER = 1e-6


@dataclass(frozen=True, eq=False)
class ExportSamples:
    """Samples of a trajectory, for a file."""

    samples: TrajectorySamples  # a sample per period, the last one at their duration
    rate: float  # [Hz]
    # excess of their duration over the trajectory's, as a fraction; 0 if they lie on it
    slowed: float
    # difference to the trajectory, or conditions that the joined samples violate; None: neither
    note: str | None


def samples_for_export(
    problem: PlanningProblem, trajectory: JointTrajectory, rate: float
) -> ExportSamples:
    """Return samples that pass `check`: of the trajectory itself, averaged, or slowed down.

    If nothing passes, samples of the trajectory itself; the note says which conditions fail, and
    whether the trajectory, in the joint order of the problem, itself fails them.

    Raises:
        TrajectoryError: The rate [Hz] is not positive, or makes too many samples.
    """
    samples = trajectory.sample(rate)
    failures = _failures(problem, _joined(trajectory, samples))
    if failures is None:
        return ExportSamples(samples, rate, 0.0, None)
    for method, how in (
        (_averaged, "averaged over neighbouring periods"),
        (_slowed, "slowed down"),
    ):
        gentler = method(problem, trajectory, rate)
        if gentler is None or _failures(problem, _joined(trajectory, gentler)) is not None:
            continue
        slowed = gentler.time[-1] / trajectory.duration - 1
        note = (
            f"CSV and ROS samples at {rate:g} Hz are {how} and last {gentler.time[-1]:.4f} s, "
            f"{100 * slowed:.2g} % longer than the trajectory, so that the limits hold "
            "between samples too"
        )
        return ExportSamples(gentler, rate, slowed, note)
    own_failures = _failures(problem, trajectory)
    if own_failures is not None:
        note = (
            "CSV and ROS samples are of the trajectory as it is, which itself breaks the "
            f"conditions {own_failures}"
        )
    else:
        note = (
            f"CSV and ROS samples at {rate:g} Hz are too few: joined by polynomials, they break "
            f"the conditions {failures}; raise the rate"
        )
    return ExportSamples(samples, rate, 0.0, note)


def _failures(problem: PlanningProblem, trajectory: JointTrajectory) -> str | None:
    """Return the conditions that a trajectory violates; None without violations."""
    return ", ".join(verify(problem, trajectory, FOREIGN_TOLERANCE).failures()) or None


def _averaged(
    problem: PlanningProblem, trajectory: JointTrajectory, rate: float
) -> TrajectorySamples | None:
    """Return averaged samples, in the fewest periods that keep the limits; None: too many."""
    fewest = max(int(np.ceil(trajectory.duration * rate)), _MIN_PERIODS)
    periods = fewest
    while periods <= _MAX_SLOWED * fewest:
        average = averaged(trajectory, periods, periods / rate)
        factor_needed = _required_slowing(problem, average)
        if factor_needed <= 1 + _RUN_OVER:
            return average.at(np.arange(periods + 1) / rate)
        periods += max(1, int((factor_needed - 1) * periods))
    return None


def _slowed(
    problem: PlanningProblem, trajectory: JointTrajectory, rate: float
) -> TrajectorySamples | None:
    """Return samples slow enough to keep the limits when joined; None: too slow."""
    factor = 1.0
    while factor <= _MAX_SLOWED:
        samples = trajectory.scaled(factor).sample(rate)
        factor_needed = _required_slowing(problem, _joined(trajectory, samples))
        if factor_needed <= 1 + _RUN_OVER:
            return samples
        factor *= factor_needed
    return None


def _required_slowing(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the factor by which a trajectory must last longer to keep the limits."""
    try:
        return minimum_duration(problem, trajectory) / trajectory.duration
    except Infeasible:  # gravity alone exceeds a motor at the joined samples
        return np.inf


def _joined(trajectory: JointTrajectory, samples: TrajectorySamples) -> JointTrajectory:
    rows = (samples.position, samples.velocity, samples.acceleration)
    return joined_samples(trajectory.joint_names, samples.time, rows)


# ---- Samples of a motion: sections in turn, and the rests between sections.


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Samples of all sections of a motion."""

    motion: Motion  # the motion
    sections: tuple[ExportSamples, ...]  # samples of each section, from time zero
    rate: float  # [Hz]

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences of samples to the motion, and begins of moves if they are later."""
        names = [", ".join(section.names) for section in self.motion.ended_sections]
        named = [f"move '{name}': " if self.motion.marks else "" for name in names]
        notes = [
            f"{name}{sampled.note}"
            for name, sampled in zip(named, self.sections, strict=True)
            if sampled.note is not None
        ]
        begins = self.begins
        planned = [section.begin for section in self.motion.ended_sections]
        if not np.allclose(begins, planned, rtol=0, atol=1e-9):
            listed = ", ".join(f"{n} at {t:.4f} s" for n, t in zip(names, begins, strict=True))
            notes.append(f"in CSV, moves begin later than in the trajectory: {listed}")
        return tuple(notes)

    @property
    def begins(self) -> list[float]:
        """Begin of each section in the motion of the samples [s]."""
        time, result = 0.0, []
        for stop, sampled in zip(self.motion.stops, self.sections, strict=False):
            time += stop.duration
            result.append(time)
            time += float(sampled.samples.time[-1])
        return result

    @property
    def passed_marks(self) -> list[Mark]:
        """Marks of stretches and of events on the way, in the motion of the samples."""
        rows = zip(self.motion.ended_sections, self.sections, self.begins, strict=True)
        return passed_marks(
            [
                replace(each, trajectory=_joined(each.trajectory, own.samples), begin=begin)
                for each, own, begin in rows
            ]
        )

    def whole(self) -> tuple[TrajectorySamples, FloatArray]:
        """Return samples of sections and rests, and motor efforts, shape (N, n) [N m or N].

        At the instant at which the tool takes or releases a part, efforts are those after it.
        """
        tables, begin = [], 0.0
        for samples, effort in self._parts():
            rows = (samples.position, samples.velocity, samples.acceleration, effort)
            tables.append(np.column_stack([begin + samples.time, *rows]))
            begin = tables[-1][-1, 0]
        # An instant at which one part ends and the next begins belongs to the next.
        table = np.concatenate([*(each[:-1] for each in tables[:-1]), tables[-1]])
        position, velocity, acceleration, effort = np.split(table[:, 1:], 4, axis=1)
        return TrajectorySamples(table[:, 0], position, velocity, acceleration), effort

    def _parts(self) -> Iterator[tuple[TrajectorySamples, FloatArray]]:
        """Yield samples of every section and dwell, from time zero, and efforts (N, n)."""
        rests = list(zip(self.motion.stops, self.motion.junctions, strict=True))
        sections = zip(self.motion.ended_sections, self.sections, strict=True)
        for rest, (section, sampled) in zip(rests, sections, strict=False):
            yield from self._dwells(*rest)
            robot, samples = section.problem.robot, sampled.samples
            yield samples, motor_effort(robot, section.trajectory, samples)
        yield from self._dwells(*rests[-1])

    def _dwells(self, stop: Stop, q: FloatArray) -> Iterator[tuple[TrajectorySamples, FloatArray]]:
        """Yield samples and efforts of every dwell of a rest in a configuration (n,)."""
        for step, arm in zip(stop.steps, stop.arms[1:], strict=True):
            if isinstance(step, Event) and step.dwell > 0:
                samples = resting(arm.joint_names, q, step.dwell).sample(self.rate)
                yield samples, arm.gravity_effort(samples.position)


def motion_samples(motion: Motion, rate: float) -> MotionSamples:
    """Return samples of a motion's sections at a rate [Hz] that keep their limits when joined.

    Raises:
        TrajectoryError: The rate is not positive, or makes too many samples.
    """
    sections = [(each.problem, each.trajectory) for each in motion.ended_sections]
    return MotionSamples(motion, tuple(samples_for_export(*each, rate) for each in sections), rate)
