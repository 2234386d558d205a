"""JudgedCondition: margin, location, coverage; JudgedMotion: quantities common to conditions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.enclosed_quantities import (
    EnclosedPose,
    enclosed_efforts,
    enclosed_pose,
    enclosed_tool,
)
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.certificate.segment_margins import MarginMaker
from tubeplanner.certificate.tube_visits import Visit, telling_visits, tube_visits
from tubeplanner.checks import NUMBER
from tubeplanner.errors import OptionError, shown
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import MARGIN_TOLERANCE, Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import MonotoneIntervals, monotone_intervals
from tubeplanner.trajectory.polynomials import peak_magnitudes

# ---- A condition of a certificate: margin, location, coverage.

FOR_ALL_TIMES = "for all t"
RELATIVE = "relative"
# Bounds farther apart than this, absolute [m] and as a fraction of the margin, are undecided.
_UNDECIDED_LENGTH, _UNDECIDED_FRACTION = 1e-6, 0.05


@dataclass(frozen=True)
class Tolerance:
    """The largest violation that counts as none: a margin may lie this far below zero.

    Attributes:
        absolute: For margins in m, rad and s, >= 0.
        relative: For relative margins, >= 0.
    """

    absolute: float = MARGIN_TOLERANCE
    relative: float = MARGIN_TOLERANCE

    def __post_init__(self) -> None:
        for name in ("absolute", "relative"):
            value = getattr(self, name)
            if not (isinstance(value, NUMBER) and 0 <= value < 1):
                raise OptionError(f"tolerance: {name} is {shown(value)}, not in [0, 1)")

    def of(self, unit: str) -> float:
        """Return the tolerance of margins with a unit."""
        return self.relative if unit == RELATIVE else self.absolute


# For trajectories made elsewhere: rounded numbers, samples.
FOREIGN_TOLERANCE = Tolerance(1e-4, 1e-3)


@dataclass(frozen=True)
class JudgedCondition:
    """A judged condition of a certificate.

    Attributes:
        margin: Distance to a violation: negative where violated, None where the condition does not
            apply.
        unit: "m", "rad" or "relative"; "s" where a cycle rests.
        where: Location of the smallest margin.
        coverage: "for all t", and whether that is undecided because bounds stayed apart; or why
            there is no margin; or what was compared.
    """

    margin: float | None
    unit: str
    where: Location
    coverage: str

    @property
    def shown_margin(self) -> str:
        """The margin in messages, with its unit."""
        unit = "" if self.unit == RELATIVE else f" {self.unit}"
        return f"margin {self.margin:.3g}{unit}"

    def holds(self, tolerance: Tolerance) -> bool:
        """Return True if the condition holds or does not apply."""
        return self.margin is None or self.margin >= -tolerance.of(self.unit)

    def as_dict(self, tolerance: Tolerance) -> dict[str, Any]:
        """Return the condition as JSON values, judged with a tolerance."""
        return {
            "margin": self.margin,
            "unit": self.unit,
            "satisfied": self.holds(tolerance),
            "where": self.where.as_dict(),
            "coverage": self.coverage,
        }


def not_required(unit: str, reason: str) -> JudgedCondition:
    """Return a condition that does not apply."""
    return JudgedCondition(None, unit, Location(), reason)


def bracketed(margin: float, attained: float, unit: str, where: Location) -> JudgedCondition:
    """Return a condition that holds for all t, undecided if its bounds are far apart.

    The margin is a lower bound; the trajectory has the attained margin, in the same unit.
    """
    allowed = max(_UNDECIDED_LENGTH, _UNDECIDED_FRACTION * abs(attained))
    coverage = FOR_ALL_TIMES if margin >= attained - allowed else undecided(attained, unit)
    return JudgedCondition(margin, unit, where, coverage)


def undecided(attained: float, unit: str) -> str:
    """Return the coverage of a margin whose bounds are far apart."""
    return f"{FOR_ALL_TIMES}, undecided: the margin found is {attained:.3g} {unit}"


# ---- A judged trajectory, and the quantities that several conditions share.

# Errors of enclosures are tighter than the certificate's tolerance, so that the planner may use
# most of that: of efforts as a fraction of their limits, of the tool [m].
EFFORT_ENCLOSURE = 1e-8
_TOOL_ENCLOSURE = 1e-7
_STILL_FRACTION = 1e-6  # a joint slower than this fraction of the fastest counts as standing still
# Where the rotation is judged too: an error of the tool is one of its reference orientation.
_POSE_ENCLOSURE, _ROTATION_ENCLOSURE = 1e-8, 1e-9


@dataclass(frozen=True, eq=False)
class JudgedMotion:
    """A problem, a trajectory, and quantities of both, each computed once at its first use."""

    problem: PlanningProblem  # with neighbouring segments on the same line joined
    trajectory: JointTrajectory  # in the robot's joint order
    tolerance: Tolerance  # largest violation that counts as none
    # makers of further margins of segments, as for `segment_margins`
    further: tuple[MarginMaker, ...] = ()
    # True: visits are the `telling_visits`; False: those with the largest margins
    is_telling: bool = False

    @property
    def robot(self) -> RobotModel:
        """The arm."""
        return self.problem.robot

    @property
    def tube(self) -> Tube:
        """The tube of the problem."""
        return self.problem.tube

    @cached_property
    def pose(self) -> EnclosedPose | None:
        """The tool's path and orientation; None if the tube leaves the orientation free."""
        if self.tube.rotation is None:
            return None
        tolerances = _POSE_ENCLOSURE, _ROTATION_ENCLOSURE
        return enclosed_pose(self.robot, self.tube, self.trajectory, *tolerances)

    @cached_property
    def tool(self) -> Enclosure:
        """The path of the tool centre point, c = 3 [m]."""
        if self.pose is not None:
            return self.pose.tool
        return enclosed_tool(self.robot, self.tube, self.trajectory, _TOOL_ENCLOSURE)

    @property
    def rotation(self) -> Enclosure | None:
        """The tool's rotation matrix, c = 9; None if the tube leaves the rotation free."""
        return None if self.pose is None else self.pose.rotation

    @cached_property
    def visits(self) -> list[Visit]:
        """The visits of segments, in the order of time."""
        visits = telling_visits if self.is_telling else tube_visits
        return visits(self.problem, self.trajectory, self.tool, self.rotation, self.further)

    @cached_property
    def intervals(self) -> MonotoneIntervals:
        """The intervals in which joints move without reversal, and their directions."""
        return monotone_intervals(self.trajectory)

    @cached_property
    def smooth_efforts(self) -> Enclosure:
        """The joint efforts without Coulomb friction, c = n [N m or N]."""
        most = np.minimum(self.robot.limits.effort, self.robot.motors.saturation_effort)
        return enclosed_efforts(self.robot, self.trajectory, EFFORT_ENCLOSURE * most)

    @cached_property
    def largest_rates(self) -> dict[int, FloatArray]:
        """The largest velocity (1) and acceleration (2) of each joint by order, each (n,).

        In rad/s and rad/s^2, or with m. The rates of a joint that nearly stands still are raised to
        a fraction of the others', so that its rounding errors are no jumps.
        """
        rates = {}
        for order in (1, 2):
            coefficients = self.trajectory.derivative_coefficients(order)
            largest = peak_magnitudes(coefficients, self.trajectory.widths).value
            overall = float(largest.max())
            rates[order] = np.maximum(largest, _STILL_FRACTION * overall if overall > 0 else 1.0)
        return rates

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
        """Return a segment's number in messages; of joined segments, the part at a time [s]."""
        tool = self.robot.tool_position(self.trajectory.position(time)[None])[0]
        return self.tube.segment_number(segment, tool)

    def location_in_segment(self, segment: int, time: float) -> Location:
        """Return the location at a time [s], with the segment's number in messages."""
        return Location(time=time, segment=self.segment_number(segment, time))
