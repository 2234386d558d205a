"""Whether a trajectory goes through a tube: which segment it is in at which instant.

Of all visits of the segments in order, those are taken whose least margin is greatest. The
margin of an instant in a segment is the least of that of the capsule or box [m], of the joints'
signs or ranges [rad, m], of the rotation tolerance [rad], of the tool's speed and
acceleration (relative) and of the links' clearance [m], if that is not the same in all; at a
switching time both segments' count. Where segments have a least speed, the tool passes into them
behind the plane through the first point of their stretch, and out of them beyond that through its
last one; how far it is there counts under the tube [m].
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from outside.arm import Arm
from outside.trajectory import Samples, Trajectory
from outside.tube_fields import TubeFields, box_margin

State = tuple[int, bool, bool]
CONDITIONS = ("tube", "joint_signs", "rotation", "tool_speed", "tool_acceleration", "clearance")
NEAR = 1e-3  # [m, rad, relative]: steps beside a smaller margin are looked at again, divided
PARTS = 20  # into so many
BESIDE = 1e-5  # [s] by which velocities are apart whose difference is an acceleration
MAX_LOOKS_BETWEEN = 4
MAX_ROUNDS = 40  # of dividing the steps where the least margin is; each gains a factor of 20
MAX_WORST = 20  # samples with the same least margin: a tool may go on at its limit
SETTLED = 1e-9  # [m, rad, relative] by which a round must change the least margin
BROKEN = -1e-6  # [m, rad, relative]: below it no visits keep all conditions
MarginAt = Callable[[Samples], np.ndarray]  # of N samples in m segments, (N, m)


@dataclass(frozen=True, eq=False)
class Visits:
    """Which segments are the current ones when.

    Attributes:
        samples: Instants, shape (N,).
        rows: Of these, in order; one at which segments change is there with both, shape (V,).
        segments: The segment of each, shape (V,).
    """

    samples: Samples
    rows: np.ndarray
    segments: np.ndarray

    def current(self, samples: Samples, count: int) -> np.ndarray:
        """Return which of so many segments are current at samples: bool, shape (N, count).

        Between two of the visits' samples that is the segment of the one before.
        """
        time = self.samples.time[self.rows]
        first = np.searchsorted(time, samples.time, side="left")
        last = np.searchsorted(time, samples.time, side="right") - 1
        found = np.zeros((len(samples), count), dtype=bool)
        for k, (low, high) in enumerate(zip(np.minimum(first, last), last, strict=True)):
            found[k, self.segments[low : high + 1]] = True
        return found


def ordered_visits(
    least: np.ndarray,
    inside: dict[int, np.ndarray] | None = None,
    gates: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return samples and segments of the ordered visits whose least margin is greatest.

    A state is a segment and whether the points at its two ends have been passed, if they must be.
    value[state][k] is the best least margin of visits that are in it at sample k. They came from
    the sample before in the same state, or at this sample from the segment before, or by passing a
    point. Into a segment, the margin at its gate counts.
    """
    inside, count = inside or {}, least.shape[1]
    value: dict[State, list[float]] = {}
    for state in _states(count, inside):
        ways = [(value[source], gate) for source, gate in _before(state, inside, gates)]
        entries = [math.inf] + [-math.inf] * (len(least) - 1)
        if ways:
            both = [np.minimum(row, np.inf if gate is None else gate) for row, gate in ways]
            entries = np.max(both, axis=0).tolist()
        row, last = [], -math.inf
        for margin, entry in zip(least[:, state[0]].tolist(), entries, strict=True):
            last = min(margin, max(last, entry))
            row.append(last)
        value[state] = row
    k, state = len(least) - 1, (count - 1, True, True)
    visits = [(k, state[0])]
    while k > 0 or _before(state, inside, gates):
        stays = value[state][k - 1] if k > 0 else -math.inf
        entered = [
            (min(value[source][k], math.inf if gate is None else gate[k]), source)
            for source, gate in _before(state, inside, gates)
        ]
        enters, source = max(entered, key=lambda one: one[0], default=(-math.inf, state))
        k, state = (k - 1, state) if k > 0 and stays >= enters else (k, source)
        visits.append((k, state[0]))
    rows, segments = np.array(visits[::-1]).T
    return rows, segments


