"""Is a path of many points planned as fast as one of few, and does it become as fast a motion?

    python benchmarks/many_points.py [--against CHECKOUT] [--only SUBSTRING] [--limit SECONDS]

Plans a circle and a spline, each of 12 to 2,000 points, bundled problems whose segments are cut
into short ones, scans that run backwards, and a wave. Prints durations, processor times and peaks
of memory (every plan is a process of its own) beside another checkout's, plan by plan in turns;
where that takes longer than the limit, nothing. Exit status 1 if a plan is not certified, if a path
of 25 points or more becomes more than 1 % slower than the fastest of them, or if 500 points take
more than 2.5 times as long to plan as 12.
"""

import argparse
import math
import random
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from shared import HERE, asked_once, figure

COUNTS = (12, 25, 50, 100, 200, 250, 500, 1000, 2000)
RADII = (0.010, 0.002)
CUT = ("ur5/over_the_wall", "panda/between_shelves", "xarm7/from_crate_to_crate")
PARTS = (1, 4, 16)
NOISE = 0.001  # [m], standard deviation
MAX_SLOWER, MAX_CPU = 1.01, 2.5
ENOUGH = 25  # points, from which on all must be equally fast
# The second of two plans counts, so that libraries are loaded and covers known.
DRIVER = """
import json, resource, sys, time
from dataclasses import replace
import numpy as np
from tubeplanner import Tube, load_problem, parse_problem, plan

def cut(tube, parts):
    share = np.arange(parts)[:, None] / parts
    legs = zip(tube.points, tube.points[1:])
    points = np.vstack([a + share * (b - a) for a, b in legs] + [tube.points[-1:]])
    signs = [row for row in tube.joint_signs for _ in range(parts)]
    return Tube(points, np.repeat(tube.radius, parts), tool_radius=tube.tool_radius,
                joint_signs=signs, visit=tube.visit)

case = json.loads(sys.stdin.readline())
if case["bundled"]:
    problem = load_problem("example:" + case["bundled"])
    problem = replace(problem, tube=cut(problem.tube, case["parts"]))
else:
    problem = parse_problem(case["data"])
plan(load_problem("example:two_link/around_a_post"), SHORTEST)
begun = time.process_time()
result = plan(problem, SHORTEST)
cpu = time.process_time() - begun
answer = {"status": result.status, "method": result.method, "duration": result.duration}
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # [MiB] on Linux
print(json.dumps(answer | {"cpu": cpu, "memory": memory}), flush=True)
"""


@dataclass(frozen=True, eq=False)
class Case:
    """One problem.

    Attributes:
        family: Of which path or problem it is a variant.
        count: How many segments the path has, or into how many parts each is cut.
        data: What its problem file holds, if it is no bundled one.
        bundled: The bundled problem that is cut, or None.
    """

    family: str
    count: int
    data: dict[str, Any] = field(default_factory=dict)
    bundled: str | None = None

    @property
    def name(self) -> str:
        """What the table calls it."""
        return f"{self.family}, {'cut in' if self.bundled else 'N ='} {self.count}"


def cases() -> list[Case]:
    """Return all problems."""
    paths = {"circle": circle, "spline": spline}
    found = [
        Case(f"{name} {1000 * radius:g} mm", count, path(count, radius))
        for name, path in paths.items()
        for radius in RADII
        for count in COUNTS
    ]
    found += [Case(name, parts, bundled=name) for name in CUT for parts in PARTS]
    found += [
        Case(f"scan {1000 * radius:g} mm", 200, scan(200, radius)) for radius in (0.005, 0.002)
    ]
    found.append(Case("wave of 2.5 mm bends, 10 mm", 400, wave(400, 0.010)))
    return found


def circle(count: int, radius: float) -> dict[str, Any]:
    """Return an xArm7 that follows a closed circle of 70 mm in so many chords."""
    angles = [2 * math.pi * i / count for i in range(count + 1)]
    points = [[0.40 + 0.07 * math.cos(a), 0.07 * math.sin(a), 0.25] for a in angles]
    return {
        "robot": {
            "urdf": "example:xarm7",
            "tool_frame": "link_eef",
            "tool_offset": {"position": [0, 0, 0.1]},
        },
        "start": {"seed": [0, 0.19, 0, 0.83, 0, 0.64, 0]},
        "tube": {"points": points, "radius": radius, "joint_signs": {"joint4": "+"}},
    }


