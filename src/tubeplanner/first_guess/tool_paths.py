"""Joint paths along a curve of the tool: lines, arcs at corners."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, elementwise

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.first_guess.inverse_kinematics import WantedRotation, solve_position
from tubeplanner.first_guess.segment_walk import explain_error
from tubeplanner.first_guess.upright import upright_cone
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Curves that the tool follows along a polyline: its lines, and arcs in place of its corners.

_STRAIGHT, _BACK = 1e-6, 1e-3  # [rad]: smaller turns need no arc, turns nearer to pi allow none
_MIN_LENGTH = 1e-9  # [m]
# Arcs stay away from the wall by this fraction of the radius: the arm follows them only closely.
_KEPT_FRACTION = 1e-3


@dataclass(frozen=True, eq=False)
class ToolCurve:
    """A curve of P lines and arcs that join with the same direction."""

    start: FloatArray  # start of each piece, shape (P, 3) [m]
    direction: FloatArray  # direction of the tool there, unit vectors, shape (P, 3)
    # towards the centre of an arc, unit vectors, shape (P, 3); anything for a line
    normal: FloatArray
    curvature: FloatArray  # shape (P,) [1/m], 0 for a line
    # length of the curve up to the ends of its pieces, shape (P+1,), from 0 [m]
    arc_lengths: FloatArray
    # length of the polyline up to the same points, shape (P+1,) [m]
    polyline_arc_lengths: FloatArray

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(self.arc_lengths[-1])

    def point(self, arc_length: FloatArray) -> FloatArray:
        """Return the points (N, 3) [m] at arc lengths (N,) from 0 to the length."""
        piece = np.clip(
            np.searchsorted(self.arc_lengths, arc_length, "right") - 1, 0, len(self.start) - 1
        )
        local = (arc_length - self.arc_lengths[piece])[:, None]
        half = self.curvature[piece, None] * local / (2 * np.pi)
        forward = local * np.sinc(2 * half)  # sin(c s) / c
        sideways = np.pi * half * local * np.sinc(half) ** 2  # (1 - cos(c s)) / c
        return self.start[piece] + forward * self.direction[piece] + sideways * self.normal[piece]


def rounded_polyline(points: FloatArray, radius: FloatArray | None) -> list[ToolCurve]:
    """Return a polyline whose corners are cut by arcs, as curves between stops.

    Arcs are at most `radius` (m,) from the lines that they join [m]; None: no arcs, the tool stops
    at every point (m+1, 3).

    Returns:
        One curve from stop to stop. Stops are where no arc is possible: where a line doubles back.
    """
    lines = np.diff(points, axis=0)
    length = np.linalg.norm(lines, axis=1)
    direction = lines / length[:, None]
    count = len(lines)
    bend = np.array([_angle(a, b) for a, b in pairwise(direction)])
    cut = np.zeros(count + 1)  # length of both lines that each corner's arc replaces
    if radius is not None:
        for k in range(1, count):
            if _STRAIGHT < bend[k - 1] < np.pi - _BACK:
                available = min(length[k - 1] / (1 + (k > 1)), length[k] / (1 + (k + 1 < count)))
                bends = _arc_radius((1 - _KEPT_FRACTION) * radius[k - 1 : k + 1], bend[k - 1])
                cut[k] = min(bends * np.tan(bend[k - 1] / 2), available)
    is_passed = (cut[1:-1] > 0) | (bend <= _STRAIGHT) & (radius is not None)
    stops = [0, *(np.flatnonzero(~is_passed) + 1).tolist(), count]
    before = arc_lengths(points)
    return [_between_stops(points, before, cut, a, b) for a, b in pairwise(stops)]


def _angle(a: FloatArray, b: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _arc_radius(allowed: FloatArray, bend: float) -> float:
    """Return the largest radius of an arc that stays near its two lines.

    After a turn by p, the arc is away(p) radii from the line that it leaves, and away(turn - p)
    radii from the line that it joins. Where it is best counted to the other line, both distances
    are at their bounds.
    """
    corner = 1 / np.cos(bend / 2)  # radii from the centre to where the lines meet

    def away(p: float) -> float:
        if np.sin(p) <= np.tan(bend / 2):
            return float(1 - np.cos(p))
        return float(np.sqrt(1 + corner**2 - 2 * corner * np.cos(p - bend / 2)))  # past its end

    change = brentq(lambda p: allowed[0] * away(bend - p) - allowed[1] * away(p), 0.0, bend)
    return float(allowed[0] / away(change))


def _between_stops(
    points: FloatArray, before: FloatArray, cut: FloatArray, first: int, last: int
) -> ToolCurve:
    """Return the curve between two points of a polyline."""
    rows: list[tuple[FloatArray, FloatArray, FloatArray, float, float, float]] = []
    for k in range(first, last):
        line = points[k + 1] - points[k]
        length = float(np.linalg.norm(line))
        direction = line / length
        before_line, after_line = cut[k] if k > first else 0.0, cut[k + 1] if k + 1 < last else 0.0
        straight = length - before_line - after_line
        if straight > _MIN_LENGTH:
            start = points[k] + before_line * direction
            rows.append((start, direction, direction, 0.0, straight, straight))
        if after_line > 0:
            start = points[k + 1] - after_line * direction
            following = points[k + 2] - points[k + 1]
            after = following / np.linalg.norm(following)
            bend = _angle(direction, after)
            sideways = after - (after @ direction) * direction
            curvature = float(np.tan(bend / 2) / after_line)
            normal = sideways / np.linalg.norm(sideways)
            rows.append((start, direction, normal, curvature, bend / curvature, 2 * after_line))
    starts, directions, normals, curvatures, lengths, polyline = zip(*rows, strict=True)
    return ToolCurve(
        np.array(starts),
        np.array(directions),
        np.array(normals),
        np.array(curvatures),
        np.concatenate([[0.0], np.cumsum(lengths)]),
        before[first] + np.concatenate([[0.0], np.cumsum(polyline)]),
    )


# ---- The arm along a curve of its tool: a path in joint space, by inverse kinematics.

CURVE_TOLERANCE = 1e-6  # [m] between the tool and its curve
_MAX_ROUNDS, _MAX_NODES = 12, 2000  # of halving the steps that leave the curve
# Configurations nearer to each other than this fraction of the arc length carry rounding errors, no
# shape.
_APART = 1e-5
# A tool that moves less stands still [m]; joints that move as much meanwhile [rad or m] would have
# to turn a sharp corner, where only a stop helps.
_STILL, _TURNED = 1e-6, 1e-3
_AT_END = 1e-9  # [m]
# Newton's method doubles the digits with every step.
_NEWTON_STEPS, _NEWTON_ROUNDING = 8, 1e-13
_PROBES = (0.25, 0.5, 0.75)  # of every step


@dataclass(frozen=True, eq=False)
class ToolPath:
    """A path in joint space whose tool is on a curve."""

    # cubics, C2, over the arc length in joint space [rad or m], at about unit speed
    joints: JointTrajectory
    curve: ToolCurve
    segment: int  # number, for messages, of the tube's segment in which it begins


def tool_paths(problem: PlanningProblem, branch: ReferenceBranch, *, arcs: bool) -> list[ToolPath]:
    """Return the arm's paths along the tool's lines between the reference points of a branch.

    Arcs inside the tube cut corners; without arcs, the tool stops there.

    Returns:
        The paths from stop to stop.

    Raises:
        Infeasible: There is nothing to move, or the tool cannot follow its lines and arcs.
    """
    route = _route(problem, branch)
    length = np.linalg.norm(np.diff(route, axis=0), axis=1)
    moves = length > _STILL
    for k in branch.moving_segments:
        if not moves[k]:
            raise _standstill(k)
    if not moves.any():
        message = "the start is the goal: there is nothing to move"
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
    radius = problem.tube.effective_radius[moves] if arcs else None
    curves = rounded_polyline(route[np.append(True, moves)], radius)
    return [_Follower(problem, branch, curve).path() for curve in curves]


def arc_lengths_on_line(robot: RobotModel, line: ToolPath, distance: FloatArray) -> FloatArray:
    """Return the joint-space arc lengths (N,) of the tool's distances (N,) along its line [m]."""
    arc_lengths = np.where(distance > _AT_END, line.joints.duration, 0.0)
    inner = np.flatnonzero((distance > _AT_END) & (distance < line.curve.length - _AT_END))
    if len(inner):
        solution = _by_newton(robot, line, distance[inner])
        slow = inner[np.isnan(solution)]
        arc_lengths[inner] = solution
        if len(slow):
            arc_lengths[slow] = _by_bracketing(robot, line, distance[slow])
    return arc_lengths


