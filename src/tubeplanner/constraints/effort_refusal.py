"""Why a motor is too weak for an arm at rest, or moved slowly."""

from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.outcome import Infeasible, Place, PlanStatus


def effort_refusal(
    at: PathSamples,
    sample: int,
    joint: int,
    needed: float,
    limit: float,
    *,
    mass: float | None = None,
    proved: bool = False,
) -> Infeasible:
    """Return that a joint cannot hold what it carries, or move it, however slowly.

    Args:
        at: The path.
        sample: Where on it.
        joint: Which joint.
        needed: Size of its effort at rest or at low speed [N m or N].
        limit: The most that its motor has there, in that direction [N m or N].
        mass: The heaviest payload that all joints hold there [kg]; None: not known.
        proved: As of `Infeasible`.
    """
    robot = at.problem.robot
    name, unit = robot.joint_names[joint], "N m" if robot.revolute[joint] else "N"
    has_friction = robot.motors.backwards_friction[joint] or robot.motors.forwards_friction[joint]
    against = "gravity and friction" if has_friction else "gravity alone"
    lighten = "lighten the payload" if mass is None else f"carry at most {mass:.3g} kg"
    return Infeasible(
        PlanStatus.GRAVITY_EXCEEDS_EFFORT,
        f"joint '{name}' needs {needed:.2f} {unit} against {against}, its effort limit is "
        f"{limit:.2f}; {lighten}, choose another configuration or a motor with "
        f"{needed - limit:.3g} {unit} more (robot.limits.effort.{name})",
        Place(joint=name).at(at.tool_pose[1][sample]),
        proved=proved,
        configuration=at.position[sample],
    )
