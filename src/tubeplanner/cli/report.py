"""Plans and certificates of problems and cycles as terminal text."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tubeplanner.certificate.judged_motion import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    Tolerance,
)
from tubeplanner.certificate.verification import CONDITION_NAMES, Certificate, CycleCertificate
from tubeplanner.geometry.collision_checker import ALWAYS_TOUCHING, TOUCH_SAMPLES
from tubeplanner.limits.holding_limit import HoldingPeak, holding_peaks
from tubeplanner.limits.peaks import TrajectoryPeaks, trajectory_peaks
from tubeplanner.limits.process_stretches import StretchRun, all_marks, stretch_runs
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import unlimited_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.info import task_doubts
from tubeplanner.task.legs import Leg, Stop, stop_text
from tubeplanner.task.motion import CycleMotion, Motion, Task
from tubeplanner.task.side_files import fitting_presets
from tubeplanner.text import MIN_SAVING, in_milliseconds, savings
from tubeplanner.trajectory.parts import EVENT, Mark

if TYPE_CHECKING:
    from tubeplanner.planning.result import CycleResult, LegPlan, PlanResult

# ---- Plans and certificates as text for a terminal.

_WIDTH_OF_A_FILE, _VERY_WIDE = 160, 10_000  # [characters]
_ROUNDING = 1e-10  # smaller margins are shown as zero
_SENSITIVITIES_SHOWN = 3


def plan_text(
    task: Task,
    result: "PlanResult | CycleResult",
    loading_time: float,
    *,
    with_minimum: bool = False,
) -> str:
    """Return the result of planning as text; with the least time for the path on request."""
    from tubeplanner.planning.result import CycleResult

    robot, of_cycle, peaks = task.robot, "", None
    if not isinstance(result, CycleResult):
        peaks = result.peaks
    elif result.motion is not None:
        peaks = trajectory_peaks(robot, result.motion.trajectory)
    lines = [
        f"{task.name}: {robot.name}, {robot.joint_count} joints to {robot.tool_frame}",
        *([] if peaks is None else peaks_lines(robot, peaks)),
        *holding_lines(result.holding),
        *stretch_lines(result.stretches, result.certificate),
        *mark_lines(result.marks),
        f"loaded in {loading_time:.2f} s, planned in {result.planning_time:.2f} s "
        f"(certificate {result.certificate_time:.2f} s), method {result.method}",
    ]
    if isinstance(result, CycleResult):
        of_cycle = ", over the cycle"
        if result.motion is not None:
            legs = zip(result.motion.cycle.legs, result.legs, strict=True)
            largest = [_largest_saving(*each) for each in legs]
            title = "largest saving by a 10 % higher limit"
            lines.append(_timetable(result.motion, title, largest))
    else:
        if result.search is not None:
            lines.append(f"branch and bound: {result.search}")
        if result.phase_two is not None:
            lines.append(f"phase 2, from {result.phase1_duration:.4f} s: {result.phase_two}")
    if result.certificate is not None:
        lines.append(certificate_text(result.certificate))
        lines += left_out_lines(result.certificate)
    before, beside, after = _sorted_notes(result.notes, robot, task_doubts(task))
    lines += [*before, f"{result.status}: {result.message}", *beside, *bound_lines(result)]
    if savings_text := "; ".join(savings(result.sensitivities)[:_SENSITIVITIES_SHOWN]):
        lines.append(f"raising a limit by 10 % would save{of_cycle}: {savings_text}")
    if isinstance(result, CycleResult):
        lines += _gain_lines(result)
    else:
        prices = ", ".join(
            f"{each.field} {in_milliseconds(abs(each.saved_per_unit))} per {each.unit} "
            f"{'more' if each.saved > 0 else 'less'}"
            for each in result.sensitivities
            if each.saved_per_unit is not None and abs(each.saved) > MIN_SAVING
        )
        lines += [f"holding the part better would save: {prices}"] * bool(prices)
    if with_minimum:
        lines += _minimum_lines(robot, result)
    lines += after
    lines += [f"where: {result.location}"] * bool(str(result.location))
    is_explained = isinstance(result, CycleResult) or result.survival is not None
    if result.proved is not None and not is_explained:
        lines.append("`tubeplanner explain` looks for the smallest changes that make it possible")
    if result.stopped_by is not None:
        lines.append(f"stopped by {result.stopped_by.replace('_', ' ')}: there may be better")
    return "\n".join([*lines, *geometry_lines(task)])


def bound_lines(result: "PlanResult | CycleResult") -> list[str]:
    """Return a line on the lower bound on an answer's duration, if there is one."""
    if result.bound is None or result.duration is None:
        return []
    least = result.bound.beside(result.duration)
    return [f"{least}: {result.bound.reason}"] * bool(least)


