"""How closely the links of a robot are covered."""

from dataclasses import dataclass

from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.link_geometry import link_parts


@dataclass(frozen=True)
class LinkCover:
    """How closely a link is covered.

    Attributes:
        link: Its name.
        shapes: Number of its convex shapes.
        outer_error: The largest distance found from their surface to the link as it is [m].
        closer_shapes: Number of the shapes for the links that come near it; 0 if it has none.
        closer_error: Likewise, of these, where the other links come near; None without any [m].
    """

    link: str
    shapes: int
    outer_error: float
    closer_shapes: int
    closer_error: float | None


def link_covers(checker: CollisionChecker) -> list[LinkCover]:
    """Return how closely every link that has collision geometry is covered.

    Meshes are measured when that is first asked for; the cache keeps the distances.

    Raises:
        RobotError: A mesh is missing or unreadable.
    """
    found = []
    for link, parts in link_parts(checker.robot).items():
        closer = checker.closer_covers.get(link)
        found.append(
            LinkCover(
                link,
                sum(len(part.cover()) for part in parts),
                max(part.outer_error() for part in parts),
                0 if closer is None else len(closer.shapes),
                None if closer is None else closer.outer_error,
            )
        )
    return found
