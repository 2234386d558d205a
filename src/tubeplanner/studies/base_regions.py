"""Regions of base poses; free standing; problems with a movable base."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite, pi, remainder, sqrt
from typing import Any, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.checks import given_row, is_number
from tubeplanner.errors import OptionError, ProblemError, shown
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.first_guess.pose_configurations import ends_segment, is_free, spread_seeds
from tubeplanner.orientation import rpy_of_matrix
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.problem_spec import PosedProblem
from tubeplanner.task.endpoints import Endpoint
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import check_problem_fields, require_problem
from tubeplanner.task.problem_reader import end_of, robot_of

# ---- Where the base of a robot may stand: a region of its cell, turned about the vertical at will.

_YAWS, _HEIGHTS = 8, 3  # of the grid, at most
_DIGITS = 6  # of a stand: a micrometre, and what that is at a metre's distance


class Stand(NamedTuple):
    """Where a root link stands.

    Attributes:
        x: Of its origin, in the cell [m].
        y: Likewise.
        z: Likewise, upwards.
        yaw: The last of its roll, pitch and yaw: how it is turned about the vertical [rad].
    """

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class StandGrid:
    """Stands in the middles of equal cells of a region.

    Attributes:
        stands: All of them.
        spacing: Sides of a cell: x, y, z [m] and yaw [rad]; 0 where there is nothing to vary.
    """

    stands: tuple[Stand, ...]
    spacing: tuple[float, float, float, float]


@dataclass(frozen=True)
class Region:
    """A box in the cell, its sides along the axes, that a root link's origin must not leave.

    Attributes:
        low: Least x, y, z [m].
        high: Largest x, y, z [m].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @classmethod
    def of(cls, bounds: Sequence[float], height: float) -> "Region":
        """Return the region X0, X1, Y0, Y1 and perhaps Z0, Z1 [m], else at one height [m].

        Raises:
            OptionError: It is none.
        """
        given = given_row("region", bounds, "four or six numbers")
        if len(given) not in (4, 6) or not all(is_number(v) and isfinite(v) for v in given):
            raise OptionError(
                f"region is {shown(given)}; give X0, X1, Y0, Y1 and, if the height may vary, Z0, "
                "Z1, in metres in the cell"
            )
        given = [float(value) for value in given] + [height, height][: 6 - len(given)]
        low, high = given[::2], given[1::2]
        for axis, least, most in zip("xyz", low, high, strict=True):
            if least > most:
                raise OptionError(
                    f"region: {axis} goes from {least:g} to {most:g} m; give the smaller first"
                )
        return cls((low[0], low[1], low[2]), (high[0], high[1], high[2]))

    @property
    def bounds(self) -> list[float]:
        """X0, X1, Y0, Y1, Z0, Z1 [m]."""
        return [value for pair in zip(self.low, self.high, strict=True) for value in pair]

    def holds(self, stand: Stand) -> bool:
        """Return whether a stand is in it."""
        sides = zip(self.low, stand[:3], self.high, strict=True)
        return all(low <= value <= high for low, value, high in sides)

    def nearest(self, stand: Stand) -> Stand:
        """Return the stand in it that is nearest to another one, its yaw within half a turn."""
        sides = zip(self.low, stand[:3], self.high, strict=True)
        x, y, z = (min(max(round(value, _DIGITS), low), high) for low, value, high in sides)
        return Stand(x, y, z, round(remainder(stand.yaw, 2 * pi), _DIGITS))

    def grid(self, count: int, yaw: float) -> StandGrid:
        """Return about so many stands spread over it.

        Args:
            count: Of them.
            yaw: One of the angles about the vertical; the others share the turn evenly [rad].
        """
        counts = self._counts(count)
        axes = [
            [low + (k + 0.5) * (high - low) / n for k in range(n)]
            for low, high, n in zip(self.low, self.high, counts, strict=False)
        ]
        turn = 2 * pi / counts[3]
        yaws = [yaw + k * turn for k in range(counts[3])]
        stands = tuple(self.nearest(Stand(*each)) for each in product(*axes, yaws))
        x, y, z = (
            (high - low) / n for low, high, n in zip(self.low, self.high, counts, strict=False)
        )
        return StandGrid(stands, (x, y, z, turn))

    def _counts(self, count: int) -> tuple[int, int, int, int]:
        """Return how many of so many stands share x, y, z and yaw; cells are nearly square."""
        width, depth, height = (h - low for low, h in zip(self.low, self.high, strict=True))
        yaws = min(_YAWS, count)
        heights = min(_HEIGHTS, count // yaws) if height > 0 else 1
        columns = count // (yaws * heights)
        if width == 0 or depth == 0:
            return (columns if width else 1), (columns if depth else 1), heights, yaws
        along = min(max(1, round(sqrt(columns * width / depth))), columns)
        return along, max(1, round(columns / along)), heights, yaws


# ---- Links that stand still against obstacles: whether the robot can stand where it is put.
#
# Planning never asks this, as it can change neither; looking for a place for the robot does.

_TOUCHING = 5e-5  # [m]
_BASE = 0  # the body of what no joint moves


def require_base_free(problem: PlanningProblem, stands_on: Collection[str] = ()) -> None:
    """Raise unless the links that no joint moves keep their distance from the obstacles.

    It is that of the other links, the most that any segment asks. Pairs that the problem ignores do
    not count.

    Args:
        problem: The planning problem.
        stands_on: Names of obstacles that these links may touch.

    Raises:
        Infeasible: Status tube_blocked: the message names link and obstacle, and how deep one is in
            the other.
    """
    pairs = _base_pairs(problem, stands_on)
    if len(pairs) == 0:
        return
    checker = problem.collision
    rotation, position = problem.robot.body_poses(np.zeros((1, problem.robot.joint_count)))
    distance = checker.distances(rotation[0], position[0], pairs)
    required, worst = _required(problem), int(distance.argmin())
    if distance[worst] >= required - MARGIN_TOLERANCE:
        return
    link, obstacle = (checker.shapes[index].owner for index in pairs[worst])
    message = _words(link, obstacle, float(distance[worst]), required)
    raise Infeasible(PlanStatus.TUBE_BLOCKED, message, Place(links=(link,), obstacle=obstacle))


def _base_pairs(problem: PlanningProblem, stands_on: Collection[str]) -> IntArray:
    """Return links that stand still against obstacles, as indices of the checker's shapes (P, 2).

    Covers of links from before the obstacles, as for moving links; closer ones come behind.
    """
    shapes = problem.collision.shapes
    names = {obstacle.name for obstacle in problem.obstacles}
    ignored = {frozenset(pair) for pair in problem.ignore_collisions}
    obstacles = [k for k, shape in enumerate(shapes) if shape.owner in names]
    links = [k for k in range(min(obstacles, default=0)) if shapes[k].body == _BASE]
    found = [
        (i, j)
        for i in links
        for j in obstacles
        if shapes[j].owner not in stands_on
        and frozenset((shapes[i].owner, shapes[j].owner)) not in ignored
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _required(problem: PlanningProblem) -> float:
    """Return the distance that links must keep from obstacles [m]."""
    own = problem.tube.clearance
    if own is None:
        return float(problem.clearance)
    return float(np.where(np.isfinite(own), own, problem.clearance).max())


def _words(link: str, obstacle: str, distance: float, required: float) -> str:
    own, wanted = f"'{link}', which no joint moves,", f"(clearance {1000 * required:g} mm)"
    if abs(distance) < _TOUCHING:
        return f"{own} touches '{obstacle}'{f' {wanted}' if required else ''}"
    if distance < 0:
        return f"{own} stands {-1000 * distance:.1f} mm in '{obstacle}'"
    return f"{own} stands {1000 * distance:.1f} mm from '{obstacle}' {wanted}"


# ---- A problem whose robot may stand elsewhere: joints at start and goal are seeds there.

_ENDS = ("start", "goal")


@dataclass(frozen=True)
class MovableProblem:
    """A problem file's contents, ready for any stand of the robot.

    Attributes:
        posed: The problem as given.
        seeds: Start and goal, where they are configurations: these joints [rad or m] are where
            inverse kinematics begins.
        given: Where the robot stands as given.
        tilt: Its roll and pitch, which it keeps [rad].
    """

    posed: PosedProblem
    seeds: Mapping[str, Any]
    given: Stand
    tilt: tuple[float, float]

    @classmethod
    def of(cls, posed: PosedProblem) -> "MovableProblem":
        """Take a problem.

        Raises:
            ProblemError: It is a cycle, or contradicts its format.
            RobotError: Its robot cannot be planned with.
        """
        require_problem(posed.document, posed.name)
        fields = check_problem_fields(posed.document, posed.name)
        robot = robot_of(fields, posed.folder)
        seeds = {}
        for end in _ENDS:
            try:
                given = end_of(end, getattr(fields, end), fields, robot, posed.folder)
            except ProblemError as error:
                raise ProblemError(f"{posed.name}: {error}") from None
            if isinstance(given, np.ndarray):
                seeds[end] = given.tolist()
            elif isinstance(given, dict):
                seeds[end] = given
        stand, tilt = _stand_of(robot)
        return cls(posed, seeds, stand, tilt)

    def changes(
        self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> dict[str, Any]:
        """Return what is to be changed for a stand, by field path.

        Args:
            stand: Where the root link is to stand.
            seeds: Other seeds than the joints given, by end.
        """
        place = {"position": [stand.x, stand.y, stand.z], "rpy": [*self.tilt, stand.yaw]}
        ends = {**self.seeds, **(seeds or {})}
        return {"robot.base": place, **{end: {"seed": values} for end, values in ends.items()}}

    def at(self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None) -> PosedProblem:
        """Return the problem with the robot at a stand; arguments as of `changes`."""
        return self.posed.changed(self.changes(stand, seeds))

    def load(
        self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> PlanningProblem:
        """Return `at` as a planning problem.

        Raises:
            ProblemError: It contradicts itself there.
            RobotError: The robot cannot be planned with.
        """
        loaded = self.at(stand, seeds).load()
        assert isinstance(loaded, PlanningProblem)
        return loaded


def _stand_of(robot: RobotModel) -> tuple[Stand, tuple[float, float]]:
    """Return where a robot stands, and its roll and pitch [rad]."""
    base = robot.base
    if base is None:
        return Stand(0.0, 0.0, 0.0, 0.0), (0.0, 0.0)
    roll, pitch, yaw = base.rpy or rpy_of_matrix(base.placement[:3, :3])
    return Stand(*base.position, yaw), (roll, pitch)


# ---- Seeds for start and goal of a robot that stands elsewhere.


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
        own = problem.endpoints[_point(end)].seed
        assert own is not None
        if next(_free(problem, end, [own]), None) is not None:
            continue
        segment = ends_segment(problem, _point(end))[1]
        spread = spread_seeds(problem.joint_lower[segment], problem.joint_upper[segment])
        others = list(_free(problem, end, spread))
        if others:
            away = [float(np.linalg.norm(q - own)) for q in others]
            found[end] = np.round(others[int(np.argmin(away))], _DIGITS).tolist()
    return found


def _free(
    problem: PlanningProblem, end: str, seeds: Sequence[FloatArray] | FloatArray
) -> Iterator[FloatArray]:
    """Yield the configurations (n,), free of collision, that seeds lead to."""
    for seed in seeds:
        try:
            q = end_configuration(problem, Endpoint("seed", seed=seed), _point(end))
        except Infeasible:
            continue
        if is_free(problem, end, q):
            yield q


def _point(end: str) -> int:
    return 0 if end == "start" else -1
