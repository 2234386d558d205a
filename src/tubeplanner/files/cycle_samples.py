"""Samples of the motion of a cycle at a rate: move after move, and the rests between them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.motor_effort import motor_effort
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.leg import Rest
from tubeplanner.cycle.steps import Event
from tubeplanner.files.export_samples import ExportSamples, samples_for_export
from tubeplanner.trajectory.joint_trajectory import TrajectorySamples
from tubeplanner.trajectory.parts import resting


@dataclass(frozen=True, eq=False)
class CycleSamples:
    """Samples of all legs of a motion.

    Attributes:
        motion: What they are of.
        legs: Each leg's, from time zero.
        rate: [Hz].
    """

    motion: CycleMotion
    legs: tuple[ExportSamples, ...]
    rate: float

    @property
    def notes(self) -> tuple[str, ...]:
        """How samples differ from the motion, and when moves begin if that is later."""
        notes = [
            f"move '{leg.name}': {sampled.note}"
            for leg, sampled in zip(self.motion.cycle.legs, self.legs, strict=True)
            if sampled.note is not None
        ]
        begins, marked = self.begins, [begin for begin, _ in self.motion.leg_times]
        if not np.allclose(begins, marked, rtol=0, atol=1e-9):
            names = [leg.name for leg in self.motion.cycle.legs]
            listed = ", ".join(f"{n} at {t:.4f} s" for n, t in zip(names, begins, strict=True))
            notes.append(f"in CSV, moves begin later than in the trajectory: {listed}")
        return tuple(notes)

    @property
    def begins(self) -> list[float]:
        """When each leg begins, all of them one after the other [s]."""
        cycle, time, found = self.motion.cycle, 0.0, []
        for k, sampled in enumerate(self.legs):
            time += cycle.rest_at(k).duration
            found.append(time)
            time += float(sampled.samples.time[-1])
        return found

    def whole(self) -> tuple[TrajectorySamples, FloatArray]:
        """Return samples of all, rests included, and what the motors give, shape (N, n) [N m or N].

        Where the tool takes something or lets it go, the motors give what holds from then on.
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
        """Yield samples of every leg and dwell, from time zero, and efforts (N, n)."""
        motion = self.motion
        cycle, seams = motion.cycle, motion.seams
        for k, trajectory in enumerate(motion.legs):
            yield from self._dwells(cycle.legs[k].before, seams[k])
            samples = self.legs[k].samples
            yield samples, motor_effort(cycle.legs[k].robot, trajectory, samples)
        yield from self._dwells(cycle.after, seams[-1])

    def _dwells(self, rest: Rest, q: FloatArray) -> Iterator[tuple[TrajectorySamples, FloatArray]]:
        """Yield the same of every dwell of a rest in a configuration (n,)."""
        for step, arm in zip(rest.steps, rest.arms[1:], strict=True):
            if isinstance(step, Event) and step.dwell > 0:
                samples = resting(arm.joint_names, q, step.dwell).sample(self.rate)
                yield samples, arm.gravity_effort(samples.position)


def cycle_samples(motion: CycleMotion, rate: float) -> CycleSamples:
    """Return samples of a motion's legs that keep their limits when joined.

    Args:
        motion: A certified answer.
        rate: [Hz].

    Raises:
        TrajectoryError: The rate is not positive, or makes too many samples.
    """
    problems = motion.cycle.problems(motion.seams)
    legs = zip(problems, motion.legs, strict=True)
    return CycleSamples(motion, tuple(samples_for_export(*leg, rate) for leg in legs), rate)
