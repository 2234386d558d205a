"""What friction, rotors and torque-speed lines do to shortest motions, and to planning times.

    python benchmarks/motors.py [--repeats 3] [--plot docs/motor_curves.png]

Plans bundled problems without and with motors, in turn, and prints of each the duration, the
processor time (of repeated plans the least), and which limits are the dearest. Torque-speed lines
are made up: stall efforts and no-load velocities near those of the limits. --plot draws the efforts
of the last problem over velocities, inside what the motors have.
"""

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.motor_panels import draw_motors, motor_joints
from tubeplanner.views.panels import trajectory_curves

_LINES = {
    "robot.motors.saturation_effort": [400, 400, 200, 80, 80, 80],
    "robot.motors.no_load_velocity": [4, 4, 6, 6, 6, 6],
}
_UR10, _PANDA = "ur10/onto_a_conveyor", "panda/between_shelves"
# By problem: what it has without motors, and what comes on top.
CASES: tuple[tuple[str, Mapping[str, Any], Mapping[str, Any]], ...] = (
    (_PANDA, {"robot.preset": "fr3"}, {"robot.preset": ["fr3", "fr3_friction"]}),
    (_UR10, {}, {"robot.preset": "ur10_friction"}),
    (_UR10, {}, {"robot.preset": "ur10_friction", **_LINES}),
)
_SHORTEST = PlanOptions(slack=0.0)
_DEAREST = 3


def timed(problem: PlanningProblem) -> tuple[PlanResult, float]:
    """Return the shortest motion and the processor time of planning it [s]."""
    begin = time.process_time()
    result = plan(problem, _SHORTEST)
    return result, time.process_time() - begin


def _print_rows(name: str, changes: tuple[Mapping[str, Any], ...], repeats: int) -> None:
    """Print what a problem takes with each of some changes, planned in turn."""
    problems = [load_problem(f"example:{name}", changes=dict(change)) for change in changes]
    rounds = [[timed(problem) for problem in problems] for _ in range(repeats)]
    for change, plans in zip(changes, zip(*rounds, strict=True), strict=True):
        result, spent = plans[0][0], min(cpu for _, cpu in plans)
        dearest = "; ".join(str(each) for each in result.sensitivities[:_DEAREST])
        duration = "no trajectory" if result.duration is None else f"{result.duration:.4f} s"
        fields = ", ".join(f"{path}={value}" for path, value in change.items()) or "ideal motors"
        print(f"{name:24} {duration}  CPU {spent:6.2f} s  {fields}\n{'':24} {dearest}", flush=True)


def draw(name: str, changes: Mapping[str, Any], path: Path) -> None:
    """Draw the efforts of a problem's motion over velocities."""
    problem = load_problem(f"example:{name}", changes=dict(changes))
    trajectory = plan(problem).trajectory
    assert trajectory is not None
    figure = new_figure(8.5, 5.0)
    curves = trajectory_curves(problem, trajectory)
    draw_motors(figure, curves, motor_joints(problem.robot), columns=3)
    saved(figure, path)


def main() -> int:
    """Plan and print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=1, help="plans of every problem")
    parser.add_argument("--plot", type=Path, help="picture of efforts over velocities")
    asked = parser.parse_args()
    for name, without, motors in CASES:
        _print_rows(name, (without, motors), asked.repeats)
    if asked.plot:
        name, _, motors = CASES[-1]
        draw(name, motors, asked.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