def _by_newton(robot: RobotModel, line: ToolPath, distance: FloatArray) -> FloatArray:
    """Return the arc lengths (N,) of distances inside a line; NaN where Newton's steps fail.

    They fail where the tool is slow for its joints, near a singular configuration.
    """
    start, direction = line.curve.start[0], line.curve.direction[0]
    end = line.joints.duration
    arc_length = distance / line.curve.length * end
    step = np.full(len(distance), np.nan)
    for _ in range(_NEWTON_STEPS):
        tool, jacobian = robot.tool_jacobian(line.joints.position(arc_length))
        slope = line.joints.velocity(arc_length)
        gain = np.einsum("nij,nj,i->n", jacobian[:, :3], slope, direction)
        excess = (tool - start) @ direction - distance
        step = np.divide(excess, gain, out=np.full_like(gain, np.nan), where=gain > 0)
        arc_length = arc_length - step
        arc_length[(arc_length < 0) | (arc_length > end)] = np.nan
        if not (abs(step) > _NEWTON_ROUNDING * end).any():  # NaN is done, too
            break
    arc_length[~(abs(step) <= _NEWTON_ROUNDING * end)] = np.nan
    return arc_length


def _by_bracketing(robot: RobotModel, line: ToolPath, distance: FloatArray) -> FloatArray:
    """Return the arc lengths (N,) of distances inside a line, however slow the tool is there."""
    start, direction = line.curve.start[0], line.curve.direction[0]

    def excess(arc_length: FloatArray, distance: FloatArray) -> FloatArray:
        tool = robot.tool_position(line.joints.position(arc_length))
        return (tool - start) @ direction - distance

    ends = (np.zeros(len(distance)), np.full(len(distance), line.joints.duration))
    arc_lengths: FloatArray = elementwise.find_root(excess, ends, args=(distance,)).x
    return arc_lengths


