"""What is in a cycle, as text for a terminal."""

import numpy as np
from rich.markup import escape
from rich.table import Table

from tubeplanner.commands.info_text import bare, end_line, robot_text, srdf_lines
from tubeplanner.commands.report import rendered
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_info import CycleInfo
from tubeplanner.cycle.leg import Leg, Rest
from tubeplanner.cycle.step_text import rest_text
from tubeplanner.cycle.steps import Move


def cycle_text(info: CycleInfo) -> str:
    """Return what is in a cycle as text."""
    lines = [robot_text(info.robot)]
    if info.srdf is not None:
        lines += srdf_lines(info.srdf)
    if info.cycle is not None:
        lines += _cycle_lines(info.cycle)
    if info.refused is not None:
        lines.append(f"the cycle does not load: {info.refused}")
    return "\n".join(lines)


def _cycle_lines(cycle: Cycle) -> list[str]:
    """Return start, moves, rests and solids of a cycle."""
    ends = "ends where it begins" if cycle.closed else "ends where its last move does"
    moves = sum(len(leg.moves) for leg in cycle.legs)
    first = cycle.problem_from_anywhere(0)
    legs = f"{len(cycle.legs)} legs (each without a stop)"
    return [
        f"cycle {cycle.name}: {moves} moves in {legs}; {ends}",
        end_line(first, "start", cycle.start),
        _step_table(cycle),
        *([f"obstacle {bare(solid)}" for solid in cycle.obstacles] or ["no obstacles"]),
        *(f"attached {bare(solid)}" for solid in cycle.attached),
        *([] if cycle.period is None else [f"period: {cycle.period:g} s"]),
    ]


def _step_table(cycle: Cycle) -> str:
    table = Table(title="moves and what happens between them", title_justify="left")
    table.add_column("what")
    for heading in ("segments", "length"):
        table.add_column(heading, justify="right")
    for heading in ("ends", "carries"):
        table.add_column(heading)
    for k, leg in enumerate(cycle.legs):
        _add_rest(table, leg.before)
        for move in leg.moves:
            goal = _goal(cycle, move)
            cells = (escape(move.name), str(move.tube.numbers[-1]), _length(move), goal)
            table.add_row(*cells, escape(_carried(cycle, k, leg)))
    _add_rest(table, cycle.after)
    return rendered(table)


def _add_rest(table: Table, rest: Rest) -> None:
    if rest.steps:
        table.add_row(escape(f"at rest: {rest_text(rest)}"), "", "", "", "")


def _length(move: Move) -> str:
    return f"{np.linalg.norm(np.diff(move.tube.points, axis=0), axis=1).sum():.4g} m"


def _goal(cycle: Cycle, move: Move) -> str:
    if move.goal is not None and not move.ends_openly:
        return "in a given configuration"
    closes = cycle.closed and move is cycle.legs[-1].moves[-1]
    return "as the cycle begins" if closes else "in any configuration"


def _carried(cycle: Cycle, k: int, leg: Leg) -> str:
    """Return what is carried in leg k."""
    payload, solids = leg.robot.payload, cycle.problem_from_anywhere(k).attached
    parts = [] if payload is None else [f"{payload.mass:g} kg"]
    return ", ".join([*parts, *(solid.name for solid in solids)]) or "nothing"
