"""Seeds for start and goal of a robot that stands elsewhere."""

from collections.abc import Iterator, Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.pose_configurations import ends_segment, is_free, spread_seeds
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem, Seed

_DIGITS = 6  # of a seed: it only has to lead to the configuration


def leading_seeds(problem: PlanningProblem, ends: Sequence[str]) -> dict[str, list[float]]:
    """Return other seeds for ends whose own lead to no configuration that is free of collision.

    Of the free ones that other seeds lead to, the one nearest to the end's own seed. Ends without
    any are left out: planning says why.

    Args:
        problem: The planning problem.
        ends: Those that are seeds and may be others: of start and goal.
    """
    found = {}
    for end in ends:
        own = getattr(problem, end)
        assert isinstance(own, Seed)
        if next(_free(problem, end, [own.joints]), None) is not None:
            continue
        segment = ends_segment(problem, _point(end))[1]
        spread = spread_seeds(problem.joint_lower[segment], problem.joint_upper[segment])
        others = list(_free(problem, end, spread))
        if others:
            away = [float(np.linalg.norm(q - own.joints)) for q in others]
            found[end] = np.round(others[int(np.argmin(away))], _DIGITS).tolist()
    return found


def _free(
    problem: PlanningProblem, end: str, seeds: Sequence[FloatArray] | FloatArray
) -> Iterator[FloatArray]:
    """Yield the configurations (n,), free of collision, that seeds lead to."""
    for seed in seeds:
        try:
            q = end_configuration(problem, Seed(seed), _point(end))
        except Infeasible:
            continue
        if is_free(problem, end, q):
            yield q


def _point(end: str) -> int:
    return 0 if end == "start" else -1
