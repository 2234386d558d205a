"""Steps of a cycle: Move, Event, Attach, Detach; contradictions between steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, floor
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.demands import Contact, Names, Objective, is_multiple, pair_distances
from tubeplanner.task.endpoints import Endpoint, Goal, endpoint_of
from tubeplanner.task.problem import given_members, require_parts
from tubeplanner.text import require_name, short_repr

# ---- The steps of a cycle: moves, and what happens at rest between them.

_LONGEST_DWELL = 1e5  # [s]


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
    def endpoint(self) -> Endpoint:
        """The goal."""
        return endpoint_of(self.goal, self.tube.points[-1])

    @property
    def ends_openly(self) -> bool:
        """Whether only the tool's position is given where it ends."""
        return self.endpoint.is_open


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


# ---- What contradicts itself in a cycle's steps.


def require_consistent(
    steps: Sequence[Step],
    obstacles: Sequence[Obstacle],
    attached: Sequence[AttachedSolid],
    *,
    closed: bool,
    period: float | None = None,
) -> None:
    """Raise ProblemError, which names the step, if steps contradict each other.

    Args:
        steps: Of a cycle.
        obstacles: That stand there at first.
        attached: What is carried all along.
        closed: Whether the cycle ends as it began.
        period: A controller's [s], of which dwells are multiples; None: of none.
    """
    for k, step in enumerate(steps):
        if not isinstance(step, Move | Event | Attach | Detach):
            raise ProblemError(f"steps[{k}] is {shown(step)}; give Move, Event, Attach or Detach")
    moves = [step for step in steps if isinstance(step, Move)]
    names = [move.name for move in moves]
    for name in names:
        if names.count(name) > 1:
            raise ProblemError(f"move '{name}': {names.count(name)} moves have this name")
    for before, move in pairwise(moves):
        _require_one_arm(before, move)
        _require_meeting(before, move)
    _require_dwells(steps, period)
    held = _Held({obstacle.name for obstacle in obstacles}, {solid.name for solid in attached})
    for step in steps:
        held.require(step)
    if closed and held.taken:
        raise ProblemError(
            f"closed: '{held.taken[0]}' is still attached where the cycle ends and would be once "
            "more where it begins; detach it, or leave closed out"
        )


def _require_dwells(steps: Sequence[Step], period: float | None) -> None:
    """Raise unless every dwell is a multiple of the period, if there is a sensible one."""
    if period is None or not is_number(period) or not period > 0:
        return  # the moves' problems say what is wrong with it
    for step in steps:
        if isinstance(step, Event) and not is_multiple(step.dwell, period):
            below, above = (round_to(step.dwell / period) * period for round_to in (floor, ceil))
            raise ProblemError(
                f"event '{step.name}': dwell is {in_figures(step.dwell)} s, no multiple of the "
                f"period, {period:g} s; give {below:.9g} or {above:.9g}"
            )


def _require_one_arm(before: Move, move: Move) -> None:
    for name in ("joint_names", "tool_frame"):
        if getattr(before.robot, name) != getattr(move.robot, name):
            raise ProblemError(
                f"move '{move.name}': its robot's {name} differs from the move's before; a cycle "
                "has one arm and one tool"
            )


def _require_meeting(before: Move, move: Move) -> None:
    """Raise unless a move's tube begins where the tool is, as far as that is known."""
    end = before.endpoint
    tool = before.tube.points[-1] if end.position is None else end.position
    if end.joints is not None:
        tool = before.robot.tool_position(end.joints[None])[0]
    slack = 0.0 if end.region is None else end.region.tolerance
    away = -float(move.tube.margin(tool[None])[0, 0])
    if away > slack + MARGIN_TOLERANCE:
        raise ProblemError(
            f"move '{move.name}': tube.points[0] is {move.tube.points[0].tolist()} m, but move "
            f"'{before.name}' ends at {np.round(tool, 4).tolist()} m, {away:.3g} m outside the "
            "first segment; begin where it ends"
        )


class _Held:
    """What stands and what is held, from step to step."""

    def __init__(self, standing: set[str], carried: set[str]) -> None:
        self._standing, self._carried = standing, carried
        self._has_shape: dict[str, bool] = {}

    @property
    def taken(self) -> list[str]:
        """What is attached now."""
        return list(self._has_shape)

    def require(self, step: Step) -> None:
        """Raise unless a step is possible now; then take it."""
        if isinstance(step, Attach):
            self._attach(step)
        elif isinstance(step, Detach):
            self._detach(step)

    def _attach(self, step: Attach) -> None:
        here, name = f"attach '{step.name}'", step.name
        if name in self._carried:
            raise ProblemError(f"{here}: the robot carries it all along; choose another name")
        if name in self._has_shape:
            raise ProblemError(f"{here}: it is attached already; detach it before")
        if name in self._standing and step.solid is not None:
            raise ProblemError(
                f"{here}: shape is given, and there is an obstacle of this name, which is taken as "
                "it stands; leave out the shape, or choose another name"
            )
        if name not in self._standing and step.solid is None and step.payload is None:
            known = sorted(self._standing)
            raise ProblemError(
                f"{here}: {unknown_name('obstacle', name, known)}; or give shape, payload or both"
            )
        self._has_shape[name] = name in self._standing or step.solid is not None
        self._standing.discard(name)

    def _detach(self, step: Detach) -> None:
        if step.name in self._carried:
            raise ProblemError(
                f"detach '{step.name}': the robot carries it all along; attach it in a step instead"
            )
        if step.name not in self._has_shape:
            held = unknown_name("attached name", step.name, self._has_shape)
            raise ProblemError(f"detach '{step.name}': {held}")
        if self._has_shape.pop(step.name) and step.leaves_obstacle:
            self._standing.add(step.name)
