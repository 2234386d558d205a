"""A tube from a recorded trail: its corners, and its joints' ranges between them."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arguments import given_options
from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.options import require_between, require_count
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, ProgressCallback
from tubeplanner.tube_sources.free_space import FreeSpace
from tubeplanner.tube_sources.measured_plan import (
    MAX_CORNER_SEGMENTS,
    PlannedTube,
    followed,
    measure_options,
    measured_plan,
)
from tubeplanner.tube_sources.tool_corners import ToolCorners, tool_corners
from tubeplanner.tube_sources.trail import MIN_MOVE, moving_part, trail_samples, without_ways_back
from tubeplanner.tube_sources.tube_answer import TubeAnswer, answer_of
from tubeplanner.verification.refusal import require_free


@dataclass(frozen=True)
class TeachOptions:
    """How to make a tube from a trail.

    Attributes:
        deviation: How far the tool of the trail may be from the lines between reference points [m].
        band: How far joints may leave the trail's ranges in the segment [rad or m].
        max_radius: No segment gets a larger radius [m].
        samples: How many configurations of a segment the last counterexample search draws.
        seed: Of measuring's random numbers.
    """

    deviation: float = 0.01
    band: float = 0.3
    max_radius: float = 0.2
    samples: int = 2_000
    seed: int = 1

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "band")
        require_between(self, 0, np.inf, "deviation", "max_radius", unit="m")
        require_count(self, 1, "samples")
        require_count(self, 0, "seed")


def teach(
    problem: PlanningProblem,
    trail: FloatArray,
    options: TeachOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeAnswer:
    """Make a tube from a trail, and plan the trajectory through it.

    Args:
        problem: The arm and its obstacles, from the trail's first configuration to its last.
        trail: From `joint_trail`, shape (N, n) [rad or m].
        options: How to make it.
        progress: Called with every stage as it begins.

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: The trail is none, does not move, or comes back the way it went.
        OptionError: The largest radius is not above the tool radius, the deviation is so small that
            the trail becomes too many segments, or an argument is of another kind.
    """
    PlanningProblem.require(problem)
    options, clock = given_options(options, TeachOptions), PlanningClock(None, progress)
    trail = trail_samples(trail, problem.robot.joint_count)
    clock.enter("corners of the trail")
    kept = moving_part(trail)
    moving, turns = without_ways_back(problem.robot, kept, options.deviation)
    notes = [
        f"removed: {len(trail) - len(kept)} of {len(trail)} samples, in which no joint moved by "
        f"{MIN_MOVE:g} rad or m since the one before: pauses and noise"
    ] * (len(kept) < len(trail))
    notes += [
        f"removed: a detour out and back that turned at {np.round(turn, 3).tolist()} m "
        "(no tube can ask for it; record two trails to have the tool go there)"
        for turn in turns
    ]
    how = measure_options(options.max_radius, options.samples, options.seed)
    found: PlannedTube | Infeasible
    try:
        space = FreeSpace(problem, 0.0, moving[[0, -1]])
        corners = _corners(problem, space, moving, options.deviation)
        _require_few(corners, options.deviation)
        found = measured_plan(problem, space, corners, options.band, how, clock)
        notes += _left_by_trail(found.problem, moving)
    except Infeasible as reason:
        found = reason
    measured = None if isinstance(found, Infeasible) else found
    if not isinstance(found, Infeasible):
        found = followed(found, clock)
    return answer_of(found, measured=measured, notes=tuple(notes), search_time=clock.elapsed)


def _require_few(corners: ToolCorners, deviation: float) -> None:
    """Raise unless the corners of a trail make few enough segments to be measured."""
    count = len(corners.parts)
    if count > MAX_CORNER_SEGMENTS:
        raise OptionError(
            f"deviation is {deviation:g} m, at which the trail becomes {count} segments; at most "
            f"{MAX_CORNER_SEGMENTS} are measured, at one to two seconds each: choose a larger "
            "deviation, or cut the trail into parts"
        )


def _left_by_trail(problem: PlanningProblem, trail: FloatArray) -> list[str]:
    """Return a note if a tube's joint ranges do not hold the trail (N, n) itself."""
    beyond = np.maximum(problem.joint_lower - trail[:, None], trail[:, None] - problem.joint_upper)
    inside = problem.tube.margin(problem.robot.tool_position(trail)) >= 0
    most = np.where(inside, beyond.max(axis=2), np.inf)
    rows = np.flatnonzero(inside.any(axis=1))
    row = int(rows[most[rows].min(axis=1).argmax()])
    segment = int(most[row].argmin())
    joint = int(beyond[row, segment].argmax())
    if beyond[row, segment, joint] <= 0:
        return []
    return [
        "the measured joint ranges are those around the planner's own branch along the lines; the "
        f"trail leaves them by up to {beyond[row, segment, joint]:.2g} rad or m "
        f"('{problem.robot.joint_names[joint]}', segment {segment})"
    ]


def _corners(
    problem: PlanningProblem, space: FreeSpace, trail: FloatArray, deviation: float
) -> ToolCorners:
    """Return the corners of a trail (N, n).

    Raises:
        Infeasible: Status tube_blocked: the trail collides.
    """
    require_free(problem, "start", trail[0])
    require_free(problem, "goal", trail[-1])
    for q in trail:
        place = space.lacking(q)
        if place is not None:
            message = (
                f"the trail itself has too little clearance: {place}; correct the obstacles or the "
                "clearance, or list a pair that may touch in collision.ignore"
            )
            raise Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
    corners = tool_corners(problem.robot, space, trail, deviation)
    if corners is None:
        raise Infeasible(
            PlanStatus.TUBE_BLOCKED,
            "the tool cannot follow the trail in straight lines without a collision",
            Place(),
        )
    return corners
