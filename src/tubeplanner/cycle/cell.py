"""The cell around the arm, as steps of a cycle change it."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.handed_over import left, taken
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.cycle.leg import RestStep
from tubeplanner.cycle.steps import Attach, Detach
from tubeplanner.robot.robot_model import RobotModel

# Links nearer than this [m] to what is attached touch it.
_TOUCHING = 1e-3


@dataclass(frozen=True, eq=False)
class Cell:
    """What stands in the cell and what the tool carries.

    Attributes:
        obstacles: Solids in the base frame.
        attached: Solids in the tool frame.
        handed_over: Names of what was taken or let go since the arm moved last.
    """

    obstacles: tuple[Obstacle, ...]
    attached: tuple[AttachedSolid, ...]
    handed_over: tuple[str, ...] = ()

    def after(self, step: RestStep, robot: RobotModel, q: FloatArray) -> "Cell":
        """Return the cell after a step.

        Args:
            step: What happens.
            robot: The arm.
            q: The configuration in which it is at rest, shape (n,).
        """
        if isinstance(step, Attach):
            return self._with(step, robot, q)
        if isinstance(step, Detach):
            return self._without(step, robot, q)
        return self

    def _with(self, step: Attach, robot: RobotModel, q: FloatArray) -> "Cell":
        solid, standing = step.solid, self.obstacles
        for obstacle in self.obstacles:
            if obstacle.name == step.name:
                solid = taken(obstacle, _hand_pose(robot, q))
                standing = tuple(each for each in standing if each is not obstacle)
        if solid is None:
            return self
        solid = replace(solid, touch_links=_touching(solid, robot, q))
        handed_over = (*self.handed_over, step.name)
        return Cell(standing, (*self.attached, solid), handed_over)

    def _without(self, step: Detach, robot: RobotModel, q: FloatArray) -> "Cell":
        gone = [solid for solid in self.attached if solid.name == step.name]
        kept = tuple(solid for solid in self.attached if solid not in gone)
        if not gone or not step.leaves_obstacle:
            return replace(self, attached=kept)
        stands = left(gone[0], _hand_pose(robot, q))
        return Cell((*self.obstacles, stands), kept, (*self.handed_over, step.name))


def _hand_pose(robot: RobotModel, q: FloatArray) -> FloatArray:
    """Return the pose of the tool frame, base frame, shape (4, 4)."""
    rotation, position = robot.body_poses(q[None])
    body = robot.link_body[robot.tool_frame]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation[0, body], position[0, body]
    return pose @ robot.link_placement[robot.tool_frame]


def _touching(solid: AttachedSolid, robot: RobotModel, q: FloatArray) -> tuple[str, ...]:
    """Return the links that something attached may touch: those it does, and what is given."""
    checker = CollisionChecker(robot, attached=[solid])
    owners = np.array([shape.owner for shape in checker.shapes])[checker.pairs].reshape(-1, 2)
    own = (owners == solid.name).any(axis=1)
    rotation, position = robot.body_poses(q[None])
    near = checker.distances(rotation[0], position[0], checker.pairs[own]) < _TOUCHING
    names = owners[own][near].ravel()
    return tuple(dict.fromkeys([*solid.touch_links, *(n for n in names if n != solid.name)]))
