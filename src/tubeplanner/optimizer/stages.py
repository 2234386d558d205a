"""Refinement on ever finer knots; sensitivities; second stage at fixed duration."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.verification import Certificate
from tubeplanner.limits.path_samples import LimitKey
from tubeplanner.limits.speed_limits import minimum_duration
from tubeplanner.optimizer.descent import (
    FIRST_PENALTY,
    MAX_PENALTY,
    Descent,
    DescentState,
    SequentialProgram,
)
from tubeplanner.optimizer.link_constraints import (
    CAUTIOUS_PER_INTERVAL,
    PER_INTERVAL,
    LinkConstraints,
)
from tubeplanner.optimizer.motion_measures import objective_measures
from tubeplanner.optimizer.phased_spline import KnotGrid, PhasedSpline, segments_of_pieces
from tubeplanner.optimizer.rows import MERIT_TOLERANCE
from tubeplanner.optimizer.spline_constraints import (
    BLENDED,
    WIDELY_BLENDED,
    Iterate,
    SplineConstraints,
)
from tubeplanner.optimizer.starts import subdivided, with_turn_knots
from tubeplanner.optimizer.step_objective import MeasuredObjective
from tubeplanner.optimizer.step_search import TrustRegion
from tubeplanner.optimizer.tube_phases import has_turns_at_speed, widened_radius
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.task.holding import PRICED
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import in_milliseconds
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, from_spline
from tubeplanner.trajectory.parts import common_intervals

# ---- Phase 2: path and speed optimised together, from coarse to fine knots.
#
# The paper's phase 2 moves its knots along discretised gradients and doubles them (Suh & Bishop
# 1988). Here, sequential linear programs shorten a spline over phases, one per tube segment or
# chain of them, on few knots; then its knot intervals are divided, which does not change it, and it
# is shortened again. Links are watched where they come close. On the finest knots, samples are
# added where a constraint is violated between them.

# Radii of trust regions, in their units.
_FIRST_TRUST, _LATER_TRUST, _LAST_TRUST = 0.2, 0.1, 0.02
_MIN_LAST_TRUST = 0.002
_GAIN, _LAST_GAIN = 5e-4, 2e-4
_MAX_STEPS, _STEPS_PER_ROUND, _MAX_ROUNDS = 60, 3, 8
# Further rounds while each gains at least this fraction of T^2, up to this number in all.
_WORTH_A_ROUND, _MOST_ROUNDS = 0.002, 32
_NEAR_TRUST = 0.01  # of a start that is nearly an answer
# Floors of the tool's speed hold from such a start on that is this far below them at most, else
# from a motion inside its tube on. Where all steps leave more than this, the joints cannot.
_NEARLY_STEADY, _UNSTEADY = 0.1, 0.02
# On coarse knots, links that came close during the search keep this much clearance.
_MAX_COARSE_ROUNDS, _STEPS_PER_COARSE_ROUND = 6, 10
# Links that ended clear on fine knots were never this deep on coarse ones (1,856 runs: 0.0073).
_HOPELESS = 0.05
# Links that leave an obstacle on more knots do so in half as many steps.
_STEPS_TO_GET_OUT = 15
# Links that pass through an obstacle between samples are this deep in it where samples are added
# (110 problems with a solution: 0.027 at most, once). After this number of times, they stay.
_DODGED, _MAX_DODGES = 0.2, 3
# Splines with this number of knot intervals can go round an obstacle.
_MANY_INTERVALS = 16
# Certificates at most, each of which gives the optimiser the times of failed conditions.
_OBJECTIONS, _CAUTIOUS_OBJECTIONS = 5, 12
# The exchange of samples ends when violations between them are below this fraction of T^2.
_BETWEEN_SAMPLES = 0.003


class Stage(ABC):
    """An optimisation of a spline, and the best spline so far.

    Attributes:
        problem: The planning problem.
        gave_up: True if the stage ended early, links too deep in an obstacle.
        max_objections: Number of certificates after which the stage ends without an answer.
    """

    max_objections = _OBJECTIONS
    _name: ClassVar[str]  # in messages
    _program: SequentialProgram

    def __init__(
        self, problem: PlanningProblem, start: PhasedSpline, checkpoint: Callable[[float], None]
    ) -> None:
        self.problem, self.gave_up = problem, False
        self._start, self._checkpoint_duration = start, checkpoint
        self._best: Iterate | None = None

    @abstractmethod
    def run(self) -> bool:
        """Optimise the start; return True if there is an answer.

        Raises:
            Infeasible: Status no_trajectory: the motors cannot hold the start.
        """

    @abstractmethod
    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return True if there is an answer.

        The certificate is of the best trajectory at its limits, of that duration [s].
        """

    @property
    def has_spline(self) -> bool:
        """True if there is a trajectory."""
        return self._best is not None

    @property
    def spline(self) -> PhasedSpline:
        """The best spline so far, or the last if none was feasible."""
        if self._best is None:
            raise RuntimeError(f"{self._name} has not run")
        return self._best.spline

    @property
    def trajectory(self) -> JointTrajectory:
        """`spline` as a trajectory of duration 1 s."""
        return from_spline(self.problem.robot.joint_names, self.spline.bspline())

    @property
    def segments(self) -> IntArray:
        """The tube segment of each polynomial piece of `trajectory`, shape (pieces,)."""
        return segments_of_pieces(self.spline.grid)

    def _begun(self, spline: PhasedSpline) -> Iterate:
        iterate = self._program.iterate(spline)
        if not np.isfinite(iterate.squared_duration):
            message = f"{self._name} has no trajectory to start from"
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
        return iterate

    def _add_failures(self, certificate: Certificate, duration: float) -> bool:
        """Add samples of the best spline where a certificate fails; return True if there are."""
        locations = [certificate.conditions[name].where for name in certificate.failures()]
        times = [location.time for location in locations if location.time is not None]
        for time in times:
            self._program.constraints.add_samples(self.spline, time / duration)
        return bool(times)


