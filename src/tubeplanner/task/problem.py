"""PlanningProblem: robot, tube, start, goal, obstacles, objective; checks of its parts."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.geometry.collision_checker import CollisionChecker, CollisionScene
from tubeplanner.geometry.solids import MAX_SIZE, AttachedSolid, Obstacle
from tubeplanner.geometry.tube.rotation import RotationalTube
from tubeplanner.geometry.tube.tube import Tube, joined_segments
from tubeplanner.outcome import MARGIN_TOLERANCE, ContradictionError, Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.demands import (
    ENERGY,
    Contact,
    Names,
    Objective,
    Robustness,
    pair_distances,
    require_checked,
    require_period,
)
from tubeplanner.task.endpoints import (
    Endpoint,
    GoalRegion,
    Seed,
    ToolPose,
    configuration_of,
    endpoint_of,
)
from tubeplanner.task.holding import Holding, holdings_of, loss_at_rest


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """The problem that `plan` solves.

    Attributes:
        robot: The arm.
        tube: Region of the tool centre point.
        start: Configuration (n,) [rad or m] in group order, or a map by joint name, or a Seed, or a
            ToolPose.
        goal: The same for the last point. None: the tool at the last point, in a configuration
            that the plan chooses; a GoalRegion: the tool in a ball, in such a configuration.
        obstacles: Solids in the base frame.
        attached: Solids in the tool frame, carried by the tool.
        clearance: Least distance between any moving link and any obstacle [m]; segments of the tube
            may have others.
        pair_clearances: Clearances of pairs, by names of links or obstacles [m].
        contacts: Solids that may be nearer at start or goal.
        self_collision: True if links are checked against each other.
        ignore_collisions: Pairs of names of links or obstacles that may touch.
        objective: Objective beside the shortest duration.
        period: Of the controller [s]: duration and breakpoints are multiples of it; None: any.
        robustness: Errors that the plan must survive in simulation; None: none.
        holding: Parts that the tool holds by contact, and must not lose.
        name: Name in messages and plots.
        notes: Sentences on implausible values of its file.
        joint_lower: Lower bounds of joints per segment, from limits and signs, (m, n) [rad or m].
        joint_upper: Upper bounds of joints per segment, from limits and signs, (m, n) [rad or m].

    Raises:
        ProblemError: On construction, if start, goal or a seed break a limit, a sign, their
            segment's region or rotation tolerance, a goal region bounds the rotation without
            orientations of the tube, the tube names a joint outside the planning group, a
            clearance is negative, a pair of solids is not checked, or a value is of another kind.
    """

    robot: RobotModel
    tube: Tube
    start: FloatArray | Seed | ToolPose
    goal: FloatArray | Seed | ToolPose | GoalRegion | None = None
    obstacles: Sequence[Obstacle] = ()
    attached: Sequence[AttachedSolid] = ()
    clearance: float = 0.0
    pair_clearances: Mapping[Names, float] = field(default_factory=dict)
    contacts: Sequence[Contact] = ()
    self_collision: bool = True
    ignore_collisions: Sequence[tuple[str, str]] = ()
    objective: Objective | None = None
    period: float | None = None
    robustness: Robustness | None = None
    holding: Sequence[Holding] = ()
    name: str = "problem"
    notes: tuple[str, ...] = ()
    joint_lower: FloatArray = field(init=False)
    joint_upper: FloatArray = field(init=False)
    _scene: CollisionScene | None = field(default=None, repr=False)
    _is_part: bool = field(default=False, repr=False)  # of a motion that does not stop at its ends

    def __post_init__(self) -> None:
        require_parts(self, "robot", "tube", "self_collision", "name")
        for group in ("obstacles", "attached", "ignore_collisions", "contacts"):
            self._keep(group, given_members(group, getattr(self, group)))
        # The scene of another problem stays unless its robot or solids were replaced.
        scene = CollisionScene(
            self.robot,
            tuple(self.obstacles),
            tuple(self.attached),
            self.self_collision,
            tuple(self.ignore_collisions),
        )
        if self._scene is None or not self._scene.is_as(scene):
            self._keep("_scene", scene)
        self._keep_joint_bounds()
        if not self._is_part:
            self._require_free_ends()
        self._keep("start", self._checked_end("start", self.start, 0))
        last = self.tube.segment_count - 1
        if isinstance(self.goal, GoalRegion):
            self._require_in_region("goal", "goal.position", self.goal.position, last)
            if self.goal.rotation_tolerance is not None and self.tube.orientations is None:
                raise ProblemError(
                    "goal.rotation_tolerance is about the tube's last orientation, but "
                    "tube.orientations is not given; give both it and tube.rotation_tolerance "
                    "(.inf where the tool is free on the way), or leave goal.rotation_tolerance out"
                )
        elif self.goal is not None:
            self._keep("goal", self._checked_end("goal", self.goal, last))
        if self.tube.route is not None:
            self._require_route(self.tube.route)
        if not is_number(self.clearance) or not 0 <= self.clearance <= MAX_SIZE:
            raise ProblemError(
                f"clearance is {in_figures(self.clearance)} m; 0 to {MAX_SIZE:g} m are accepted"
            )
        self._keep("pair_clearances", pair_distances(self.pair_clearances))
        if self.pair_clearances:
            require_checked(self.collision, "clearance.pairs", self.pair_clearances)
        if self.contacts:
            require_checked(self.collision, "contacts", (each.links for each in self.contacts))
        require_parts(self, "objective", "robustness")
        self._keep("holding", holdings_of(self.holding))
        self._require_held_at_ends()
        if self.objective is not None and self.objective.minimise == ENERGY:
            self.objective.energy_weights(self.robot)
        if self.period is not None:
            duration = None if self.objective is None else self.objective.duration
            require_period(self.period, duration)

    def _require_free_ends(self) -> None:
        """Raise ProblemError if the motion rests, or may rest, where it has a least speed."""
        tube = self.tube
        if tube.stretches and tube.visit == "any":
            raise ProblemError(
                "tube.tool_speed has a band, which does not go with visit: any; leave visit out, "
                "so that segments are visited in order"
            )
        floor, most = tube.least_tool_speed, self.robot.limits.tool_speed
        if floor is None:
            return
        for k in np.flatnonzero(np.isfinite(floor) & (floor >= most)).tolist():
            raise ProblemError(
                f"tube.tool_speed: segment {tube.segment_number(k)} has a least speed of "
                f"{floor[k]:g} m/s, but robot.limits.tool_speed is {most:g} m/s; lower the band or "
                "raise that limit"
            )
        for end, k in (("begins", 0), ("ends", tube.segment_count - 1)):
            if np.isfinite(floor[k]):
                raise ProblemError(
                    f"tube.tool_speed: segment {tube.segment_number(k)} has a least speed of "
                    f"{floor[k]:g} m/s, but the motion {end} in it, at rest; give "
                    "the tube a segment beside it for the tool to speed up or slow down"
                )

    def __repr__(self) -> str:
        robot, solids = self.robot, len(self.obstacles)
        kinds = [end.kind for end in self.endpoints]
        held = "".join(f", holding: {each.kind}" for each in self.holding)
        return (
            f"<PlanningProblem {self.name}: {robot.joint_count} joints of {robot.name} to "
            f"{robot.tool_frame}, {self.tube.segment_count} segments, {solids} "
            f"obstacle{'s' * (solids != 1)}, start by {kinds[0]}, goal {kinds[1]}{held}>"
        )

    @cached_property
    def endpoints(self) -> tuple[Endpoint, Endpoint]:
        """The start and the goal."""
        points = self.tube.points
        return endpoint_of(self.start, points[0]), endpoint_of(self.goal, points[-1])

    @cached_property
    def end_radii(self) -> FloatArray:
        """Radii of the balls about the first and the last reference point, shape (2,) [m].

        A start from a seed and an open goal have the tool anywhere in the ball where the arm does
        not reach the point. 0 for arms whose tool moves in three directions: it has to be there.
        """
        ends = self.tube.effective_radius[[0, -1]]
        return read_only(ends * (self.robot.tool_directions < 3))

    @property
    def given_goal(self) -> FloatArray | Seed | ToolPose | None:
        """Configuration, seed or pose of the goal; None if the goal is open."""
        return None if self.endpoints[1].is_open else self.goal  # type: ignore[return-value]

    @property
    def open_goal(self) -> GoalRegion | None:
        """Region of an open goal; None if the goal is not open."""
        return self.endpoints[1].region

    @cached_property
    def rotation(self) -> RotationalTube | None:
        """Rotational part of the tube, with an added segment if the goal bounds the rotation."""
        return self.tube.rotation if self.open_goal is None else self.open_goal.rotation(self.tube)

    @property
    def collision(self) -> CollisionChecker:
        """Checker of the robot's links and the obstacles."""
        return self.scene.checker

    @cached_property
    def scene(self) -> CollisionScene:
        """Robot and solids; problems that differ in tube, start or goal alone share the scene.

        Where covers of links overlap in a configuration of start or goal, closer ones are tried,
        since every motion has that configuration.
        """
        assert self._scene is not None
        ends = [end.joints for end in self.endpoints if end.joints is not None]
        self._keep("_scene", self._scene.free_at(ends))
        return self._scene

    @cached_property
    def distinct_joint_bounds(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Different rows of `joint_lower` and `joint_upper`, and the row of each segment.

        Lower and upper bounds, (u, n) each [rad or m], and the row of each of m segments, (m,).
        """
        both = np.hstack([self.joint_lower, self.joint_upper])
        rows, bounds_of = np.unique(both, axis=0, return_inverse=True)
        lower, upper = map(read_only, np.hsplit(rows, 2))
        bounds_of = bounds_of.ravel()
        bounds_of.setflags(write=False)
        return lower, upper, bounds_of

    @property
    def solids(self) -> dict[str, Any]:
        """Arguments of another problem of this robot that shares its solids."""
        names = ("obstacles", "attached", "self_collision", "ignore_collisions", "_scene")
        return {name: getattr(self, name) for name in names}

    @property
    def has_free_tool(self) -> bool:
        """True if the tube excludes no motion from start to goal."""
        tube, rotation = self.tube, self.tube.rotation
        is_bound = any(tube.joint_ranges)
        is_bound |= rotation is not None and bool(np.isfinite(rotation.bounds).any())
        return tube.is_anywhere and tube.segment_count == 1 and not is_bound

    @property
    def has_one_clearance(self) -> bool:
        """True if all links, obstacles and segments have the same clearance."""
        return not (self.pair_clearances or self.contacts or self.tube.clearance is not None)

    @cached_property
    def joined(self) -> "PlanningProblem":
        """Problem with equal, collinear neighbouring segments joined.

        Planner and certificate take the joined problem. The problem itself if nothing is joined.
        """
        tube = self._joined_tube
        return self if tube is self.tube else replace(self, tube=tube)

    @cached_property
    def _joined_tube(self) -> Tube:
        return joined_segments(self.tube)

    @staticmethod
    def require(problem: object) -> None:
        """Raise ProblemError unless a value is a PlanningProblem."""
        if not isinstance(problem, PlanningProblem):
            raise ProblemError(
                f"the problem is {shown(problem)}; give a PlanningProblem, as load_problem returns"
            )

    def with_tube(self, tube: Tube, goal: FloatArray | None = None) -> "PlanningProblem":
        """Return the problem with another tube; robot and collision geometry are shared.

        Args:
            tube: The other tube.
            goal: Another goal (n,) [rad or m]; None: the same.

        Raises:
            ProblemError: As on construction: start or goal may lie outside the other tube.
        """
        return replace(self, tube=tube, goal=self.goal if goal is None else goal)

    def along(self, tube: Tube, start: FloatArray | Seed | ToolPose) -> "PlanningProblem":
        """Return the problem with another tube and start and an open goal; the scene is shared.

        Raises:
            ProblemError: As on construction.
        """
        return replace(self, tube=tube, start=start, goal=None)

    def farther_apart(self, by: float) -> "PlanningProblem":
        """Return the problem with all clearances larger by a distance [m], contacts unchanged.

        Between links, only the clearances of pairs.
        """
        tube, pairs = self.tube, self.pair_clearances.items()
        if tube.clearance is not None:
            tube = replace(tube, clearance=tube.clearance + by)
        wider = {names: clearance + by for names, clearance in pairs}
        return replace(self, tube=tube, clearance=self.clearance + by, pair_clearances=wider)

    def _require_route(self, route: FloatArray) -> None:
        """Raise unless a route (P, n) leads from the start to the goal inside limits."""
        for k, q in enumerate(route):
            configuration_of(self.robot, f"tube.route[{k}]", q)
            self._require_within_limits(f"tube.route[{k}]", q)
        for k, (name, end) in enumerate(zip(("start", "goal"), self.endpoints, strict=True)):
            if end.joints is None:
                raise ProblemError(f"{name}.joints is required: tube.route leads there")
            away = abs(route[-k] - end.joints)
            if away.max() > MARGIN_TOLERANCE:
                joint = int(away.argmax())
                raise ProblemError(
                    f"tube.route {('begins', 'ends')[k]} with joint "
                    f"'{self.robot.joint_names[joint]}' at {route[-k, joint]:g}, the {name} has it "
                    f"at {end.joints[joint]:g}; give both the same, or find another route "
                    "(`tubeplanner route`)"
                )

    def _require_held_at_ends(self) -> None:
        """Raise unless the held parts are held at rest in given configurations of the ends."""
        kinds = [each.kind for each in self.holding if each.kind in ("tray", "liquid")]
        if kinds and not self.robot.gravity.any():
            raise ProblemError(
                f"holding: a {kinds[0]} takes gravity, and robot.gravity is [0, 0, 0]; give "
                "robot.gravity, or hold the part by a cup or a gripper"
            )
        for name, end in zip(("start", "goal"), self.endpoints, strict=True):
            if end.joints is None:
                continue
            if (loss := loss_at_rest(self.robot, self.holding, end.joints)) is not None:
                segment = 0 if name == "start" else self.tube.segment_count - 1
                number = self.tube.segment_number(segment)
                raise ContradictionError(
                    f"{name}: {loss}; turn the tool there, or hold the part better",
                    self._location_of(name, number, self.robot.tool_position(end.joints)),
                    configuration=end.joints,
                )

    def _keep(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _checked_end(
        self, end: str, value: FloatArray | Seed | ToolPose, segment: int
    ) -> FloatArray | Seed | ToolPose:
        """Return start or goal in group order; raise unless inside limits and tube."""
        if isinstance(value, ToolPose):
            seed = None if value.seed is None else self._checked_seed(end, value.seed)
            self._require_tool_inside(end, value.rotation[None], value.position[None], segment)
            return replace(value, seed=seed)
        if isinstance(value, Seed):
            return Seed(self._checked_seed(end, value.joints))
        q = configuration_of(self.robot, end, value)
        self._require_inside(end, q, segment)
        return q

    def _checked_seed(self, end: str, value: FloatArray) -> FloatArray:
        """Return a seed in group order; raise unless inside limits."""
        seed = configuration_of(self.robot, f"{end}.seed", value)
        self._require_within_limits(f"{end}.seed", seed)
        return seed

    def _require_within_limits(self, what: str, q: FloatArray) -> None:
        """Raise unless a configuration (n,), with a label, is inside position limits."""
        limits = self.robot.limits
        low = limits.lower_position - MARGIN_TOLERANCE
        high = limits.upper_position + MARGIN_TOLERANCE
        for joint in np.flatnonzero((q < low) | (q > high)):
            name = self.robot.joint_names[joint]
            raise ContradictionError(
                f"{what}: joint '{name}' at {q[joint]:g} is outside its "
                f"position limits {limits.range_text(int(joint))} (radians and metres are meant)",
                Location(joint=name),
                configuration=q,
            )

    def _require_inside(self, end: str, q: FloatArray, segment: int) -> None:
        """Raise unless a configuration (n,) is inside joint ranges and tube of its segment."""
        number = self.tube.segment_number(segment)
        lower, upper = self.joint_lower[segment], self.joint_upper[segment]
        rotation, tool = self.tube.tool_pose(self.robot, q[None])
        for name, value, low, high in zip(self.robot.joint_names, q, lower, upper, strict=True):
            if not low - MARGIN_TOLERANCE <= value <= high + MARGIN_TOLERANCE:
                raise ContradictionError(
                    f"{end}: joint '{name}' at {value:g} is outside [{low:g}, {high:g}], its "
                    f"position limits and joint sign in segment {number}",
                    Location(joint=name, segment=number).at(tool[0]),
                    configuration=q,
                )
        try:
            self._require_tool_inside(end, rotation, tool, segment)
        except ContradictionError as error:
            raise ContradictionError(str(error), error.location, configuration=q) from error

    def _require_tool_inside(
        self, end: str, rotation: FloatArray, tool: FloatArray, segment: int
    ) -> None:
        """Raise unless rotation (1, 3, 3) and position (1, 3) of a tool are inside its segment."""
        self._require_in_region(end, f"{end}: the tool", tool[0], segment)
        number = self.tube.segment_number(segment)
        tube, joined = self._joined_tube.rotation, 0 if end == "start" else -1
        if tube is None or tube.margin(rotation, tool, joined)[0] >= -MARGIN_TOLERANCE:
            return
        error = tube.error(rotation, tool, joined)[0]
        errors = [*error.tolist(), float(np.linalg.norm(error))]
        worst = int((abs(np.array(errors)) - tube.bounds[joined]).argmax())
        about = "" if worst == 3 else f" about {'xyz'[worst]} of the reference orientation"
        raise ContradictionError(
            f"{end}: the tool is turned by {errors[worst]:.4g} rad{about}, where the rotation "
            f"tolerance of segment {number} is {tube.bounds[joined, worst]:.4g} rad; turn the "
            f"{end}, change tube.orientations[{number + (end == 'goal')}] or widen "
            f"tube.rotation_tolerance[{number}]",
            self._location_of(end, number, tool[0]),
        )

    def _require_in_region(self, end: str, what: str, tool: FloatArray, segment: int) -> None:
        """Raise unless a tool position (3,), with a label, is in the region of a segment."""
        margin = float(self._joined_tube.margin(tool[None])[0, 0 if end == "start" else -1])
        if margin < -MARGIN_TOLERANCE:
            point = self.tube.points[segment + (end == "goal")]
            region = "box" if self.tube.is_box[segment] else "capsule"
            number = self.tube.segment_number(segment)
            raise ContradictionError(
                f"{what} is at {np.round(tool, 4).tolist()} m, {-margin:.3g} m outside "
                f"the {region} of segment {number} (its end point is "
                f"{point.tolist()} m); move the {end} or the reference point",
                self._location_of(end, number, tool),
            )

    def _location_of(self, end: str, number: int, tool: FloatArray) -> Location:
        """Return the place of an end in a numbered segment, the tool at a position (3,)."""
        point = self.tube.numbers[0 if end == "start" else -1]
        return Location(segment=number, point=int(point)).at(tool)

    def _keep_joint_bounds(self) -> None:
        """Keep the intersection of position limits and the tube's joint ranges, (m, n)."""
        names, limits = self.robot.joint_names, self.robot.limits
        for ranges in self.tube.joint_ranges:
            for joint in ranges:
                if joint not in names:
                    raise ProblemError(f"tube.joint_signs: {unknown_name('joint', joint, names)}")
        lower, upper = self.tube.ranges_of(names)
        lower = np.maximum(lower, limits.lower_position)
        upper = np.minimum(upper, limits.upper_position)
        for segment, joint in np.argwhere(lower > upper):
            number = self.tube.segment_number(segment)
            gap = lower[segment, joint] - upper[segment, joint]
            raise ContradictionError(
                f"tube.joint_signs: joint '{names[joint]}' has no value left in segment {number}: "
                f"signs and position limits {limits.range_text(joint)} ask for "
                f">= {lower[segment, joint]:g} and <= {upper[segment, joint]:g}",
                Location(joint=names[joint], segment=number),
                proved=(self.tube.visit == "ordered" and gap > 2 * MARGIN_TOLERANCE) or None,
            )
        self._keep("joint_lower", read_only(lower))
        self._keep("joint_upper", read_only(upper))


# ---- Checks of the parts of problems and cycles that are made in Python.

_FLAG = (bool, "True or False")
_PARTS = {
    "robot": (RobotModel, "a RobotModel, as load_robot returns"),
    "tube": (Tube, "a Tube"),
    "objective": (Objective | None, "an Objective"),
    "robustness": (Robustness | None, "a Robustness"),
    "payload": (Payload | None, "a Payload"),
    "solid": (AttachedSolid | None, "an AttachedSolid"),
    "name": (str, "text"),
    "self_collision": _FLAG,
    "closed": _FLAG,
    "passes_through": _FLAG,
    "leaves_obstacle": _FLAG,
}
_MEMBERS = {
    "obstacles": (Obstacle, "Obstacle.box, .sphere, .cylinder, .capsule or .mesh"),
    "attached": (AttachedSolid, "AttachedSolid"),
    "ignore_collisions": (list | tuple, "pairs of names"),
    "contacts": (Contact, "Contact"),
}


def require_parts(holder: object, *names: str, label: str = "") -> None:
    """Raise ProblemError unless attributes of a problem, a cycle or a step are of their kind."""
    for name in names:
        kind, remedy = _PARTS[name]
        if not isinstance(value := getattr(holder, name), kind):
            raise ProblemError(f"{label}{name} is {shown(value)}; give {remedy}")


def given_members(group: str, value: object, label: str = "") -> tuple[Any, ...]:
    """Return a group of solids, contacts or pairs of names, or a single member, as a tuple."""
    kind, remedy = _MEMBERS[group]
    members: tuple[Any, ...] = (value,)
    # An array without dimensions is an Iterable, but cannot be iterated.
    if isinstance(value, Iterable) and getattr(value, "ndim", 1) > 0:
        members = tuple(value)
    for k, member in enumerate(members):
        is_valid = isinstance(member, kind)
        if is_valid and group == "ignore_collisions":
            is_valid = len(member) == 2 and all(isinstance(name, str) for name in member)
        if not is_valid:
            raise ProblemError(f"{label}{group}[{k}] is {shown(member)}; give {remedy}")
    return members
