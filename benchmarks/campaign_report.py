"""What a campaign shows, as text: marks, processor times, refusals by cause, what is stuck.

A message's cause is the message without its numbers and names.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np

from campaign_examine import UNBUILT, is_wrong

Line = dict[str, Any]

STUCK = 1.01  # times the best of the three
MOST_SHOWN = 12  # seeds of a cause
# Marks: shares, and processor times in those of the reference.
LEAST_SOLVED, MOST_STUCK, SUCCESSES, REFUSALS = 0.995, 0.01, 20.0, 60.0
_BY_JOINTS = ((1, 2), (3, 4), (5, 6), (7, 8), (9, 10))
_BY_SEGMENTS = ((1, 3), (4, 10), (11, 30), (31, 80), (81, 200))


def stuck(line: Line) -> list[str]:
    """Return what shows that an answer is needlessly slow, or missing."""
    baseline, duration = line.get("baseline"), line.get("duration")
    slower = baseline is not None and (duration is None or duration > baseline)
    return ["beside a baseline"] * slower + _stuck_of_pair(line.get("pairs"))


def _stuck_of_pair(pairs: Line | None) -> list[str]:
    """Return which of the plans forwards and backwards are needlessly slow, or missing."""
    if not pairs:
        return []
    durations = {name: pairs[name] for name in ("forwards", "backwards", "narrower")}
    best = min((each for each in durations.values() if each is not None), default=None)
    if best is None:
        return []
    limit = STUCK * best
    return [n for n in ("forwards", "backwards") if durations[n] is None or durations[n] > limit]


def report(lines: Iterable[Line]) -> str:
    """Return the whole report of the lines of a campaign."""
    lines = sorted(lines, key=lambda line: line["seed"])
    built = [line for line in lines if line["status"] != UNBUILT]
    if not built:
        return "no problem was built"
    parts = [_marks(lines, built), _kinds(built), _times(built), _causes(built), _lists(built)]
    return "\n\n".join(part for part in parts if part)


def _marks(lines: list[Line], built: list[Line]) -> str:
    """Return a table of the marks: what was found, what is asked, and whether it is kept."""
    solved = [line for line in built if line["status"] == "success"]
    paired = [line for line in built if "pairs" in line]
    slow, wrong = [line for line in paired if stuck(line)], [x for x in built if is_wrong(x)]
    share, share_stuck = len(solved) / len(built), len(slow) / max(len(paired), 1)
    seeds = f"seeds {lines[0]['seed']} to {lines[-1]['seed']}"
    missing = [line for line in built if line["status"] != "success"]
    rows = [
        f"{len(built)} problems with a witness, {seeds} ({len(lines) - len(built)} not built)",
        f"{'mark':<24}{'found':<28}{'asked':<12}",
        _mark("wrong", f"{len(wrong)} of {len(solved)} solved", "0", not wrong, wrong),
        _mark(
            "solved",
            f"{len(solved)} of {len(built)}, {share:.2%}",
            f"{LEAST_SOLVED:.1%}",
            share >= LEAST_SOLVED,
            missing,
        ),
        _mark(
            "stuck",
            f"{len(slow)} of {len(paired)} pairs, {share_stuck:.1%}",
            f"{MOST_STUCK:.0%}",
            share_stuck <= MOST_STUCK,
            slow,
        ),
    ]
    return "\n".join(rows + _marks_of_times(built))


def _mark(name: str, found: str, asked: str, kept: bool, beside: list[Line]) -> str:
    verdict = "kept" if kept else "MISSED"
    return f"{name:<24}{found:<28}{asked:<12}{verdict:<8}{_seeds(beside)}".rstrip()


def _marks_of_times(built: list[Line]) -> list[str]:
    """Return rows of processor times, in those of the reference; none if it was not planned."""
    reference = _reference(built)
    if not reference > 0:
        return ["processor times: the reference was not planned yet"]
    rows = [f"processor times in those of ur5/over_the_wall, {reference:.2f} s:"]
    for name, most in (("success", SUCCESSES), ("refused", REFUSALS)):
        chosen = [x for x in built if _ended(x) == name]
        times = _multiples(chosen, reference)
        if len(times):
            p50, p90, p99 = np.percentile(times, [50, 90, 99])
            beyond = [x for x in chosen if _counts(x) and x["cpu"] > most * reference]
            found = f"p50 {p50:.2g}, p90 {p90:.2g}, p99 {p99:.3g}"
            rows.append(_mark(name, found, f"p99 {most:g}", p99 <= most, beyond))
    return rows


def _ended(line: Line) -> str:
    return "success" if line["status"] == "success" else "refused"


def _reference(lines: list[Line]) -> float:
    """Return the median processor time of the reference [s]; nan if it was not planned."""
    times = [line["reference_cpu"] for line in lines if line.get("reference_cpu")]
    return float(np.median(times)) if times else float("nan")


def _multiples(lines: list[Line], reference: float) -> "np.ndarray[Any, Any]":
    """Return processor times of lines, in those of the reference."""
    return np.array([line["cpu"] for line in lines if _counts(line)]) / reference


def _counts(line: Line) -> bool:
    """Return whether a line has the processor time of one plan: cycles have two."""
    return bool(line.get("cpu")) and not line.get("cycle")


def _kinds(built: list[Line]) -> str:
    counted: Counter[str] = Counter(kind for line in built for kind in line.get("kinds", []))
    counted["cycles of two moves"] = sum(bool(line.get("cycle")) for line in built)
    arms = len({line["arm"].split("/")[0] for line in built if "arm" in line})
    listed = ", ".join(f"{count} {kind}" for kind, count in counted.most_common() if count)
    return f"of them with: {listed}; {arms} kinds of arms"


def _times(built: list[Line]) -> str:
    """Return a table of processor times of successes by joints and by segments."""
    reference = _reference(built)
    solved = [line for line in built if line["status"] == "success"]
    if not reference > 0 or not solved:
        return ""
    rows = [f"{'successes with':20}{'count':>7}{'p50':>8}{'p90':>8}{'p99':>8}"]
    for name, bands in (("joints", _BY_JOINTS), ("segments", _BY_SEGMENTS)):
        for low, high in bands:
            times = _multiples([x for x in solved if low <= x[name] <= high], reference)
            if len(times):
                p50, p90, p99 = np.percentile(times, [50, 90, 99])
                label = f"{low} to {high} {name}"
                rows.append(f"{label:20}{len(times):7}{p50:8.2g}{p90:8.2g}{p99:8.3g}")
    return "\n".join(rows)


def _causes(built: list[Line]) -> str:
    """Return refusals by cause, the most frequent first."""
    by_cause: dict[str, list[Line]] = defaultdict(list)
    for line in built:
        if line["status"] != "success":
            by_cause[f"{line['status']}: {cause(line['message'])}"].append(line)
    listed = sorted(by_cause.items(), key=lambda item: -len(item[1]))
    rows = [f"{len(found):4}  {name} {_seeds(found)}" for name, found in listed]
    return "\n".join(["refused, by cause:", *rows]) if rows else ""


def cause(message: str) -> str:
    """Return a message without its numbers, names and places."""
    text = re.sub(r"'[^']*'", "'...'", message)
    text = re.sub(r"\[[^\]]*\]", "[...]", text)
    text = re.sub(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?", "#", text)
    return text[:110]


def _lists(built: list[Line]) -> str:
    rows = [
        f"WRONG {_what(x)}: {x['worst']} {x.get('pairs', {}).get('wrong')}"
        for x in built
        if is_wrong(x)
    ]
    rows += [
        f"stuck {_what(x)}: {' and '.join(stuck(x))}: {x.get('pairs', x.get('baseline'))}"
        for x in built
        if stuck(x)
    ]
    return "\n".join(rows)


def _seeds(lines: list[Line]) -> str:
    seeds = [str(line["seed"]) for line in lines]
    more = f" and {len(seeds) - MOST_SHOWN} more" if len(seeds) > MOST_SHOWN else ""
    return f"[seeds {', '.join(seeds[:MOST_SHOWN])}{more}]" if seeds else ""


def _what(line: Line) -> str:
    if "arm" not in line:
        return f"seed {line['seed']}"
    return (
        f"seed {line['seed']} ({line['arm']}, {line['segments']} segments, {line['scale']:.2g} m)"
    )
