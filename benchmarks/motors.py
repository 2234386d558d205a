"""What motors change: durations, what limits them, and what plans without them would ask for.

    python benchmarks/motors.py [--slack 0.005] [--repeats 3] [--plot docs/motor_curves.png]

Plans bundled problems as they are and with motors, in turns, and prints of each the duration, the
same as a share of the duration without motors, the most that any joint uses of its motor (effort
limit or torque-speed line) with the motion that was planned without motors, the joint that does,
the limit whose rise by 10 % saves most time, and processor times as shares of those without motors,
of repeated plans the least of each. Exit status 1 if an answer is not certified, or if identified
motors take more than 1.3 times the processor time. --plot draws the efforts of the UR10 with
torque-speed lines over velocities, inside what the motors have.
"""

import argparse
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tubeplanner import PlanOptions, load_problem, plan, verify
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.motor_panels import draw_motors, motor_joints
from tubeplanner.views.panels import trajectory_curves

MAX_CPU = 1.3
# Made up: near the limits, as no maker gives them.
LINES = {
    "saturation_effort": [400, 400, 200, 80, 80, 80],
    "no_load_velocity": [4, 4, 6, 6, 6, 6],
}


@dataclass(frozen=True)
class Case:
    """Changes of a bundled problem, beside what it is compared with.

    Attributes:
        name: What the table calls it.
        changes: Of the file.
        is_identified: Whether the goal for processor times is about it.
    """

    name: str
    changes: Mapping[str, Any]
    is_identified: bool = True


CASES: Mapping[str, tuple[Case, ...]] = {
    "ur10/onto_a_conveyor": (
        Case("no motors", {}),
        Case("ur10_friction", {"robot.preset": "ur10_friction"}),
        Case(
            "... uncertain by 20 %",
            {"robot.preset": "ur10_friction", "robot.motors.friction_uncertainty": 0.2},
        ),
        Case(
            "... and torque-speed lines",
            {"robot.preset": "ur10_friction", "robot.motors": LINES},
            is_identified=False,
        ),
    ),
    "panda/between_shelves": (
        Case("no motors", {}),
        Case("fr3_friction", {"robot.preset": "fr3_friction"}),
    ),
    "panda/between_shelves ": (
        Case("limits of fr3, no rotors", {"robot.preset": "fr3", "robot.motors.armature": 0.0}),
        Case("fr3", {"robot.preset": "fr3"}),
        Case("fr3, fr3_friction", {"robot.preset": ["fr3", "fr3_friction"]}),
    ),
}


def main() -> int:
    """Print the table; return 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slack", type=float, default=0.005)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--plot", type=Path, help="picture of efforts over velocities")
    options = parser.parse_args()
    heading = f"{'':38}{'duration':>10}{'ratio':>8}{'asked without':>15}{'CPU':>7}  binds"
    print(heading)
    faults = []
    for problem, cases in CASES.items():
        faults += _compared(problem.strip(), cases, options.slack, options.repeats)
    if options.plot:
        name = "ur10/onto_a_conveyor"
        _draw(name, CASES[name][-1], options.plot)
    print("\n".join(faults) or "all goals are met")
    return int(bool(faults))


def _compared(name: str, cases: tuple[Case, ...], slack: float, repeats: int) -> list[str]:
    """Print the rows of one problem; return what misses a goal."""
    problems = [load_problem(f"example:{name}", changes=case.changes) for case in cases]
    results: list[PlanResult] = []
    least = [float("inf")] * len(cases)
    for _ in range(repeats):
        results = []
        for k, problem in enumerate(problems):
            _ = problem.collision
            begun = time.process_time()
            results.append(plan(problem, PlanOptions(slack=slack)))
            least[k] = min(least[k], time.process_time() - begun)
    print(name)
    faults = []
    for case, problem, result, cpu in zip(cases, problems, results, least, strict=True):
        if result.trajectory is None or not result.succeeded:
            print(f"  {case.name:36}{result.message}")
            faults.append(f"{name}, {case.name}: {result.message}")
            continue
        first = results[0].trajectory
        share = result.trajectory.duration / first.duration if first else float("nan")
        asked = _asked(verify(problem, first).conditions) if first else ""
        ratio = cpu / least[0]
        print(
            f"  {case.name:36}{result.trajectory.duration:8.4f} s{share:8.3f}{asked:>15}"
            f"{ratio:7.2f}  {_binding(result)}"
        )
        if case.is_identified and ratio > MAX_CPU:
            faults.append(f"{name}, {case.name}: {ratio:.2f} times the processor time")
    return faults


def _asked(conditions: Mapping[str, Any]) -> str:
    """Return the most that a motion uses of a motor."""
    known = [conditions[name] for name in ("effort", "motor_curve")]
    worst = min((one for one in known if one.margin is not None), key=lambda one: one.margin)
    return f"{1 - worst.margin:.1%} {str(worst.where.joint)[-6:]}"


def _binding(result: PlanResult) -> str:
    """Return the limit whose rise saves most."""
    saving = max(result.sensitivities, key=lambda one: one.saved, default=None)
    return "" if saving is None else str(saving)


def _draw(name: str, case: Case, path: Path) -> None:
    """Draw the efforts of a problem's motion over velocities."""
    problem = load_problem(f"example:{name}", changes=case.changes)
    trajectory = plan(problem).trajectory
    assert trajectory is not None
    figure = new_figure(8.5, 5.0)
    curves = trajectory_curves(problem, trajectory)
    draw_motors(figure, curves, motor_joints(problem.robot), columns=3)
    saved(figure, path)


if __name__ == "__main__":
    sys.exit(main())
