"""Beads, seams and rasters at a constant tool speed: by the upper limit alone, and in a band.

    python benchmarks/band_table.py [--only SUBSTRING]

Prints a table of UR arms whose tool points down, in a cone of 0.1 rad and with a free spin. A row
is a tube of one radius: its duration by the upper limit alone, the fraction of the stretch in the
band and the least deviation there, then the duration in the band, its least deviation, its
processor time, and that as a multiple of the processor time by the upper limit alone.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    Seed,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.arrays import FloatArray

CORNERS = {"ur5": (0.35, -0.1, 0.25), "ur10": (0.6, -0.2, 0.3)}  # where stretches begin [m]
LEG, RUN = 0.2, 0.03  # of beads, and of the straight ways before and after them [m]
LINES, LINE, APART = 10, 0.3, 0.02  # of the raster [m]
TOLERANCE = 0.05
OPTIONS = PlanOptions(slack=0)
LOOKS = 100_001


@dataclass(frozen=True)
class Row:
    """A stretch of an arm."""

    arm: str
    shape: str  # seam, L, U, ellipse or raster
    radius: float  # of the tube [m]
    speed: float = 0.25  # [m/s]
    acceleration: float = np.inf  # limit of all joints [rad/s^2]

    @property
    def name(self) -> str:
        """What the row is called."""
        limit = f", {self.acceleration:g} rad/s^2" if np.isfinite(self.acceleration) else ""
        return f"{self.arm} {self.shape} {1000 * self.radius:g} mm, {self.speed:g} m/s{limit}"

    @property
    def points(self) -> FloatArray:
        """The points of the stretch, shape (k, 3) [m]."""
        shapes = {
            "seam": [[0, 0, 0], [0, 2 * LEG, 0]],
            "L": [[0, 0, 0], [LEG, 0, 0], [LEG, LEG, 0]],
            "U": [[0, 0, 0], [LEG, 0, 0], [LEG, LEG, 0], [0, LEG, 0]],
        }
        if self.shape == "ellipse":
            angle = np.linspace(0, 2 * np.pi, 151)
            points = np.stack([0.12 * np.cos(angle), 0.08 * np.sin(angle), 0 * angle], axis=1)
            points += [0.1, 0.1, 0]
        elif self.shape == "raster":
            x = APART * np.repeat(np.arange(LINES), 2)
            y = LINE * (np.arange(1, 2 * LINES + 1) // 2 % 2)
            points = np.stack([x, y, 0 * x], axis=1)
        else:
            points = np.array(shapes[self.shape])
        return np.asarray(points + CORNERS[self.arm])

    def problem(self, *, with_band: bool) -> PlanningProblem:
        """Return the problem; without a band, the speed is an upper limit."""
        stretch = self.points
        before, after = stretch[0] - stretch[1], stretch[-1] - stretch[-2]
        ends = [
            end + RUN * way / np.linalg.norm(way)
            for end, way in ((stretch[0], before), (stretch[-1], after))
        ]
        points = np.vstack([ends[0], stretch, ends[1]])
        count = len(points) - 1
        speed = {"speed": self.speed, "tolerance": TOLERANCE} if with_band else self.speed
        is_free = np.zeros(count, dtype=bool)
        is_free[[0, -1]] = True
        if self.shape == "raster":
            is_free[::2] = True
        tube = Tube(
            points,
            self.radius,
            tool_speed=[None if free else speed for free in is_free],
            orientations=np.tile([1.0, 0.0, 0.0, 0.0], (count + 1, 1)),
            rotation_tolerance=[[0.1, 0.1, np.inf]] * count,
        )
        robot = load_robot(
            f"example:{self.arm}", "tool0", limits=LimitOverrides(acceleration=self.acceleration)
        )
        return PlanningProblem(robot, tube, Seed([-0.77, -1.29, 1.83, -2.1, -1.57, 0.0]))


@dataclass(frozen=True)
class Outcome:
    """A planned motion, or why there is none."""

    result: PlanResult
    processor_time: float  # [s]
    in_band: float  # fraction of the stretch's way at a speed within the band
    least: float  # least deviation from the speed, as a fraction of it

    @classmethod
    def of(cls, row: Row, *, with_band: bool) -> "Outcome":
        """Plan a row and look at the speeds of its stretches."""
        problem = row.problem(with_band=with_band)
        began = time.process_time()
        result = plan(problem, OPTIONS)
        took = time.process_time() - began
        if result.trajectory is None:
            return cls(result, took, np.nan, np.nan)
        t = np.linspace(0, result.trajectory.duration, LOOKS)
        q, v = result.trajectory.position(t), result.trajectory.velocity(t)
        tool = problem.robot.tool_position(q)
        speed = np.linalg.norm(problem.robot.tool_velocity(q, v)[0], axis=1)
        is_on = np.zeros(LOOKS, dtype=bool)
        for part in stretch_ranges(row.problem(with_band=True).tube, tool):
            is_on[part] = True
        slow = speed < (1 - TOLERANCE) * row.speed * (1 - 1e-6)
        way = speed * is_on
        in_band = float((way * ~slow).sum() / way.sum())
        return cls(result, took, in_band, float(speed[is_on].min() / row.speed - 1))


def stretch_ranges(tube: Tube, tool: FloatArray) -> Iterator[slice]:
    """Yield the samples of each stretch, between the planes through its ends, in order."""
    at = 0
    for stretch, (enter, leave) in zip(
        tube.stretches, zip(tube.gates[::2], tube.gates[1::2], strict=True), strict=True
    ):
        inside = tube.margin(tool, slice(stretch.first, stretch.last + 1)).max(axis=1) > -1e-9
        ahead = np.flatnonzero(inside & (enter.margin(tube, tool) <= 0))
        first = int(ahead[ahead >= at][0])
        # A closed stretch begins beyond its last plane: its last segment counts.
        last = tube.margin(tool, slice(stretch.last, stretch.last + 1))[:, 0] > -1e-9
        in_last = np.flatnonzero(last & (leave.margin(tube, tool) <= 0))
        in_last = in_last[in_last >= first]
        breaks = np.flatnonzero(np.diff(in_last) > 1)
        ends = np.append(in_last[breaks], in_last[-1])
        at = int(ends[-1] if len(tube.stretches) == 1 else ends[0])
        yield slice(first, at + 1)


ROWS = [
    *(Row(arm, "seam", 0.001, speed) for arm in ("ur5", "ur10") for speed in (0.1, 0.25)),
    *(Row("ur5", shape, radius) for shape in "LU" for radius in (0.001, 0.002, 0.005)),
    *(Row("ur10", shape, radius) for shape in "LU" for radius in (0.001, 0.002, 0.005)),
    *(Row(arm, "ellipse", 0.001, 0.15) for arm in ("ur5", "ur10")),
    Row("ur5", "L", 0.001, 0.25, 5.0),
    Row("ur5", "L", 0.001, 0.15, 5.0),
    Row("ur5", "L", 0.005, 0.25, 5.0),
    Row("ur5", "U", 0.002, 0.25, 5.0),
    Row("ur5", "U", 0.005, 0.25, 5.0),
    Row("ur5", "ellipse", 0.001, 0.15, 5.0),
    Row("ur5", "raster", 0.001),
    Row("ur5", "raster", 0.001, 0.25, 5.0),
]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--only", default="", help="rows whose names contain this")
    only = parser.parse_args().only
    print("| stretch | upper limit alone [s] | in band | least | band [s] | least | cpu |")
    print("|---|---|---|---|---|---|---|")
    for row in ROWS:
        if only not in row.name:
            continue
        alone, band = (Outcome.of(row, with_band=with_band) for with_band in (False, True))
        cells = [row.name]
        cells += [_seconds(alone), f"{100 * alone.in_band:.1f} %", f"{100 * alone.least:.1f} %"]
        cells += [_seconds(band), f"{100 * band.least:.1f} %"]
        cells += [f"{band.processor_time:.1f} s, {band.processor_time / alone.processor_time:.2f}"]
        print("| " + " | ".join(cells) + " |", flush=True)


def _seconds(outcome: Outcome) -> str:
    duration = outcome.result.duration
    return outcome.result.message if duration is None else f"{duration:.3f}"


if __name__ == "__main__":
    main()
