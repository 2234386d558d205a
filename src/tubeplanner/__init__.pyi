"""The public names, by the sections in which the reference lists them.

The one list of them: read when a name is first used, by type checkers, and for the reference.
Of what is marked as returned, nobody needs the arguments: the reference leaves them out.
"""

# Plan and judge
from .planning.planner import plan as plan
from .planning.planner import Planner as Planner
from .planning.plan_options import PlanOptions as PlanOptions
from .planning.plan_result import PlanResult as PlanResult  # returned
from .outcome import PlanStatus as PlanStatus
from .outcome import Place as Place
from .refinement.sensitivities import Sensitivity as Sensitivity
from .waypoint_search.branch_and_bound import SearchStatistics as SearchStatistics
from .constraints.trajectory_peaks import trajectory_peaks as trajectory_peaks
from .constraints.trajectory_peaks import TrajectoryPeaks as TrajectoryPeaks  # returned
from .constraints.trajectory_peaks import Peak as Peak  # returned
from .progress import Progress as Progress
from .verification.verification import verify as verify
from .verification.certificate import Certificate as Certificate
from .verification.judged_condition import JudgedCondition as JudgedCondition
from .verification.judged_condition import Tolerance as Tolerance
from .verification.braking import Braking as Braking  # returned
from .verification.slower_runs import SlowerRun as SlowerRun  # returned

# Robot
from .robot.robot_loader import load_robot as load_robot
from .robot.robot_model import RobotModel as RobotModel  # returned
from .robot.pinocchio_model import ToolOffset as ToolOffset
from .robot.base_pose import BasePose as BasePose
from .robot.pinocchio_model import Payload as Payload
from .robot.limit_overrides import LimitOverrides as LimitOverrides
from .robot.motor_overrides import MotorOverrides as MotorOverrides
from .robot.point_speed import PointSpeed as PointSpeed
from .robot.limit_layers import LimitLayer as LimitLayer  # returned
from .problem.presets import read_preset as read_preset
from .problem.moveit_limits import read_limits_file as read_limits_file

# Problem
from .problem.problem_reader import load_problem as load_problem
from .problem.problem_reader import parse_problem as parse_problem
from .problem.problem import PlanningProblem as PlanningProblem
from .problem.problem import Seed as Seed
from .problem.contact import Contact as Contact
from .problem.goal_region import GoalRegion as GoalRegion
from .problem.tool_pose import ToolPose as ToolPose
from .problem.objective import Objective as Objective
from .tube.tube import Tube as Tube
from .collision.obstacle import Obstacle as Obstacle
from .collision.obstacle import AttachedSolid as AttachedSolid
from .collision.obstacle import placement_of as placement_of

# Trajectory
from .trajectory.joint_trajectory import JointTrajectory as JointTrajectory
from .trajectory.trajectory_file import read_trajectory as read_trajectory
from .constraints.time_scaling import scaling_factor as scaling_factor
from .waypoint_search.waypoint_interpolation import sequential_quartics as sequential_quartics
from .waypoint_search.waypoint_interpolation import quartic_spline as quartic_spline

# Cycle
from .cycle.cycle_reader import load_cycle as load_cycle
from .cycle.cycle_reader import parse_cycle as parse_cycle
from .cycle.cycle import Cycle as Cycle
from .cycle.steps import Move as Move
from .cycle.steps import Event as Event
from .cycle.steps import Attach as Attach
from .cycle.steps import Detach as Detach
from .cycle_planning.cycle_planner import plan_cycle as plan_cycle
from .cycle_planning.cycle_result import CycleResult as CycleResult  # returned
from .cycle_planning.cycle_result import CycleSensitivity as CycleSensitivity  # returned
from .cycle.cycle_motion import CycleMotion as CycleMotion
from .cycle.motion_of_file import read_cycle_motion as read_cycle_motion
from .files.cycle_writer import write_cycle_motion as write_cycle_motion
from .trajectory.marks import Mark as Mark
from .verification.cycle_verification import verify_cycle as verify_cycle
from .verification.cycle_certificate import CycleCertificate as CycleCertificate  # returned

