"""CollisionChecker: pairs of links and obstacles, distances, cover errors of links."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, IntArray
from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes
from tubeplanner.geometry.convex_shapes import ConvexShape, extent_of
from tubeplanner.geometry.fine_covers import Cover
from tubeplanner.geometry.link_geometry import LinkPart, link_contents, link_parts
from tubeplanner.geometry.link_pairs import judged_pairs
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, open_meshes
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent

_BASE = 0
# Reasons to leave pairs out.
NEIGHBOURS, ALWAYS_TOUCHING, IGNORED = "neighbours", "always touching", "ignored"


@dataclass(frozen=True)
class LeftOutPair:
    """Two solids that are not checked against each other.

    Attributes:
        links: Their names.
        reason: "neighbours" (a joint connects them), "always touching" (the solids, in all sampled
            configurations) or "ignored" (by the problem, the SRDF or an attached solid).
    """

    links: tuple[str, str]
    reason: str


class CollisionChecker(BodyShapes):
    """The pairs of shapes that must stay apart, and their distances.

    Several threads may use one checker; it pickles by content, without any file.

    Left out are links that no joint moves against obstacles and each other, links on the same or on
    neighbouring bodies, link pairs that always touch, and the pairs that the problem ignores. Pairs
    of links whose usual covers overlap where the links do not are judged by closer covers.

    Attributes:
        robot: The arm.
        shapes: All shapes: links first, closer covers of some links last.
        obstacle_pairs: Link against obstacle, as indices of `shapes`: int, shape (P, 2).
        link_pairs: Link against link, likewise.
        pairs: All pairs, with obstacles first.
        left_out: Solids that joints move against each other and that are not checked, and why.
        closer_covers: By link name, of links that others come near, in the frame of the body; of
            links that no joint moves, in the root link's.
        has_link_geometry: Whether the robot itself has any collision geometry.
        link_contents: By link name, the source of the links' collision geometry.
        open_meshes: Open meshes of links, obstacles and attached solids, see `open_meshes`.
    """

    def __init__(
        self,
        robot: RobotModel,
        obstacles: Sequence[Obstacle] = (),
        *,
        attached: Sequence[AttachedSolid] = (),
        self_collision: bool = True,
        ignore: Sequence[tuple[str, str]] = (),
    ) -> None:
        """Build the geometry.

        Args:
            robot: The arm.
            obstacles: Solids in the base frame.
            attached: Solids in the tool frame; they count as links.
            self_collision: Whether links are checked against each other.
            ignore: Pairs of names of links or obstacles that may touch.

        Raises:
            ProblemError: Two solids or a solid and a link have one name, or an ignored name does
                not exist.
            RobotError: A link's geometry cannot be read.
        """
        alone = robot.in_root_frame()  # its results hold for every base pose
        parts = link_parts(alone)
        covers = {
            link: [shape for part in own for shape in part.cover()] for link, own in parts.items()
        }
        self.has_link_geometry = bool(covers)
        self.link_contents = link_contents(robot)
        self.open_meshes = open_meshes(self.link_contents, [*obstacles, *attached])
        touching = [(solid.name, link) for solid in attached for link in solid.touch_links]
        _require_names(robot, obstacles, attached, [*ignore, *touching])
        self._obstacle_names = {obstacle.name for obstacle in obstacles}
        self._attached_names = {solid.name for solid in attached}
        self._ignored = {frozenset(pair) for pair in (*ignore, *touching)}
        links = _link_shapes(robot, covers)
        body = robot.link_body[robot.tool_frame]
        placement = robot.link_placement[robot.tool_frame]
        carried = [
            BodyShape(solid.name, body, shape.transformed(placement))
            for solid in attached
            for shape in solid.shapes
        ]
        standing = [
            BodyShape(obstacle.name, _BASE, shape)
            for obstacle in obstacles
            for shape in obstacle.shapes
        ]
        super().__init__(robot, [*links, *carried, *standing])
        moving, fixed = range(len(links + carried)), range(len(links + carried), len(self.shapes))
        self.obstacle_pairs = self._select((i, j) for i in moving for j in fixed)
        self.link_pairs = _as_pairs([])
        self.closer_covers: Mapping[str, Cover] = {}
        always_touching: Sequence[tuple[str, str]] = ()
        if self_collision:
            candidates = self._select(combinations(moving, 2))
            always_touching = self._judge_links(alone, parts, covers, candidates)
        self.pairs = np.concatenate([self.obstacle_pairs, self.link_pairs])
        self.left_out = self._left_out(always_touching, self_collision)

    def __repr__(self) -> str:
        return (
            f"<CollisionChecker of {self.robot.name}: {len(self.shapes)} shapes, "
            f"{len(self.obstacle_pairs)} pairs with obstacles, {len(self.link_pairs)} of links>"
        )

    @cached_property
    def extents(self) -> dict[str, Extent]:
        """Extents of all links and solids, by label."""
        shapes: dict[str, list[BodyShape]] = {}
        for shape in self.shapes:
            kind = "attached solid" if shape.owner in self._attached_names else "link"
            kind = "obstacle" if shape.owner in self._obstacle_names else kind
            shapes.setdefault(f"{kind} '{shape.owner}'", []).append(shape)
        return {
            label: Extent(own[0].body, extent_of(each.shape for each in own))
            for label, own in shapes.items()
        }

    def between(self, first: str, second: str) -> BoolArray:
        """Return True for the `pairs` of two links or obstacles, by name: shape (P,)."""
        owner = np.array([shape.owner for shape in self.shapes])
        one, other = owner[self.pairs].reshape(-1, 2).T
        return ((one == first) & (other == second)) | ((one == second) & (other == first))

    def owners(self, pair: IntArray | tuple[int, int]) -> tuple[tuple[str, ...], str | None]:
        """Return the links of a pair, and its obstacle or None."""
        names = [self.shapes[index].owner for index in pair]
        links = tuple(name for name in names if name not in self._obstacle_names)
        obstacles = [name for name in names if name in self._obstacle_names]
        return links, obstacles[0] if obstacles else None

    def _select(self, pairs: Iterator[tuple[int, int]]) -> IntArray:
        """Return the pairs (P, 2) that must stay apart, before covers of links are judged."""
        solids = self._obstacle_names | self._attached_names
        moves, result = self.robot.carries, []
        for i, j in pairs:
            first, second = self.shapes[i], self.shapes[j]
            owners = frozenset((first.owner, second.owner))
            joints = int((moves[first.body] != moves[second.body]).sum())
            # Neighbouring links meet at their joint; nothing else may touch.
            if owners not in self._ignored and joints > (0 if owners & solids else 1):
                result.append((i, j))
        return _as_pairs(result)

    def _judge_links(
        self,
        alone: RobotModel,
        parts: Mapping[str, Sequence[LinkPart]],
        covers: Mapping[str, Sequence[ConvexShape]],
        candidates: IntArray,
    ) -> Sequence[tuple[str, str]]:
        """Set the pairs of links that are checked, and return the pairs that always touch.

        Attached solids stay checked: only their touch_links may touch them.
        """
        owners = [(self.shapes[i].owner, self.shapes[j].owner) for i, j in candidates]
        pairs = [pair for pair in dict.fromkeys(owners) if not {*pair} & self._attached_names]
        judged = judged_pairs(alone, parts, covers, pairs)
        without = {*judged.always_touching, *judged.refined}
        fine = _link_shapes(self.robot, {link: cover.shapes for link, cover in judged.fine.items()})
        self.closer_covers = judged.fine
        first = len(self.shapes)
        indices = {
            link: [first + k for k, shape in enumerate(fine) if shape.owner == link]
            for link in judged.fine
        }
        self._add(fine)
        usual = candidates[[pair not in without for pair in owners]]
        closer = [(i, j) for a, b in judged.refined for i in indices[a] for j in indices[b]]
        self.link_pairs = np.concatenate([usual, _as_pairs(closer)])
        return judged.always_touching

    def _left_out(
        self, always_touching: Sequence[tuple[str, str]], self_collision: bool
    ) -> tuple[LeftOutPair, ...]:
        body = {shape.owner: shape.body for shape in self.shapes}
        result = []
        for first, second in combinations(body, 2):
            moves = self.robot.carries
            joints = int((moves[body[first]] != moves[body[second]]).sum())
            solid = {first, second} & (self._obstacle_names | self._attached_names)
            is_checked_kind = self_collision or {first, second} & self._obstacle_names
            if joints == 0 or not is_checked_kind:
                continue
            if frozenset((first, second)) in self._ignored:
                result.append(LeftOutPair((first, second), IGNORED))
            elif joints == 1 and not solid:
                result.append(LeftOutPair((first, second), NEIGHBOURS))
            elif (first, second) in always_touching:
                result.append(LeftOutPair((first, second), ALWAYS_TOUCHING))
        return tuple(result)


def _link_shapes(robot: RobotModel, covers: Mapping[str, Sequence[ConvexShape]]) -> list[BodyShape]:
    """Return covers of links, given in the frame of the root link, as shapes of their bodies."""
    result = []
    for link, shapes in covers.items():
        body = robot.link_body[link]
        if body == _BASE and robot.base is not None:  # the pose of the base
            shapes = [shape.transformed(robot.base.placement) for shape in shapes]
        result += [BodyShape(link, body, shape) for shape in shapes]
    return result


def _as_pairs(pairs: list[tuple[int, int]]) -> IntArray:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _require_names(
    robot: RobotModel,
    obstacles: Sequence[Obstacle],
    attached: Sequence[AttachedSolid],
    ignore: Sequence[tuple[str, str]],
) -> None:
    names = [*(obstacle.name for obstacle in obstacles), *(solid.name for solid in attached)]
    for name in names:
        if names.count(name) > 1:
            raise ProblemError(f"obstacles: the name '{name}' is given {names.count(name)} times")
        if name in robot.link_body:
            raise ProblemError(f"obstacles: '{name}' is also the name of a link; choose another")
    names_in_cell = [*robot.link_body, *names]
    for pair in ignore:
        for name in pair:
            if name not in names_in_cell:
                raise ProblemError(
                    f"collision.ignore: {unknown_name('link or obstacle', name, names_in_cell)}"
                )


@dataclass(frozen=True, eq=False)
class CollisionScene:
    """An arm, its attached solids and the obstacles around it, as `CollisionChecker` takes them."""

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
        """Return True if another scene is made of the same objects, the arm with any limits."""
        others = (f.name for f in fields(self) if f.name != "robot")
        same = all(getattr(self, name) is getattr(other, name) for name in others)
        return same and self.robot.moves_as(other.robot)


# ---- Cover errors of the links.


@dataclass(frozen=True)
class LinkCover:
    """The number of a link's shapes and their errors.

    Attributes:
        link: Its name.
        shapes: Number of its convex shapes.
        outer_error: The largest distance found from their surface to the link itself [m].
        closer_shapes: Number of the closer shapes for the links that come near it; 0 if it has
            none.
        closer_error: `outer_error` of the closer shapes, where other links come near [m]; None
            without any.
    """

    link: str
    shapes: int
    outer_error: float
    closer_shapes: int
    closer_error: float | None


def link_covers(checker: CollisionChecker) -> list[LinkCover]:
    """Return the covers and cover errors of all links that have collision geometry.

    Meshes are measured on the first call; the cache keeps the distances.

    Raises:
        RobotError: A mesh is missing or unreadable.
    """
    result = []
    for link, parts in link_parts(checker.robot).items():
        closer = checker.closer_covers.get(link)
        result.append(
            LinkCover(
                link,
                sum(len(part.cover()) for part in parts),
                max(part.outer_error() for part in parts),
                0 if closer is None else len(closer.shapes),
                None if closer is None else closer.outer_error,
            )
        )
    return result
