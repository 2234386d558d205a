"""What contradicts itself in a cycle's steps."""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, floor

import numpy as np

from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.cycle.steps import Attach, Detach, Event, Move, Step
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.objective import is_multiple
from tubeplanner.problem.tool_pose import ToolPose


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
    goal = before.goal
    tool, slack = before.tube.points[-1], 0.0
    if isinstance(goal, GoalRegion):
        tool, slack = goal.position, goal.tolerance
    elif isinstance(goal, ToolPose):
        tool = goal.position
    elif isinstance(goal, np.ndarray):
        tool = before.robot.tool_position(goal[None])[0]
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
