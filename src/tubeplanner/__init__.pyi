"""The public names, by the sections in which the reference lists them.

The one list of them: read when a name is first used, by type checkers, and for the reference.
Of what is marked as returned, nobody needs the arguments: the reference leaves them out.
"""

# Plan and judge
from .planning.strategy import plan as plan
from .planning.strategy import Planner as Planner
from .planning.options import PlanOptions as PlanOptions
from .planning.result import PlanResult as PlanResult  # returned
from .outcome import PlanStatus as PlanStatus
from .outcome import Location as Location
from .optimizer.stages import Sensitivity as Sensitivity
from .first_guess.branch_and_bound import SearchStatistics as SearchStatistics
from .limits.lower_bound import lower_bound as lower_bound
from .limits.lower_bound import LowerBound as LowerBound  # returned
from .limits.peaks import trajectory_peaks as trajectory_peaks
from .limits.peaks import TrajectoryPeaks as TrajectoryPeaks  # returned
from .limits.peaks import Peak as Peak  # returned
from .outcome import Progress as Progress
from .certificate.verification import verify as verify
from .certificate.verification import Certificate as Certificate
from .certificate.judged_motion import JudgedCondition as JudgedCondition
from .certificate.judged_motion import Tolerance as Tolerance
from .certificate.other_speeds import Braking as Braking  # returned
from .certificate.other_speeds import SlowerRun as SlowerRun  # returned

# Robot
from .robot.loader import load_robot as load_robot
from .robot.model import RobotModel as RobotModel  # returned
from .robot.pinocchio_model import ToolOffset as ToolOffset
from .robot.pinocchio_model import BasePose as BasePose
from .robot.pinocchio_model import Payload as Payload
from .robot.overrides import LimitOverrides as LimitOverrides
from .robot.overrides import MotorOverrides as MotorOverrides
from .robot.overrides import PointSpeed as PointSpeed
from .robot.joint_limits import LimitLayer as LimitLayer  # returned
from .task.side_files import read_preset as read_preset
from .task.side_files import read_robustness as read_robustness
from .task.side_files import read_limits_file as read_limits_file

# Problem
from .task.problem_reader import load_problem as load_problem
from .task.problem_reader import parse_problem as parse_problem
from .task.problem import PlanningProblem as PlanningProblem
from .task.endpoints import Seed as Seed
from .task.demands import Contact as Contact
from .task.endpoints import GoalRegion as GoalRegion
from .task.endpoints import ToolPose as ToolPose
from .task.demands import Objective as Objective
from .task.holding import Holding as Holding
from .task.holding import Cup as Cup
from .task.holding import Tray as Tray
from .task.holding import Gripper as Gripper
from .task.holding import Liquid as Liquid
from .geometry.tube.tube import Tube as Tube
from .geometry.solids import Obstacle as Obstacle
from .geometry.solids import AttachedSolid as AttachedSolid
from .geometry.solids import placement_of as placement_of

# Trajectory
from .trajectory.joint_trajectory import JointTrajectory as JointTrajectory
from .trajectory.reader import read_trajectory as read_trajectory
from .limits.speed_limits import scaling_factor as scaling_factor
from .first_guess.waypoints import sequential_quartics as sequential_quartics
from .first_guess.waypoints import quartic_spline as quartic_spline

# Cycle
from .task.cycle_file import load_cycle as load_cycle
from .task.cycle_file import parse_cycle as parse_cycle
from .task.cycle import Cycle as Cycle
from .task.steps import Move as Move
from .task.steps import Event as Event
from .task.steps import Attach as Attach
from .task.steps import Detach as Detach
from .planning.strategy import plan_cycle as plan_cycle
from .planning.result import CycleResult as CycleResult  # returned
from .planning.result import CycleSensitivity as CycleSensitivity  # returned
from .task.motion import CycleMotion as CycleMotion
from .task.motion import read_cycle_motion as read_cycle_motion
from .output.files.trajectory_writer import write_cycle_motion as write_cycle_motion
from .trajectory.parts import Mark as Mark
from .certificate.verification import verify_cycle as verify_cycle
from .certificate.verification import CycleCertificate as CycleCertificate  # returned