def check_lines(motion: Motion, certificate: Certificate | CycleCertificate) -> list[str]:
    """Return the peaks of a motion, its moves if any, its certificate, and its other speeds."""
    lines = peaks_lines(motion.task.robot, trajectory_peaks(motion.task.robot, motion.trajectory))
    lines += holding_lines(holding_peaks(motion.sections))
    lines += stretch_lines(stretch_runs(motion.sections), certificate)
    lines += mark_lines(all_marks((), motion.sections))
    if isinstance(motion, CycleMotion) and isinstance(certificate, CycleCertificate):
        verdicts = [_verdict(certificate, leg) for leg in motion.cycle.legs]
        return [*lines, _timetable(motion, "certificate", verdicts), certificate_text(certificate)]
    assert isinstance(certificate, Certificate)
    return [*lines, certificate_text(certificate), other_speeds_line(certificate)]


def geometry_lines(task: Task) -> list[str]:
    """Return a note if obstacles are not checked, as the robot has no collision geometry."""
    problem = task.problem_from_anywhere(0) if isinstance(task, Cycle) else task
    if not problem.obstacles or problem.collision.has_link_geometry:
        return []
    return ["note: the robot has no collision geometry; the obstacles were NOT checked against it"]


def _sorted_notes(
    notes: Sequence[str], robot: RobotModel, doubts: Sequence[str]
) -> tuple[list[str], list[str], list[str]]:
    """Return lines of notes before, beside and after an answer.

    Doubts on implausible values are read before; joints that nothing holds back, beside.
    """
    lines: tuple[list[str], list[str], list[str]] = ([], [], [])
    beside = unlimited_notes(robot)
    for note in notes:
        location = 0 if note in doubts else 1 if note in beside else 2
        lines[location].append(f"note: {note}")
    return lines


def _minimum_lines(robot: RobotModel, result: "PlanResult | CycleResult") -> list[str]:
    """Return a line on the path's least time, with motors that switch instantly, if computed."""
    if result.path_minimum is None or not result.duration:
        return []
    saving = 100 * max(1 - result.path_minimum / result.duration, 0.0)
    line = "time left on this path: motors that switch instantly would take"
    without = [
        leg.problem.name for leg in getattr(result, "legs", ()) if leg.result.path_minimum is None
    ]
    reason = f"no solution of TOPP-RA for {', '.join(without)}" if without else ""
    if robot.motors.has_less_at_speed:
        from tubeplanner.first_guess.fastest_parameterization import NOT_PROVED

        reason = NOT_PROVED
    if not reason:
        return [f"{line} {result.path_minimum:.4f} s, {saving:.1f} % less"]
    return [f"{line} at most {result.path_minimum:.4f} s, at least {saving:.1f} % less ({reason})"]


def peaks_lines(robot: RobotModel, peaks: TrajectoryPeaks) -> list[str]:
    """Return a line of a trajectory's peaks, and a line of missing limits if there are any."""
    lines = [f"peaks: {peaks}"]
    free = {quantity: robot.limits.unlimited(quantity) for quantity in ("acceleration", "jerk")}
    unlimited = [quantity for quantity, joints in free.items() if len(joints) > 0]
    if unlimited:
        of_some = []  # " of" and the names of some joints; empty for every joint
        for joints in (free[quantity] for quantity in unlimited):
            listed = ", ".join(robot.joint_names[joint] for joint in joints)
            of_some.append(f" of {listed}" if len(joints) < robot.joint_count else "")
        named = " or ".join(unlimited) + of_some[0]
        if len(set(of_some)) > 1:
            each = zip(unlimited, of_some, strict=True)
            named = ", or ".join(f"{quantity}{own or ' of every joint'}" for quantity, own in each)
        lines.append(
            f"nothing limits {named}; for a motion that a machine can "
            "follow, give the robot's own as "
            + " and ".join(f"robot.limits.{quantity}" for quantity in unlimited)
            + "".join(f", or robot.preset: {name}" for name in fitting_presets(robot))
        )
    return lines


def holding_lines(peaks: Sequence[HoldingPeak]) -> list[str]:
    """Return a line on what contacts carry, if any holds a part."""
    return [f"holding: {'; '.join(map(str, peaks))}"] * bool(peaks)


