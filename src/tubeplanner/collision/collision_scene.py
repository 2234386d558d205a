"""What may collide, and the checker that is built from it on first use."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.robot.robot_model import RobotModel


@dataclass(frozen=True, eq=False)
class CollisionScene:
    """An arm, what it carries and what stands around it.

    Attributes:
        robot: The arm.
        obstacles: Solids in the base frame.
        attached: Solids in the tool frame; they count as links.
        self_collision: Whether links are checked against each other.
        ignore: Pairs of names of links or obstacles that may touch.
    """

    robot: RobotModel
    obstacles: tuple[Obstacle, ...]
    attached: tuple[AttachedSolid, ...]
    self_collision: bool
    ignore: tuple[tuple[str, str], ...]

    @cached_property
    def checker(self) -> CollisionChecker:
        """The shapes and their pairs, ready to be checked; raises as `CollisionChecker` does."""
        return CollisionChecker(
            self.robot,
            self.obstacles,
            attached=self.attached,
            self_collision=self.self_collision,
            ignore=self.ignore,
        )

    def __getstate__(self) -> dict[str, Any]:
        _ = self.checker  # built from files now: where the pickle goes, there may be none
        return dict(vars(self))

    def is_as(self, other: "CollisionScene") -> bool:
        """Return whether another scene is made of the same objects, the arm with any limits."""
        others = (f.name for f in fields(self) if f.name != "robot")
        same = all(getattr(self, name) is getattr(other, name) for name in others)
        return same and self.robot.moves_as(other.robot)
