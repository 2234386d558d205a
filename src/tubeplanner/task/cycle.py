"""Cycle: legs and rests in a changing cell; one PlanningProblem per leg."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, RobotError, shown
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, left, taken
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import Names
from tubeplanner.task.endpoints import Endpoint, Goal, Seed, ToolPose, endpoint_of
from tubeplanner.task.legs import Leg, Rest, RestStep, legs_of
from tubeplanner.task.problem import PlanningProblem, given_members, require_parts
from tubeplanner.task.required_distances import usual_contacts
from tubeplanner.task.steps import Attach, Detach, Step, require_consistent

# ---- The cell around the arm, as steps of a cycle change it.

# Links nearer than this [m] to what is attached touch it.
_TOUCHING = 1e-3


@dataclass(frozen=True, eq=False)
class Cell:
    """What stands in the cell and what the tool carries.

    Attributes:
        obstacles: Solids in the base frame.
        attached: Solids in the tool frame.
        handed_over: Names of what was taken or let go since the arm moved last.
    """

    obstacles: tuple[Obstacle, ...]
    attached: tuple[AttachedSolid, ...]
    handed_over: tuple[str, ...] = ()

    def after(self, step: RestStep, robot: RobotModel, q: FloatArray) -> "Cell":
        """Return the cell after a step.

        Args:
            step: What happens.
            robot: The arm.
            q: The configuration in which it is at rest, shape (n,).
        """
        if isinstance(step, Attach):
            return self._with(step, robot, q)
        if isinstance(step, Detach):
            return self._without(step, robot, q)
        return self

    def _with(self, step: Attach, robot: RobotModel, q: FloatArray) -> "Cell":
        solid, standing = step.solid, self.obstacles
        for obstacle in self.obstacles:
            if obstacle.name == step.name:
                solid = taken(obstacle, _hand_pose(robot, q))
                standing = tuple(each for each in standing if each is not obstacle)
        if solid is None:
            return self
        solid = replace(solid, touch_links=_touching(solid, robot, q))
        handed_over = (*self.handed_over, step.name)
        return Cell(standing, (*self.attached, solid), handed_over)

    def _without(self, step: Detach, robot: RobotModel, q: FloatArray) -> "Cell":
        gone = [solid for solid in self.attached if solid.name == step.name]
        kept = tuple(solid for solid in self.attached if solid not in gone)
        if not gone or not step.leaves_obstacle:
            return replace(self, attached=kept)
        stands = left(gone[0], _hand_pose(robot, q))
        return Cell((*self.obstacles, stands), kept, (*self.handed_over, step.name))


def _hand_pose(robot: RobotModel, q: FloatArray) -> FloatArray:
    """Return the pose of the tool frame, base frame, shape (4, 4)."""
    rotation, position = robot.body_poses(q[None])
    body = robot.link_body[robot.tool_frame]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation[0, body], position[0, body]
    return pose @ robot.link_placement[robot.tool_frame]


def _touching(solid: AttachedSolid, robot: RobotModel, q: FloatArray) -> tuple[str, ...]:
    """Return the links that something attached may touch: those it does, and what is given."""
    checker = CollisionChecker(robot, attached=[solid])
    owners = np.array([shape.owner for shape in checker.shapes])[checker.pairs].reshape(-1, 2)
    own = (owners == solid.name).any(axis=1)
    rotation, position = robot.body_poses(q[None])
    near = checker.distances(rotation[0], position[0], checker.pairs[own]) < _TOUCHING
    names = owners[own][near].ravel()
    return tuple(dict.fromkeys([*solid.touch_links, *(n for n in names if n != solid.name)]))


# ---- A cycle: moves of the arm one after the other, and what happens at rest between them.


@dataclass(frozen=True, eq=False)
class Cycle:
    """Moves of an arm, one after the other, and what happens at rest between them.

    What the arm moves without stopping is a leg; between legs are seams, the first before leg 0 and
    the last after them all.

    Attributes:
        start: Where the first move begins, as of a `PlanningProblem`.
        steps: Moves, events, and what the tool takes and lets go.
        obstacles: Solids in the base frame, at first.
        attached: Solids in the tool frame, carried along from first to last.
        closed: Whether the arm ends in the configuration in which it began.
        self_collision: Whether links are checked against each other.
        period: A controller's [s], as of a `PlanningProblem`.
        name: What messages and plots call it.
        legs: What the arm moves without stopping.
        after: What happens after the last leg.

    Raises:
        ProblemError: On construction, if a step contradicts those before it, or a move itself; the
            message names the step.
        RobotError: Likewise.
    """

    start: FloatArray | Seed | ToolPose
    steps: Sequence[Step]
    obstacles: Sequence[Obstacle] = ()
    attached: Sequence[AttachedSolid] = ()
    closed: bool = False
    self_collision: bool = True
    period: float | None = None
    name: str = "cycle"
    legs: tuple[Leg, ...] = field(init=False)
    after: Rest = field(init=False)

    def __post_init__(self) -> None:
        require_parts(self, "closed", "self_collision", "name")
        is_row = isinstance(self.steps, list | tuple)
        object.__setattr__(self, "steps", tuple(self.steps) if is_row else (self.steps,))
        for group in ("obstacles", "attached"):
            object.__setattr__(self, group, given_members(group, getattr(self, group)))
        require_consistent(
            self.steps, self.obstacles, self.attached, closed=self.closed, period=self.period
        )
        legs, after = legs_of(self.steps, closed=self.closed)
        object.__setattr__(self, "legs", legs)
        object.__setattr__(self, "after", after)
        _ = self._from_anywhere

    def __repr__(self) -> str:
        moves = sum(len(leg.moves) for leg in self.legs)
        robot = self.robot
        return (
            f"<Cycle {self.name}: {moves} moves of {robot.name} to {robot.tool_frame} in "
            f"{len(self.legs)} legs, {'closed' if self.closed else 'open'}>"
        )

    @cached_property
    def endpoint(self) -> Endpoint:
        """The start."""
        return endpoint_of(self.start, self.legs[0].joined.tube.points[0])

    @staticmethod
    def require(cycle: object) -> None:
        """Raise ProblemError unless something is a cycle."""
        if not isinstance(cycle, Cycle):
            raise ProblemError(f"the cycle is {shown(cycle)}; give a Cycle, as load_cycle returns")

    @property
    def robot(self) -> RobotModel:
        """The arm as it begins."""
        return self.legs[0].robot

    def cells(self, seams: Sequence[FloatArray]) -> list[Cell]:
        """Return the cell as it is in every leg whose beginning is known.

        Args:
            seams: Configurations (n,) of the first seams, at least one.
        """
        cell, found = Cell(tuple(self.obstacles), tuple(self.attached)), []
        for leg, q in zip(self.legs, seams, strict=False):
            cell = replace(cell, handed_over=())
            for step in leg.before.steps:
                cell = cell.after(step, leg.robot, q)
            found.append(cell)
        return found

    def problem(self, k: int, seams: Sequence[FloatArray], goal: Goal = None) -> PlanningProblem:
        """Return the planning problem of a leg, the cell as it is then.

        Args:
            k: Which leg.
            seams: Configurations (n,) of all seams up to where it begins, or ends if that is known.
            goal: Where it ends, instead of where its move says; None: there.

        Raises:
            ProblemError: As a `PlanningProblem`; the message names the move.
        """
        end = seams[k + 1] if len(seams) > k + 1 else None
        return self._problem(k, self.cells(seams)[k], seams[k], goal, end)

    def problems(self, seams: Sequence[FloatArray]) -> tuple[PlanningProblem, ...]:
        """Return the planning problems of all legs between configurations of all seams.

        Args:
            seams: One more configuration (n,) than legs.

        Raises:
            ProblemError: As `problem`.
        """
        cells = self.cells(seams)
        ends = pairwise(seams)
        return tuple(self._problem(k, cells[k], *pair) for k, pair in enumerate(ends))

    def problem_from_anywhere(self, k: int) -> PlanningProblem:
        """Return the planning problem of a leg before it is known where it begins.

        The first begins where the cycle does; others at a seed, and what was taken or let go
        before them is anywhere.

        Raises:
            ProblemError: As `problem`.
        """
        return self._from_anywhere[k]

    @cached_property
    def _from_anywhere(self) -> tuple[PlanningProblem, ...]:
        somewhere = anywhere(self.robot)
        starts = [self.start, *[Seed(somewhere)] * (len(self.legs) - 1)]
        cells = self.cells([somewhere] * len(self.legs))
        each = enumerate(zip(cells, starts, strict=True))
        return tuple(self._problem(k, cell, start, None) for k, (cell, start) in each)

    def called(self, k: int) -> str:
        """Return what messages call a leg: its moves' names, and which of all moves these are."""
        leg, before = self.legs[k], sum(len(each.moves) for each in self.legs[:k])
        count = sum(len(each.moves) for each in self.legs)
        names = ", ".join(f"'{move.name}'" for move in leg.moves)
        which = str(before + 1)
        if len(leg.moves) > 1:
            return f"moves {which} to {before + len(leg.moves)} of {count}, {names}"
        return f"move {which} of {count}, {names}"

    def rest_at(self, seam: int) -> Rest:
        """Return what happens at a seam."""
        return self.after if seam == len(self.legs) else self.legs[seam].before

    def _problem(
        self,
        k: int,
        cell: Cell,
        start: FloatArray | Seed | ToolPose,
        goal: Goal,
        end: FloatArray | None = None,
    ) -> PlanningProblem:
        leg, move = self.legs[k], self.legs[k].joined
        try:
            problem = PlanningProblem(
                leg.robot,
                move.tube,
                start,
                move.goal if goal is None else goal,
                cell.obstacles,
                cell.attached,
                move.clearance,
                self._present(move.pair_clearances, cell),
                [c for c in move.contacts if self._is_present(c.links, cell)],
                self.self_collision,
                [pair for pair in move.ignore_collisions if self._is_present(pair, cell)],
                move.objective,
                self.period,
                name=f"{self.name}, {leg.name}",
            )
            _ = problem.collision  # built here: its faults are the move's
            contacts = usual_contacts(
                problem, cell.handed_over, self.rest_at(k + 1).handed_over, end
            )
            return replace(problem, contacts=(*problem.contacts, *contacts))
        except (ProblemError, RobotError) as error:
            raise type(error)(f"move '{leg.name}': {error}") from None

    def _present(self, pairs: Mapping[Names, float], cell: Cell) -> dict[Names, float]:
        return {pair: value for pair, value in pairs.items() if self._is_present(pair, cell)}

    def _is_present(self, pair: Sequence[str], cell: Cell) -> bool:
        """Return whether both of a pair are there, of what comes and goes."""
        there = {each.name for each in cell.obstacles} | {each.name for each in cell.attached}
        comes_and_goes = {step.name for step in self.steps if isinstance(step, Attach)}
        return all(name in there for name in pair if name in comes_and_goes)


def anywhere(robot: RobotModel) -> FloatArray:
    """Return a configuration inside the limits, shape (n,), where it does not matter which."""
    return robot.limits.clip(np.zeros(robot.joint_count))
