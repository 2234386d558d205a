"""Steps of a cycle: Move, Event, Attach, Detach; contradictions between steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, floor
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import ProblemError, faults_of, shown, unknown_name
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.demands import Contact, Names, Objective, is_multiple, pair_distances
from tubeplanner.task.endpoints import Endpoint, Goal, endpoint_of
from tubeplanner.task.holding import Holding, holdings_of, require_carried
from tubeplanner.task.problem import given_members, require_parts
from tubeplanner.text import require_name, short_repr

# ---- Steps: moves, and events, attaching and detaching at rest between them.

_MAX_DWELL = 1e5  # [s]


@dataclass(frozen=True, eq=False)
class Move:
    """Motion of the tool along a tube, from the end of the move before.

    Attributes:
        name: Unique in its cycle.
        robot: The arm with the limits of this move, without payloads and solids of steps.
        tube: Region of the tool centre point; `Tube.anywhere` where only start and goal count.
        goal: As of a `PlanningProblem`; None, or a GoalRegion: a tool position alone, whose
            configuration is chosen so that the cycle is short.
        clearance: Least distance between any moving link and any obstacle [m].
        pair_clearances: Clearances of pairs, by names of links, obstacles or attached solids [m].
        contacts: Solids that may be nearer at start or end of the move.
        ignore_collisions: Pairs of names that may touch.
        objective: Objective beside the shortest duration.
        passes_through: True if the arm does not stop at the start of this move.
        holding: Parts that the tool holds by contact in this move, beside attached ones.
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
    holding: Sequence[Holding] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("the name of a move", self.name, ProblemError)
        label = f"move '{self.name}': "
        require_parts(self, "robot", "tube", "objective", "passes_through", label=label)
        for group in ("contacts", "ignore_collisions"):
            object.__setattr__(self, group, given_members(group, getattr(self, group), label))
        object.__setattr__(self, "pair_clearances", pair_distances(self.pair_clearances))
        object.__setattr__(self, "holding", holdings_of(self.holding))

    @property
    def endpoint(self) -> Endpoint:
        """The goal."""
        return endpoint_of(self.goal, self.tube.points[-1])

    @property
    def end_position(self) -> FloatArray:
        """The tool's position at the goal, shape (3,) [m]; of a region its centre."""
        end = self.endpoint
        if end.joints is not None:
            return self.robot.tool_position(end.joints[None])[0]
        return self.tube.points[-1] if end.position is None else end.position

    @property
    def ends_openly(self) -> bool:
        """True if the move's end is a tool position alone."""
        return self.endpoint.is_open


@dataclass(frozen=True)
class Event:
    """Event while the arm is at rest: a gripper opens, a weld cools.

    Attributes:
        name: Name of the event.
        setting: Value that the event sets, for readers of the marks; None: nothing.
        dwell: Time at rest [s].
    """

    name: str
    setting: Any = None
    dwell: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("the name of an event", self.name, ProblemError)
        if not is_number(self.dwell) or not 0 <= self.dwell <= _MAX_DWELL:
            raise ProblemError(
                f"event '{self.name}': dwell is {in_figures(self.dwell)} s; 0 to "
                f"{_MAX_DWELL:g} s are accepted"
            )


@dataclass(frozen=True, eq=False)
class Attach:
    """Attaching of an object to the tool.

    Attributes:
        name: Name of an obstacle, attached at its pose of that time, or of `solid`.
        payload: Mass of the object, in addition to the robot's payload; None: no mass.
        solid: Shape in the tool frame; None: the obstacle's shape, or none.
        holding: Contacts that hold the object while it is attached.
    """

    name: str
    payload: Payload | None = None
    solid: AttachedSolid | None = None
    holding: Sequence[Holding] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("what is attached", self.name, ProblemError)
        require_parts(self, "payload", "solid", label=f"attach '{self.name}': ")
        object.__setattr__(self, "holding", holdings_of(self.holding))
        with faults_of(f"attach '{self.name}'", ProblemError):
            require_carried(self.holding, self.payload, "its payload")
        if self.solid is not None and self.solid.name != self.name:
            raise ProblemError(
                f"attach '{self.name}': its solid is called {shown(self.solid.name)}; give both "
                "the same name"
            )


