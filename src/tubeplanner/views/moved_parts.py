"""Parts of a cycle over time: they stand, move with the tool, and stand where it put them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Attach, Detach
from tubeplanner.trajectory.marks import Mark
from tubeplanner.views.surface import Surface, joined, shape_surface


@dataclass(frozen=True, eq=False)
class MovedPart:
    """Something that the tool takes or lets go, at T times.

    Attributes:
        name: What it is called; parts that follow each other may share a name.
        surface: In its own frame.
        poses: Of its frame, base frame, shape (T, 4, 4).
        present: Whether it is there, shape (T,).
    """

    name: str
    surface: Surface
    poses: FloatArray
    present: BoolArray

    def carry(self, first: int, tool: FloatArray) -> None:
        """Let it move with the tool frame, shape (T, 4, 4), from a time's index on."""
        grip = np.linalg.solve(tool[first], self.poses[first])
        self.poses[first:] = tool[first:] @ grip

    def seen_at(self, step: int) -> FloatArray:
        """Return its points at one of the times, base frame, shape (V, 3) [m]; none if absent."""
        return self.surface.moved(self.poses[step]).vertices[: None if self.present[step] else 0]

    def put_down(self, first: int, *, stays: bool) -> None:
        """Let it stand where it is from a time's index on, or be gone."""
        self.poses[first:] = self.poses[first]
        self.present[first:] = stays


def moved_parts(
    cycle: Cycle, marks: Sequence[Mark], time: FloatArray, tool: FloatArray
) -> list[MovedPart]:
    """Return the parts that a cycle's steps hand over.

    Args:
        cycle: The cycle.
        marks: When its steps begin; none: nothing is handed over yet.
        time: Shape (T,), the times of all marks among them [s].
        tool: Pose of the tool frame at these times, base frame, shape (T, 4, 4).
    """
    handed_over = {step.name for step in cycle.steps if isinstance(step, Attach)}
    found = [
        _part(obstacle.name, obstacle.shapes, len(time))
        for obstacle in cycle.obstacles
        if obstacle.name in handed_over
    ]
    present = {part.name: part for part in found}
    for step, mark in zip(cycle.steps, marks, strict=False):
        first = int(np.searchsorted(time, mark.time))
        if isinstance(step, Attach):
            if step.name not in present and step.solid is not None:
                present[step.name] = _new_part(step.name, step.solid.shapes, first, tool)
                found.append(present[step.name])
            if step.name in present:
                present[step.name].carry(first, tool)
        elif isinstance(step, Detach) and step.name in present:
            present[step.name].put_down(first, stays=step.leaves_obstacle)
            if not step.leaves_obstacle:
                del present[step.name]
    return found


def _part(name: str, shapes: Sequence[ConvexShape], count: int) -> MovedPart:
    """Return a part that stands still at so many times."""
    surface = joined(shape_surface(shape) for shape in shapes)
    return MovedPart(name, surface, np.tile(np.eye(4), (count, 1, 1)), np.ones(count, bool))


def _new_part(name: str, shapes: Sequence[ConvexShape], first: int, tool: FloatArray) -> MovedPart:
    """Return a part in the tool frame that was not there before."""
    part = _part(name, shapes, len(tool))
    part.poses[:] = tool[first]
    part.present[:first] = False
    return part