def union_visits(
    least: np.ndarray, inside: None = None, gates: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return samples and, for each, the segment whose margin is greatest; any may be entered."""
    return np.arange(len(least)), least.argmax(axis=1)


@dataclass(frozen=True)
class Least:
    """A condition's least margin; infinite where it is not asked.

    Attributes:
        margin: [m or rad], or relative.
        time: When [s].
        segment: In which segment.
        joint: Index of the joint, for signs and ranges.
        point: Index of the point, for those to be passed.
    """

    margin: float = math.inf
    time: float = 0.0
    segment: int = 0
    joint: int | None = None
    point: int | None = None


def judge_tube(
    tube: TubeFields,
    arm: Arm,
    trajectory: Trajectory,
    samples: Samples,
    clearance: MarginAt | None = None,
) -> tuple[dict[str, Least], Visits]:
    """Return the least margins of `CONDITIONS` on the best visits of the segments, and these.

    Where none keep all of them, they are the best for the first of them that can be kept, so
    that the blame falls on the one that cannot.

    Args:
        tube: What is asked.
        arm: Whose trajectory it is.
        trajectory: Of the arm's joints.
        samples: Where to begin looking; steps are divided where margins are small.
        clearance: What the links' clearance is in all segments, if not the same in all.
    """
    for count in range(len(CONDITIONS), 0, -1):
        counted = CONDITIONS[:count]
        found, visits = _on_best_visits(tube, arm, trajectory, samples, counted, clearance)
        if min(found[name].margin for name in counted) >= BROKEN:
            break
    return found, visits


def rotation_error(
    tube: TubeFields, rotation: np.ndarray, position: np.ndarray, segment: int
) -> np.ndarray:
    """Return log(R_ref^T R) of tools in a segment, shape (N, 3) [rad].

    The reference turns from one point's orientation to the next, the short way, in proportion to
    the distance along the segment; it is taken at the point of the segment nearest to the tool.

    Args:
        tube: It has orientations.
        rotation: Of the tool centre point, shape (N, 3, 3).
        position: Likewise, shape (N, 3) [m].
        segment: Index.
    """
    assert tube.orientations is not None
    begin, end = (Rotation.from_quat(tube.orientations[segment + k]) for k in (0, 1))
    turn = (begin.inv() * end).as_rotvec()
    fraction, _ = _nearest(tube.points, position, segment)
    reference = begin * Rotation.from_rotvec(fraction[:, None] * turn)
    return (reference.inv() * Rotation.from_matrix(rotation)).as_rotvec()


def distance(points: np.ndarray, position: np.ndarray, segment: int) -> np.ndarray:
    """Return how far positions (N, 3) are from a segment of reference points, shape (N,) [m]."""
    return _nearest(points, position, segment)[1]


def region_margin(tube: TubeFields, position: np.ndarray, segment: int) -> np.ndarray:
    """Return how far positions (N, 3) are inside a segment's capsule or box, shape (N,) [m]."""
    section = None if tube.sections is None else tube.sections[segment]
    if section is None:
        margin: np.ndarray = tube.radius[segment] - distance(tube.points, position, segment)
        return margin
    begin, end = tube.points[segment : segment + 2]
    return box_margin(begin, end, section, tube.tool_radius, position)


def tool_rate(arm: Arm, trajectory: Trajectory, samples: Samples, name: str) -> np.ndarray:
    """Return the tool's speed [m/s] or acceleration [m/s^2] at samples, shape (N,).

    The acceleration is that of the joints' parabola: a difference of velocities beside.
    """
    q, v, a = (trajectory.at(samples, order) for order in range(3))
    if name == "tool_speed":
        rate = arm.tool_velocity(q, v)
    else:
        sides = (step * BESIDE for step in (1, -1))
        after, before = (arm.tool_velocity(q + (v + a * s / 2) * s, v + a * s) for s in sides)
        rate = (after - before) / (2 * BESIDE)
    size: np.ndarray = np.linalg.norm(rate, axis=1)
    return size


def judge_points(
    tube: TubeFields,
    arm: Arm,
    trajectory: Trajectory,
    samples: Samples,
    clearance: MarginAt | None = None,
) -> Least:
    """Return the least margin of all points that must be passed, each at its best instant.

    An instant counts while one of the two segments beside the point is the current one. Other
    visits than the best are looked at if these miss a point; not if they break another condition.
    """
    if not tube.passing:
        return Least()

    def margins_at(where: Samples) -> tuple[np.ndarray, dict[int, np.ndarray], np.ndarray]:
        q = trajectory.at(where)
        tool = arm.tool(q)[1]
        inside = {
            k: min(tube.radius[k - 1 : k + 1]) - np.linalg.norm(tool - tube.points[k], axis=1)
            for k in tube.passing
        }
        margins = _margins(tube, arm, trajectory, where, CONDITIONS, clearance)
        least = margins.least
        if not tube.is_ordered:
            beside = {k: np.maximum(least[:, k - 1], least[:, k]) for k in inside}
            inside = {k: np.minimum(margin, beside[k]) for k, margin in inside.items()}
        return least, inside, margins.gates

    least, inside, gates = margins_at(samples)
    windows = dict.fromkeys(tube.passing, (0, len(samples) - 1))
    if tube.is_ordered:
        windows = _windows(least, inside, gates)
    found = []
    for k, (low, high) in windows.items():
        best = low + int(inside[k][low : high + 1].argmax())
        finer = samples.between(np.arange(max(best - 1, low), min(best + 1, high)), PARTS**2)
        around = margins_at(finer)[1][k]
        here = Least(float(inside[k][best]), float(samples.time[best]), point=k)
        if len(around) and around.max() > here.margin:
            here = Least(float(around.max()), float(finer.time[around.argmax()]), point=k)
        found.append(here)
    return min(found, key=_margin)


def _states(count: int, inside: dict[int, np.ndarray]) -> list[State]:
    """Return all states, each after those that lead to it."""
    return [
        (s, first, last)
        for s in range(count)
        for first in ((False, True) if s in inside else (True,))
        for last in ((False, True) if s + 1 in inside else (True,))
    ]


def _before(
    state: State, inside: dict[int, np.ndarray], gates: np.ndarray | None
) -> list[tuple[State, np.ndarray | None]]:
    """Return the states that lead to one, and the margin of what is passed on the way."""
    s, first, last = state
    found: list[tuple[State, np.ndarray | None]] = []
    if s > 0 and last == (s + 1 not in inside):  # what lies ahead is passed later
        found.append(((s - 1, True, first), None if gates is None else gates[:, s]))
    if first and s in inside:
        found.append(((s, False, last), inside[s]))
    if last and s + 1 in inside:
        found.append(((s, first, False), inside[s + 1]))
    return found


@dataclass(frozen=True, eq=False)
class _Margins:
    """Margins of N samples in m segments, each (N, m); the worst joint likewise.

    `counted` are those by which the visits are chosen.
    """

    counted: tuple[str, ...]

    tube: np.ndarray
    joint_signs: np.ndarray
    rotation: np.ndarray
    tool_speed: np.ndarray
    tool_acceleration: np.ndarray
    clearance: np.ndarray
    joint: np.ndarray
    gates: np.ndarray  # where each segment may be entered

    @property
    def least(self) -> np.ndarray:
        least: np.ndarray = np.min([getattr(self, name) for name in self.counted], axis=0)
        return least


def _on_best_visits(
    tube: TubeFields,
    arm: Arm,
    trajectory: Trajectory,
    samples: Samples,
    counted: tuple[str, ...],
    clearance: MarginAt | None,
) -> tuple[dict[str, Least], Visits]:
    """Return the least margins of all conditions on the best visits for some, and these."""

    def margins_at(where: Samples, segments: np.ndarray | None = None) -> _Margins:
        return _margins(tube, arm, trajectory, where, counted, clearance, segments)

    choose = ordered_visits if tube.is_ordered else union_visits
    margins, found = margins_at(samples), dict.fromkeys(CONDITIONS, Least())
    for _ in range(MAX_LOOKS_BETWEEN):
        samples, margins = _confirmed(choose, samples, margins, margins_at)
        rows, segments = choose(margins.least, gates=margins.gates)
        visits, found = Visits(samples, rows, segments), _least_on(margins, samples, rows, segments)
        between = _between(samples, rows, segments, margins, margins_at)
        worst, least = (min((e[n] for n in counted), key=_margin) for e in (between, found))
        found = {name: min(found[name], between[name], key=_margin) for name in CONDITIONS}
        if worst.margin > least.margin - SETTLED:
            break
        at = int(np.searchsorted(samples.time, worst.time))
        new = samples.between(np.array([at - 2, at - 1, at]), PARTS)
        samples, margins = _with(samples, margins, new, margins_at(new))
    return found, visits


def _confirmed(
    choose: Callable[..., tuple[np.ndarray, np.ndarray]],
    samples: Samples,
    margins: "_Margins",
    margins_at: Callable[..., "_Margins"],
) -> tuple[Samples, "_Margins"]:
    """Return more samples, where the least margin is and at tight switching times.

    A switching time may be a single instant, at which a joint whose sign changes is at zero.
    """
    before, times_alike = math.inf, 0
    for _ in range(MAX_ROUNDS):
        rows, segments = choose(margins.least, gates=margins.gates)
        values = np.minimum(margins.least[rows, segments], _at_gates(margins, rows, segments))
        times_alike = times_alike + 1 if abs(values.min() - before) < SETTLED else 0
        if times_alike == 2:
            break
        before = values.min()
        switches = np.diff(segments, prepend=segments[0]) != 0
        worst = rows[values == before][:MAX_WORST]
        tight = np.concatenate([worst, rows[switches & (values < NEAR)]])
        new = samples.between(np.concatenate([tight - 1, tight]), PARTS)
        if len(new) == 0:
            break
        samples, margins = _with(samples, margins, new, margins_at(new))
    return samples, margins


def _at_gates(margins: "_Margins", rows: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Return the margin at the gate wherever visits enter a segment, infinite elsewhere [m]."""
    entered = np.diff(segments, prepend=segments[0]) > 0
    values: np.ndarray = np.where(entered, margins.gates[rows, segments], math.inf)
    return values


def _margin(least: Least) -> float:
    return least.margin


def _nearest(
    points: np.ndarray, position: np.ndarray, segment: int
) -> tuple[np.ndarray, np.ndarray]:
    begin, along = points[segment], points[segment + 1] - points[segment]
    square = max(float(along @ along), 1e-300)  # a segment of no length is a ball
    fraction = np.clip((position - begin) @ along / square, 0, 1)
    return fraction, np.linalg.norm(position - begin - fraction[:, None] * along, axis=1)


def _margins(
    tube: TubeFields,
    arm: Arm,
    trajectory: Trajectory,
    samples: Samples,
    counted: tuple[str, ...],
    clearance: MarginAt | None,
    segments: np.ndarray | None = None,
) -> _Margins:
    """Return the margins of N samples in all segments, (N, m), or in one per sample, (N, 1)."""
    q, count = trajectory.at(samples), len(tube.radius)
    rotation, position = arm.tool(q)
    own = np.full(count, math.inf) if tube.acceleration is None else tube.acceleration
    limits = {
        "tool_speed": np.minimum(tube.speed, arm.limits.tool_speed),
        "tool_acceleration": np.minimum(own, arm.limits.tool_acceleration),
    }
    reached = {
        name: tool_rate(arm, trajectory, samples, name) if np.isfinite(limit).any() else 0 * q[:, 0]
        for name, limit in limits.items()
    }
    shape = (len(q), count if segments is None else 1)
    free = np.full((len(CONDITIONS), *shape), math.inf)
    gates = free[0].copy()
    if segments is None and tube.is_ordered:
        gates = tube.gates(position)
    found = _Margins(counted, *free, np.zeros(shape, dtype=int), gates)
    if clearance is not None:
        every = clearance(samples)
        own = every if segments is None else every[np.arange(len(q)), segments][:, None]
        found.clearance[:] = own
    for k in range(count):
        rows = np.arange(len(q)) if segments is None else np.flatnonzero(segments == k)
        column = k if segments is None else 0
        if len(rows) == 0:
            continue
        found.tube[rows, column] = region_margin(tube, position[rows], k)
        if tube.orientations is not None and tube.bounds is not None:
            error = rotation_error(tube, rotation[rows], position[rows], k)
            sizes = np.hstack([abs(error), np.linalg.norm(error, axis=1, keepdims=True)])
            found.rotation[rows, column] = (tube.bounds[k] - sizes).min(axis=1)
        for name, limit in limits.items():
            if np.isfinite(limit[k]):
                getattr(found, name)[rows, column] = 1 - reached[name][rows] / limit[k]
        if tube.floor is not None and tube.floor[k] > 0:
            above = reached["tool_speed"][rows] / tube.floor[k] - 1
            found.tool_speed[rows, column] = np.minimum(found.tool_speed[rows, column], above)
        for name, (lower, upper) in tube.ranges[k].items():
            joint = arm.joint_names.index(name)
            inside = np.minimum(q[rows, joint] - lower, upper - q[rows, joint])
            closer = rows[inside < found.joint_signs[rows, column]]
            found.joint[closer, column] = joint
            found.joint_signs[rows, column] = np.minimum(found.joint_signs[rows, column], inside)
    return found


def _windows(
    least: np.ndarray, inside: dict[int, np.ndarray], gates: np.ndarray
) -> dict[int, tuple[int, int]]:
    """Return the first and the last sample in the two segments beside each point."""
    ways = [ordered_visits(least, each, gates) for each in (None, inside)]
    windows = []
    for rows, segments in ways:
        beside = {k: rows[(segments == k - 1) | (segments == k)] for k in inside}
        windows.append({k: (int(found[0]), int(found[-1])) for k, found in beside.items()})
    missed = any(inside[k][a : b + 1].max() < 0 for k, (a, b) in windows[0].items())
    usual, other = (float(least[visits].min()) for visits in ways)
    return windows[1] if missed and other >= min(usual, BROKEN) else windows[0]


def _least_on(
    margins: _Margins, samples: Samples, rows: np.ndarray, segments: np.ndarray
) -> dict[str, Least]:
    found = {}
    for name in CONDITIONS:
        values = getattr(margins, name)[rows, segments]
        at = int(values.argmin())
        joint = int(margins.joint[rows[at], segments[at]]) if name == "joint_signs" else None
        where = float(samples.time[rows[at]]), int(segments[at])
        found[name] = Least(float(values[at]), *where, joint) if values[at] < math.inf else Least()
    entered = _at_gates(margins, rows, segments)
    if (worst := float(entered.min())) < found["tube"].margin:
        at, point = int(entered.argmin()), int(segments[entered.argmin()])
        found["tube"] = Least(worst, float(samples.time[rows[at]]), point, point=point)
    return found


def _between(
    samples: Samples,
    rows: np.ndarray,
    segments: np.ndarray,
    margins: _Margins,
    margins_at: Callable[..., _Margins],
) -> dict[str, Least]:
    """Return the least margins inside the steps of visits that have a small margin at an end."""
    is_near = margins.least[rows, segments] < NEAR
    steps = (is_near[:-1] | is_near[1:]) & (segments[:-1] == segments[1:])
    segment_after = np.zeros(len(samples), dtype=int)
    segment_after[rows[:-1][steps]] = segments[:-1][steps]
    inner = samples.between(rows[:-1][steps], PARTS)
    if len(inner) == 0:
        return dict.fromkeys(CONDITIONS, Least())
    owner = np.searchsorted(samples.time, inner.time, side="left") - 1
    inner_segments = segment_after[owner]
    found = margins_at(inner, inner_segments)
    least = _least_on(found, inner, np.arange(len(inner)), np.zeros(len(inner), dtype=int))
    at = {name: int(getattr(found, name)[:, 0].argmin()) for name in CONDITIONS}
    return {
        name: Least(one.margin, one.time, int(inner_segments[at[name]]), one.joint)
        for name, one in least.items()
    }


def _with(
    samples: Samples, margins: _Margins, new: Samples, more: _Margins
) -> tuple[Samples, _Margins]:
    joined = samples.joined(new)
    order = np.lexsort(
        (np.concatenate([samples.local, new.local]), np.concatenate([samples.piece, new.piece]))
    )
    names = (*CONDITIONS, "joint", "gates")
    values = (np.concatenate([getattr(margins, n), getattr(more, n)])[order] for n in names)
    return joined, _Margins(margins.counted, *values)
