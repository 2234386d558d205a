"""The configurations in which moves end and the next begin, for the least sum of durations."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from tubeplanner.branches.pose_configurations import is_free
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Goal
from tubeplanner.cycle_planning.leg_plan import LegPlan
from tubeplanner.errors import ProblemError
from tubeplanner.planning.continued_plan import continued_plan
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.planner import shortest_plan
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.progress import PlanningClock, Progress
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.refined_motion import RefinedMotion
from tubeplanner.refinement.tied_legs import TiedLegs

_STAGE = "shared configurations"
# Where a part is taken and put down in other configurations, it hangs and stands otherwise: where
# it is then put down a little too deep, that configuration alone is chosen once more.
_ROUNDS = 4


def shared_plan(
    cycle: Cycle, greedy: Sequence[LegPlan], options: PlanOptions, clock: PlanningClock
) -> list[LegPlan] | None:
    """Return the shortest motions of all legs between ends that suit all of them.

    Args:
        cycle: The cycle.
        greedy: Each leg's from where the one before ended.
        options: How to plan a leg afresh, where that is necessary.
        clock: The planning's.

    Returns:
        None if nothing shorter is found than what there is.

    Raises:
        TimeLimitReached: Before it was known; likewise KeyboardInterrupt.
    """
    last = len(greedy) - 1
    is_open = [leg.joined.ends_openly for leg in cycle.legs]
    is_open[last] &= not cycle.closed or isinstance(cycle.start, Seed)
    goals = _goals(cycle, greedy, is_open)
    motions = [_opened(*each) for each in zip(greedy, goals, strict=True)]
    known = [motion for motion in motions if motion is not None]
    if last == 0 or not any(is_open) or len(known) < len(greedy):
        return None
    for _ in range(_ROUNDS):
        clock.enter(_STAGE)
        splines = _tied(known, is_open, clock, closed=cycle.closed)
        if splines is None:
            return None
        ends = [spline.control_points[[0, -1]] for spline in splines]
        try:
            problems = cycle.problems([ends[0][0], *(end for _, end in ends)])
        except ProblemError:  # no place for an end after all
            return None
        opened = [
            replace(motion, problem=replace(problem.joined, goal=goal), spline=spline)
            for motion, problem, goal, spline in zip(known, problems, goals, splines, strict=True)
        ]
        is_open = [_presses(*each) for each in zip(opened, is_open, strict=True)]
        known = [
            motion if opens else replace(motion, problem=problem.joined)
            for motion, problem, opens in zip(opened, problems, is_open, strict=True)
        ]
        if not any(is_open):
            plans = _planned(problems, known, options, clock)
            return plans if plans is not None and _total(plans) < _total(greedy) else None
    return None


def _goals(cycle: Cycle, greedy: Sequence[LegPlan], is_open: Sequence[bool]) -> list[Goal]:
    """Return where legs end: as their moves say if that is open, else where they end already."""
    goals = [
        leg.joined.goal if opens else plan.end
        for leg, plan, opens in zip(cycle.legs, greedy, is_open, strict=True)
    ]
    if cycle.closed and is_open[-1]:
        # A ball would leave more room than the start has, where the first tube begins.
        begin, goal = cycle.legs[0].joined.tube.points[0], goals[-1]
        turn = goal.rotation_tolerance if isinstance(goal, GoalRegion) else None
        goals[-1] = GoalRegion(begin, rotation_tolerance=turn)
    return goals


def _tied(
    motions: Sequence[RefinedMotion], is_open: Sequence[bool], clock: PlanningClock, *, closed: bool
) -> list[PhasedSpline] | None:
    """Return the splines of legs, those with open ends improved together; None if none can be.

    Args:
        motions: Of all legs.
        is_open: Whether each ends openly.
        clock: The planning's.
        closed: Whether the first follows the last.
    """
    splines = [motion.spline for motion in motions]
    for chain in _chains(is_open, closed=closed):
        found = TiedLegs(
            [motions[k] for k in chain],
            [is_open[k] for k in chain[:-1]],
            is_closed=closed and all(is_open),
            checkpoint=_checkpoint(clock),
        ).run()
        for k, spline in zip(chain, found or (), strict=found is not None):
            splines[k] = spline
    is_same = all(spline is motion.spline for spline, motion in zip(splines, motions, strict=True))
    return None if is_same else splines


def _chains(is_open: Sequence[bool], *, closed: bool) -> list[list[int]]:
    """Return the legs that open ends join, in the order in which they run.

    Args:
        is_open: Whether each leg ends openly.
        closed: Whether the first follows the last.
    """
    count = len(is_open)
    # So that the ring is cut where an end is given, if one is.
    first = next((k + 1 for k in range(count) if not is_open[k]), 0) if closed else 0
    chains: list[list[int]] = [[]]
    for leg in range(first, first + count):
        k = leg % count
        chains[-1].append(k)
        if not is_open[k]:
            chains.append([])
    return [chain for chain in chains if any(is_open[k] for k in chain)]


def _presses(motion: RefinedMotion, is_open: bool) -> bool:
    """Return whether a leg's end was chosen, and what is put down there is in what it stands on."""
    end = motion.spline.control_points[-1]
    return is_open and not is_free(motion.problem, "goal", end)


def _opened(plan: LegPlan, goal: Goal) -> RefinedMotion | None:
    """Return a leg's motion as one of a problem whose goal is that of its move."""
    motion = plan.result.motion
    if motion is None:
        return None
    return replace(motion, problem=replace(motion.problem, goal=goal))


def _planned(
    problems: Sequence[PlanningProblem],
    motions: Sequence[RefinedMotion],
    options: PlanOptions,
    clock: PlanningClock,
) -> list[LegPlan] | None:
    """Return the shortest motions of legs between their ends; None if one has none.

    Args:
        problems: The legs'.
        motions: From which to begin.
        options: How to plan a leg afresh, if that leads nowhere.
        clock: The planning's.
    """
    plans = []
    for problem, motion in zip(problems, motions, strict=True):
        with clock.within(f"{_STAGE}, {problem.name}"):
            result = continued_plan(problem.joined, motion, clock)
            if result is None or not result.succeeded:
                result = shortest_plan(problem, options, clock)
        if not result.succeeded:
            return None
        plans.append(LegPlan(problem, result))
    return plans


def _checkpoint(clock: PlanningClock) -> Callable[[float], None]:
    """Return what is called with the sum of durations after every step."""

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(_STAGE, best_duration=duration))
        clock.check()

    return checkpoint


def _total(plans: Sequence[LegPlan]) -> float:
    return sum(plan.duration for plan in plans)
