"""What is known of a trajectory at other speeds than its own: found when it is asked for."""

from functools import cached_property

from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.braking import Braking, worst_braking
from tubeplanner.verification.slower_runs import SlowerRun, tightest_slower_run


class OtherSpeeds:
    """A trajectory run slower, and brought to rest. Certificates are many: those who read it pay.

    So it is where they travel: what is pickled or copied can be asked there.
    """

    def __init__(self, robot: RobotModel, trajectory: JointTrajectory, tolerance: float) -> None:
        """Take a trajectory in the robot's joint order, and by how much limits may be exceeded."""
        self._given = (robot, trajectory, tolerance)

    @cached_property
    def slower(self) -> SlowerRun | None:
        """The tightest slower run, as `tightest_slower_run`."""
        return tightest_slower_run(*self._given[:2])

    @cached_property
    def braking(self) -> Braking | None:
        """How it comes to rest, as `worst_braking`."""
        return worst_braking(*self._given)
