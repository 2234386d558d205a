"""Smooth, certified joint trajectories of a robot arm whose tool stays in a tolerance tube.

Letters used everywhere: N samples, K control points, n joints, m tube segments (m+1 reference
points). Units are SI and radians; positions are in the frame of the URDF's root link.

    problem = load_problem("example:ur5/over_the_wall")
    result = plan(problem)

Data flows one way, through folders that import only those above them: `robot`, `collision`, `tube`,
`problem`, `trajectory`, `verification`, `constraints`, `branches`, `waypoint_search` (phase 1),
`suh_bishop` (phase 2 as published), `refinement` (phase 2), `baselines`, `planning`, `measurement`,
`tube_sources`, `studies`, `files`, `views`, `commands`.

Names are loaded on first use, so that `import tubeplanner` stays quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tubeplanner.collision.obstacle import AttachedSolid as AttachedSolid
    from tubeplanner.collision.obstacle import Obstacle as Obstacle
    from tubeplanner.collision.obstacle import placement_of as placement_of
    from tubeplanner.errors import OptionError as OptionError
    from tubeplanner.errors import OutputError as OutputError
    from tubeplanner.errors import ProblemError as ProblemError
    from tubeplanner.errors import RobotError as RobotError
    from tubeplanner.errors import TrajectoryError as TrajectoryError
    from tubeplanner.errors import TubePlannerError as TubePlannerError
    from tubeplanner.files.trajectory_file import read_trajectory as read_trajectory
    from tubeplanner.measurement.measured_tube import MeasureOptions as MeasureOptions
    from tubeplanner.measurement.measured_tube import SegmentMeasurement as SegmentMeasurement
    from tubeplanner.measurement.measured_tube import TubeMeasurement as TubeMeasurement
    from tubeplanner.measurement.sign_patterns import PatternSurvey as PatternSurvey
    from tubeplanner.measurement.sign_patterns import survey_patterns as survey_patterns
    from tubeplanner.measurement.tube_measurement import measure_tube as measure_tube
    from tubeplanner.outcome import Place as Place
    from tubeplanner.outcome import PlanStatus as PlanStatus
    from tubeplanner.planning.plan_options import PlanOptions as PlanOptions
    from tubeplanner.planning.plan_result import PlanResult as PlanResult
    from tubeplanner.planning.planner import plan as plan
    from tubeplanner.problem.problem import PlanningProblem as PlanningProblem
    from tubeplanner.problem.problem import Seed as Seed
    from tubeplanner.problem.problem_reader import load_problem as load_problem
    from tubeplanner.problem.problem_reader import parse_problem as parse_problem
    from tubeplanner.progress import Progress as Progress
    from tubeplanner.refinement.sensitivities import Sensitivity as Sensitivity
    from tubeplanner.robot.joint_limits import LimitOverrides as LimitOverrides
    from tubeplanner.robot.pinocchio_model import Payload as Payload
    from tubeplanner.robot.pinocchio_model import ToolOffset as ToolOffset
    from tubeplanner.robot.robot_model import RobotModel as RobotModel
    from tubeplanner.robot.robot_model import load_robot as load_robot
    from tubeplanner.studies.comparison import Comparison as Comparison
    from tubeplanner.studies.comparison import ComparisonRow as ComparisonRow
    from tubeplanner.studies.comparison import compare as compare
    from tubeplanner.studies.tolerance_sweep import SweepResult as SweepResult
    from tubeplanner.studies.tolerance_sweep import SweepRow as SweepRow
    from tubeplanner.studies.tolerance_sweep import sweep as sweep
    from tubeplanner.studies.trajectory_measures import TrajectoryMeasures as TrajectoryMeasures
    from tubeplanner.trajectory.joint_trajectory import JointTrajectory as JointTrajectory
    from tubeplanner.tube.tube import Tube as Tube
    from tubeplanner.tube_sources.route import find_route as find_route
    from tubeplanner.tube_sources.route_candidates import RouteOptions as RouteOptions
    from tubeplanner.tube_sources.teach import TeachOptions as TeachOptions
    from tubeplanner.tube_sources.teach import teach as teach
    from tubeplanner.tube_sources.trail import joint_trail as joint_trail
    from tubeplanner.tube_sources.tube_answer import TubeAnswer as TubeAnswer
    from tubeplanner.tube_sources.zones import ZonedPath as ZonedPath
    from tubeplanner.tube_sources.zones import tube_from_zones as tube_from_zones
    from tubeplanner.tube_sources.zones import zones_of_tube as zones_of_tube
    from tubeplanner.verification.certificate import Certificate as Certificate
    from tubeplanner.verification.certificate import JudgedCondition as JudgedCondition
    from tubeplanner.verification.certificate import Tolerance as Tolerance
    from tubeplanner.verification.verification import verify as verify
    from tubeplanner.views.comparison_plot import plot_comparison as plot_comparison
    from tubeplanner.views.plotting import plot_trajectory as plot_trajectory
    from tubeplanner.views.study_plots import plot_convergence as plot_convergence
    from tubeplanner.views.study_plots import plot_sweep as plot_sweep
    from tubeplanner.views.viewer import View as View
    from tubeplanner.views.viewer import view as view
    from tubeplanner.waypoint_search.branch_and_bound import SearchStatistics as SearchStatistics
    from tubeplanner.waypoint_search.waypoint_interpolation import quartic_spline as quartic_spline
    from tubeplanner.waypoint_search.waypoint_interpolation import (
        sequential_quartics as sequential_quartics,
    )

__version__ = "0.1.0"

_HOMES = {
    "collision.obstacle": ("AttachedSolid", "Obstacle", "placement_of"),
    "errors": (
        "OptionError",
        "OutputError",
        "ProblemError",
        "RobotError",
        "TrajectoryError",
        "TubePlannerError",
    ),
    "files.trajectory_file": ("read_trajectory",),
    "measurement.measured_tube": ("MeasureOptions", "SegmentMeasurement", "TubeMeasurement"),
    "measurement.sign_patterns": ("PatternSurvey", "survey_patterns"),
    "measurement.tube_measurement": ("measure_tube",),
    "trajectory.joint_trajectory": ("JointTrajectory",),
    "outcome": ("Place", "PlanStatus"),
    "planning.plan_options": ("PlanOptions",),
    "planning.plan_result": ("PlanResult",),
    "planning.planner": ("plan",),
    "problem.problem": ("PlanningProblem", "Seed"),
    "problem.problem_reader": ("load_problem", "parse_problem"),
    "progress": ("Progress",),
    "refinement.sensitivities": ("Sensitivity",),
    "robot.joint_limits": ("LimitOverrides",),
    "robot.pinocchio_model": ("Payload", "ToolOffset"),
    "robot.robot_model": ("RobotModel", "load_robot"),
    "studies.comparison": ("Comparison", "ComparisonRow", "compare"),
    "studies.trajectory_measures": ("TrajectoryMeasures",),
    "studies.tolerance_sweep": ("SweepResult", "SweepRow", "sweep"),
    "tube.tube": ("Tube",),
    "tube_sources.route": ("find_route",),
    "tube_sources.route_candidates": ("RouteOptions",),
    "tube_sources.teach": ("TeachOptions", "teach"),
    "tube_sources.trail": ("joint_trail",),
    "tube_sources.tube_answer": ("TubeAnswer",),
    "tube_sources.zones": ("ZonedPath", "tube_from_zones", "zones_of_tube"),
    "verification.certificate": ("Certificate", "JudgedCondition", "Tolerance"),
    "verification.verification": ("verify",),
    "views.comparison_plot": ("plot_comparison",),
    "views.plotting": ("plot_trajectory",),
    "views.study_plots": ("plot_convergence", "plot_sweep"),
    "views.viewer": ("View", "view"),
    "waypoint_search.branch_and_bound": ("SearchStatistics",),
    "waypoint_search.waypoint_interpolation": ("quartic_spline", "sequential_quartics"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted([*_HOME_OF, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'tubeplanner' has no attribute '{name}'")
    return getattr(import_module(f"tubeplanner.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return __all__
