"""What the limits in a file say, as the robot takes them."""

from tubeplanner.problem.problem_format import LimitFields
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.point_speed import PointSpeed


def limits_of(fields: LimitFields) -> LimitOverrides:
    """Return the limits that fields give.

    Raises:
        RobotError: A number is out of its bounds.
    """
    points = tuple(PointSpeed(**point.model_dump()) for point in fields.point_speed)
    return LimitOverrides(**(fields.model_dump() | {"point_speed": points}))
