"""Teach: a tube from a recorded trail, unwrapped, without pauses and detours."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.certificate.refusal import require_free
from tubeplanner.checks import checked_options, require_between, require_count
from tubeplanner.errors import OptionError, TrajectoryError, shown
from tubeplanner.first_guess.joint_routes import FreeSpace
from tubeplanner.geometry.tube.points import simplified
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, ProgressCallback
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.tubes.planned_tube import (
    MAX_CORNER_SEGMENTS,
    PlannedTube,
    TubeAnswer,
    answer_of,
    followed,
    measure_options,
    measured_plan,
)
from tubeplanner.studies.tubes.routes import ToolCorners, tool_corners
from tubeplanner.task.problem import PlanningProblem

# ---- A tube from a recorded trail: its corners, and its joints' ranges between them.


@dataclass(frozen=True)
class TeachOptions:
    """How to make a tube from a trail.

    Attributes:
        deviation: Largest distance of the trail's tool from the lines between reference points [m].
        band: Width by which joints may leave the trail's ranges in the segment [rad or m].
        max_radius: Largest radius of a segment [m].
        samples: Number of configurations of a segment in the last counterexample search.
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
    """Make a tube from a trail, and plan the trajectory.

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
    options, clock = checked_options(options, TeachOptions), PlanningClock(None, progress)
    trail = trail_samples(trail, problem.robot.joint_count)
    clock.enter("corners of the trail")
    moving = moving_part(trail)
    pauses = len(trail) - len(moving)
    moving, detours = without_ways_back(problem.robot, moving, options.deviation)
    notes = [
        f"removed: {pauses} of {len(trail)} samples, in which no joint moved by "
        f"{MIN_MOVE:g} rad or m since the one before: pauses and noise"
    ] * (pauses > 0)
    notes += [
        f"removed: a detour out and back that turned at {np.round(detour, 3).tolist()} m "
        "(no tube can ask for it; record two trails to have the tool go there)"
        for detour in detours
    ]
    how = measure_options(options.max_radius, options.samples, options.seed)
    measured: PlannedTube | None = None
    answer: PlannedTube | Infeasible
    try:
        space = FreeSpace(problem, 0.0, moving[[0, -1]])
        corners = _corners(problem, space, moving, options.deviation)
        measured = measured_plan(problem, space, corners, options.band, how, clock)
        notes += _left_by_trail(measured.problem, moving)
    except Infeasible as reason:
        answer = reason
    else:
        answer = followed(measured, clock)
    return answer_of(answer, measured=measured, notes=tuple(notes), search_time=clock.elapsed)


def _corners(
    problem: PlanningProblem, space: FreeSpace, trail: FloatArray, deviation: float
) -> ToolCorners:
    """Return the corners of a trail (N, n).

    Raises:
        Infeasible: Status tube_blocked: the trail collides.
        OptionError: The corners make more segments than are measured.
    """
    require_free(problem, "start", trail[0])
    require_free(problem, "goal", trail[-1])
    for q in trail:
        location = space.shortfall(q)
        if location is not None:
            message = (
                f"the trail itself has too little clearance: {location}; correct the obstacles or "
                "the clearance, or list a pair that may touch in collision.ignore"
            )
            raise Infeasible(PlanStatus.TUBE_BLOCKED, message, location)
    corners = tool_corners(space, trail, deviation)
    if corners is None:
        raise Infeasible(
            PlanStatus.TUBE_BLOCKED,
            "the tool cannot follow the trail in straight lines without a collision",
            Location(),
        )
    count = len(corners.parts)
    if count > MAX_CORNER_SEGMENTS:
        raise OptionError(
            f"deviation is {deviation:g} m, at which the trail becomes {count} segments; at most "
            f"{MAX_CORNER_SEGMENTS} are measured, at one to two seconds each: choose a larger "
            "deviation, or cut the trail into parts"
        )
    return corners


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


# ---- A recorded trail of the joints: matched, unwrapped, without pauses and detours.

# Joints that were recorded this far outside their limits stood at them [rad or m].
_AT_LIMIT = 0.01
# Samples are dropped until a joint has moved this far: pauses, duplicates, noise [rad or m].
MIN_MOVE = 0.02
# Configurations on the way out and back are the same ones [rad or m].
_SAME_CONFIGURATION = 0.25
_DECIMALS = 6
_MIN_TRAVEL = 1e-3  # [m] of the tool


def joint_trail(robot: RobotModel, joint_names: Sequence[str], samples: FloatArray) -> FloatArray:
    """Return recorded joint values in group order, continuous joints unwrapped: shape (N, n).

    Args:
        robot: The arm.
        joint_names: Of the columns of the samples; joints that are not planned are left out.
        samples: Shape (N, columns) [rad or m].

    Raises:
        RobotError: The robot is none.
        TrajectoryError: A joint of the arm is missing, or recorded outside its limits, or samples
            or names are none.
    """
    RobotModel.require(robot)
    if not isinstance(joint_names, list | tuple) or not all(
        isinstance(name, str) for name in joint_names
    ):
        raise TrajectoryError(f"joint_names is {shown(joint_names)}; give a list of names")
    joint_names = list(joint_names)
    missing = [name for name in robot.joint_names if name not in joint_names]
    if missing:
        raise TrajectoryError(
            f"the trail has no joint {', '.join(missing)}; its joints are {', '.join(joint_names)}"
        )
    samples = trail_samples(samples, len(joint_names))
    q: FloatArray = np.array(samples[:, [joint_names.index(name) for name in robot.joint_names]])
    for j, name in enumerate(robot.joint_names):
        if robot.urdf.joints[name].type == "continuous":
            q[:, j] = np.unwrap(q[:, j])
    lower, upper = robot.limits.lower_position, robot.limits.upper_position
    for k, j in np.argwhere((q < lower - _AT_LIMIT) | (q > upper + _AT_LIMIT)):
        raise TrajectoryError(
            f"the trail has '{robot.joint_names[j]}' at {q[k, j]:g} in sample {k}, outside its "
            f"position limits [{lower[j]:g}, {upper[j]:g}] (radians and metres are meant)"
        )
    return np.minimum(np.maximum(q.round(_DECIMALS), lower), upper)


def trail_samples(values: object, columns: int) -> FloatArray:
    """Return the samples of a trail as an array (N, columns).

    Raises:
        TrajectoryError: The samples are no such numbers, none, or not all finite.
    """
    try:
        samples = read_only(values)
    except (TypeError, ValueError):
        raise TrajectoryError(
            f"the trail is {shown(values)}; give samples, {columns} numbers in each row"
        ) from None
    if samples.ndim != 2 or samples.shape[1] != columns or len(samples) == 0:
        raise TrajectoryError(
            f"the trail has the shape {samples.shape}; give samples, {columns} numbers in each row"
        )
    if not np.isfinite(samples).all():
        raise TrajectoryError("the trail has values that are not finite; leave these samples out")
    return samples


def moving_part(q: FloatArray) -> FloatArray:
    """Return a trail (N, n) without samples that hardly differ from the sample before.

    Raises:
        TrajectoryError: The trail does not move.
    """
    rows = [0]
    for k in range(1, len(q)):
        if abs(q[k] - q[rows[-1]]).max() >= MIN_MOVE:
            rows.append(k)
    if len(rows) < 2:
        raise TrajectoryError(
            f"the trail does not move: no joint leaves its first value by {MIN_MOVE:g} rad or m "
            f"in {len(q)} samples; at least a start and a goal are needed"
        )
    if abs(q[-1] - q[rows[-1]]).max() > 0:
        rows = [*rows[:-1], len(q) - 1] if len(rows) > 2 else [*rows, len(q) - 1]
    return q[rows]


def without_ways_back(
    robot: RobotModel, q: FloatArray, deviation: float
) -> tuple[FloatArray, list[FloatArray]]:
    """Return a trail (N, n) without detours out and back, and their turning points (3,) [m].

    A tube cannot enforce such a detour: its capsules overlap all along, and the tool may pass from
    one to the other anywhere. Tools no farther apart than twice the deviation [m] are at one place.

    Raises:
        TrajectoryError: The whole trail goes out and back, or its tool does not move.
    """
    detours: list[FloatArray] = []
    joint = -1  # where the last removed detour was
    while True:
        tool = robot.tool_position(q)
        detour = _detour(q, tool, deviation)
        if detour is None:
            break
        i, j = detour
        if i == 0 and j == len(q) - 1:
            raise TrajectoryError(
                "the trail ends where it starts and comes back the way it went; record the way out "
                "and the way back as two trails"
            )
        if not i <= joint <= j:  # otherwise it is the rest of the same detour
            away = np.linalg.norm(tool[i : j + 1] - tool[i], axis=1)
            detours.append(tool[i + int(away.argmax())])
        joint = i
        # The ends of the trail stay as they are.
        q = np.vstack([q[:i], q[j:]]) if i > 0 else np.vstack([q[:1], q[j + 1 :]])
    travel = float(np.linalg.norm(tool - tool[0], axis=1).max())
    if travel < _MIN_TRAVEL:
        raise TrajectoryError(
            f"the tool moves by {travel:.2g} m only; a tube needs reference points that are apart"
        )
    return q, detours


def _detour(q: FloatArray, tool: FloatArray, deviation: float) -> tuple[int, int] | None:
    """Return the ends of a way out and straight back: two samples in the same configuration."""
    corners = simplified(tool, deviation)
    pairs = []
    for a, b in pairwise(corners):  # the distance from a line does not show a way back on it
        progress = (tool[a : b + 1] - tool[a]) @ (tool[b] - tool[a])
        lowest = int((np.maximum.accumulate(progress) - progress).argmax())
        pairs.append((a + int((progress >= progress[lowest]).argmax()), a + lowest))
    for a, b, c in zip(corners, corners[1:], corners[2:], strict=False):
        out = a + int(np.linalg.norm(tool[a:b] - tool[c], axis=1).argmin())
        back = b + 1 + int(np.linalg.norm(tool[b + 1 : c + 1] - tool[a], axis=1).argmin())
        pairs += [(out, c), (a, back)]
    for i, j in pairs:
        is_near = np.linalg.norm(tool[i] - tool[j]) <= 2 * deviation
        is_away = np.linalg.norm(tool[i : j + 1] - tool[i], axis=1).max() > 2 * deviation
        if is_near and is_away and abs(q[i] - q[j]).max() <= _SAME_CONFIGURATION:
            return i, j
    return None
