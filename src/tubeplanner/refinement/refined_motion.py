"""Where refinement ended, and the start that it makes for a problem that has changed a little."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.branches.reference_turn import wanted_at
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.phased_spline import DEGREE, PhasedSpline
from tubeplanner.refinement.smoother_tube import smoother_problem
from tubeplanner.refinement.tube_chains import tube_chains
from tubeplanner.trajectory.fitted_spline import REST_POINTS


@dataclass(frozen=True, eq=False)
class RefinedMotion:
    """Where refinement ended.

    Attributes:
        problem: What was refined: the planning problem, or a smoother one inside of its tube.
        is_smoother: Whether it was that.
        spline: The motion, without its duration.
    """

    problem: PlanningProblem
    is_smoother: bool
    spline: PhasedSpline

    def suited(self, changed: PlanningProblem) -> PlanningProblem | None:
        """Return what is to be refined of a changed problem, likewise; None if all is different.

        The motion suits it if it has the same joints, and phases of the same segments.
        """
        if changed.robot.joint_names != self.problem.robot.joint_names:
            return None
        inner = smoother_problem(changed) if self.is_smoother else changed
        if inner is None or tube_chains(inner) != self.spline.grid.chains:
            return None
        return inner

    def shifted(self, changed: PlanningProblem) -> PhasedSpline:
        """Return the motion from a changed problem's start to its goal, on the same knots.

        At switching times the tool moves as far as the reference points have; between them, joints
        move by a smooth blend.

        Args:
            changed: What the motion suits.

        Raises:
            Infeasible: Status unreachable: the arm does not reach a point from where it was.
        """
        q = self.spline.bspline()(self.spline.switching_times)
        wanted = q.copy()
        wanted[0] = end_configuration(changed, changed.start, 0)
        points = [chain.stop for chain in self.spline.grid.chains]
        for k, point in enumerate(points, start=1):
            is_last = k == len(points)
            moved = changed.tube.points[point] - self.problem.tube.points[point]
            tool = changed.robot.tool_position(q[k : k + 1])[0]
            if is_last and changed.given_goal is not None:
                wanted[k] = end_configuration(changed, changed.given_goal, -1)
            elif is_last and changed.open_goal is not None:
                wanted[k] = _reached(changed, point, changed.open_goal.nearest(tool), q[k])
            elif moved.any():
                wanted[k] = _reached(changed, point, tool + moved, q[k])
        control_points = self.spline.control_points + self._blend(wanted - q)
        return PhasedSpline(self.spline.grid, self.spline.switching_times, control_points)

    def _blend(self, shift: FloatArray) -> FloatArray:
        """Return how control points (K, n) follow what shifts the ends of the phases, (P+1, n)."""
        grid, ends = self.spline.grid, self.spline.switching_times
        knots, count = grid.knots(ends), grid.control_point_count
        times = np.mean([knots[k : k + count] for k in range(1, DEGREE + 1)], axis=0)
        times[:REST_POINTS], times[-REST_POINTS:] = 0.0, 1.0
        phase = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, len(ends) - 2)
        x = (times - ends[phase]) / np.diff(ends)[phase]
        share = (x**3 * (10 - 15 * x + 6 * x**2))[:, None]
        blend: FloatArray = (1 - share) * shift[phase] + share * shift[phase + 1]
        return blend


def _reached(
    problem: PlanningProblem, point: int, target: FloatArray, near: FloatArray
) -> FloatArray:
    """Return a configuration (n,) near another with the tool at a target, turned as it was."""
    segment = point - 1
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    wanted = wanted_at(problem, target, segment, near)
    found = solve_position(problem.robot, target, near, lower, upper, rotation=wanted)
    if found.error > MARGIN_TOLERANCE / 2:
        message = f"the last motion does not lead to reference point {problem.tube.numbers[point]}"
        raise Infeasible(PlanStatus.UNREACHABLE, message, Place().at(target))
    return found.q
