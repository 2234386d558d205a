"""The tables of Suh & Bishop (1988) beside ours, as a page of Markdown."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tubeplanner.studies.printed_results import (
    FIGURE_SEVEN,
    NO_TUBE,
    TABLE_FOUR,
    TABLE_THREE,
    TABLE_TWO,
    PrintedLine,
)
from tubeplanner.studies.reproduction import PATH_RADIUS, Reproduction

_INTRODUCTION = """\
# Suh & Bishop (1988), from our code

"Collision-avoidance trajectory planning using tube concept: analysis and simulation", J. Robotic
Systems 5(6), 497-525. The two-link arm of its Table I, horizontal plane, motors of 95 and 27 N m,
elbow kept on one side. The paper does not say where the masses are: with each at the end of its
link, ours match its bang-bang times. Durations are in seconds.

The paper plans in two phases. Phase 1 takes points of the reference path as knots of a joint
polynomial and finds the fastest choice by branch and bound. Phase 2 moves the knots within the tube
and doubles their number.

**Published** is `--method suh-bishop`, the algorithm as printed; what the paper leaves open (the
increments, the line search, when to stop) is ours. **Default** is `refinement`. Both are certified.
**Ratio** is our value divided by the printed one. `tubeplanner reproduce` made this page.
"""

_NOT_MONOTONE = """\
- Where a wider tube gives a slower published trajectory, its search ended in another local optimum:
the
  narrower tube's trajectory stays in the wider one too.
