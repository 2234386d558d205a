"""The output files of a plan.

What draws is imported when a figure or page is asked for: it loads parts of SciPy that plans do
without.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import require_page
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.export import require_no_formula
from tubeplanner.files.output_files import require_writable
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.figure_files import figure_file, require_figure


@dataclass(frozen=True)
class PlanOutputs:
    """The output files of a plan.

    Attributes:
        files: With the trajectory.
        plot: With a figure (PNG, PDF or SVG); None: none.
        html: With a page; likewise.
    """

    files: TrajectoryFiles
    plot: Path | None
    html: Path | None

    def paths(self) -> list[tuple[str, Path]]:
        """Return the requested files: kind and path."""
        asked = {
            "trajectory": self.files.json,
            "CSV": self.files.csv,
            "ROS": self.files.ros,
            "plot": self.plot,
            "view": self.html,
        }
        return [(kind, path) for kind, path in asked.items() if path is not None]

    def require_usable(self, *inputs: str | Path) -> None:
        """Raise if a file could not be written, before any work is done."""
        require_figure(self.plot, "--plot")
        require_page(self.html)
        require_writable([path for _, path in self.paths()], [Path(path) for path in inputs])

    def require_names(self, joint_names: Sequence[str]) -> None:
        """Raise if a file cannot hold the names of the joints, before any work is done."""
        if self.files.csv is not None:
            require_no_formula(joint_names)

    def write(
        self, problem: PlanningProblem, method: str, trajectory: JointTrajectory
    ) -> tuple[str, ...]:
        """Write all files, or none of them; return notes about them."""
        contents, notes = self.files.contents(trajectory, problem, method)
        if self.plot:
            from tubeplanner.views.plotting import plot_trajectory

            contents[self.plot] = figure_file(plot_trajectory(problem, trajectory), self.plot)
        if self.html:
            from tubeplanner.views.viewer import view as view_scene

            contents[self.html] = view_scene(problem, trajectory, names=[method]).html.encode()
        write_answer(contents)
        return notes

    def write_cycle(self, method: str, motion: CycleMotion) -> tuple[str, ...]:
        """Write all files of a cycle's motion, or none of them; return notes about them."""
        contents, notes = cycle_contents(self.files, motion, method)
        if self.plot:
            from tubeplanner.views.cycle_plot import plot_cycle

            contents[self.plot] = figure_file(plot_cycle(motion.cycle, motion), self.plot)
        if self.html:
            from tubeplanner.views.cycle_view import view_cycle

            contents[self.html] = view_cycle(motion.cycle, [motion], [method]).html.encode()
        write_answer(contents)
        return notes
