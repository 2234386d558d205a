"""What motions of a problem are measured by, as its objective says."""

from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.problem.objective import ENERGY, SMOOTHNESS, Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.effort_measures import Energy, Work
from tubeplanner.refinement.measure import Measure, Weighted
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.smoothness_measures import smoothness_measures
from tubeplanner.trajectory.joint_trajectory import from_spline

# Weight of the logarithm of energy or work, and the share of smoothness beside it: joints that cost
# nothing would wiggle, and efforts chatter where that costs next to nothing.
_WEIGHT, _SMOOTHNESS = 30.0, 0.3
_LEAST_WORK = 1e-9  # [J]


def objective_measures(problem: PlanningProblem, spline: PhasedSpline, run_in: float) -> Weighted:
    """Return the measures, with the weights of their logarithms.

    Args:
        problem: The planning problem.
        spline: A motion to take scales from.
        run_in: Its duration [s].
    """
    smooth = smoothness_measures(problem, spline, run_in)
    objective, robot = problem.objective or Objective(), problem.robot
    if objective.minimise == SMOOTHNESS:
        return smooth
    own: Measure
    if objective.minimise == ENERGY:
        own = Energy(objective.energy_weights(robot))
    else:
        motion = from_spline(robot.joint_names, spline.bspline()).scaled(run_in)
        own = Work(robot.joint_count, max(EffortCosts(robot, motion).work(), _LEAST_WORK))
    return ((_WEIGHT, own), *((_SMOOTHNESS * weight, measure) for weight, measure in smooth))
