"""The second stage: of all motions near the shortest, the best one in a given duration.

What is best the problem's objective says: the smoothest, or the one that saves most. It begins with
the shortest one, on its knots, and keeps most of the room that this leaves free in the tube and
from obstacles.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.time_scaling import minimum_duration
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.linear_rows import MERIT_TOLERANCE
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.measured_objective import MeasuredObjective
from tubeplanner.refinement.objective_measures import objective_measures
from tubeplanner.refinement.phased_spline import PhasedSpline, segments_of_pieces
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_constraints import BLENDED, Iterate, SplineConstraints
from tubeplanner.refinement.trust_region import TrustRegion
from tubeplanner.trajectory.directed_stretches import common_stretches
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, from_spline
from tubeplanner.verification.certificate import Certificate

_FIRST_DAMPING = 1e-3
_FIRST_TRUST, _LEAST_TRUST = 0.01, 0.002  # in units of the trust region
_PENALTY = 1.0
_GAIN = 5e-4
_STEPS_PER_ROUND, _MAX_ROUNDS = 4, 8
# Aimed at is this share less than the duration that it may take, for peaks between samples: between
# these, a part of what it may take longer. Peaks that are looked at stay this far below for others.
_LEAST_RESERVE, _MOST_RESERVE, _RESERVE_SHARE = 1e-4, 2.5e-4, 0.25
_BETWEEN_LOOKS = 5e-5
# Over so many knot intervals Coulomb friction is blended: reversals move with what is saved. These
# are between samples, and have sharper peaks.
_BLENDED, _MOST_AT_REVERSALS = 8.0, 7e-4
# What the shortest motion left free may become smaller by this share of the radius; and by this
# share of the distance from obstacles, of which no more than so much counts [m].
_LESS_ROOM, _LESS_CLEARANCE, _MOST_CLEARANCE = 0.05, 0.1, 0.02


class SecondStage:
    """The second stage of one spline, and the best one found so far."""

    def __init__(
        self,
        problem: PlanningProblem,
        spline: PhasedSpline,
        longest: float,
        clearance: float,
        checkpoint: Callable[[float], None] = lambda duration: None,
    ) -> None:
        """Prepare it.

        Args:
            problem: The planning problem; segments are visited in order.
            spline: The shortest motion.
            longest: How long a better one may take [s].
            clearance: What that leaves free from obstacles, beyond what is asked [m].
            checkpoint: Called with the duration [s] after every step; it may raise to end the work.
        """
        self._problem, self._start, self._longest = problem, spline, longest
        plain = SplineConstraints(
            problem, spline.grid, LinkConstraints(problem), problem.tube.effective_radius
        )
        dense = plain.between_samples(spline)
        reserve = _RESERVE_SHARE * abs(1 - dense.duration / longest)
        has_reversals = problem.robot.motors.has_coulomb_friction
        most = _MOST_AT_REVERSALS if has_reversals else _MOST_RESERVE
        reserve = min(max(reserve, _LEAST_RESERVE), most)
        run_in = longest * (1 - reserve)
        measures = objective_measures(problem, spline, run_in)
        self._objective = MeasuredObjective(measures, run_in)
        kept = (1 - _LESS_CLEARANCE) * min(max(clearance, 0.0), _MOST_CLEARANCE)
        self._program = SequentialProgram(
            problem,
            spline.grid,
            LinkConstraints(problem, kept),
            objective=self._objective,
            room=_room(problem, dense) - _LESS_ROOM,
        )
        self._program.constraints.blend(_BLENDED)
        self._checkpoint = checkpoint
        self._penalty = _PENALTY
        self._best: Iterate | None = None

    @property
    def gave_up(self) -> bool:
        """Whether it ended early: never."""
        return False

    @property
    def has_spline(self) -> bool:
        """Whether there is a better motion yet."""
        return self._best is not None

    @property
    def trajectory(self) -> JointTrajectory:
        """The best so far, as a trajectory that takes one second."""
        return from_spline(self._problem.robot.joint_names, self._found.spline.bspline())

    @property
    def segments(self) -> IntArray:
        """The tube segment of each polynomial piece of that trajectory, shape (pieces,)."""
        return segments_of_pieces(self._found.spline.grid)

    def run(self) -> bool:
        """Make the motion as good as it can be; return whether there is one.

        Raises:
            Infeasible: Status no_trajectory: the motors cannot hold it.
        """
        constraints, start = self._program.constraints, self._start
        constraints.look_for_links(start)
        first = TrustRegion(_FIRST_TRUST, _FIRST_DAMPING)
        # Where that asks for more time than there is, friction is blended as in the first stage.
        return self._improved(self._begun(start), first) or (
            constraints.blend(BLENDED) and self._improved(self._begun(start), first)
        )

    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return whether there is an answer.

        Args:
            certificate: Of the best motion, as long as it may take.
            duration: Of that motion [s].
        """
        found = [certificate.conditions[name].where for name in certificate.failures()]
        times = [place.time for place in found if place.time is not None]
        spline = self._found.spline
        for time in times:
            self._program.constraints.add_samples(spline, time / duration)
        self._best = None
        return bool(times) and self._improved(self._begun(spline), TrustRegion(_LEAST_TRUST))

    @property
    def _found(self) -> Iterate:
        if self._best is None:
            raise RuntimeError("the second stage has not run")
        return self._best

    def _begun(self, spline: PhasedSpline) -> Iterate:
        iterate = self._program.iterate(spline)
        if not np.isfinite(iterate.squared_duration):
            message = "the second stage has no trajectory to start from"
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Place())
        return iterate

    def _improved(self, current: Iterate, trust: TrustRegion) -> bool:
        """Keep the best motion, adding samples and links where they are missing."""
        for _ in range(_MAX_ROUNDS):
            found = self._program.improved(
                current,
                trust,
                self._penalty,
                min_gain=_GAIN,
                max_steps=_STEPS_PER_ROUND,
                checkpoint=lambda iterate: self._checkpoint(self._longest),
            )
            self._penalty = found.penalty
            inside = self._looked_at(found.iterate)
            if inside and (self._best is None or self._is_better(found.iterate)):
                self._best = found.iterate
            if inside and found.has_ended:
                break
            current = self._begun(found.iterate.spline)
            trust = replace(found.trust, radius=max(found.trust.radius, _LEAST_TRUST))
        return self._best is not None

    def _looked_at(self, iterate: Iterate) -> bool:
        """Return whether a motion is an answer between samples too; add some where it is not."""
        dense, _ = self._program.constraints.look_between_samples(iterate)
        if dense.excess > MERIT_TOLERANCE:
            return False
        longest = self._longest * (1 - _BETWEEN_LOOKS)
        if not self._problem.robot.motors.has_coulomb_friction:
            return dense.squared_duration <= longest**2
        return self._has_time_with_friction(dense.spline, longest)

    def _has_time_with_friction(self, spline: PhasedSpline, longest: float) -> bool:
        """Return whether a duration is enough by exact time scaling; if not, watch all reversals.

        Blended friction asks for more than that, and between samples, where efforts are steep, may
        miss what a reversal needs.
        """
        shape = from_spline(self._problem.robot.joint_names, spline.bspline())
        segments = segments_of_pieces(spline.grid)
        try:
            if minimum_duration(self._problem, shape, segments=segments) <= longest:
                return True
        except Infeasible:
            pass
        stretches = common_stretches(shape)
        begin = shape.breakpoints[stretches.piece] + stretches.start * shape.widths[stretches.piece]
        self._program.constraints.watch(spline, begin[stretches.start > 0])
        return False

    def _is_better(self, iterate: Iterate) -> bool:
        return self._objective.value(iterate) < self._objective.value(self._found)


def _room(problem: PlanningProblem, dense: Iterate) -> FloatArray:
    """Return the share of the tube's regions that a motion leaves free, by segment, (m,).

    None beside compulsory points, about which there is a region of another kind.
    """
    tube, regions = problem.tube, dense.regions[0]
    room = np.ones(tube.segment_count)
    share = regions.regions.share(regions.vector, regions.segment)
    np.minimum.at(room, regions.segment, 1 - share)
    beside = np.concatenate([tube.compulsory_points - 1, tube.compulsory_points])
    room[beside] = 0.0
    return room
