"""The outside judge of one problem."""

from pathlib import Path

import numpy as np

from outside.arm import Arm, Solid, placed, solid_geometry
from outside.clearance import Clearance
from outside.files import BadInput
from outside.goal import judge_turn
from outside.limits import judge_ends, judge_limits
from outside.nearest import Nearest, Poses, least_margin
from outside.problem import Problem, read_problem
from outside.required import Required
from outside.trajectory import Samples, Trajectory
from outside.tube import CONDITIONS, Least, judge_points, judge_tube
from outside.verdict import RELATIVE, Condition, margin_of
from outside.visits import Visits

SAMPLES = 5000
PARTS = 20  # into which steps are divided where links come nearest
REPORTED = tuple(name for name in CONDITIONS if name != "clearance")  # by pairs of solids instead


class Judge:
    """Judges trajectories for one problem, whose robot and meshes are read once.

    Attributes:
        problem: What is asked.
        arm: Its arm.
        clearance: Which solids must stay apart.
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
        unit = RELATIVE if name == "tool_speed" else unit
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
        asked = self._asked(samples, required, visits)
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
                asked_there = self._asked(finer, required, visits)[:, own]
                closer, _ = least_margin(pairs, there, asked_there)
                nearest, where = min(
                    (nearest, where), (closer, finer), key=lambda one: one[0].margin
                )
            found[name] = _clearance_condition(nearest, where)
        return found

    def _asked(self, samples: Samples, required: Required, visits: Visits) -> np.ndarray:
        return required.at(samples, visits.current(samples, len(self.problem.tube.radius)))


def obstacles_of(problem: Problem) -> list[Solid]:
    """Return a problem's obstacles."""
    folders = [problem.folder / folder for folder in problem.robot.get("package_dirs") or []]
    solids = []
    for fields in problem.obstacles:
        geometry, placement = solid_geometry(fields, problem.folder, folders)
        solids.append(placed(str(fields["name"]), "obstacle", 0, placement, geometry))
    return solids


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
