"""Start and goal: joints, tool pose or goal region; checks of both."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.checks import are_numbers, in_figures, is_number
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.geometry.solids import MAX_SIZE
from tubeplanner.geometry.tube.rotation import (
    RotationalTube,
    RotationBound,
    rotation_bound,
    rotational_tube,
)
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.robot.model import RobotModel
from tubeplanner.text import short_repr


def configuration_of(robot: RobotModel, what: str, values: Any) -> FloatArray:
    """Return a configuration (n,) [rad or m] from joint values in group order or by joint name."""
    names = robot.joint_names
    if isinstance(values, Mapping):
        for name in values:
            if name not in names:
                raise ProblemError(f"{what}: {unknown_name('joint', name, names)}")
        missing = [name for name in names if name not in values]
        if missing:
            raise ProblemError(f"{what}: no value for joint {', '.join(missing)}")
        values = [values[name] for name in names]
    try:
        if any(isinstance(value, bool) for value in values):
            raise TypeError("a truth value is no number")
        q = read_only(values)
    except (TypeError, ValueError) as error:
        raise ProblemError(
            f"{what} {shown(values)} must be numbers, one per joint ({error})"
        ) from None
    if q.shape != (len(names),):
        raise ProblemError(
            f"{what} has {q.size} values for the {len(names)} joints {', '.join(names)}"
        )
    if not np.isfinite(q).all():
        raise ProblemError(f"{what} must be finite numbers")
    return q


_ORTHONORMAL = 1e-6  # largest entry of R R^T - 1 by which a matrix still is a rotation


@dataclass(frozen=True, eq=False)
class ToolPose:
    """Pose of the tool centre point, on the branch of the tube's joint ranges.

    Attributes:
        placement: Shape (4, 4), base frame [m], as `placement_of` returns.
        seed: Start of inverse kinematics, (n,) in group order or a map by joint name [rad or m];
            None: several configurations spread over the joint ranges.

    Raises:
        ProblemError: On construction, if the placement is no rotation and translation.
    """

    placement: FloatArray
    seed: FloatArray | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        try:
            placement = read_only(self.placement)
        except (TypeError, ValueError):
            raise _no_placement(self.placement) from None
        if placement.shape != (4, 4) or not (abs(placement) <= MAX_SIZE).all():
            raise _no_placement(self.placement)
        r = placement[:3, :3]
        error = float(abs(r @ r.T - np.eye(3)).max())
        if error > _ORTHONORMAL or np.linalg.det(r) < 0 or (placement[3] != (0, 0, 0, 1)).any():
            raise _no_placement(placement.tolist())
        object.__setattr__(self, "placement", placement)

    @property
    def position(self) -> FloatArray:
        """Position of the tool centre point, base frame, shape (3,) [m]."""
        return self.placement[:3, 3]

    @property
    def rotation(self) -> FloatArray:
        """Rotation matrix of its frame, base frame, shape (3, 3)."""
        return self.placement[:3, :3]

    def errors(self, rotation: FloatArray, position: FloatArray) -> tuple[float, float]:
        """Return distance [m] and angle [rad] of a tool's rotation (3, 3) and position (3,)."""
        error = self.rotation.T @ rotation
        # From sine and cosine: each alone is insensitive at some angles.
        twice_sine = np.linalg.norm((error - error.T)[[2, 0, 1], [1, 2, 0]])
        angle = np.arctan2(twice_sine, np.trace(error) - 1)
        return float(np.linalg.norm(position - self.position)), float(angle)