@dataclass(frozen=True)
class Detach:
    """Detaching of an object from the tool.

    Attributes:
        name: Name of the attached object.
        leaves_obstacle: True if the object stays in the cell at its pose of that time.
    """

    name: str
    leaves_obstacle: bool = True

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_name("what is detached", self.name, ProblemError)
        require_parts(self, "leaves_obstacle", label=f"detach '{self.name}': ")


Step: TypeAlias = Move | Event | Attach | Detach


def require_consistent(
    steps: Sequence[Step],
    obstacles: Sequence[Obstacle],
    attached: Sequence[AttachedSolid],
    *,
    closed: bool,
    period: float | None = None,
) -> None:
    """Raise ProblemError, with the name of the step, if steps contradict each other.

    Obstacles are those before the first step, attached solids are carried during the whole cycle,
    and dwells are multiples of the period [s].
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
        for name in ("joint_names", "tool_frame"):
            if getattr(before.robot, name) != getattr(move.robot, name):
                raise ProblemError(
                    f"move '{move.name}': its robot's {name} differs from the move's before; a "
                    "cycle has one arm and one tool"
                )
        _require_meeting(before, move)
    # The problems of the moves report an invalid period.
    if period is not None and is_number(period) and period > 0:
        for step in steps:
            if isinstance(step, Event) and not is_multiple(step.dwell, period):
                multiples = [round_to(step.dwell / period) * period for round_to in (floor, ceil)]
                raise ProblemError(
                    f"event '{step.name}': dwell is {in_figures(step.dwell)} s, no multiple of the "
                    f"period, {period:g} s; give {multiples[0]:.9g} or {multiples[1]:.9g}"
                )
    solids = _SolidNames({each.name for each in obstacles}, {each.name for each in attached})
    for step in steps:
        solids.apply(step)
    if closed and solids.attached:
        raise ProblemError(
            f"closed: '{solids.attached[0]}' is still attached where the cycle ends and would be "
            "once more where it begins; detach it, or leave closed out"
        )


def _require_meeting(before: Move, move: Move) -> None:
    """Raise unless a move's tube begins at the known end of the move before."""
    tool, region = before.end_position, before.endpoint.region
    slack = 0.0 if region is None else region.tolerance
    distance = -float(move.tube.margin(tool[None])[0, 0])
    if distance > slack + MARGIN_TOLERANCE:
        raise ProblemError(
            f"move '{move.name}': tube.points[0] is {move.tube.points[0].tolist()} m, but move "
            f"'{before.name}' ends at {np.round(tool, 4).tolist()} m, {distance:.3g} m outside the "
            "first segment; begin where it ends"
        )


class _SolidNames:
    """Names of obstacles and attached objects, from step to step."""

    def __init__(self, obstacles: set[str], permanent: set[str]) -> None:
        self._obstacles, self._permanent = obstacles, permanent
        self._has_shape: dict[str, bool] = {}  # of attached objects

    @property
    def attached(self) -> list[str]:
        """Names of the attached objects, in the order of attaching."""
        return list(self._has_shape)

    def apply(self, step: Step) -> None:
        """Apply a step, or raise if the step is impossible."""
        if isinstance(step, Attach):
            here, name = f"attach '{step.name}'", step.name
            if name in self._permanent:
                raise ProblemError(f"{here}: the robot carries it all along; choose another name")
            if name in self._has_shape:
                raise ProblemError(f"{here}: it is attached already; detach it before")
            if name in self._obstacles and step.solid is not None:
                raise ProblemError(
                    f"{here}: shape is given, and there is an obstacle of this name, which is "
                    "taken as it stands; leave out the shape, or choose another name"
                )
            if name not in self._obstacles and step.solid is None and step.payload is None:
                message = unknown_name("obstacle", name, sorted(self._obstacles))
                raise ProblemError(f"{here}: {message}; or give shape, payload or both")
            self._has_shape[name] = name in self._obstacles or step.solid is not None
            self._obstacles.discard(name)
        elif isinstance(step, Detach):
            if step.name in self._permanent:
                raise ProblemError(
                    f"detach '{step.name}': the robot carries it all along; attach it in a step "
                    "instead"
                )
            if step.name not in self._has_shape:
                message = unknown_name("attached name", step.name, self._has_shape)
                raise ProblemError(f"detach '{step.name}': {message}")
            if self._has_shape.pop(step.name) and step.leaves_obstacle:
                self._obstacles.add(step.name)
