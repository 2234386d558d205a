"""A cycle as one HTML page: all moves on one time line, with what happens between them."""

from collections.abc import Sequence

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.errors import OptionError
from tubeplanner.simulation.execution import Execution
from tubeplanner.views.cycle_panel import cycle_panel_data
from tubeplanner.views.cycle_scene import build_cycle_scene
from tubeplanner.views.viewer import View, require_names


def view_cycle(
    cycle: Cycle,
    motions: Sequence[CycleMotion] = (),
    names: Sequence[str] | None = None,
    notes: Sequence[str] = (),
    execution: Execution | None = None,
) -> View:
    """Return a view of a cycle with motions side by side; without any, at its start.

    With an execution, also the paths that the tool took, in another colour outside the tube of the
    move that runs.

    Args:
        cycle: The cycle.
        motions: Of the cycle.
        names: Names of the motions; default: numbers.
        notes: Shown on the page before its own.
        execution: Of the one motion.

    Raises:
        ProblemError: The cycle is none.
        OptionError: There are not as many names as motions, or two are the same; or an execution,
            and not one motion.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    Cycle.require(cycle)
    if names is None:
        names = [f"motion {i + 1}" for i in range(len(motions))]
    require_names(names, len(motions))
    if execution is not None and len(motions) != 1:
        raise OptionError(f"execution goes with one motion, not {len(motions)}; give one")
    scene = build_cycle_scene(cycle, dict(zip(names, motions, strict=True)), notes, execution)
    return View(scene, cycle_panel_data(scene))
