"""Are narrow tubes planned as well as wide ones, and as well as by another checkout?

    python benchmarks/never_stuck.py [--against CHECKOUT] [--only SUBSTRING]

Bundled problems, the same with tubes of 0.5 to 5 mm, and paths that a Z1 draws on a table are
planned by the default method. Each duration stands beside the mark that was once reached, the
fastest baseline that passes the certificate and, plan by plan in turns, another checkout's duration
and processor time. Exit status 1 if a plan is not certified, slower than a baseline, or more than
2 % above its mark.
"""

import argparse
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from shared import HERE, Checkout, figure, geometric_mean

SMOOTHED = ("smoothed-arc-corners", "smoothed-bang-bang")
MAX_ABOVE_MARK = 1.02
DRIVER = """
import json, sys, time
from dataclasses import replace
from tubeplanner import compare, load_problem, parse_problem, plan
for line in sys.stdin:
    case = json.loads(line)
    bundled, baselines = case["bundled"], case["baselines"]
    problem = load_problem(f"example:{bundled}") if bundled else parse_problem(case["data"])
    if case["radius"] is not None:
        tube = problem.tube
        problem = replace(problem, tube=tube.with_radius(case["radius"] + tube.tool_radius))
    begun = time.process_time()
    result = plan(problem, SHORTEST)
    answer = {"duration": result.duration, "status": result.status, "method": result.method}
    answer["cpu"] = time.process_time() - begun
    if baselines:
        rows = compare(problem, methods=baselines).rows
        fastest = [row.duration for row in rows if row.certified]
        answer["baseline"] = min(fastest, default=None)
    print(json.dumps(answer), flush=True)
"""
# A tool of 15 cm that a Z1 holds down, above a table.
Z1: dict[str, Any] = {
    "robot": {
        "urdf": "example:z1",
        "tool_frame": "gripperStator",
        "tool_offset": {"position": [0.15, 0, 0]},
    },
    "start": {"seed": [0, 1.5, -1, -0.54, 0, 0]},
    "obstacles": [{"name": "table", "box": [0.6, 0.6, 0.02], "position": [0.4, 0, 0]}],
}
_HEIGHT = 0.10
_BEAD = (
    *((0.30, -0.10), (0.36, -0.12), (0.42, -0.10), (0.45, -0.05), (0.45, 0.0), (0.45, 0.05)),
    *((0.42, 0.10), (0.36, 0.12), (0.30, 0.10), (0.27, 0.05), (0.27, -0.05), (0.30, -0.10)),
)
BUNDLED = {
    "ur5/over_the_wall": {0.5: 0.648, 1: 0.640, 2: 0.633, 5: 0.607},
    "panda/between_shelves": {0.5: 0.792, 1: 0.786, 2: 0.777, 5: 0.758},
    "ur10/onto_a_conveyor": {0.5: 1.049, 1: 1.037, 2: 1.018, 5: 0.989},
    "xarm7/from_crate_to_crate": {0.5: 0.660, 1: 0.644, 2: 0.626, 5: None},
}
WIDE = (*BUNDLED, "ur5/level_tray", "two_link/around_a_post")
PAPER = tuple(f"two_link/paper_{i}_{radius}mm" for i in range(1, 6) for radius in (10, 30, 50))


@dataclass(frozen=True)
class Case:
    """One problem.

    Attributes:
        name: What the table calls it.
        bundled: The bundled problem that it is, or None.
        radius: Its tube's radius instead of its own [m], or None.
        data: What its problem file holds, if it is no bundled one.
        mark: A duration that was reached [s], or None.
    """

    name: str
    bundled: str | None = None
    radius: float | None = None
    data: dict[str, Any] = field(default_factory=dict)
    mark: float | None = None

    @property
    def is_narrow(self) -> bool:
        """Whether its tube is one of millimetres."""
        return self.radius is not None or bool(self.data)


def planned(checkout: Checkout, case: Case, baselines: tuple[str, ...] = ()) -> dict:
    """Return what a checkout plans, and its fastest baseline."""
    return checkout.ask(asdict(case) | {"baselines": baselines})


def fault(case: Case, answer: dict) -> str:
    """Say what is wrong with an answer; empty if nothing."""
    if answer["status"] != "success":
        return str(answer["status"])
    if answer["baseline"] is not None and answer["duration"] > answer["baseline"]:
        return "slower than a baseline"
    if case.mark is not None and answer["duration"] > MAX_ABOVE_MARK * case.mark:
        return "above its mark"
    return ""