def _route(problem: PlanningProblem, branch: ReferenceBranch) -> FloatArray:
    """Return the tool's positions at the ends of a branch's segments, shape (m+1, 3) [m]."""
    ends = [branch.start, *(q[-1] for q in branch.segments)]
    return problem.robot.tool_position(np.array(ends))


class _Follower:
    """Configurations with the tool on a curve; rows of tables are (*configuration, arc length).

    The branch's configurations are moved to the curve and joined by a cubic spline over their
    distances; steps that leave the curve at probes are halved.
    """

    def __init__(self, problem: PlanningProblem, branch: ReferenceBranch, curve: ToolCurve) -> None:
        self._problem, self._branch, self._curve = problem, branch, curve
        self._route = _route(problem, branch)
        self._before = arc_lengths(self._route)
        is_lost = problem.holding and upright_cone(problem, branch.start[None]) is not None
        self._keeps_rotation = problem.rotation is not None or is_lost

    def path(self) -> ToolPath:
        # A table of the branch's configurations beside the curve.
        first, last = self._curve.polyline_arc_lengths[[0, -1]]
        rows = []
        for k, q in enumerate(self._branch.segments):
            begin, end = self._before[k : k + 2]
            if begin < first - CURVE_TOLERANCE or end > last + CURVE_TOLERANCE or begin == end:
                continue
            direction = (self._route[k + 1] - self._route[k]) / (end - begin)
            arc_length = (self._problem.robot.tool_position(q) - self._route[k]) @ direction
            travel = abs(np.diff(q, axis=0)).max(axis=1)
            if ((np.diff(arc_length) < _STILL) & (travel > _TURNED)).any():
                raise _standstill(self._number(k))
            rows.append(np.column_stack([q, begin + np.clip(arc_length, 0.0, end - begin)]))
        table = np.vstack(rows)
        table[:, -1] = np.interp(
            table[:, -1], self._curve.polyline_arc_lengths, self._curve.arc_lengths
        )
        table = _apart(self._on_curve(table))
        for _ in range(_MAX_ROUNDS):
            spline = CubicSpline(arc_lengths(table[:, :-1]), table)
            x = spline.x
            within = x[:-1, None] + np.diff(x)[:, None] * _PROBES
            probes = spline(within.ravel())
            tool = self._problem.robot.tool_position(probes[:, :-1])
            target = self._curve.point(np.clip(probes[:, -1], 0.0, self._curve.length))
            off = np.linalg.norm(tool - target, axis=1).reshape(within.shape).max(axis=1)
            steps = np.flatnonzero(off > CURVE_TOLERANCE)
            if len(steps) == 0:
                names = self._problem.robot.joint_names
                joints = JointTrajectory(names, spline.x, spline.c[:, :, :-1])
                first = self._segment(self._curve.arc_lengths[1:2] / 2)[0]
                return ToolPath(joints, self._curve, self._number(int(first)))
            if len(table) > _MAX_NODES:
                break
            middle = spline((spline.x[steps] + spline.x[steps + 1]) / 2)
            table = _apart(np.insert(table, steps + 1, self._on_curve(middle), axis=0))
        at = table[off.argmax(), -1:]
        k = self._number(int(self._segment(at)[0]), self._curve.point(at)[0])
        raise Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"segment {k}: a spline through {len(table)} configurations leaves the tool's curve by "
            f"{off.max():.3g} m: a singular configuration is in the way; move the reference points",
            Location(segment=k),
        )

    def _segment(self, arc_length: FloatArray) -> IntArray:
        """Return the tube's segments (N,) to which arc lengths (N,) on the curve belong."""
        polyline = np.interp(arc_length, self._curve.arc_lengths, self._curve.polyline_arc_lengths)
        return np.searchsorted(self._before[1:-1], polyline)

    def _number(self, segment: int, tool: FloatArray | None = None) -> int:
        return self._problem.tube.segment_number(segment, tool)

    def _on_curve(self, table: FloatArray) -> FloatArray:
        """Return a table with its tools moved onto the curve, orientation kept if it matters."""
        problem, result, rotation = self._problem, table.copy(), None
        if self._keeps_rotation:
            rotation, _ = problem.robot.tool_pose(table[:, :-1])
        points, segments = self._curve.point(table[:, -1]), self._segment(table[:, -1])
        for i, (point, k) in enumerate(zip(points, segments, strict=True)):
            seed, bounds = table[i, :-1], (problem.joint_lower[k], problem.joint_upper[k])
            target = None
            if rotation is not None:
                target = WantedRotation(rotation[i])
            solution = solve_position(problem.robot, point, seed, *bounds, rotation=target)
            if solution.error > CURVE_TOLERANCE:
                reason = explain_error(problem, point, seed, int(k), solution)
                location = Location(segment=self._number(int(k), point)).at(point)
                raise Infeasible(PlanStatus.UNREACHABLE, f"{location}: {reason}", location)
            result[i, :-1] = solution.q
        return result


def _standstill(segment: int) -> Infeasible:
    return Infeasible(
        PlanStatus.NO_TRAJECTORY,
        f"segment {segment}: joints have to move where the tool stands still, which no scheme that "
        "is led by the tool can; leave the goal open, or give one that the line leads to",
        Location(segment=segment),
    )


def _apart(table: FloatArray) -> FloatArray:
    """Return a table without configurations that almost equal their predecessors."""
    lengths = arc_lengths(table[:, :-1])
    apart = _APART * lengths[-1]
    rows = [0]
    for i in range(1, len(table) - 1):
        if min(lengths[i] - lengths[rows[-1]], lengths[-1] - lengths[i]) > apart:
            rows.append(i)
    return table[[*rows, len(table) - 1]]