"""

_SCHEMES = f"""\
The schemes that the paper compares with. Conventional: straight lines with stops at trapezoidal
speed, by the constants of Table I or as fast as the limits allow. Bang-bang: the least time on the
lines, if motors switch instantly; smoothed until the acceleration is continuous. Arc corners and
Taylor's bounded deviation cut corners, within {1000 * PATH_RADIUS:.0f} mm. All but the smoothed
ones have accelerations that jump.
"""

# The quantities with a ratio, and their columns in Table II.
_PHASE_ONE, _PUBLISHED, _DEFAULT = "phase 1", "phase 2, published", "default"


def reproduction_page(reproduction: Reproduction, figures: Mapping[str, str]) -> str:
    """Return the page.

    Args:
        reproduction: The results.
        figures: The file of each figure, by its caption.
    """
    parts = [
        _INTRODUCTION,
        "## Table II: five examples\n",
        _table_two(reproduction),
        _summary(reproduction),
        _NOT_MONOTONE + _remarks(_on_examples()),
        "## The reference path itself\n",
        _SCHEMES,
        _table_of_paths(reproduction),
        "## Table III: the line of figure 8(a)\n",
        _table_of_line(reproduction, TABLE_THREE),
        _remarks([TABLE_THREE.remark, _line_itself(reproduction, TABLE_THREE)]),
        "## Table IV: the line of figure 9(a)\n",
        _table_of_line(reproduction, TABLE_FOUR),
        _remarks([TABLE_FOUR.remark, _line_itself(reproduction, TABLE_FOUR)]),
        "## Figures\n",
        _remarks([_figure_seven(reproduction)]),
        *(f"![{caption}]({file})\n" for caption, file in figures.items()),
    ]
    return "\n".join(parts)


def _on_examples() -> list[str]:
    """Return the remarks on the printed numbers; one that is about several examples, once."""
    examples: dict[str, list[int]] = {}
    for number, row in TABLE_TWO.items():
        if row.remark:
            examples.setdefault(row.remark, []).append(number)
    return [
        f"Example{'s' * (len(numbers) > 1)} {' and '.join(map(str, numbers))}: {remark}."
        for remark, numbers in examples.items()
    ]


def _table_two(reproduction: Reproduction) -> str:
    head = ["example", "tolerance [mm]"]
    for name in (_PHASE_ONE, _PUBLISHED):
        head += [name, "printed", "ratio"]
    rows = []
    for number, row in TABLE_TWO.items():
        for radius in row.phases:
            pairs = _pairs(reproduction, number, radius)
            line = [str(number), f"{1000 * radius:.0f}"]
            for name in (_PHASE_ONE, _PUBLISHED):
                ours, printed = pairs[name]
                line += [_seconds(ours), f"{printed:.2f}", _ratio(ours, printed)]
            ours, printed = pairs[_DEFAULT]
            rows.append([*line, _seconds(ours), _ratio(ours, printed)])
    return _table([*head, _DEFAULT, "ratio"], rows)


def _summary(reproduction: Reproduction) -> str:
    """Return the mean, least and largest ratio to the printed durations."""
    rows = []
    for name in (_PHASE_ONE, _PUBLISHED, _DEFAULT):
        pairs = [
            _pairs(reproduction, number, radius)[name]
            for number, row in TABLE_TWO.items()
            for radius in row.phases
        ]
        ratios = [ours / printed for ours, printed in pairs if ours is not None]
        summary = ["-"] * 3
        if ratios:
            summary = [f"{value:.3f}" for value in (np.mean(ratios), min(ratios), max(ratios))]
        rows.append([name, f"{len(ratios)} of {len(pairs)}", *summary])
    return _table(("ratio", "cells", "mean", "least", "largest"), rows)


def _pairs(
    reproduction: Reproduction, example: int, radius: float
) -> dict[str, tuple[float | None, float]]:
    """Return our duration and the printed one, by name."""
    cell = reproduction.cell(example, radius)
    phase_one, phase_two = TABLE_TWO[example].phases[radius]
    return {
        _PHASE_ONE: (cell.published.phase1_duration, phase_one),
        _PUBLISHED: (cell.published.duration, phase_two),
        _DEFAULT: (cell.default.duration, phase_two),
    }


def _table_of_paths(reproduction: Reproduction) -> str:
    """Return the durations of the schemes without a tube; only the first column is printed."""
    schemes = list(next(iter(reproduction.paths.values())).trajectories)
    rows = [
        [str(number), f"{TABLE_TWO[number].conventional:.2f}"]
        + [_seconds(path.duration(scheme)) for scheme in schemes]
        for number, path in reproduction.paths.items()
    ]
    return _table(("example", "conventional, printed", *schemes), rows)


def _table_of_line(reproduction: Reproduction, table: PrintedLine) -> str:
    rows = []
    for radius, printed in table.durations.items():
        cell = reproduction.cell(table.example, radius)
        row = ["none" if radius == NO_TUBE else f"{1000 * radius:.0f}", f"{printed:.2f}"]
        for duration in (cell.published.duration, cell.default.duration):
            row += [_seconds(duration), _ratio(duration, printed)]
        rows.append(row)
    return _table(("tolerance [mm]", "printed", "published", "ratio", "default", "ratio"), rows)


def _line_itself(reproduction: Reproduction, table: PrintedLine) -> str:
    """Return a sentence on motors that switch instantly, and on the cost of smoothness."""
    path = reproduction.paths[table.example]
    switched, smoothed = path.duration("bang-bang"), path.duration("smoothed-bang-bang")
    return (
        f"Bang-bang on the line itself takes {_seconds(switched)} s (printed: "
        f"{table.bang_bang:.2f} s), smoothed {_seconds(smoothed)} s (printed: {table.smoothed:.2f} "
        "s, of which 26 % are an estimate of what smoothness costs)."
    )


def _figure_seven(reproduction: Reproduction) -> str:
    summary = ", ".join(
        f"{_seconds(reproduction.cell(1, radius).published.duration)} ({printed:.2f})"
        for radius, printed in FIGURE_SEVEN.items()
    )
    radii = ", ".join(f"{1000 * radius:.0f}" for radius in FIGURE_SEVEN)
    return (
        f"Figure 7 is captioned example 2 and shows example 1. As published, at {radii} mm, ours "
        f"and, in brackets, printed: {summary} s."
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _remarks(sentences: Iterable[str]) -> str:
    return "\n".join(f"- {sentence}" for sentence in sentences) + "\n"


def _seconds(duration: float | None) -> str:
    return "-" if duration is None else f"{duration:.3f}"


def _ratio(ours: float | None, printed: float) -> str:
    return "-" if ours is None else f"{ours / printed:.2f}"
