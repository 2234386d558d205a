"""Whole cycles executed by arms that are drawn at random."""

from collections.abc import Callable

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.cycle_stages import cycle_stages
from tubeplanner.simulation.execution import Execution, executed_stages
from tubeplanner.simulation.plant import Draw


def executed_cycle(
    motion: CycleMotion,
    errors: Robustness,
    draw: Draw | None = None,
    checkpoint: Callable[[], None] = lambda: None,
) -> Execution:
    """Return what arms do that a controller moves through a cycle without a break.

    What the tool takes is in it, and what it lets go is gone, from the beginning of the control
    period on in which that is planned; the controller knows of it, and not what it really weighs.

    Args:
        motion: The planned motion.
        errors: Sizes of the errors, and the controller.
        draw: How many arms, and which; None: 50, from seed 0.
        checkpoint: Called in every control period; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
    """
    stages = cycle_stages(motion, errors, draw or Draw())
    controlled = (errors.controller, errors.control_period)
    return executed_stages(stages, motion.trajectory, *controlled, checkpoint)
