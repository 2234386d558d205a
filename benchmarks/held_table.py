"""What does it cost to hold a part, and what do other ways of holding it cost?

    python benchmarks/held_table.py [--only SUBSTRING] [--quick]

Nine problems of three arms with a part on a tray or under a cup, and a tray that may tilt. Each is
planned without a contact, slowed down until the contact holds, run on the fixed path by the least
time under the same cones (arcs, stops), planned with the highest `tool_acceleration` at which it
holds, and planned with the contact, at safety 1 and at the contact's usual safety. All durations
are certified, but those of fixed paths, whose accelerations jump. `--quick` leaves out the fixed
paths and the limit on acceleration.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from shared import figure
from tubeplanner import PlanningProblem, PlanOptions, load_problem, plan
from tubeplanner.certificate.verification import verify
from tubeplanner.first_guess.baselines import judged_baseline
from tubeplanner.limits.speed_limits import minimum_duration
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import ContactKind, Cup, Holding, Liquid, Tray

SHORTEST = PlanOptions(slack=0.0)
# The level tray's tube with a tool that points down; what stands on it is above.
LEVEL, LEVEL_TILT = "ur5/level_tray", 0.0524
UP = (0.0, 0.0, -1.0)
_ENDS = ((-0.3, 0.2), (-0.3, 0.525), (0.3, 0.525), (0.3, 0.2))
DOWN = {
    "tube.points": [[0.45, y, z] for y, z in _ENDS],
    "tube.orientations": [[0.7071068, -0.7071068, 0.0, 0.0]] * 4,
    "start.joints": [-0.791217, -1.311999, 1.900383, -2.159181, -1.570796, 0.0],
}
CUPS = ("ur5/over_the_wall", "ur10/onto_a_conveyor", "panda/between_shelves")
TILTS = (0.2, 3.0, 5.0, 15.0, 30.0)  # [deg]
SAMPLES = 2000
HALVINGS = 6  # of the range of accelerations


@dataclass(frozen=True)
class Case:
    """A problem without its contact, and the contact with safety 1 and with the usual one."""

    name: str
    free: PlanningProblem
    contacts: tuple[ContactKind, ContactKind]
    part: Payload | None

    def held(self, which: int) -> PlanningProblem:
        """Return the problem with the contact at safety 1 (0) or the usual one (1)."""
        return replace(self.free, holding=(Holding(self.contacts[which], self.part),))


def cases() -> Iterator[Case]:
    """Yield the cases, level trays first, then cups, then tilting trays."""
    yield from (tilted("level", LEVEL_TILT, kind) for kind in ("tray 0.3", "tray 0.5", "liquid"))
    for name in CUPS:
        for mass in (0.5, 1.0):
            part = Payload(mass, (0.0, 0.0, 0.03))
            problem = load_problem(f"example:{name}")
            problem = replace(problem, robot=problem.robot.with_payload(part))
            cups = tuple(Cup(42.4, 0.015, 0.5, safety=safety) for safety in (1.0, 1.5))
            yield Case(f"{name}, cup {mass:g} kg", problem, cups, part)
    for tilt in TILTS:
        for kind in ("tray 0.3", "tray 0.5", "liquid"):
            yield tilted(f"tilt {tilt:g} deg", np.radians(tilt), kind)


def tilted(label: str, tilt: float, kind: str) -> Case:
    """Return the level tray's problem with a tilt [rad] about x and y, and a contact."""
    bounds = {"tube.rotation_tolerance": [[float(tilt), float(tilt), float("inf")]] * 3}
    problem = load_problem(f"example:{LEVEL}", changes=DOWN | bounds)
    if kind == "liquid":
        surface = Liquid(np.radians(15.0), normal=UP)
        return Case(f"{label}, {kind}", problem, (surface, surface), None)
    friction = float(kind.split()[1])
    trays = tuple(Tray(friction, (0.04, 0.04), safety=safety, normal=UP) for safety in (1.0, 1.2))
    return Case(f"{label}, {kind}", problem, trays, Payload(1.0, (0.0, 0.0, -0.05)))


def planned(problem: PlanningProblem) -> tuple[float | None, float]:
    """Return duration and processor time [s] of the shortest plan."""
    begin = time.process_time()
    result = plan(problem, SHORTEST)
    return result.duration if result.succeeded else None, time.process_time() - begin


def lost_share(held: PlanningProblem, motion) -> float:  # noqa: ANN001
    """Return the share of a motion's time at which its part is lost."""
    from tubeplanner.limits.holding_limit import HoldingLimit
    from tubeplanner.limits.path_samples import PathSamples

    at = motion.at((np.arange(SAMPLES) + 0.5) / SAMPLES * motion.duration)
    path = PathSamples(held, np.stack([at.position, at.velocity, at.acceleration]))
    limit = HoldingLimit(held)
    return float((limit.used(path).largest_speed(limit.signs).min(axis=1) < 1).mean())


def slowed(held: PlanningProblem, motion) -> float | None:  # noqa: ANN001
    """Return the duration of a motion, slowed down until its part is held; None: never."""
    try:
        return minimum_duration(held, motion)
    except Infeasible:
        return None


def fixed(held: PlanningProblem, name: str) -> float | None:
    """Return the least time of a fixed path under the same cones."""
    try:
        return judged_baseline(held, name)[0].trajectory.duration
    except Infeasible:
        return None


def capped(case: Case) -> tuple[float | None, float]:
    """Return the duration under the largest limit of acceleration that holds, and it [m/s^2]."""
    low, high, best = 0.5, 60.0, None
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        limits = replace(case.free.robot.limits, tool_acceleration=middle)
        robot = case.free.robot.with_limits(limits, case.free.robot.motors)
        result = plan(replace(case.free, robot=robot), SHORTEST)
        holds = result.succeeded and verify(case.held(0), result.trajectory).passed
        low, high = (middle, high) if holds else (low, middle)
        best = result.duration if holds else best
    return best, low


def main() -> None:
    """Print a row for every case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="cases whose names contain this")
    parser.add_argument("--quick", action="store_true", help="no fixed paths, no acceleration")
    options = parser.parse_args()
    print("| problem | lost | without | slowed | arcs / stops | cap | S = 1 | usual | CPU |")
    print("|---|---|---|---|---|---|---|---|---|")
    for case in cases():
        if options.only not in case.name:
            continue
        begin = time.process_time()
        free = plan(case.free, SHORTEST)
        seconds = time.process_time() - begin
        held = case.held(0)
        (tight, tight_seconds), (usual, _) = planned(held), planned(case.held(1))
        lost, slow = 0.0, None
        arcs = stops = cap = most = None
        if free.trajectory is not None:
            lost, slow = lost_share(held, free.trajectory), slowed(held, free.trajectory)
        if not options.quick:
            arcs, stops = fixed(held, "arc-corners"), fixed(held, "bang-bang")
            cap, most = capped(case)
        cells = (
            case.name,
            f"{100 * lost:.0f} %",
            figure(free.duration, 3),
            figure(slow, 3),
            f"{figure(arcs, 3)} / {figure(stops, 3)}",
            f"{figure(cap, 3)} ({figure(most, 1)})",
            figure(tight, 3),
            figure(usual, 3),
            f"{seconds:.2f} -> {tight_seconds:.2f}",
        )
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
