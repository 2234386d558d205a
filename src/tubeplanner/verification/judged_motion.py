"""A trajectory that is judged, and what several conditions need to know of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.trajectory.directed_stretches import DirectedStretches, directed_stretches
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.tube.tube import Tube
from tubeplanner.verification.directed_efforts import DirectedEfforts, directed_efforts
from tubeplanner.verification.enclosed_efforts import enclosed_efforts
from tubeplanner.verification.enclosed_pose import EnclosedPose, enclosed_pose, enclosed_tool
from tubeplanner.verification.enclosure import Enclosure
from tubeplanner.verification.judged_condition import Tolerance
from tubeplanner.verification.segment_margins import MarginMaker
from tubeplanner.verification.tube_visits import Visit, tube_visits

# How closely efforts are enclosed, as a share of their limits: tighter than the certificate's
# tolerance, so that the planner may use most of it.
EFFORT_ENCLOSURE = 1e-8
_STILL_SHARE = 1e-6  # a joint slower than this share of the fastest counts as standing still
# How closely the tool is enclosed [m]: tighter than the certificate's tolerance, so that the
# planner may use most of it.
_TOOL_ENCLOSURE = 1e-7
# Where the rotation is judged too: an error of the tool is one of its reference orientation.
_POSE_ENCLOSURE, _ROTATION_ENCLOSURE = 1e-8, 1e-9


@dataclass(frozen=True, eq=False)
class JudgedMotion:
    """A problem, a trajectory, and what follows from both; computed once, when it is asked for.

    Attributes:
        problem: Its neighbouring segments on one line joined.
        trajectory: In the robot's joint order.
        tolerance: How far below zero margins may lie.
        further: What further conditions segments ask, as for `segment_margins`.
    """

    problem: PlanningProblem
    trajectory: JointTrajectory
    tolerance: Tolerance
    further: tuple[MarginMaker, ...] = ()

    @property
    def robot(self) -> RobotModel:
        """The arm."""
        return self.problem.robot

    @property
    def tube(self) -> Tube:
        """Where its tool may be."""
        return self.problem.tube

    @cached_property
    def pose(self) -> EnclosedPose | None:
        """The tool's path and orientation, if the tube bounds the orientation."""
        if self.tube.rotation is None:
            return None
        return enclosed_pose(self.robot, self.trajectory, _POSE_ENCLOSURE, _ROTATION_ENCLOSURE)

    @cached_property
    def tool(self) -> Enclosure:
        """The path of the tool centre point, c = 3 [m]."""
        if self.pose is not None:
            return self.pose.tool
        return enclosed_tool(self.robot, self.trajectory, _TOOL_ENCLOSURE)

    @property
    def rotation(self) -> Enclosure | None:
        """The tool's rotation matrix, c = 9, if the tube bounds it."""
        return None if self.pose is None else self.pose.rotation

    @cached_property
    def visits(self) -> list[Visit]:
        """The trajectory's share of each segment that it visits."""
        known = (self.problem, self.trajectory, self.tool, self.rotation)
        return tube_visits(*known, self.further)

    @cached_property
    def stretches(self) -> DirectedStretches:
        """When joints move which way."""
        return directed_stretches(self.trajectory)

    @cached_property
    def smooth_efforts(self) -> Enclosure:
        """The joint efforts without Coulomb friction, c = n [N m or N]."""
        most = np.minimum(self.robot.limits.effort, self.robot.motors.saturation_effort)
        return enclosed_efforts(self.robot, self.trajectory, EFFORT_ENCLOSURE * most)

    def efforts_of(self, joints: IntArray) -> DirectedEfforts:
        """Return the efforts of some joints, shape (k,), with Coulomb friction."""
        known = (self.robot, self.trajectory, self.smooth_efforts, self.stretches)
        return directed_efforts(*known, joints)

    @cached_property
    def largest_rates(self) -> dict[int, FloatArray]:
        """The largest velocity (1) and acceleration (2) of each joint by order, each (n,).

        In rad/s and rad/s^2, or with m. A joint that all but stands still is measured by the
        others: its own rounding errors are not jumps.
        """
        found = {}
        for order in (1, 2):
            coefficients = self.trajectory.derivative_coefficients(order)
            largest = peak_magnitudes(coefficients, self.trajectory.widths).value
            overall = float(largest.max())
            found[order] = np.maximum(largest, _STILL_SHARE * overall if overall > 0 else 1.0)
        return found

    def piece_ends(self, order: int) -> FloatArray:
        """Return a derivative at the start and the end of every piece, shape (2, pieces, n)."""
        coefficients = self.trajectory.derivative_coefficients(order)
        powers = np.arange(len(coefficients) - 1, -1, -1)
        widths = self.trajectory.widths[None, :] ** powers[:, None]
        return np.array([coefficients[-1], np.einsum("kpn,kp->pn", coefficients, widths)])

    def position_unit(self, joint: str) -> str:
        """Return the unit of a joint's position."""
        return "rad" if self.robot.revolute[self.robot.joint_names.index(joint)] else "m"

    def segment_number(self, segment: int, time: float) -> int:
        """Return what messages call a segment; where parts are joined, the one at a time [s]."""
        tool = self.robot.tool_position(self.trajectory.position(time)[None])[0]
        return self.tube.segment_number(segment, tool)

    def place_in_segment(self, segment: int, time: float) -> Place:
        """Return the place at a time [s], with the segment as messages call it."""
        return Place(time=time, segment=self.segment_number(segment, time))
