"""Drake's KinematicTrajectoryOptimization on tube problems, for `rivals.py`.

Tuned as a fair user would: a cubic B-spline of 24 control points; position and velocity limits on
control points; efforts, tube and distances at samples. The tool's distance to each segment is
exact (`PointToLineDistanceConstraint`), not a box. Which segment a sample belongs to is fixed while
SNOPT runs; it is then chosen again from the answer, and the program solved from there. What is
broken between samples is taken into account by narrower limits in the next round. Ends are those of
our plan, at rest with zero acceleration.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pydrake.math import BsplineBasis, KnotVectorType
from pydrake.multibody.inverse_kinematics import (
    MinimumDistanceLowerBoundConstraint,
    PointToLineDistanceConstraint,
    PositionConstraint,
)
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import MathematicalProgramResult, SnoptSolver, SolverOptions
from pydrake.trajectories import BsplineTrajectory
from scipy.interpolate import BSpline, make_lsq_spline

from drake_arm import DrakeArm, drake_arm
from transcription_program import PhasedTrajectory
from tubeplanner import JointTrajectory, PlanningProblem, verify
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.trajectory.joint_trajectory import from_spline

CONTROL_POINTS, ORDER = 24, 4
INTERVALS = CONTROL_POINTS - ORDER + 1
# All knots are among the samples: accelerations have their peaks there.
TUBE_SAMPLES, EFFORT_SAMPLES, DISTANCE_SAMPLES = (k * INTERVALS + 1 for k in (3, 3, 2))
ROUNDS, MIN_GAIN = 3, 2e-3  # of choosing segments again, while a round gains so much
NARROWER = 0.98  # of radius and effort limit, every round that left the tube
WIDER_CLEARANCE = 0.003  # [m], every round that came too close
INFLUENCE = 0.05  # [m]: nearer pairs count
MAJOR_ITERATIONS, MINOR_ITERATIONS = 80, 15_000
AMPLE_VELOCITY = 100.0  # where no limit is given [rad/s or m/s]
FIT_POINTS = 400


@dataclass(frozen=True)
class Tightening:
    """What is asked beyond the problem's limits.

    Attributes:
        radius: Share of the tube's radius that may be used.
        clearance: Added to the problem's [m].
    """

    radius: float = 0.995
    clearance: float = 0.001


def drake_trajectory(
    problem: PlanningProblem, starts: Iterable[PhasedTrajectory]
) -> JointTrajectory | None:
    """Return the fastest certified trajectory that some starts lead to, or any, or None."""
    arm, best = drake_arm(problem), None
    for start in starts:
        for passed, trajectory in _rounds(problem, arm, start):
            rank = (not passed, trajectory.duration)
            if best is None or rank < best[0]:
                best = rank, trajectory
    return best[1] if best else None


def _rounds(
    problem: PlanningProblem, arm: DrakeArm, start: PhasedTrajectory
) -> Iterable[tuple[bool, JointTrajectory]]:
    """Yield what becomes of a start, round by round."""
    tight = Tightening()
    for index in range(ROUNDS):
        program = _program(problem, arm, start, tight)
        result = SnoptSolver().Solve(program.prog(), None, _options())
        # SNOPT often ends without the last digits; what it has is judged all the same.
        trajectory = scaled_to_limits(problem, _trajectory(problem, program, result))
        certificate = verify(problem, trajectory)
        yield certificate.passed, trajectory
        gain = start.switching_times[-1] / trajectory.duration - 1
        if certificate.passed and index > 0 and gain < MIN_GAIN:
            return
        holds = {
            name: condition.holds(certificate.tolerance)
            for name, condition in certificate.conditions.items()
        }
        apart = holds["obstacles"] and holds["self_collision"]
        tight = Tightening(
            tight.radius * (1.0 if holds["tube"] else NARROWER),
            tight.clearance + (0.0 if apart else WIDER_CLEARANCE),
        )
        start = PhasedTrajectory(trajectory, switching_times_of(problem, trajectory))


def _options() -> SolverOptions:
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major iterations limit", MAJOR_ITERATIONS)
    options.SetOption(SnoptSolver.id(), "Iterations limit", MINOR_ITERATIONS)
    options.SetOption(SnoptSolver.id(), "Major optimality tolerance", 1e-4)
    options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", 1e-6)
    return options


def _program(
    problem: PlanningProblem, arm: DrakeArm, start: PhasedTrajectory, tight: Tightening
) -> KinematicTrajectoryOptimization:
    robot = problem.robot
    program = KinematicTrajectoryOptimization(robot.joint_count, CONTROL_POINTS, ORDER)
    ends = start.trajectory.position([0.0, start.trajectory.duration])
    still = np.zeros(robot.joint_count)
    for place, q in ((0.0, ends[0]), (1.0, ends[1])):
        program.AddPathPositionConstraint(q, q, place)
        program.AddPathVelocityConstraint(still, still, place)
        program.AddPathAccelerationConstraint(still, still, place)
    most = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, AMPLE_VELOCITY)
    program.AddVelocityBounds(-most, most)
    program.AddPositionBounds(problem.joint_lower.max(axis=0), problem.joint_upper.min(axis=0))
    places = np.linspace(0, 1, EFFORT_SAMPLES)
    program.AddEffortBoundsAtNormalizedTimes(arm.plant, places)
    _keep_in_tube(program, problem, arm, start, tight)
    _keep_apart(program, problem, arm, tight)
    program.AddDurationCost(1.0)
    program.AddDurationConstraint(0.05, 20.0)
    program.SetInitialGuess(_fitted(start.trajectory))
    return program


def _keep_in_tube(
    program: KinematicTrajectoryOptimization,
    problem: PlanningProblem,
    arm: DrakeArm,
    start: PhasedTrajectory,
    tight: Tightening,
) -> None:
    tube = problem.tube
    lengths = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    places = np.linspace(0, 1, TUBE_SAMPLES)
    switching_times = start.switching_times / start.switching_times[-1]
    nearest = 1 + abs(places[1:-1, None] - switching_times[1:-1]).argmin(axis=0)
    for index, place in enumerate(places[1:-1], 1):
        # At a switching time the tool is in both capsules.
        segments = {int(np.searchsorted(switching_times[1:-1], place))}
        segments |= {k + side for k in np.flatnonzero(nearest == index) for side in (0, 1)}
        for k in segments:
            radius = tight.radius * tube.effective_radius[k]
            for constraint in _capsule(arm, arm.lines[k], radius, lengths[k]):
                program.AddPathPositionConstraint(constraint, place)


def _capsule(arm: DrakeArm, line: object, radius: float, length: float) -> list[object]:
    """Return the constraints that hold the tool in a capsule's cylinder."""
    plant, context, tool = arm.plant, arm.context, arm.tool_point
    free = np.full(2, np.inf)
    axis = np.array([0.0, 0.0, 1.0])
    return [
        PointToLineDistanceConstraint(
            plant, arm.tool, tool, line, np.zeros(3), axis, 0.0, radius, context
        ),
        PositionConstraint(plant, line, [*-free, 0.0], [*free, length], arm.tool, tool, context),
    ]