class Refinement(Stage):
    """Refinement of a spline.

    Attributes:
        without_floors: The shortest motion before the floors of speed bands joined; None: they did
            not join.
    """

    _name = "refinement"

    def __init__(
        self,
        problem: PlanningProblem,
        start: PhasedSpline,
        divisions: tuple[int, ...] | None,
        checkpoint: Callable[[float], None] = lambda duration: None,
        *,
        widens: bool = True,
        is_cautious: bool = False,
        max_steps: int | None = None,
    ) -> None:
        """Take a problem and a start.

        Args:
            problem: The planning problem; segments are visited in order.
            start: The first spline; its phases are the tube's segments or chains of them.
            divisions: Number of parts of every knot interval after each round; None: the start is
                nearly an answer, and refined on its own knots.
            checkpoint: Called with the duration [s] after every step; it may raise to end the work.
            widens: Whether coarse knots get a tube as wide as they are coarse; links that are deep
                in an obstacle there end the refinement.
            is_cautious: Whether the start is free of collision and stays so at every step.
            max_steps: After more steps `run` raises Infeasible; None: after no number.
        """
        super().__init__(problem, start, checkpoint)
        self._divisions, self._widens = divisions, widens and not is_cautious
        self._is_cautious = is_cautious
        if is_cautious:
            self.max_objections = _CAUTIOUS_OBJECTIONS
        self._steps, self._max_steps = 0, max_steps
        self.without_floors: PhasedSpline | None = None
        self._radius = problem.tube.effective_radius
        self._penalty, self._trust = FIRST_PENALTY, TrustRegion(_FIRST_TRUST)

    def run(self) -> bool:
        """Refine to the finest knots, or until links turn out to stay in obstacles; return True.

        Raises:
            Infeasible: Status no_trajectory: the motors cannot hold the start, or too many steps.
        """
        per_interval = CAUTIOUS_PER_INTERVAL if self._is_cautious else PER_INTERVAL
        links = LinkConstraints(self.problem, per_interval=per_interval)
        spline, trust, divisions = self._start, _FIRST_TRUST, self._divisions or ()
        if self._divisions == () and has_turns_at_speed(self.problem):
            divisions = (1,)  # the knots of turns follow from a duration
        for level, parts in enumerate(divisions, 1):
            is_last = level == len(divisions)
            self._begin_level(spline, links, widens=self._widens)
            # The fewest knots may be too few to go round an obstacle: a last try has some more.
            is_decisive = is_last and has_enough_knots(spline.grid)
            is_second_of_last_try = level > 1 and is_decisive and not self._widens
            steps = _STEPS_TO_GET_OUT if is_second_of_last_try else _MAX_STEPS
            coarse = self._on_coarse_knots(spline, trust, steps)
            if (self._widens or is_decisive) and _is_hopeless(coarse):
                self._best, self.gave_up = coarse, True
                return True
            spline, trust = subdivided(coarse.spline, parts), _LATER_TRUST
            if is_last:
                spline = with_turn_knots(self.problem, spline, coarse.duration)
            links = self._program.constraints.links.on_other_knots(coarse.spline, spline)
        self._begin_level(spline, links, widens=False)
        begun, is_near = self._begun(spline), self._divisions is None
        constraints = self._program.constraints
        if constraints.has_floors and is_near:  # a motion that keeps them nearly
            constraints.keeps_floors = True
            begun = self._begun(spline)
            if begun.excess > _NEARLY_STEADY:
                constraints.keeps_floors = False
                begun = self._begun(spline)
        if self._passed_through(begun) and not is_near:
            self._best, self.gave_up = begun, True
        else:
            trust = _NEAR_TRUST if is_near else trust
            self._exchange(self._improved(begun, trust, _GAIN, _MAX_STEPS))
            if constraints.has_floors and not constraints.keeps_floors:
                constraints.keeps_floors, self.without_floors = True, self.spline
                again = self._begun(self.spline)
                result = self._improved(again, _LATER_TRUST, _LAST_GAIN, _MAX_STEPS)
                if result.penalty == MAX_PENALTY and result.iterate.excess > _UNSTEADY:
                    self._best = result.iterate
                else:
                    self._exchange(result)
        self._max_steps = None
        return True

    def _begin_level(self, spline: PhasedSpline, links: LinkConstraints, *, widens: bool) -> None:
        tube = self.problem.tube
        self._radius = widened_radius(tube, spline.grid) if widens else tube.effective_radius
        self._program = SequentialProgram(
            self.problem, spline.grid, links, self._radius, is_cautious=self._is_cautious
        )
        constraints = self._program.constraints
        constraints.blend(WIDELY_BLENDED)
        constraints.keeps_floors = False
        constraints.links.add_samples(spline)
        self._penalty, self._trust = FIRST_PENALTY, TrustRegion(_FIRST_TRUST)

    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return False without such samples.

        False, too, if the best trajectory is infeasible at the present samples, or links are deep
        in an obstacle at the new ones.
        """
        is_feasible = self._best is not None and self._best.excess <= MERIT_TOLERANCE
        if not is_feasible or not self._add_failures(certificate, duration):
            return False
        again = self._program.iterate(self.spline)
        if self._passed_through(again):
            self.gave_up = True
            return False
        self._exchange(self._improved(again, _LAST_TRUST, _LAST_GAIN, _MAX_STEPS))
        return True

    def elasticities(self) -> dict[LimitKey, float]:
        """Return d ln T / d ln p for every limit p: see `SequentialProgram.elasticities`."""
        if self._best is None:
            return {}
        spline, program = self._best.spline, self._program
        if spline.grid is not program.grid:  # ended before there was a trajectory on finer knots
            program = SequentialProgram(self.problem, spline.grid)
        return program.elasticities(program.iterate(spline))

    def _on_coarse_knots(self, spline: PhasedSpline, trust: float, max_steps: int) -> Iterate:
        """Return about the shortest trajectory, links not yet clear between samples."""
        result = self._improved(self._begun(spline), trust, _GAIN, max_steps)
        for _ in range(_MAX_COARSE_ROUNDS):
            if _has_settled_inside(result):
                break
            if not self._program.constraints.links.add_samples(result.iterate.spline):
                break
            again = self._program.iterate(result.iterate.spline)
            result = self._improved(again, _LATER_TRUST, _GAIN, _STEPS_PER_COARSE_ROUND)
        return result.iterate

    def _improved(
        self, current: Iterate, radius: float, min_gain: float, max_steps: int
    ) -> DescentState:
        """Return a shorter trajectory; the next descent begins with its penalty and damping."""
        begun = DescentState((current,), replace(self._trust, radius=radius), self._penalty)
        result = Descent((self._program,)).improved(
            begun, min_gain=min_gain, max_steps=max_steps, checkpoint=self._checkpoint
        )
        self._penalty, self._trust = result.penalty, result.trust
        return result

    def _exchange(self, result: DescentState) -> None:
        """Set the best trajectory between samples too, adding samples where constraints fail."""
        best, dodges = None, 0
        if self._program.constraints.blend(BLENDED):
            again = self._program.iterate(result.iterate.spline)
            result = replace(result, iterates=(again,), has_ended=False)
        for rounds in range(_MOST_ROUNDS):
            dense, has_more = self._program.constraints.add_samples_between(result.iterate)
            inside = dense.excess <= MERIT_TOLERANCE
            least = np.inf if best is None else best.squared_duration
            if inside and dense.squared_duration < least:
                best = dense
            if rounds >= _MAX_ROUNDS and not (
                inside and dense.squared_duration < (1 - _WORTH_A_ROUND) * least
            ):
                break
            near = dense.squared_duration < (1 + _BETWEEN_SAMPLES) * result.iterate.squared_duration
            if inside and result.has_ended and (near or not has_more):
                break
            again = self._program.iterate(result.iterate.spline)
            if best is not None and not np.isfinite(again.squared_duration):
                again = self._program.iterate(best.spline)  # motors cannot hold the last between
            if not np.isfinite(again.squared_duration):
                break
            dodges += self._passed_through(again)
            if best is None and (_has_settled_inside(result) or dodges == _MAX_DODGES):
                self.gave_up = True
                break
            trust = min(max(2 * result.trust.radius, _MIN_LAST_TRUST), _LAST_TRUST)
            result = self._improved(again, trust, _LAST_GAIN, _STEPS_PER_ROUND)
        self._best = best or result.iterate

    def _passed_through(self, again: Iterate) -> bool:
        """Return True if links are deep in an obstacle at new samples: they passed between the old.

        Cautious steps pass corners at most: more samples bring links out.
        """
        deepest = float(again.links.excess.max(initial=0.0))
        return deepest > _DODGED and not self._is_cautious

    def _checkpoint(self, iterates: tuple[Iterate, ...]) -> None:
        (iterate,) = iterates
        is_widened = (self._radius > self.problem.tube.effective_radius).any()
        if iterate.excess <= MERIT_TOLERANCE and not is_widened:
            self._best = iterate
        self._checkpoint_duration(iterate.duration)
        self._steps += 1
        if self._max_steps is not None and self._steps > self._max_steps:
            message = f"refinement still changed its start after {self._max_steps} steps"
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())


def has_enough_knots(grid: KnotGrid) -> bool:
    """Return True if splines can go round an obstacle: links inside will then stay inside."""
    return grid.interval_count >= _MANY_INTERVALS


def _is_hopeless(coarse: Iterate) -> bool:
    """Return True if links are too deep in an obstacle on coarse knots for finer knots to mend."""
    return bool(coarse.links.excess.max(initial=0.0) > _HOPELESS)


def _has_settled_inside(result: DescentState) -> bool:
    """Return True if links stay in an obstacle at the present samples: more samples ask more."""
    return result.has_ended and _is_hopeless(result.iterate)


# ---- The sensitivities of a refined trajectory: the cost of each tolerance and each motor.

_RISE = 0.1  # the rise of a limit for which `saved` holds


@dataclass(frozen=True)
class Sensitivity:
    """Cost of one limit, with start, goal and all other limits fixed.

    A goal with tolerances is not fixed: it stays within them.

    Attributes:
        limit: "effort" and "effort_rate" (both directions together), "velocity", "acceleration",
            "jerk", "velocity_by_position", "tool_speed", "least_tool_speed" (the lower end of a
            band), "tool_acceleration", "point_speed", "radius", "rotation", "width" or "height" of
            a box, "tolerance" or "rotation_tolerance" of the goal, or "holding".
        joint: Name of the joint; None for a limit of a segment, a point or the goal.
        segment: Number of the segment, or of the first of joined ones; None for others.
        elasticity: d ln T / d ln limit: the relative change of the duration per relative rise of
            the limit. At most 0, but for the mass of a held part and the lower end of a band.
        saved: Duration that 10 % more would save [s], to first order.
        last_segment: Number of the last of joined segments; None for others.
        link: Link of the point; None for others.
        point: Index of the point among those whose speed is limited; None for others.
        field: Path of the number of a holding, such as "holding.cup.force"; None for others. The
            mass of a part is changed alone: the arm's payload stays.
        unit: Unit of `saved_per_unit`: "N", "0.1", "mm", "degree" or "kg"; None for others.
        saved_per_unit: Duration that one unit more saves [s], to first order; None for others.
    """

    limit: str
    joint: str | None
    segment: int | None
    elasticity: float
    saved: float
    last_segment: int | None = None
    link: str | None = None
    point: int | None = None
    field: str | None = None
    unit: str | None = None
    saved_per_unit: float | None = None

    def __str__(self) -> str:
        if self.field is not None:
            return f"{self.field}: {in_milliseconds(self.saved)}"
        location = self.joint or ("the goal" if self.segment is None else f"segment {self.segment}")
        if self.last_segment not in (None, self.segment):
            location = f"segments {self.segment} to {self.last_segment}"
        if self.point is not None:
            location = f"point {self.point}, on {self.link}"
        return f"{self.limit} of {location}: {in_milliseconds(self.saved)}"


def limit_sensitivities(
    problem: PlanningProblem, refinement: Refinement, duration: float
) -> tuple[Sensitivity, ...]:
    """Return the cost of every limit, largest saving first.

    The duration is the answer's [s].
    """
    tube, sensitivities = problem.tube, []
    for key, elasticity in refinement.elasticities().items():
        joint = None if key.joint is None else problem.robot.joint_names[key.joint]
        first = last = None
        if key.segment is not None:  # joined segments have a first and a last number
            begin, end = (tube.points[key.segment + k] for k in (0, 1))
            first = tube.segment_number(key.segment, begin)
            last = tube.segment_number(key.segment, end)
        saved = -elasticity * _RISE * duration
        own = (key.kind, joint, first, elasticity, saved, last, key.link, key.point)
        price: tuple[str | None, str | None, float | None] = None, None, None
        if key.contact is not None and key.parameter is not None:
            holding, number = problem.holding[key.contact], f".{key.contact}"
            owner = "part" if key.parameter == "mass" else holding.kind
            unit, size = PRICED[key.parameter]
            path = f"holding{number * (len(problem.holding) > 1)}.{owner}.{key.parameter}"
            price = path, unit, saved / _RISE * size / holding.priced[key.parameter]
        sensitivities.append(Sensitivity(*own, *price))
    return tuple(sorted(sensitivities, key=lambda sensitivity: -sensitivity.saved))


# ---- The second stage: of all motions near the shortest, the best by the problem's objective.
#
# The objective is smoothness, energy or work, in a given duration. The second stage begins with the
# shortest motion, on its knots, and keeps most of the clearance that this has in the tube and from
# obstacles.

_FIRST_DAMPING = 1e-3
_SMOOTHING_TRUST, _MIN_TRUST = 0.01, 0.002  # in units of the trust region
_PENALTY = 1.0
_SMOOTHING_GAIN = 5e-4
_SMOOTHING_STEPS, _SMOOTHING_ROUNDS = 4, 8
# For peaks between samples, the second stage aims at this fraction less than the longest duration:
# between the first two, a part of the extra time over the shortest motion. Peaks at dense samples
# stay the last fraction below, for peaks between those.
_MIN_RESERVE, _MAX_RESERVE, _RESERVE_FRACTION = 1e-4, 2.5e-4, 0.25
_BETWEEN_LOOKS = 5e-5
# Coulomb friction is blended over these knot intervals, as reversals move during the descent.
# They lie between samples, and have sharper peaks.
_BLENDED, _MAX_AT_REVERSALS = 8.0, 7e-4
# The shortest motion's slack in the tube may shrink by this fraction of the radius; its clearance
# by this fraction, of which no more than so much counts [m].
_LESS_SLACK, _LESS_CLEARANCE, _MAX_CLEARANCE = 0.05, 0.1, 0.02


class SecondStage(Stage):
    """The second stage of a spline."""

    _name = "the second stage"

    def __init__(
        self,
        problem: PlanningProblem,
        spline: PhasedSpline,
        longest: float,
        clearance: float,
        checkpoint: Callable[[float], None] = lambda duration: None,
    ) -> None:
        """Take a problem and its shortest motion.

        Segments are visited in order. The spline is the shortest motion, with its clearance from
        obstacles beyond the required one [m]; a better motion takes at most `longest` [s]. The
        checkpoint is called with the duration [s] after every step.
        """
        super().__init__(problem, spline, checkpoint)
        self._longest = longest
        plain = SplineConstraints(
            problem, spline.grid, LinkConstraints(problem), problem.tube.effective_radius
        )
        dense = plain.between_samples(spline)
        reserve = _RESERVE_FRACTION * abs(1 - dense.duration / longest)
        has_reversals = problem.robot.motors.has_coulomb_friction
        most = _MAX_AT_REVERSALS if has_reversals else _MAX_RESERVE
        reserve = min(max(reserve, _MIN_RESERVE), most)
        run_in = longest * (1 - reserve)
        measures = objective_measures(problem, spline, run_in)
        self._objective = MeasuredObjective(measures, run_in)
        min_clearance = (1 - _LESS_CLEARANCE) * min(max(clearance, 0.0), _MAX_CLEARANCE)
        self._program = SequentialProgram(
            problem,
            spline.grid,
            LinkConstraints(problem, min_clearance),
            objective=self._objective,
            slack=_slack(problem, dense) - _LESS_SLACK,
        )
        self._program.constraints.blend(_BLENDED)
        self._penalty = _PENALTY

    def run(self) -> bool:
        """Improve the shortest motion; return True if there is an answer."""
        constraints, start = self._program.constraints, self._start
        constraints.links.add_samples(start)
        first = TrustRegion(_SMOOTHING_TRUST, _FIRST_DAMPING)
        # Where wide blending needs more time than there is, friction is blended as in refinement.
        return self._improved(self._begun(start), first) or (
            constraints.blend(BLENDED) and self._improved(self._begun(start), first)
        )

    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return True if there is an answer."""
        spline, has_samples = self.spline, self._add_failures(certificate, duration)
        self._best = None
        return has_samples and self._improved(self._begun(spline), TrustRegion(_MIN_TRUST))

    def _improved(self, current: Iterate, trust: TrustRegion) -> bool:
        """Set the best motion, adding samples and links where constraints fail; True if any."""
        for _ in range(_SMOOTHING_ROUNDS):
            result = Descent((self._program,)).improved(
                DescentState((current,), trust, self._penalty),
                min_gain=_SMOOTHING_GAIN,
                max_steps=_SMOOTHING_STEPS,
                checkpoint=lambda iterates: self._checkpoint_duration(self._longest),
            )
            self._penalty = result.penalty
            value = self._objective.value
            inside = self._looked_at(result.iterate)
            if inside and (self._best is None or value(result.iterate) < value(self._best)):
                self._best = result.iterate
            if inside and result.has_ended:
                break
            current = self._begun(result.iterate.spline)
            trust = replace(result.trust, radius=max(result.trust.radius, _MIN_TRUST))
        return self._best is not None

    def _looked_at(self, iterate: Iterate) -> bool:
        """Return True if a motion is valid between samples too; add samples at failures."""
        dense, _ = self._program.constraints.add_samples_between(iterate)
        if dense.excess > MERIT_TOLERANCE:
            return False
        longest = self._longest * (1 - _BETWEEN_LOOKS)
        if not self.problem.robot.motors.has_coulomb_friction:
            return dense.squared_duration <= longest**2
        return self._has_time_with_friction(dense.spline, longest)

    def _has_time_with_friction(self, spline: PhasedSpline, longest: float) -> bool:
        """Return True if a duration is enough by exact time scaling; if not, watch all reversals.

        Blended friction asks for more than the exact one, and between samples, where efforts are
        steep, may miss the peak at a reversal.
        """
        shape = from_spline(self.problem.robot.joint_names, spline.bspline())
        segments = segments_of_pieces(spline.grid)
        try:
            if minimum_duration(self.problem, shape, segments=segments) <= longest:
                return True
        except Infeasible:
            pass
        intervals = common_intervals(shape)
        begin = shape.breakpoints[intervals.piece] + intervals.start * shape.widths[intervals.piece]
        self._program.constraints.watch(spline, begin[intervals.start > 0])
        return False


def _slack(problem: PlanningProblem, dense: Iterate) -> FloatArray:
    """Return the fraction of the tube's regions that a motion leaves unused, by segment, (m,).

    0 beside compulsory points, about which there is a region of another kind.
    """
    tube, regions = problem.tube, dense.regions[0]
    slack = np.ones(tube.segment_count)
    fraction = regions.regions.fraction(regions.vector, regions.segment)
    np.minimum.at(slack, regions.segment, 1 - fraction)
    beside = np.concatenate([tube.compulsory_points - 1, tube.compulsory_points])
    slack[beside] = 0.0
    return slack