def main() -> int:
    """Plan and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="problems whose name contains this")
    arguments = parser.parse_args()
    here = Checkout(HERE, DRIVER)
    other = Checkout(arguments.against.resolve(), DRIVER) if arguments.against else None
    names = ("T [s]", "mark", "baseline", "other T", "CPU", "other")
    print(f"{'problem':32}" + "".join(f"{name:>10}" for name in names))
    faults, ratios = 0, {}
    for case in cases():
        if arguments.only not in case.name:
            continue
        answer = planned(here, case, SMOOTHED if case.is_narrow else ())
        answer.setdefault("baseline", None)
        before = {} if other is None else planned(other, case)
        wrong = fault(case, answer)
        faults += bool(wrong)
        print(
            f"{case.name:32}{figure(answer['duration']):>10}{figure(case.mark, 3):>10}"
            f"{figure(answer['baseline'], 3):>10}{figure(before.get('duration')):>10}"
            f"{figure(answer['cpu'], 2):>10}{figure(before.get('cpu'), 2):>10}  {wrong}",
            flush=True,
        )
        group = ratios.setdefault("narrow" if case.is_narrow else "wide", {})
        if case.mark is not None and answer["duration"]:
            group.setdefault("T / mark", []).append(answer["duration"] / case.mark)
        if answer["duration"] and before.get("duration"):
            group.setdefault("T / other", []).append(answer["duration"] / before["duration"])
            group.setdefault("CPU / other", []).append(answer["cpu"] / before["cpu"])
    for name, group in ratios.items():
        for what, found in group.items():
            mean = geometric_mean(found)
            print(f"{name}: {what}: geometric mean {mean:.4f}, largest {max(found):.4f}")
    return 1 if faults else 0


def cases() -> list[Case]:
    """Return all problems, the narrow ones first."""
    narrowed = [
        Case(f"{name} {radius:g} mm", name, radius / 1000, mark=mark)
        for name, marks in BUNDLED.items()
        for radius, mark in marks.items()
    ]
    wide = [Case(name, name) for name in (*WIDE, *PAPER)]
    return [*narrowed, *drawn(), *wide]


def drawn() -> list[Case]:
    """Return what the Z1 draws."""
    return [
        _drawn("bead 2 mm", _BEAD, 0.002, 0.426),
        _drawn("circle of 48 chords 1.5 mm", _circle(48, 0.08), 0.0015, 0.348),
        _drawn("circle of 60 chords 1 mm", _circle(60, 0.08), 0.001, 0.356),
        _drawn("lawn 1 mm", _lawn(6, 0.01), 0.001),
        _drawn("lawn 2 mm", _lawn(6, 0.005), 0.002),
        _drawn("hairpin 1 mm", [(0.36, -0.08), (0.44, 0.0), (0.36, -0.06)], 0.001),
        _drawn("spiral 1 mm", _spiral(40), 0.001),
        _drawn("star 1 mm", _star(5), 0.001),
    ]


def _drawn(name: str, path: Any, radius: float, mark: float | None = None) -> Case:
    points = [[round(x, 6), round(y, 6), _HEIGHT] for x, y in path]
    return Case(name, data={**Z1, "tube": {"points": points, "radius": radius}}, mark=mark)


def _circle(chords: int, radius: float) -> list[tuple[float, float]]:
    angles = [math.pi - 2 * math.pi * i / chords for i in range(chords + 1)]
    return [(0.36 + radius * math.cos(a), radius * math.sin(a)) for a in angles]


def _lawn(lines: int, apart: float) -> list[tuple[float, float]]:
    path = []
    for i in range(lines):
        ends = [(0.32 + apart * i, -0.06), (0.32 + apart * i, 0.06)]
        path += ends if i % 2 == 0 else ends[::-1]
    return path


def _spiral(chords: int) -> list[tuple[float, float]]:
    turns = [i / chords for i in range(chords + 1)]
    return [
        (
            0.36 + (0.02 + 0.06 * t) * math.cos(6 * math.pi * t),
            (0.02 + 0.06 * t) * math.sin(6 * math.pi * t),
        )
        for t in turns
    ]


def _star(corners: int) -> list[tuple[float, float]]:
    angles = [math.pi * i / corners for i in range(2 * corners + 1)]
    radii = [0.08 if i % 2 == 0 else 0.035 for i in range(2 * corners + 1)]
    return [(0.36 + r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]


if __name__ == "__main__":
    raise SystemExit(main())
