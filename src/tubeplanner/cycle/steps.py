"""The steps of a cycle: moves, and what happens at rest between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.obstacle import AttachedSolid
from tubeplanner.errors import ProblemError, shown
from tubeplanner.names import require_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.problem.contact import Contact, Names, pair_distances
from tubeplanner.problem.given_parts import given_members, require_parts
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.problem import Seed
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.short_repr import short_repr
from tubeplanner.tube.tube import Tube

_LONGEST_DWELL = 1e5  # [s]

Goal: TypeAlias = FloatArray | Seed | ToolPose | GoalRegion | None


@dataclass(frozen=True, eq=False)
class Move:
    """A motion of the tool along a tube, from wherever the one before ended.

    Attributes:
        name: Unique in its cycle.
        robot: The arm with this move's limits, and without what steps attach.
        tube: Where its tool may be.
        goal: As of a `PlanningProblem`; None, or a GoalRegion: a hand position alone, whose
            configuration is chosen so that the cycle is short.
        clearance: Least distance between any moving link and any obstacle [m].
        pair_clearances: By pairs of names of links, obstacles or attached solids, instead [m].
        contacts: Solids that may be nearer at its start or end.
        ignore_collisions: Pairs of names that may touch.
        objective: What the motion is to be beside short.
        passes_through: Whether the arm does not stop where this move begins.
    """

    name: str
    robot: RobotModel
    tube: Tube
    goal: Goal = None
    clearance: float = 0.0
    pair_clearances: Mapping[Names, float] = field(default_factory=dict)
    contacts: Sequence[Contact] = ()
    ignore_collisions: Sequence[Names] = ()
    objective: Objective | None = None
    passes_through: bool = False

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("the name of a move", self.name, ProblemError)
        called = f"move '{self.name}': "
        require_parts(self, "robot", "tube", "objective", "passes_through", called=called)
        for group in ("contacts", "ignore_collisions"):
            members = given_members(group, getattr(self, group), called)
            object.__setattr__(self, group, members)
        object.__setattr__(self, "pair_clearances", pair_distances(self.pair_clearances))

    @property
    def ends_openly(self) -> bool:
        """Whether only the tool's position is given where it ends."""
        return self.goal is None or isinstance(self.goal, GoalRegion)


@dataclass(frozen=True)
class Event:
    """Something else that happens while the arm is at rest: a gripper opens, a weld cools.

    Attributes:
        name: What it is called.
        setting: What it sets, for whoever reads the marks; None: nothing.
        dwell: How long the arm stays [s].
    """

    name: str
    setting: Any = None
    dwell: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("the name of an event", self.name, ProblemError)
        if not is_number(self.dwell) or not 0 <= self.dwell <= _LONGEST_DWELL:
            raise ProblemError(
                f"event '{self.name}': dwell is {in_figures(self.dwell)} s; 0 to "
                f"{_LONGEST_DWELL:g} s are accepted"
            )


@dataclass(frozen=True, eq=False)
class Attach:
    """The tool takes something.

    Attributes:
        name: Of an obstacle, which is taken as it stands then, or of what `solid` is.
        payload: What it weighs; it adds to what the robot carries. None: nothing.
        solid: Its shape in the tool frame; None: the obstacle's, or none at all.
    """

    name: str
    payload: Payload | None = None
    solid: AttachedSolid | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("what is attached", self.name, ProblemError)
        require_parts(self, "payload", "solid", called=f"attach '{self.name}': ")
        if self.solid is not None and self.solid.name != self.name:
            raise ProblemError(
                f"attach '{self.name}': its solid is called {shown(self.solid.name)}; give both "
                "the same name"
            )


@dataclass(frozen=True)
class Detach:
    """The tool lets something go.

    Attributes:
        name: Of what was attached.
        leaves_obstacle: Whether it stays in the cell, where it is then.
    """

    name: str
    leaves_obstacle: bool = True

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("what is detached", self.name, ProblemError)
        require_parts(self, "leaves_obstacle", called=f"detach '{self.name}': ")


Step: TypeAlias = Move | Event | Attach | Detach
