"""What the limits and motors in a file say, as the robot takes them."""

from tubeplanner.problem.limit_fields import LimitFields, MotorFields
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.motor_overrides import MotorOverrides
from tubeplanner.robot.point_speed import PointSpeed


def limits_of(fields: LimitFields) -> LimitOverrides:
    """Return the limits that fields give.

    Raises:
        RobotError: A number is out of its bounds.
    """
    points = tuple(PointSpeed(**point.model_dump()) for point in fields.point_speed)
    return LimitOverrides(**(fields.model_dump() | {"point_speed": points}))


def motors_of(fields: MotorFields) -> MotorOverrides:
    """Return the motors that fields give.

    Raises:
        RobotError: A number is out of its bounds.
    """
    return MotorOverrides(**fields.model_dump())
