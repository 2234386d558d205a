"""Solids that change hands: taken from the cell by the tool, and left there."""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.collision.solid_contents import SolidContents


def taken(obstacle: Obstacle, tool_frame: FloatArray) -> AttachedSolid:
    """Return an obstacle as it is carried by a tool that takes it where it is.

    Args:
        obstacle: In the base frame.
        tool_frame: Pose of the tool frame at that instant, base frame, shape (4, 4).
    """
    shapes, contents = _moved(obstacle, np.array(np.linalg.inv(tool_frame), dtype=float))
    return AttachedSolid(obstacle.name, shapes, contents=contents)


def left(solid: AttachedSolid, tool_frame: FloatArray) -> Obstacle:
    """Return what a tool carried as it stands where the tool lets it go; arguments as `taken`."""
    shapes, contents = _moved(solid, tool_frame)
    return Obstacle(solid.name, shapes, contents)


def _moved(
    solid: Obstacle | AttachedSolid, placement: FloatArray
) -> tuple[tuple[ConvexShape, ...], SolidContents | None]:
    shapes = tuple(shape.transformed(placement) for shape in solid.shapes)
    contents = solid.contents
    if contents is not None:
        contents = replace(contents, placement=read_only(placement @ contents.placement))
    return shapes, contents