def _no_placement(value: object) -> ProblemError:
    return ProblemError(
        f"a tool pose's placement is {shown(value)}; give a rotation and translation (4, 4), at "
        f"most {MAX_SIZE:g} m away, made with placement_of"
    )


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """Ball in which the tool centre point ends; the plan chooses the configuration.

    Attributes:
        position: Centre, shape (3,), base frame [m].
        tolerance: Radius [m]; 0: the tool ends at the centre.
        rotation_tolerance: Bound on the rotation from the tube's last orientation: one angle, or
            bounds on the three components of log(R_ref^T R) [rad]; None: the tube's.

    Raises:
        ProblemError: On construction, if a value is of another kind or out of its bounds.
    """

    position: FloatArray
    tolerance: float = 0.0
    rotation_tolerance: RotationBound | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not are_numbers(self.position, 3):
            raise ProblemError(
                f"goal.position is {shown(self.position)}; give [x, y, z], finite numbers [m]"
            )
        object.__setattr__(self, "position", read_only(np.array(self.position, dtype=float)))
        if not is_number(self.tolerance) or not 0 <= self.tolerance <= MAX_SIZE:
            raise ProblemError(
                f"goal.tolerance is {in_figures(self.tolerance)} m; 0 to {MAX_SIZE:g} m are "
                "accepted"
            )
        if self.rotation_tolerance is not None:
            bound = rotation_bound("goal.rotation_tolerance", self.rotation_tolerance)
            object.__setattr__(self, "rotation_tolerance", bound)

    @property
    def bounds_rotation(self) -> bool:
        """True if the rotation of the tool is bounded."""
        tolerance = self.rotation_tolerance
        return tolerance is not None and bool(np.isfinite(tolerance).any())

    def rotation(self, tube: Tube) -> RotationalTube | None:
        """Return the rotational part of a tube, with an added segment if the goal bounds rotation.

        The segment lies beyond the last point; its reference is the last orientation. None if no
        rotation is bounded.
        """
        if not self.bounds_rotation:
            return tube.rotation
        assert tube.orientations is not None and tube.rotation_tolerance is not None
        assert self.rotation_tolerance is not None
        beyond = 2 * tube.points[-1] - tube.points[-2]
        return rotational_tube(
            np.vstack([tube.points, beyond]),
            np.vstack([tube.orientations, tube.orientations[-1:]]),
            (*tube.rotation_tolerance, self.rotation_tolerance),
        )

    def margin(self, tool: FloatArray) -> float:
        """Return the margin of a tool position (3,) to the ball's surface [m], positive inside."""
        return self.tolerance - self.distance(tool)

    def distance(self, tool: FloatArray) -> float:
        """Return the distance of a tool position (3,) from the centre [m]."""
        return float(np.linalg.norm(tool - self.position))

    def nearest(self, tool: FloatArray, fraction: float = 1.0) -> FloatArray:
        """Return the point (3,) of the ball, its radius scaled, nearest to a tool position (3,)."""
        distance, allowed = self.distance(tool), fraction * self.tolerance
        if distance <= allowed:
            return tool
        nearest: FloatArray = self.position + (tool - self.position) * (allowed / distance)
        return nearest


# ---- Start and goal of any kind.


@dataclass(frozen=True, eq=False)
class Seed:
    """Start of the inverse kinematics of a reference point.

    Attributes:
        joints: Shape (n,), group order [rad or m].
    """

    joints: FloatArray


# Goals of problems and moves; a start is no region and not None.
Goal: TypeAlias = FloatArray | Seed | ToolPose | GoalRegion | None


@dataclass(frozen=True, eq=False)
class Endpoint:
    """A start or goal: a configuration, a tool pose, or a region whose configuration is open.

    Exactly one of `joints`, `pose` and `region` is set, or none of them if a seed alone leads to
    the configuration at the reference point.
    """

    kind: str  # the statement's kind: joints, seed, pose, position, or open
    joints: FloatArray | None = None  # the configuration (n,) [rad or m]
    # the start of inverse kinematics (n,) [rad or m], of a seed or a pose
    seed: FloatArray | None = None
    pose: ToolPose | None = None  # the tool's pose, base frame
    # the ball that the tool ends in; of an open goal the last reference point
    region: GoalRegion | None = None

    @property
    def is_open(self) -> bool:
        """True if the plan chooses the configuration within a region."""
        return self.region is not None

    @property
    def position(self) -> FloatArray | None:
        """The tool's position (3,) [m] of a pose or region; None of joints and seeds."""
        return getattr(self.pose or self.region, "position", None)


def endpoint_of(value: Goal, point: FloatArray) -> Endpoint:
    """Return the endpoint of a start or goal with its reference point (3,) [m]."""
    if isinstance(value, Seed):
        return Endpoint("seed", seed=value.joints)
    if isinstance(value, ToolPose):
        return Endpoint("pose", pose=value, seed=value.seed)
    if isinstance(value, GoalRegion):
        return Endpoint("position", region=value)
    if value is None:
        return Endpoint("open", region=GoalRegion(point))
    return Endpoint("joints", joints=value)
