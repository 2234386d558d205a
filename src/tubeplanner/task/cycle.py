"""Cycle: legs and rests in a changing cell; one PlanningProblem per leg."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import FormerName, ProblemError, RobotError, shown
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, left, taken
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import Robustness
from tubeplanner.task.endpoints import Endpoint, Goal, Seed, ToolPose, endpoint_of
from tubeplanner.task.legs import Leg, Stop, StopStep, legs_of
from tubeplanner.task.problem import PlanningProblem, given_members, require_parts
from tubeplanner.task.required_distances import usual_contacts
from tubeplanner.task.steps import Attach, Detach, Step, require_consistent

_TOUCHING = 1e-3  # [m]; links nearer than this to an attached solid touch it


@dataclass(frozen=True, eq=False)
class Cell:
    """Solids of the cell and solids that the tool carries, between two steps of a cycle."""

    obstacles: tuple[Obstacle, ...]  # solids in the base frame
    attached: tuple[AttachedSolid, ...]  # solids in the tool frame
    # names of the solids attached or detached since the last motion
    handed_over: tuple[str, ...] = ()

    def after(self, step: StopStep, robot: RobotModel, q: FloatArray) -> "Cell":
        """Return the cell after a step of an arm at rest in a configuration (n,)."""
        if isinstance(step, Attach):
            solid, obstacles = step.solid, self.obstacles
            for obstacle in self.obstacles:
                if obstacle.name == step.name:
                    solid = taken(obstacle, _tool_frame_pose(robot, q))
                    obstacles = tuple(each for each in obstacles if each is not obstacle)
            if solid is None:
                return self
            solid = replace(solid, touch_links=_touching(solid, robot, q))
            return Cell(obstacles, (*self.attached, solid), (*self.handed_over, step.name))
        if isinstance(step, Detach):
            detached = [solid for solid in self.attached if solid.name == step.name]
            others = tuple(solid for solid in self.attached if solid not in detached)
            if not detached or not step.leaves_obstacle:
                return replace(self, attached=others)
            obstacle = left(detached[0], _tool_frame_pose(robot, q))
            return Cell((*self.obstacles, obstacle), others, (*self.handed_over, step.name))
        return self


def _tool_frame_pose(robot: RobotModel, q: FloatArray) -> FloatArray:
    """Return the pose of the tool frame in the base frame, shape (4, 4)."""
    rotation, position = robot.body_poses(q[None])
    body = robot.link_body[robot.tool_frame]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation[0, body], position[0, body]
    return pose @ robot.link_placement[robot.tool_frame]


def _touching(solid: AttachedSolid, robot: RobotModel, q: FloatArray) -> tuple[str, ...]:
    """Return the links that an attached solid may touch: `touch_links`, and links in touch."""
    checker = CollisionChecker(robot, attached=[solid])
    owners = np.array([shape.owner for shape in checker.shapes])[checker.pairs].reshape(-1, 2)
    own = (owners == solid.name).any(axis=1)
    rotation, position = robot.body_poses(q[None])
    near = checker.distances(rotation[0], position[0], checker.pairs[own]) < _TOUCHING
    names = owners[own][near].ravel()
    return tuple(dict.fromkeys([*solid.touch_links, *(n for n in names if n != solid.name)]))


@dataclass(frozen=True, eq=False)
class Cycle:
    """Moves of an arm in order, with events, attaching and detaching at rest between them.

    A leg is a run of moves without a stop. Legs begin and end at junctions: the first junction is
    before leg 0, the last after the last leg.

    Attributes:
        start: Start of the first move, as of a `PlanningProblem`.
        steps: Moves, events, attaching and detaching, in order.
        obstacles: Solids in the base frame before the first step.
        attached: Solids in the tool frame, carried from the first to the last step.
        closed: True if the arm ends in the configuration in which it began.
        self_collision: True if links are checked against each other.
        period: Of the controller [s], as of a `PlanningProblem`.
        name: Name in messages and plots.
        notes: Sentences on implausible values of its file.
        robustness: Errors that the motion of every leg must survive in simulation; None: none.
        legs: Runs of moves without a stop.
        after: The rest after the last leg.

    Raises:
        ProblemError: On construction, if a step contradicts an earlier one, or a move itself; the
            message names the step.
        RobotError: On construction, if the robot of a move cannot be used.
    """

    start: FloatArray | Seed | ToolPose
    steps: Sequence[Step]
    obstacles: Sequence[Obstacle] = ()
    attached: Sequence[AttachedSolid] = ()
    closed: bool = False
    self_collision: bool = True
    period: float | None = None
    name: str = "cycle"
    notes: tuple[str, ...] = ()
    robustness: Robustness | None = None
    legs: tuple[Leg, ...] = field(init=False)
    after: Stop = field(init=False)

    called = FormerName("label")
    rest_at = FormerName("stop_at")

    def __post_init__(self) -> None:
        require_parts(self, "closed", "self_collision", "name", "robustness")
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
        return (
            f"<Cycle {self.name}: {moves} moves of {self.robot.name} to {self.robot.tool_frame} in "
            f"{len(self.legs)} legs, {'closed' if self.closed else 'open'}>"
        )

    @cached_property
    def endpoint(self) -> Endpoint:
        """The start."""
        return endpoint_of(self.start, self.legs[0].joined.tube.points[0])

    @staticmethod
    def require(cycle: object) -> None:
        """Raise ProblemError unless a value is a Cycle."""
        if not isinstance(cycle, Cycle):
            raise ProblemError(f"the cycle is {shown(cycle)}; give a Cycle, as load_cycle returns")

    @property
    def robot(self) -> RobotModel:
        """The arm of the first leg."""
        return self.legs[0].robot

    def cells(self, junctions: Sequence[FloatArray]) -> list[Cell]:
        """Return the cell of every leg whose start is among the junctions, (n,) each."""
        cell, cells = Cell(tuple(self.obstacles), tuple(self.attached)), []
        for leg, q in zip(self.legs, junctions, strict=False):
            cell = replace(cell, handed_over=())
            for step in leg.before.steps:
                cell = cell.after(step, leg.robot, q)
            cells.append(cell)
        return cells

    def problem(
        self, k: int, junctions: Sequence[FloatArray], goal: Goal = None
    ) -> PlanningProblem:
        """Return the planning problem of a leg in its cell.

        Args:
            k: Index of the leg.
            junctions: Configurations (n,) of all junctions up to the start of the leg, or to its
                end if that is known.
            goal: Goal in place of the move's; None: the move's.

        Raises:
            ProblemError: As a `PlanningProblem`; the message names the move.
        """
        end = junctions[k + 1] if len(junctions) > k + 1 else None
        return self._problem(k, self.cells(junctions)[k], junctions[k], goal, end)

    def problems(self, junctions: Sequence[FloatArray]) -> tuple[PlanningProblem, ...]:
        """Return the planning problems of all legs, from the configurations (n,) of all junctions.

        Raises:
            ProblemError: As `problem`.
        """
        cells = self.cells(junctions)
        return tuple(
            self._problem(k, cells[k], *pair) for k, pair in enumerate(pairwise(junctions))
        )

    def problem_from_anywhere(self, k: int) -> PlanningProblem:
        """Return the planning problem of a leg whose start is not known yet.

        The first leg begins at the start of the cycle; others begin at a seed, and solids attached
        or detached before them are at arbitrary poses.

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

    def label(self, k: int) -> str:
        """Return the label of a leg in messages: numbers and names of its moves."""
        leg, before = self.legs[k], sum(len(each.moves) for each in self.legs[:k])
        count = sum(len(each.moves) for each in self.legs)
        names = ", ".join(f"'{move.name}'" for move in leg.moves)
        if len(leg.moves) > 1:
            return f"moves {before + 1} to {before + len(leg.moves)} of {count}, {names}"
        return f"move {before + 1} of {count}, {names}"

    def stop_at(self, junction: int) -> Stop:
        """Return the stop at a junction."""
        return self.after if junction == len(self.legs) else self.legs[junction].before

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
                {
                    pair: clearance
                    for pair, clearance in move.pair_clearances.items()
                    if self._is_present(pair, cell)
                },
                [c for c in move.contacts if self._is_present(c.links, cell)],
                self.self_collision,
                [pair for pair in move.ignore_collisions if self._is_present(pair, cell)],
                move.objective,
                self.period,
                self.robustness,
                leg.holding,
                name=f"{self.name}, {leg.name}",
            )
            _ = problem.collision  # built here, so that its errors name the move
            contacts = usual_contacts(
                problem, cell.handed_over, self.stop_at(k + 1).handed_over, end
            )
            return replace(problem, contacts=(*problem.contacts, *contacts))
        except (ProblemError, RobotError) as error:
            raise type(error)(f"move '{leg.name}': {error}") from None

    def _is_present(self, pair: Sequence[str], cell: Cell) -> bool:
        """Return True if the cell has all solids of a pair that steps attach."""
        present = {each.name for each in cell.obstacles} | {each.name for each in cell.attached}
        movable = {step.name for step in self.steps if isinstance(step, Attach)}
        return all(name in present for name in pair if name in movable)


def anywhere(robot: RobotModel) -> FloatArray:
    """Return an arbitrary configuration inside the position limits, shape (n,) [rad or m]."""
    return robot.limits.clip(np.zeros(robot.joint_count))
