"""A part of a motion that is judged under one problem: all of it, or a leg of a cycle."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.closest_pairs import ClosestPairs, closest_pairs
from tubeplanner.constraints.limit_use import LimitUses, limit_uses, samples_per_piece
from tubeplanner.constraints.motor_effort import motor_effort
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.point_speed import PointSpeedLimit
from tubeplanner.constraints.time_scaling import scaling_factor
from tubeplanner.constraints.tool_speed import ToolSpeed
from tubeplanner.constraints.tube_membership import current_segments, tube_use
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.tube.tube import Tube

_MAX_LABELS = 8
_MAX_MARKED = 24  # segments one by one; more of them as groups, of which each has a label


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of a motion under one problem.

    Attributes:
        problem: The problem.
        trajectory: Of its joints, in their order, from time zero.
        begin: When it begins in the whole motion [s].
    """

    problem: PlanningProblem
    trajectory: JointTrajectory
    begin: float = 0.0

    @cached_property
    def uses(self) -> LimitUses:
        """How much of its limits it uses."""
        return limit_uses(self.problem, self.trajectory)

    @cached_property
    def closest(self) -> list[ClosestPairs]:
        """Its closest pairs at the times of `uses`."""
        return closest_pairs(self.problem, self.trajectory, self.uses.samples.time)

    def inside(self, time: FloatArray) -> IntArray:
        """Return which of the times (K,) [s] of the whole motion are in it."""
        late = time > self.begin + self.trajectory.duration * (1 + 1e-12)
        return np.flatnonzero((time >= self.begin) & ~late)

    def nearest(self, time: FloatArray) -> IntArray:
        """Return the samples of `uses` nearest to times (K,) of its own [s]."""
        own = self.uses.samples.time
        later = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
        return later - (time - own[later - 1] < own[later] - time)


@dataclass(frozen=True, eq=False)
class TrajectoryCurves:
    """What there is to draw of a trajectory, at N samples, both sides of every breakpoint.

    Attributes:
        problem: The planning problem.
        samples: Times, positions, velocities, accelerations.
        jerk: Shape (N, n) [rad/s^3 or m/s^3].
        effort: Shape (N, n) [N m or N].
        effort_rate: Shape (N, n) [N m/s or N/s]; None where no joint's is limited.
        tool: Shape (N, 3) [m].
        speed: Of the tool, shape (N,) [m/s].
        speed_limit: Its limit in that segment, shape (N,) [m/s]; inf where there is none.
        points: Speeds of the points that limits name, as shares of these, shape (N, P).
        segment: The tube segment of each sample, shape (N,).
        tube_use: The tool's distance from the segment as a share of its radius, or of the nearest
            half side of its box, shape (N,).
        rotation_use: The same of the rotation tolerance; None where there is none.
    """

    problem: PlanningProblem
    samples: TrajectorySamples
    jerk: FloatArray
    effort: FloatArray
    effort_rate: FloatArray | None
    tool: FloatArray
    speed: FloatArray
    speed_limit: FloatArray
    points: FloatArray
    segment: IntArray
    tube_use: FloatArray
    rotation_use: FloatArray | None

    @property
    def visits(self) -> list[tuple[int, float, float]]:
        """The visits of groups of segments in turn: group, begin and end [s].

        A group is `segments_per_group` segments: of hundreds, nothing could be seen one by one.
        """
        time, group = self.samples.time, self.segment // self.segments_per_group
        ends = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(time) - 1]
        return [(int(group[a]), float(time[a]), float(time[b])) for a, b in pairwise(ends)]

    @cached_property
    def factor(self) -> FloatArray:
        """How many times faster each sample could be run, jerk left out, shape (N,)."""
        at = self.samples
        known = (at.position, at.velocity, at.acceleration)
        return scaling_factor(self.problem, *known, segment=self.segment)

    @property
    def segments_per_group(self) -> int:
        """How many segments one after the other are marked as one."""
        return segments_per_group(self.problem.tube.segment_count)


def trajectory_curves(problem: PlanningProblem, trajectory: JointTrajectory) -> TrajectoryCurves:
    """Return what there is to draw of a trajectory of the problem's joints, in their order."""
    robot, tube = problem.robot, problem.tube
    count = samples_per_piece(trajectory)
    samples = trajectory.per_piece(count)
    q, v, a = samples.position, samples.velocity, samples.acceleration
    rotation, tool, jacobian = robot.tool_pose_jacobian(q)
    segment = current_segments(problem, trajectory, samples)
    turned = None
    if tube.rotation is not None:
        error = tube.rotation.error(rotation, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        turned = (np.hstack([abs(error), angle]) / tube.rotation.bounds[segment]).max(axis=1)
    rate, jerk = None, trajectory.jerk_per_piece(count)
    if np.isfinite(robot.limits.effort_rate).any():
        rate = effort_rate(robot, q, v, a, jerk)
    known = PathSamples(problem, np.stack([q, v, a]))
    return TrajectoryCurves(
        problem,
        samples,
        jerk,
        motor_effort(robot, trajectory, samples),
        rate,
        tool,
        np.linalg.norm(np.einsum("nij,nj->ni", jacobian[:, :3], v), axis=1),
        ToolSpeed(problem).limit[segment],
        PointSpeedLimit(robot.limits.point_speed).used(known).at(1.0),
        segment,
        tube_use(problem, tool, segment),
        turned,
    )


def segments_per_group(count: int) -> int:
    """Return how many of so many segments are marked as one: a round number, 1 of a few."""
    if count <= _MAX_MARKED:
        return 1
    steps = (digit * 10**power for power in range(9) for digit in (1, 2, 5))
    return next(step for step in steps if -(-count // step) <= _MAX_LABELS)


def size_of(tube: Tube, k: int) -> str:
    """Return what views call the effective size of a segment: its radius, or its box's sides."""
    if tube.cross_section is None or not tube.is_box[k]:
        return f"{1000 * tube.effective_radius[k]:.3g} mm"
    width, height = 1000 * (tube.cross_section[k, :2] - 2 * tube.tool_radius)
    return f"{width:.3g} x {height:.3g} mm"
