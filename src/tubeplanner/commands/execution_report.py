"""What was seen in the runs of an execution, as text for a terminal and as JSON values."""

from collections.abc import Sequence
from typing import Any

from tubeplanner.commands.console import empty_report
from tubeplanner.simulation.judged_runs import JudgedRun
from tubeplanner.simulation.run_summary import summaries
from tubeplanner.simulation.run_verdict import run_verdict

_NAMES = {
    "tube": "beyond the tube [m]",
    "rotation": "beyond the rotation tolerance [rad]",
    "points": "beyond compulsory points [m]",
    "tracking": "a joint from the plan [rad or m]",
    "tool_tracking": "the tool from the plan [m]",
    "position": "beyond position limits [rad or m]",
    "velocity": "velocity, share of its limit",
    "obstacles": "distance from obstacles [m]",
    "self_collision": "distance between links [m]",
}


def execution_report(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return the JSON object of some runs, times still absent."""
    seen = seen_fields(judged)
    return {
        **empty_report("success", str(run_verdict(judged)), seen["seen"]["tube"]["worst"]["place"]),
        **seen,
    }


def seen_fields(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return what was seen in some runs, as JSON values."""
    found = summaries(judged)
    return {
        "verdict": run_verdict(judged).as_dict(),
        "saturated": [run.saturated for run in judged],
        "excursions": [run.tube.value for run in judged],
        "seen": {name: None if one is None else one.as_dict() for name, one in found.items()},
    }


def execution_lines(judged: Sequence[JudgedRun]) -> list[str]:
    """Return what was seen in some runs, line by line, the verdict last."""
    lines = [f"{'seen in ' + str(len(judged)) + ' runs':38}{'worst':>12}{'median':>12}  where"]
    for name, summary in summaries(judged).items():
        if summary is not None:
            worst = f"{summary.worst.value:12.4g}{summary.median:12.4g}"
            lines.append(f"{_NAMES[name]:38}{worst}  run {summary.run}, {summary.worst.place}")
    saturated = [100 * run.saturated for run in judged]
    share = f"{max(saturated):12.3g}{sorted(saturated)[len(saturated) // 2]:12.3g}"
    return [*lines, f"{'time with a motor at its limit [%]':38}{share}", f"{run_verdict(judged)}"]
