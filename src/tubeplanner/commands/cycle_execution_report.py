"""What was seen in the runs of a cycle, as text for a terminal and as JSON values."""

from collections.abc import Sequence
from typing import Any

from tubeplanner.commands.execution_report import execution_lines, execution_report, seen_fields
from tubeplanner.simulation.handover_errors import HandoverErrors
from tubeplanner.simulation.judged_cycle import JudgedCycle
from tubeplanner.simulation.judged_runs import JudgedRun
from tubeplanner.simulation.run_summary import summaries
from tubeplanner.simulation.run_verdict import run_verdict

# Of every move: columns, and what is in them.
_QUANTITIES = {
    "beyond tube [m]": "tube",
    "obstacles [m]": "obstacles",
    "tool off [m]": "tool_tracking",
}
_LIMIT = "at limit [%]"
_HANDOVERS = ("off, worst [m]", "median [m]", "turned [rad]", "speed [m/s]")


def cycle_execution_report(judged: JudgedCycle) -> dict[str, Any]:
    """Return the JSON object of the runs of a cycle, times still absent.

    Moves that run without a stop have the same under each of their names.
    """
    moves = {name: seen_fields(runs) for names, runs in judged.legs.items() for name in names}
    handovers = [each.as_dict() for each in judged.handovers]
    return {**execution_report(judged.runs), "moves": moves, "handovers": handovers}


def cycle_execution_lines(judged: JudgedCycle) -> list[str]:
    """Return what was seen in the runs of a cycle, line by line, the verdict last.

    First the whole, then the worst of every move, and of the tool where something changes hands.
    """
    *quantities, verdict = execution_lines(judged.runs)
    lines = [*quantities, "", _row("move, the worst of it", ["failed", *_QUANTITIES, _LIMIT])]
    lines += [_row(", ".join(names), _move_cells(runs)) for names, runs in judged.legs.items()]
    if judged.handovers:
        lines += ["", _row("the tool when something changes hands", _HANDOVERS)]
        lines += [_row(str(each.mark), _handover_cells(each)) for each in judged.handovers]
    return [*lines, "", verdict]


def _move_cells(runs: Sequence[JudgedRun]) -> list[str]:
    found, verdict = summaries(runs), run_verdict(runs)
    worst = [found[name] for name in _QUANTITIES.values()]
    shown = ["-" if one is None else f"{one.worst.value:.4g}" for one in worst]
    saturated = f"{100 * max(run.saturated for run in runs):.3g}"
    return [f"{verdict.failed} of {verdict.runs}", *shown, saturated]


def _handover_cells(errors: HandoverErrors) -> list[str]:
    found = errors.as_dict()
    names = ("distance", "angle", "speed")
    worst, turned, fast = (f"{found[name]['worst']:.3g}" for name in names)
    return [worst, f"{found['distance']['median']:.3g}", turned, fast]


def _row(name: str, cells: Sequence[str]) -> str:
    return f"{name:38}" + "".join(f"{cell:>16}" for cell in cells)
