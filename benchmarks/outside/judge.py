"""The outside judge of one problem, and what the problem asks of distances along a trajectory."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from outside.arm import Arm, Solid, placed, solid_geometry
from outside.conditions import RELATIVE, Condition, judge_ends, judge_limits, judge_turn, margin_of
from outside.distances import (
    NEAR,
    Clearance,
    Nearest,
    Pair,
    Poses,
    least_margin,
    near_distances,
    owners_of,
    signed_distance,
)
from outside.files import BadInput
from outside.holding import judge_holding, read_holding
from outside.problem import Distances, Problem, read_problem
from outside.trajectory import Samples, Trajectory
from outside.tube import CONDITIONS, Least, Visits, judge_points, judge_tube
from outside.tube_fields import OF_TOOL

SAMPLES = 5000
PARTS = 20  # into which steps are divided where links come nearest
REPORTED = tuple(name for name in CONDITIONS if name != "clearance")  # by pairs of solids instead


@dataclass(frozen=True, eq=False)
class NearEnd:
    """What is asked of a pair in contact while the tool is near an end.

    Attributes:
        owners: The pair.
        segment: The first or the last.
        tool: Where the tool is at that end, shape (3,) [m].
        within: How far from there it may be [m].
        distance: How far apart the two are at that end [m].
    """

    owners: frozenset[str]
    segment: int
    tool: np.ndarray
    within: float
    distance: float


class Required:
    """What a problem asks of the distances of pairs along a trajectory.

    Attributes:
        pairs: Obstacle pairs and link pairs, P in all.
        changes: Whether that is not the same all along.
    """

    def __init__(
        self,
        problem: Problem,
        arm: Arm,
        obstacle_pairs: list[Pair],
        link_pairs: list[Pair],
        trajectory: Trajectory,
    ) -> None:
        """Take what is asked.

        Raises:
            BadInput: A pair with a clearance of its own, or in contact, is not held apart at all.
        """
        self.pairs = [*obstacle_pairs, *link_pairs]
        _require_checked(problem.distances, {owners_of(pair) for pair in self.pairs})
        self._arm, self._trajectory = arm, trajectory
        tube, asked = problem.tube, problem.distances
        own = [tube.clearance] * len(obstacle_pairs) + [0 * tube.clearance] * len(link_pairs)
        self._own = [
            np.full_like(each, asked.pairs.get(owners_of(pair), each))
            for pair, each in zip(self.pairs, own, strict=True)
        ]
        is_given = bool({"joints", "seed", "pose"} & set(problem.goal))
        self._ends = _near_ends(asked, arm, self.pairs, trajectory, is_given, len(tube.radius))
        self.changes = bool(asked.contacts) or bool(np.ptp(tube.clearance) > 0)

    def margin(self, samples: Samples) -> np.ndarray:
        """Return what the worst pair has left in all segments, (N, m) [m]; infinite if plenty."""
        q = self._trajectory.at(samples)
        poses, tool = Poses(*self._arm.poses(q)), self._arm.tool(q)[1]
        margin = np.full((len(q), len(self._own[0]) if self._own else 1), np.inf)
        for k, pair in enumerate(self.pairs):
            asked = self._of_pair(k, tool)
            distance = near_distances(pair, poses, asked.max(axis=1) + NEAR)
            margin = np.minimum(margin, distance[:, None] - asked)
        return margin

    def at(self, samples: Samples, current: np.ndarray) -> np.ndarray:
        """Return the most that current segments (N, m) ask of all pairs, shape (N, P) [m]."""
        tool = self._arm.tool(self._trajectory.at(samples))[1]
        columns = [
            np.where(current, self._of_pair(k, tool), -np.inf).max(axis=1)
            for k in range(len(self.pairs))
        ]
        return np.reshape(columns, (len(self.pairs), len(samples))).T

    def _of_pair(self, k: int, tool: np.ndarray) -> np.ndarray:
        """Return what all segments ask of a pair while the tool is at places (N, 3), (N, m)."""
        asked = np.tile(self._own[k], (len(tool), 1))
        for end in self._ends:
            if end.owners == owners_of(self.pairs[k]):
                here = np.linalg.norm(tool - end.tool, axis=1) <= end.within
                less = np.minimum(asked[here, end.segment], end.distance)
                asked[here, end.segment] = less
        return asked


class Judge:
    """Judges trajectories for one problem, whose robot and meshes are read once.

    Attributes:
        problem: What is asked.
        arm: Its arm.
        clearance: Which solids must stay apart.
        holding: What the tool must not lose.
    """

    def __init__(self, given: str | Path | Problem) -> None:
        """Take a problem, or read its file.

        Raises:
            BadInput: It cannot be judged.
        """
        self.problem = given if isinstance(given, Problem) else read_problem(Path(given))
        try:
            self.arm = Arm(self.problem)
            _require_names(self.problem, self.arm)
            self.clearance = Clearance(self.problem, self.arm, obstacles_of(self.problem))
            self.holding = read_holding(self.problem.holding)
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
            where = "" if isinstance(given, Problem) else f"{given}: "
            raise BadInput(f"{where}{type(error).__name__}: {error}") from error

    def judge(self, trajectory: Trajectory, count: int = SAMPLES) -> dict[str, Condition]:
        """Return all conditions by name, seen at a count of uniform samples and where it matters.

        Raises:
            BadInput: The trajectory is of other joints than the problem's.
        """
        trajectory = trajectory.ordered(self.arm.joint_names)
        samples = trajectory.samples(count)
        found = judge_limits(self.arm, trajectory, samples)
        found["holding"] = judge_holding(self.holding, self.arm, trajectory, samples)
        checked = self.clearance.obstacle_pairs, self.clearance.link_pairs
        required = Required(self.problem, self.arm, *checked, trajectory)
        in_tube, visits = self._tube(trajectory, samples, required)
        found |= in_tube
        found |= judge_ends(self.problem, self.arm, trajectory)
        turn = judge_turn(self.problem, self.arm, trajectory)
        found["rotation"] = min(found["rotation"], turn, key=margin_of)
        return found | self._clearance(trajectory, samples, required, visits)

    def _tube(
        self, trajectory: Trajectory, samples: Samples, required: Required
    ) -> tuple[dict[str, Condition], Visits]:
        given = self.problem.tube, self.arm, trajectory, samples
        clearance = required.margin if required.changes else None
        least, visits = judge_tube(*given, clearance)
        found = {name: self._tube_condition(name, least[name]) for name in REPORTED}
        passed = judge_points(*given, clearance)
        return found | {"points": self._tube_condition("points", passed)}, visits

    def _tube_condition(self, name: str, least: Least) -> Condition:
        joint = least.joint
        slides = joint is not None and self.arm.slides[joint]
        unit = "m" if name in ("tube", "points") or slides else "rad"
        unit = RELATIVE if name in OF_TOOL else unit
        if not np.isfinite(least.margin):
            return Condition(None, unit)
        numbers = self.problem.tube.numbers
        first, last = numbers[least.segment], numbers[least.segment + 1] - 1
        where = f"segment {first}" if first >= last else f"segments {first} to {last}"
        if least.point is not None:
            where = f"point {numbers[least.point]}"
        if joint is not None:
            where += f", joint {self.arm.joint_names[joint]}"
        return Condition(least.margin, unit, least.time, where)

    def _clearance(
        self, trajectory: Trajectory, samples: Samples, required: Required, visits: Visits
    ) -> dict[str, Condition]:
        """Return the conditions on distances, at the visits' own samples if segments differ."""
        samples = visits.samples if required.changes else samples
        poses = Poses(*self.arm.poses(trajectory.at(samples)))
        asked = self._required(samples, required, visits)
        found, count = {}, len(self.clearance.obstacle_pairs)
        kinds = {"obstacles": slice(count), "self_collision": slice(count, None)}
        for name, own in kinds.items():
            pairs = required.pairs[own]
            nearest, near = least_margin(pairs, poses, asked[:, own])
            finer = samples.between(np.concatenate([near - 1, near]), PARTS)
            where = samples
            if name == "obstacles":
                nearest = min(nearest, self.clearance.inside(poses, 0), key=lambda one: one.margin)
            if len(finer):
                there = Poses(*self.arm.poses(trajectory.at(finer)))
                asked_there = self._required(finer, required, visits)[:, own]
                closer, _ = least_margin(pairs, there, asked_there)
                nearest, where = min(
                    (nearest, where), (closer, finer), key=lambda one: one[0].margin
                )
            found[name] = _clearance_condition(nearest, where)
        return found

    def _required(self, samples: Samples, required: Required, visits: Visits) -> np.ndarray:
        return required.at(samples, visits.current(samples, len(self.problem.tube.radius)))


