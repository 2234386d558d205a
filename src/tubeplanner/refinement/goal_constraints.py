"""The tool in the ball of its goal, and turned as that asks, at the end of a spline."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.linear_rows import INNER_MARGIN
from tubeplanner.refinement.region_constraints import EvaluatedRegions
from tubeplanner.refinement.rotation_constraints import EvaluatedRotation
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.tube.segment_regions import Capsules

# As the problem file calls them.
_BALL, _ROTATION = LimitKey("tolerance"), LimitKey("rotation_tolerance")
# Towards the faces, edges and corners of a cube.
_CORNERS = [np.array(corner) for corner in product((-1.0, 0.0, 1.0), repeat=3) if any(corner)]
_AROUND = tuple(corner / np.linalg.norm(corner) for corner in _CORNERS)


class _Balls(Capsules):
    """Balls, with planes all around from the beginning.

    Steps are larger than they: tangent planes where each try leaves them would take too many.
    """

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return the normals of a polyhedron around."""
        return [np.tile(normal, (len(segment), 1)) for normal in _AROUND]


def goal_keys(problem: PlanningProblem) -> list[LimitKey]:
    """Return the keys of the tolerances that an open goal has."""
    goal = problem.open_goal
    if goal is None:
        return []
    return [_BALL] * (goal.tolerance > 0) + [_ROTATION] * goal.bounds_rotation


def evaluated_ball(
    problem: PlanningProblem,
    at: SampledSpline,
    path: PathSamples,
    numbers: Mapping[LimitKey, int],
) -> list[EvaluatedRegions]:
    """Return the ball that the tool must end in, a capsule without length, if there is one.

    Args:
        problem: The planning problem.
        at: The spline at its end.
        path: The arm there.
        numbers: Of the keys among those of all limits.
    """
    goal = problem.open_goal
    if goal is None or goal.tolerance == 0:
        return []
    centre, own = goal.position[None], np.zeros(1, dtype=np.int64)
    ball = EvaluatedRegions(
        at,
        path.tool_pose[1],
        lambda: path.tool_jacobian[:, :3],
        _Balls(centre, centre, np.array([goal.tolerance])),
        own,
        lambda _: own,
        np.zeros(1, dtype=bool),
        np.full(1, INNER_MARGIN),
        np.array([[numbers[_BALL]]]),
        is_crossed=True,
    )
    return [ball]


def evaluated_turn(
    problem: PlanningProblem,
    at: SampledSpline,
    path: PathSamples,
    numbers: Mapping[LimitKey, int],
) -> list[EvaluatedRotation]:
    """Return the tool's rotation at the end, if the goal bounds it; arguments as for the ball."""
    goal, beyond = problem.open_goal, problem.tube.segment_count
    if goal is None or not goal.bounds_rotation:
        return []
    assert problem.rotation is not None
    own = np.full(beyond + 1, numbers[_ROTATION])
    return [EvaluatedRotation(problem.rotation, at, path, INNER_MARGIN, own, np.array([beyond]))]