# Tubes from what you have
from .measurement.tube_measurement import measure_tube as measure_tube
from .measurement.measured_tube import MeasureOptions as MeasureOptions
from .measurement.measured_tube import TubeMeasurement as TubeMeasurement  # returned
from .measurement.measured_tube import SegmentMeasurement as SegmentMeasurement  # returned
from .measurement.sign_patterns import survey_patterns as survey_patterns
from .measurement.sign_patterns import PatternSurvey as PatternSurvey  # returned
from .tube_sources.teach import teach as teach
from .tube_sources.teach import TeachOptions as TeachOptions
from .tube_sources.trail import joint_trail as joint_trail
from .tube_sources.route import find_route as find_route
from .tube_sources.route_candidates import RouteOptions as RouteOptions
from .tube_sources.tube_answer import TubeAnswer as TubeAnswer  # returned
from .tube_sources.zones import tube_from_zones as tube_from_zones
from .tube_sources.zones import zones_of_tube as zones_of_tube
from .tube_sources.zones import ZonedPath as ZonedPath  # returned

# Why not, and how much room
from .explanation.explain import explain as explain
from .explanation.explanation import Explanation as Explanation  # returned
from .explanation.remedy import Remedy as Remedy  # returned
from .explanation.remedy import Room as Room  # returned

# Many plans
from .many.plan_many import plan_many as plan_many
from .many.plan_many import PlannedItem as PlannedItem  # returned
from .many.dask_executor import dask_executor as dask_executor
from .many.posed_problem import PosedProblem as PosedProblem
from .many.worker_processes import WorkerProcesses as WorkerProcesses
from .many.worker_processes import WorkerDied as WorkerDied
from .studies.tolerance_sweep import sweep as sweep
from .studies.tolerance_sweep import SweepResult as SweepResult  # returned
from .studies.tolerance_sweep import SweepRow as SweepRow
from .studies.field_sweep import sweep_field as sweep_field
from .studies.field_sweep import FieldSweep as FieldSweep  # returned
from .studies.field_sweep import FieldRow as FieldRow  # returned
from .studies.study_reader import load_study as load_study
from .studies.study import Study as Study
from .studies.study_run import run_study as run_study
from .studies.study_result import StudyResult as StudyResult  # returned
from .studies.study_row import StudyRow as StudyRow  # returned
from .studies.placement import place as place
from .studies.placement import PlaceOptions as PlaceOptions
from .studies.placement_result import Placement as Placement  # returned
from .studies.placement_result import GivenStand as GivenStand  # returned
from .studies.placement_row import PlacementRow as PlacementRow  # returned
from .studies.placement_region import Stand as Stand  # returned
from .studies.comparison import compare as compare
from .studies.comparison import Comparison as Comparison  # returned
from .studies.comparison import ComparisonRow as ComparisonRow  # returned
from .studies.trajectory_measures import TrajectoryMeasures as TrajectoryMeasures  # returned

# Executed
from .problem.robustness import Robustness as Robustness
from .simulation.plant import drawn_plants as drawn_plants
from .simulation.plant import Draw as Draw
from .simulation.plant import Plant as Plant  # returned
from .simulation.execution import executed as executed
from .simulation.execution import Execution as Execution  # returned
from .simulation.judged_runs import judged_runs as judged_runs
from .simulation.judged_runs import JudgedRun as JudgedRun  # returned
from .simulation.cycle_execution import executed_cycle as executed_cycle
from .simulation.judged_cycle import judged_cycle as judged_cycle
from .simulation.judged_cycle import JudgedCycle as JudgedCycle  # returned
from .simulation.handover_errors import HandoverErrors as HandoverErrors  # returned
from .simulation.run_verdict import run_verdict as run_verdict
from .simulation.run_verdict import RunVerdict as RunVerdict  # returned
from .simulation.survival import Survival as Survival  # returned
from .simulation.blamed_errors import Blame as Blame  # returned
from .problem.tightening import Tightening as Tightening  # returned

# Pictures
from .views.plotting import plot_trajectory as plot_trajectory
from .views.study_plots import plot_convergence as plot_convergence
from .views.study_plots import plot_sweep as plot_sweep
from .views.field_plot import plot_field_sweep as plot_field_sweep
from .views.study_figure import plot_study as plot_study
from .views.placement_map import plot_placement as plot_placement
from .views.comparison_plot import plot_comparison as plot_comparison
from .views.execution_plot import plot_execution as plot_execution
from .views.cycle_execution_plot import plot_cycle_execution as plot_cycle_execution
from .views.viewer import view as view
from .views.viewer import View as View  # returned
from .views.cycle_view import view_cycle as view_cycle
from .views.cycle_plot import plot_cycle as plot_cycle

# Errors
# Bad input raises; a task that cannot be done is an answer with a status.
from .errors import TubePlannerError as TubePlannerError
from .errors import RobotError as RobotError
from .errors import ProblemError as ProblemError
from .errors import TrajectoryError as TrajectoryError
from .errors import OptionError as OptionError
from .errors import OutputError as OutputError

__version__: str