def obstacles_of(problem: Problem) -> list[Solid]:
    """Return a problem's obstacles."""
    folders = [problem.folder / folder for folder in problem.robot.get("package_dirs") or []]
    solids = []
    for fields in problem.obstacles:
        geometry, placement = solid_geometry(fields, problem.folder, folders)
        solids.append(placed(str(fields["name"]), "obstacle", 0, placement, geometry))
    return solids


def _require_checked(asked: Distances, checked: set[frozenset[str]]) -> None:
    for names in [*asked.pairs, *(contact.links for contact in asked.contacts)]:
        if names not in checked:
            raise BadInput(f"{' and '.join(sorted(names))} are not held against each other")


def _near_ends(
    asked: Distances,
    arm: Arm,
    pairs: list[Pair],
    trajectory: Trajectory,
    is_given: bool,
    count: int,
) -> list[NearEnd]:
    """Return what contacts ask; of a goal whose configuration is open, that none overlap."""
    q = trajectory.at(trajectory.samples(2))[[0, -1]]
    poses, tool = Poses(*arm.poses(q)), arm.tool(q)[1]
    found = []
    for contact in asked.contacts:
        own = [pair for pair in pairs if owners_of(pair) == contact.links]
        for row, has_end in enumerate((contact.at_start, contact.at_goal)):
            if not has_end:
                continue
            distance = 0.0
            if row == 0 or is_given:
                distance = min(signed_distance(pair, poses, row) for pair in own)
            segment = row * (count - 1)
            found.append(NearEnd(contact.links, segment, tool[row], contact.within, distance))
    return found


def _clearance_condition(nearest: Nearest, samples: Samples) -> Condition:
    if not np.isfinite(nearest.margin):
        return Condition(None, "m")
    time = float(samples.time[nearest.row])
    return Condition(nearest.margin, "m", time, " and ".join(nearest.owners))


def _require_names(problem: Problem, arm: Arm) -> None:
    """Raise if ends, signs or ignored pairs are of what does not exist: they would ask nothing."""
    for ranges in problem.tube.ranges:
        if unknown := set(ranges) - set(arm.joint_names):
            raise BadInput(f"tube.joint_signs: '{unknown.pop()}' is no joint of the group")
    for end in (problem.start, problem.goal):
        joints = end.get("joints") or arm.joint_names
        is_named = isinstance(joints, dict) and set(joints) != set(arm.joint_names)
        if is_named or len(joints) != len(arm.joint_names):
            raise BadInput(f"start or goal: joints must be those of {', '.join(arm.joint_names)}")
    solids = [*problem.obstacles, *(problem.robot.get("attached") or [])]
    known = arm.links | {str(solid.get("name")) for solid in solids}
    for pair in problem.ignored:
        if unknown := set(pair) - known:
            raise BadInput(f"collision.ignore: '{unknown.pop()}' is no link or solid")