def spline(count: int, radius: float) -> dict[str, Any]:
    """Return a UR5 that follows a curved path of 0.34 m in so many chords."""
    fractions = [i / count for i in range(count + 1)]
    points = [
        [
            0.35 + 0.25 * s,
            0.04 * math.sin(2 * math.pi * (s + 0.3 * s * s)),
            0.30 + 0.03 * math.sin(math.pi * s),
        ]
        for s in fractions
    ]
    return {
        "robot": {"urdf": "example:ur5", "tool_frame": "tool0"},
        "start": {"seed": [-0.2, -1.3, 1.9, -2.0, -1.6, 0]},
        "tube": {"points": points, "radius": radius, "joint_signs": {"elbow_joint": "+"}},
    }


def scan(count: int, radius: float) -> dict[str, Any]:
    """Return the spline as a scan has it: many points lie behind those that they follow."""
    data, noise = spline(count, radius), random.Random(0)
    inner = data["tube"]["points"][1:-1]
    inner[:] = [[x + noise.gauss(0, NOISE) for x in point] for point in inner]
    return data


def wave(count: int, radius: float) -> dict[str, Any]:
    """Return a UR5 on a wavy line of 20 cm, its least radius of curvature 2.5 mm."""
    amplitude, length = 0.010, 0.200
    points = []
    for i in range(count + 1):
        x = length * i / count
        fade = min(1.0, x / 0.02, (length - x) / 0.02)
        points.append(
            [0.35 + x, fade * amplitude * math.sin(x / math.sqrt(0.0025 * amplitude)), 0.3]
        )
    data = spline(1, radius)
    data["tube"]["points"] = points
    return data


def planned(checkout: Path, case: Case, limit: float) -> dict[str, Any]:
    """Return what a checkout plans; nothing if it takes longer than the limit [s]."""
    return asked_once(checkout, DRIVER, asdict(case) | {"parts": case.count}, limit)


def faults(answers: dict[Case, dict[str, Any]]) -> list[str]:
    """Return what is wrong with the answers."""
    found = [
        f"{case.name}: {answer.get('status', 'not in time')} by {answer.get('method')}"
        for case, answer in answers.items()
        if answer.get("status") != "success" or answer.get("method") != "refinement"
    ]
    for family in dict.fromkeys(case.family for case in answers if not case.bundled):
        members = {case.count: answer for case, answer in answers.items() if case.family == family}
        durations = {
            n: answer["duration"]
            for n, answer in members.items()
            if n >= ENOUGH and answer.get("duration")
        }
        fastest = min(durations.values(), default=0.0)
        found += [
            f"{family}: N = {n} is slower than another"
            for n, duration in durations.items()
            if duration > MAX_SLOWER * fastest
        ]
        cpu = [members.get(n, {}).get("cpu") for n in (12, 500)]
        if None not in cpu and cpu[1] > MAX_CPU * cpu[0]:
            found.append(f"{family}: N = 500 takes {cpu[1] / cpu[0]:.1f} times as long as N = 12")
    return found


def main() -> int:
    """Plan and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="problems whose name contains this")
    parser.add_argument("--limit", type=float, default=120.0, help="for every plan [s]")
    arguments = parser.parse_args()
    print(f"{'problem':40}{'T [s]':>9}{'other':>9}{'CPU':>8}{'other':>8}{'MiB':>7}{'other':>7}")
    answers = {}
    for case in cases():
        if arguments.only not in case.name:
            continue
        answer = answers[case] = planned(HERE, case, arguments.limit)
        other = arguments.against
        before = planned(other.resolve(), case, arguments.limit) if other else {}
        print(
            f"{case.name:40}{figure(answer.get('duration')):>9}"
            f"{figure(before.get('duration')):>9}"
            f"{figure(answer.get('cpu'), 2):>8}{figure(before.get('cpu'), 2):>8}"
            f"{figure(answer.get('memory'), 0):>7}{figure(before.get('memory'), 0):>7}",
            flush=True,
        )
    wrong = faults(answers)
    print("\n".join(wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
