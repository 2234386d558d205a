"""Regions of base poses; free standing; problems with a movable base."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite, pi, remainder, sqrt
from typing import Any, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_row, is_number
from tubeplanner.errors import OptionError, ProblemError, shown
from tubeplanner.fields import check_fields
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.first_guess.pose_configurations import ends_segment, is_free, spread_seeds
from tubeplanner.orientation import rpy_of_matrix
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.task.endpoints import Endpoint
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import ProblemFields, require_problem
from tubeplanner.task.problem_reader import end_of, robot_of

# ---- Regions of base poses: a box in the cell, with any angle about the vertical.

_YAWS, _HEIGHTS = 8, 3  # of the grid, at most
_DIGITS = 6  # of a stand: a micrometre, and the angle of that at a metre's distance


class BasePlacement(NamedTuple):
    """The base pose of a robot whose roll and pitch are fixed.

    Attributes:
        x: Position of the root link's origin in the cell [m].
        y: As `x`.
        z: As `x`, upwards.
        yaw: Last of roll, pitch and yaw: the angle about the vertical [rad].
    """

    x: float
    y: float
    z: float
    yaw: float

    def as_dict(self) -> dict[str, Any]:
        """Return the base pose as JSON values."""
        return {"position": list(self[:3]), "yaw": self.yaw}


@dataclass(frozen=True)
class PlacementGrid:
    """Base poses in the middles of equal cells of a region."""

    base_placements: tuple[BasePlacement, ...]  # the base poses
    # sides of a cell: x, y, z [m] and yaw [rad]; 0 where the region has no extent
    spacing: tuple[float, float, float, float]


@dataclass(frozen=True)
class Region:
    """A box in the cell, its sides along the axes, for a root link's origin."""

    low: tuple[float, float, float]  # least x, y, z [m]
    high: tuple[float, float, float]  # largest x, y, z [m]

    @classmethod
    def of(cls, bounds: Sequence[float], height: float) -> "Region":
        """Return the region X0, X1, Y0, Y1 and perhaps Z0, Z1 [m].

        Args:
            bounds: The four or six numbers.
            height: The height without Z0, Z1 [m].

        Raises:
            OptionError: The bounds are not four or six finite numbers, the smaller of each pair
                first.
        """
        values = checked_row("region", bounds, "four or six numbers")
        if len(values) not in (4, 6) or not all(is_number(v) and isfinite(v) for v in values):
            raise OptionError(
                f"region is {shown(values)}; give X0, X1, Y0, Y1 and, if the height may vary, Z0, "
                "Z1, in metres in the cell"
            )
        values = [float(value) for value in values] + [height, height][: 6 - len(values)]
        low, high = values[::2], values[1::2]
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

    def holds(self, base_placement: BasePlacement) -> bool:
        """Return True if the base is in the region."""
        sides = zip(self.low, base_placement[:3], self.high, strict=True)
        return all(low <= value <= high for low, value, high in sides)

    def nearest(self, base_placement: BasePlacement) -> BasePlacement:
        """Return the nearest base pose in the region, rounded, its yaw from -pi to pi."""
        sides = zip(self.low, base_placement[:3], self.high, strict=True)
        x, y, z = (min(max(round(value, _DIGITS), low), high) for low, value, high in sides)
        return BasePlacement(x, y, z, round(remainder(base_placement.yaw, 2 * pi), _DIGITS))

    def grid(self, count: int, yaw: float) -> PlacementGrid:
        """Return a grid of about `count` base poses over the region.

        Args:
            count: Number of base poses.
            yaw: One of the angles about the vertical; the others divide the turn evenly [rad].
        """
        width, depth, height = (h - low for low, h in zip(self.low, self.high, strict=True))
        yaw_count = min(_YAWS, count)
        while width + depth + height > 0 and 2 * (count // yaw_count) < yaw_count:
            yaw_count //= 2  # few poses are worth more at other positions than at other angles
        heights = min(_HEIGHTS, count // yaw_count) if height > 0 else 1
        columns = count // (yaw_count * heights)
        if width == 0 or depth == 0:
            counts = (columns if width else 1), (columns if depth else 1), heights
        else:  # cells are nearly square
            along = min(max(1, round(sqrt(columns * width / depth))), columns)
            counts = along, max(1, round(columns / along)), heights
        sides = list(zip(self.low, self.high, counts, strict=True))
        axes = [[low + (k + 0.5) * (high - low) / n for k in range(n)] for low, high, n in sides]
        step = 2 * pi / yaw_count
        yaws = [yaw + k * step for k in range(yaw_count)]
        base_placements = tuple(self.nearest(BasePlacement(*each)) for each in product(*axes, yaws))
        x, y, z = ((high - low) / n for low, high, n in sides)
        return PlacementGrid(base_placements, (x, y, z, step))


# ---- Clearance of the links that no joint moves from the obstacles. Planning does not check them:
# it can move neither.

_TOUCHING = 5e-5  # [m]
_BASE = 0  # the body of the links that no joint moves


def require_base_free(problem: PlanningProblem, stands_on: Collection[str] = ()) -> None:
    """Raise unless the links that no joint moves keep their clearance from the obstacles.

    The clearance is the largest that any segment requires. Pairs that the problem ignores do not
    count.

    Args:
        problem: The planning problem.
        stands_on: Names of obstacles that these links may touch.

    Raises:
        Infeasible: Status tube_blocked: the message names link and obstacle, and their distance or
            depth.
    """
    checker = problem.collision
    shapes = checker.shapes
    names = {obstacle.name for obstacle in problem.obstacles}
    ignored = {frozenset(pair) for pair in problem.ignore_collisions}
    obstacles = [k for k, shape in enumerate(shapes) if shape.owner in names]
    # Of links the shapes before the obstacles, as for moving links: closer covers come behind.
    links = [k for k in range(min(obstacles, default=0)) if shapes[k].body == _BASE]
    pairs = np.array(
        [
            (i, j)
            for i, j in product(links, obstacles)
            if shapes[j].owner not in stands_on
            and frozenset((shapes[i].owner, shapes[j].owner)) not in ignored
        ],
        dtype=np.int64,
    )
    if len(pairs) == 0:
        return
    rotation, position = problem.robot.body_poses(np.zeros((1, problem.robot.joint_count)))
    distance = checker.distances(rotation[0], position[0], pairs)
    required, worst = float(problem.clearance), int(distance.argmin())
    if (by_segment := problem.tube.clearance) is not None:
        required = float(np.where(np.isfinite(by_segment), by_segment, problem.clearance).max())
    if distance[worst] >= required - MARGIN_TOLERANCE:
        return
    link, obstacle = (shapes[index].owner for index in pairs[worst])
    own, requirement = f"'{link}', which no joint moves,", f"(clearance {1000 * required:g} mm)"
    least = float(distance[worst])
    if abs(least) < _TOUCHING:
        message = f"{own} touches '{obstacle}'{f' {requirement}' if required else ''}"
    elif least < 0:
        message = f"{own} stands {-1000 * least:.1f} mm in '{obstacle}'"
    else:
        message = f"{own} stands {1000 * least:.1f} mm from '{obstacle}' {requirement}"
    raise Infeasible(PlanStatus.TUBE_BLOCKED, message, Location(links=(link,), obstacle=obstacle))


# ---- Problems with a movable base: joints at start and goal become seeds of inverse kinematics.

_ENDS = ("start", "goal")


@dataclass(frozen=True)
class MovableProblem:
    """The contents of a problem file, for any base pose of the robot."""

    spec: ProblemSpec  # the problem as given
    # seeds of inverse kinematics [rad or m], by end: the configurations given for start and goal
    seeds: Mapping[str, Any]
    given: BasePlacement  # base pose as given
    tilt: tuple[float, float]  # roll and pitch of the base, which stay [rad]

    @classmethod
    def of(cls, spec: ProblemSpec) -> "MovableProblem":
        """Return a problem with a movable base.

        Raises:
            ProblemError: The problem is a cycle, or contradicts its format.
            RobotError: The robot cannot be planned with.
        """
        require_problem(spec.document, spec.name)
        fields = check_fields(ProblemFields, spec.document, spec.name)
        if fields.tube is not None and fields.tube.route is not None:
            raise ProblemError(
                f"{spec.name}: tube.route is for one base pose; give points and radii of a tube"
            )
        robot = robot_of(fields, spec.folder)
        seeds = {}
        for end in _ENDS:
            try:
                value = end_of(end, getattr(fields, end), robot, spec.folder)
            except ProblemError as error:
                raise ProblemError(f"{spec.name}: {error}") from None
            if isinstance(value, np.ndarray):
                seeds[end] = value.tolist()
            elif isinstance(value, dict):
                seeds[end] = value
        if robot.base is None:
            return cls(spec, seeds, BasePlacement(0.0, 0.0, 0.0, 0.0), (0.0, 0.0))
        roll, pitch, yaw = robot.base.rpy or rpy_of_matrix(robot.base.placement[:3, :3])
        return cls(spec, seeds, BasePlacement(*robot.base.position, yaw), (roll, pitch))

    def changes(
        self, base_placement: BasePlacement, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> dict[str, Any]:
        """Return the values of a base pose, by field path.

        Args:
            base_placement: Base pose.
            seeds: Seeds in place of the given joints, by end.
        """
        base = {
            "position": [base_placement.x, base_placement.y, base_placement.z],
            "rpy": [*self.tilt, base_placement.yaw],
        }
        ends = {**self.seeds, **(seeds or {})}
        return {"robot.base": base, **{end: {"seed": values} for end, values in ends.items()}}

    def at(
        self, base_placement: BasePlacement, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> ProblemSpec:
        """Return the problem with a base pose; arguments as of `changes`."""
        return self.spec.changed(self.changes(base_placement, seeds))

    def load(
        self, base_placement: BasePlacement, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> PlanningProblem:
        """Return the planning problem with a base pose; arguments as of `changes`.

        Raises:
            ProblemError: It contradicts itself with that base pose.
            RobotError: The robot cannot be planned with.
        """
        loaded = self.at(base_placement, seeds).load()
        assert isinstance(loaded, PlanningProblem)
        return loaded


def leading_seeds(problem: PlanningProblem, ends: Sequence[str]) -> dict[str, list[float]]:
    """Return new seeds for ends whose own seeds lead to no configuration free of collision.

    A new seed is the free configuration nearest to the own seed. Ends without a free configuration
    are left out: planning reports the reason.

    Args:
        problem: The planning problem.
        ends: Names of the ends with seeds that may change: "start", "goal".
    """
    result = {}
    for end in ends:
        own = problem.endpoints[_point(end)].seed
        assert own is not None
        if next(_free(problem, end, [own]), None) is not None:
            continue
        segment = ends_segment(problem, _point(end))[1]
        spread = spread_seeds(problem.joint_lower[segment], problem.joint_upper[segment])
        others = list(_free(problem, end, spread))
        if others:
            distances = [float(np.linalg.norm(q - own)) for q in others]
            result[end] = np.round(others[int(np.argmin(distances))], _DIGITS).tolist()
    return result


def _free(
    problem: PlanningProblem, end: str, seeds: Sequence[FloatArray] | FloatArray
) -> Iterator[FloatArray]:
    """Yield the collision-free configurations (n,) from inverse kinematics of seeds."""
    for seed in seeds:
        try:
            q = end_configuration(problem, Endpoint("seed", seed=seed), _point(end))
        except Infeasible:
            continue
        if is_free(problem, end, q):
            yield q


def _point(end: str) -> int:
    return 0 if end == "start" else -1
