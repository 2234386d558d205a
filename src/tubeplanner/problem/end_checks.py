"""What a problem's start and goal must keep: position limits, joint ranges, and their segments."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import MARGIN_TOLERANCE, ContradictionError, Place
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube


@dataclass(frozen=True, eq=False)
class EndChecks:
    """Checks of start and goal; each raises a `ContradictionError` with its place.

    Attributes:
        robot: The arm.
        tube: The tube; messages name its segments.
        joined: The same, neighbouring segments that ask the same joined to one.
        lower: Lower bounds of joints, by limits and ranges, shape (m, n) [rad or m].
        upper: Upper bounds, likewise.
    """

    robot: RobotModel
    tube: Tube
    joined: Tube
    lower: FloatArray
    upper: FloatArray

    def require_within_limits(self, what: str, q: FloatArray) -> None:
        """Raise unless a configuration (n,), called `what`, is inside position limits."""
        limits = self.robot.limits
        low, high = (
            limits.lower_position - MARGIN_TOLERANCE,
            limits.upper_position + MARGIN_TOLERANCE,
        )
        for joint in np.flatnonzero((q < low) | (q > high)):
            name = self.robot.joint_names[joint]
            raise ContradictionError(
                f"{what}: joint '{name}' at {q[joint]:g} is outside its "
                f"position limits [{limits.lower_position[joint]:g}, "
                f"{limits.upper_position[joint]:g}] (radians and metres are meant)",
                Place(joint=name),
                configuration=q,
            )

    def require_inside(self, end: str, q: FloatArray, segment: int) -> None:
        """Raise unless a configuration (n,) keeps what its segment asks of joints and tool."""
        number = self.tube.segment_number(segment)
        lower, upper = self.lower[segment], self.upper[segment]
        rotation, tool = self.robot.tool_pose(q[None])
        for name, value, low, high in zip(self.robot.joint_names, q, lower, upper, strict=True):
            if not low - MARGIN_TOLERANCE <= value <= high + MARGIN_TOLERANCE:
                raise ContradictionError(
                    f"{end}: joint '{name}' at {value:g} is outside [{low:g}, {high:g}], its "
                    f"position limits and joint sign in segment {number}",
                    Place(joint=name, segment=number).at(tool[0]),
                    configuration=q,
                )
        try:
            self.require_tool_inside(end, rotation, tool, segment)
        except ContradictionError as error:
            raise ContradictionError(str(error), error.place, configuration=q) from error

    def require_tool_inside(
        self, end: str, rotation: FloatArray, tool: FloatArray, segment: int
    ) -> None:
        """Raise unless a tool (1, 3, 3), (1, 3) is in its segment's region and turned as asked."""
        self.require_in_region(end, f"{end}: the tool", tool[0], segment)
        self._require_turned(end, rotation, tool, self.tube.segment_number(segment))

    def require_in_region(self, end: str, what: str, tool: FloatArray, segment: int) -> None:
        """Raise unless a tool position (3,), called `what`, is in the region of a segment."""
        margin = float(self.joined.margin(tool[None])[0, 0 if end == "start" else -1])
        if margin < -MARGIN_TOLERANCE:
            point = self.tube.points[segment + (end == "goal")]
            region = "box" if self.tube.is_box[segment] else "capsule"
            number = self.tube.segment_number(segment)
            raise ContradictionError(
                f"{what} is at {np.round(tool, 4).tolist()} m, {-margin:.3g} m outside "
                f"the {region} of segment {number} (its end point is "
                f"{point.tolist()} m); move the {end} or the reference point",
                self._place_of(end, number, tool),
            )

    def _require_turned(
        self, end: str, rotation: FloatArray, tool: FloatArray, number: int
    ) -> None:
        """Raise unless a tool is within the rotation tolerance of a segment called by a number."""
        tube, joined = self.joined.rotation, 0 if end == "start" else -1
        if tube is None or tube.margin(rotation, tool, joined)[0] >= -MARGIN_TOLERANCE:
            return
        error = tube.error(rotation, tool, joined)[0]
        turned = [*error.tolist(), float(np.linalg.norm(error))]
        worst = int((abs(np.array(turned)) - tube.bounds[joined]).argmax())
        about = "" if worst == 3 else f" about {'xyz'[worst]} of the reference orientation"
        raise ContradictionError(
            f"{end}: the tool is turned by {turned[worst]:.4g} rad{about}, where the rotation "
            f"tolerance of segment {number} is {tube.bounds[joined, worst]:.4g} rad; turn the "
            f"{end}, change tube.orientations[{number + (end == 'goal')}] or widen "
            f"tube.rotation_tolerance[{number}]",
            self._place_of(end, number, tool[0]),
        )

    def _place_of(self, end: str, number: int, tool: FloatArray) -> Place:
        """Return the place of an end whose segment has a number, the tool at a point (3,)."""
        point = self.tube.numbers[0 if end == "start" else -1]
        return Place(segment=number, point=int(point)).at(tool)