def stretch_lines(
    runs: Sequence[StretchRun], certificate: Certificate | CycleCertificate | None
) -> list[str]:
    """Return a line on every stretch with a speed band; a kept band holds for all t."""
    own = certificate.moves.values() if isinstance(certificate, CycleCertificate) else [certificate]
    held = [each.conditions["tool_speed"] for each in own if each is not None]
    is_proved = certificate is not None and all(
        each.holds(certificate.tolerance) and each.coverage == FOR_ALL_TIMES for each in held
    )
    return [f"{run}{'; for all t' * (is_proved and run.is_required)}" for run in runs]


def mark_lines(marks: Sequence[Mark]) -> list[str]:
    """Return a line on the events on the way, if there are any."""
    events = [mark for mark in marks if mark.kind == EVENT and not mark.is_of_step]
    return [f"events: {'; '.join(f'{each.name} at {each.time:.4f} s' for each in events)}"] * bool(
        events
    )


def certificate_text(certificate: Certificate | CycleCertificate) -> str:
    """Return a certificate as tables, as wide as the terminal."""
    if isinstance(certificate, CycleCertificate):
        return _cycle_certificate_text(certificate)
    table = _condition_table("Certificate")
    for name, condition in certificate.conditions.items():
        table.add_row(name, *condition_cells(condition, certificate.tolerance))
    return rendered(table)


def condition_cells(condition: JudgedCondition, tolerance: Tolerance) -> tuple[str, ...]:
    """Return margin, verdict, place and coverage of a condition as cells of a table."""
    if condition.margin is None:
        return "", "not required", "", condition.coverage
    margin = 0.0 if abs(condition.margin) < _ROUNDING else condition.margin
    is_relative = condition.unit == RELATIVE
    figures = f"{100 * margin:.3g} %" if is_relative else f"{margin:.3g} {condition.unit}"
    verdict = "yes" if condition.holds(tolerance) else "NO"
    return figures, verdict, escape(str(condition.where)), condition.coverage


def _condition_table(title: str) -> Table:
    return new_table(title, "condition", ">margin", "holds", "where", "coverage")


def other_speeds_line(certificate: Certificate) -> str:
    """Return a line on the longest braking to rest, and on slower runs."""
    parts = []
    braking = certificate.braking
    if braking is not None:
        parts.append(
            f"brakes to rest within {braking.time:.3f} s and {1000 * braking.distance:.0f} mm of "
            f"the tool's path (longest from {braking.where})"
        )
        if braking.holding is not None:
            held = braking.holding
            parts.append(
                f"as steep a stop may drop the held part: one that keeps it takes at most "
                f"{held.time:.3f} s and {1000 * held.distance:.0f} mm"
                if braking.drops
                else "as steep a stop keeps the held part"
            )
        if certificate.from_speed is not None:
            parts.append("any stop leaves the bands of the tool's speed")
    failure = certificate.slower_failure
    if failure is None:
        parts.append("slower runs keep all limits")
    else:
        parts.append(
            f"slower runs break limits: {failure.condition}, margin {100 * failure.margin:.3g} % "
            f"at {100 * failure.speed:.3g} % of the speed ({failure.where})"
        )
    if certificate.from_speed is not None and failure is None:
        parts[-1] = (
            "slower runs keep all upper limits; the bands of the tool's speed hold from "
            f"{100 * certificate.from_speed:.1f} % of the speed on"
        )
    return "; ".join(parts)


def left_out_lines(certificate: Certificate | CycleCertificate) -> list[str]:
    """Return a note that names the pairs of links that always touch; none if there are none."""
    pairs = [] if isinstance(certificate, CycleCertificate) else certificate.left_out
    touching = [pair for pair in pairs if pair.reason == ALWAYS_TOUCHING]
    named = "; ".join(" and ".join(pair.links) for pair in touching)
    note = f"not checked, because they touch in all of {TOUCH_SAMPLES} sampled configurations"
    return [f"note: {note}: {named}"] * bool(touching)


def new_table(title: str, *headings: str) -> Table:
    """Return an empty table; columns whose heading begins with ">" are aligned to the right."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        is_right = heading.startswith(">")
        table.add_column(heading.removeprefix(">"), justify="right" if is_right else "left")
    return table


def rendered(table: Table) -> str:
    """Return a table as text, as wide as the terminal or a file allows."""
    console = terminal()
    with console.capture() as capture:
        console.print(table)
    return capture.get().rstrip("\n")


def fits(table: Table) -> bool:
    """Return True if a table's columns fit beside each other without more line breaks."""
    return Console(width=_VERY_WIDE).measure(table).maximum <= terminal().width