# Tubes from what you have
from .studies.tubes.measurement import measure_tube as measure_tube
from .studies.tubes.segment_measurement import MeasureOptions as MeasureOptions
from .studies.tubes.segment_measurement import TubeMeasurement as TubeMeasurement  # returned
from .studies.tubes.segment_measurement import SegmentMeasurement as SegmentMeasurement  # returned
from .studies.tubes.measurement import survey_patterns as survey_patterns
from .studies.tubes.measurement import PatternSurvey as PatternSurvey  # returned
from .studies.tubes.teach import teach as teach
from .studies.tubes.teach import TeachOptions as TeachOptions
from .studies.tubes.teach import joint_trail as joint_trail
from .studies.tubes.route import find_route as find_route
from .studies.tubes.route import RouteOptions as RouteOptions
from .studies.tubes.planned_tube import TubeAnswer as TubeAnswer  # returned
from .studies.tubes.zones import tube_from_zones as tube_from_zones
from .studies.tubes.zones import zones_of_tube as zones_of_tube
from .studies.tubes.zones import ZonedPath as ZonedPath  # returned

# Why not, and how much room
from .studies.explanation import explain as explain
from .studies.explanation import Explanation as Explanation  # returned
from .studies.remedies import Remedy as Remedy  # returned
from .studies.remedies import Headroom as Headroom  # returned

# Many plans
from .studies.plan_many import plan_many as plan_many
from .studies.plan_many import PlannedItem as PlannedItem  # returned
from .studies.dask_executor import dask_executor as dask_executor
from .studies.problem_spec import ProblemSpec as ProblemSpec
from .studies.worker_processes import WorkerProcesses as WorkerProcesses
from .studies.worker_processes import WorkerDied as WorkerDied
from .studies.sweeps import sweep as sweep
from .studies.sweeps import SweepResult as SweepResult  # returned
from .studies.sweeps import SweepRow as SweepRow
from .studies.sweeps import sweep_field as sweep_field
from .studies.sweeps import FieldSweep as FieldSweep  # returned
from .studies.sweeps import FieldRow as FieldRow  # returned
from .studies.study_file import load_study as load_study
from .studies.study import Study as Study
from .studies.study import run_study as run_study
from .studies.study import StudyResult as StudyResult  # returned
from .studies.study import StudyRow as StudyRow  # returned
from .studies.placement import place as place
from .studies.placement import PlaceOptions as PlaceOptions
from .studies.placement import Placement as Placement  # returned
from .studies.placement import GivenPlacement as GivenPlacement  # returned
from .studies.placement import PlacementRow as PlacementRow  # returned
from .studies.base_regions import BasePlacement as BasePlacement  # returned
from .studies.comparison import compare as compare
from .studies.comparison import Comparison as Comparison  # returned
from .studies.comparison import ComparisonRow as ComparisonRow  # returned
from .studies.comparison import TrajectoryMeasures as TrajectoryMeasures  # returned

# Executed
from .task.demands import Robustness as Robustness
from .execution.plants import drawn_plants as drawn_plants
from .execution.plants import Draw as Draw
from .execution.plants import Plant as Plant  # returned
from .execution.simulation import executed as executed
from .execution.simulation import Execution as Execution  # returned
from .execution.run_verdict import judged_runs as judged_runs
from .execution.run_verdict import JudgedRun as JudgedRun  # returned
from .execution.simulation import executed_cycle as executed_cycle
from .execution.run_verdict import judged_cycle as judged_cycle
from .execution.run_verdict import JudgedCycle as JudgedCycle  # returned
from .execution.run_verdict import HandoverErrors as HandoverErrors  # returned
from .execution.run_verdict import run_verdict as run_verdict
from .execution.run_verdict import RunVerdict as RunVerdict  # returned
from .planning.tightening import Survival as Survival  # returned
from .execution.error_contributions import ErrorContribution as ErrorContribution  # returned
from .planning.tightening import Tightening as Tightening  # returned

# Pictures
from .output.figures.trajectory_figures import plot_trajectory as plot_trajectory
from .output.figures.sweep_figures import plot_convergence as plot_convergence
from .output.figures.sweep_figures import plot_sweep as plot_sweep
from .output.figures.sweep_figures import plot_field_sweep as plot_field_sweep
from .output.figures.study_figures import plot_study as plot_study
from .output.figures.placement_map import plot_placement as plot_placement
from .output.figures.study_figures import plot_comparison as plot_comparison
from .output.figures.execution_figures import plot_execution as plot_execution
from .output.figures.execution_figures import plot_cycle_execution as plot_cycle_execution
from .output.page.viewer import view as view
from .output.page.viewer import View as View  # returned
from .output.page.viewer import view_cycle as view_cycle
from .output.figures.trajectory_figures import plot_cycle as plot_cycle

# Errors
# Bad input raises; a task that cannot be done is an answer with a status.
from .errors import TubePlannerError as TubePlannerError
from .errors import RobotError as RobotError
from .errors import ProblemError as ProblemError
from .errors import TrajectoryError as TrajectoryError
from .errors import OptionError as OptionError
from .errors import OutputError as OutputError

__version__: str