def _keep_apart(
    program: KinematicTrajectoryOptimization,
    problem: PlanningProblem,
    arm: DrakeArm,
    tight: Tightening,
) -> None:
    if not len(problem.collision.obstacle_pairs):
        return
    constraint = MinimumDistanceLowerBoundConstraint(
        plant=arm.plant,
        bound=problem.clearance + tight.clearance,
        plant_context=arm.context,
        influence_distance_offset=INFLUENCE,
    )
    for place in np.linspace(0, 1, DISTANCE_SAMPLES)[1:-1]:
        program.AddPathPositionConstraint(constraint, place)


def _fitted(trajectory: JointTrajectory) -> BsplineTrajectory:
    """Return the nearest B-spline of Drake's kind."""
    duration = trajectory.duration
    basis = BsplineBasis(ORDER, CONTROL_POINTS, KnotVectorType.kClampedUniform, 0.0, duration)
    times = np.linspace(0, duration, FIT_POINTS)
    fit = make_lsq_spline(times, trajectory.position(times), np.array(basis.knots()), ORDER - 1)
    return BsplineTrajectory(basis, [row[:, None] for row in fit.c])


def _trajectory(
    problem: PlanningProblem,
    program: KinematicTrajectoryOptimization,
    result: MathematicalProgramResult,
) -> JointTrajectory:
    found = program.ReconstructTrajectory(result)
    points = np.hstack(found.control_points()).T
    spline = BSpline(np.array(found.basis().knots()), points, ORDER - 1)
    return from_spline(problem.robot.joint_names, spline)


def switching_times_of(problem: PlanningProblem, trajectory: JointTrajectory) -> np.ndarray:
    """Return when a trajectory is deepest in both capsules of each switching time."""
    times = np.linspace(0, trajectory.duration, 2001)
    margin = problem.tube.margin(problem.robot.tool_position(trajectory.position(times)))
    both = np.minimum(margin[:, :-1], margin[:, 1:])
    inner = np.maximum.accumulate(times[both.argmax(axis=0)])
    return np.array([0.0, *inner, trajectory.duration])