def terminal() -> Console:
    """Return the console of text, with its width; without colour, as `say` prints codes as text."""
    width = None if sys.stdout.isatty() else _WIDTH_OF_A_FILE
    return Console(width=width, color_system=None)


# ---- Plans and certificates of cycles as text for a terminal.

_MIN_GAIN = 1e-4  # [s]; smaller gains by configurations chosen together are not reported


def _timetable(motion: CycleMotion, heading: str, leg_texts: Sequence[str]) -> str:
    """Return a table of moves and dwells with their times, and a text on each leg."""
    table = Table(title="Moves", title_justify="left")
    for name in ("begins", "takes"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("what", heading):
        table.add_column(name)
    cycle, end = motion.cycle, 0.0
    for leg, text in zip(cycle.legs, leg_texts, strict=True):
        begin = motion.move_times[leg.moves[0].name][0]
        _add_stop(table, leg.before, end, begin)
        for k, move in enumerate(leg.moves):
            begin, end = motion.move_times[move.name]
            cell = text if k == 0 else f"with {leg.moves[0].name}"
            table.add_row(*_span(begin, end), escape(move.name), escape(cell))
    _add_stop(table, cycle.after, end, motion.trajectory.duration)
    return rendered(table)


def _add_stop(table: Table, stop: Stop, begin: float, end: float) -> None:
    if stop.steps:
        table.add_row(*_span(begin, end), escape(f"at rest: {stop_text(stop)}"), "")


def _span(begin: float, end: float) -> tuple[str, str]:
    return f"{begin:.4f} s", f"{end - begin:.4f} s"


def _largest_saving(leg: Leg, plan: "LegPlan") -> str:
    """Return the limit of a leg's largest saving; empty if no limit saves time."""
    largest = max(plan.result.sensitivities, key=lambda each: each.saved, default=None)
    if largest is None or not savings([largest]):
        return ""
    if largest.segment is None or len(leg.moves) == 1:
        return str(largest)
    move, first, last = leg.segments_of_move(largest.segment, largest.last_segment)
    return f"{move.name}: {replace(largest, segment=first, last_segment=last)}"


def _gain_lines(result: "CycleResult") -> list[str]:
    """Return a line on the gain of configurations chosen together, if any."""
    shortest, alone = result.shortest_duration, result.greedy_duration
    if shortest is None or alone is None or alone - shortest <= _MIN_GAIN:
        return []
    return [
        f"configurations chosen over the whole cycle save {alone - shortest:.4f} s: the shortest "
        f"moves take {alone:.4f} s one by one, {shortest:.4f} s together"
    ]


def _verdict(certificate: CycleCertificate, leg: Leg) -> str:
    """Return the verdict on a leg, with its failed conditions."""
    name = leg.moves[0].name
    if name in certificate.refused:
        return f"FAILS: {certificate.refused[name]}"
    failures = ", ".join(certificate.moves[name].failures())
    return f"FAILS: {failures}" if failures else "passes"


def _cycle_certificate_text(certificate: CycleCertificate) -> str:
    """Return tables of the conditions of moves and junctions: failures, or else the tightest."""
    # Moves of a leg have one certificate.
    certificates = list({id(each): each for each in certificate.moves.values()}.values())
    moves = _condition_table("Certificate: each condition where it is tightest")
    for name in CONDITION_NAMES if certificates else ():
        for condition in _decisive([each.conditions[name] for each in certificates], certificate):
            moves.add_row(name, *condition_cells(condition, certificate.tolerance))
    junctions = _condition_table(
        "Seams, where the arm is at rest: each condition where it is tightest"
    )
    of_junctions = [
        (n, c, junction) for junction, own in certificate.junctions.items() for n, c in own.items()
    ]
    for name in dict.fromkeys(name for name, _, _ in of_junctions):
        named = {id(c): junction for n, c, junction in of_junctions if n == name}
        for condition in _decisive([c for n, c, _ in of_junctions if n == name], certificate):
            cells = condition_cells(condition, certificate.tolerance)
            junctions.add_row(escape(f"{name}: {named[id(condition)]}"), *cells)
    return "\n".join(rendered(table) for table in (moves, junctions))


def _decisive(
    conditions: Sequence[JudgedCondition], certificate: CycleCertificate
) -> list[JudgedCondition]:
    """Return the failed cases of a condition, or else its tightest case."""
    failed = [each for each in conditions if not each.holds(certificate.tolerance)]
    required = [each for each in conditions if each.margin is not None]
    return failed or [min(required or conditions, key=lambda each: each.margin or 0.0)]
