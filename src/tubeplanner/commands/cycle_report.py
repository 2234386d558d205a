"""Plans and certificates of cycles as text for a terminal."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from tubeplanner.commands.report import condition_cells, peaks_lines, rendered
from tubeplanner.constraints.trajectory_peaks import trajectory_peaks
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.leg import Leg, Rest
from tubeplanner.cycle.step_text import rest_text
from tubeplanner.verification.conditions import CONDITION_NAMES
from tubeplanner.verification.cycle_certificate import CycleCertificate
from tubeplanner.verification.judged_condition import JudgedCondition

if TYPE_CHECKING:  # the planner loads SciPy, and `check` does not need it
    from tubeplanner.cycle_planning.cycle_result import CycleResult
    from tubeplanner.cycle_planning.leg_plan import LegPlan

_SENSITIVITIES_SHOWN = 3
# Less is no gain that shared configurations are praised for [s].
_LEAST_GAIN = 1e-4


def cycle_plan_text(cycle: Cycle, result: "CycleResult", loading_time: float) -> str:
    """Return the result of planning a cycle as text.

    Args:
        cycle: The cycle.
        result: Its result.
        loading_time: [s].
    """
    robot, motion = cycle.robot, result.motion
    lines = [f"{cycle.name}: {robot.name}, {robot.joint_count} joints to {robot.tool_frame}"]
    if motion is not None:
        lines += peaks_lines(robot, trajectory_peaks(robot, motion.trajectory))
    lines.append(
        f"loaded in {loading_time:.2f} s, planned in {result.planning_time:.2f} s "
        f"(certificate {result.certificate_time:.2f} s), method {result.method}"
    )
    if motion is not None:
        prices = [_dearest(*each) for each in zip(cycle.legs, result.legs, strict=True)]
        lines.append(_timetable(motion, "10 % more saves most", prices))
    if result.certificate is not None:
        lines.append(_certificate_text(result.certificate))
    lines += [f"{result.status}: {result.message}", *_gain_lines(result)]
    lines += [f"note: {note}" for note in result.notes]
    place = str(result.place)
    lines += [f"where: {place}"] * bool(place)
    if result.stopped_by is not None:
        lines.append(f"stopped by {result.stopped_by.replace('_', ' ')}: there may be better")
    return "\n".join([*lines, *_geometry_lines(cycle)])


def cycle_check_text(
    motion: CycleMotion, certificate: CycleCertificate, notes: Sequence[str]
) -> str:
    """Return the judgement of a cycle's motion as text.

    Args:
        motion: The motion.
        certificate: Its certificate.
        notes: What else is to be known of its file.
    """
    cycle = motion.cycle
    verdicts = [_verdict(certificate, leg) for leg in cycle.legs]
    return "\n".join(
        [
            *peaks_lines(cycle.robot, trajectory_peaks(cycle.robot, motion.trajectory)),
            _timetable(motion, "certificate", verdicts),
            _certificate_text(certificate),
            *(f"note: {note}" for note in notes),
            *_geometry_lines(cycle),
        ]
    )


def _timetable(motion: CycleMotion, heading: str, said: Sequence[str]) -> str:
    """Return when moves and rests begin, and what is said of each leg, below a heading."""
    table = Table(title="Moves", title_justify="left")
    for name in ("begins", "takes"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("what", heading):
        table.add_column(name)
    cycle, end = motion.cycle, 0.0
    for leg, about in zip(cycle.legs, said, strict=True):
        begin = motion.move_times[leg.moves[0].name][0]
        _add_rest(table, leg.before, end, begin)
        for k, move in enumerate(leg.moves):
            begin, end = motion.move_times[move.name]
            last = about if k == 0 else f"with {leg.moves[0].name}"
            table.add_row(*_span(begin, end), escape(move.name), escape(last))
    _add_rest(table, cycle.after, end, motion.trajectory.duration)
    return rendered(table)


def _add_rest(table: Table, rest: Rest, begin: float, end: float) -> None:
    if rest.steps:
        table.add_row(*_span(begin, end), escape(f"at rest: {rest_text(rest)}"), "")


def _span(begin: float, end: float) -> tuple[str, str]:
    return f"{begin:.4f} s", f"{end - begin:.4f} s"


def _dearest(leg: Leg, plan: "LegPlan") -> str:
    """Return which limit costs a leg most; nothing if none costs anything."""
    found = max(plan.result.sensitivities, key=lambda each: each.saved, default=None)
    if found is None or found.saved <= 0:
        return ""
    if found.segment is None or len(leg.moves) == 1:
        return str(found)
    move, segment = leg.move_of(found.segment)
    return f"{move.name}: {replace(found, segment=segment, last_segment=None)}"


def _gain_lines(result: "CycleResult") -> list[str]:
    """Return what more of each limit would save, and what configurations in common did."""
    lines, dearest = [], [each for each in result.sensitivities if each.saved > 0]
    if dearest:
        listed = "; ".join(str(each) for each in dearest[:_SENSITIVITIES_SHOWN])
        lines.append(f"10 % more would save, over the cycle: {listed}")
    shortest, alone = result.shortest_duration, result.greedy_duration
    if shortest is not None and alone is not None and alone - shortest > _LEAST_GAIN:
        lines.append(
            f"configurations between moves chosen together save {alone - shortest:.4f} s: moves "
            f"planned alone, one after the other, take {alone:.4f} s at the shortest, these "
            f"{shortest:.4f} s"
        )
    return lines


def _verdict(certificate: CycleCertificate, leg: Leg) -> str:
    """Return whether a leg passes, and else what it fails."""
    name = leg.moves[0].name
    if name in certificate.refused:
        return f"FAILS: {certificate.refused[name]}"
    failures = ", ".join(certificate.moves[name].failures())
    return f"FAILS: {failures}" if failures else "passes"


def _certificate_text(certificate: CycleCertificate) -> str:
    """Return the tightest of each condition over all moves, all that fail, and the seams."""
    judged = list({id(each): each for each in certificate.moves.values()}.values())
    moves = _condition_table("Certificate: each condition where it is tightest")
    for name in CONDITION_NAMES if judged else ():
        for condition in _told([each.conditions[name] for each in judged], certificate):
            moves.add_row(name, *condition_cells(condition, certificate.tolerance))
    seams = _condition_table("Seams, where the arm is at rest: each condition where it is tightest")
    of_seams = [(n, c, seam) for seam, own in certificate.seams.items() for n, c in own.items()]
    for name in dict.fromkeys(name for name, _, _ in of_seams):
        named = {id(c): seam for n, c, seam in of_seams if n == name}
        for condition in _told([c for n, c, _ in of_seams if n == name], certificate):
            cells = condition_cells(condition, certificate.tolerance)
            seams.add_row(escape(f"{name}: {named[id(condition)]}"), *cells)
    return "\n".join(rendered(table) for table in (moves, seams))


def _told(
    conditions: Sequence[JudgedCondition], certificate: CycleCertificate
) -> list[JudgedCondition]:
    """Return those of one condition, of all legs, that are told: what fails, or the tightest."""
    failing = [each for each in conditions if not each.holds(certificate.tolerance)]
    asked = [each for each in conditions if each.margin is not None]
    return failing or [min(asked or conditions, key=lambda each: each.margin or 0.0)]


def _condition_table(title: str) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in ("condition", "margin", "holds", "where", "coverage"):
        table.add_column(heading, justify="right" if heading == "margin" else "left")
    return table


def _geometry_lines(cycle: Cycle) -> list[str]:
    """Return a note where nothing is checked against obstacles."""
    problem = cycle.problem_from_anywhere(0)
    if not cycle.obstacles or problem.collision.has_link_geometry:
        return []
    return ["note: the robot has no collision geometry; the obstacles were NOT checked against it"]
