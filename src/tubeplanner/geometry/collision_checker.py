"""CollisionChecker: pairs of links and obstacles, distances, cover errors of links."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes
from tubeplanner.geometry.convex_shapes import ConvexShape, extent_of
from tubeplanner.geometry.fine_covers import Cover, surface_samples
from tubeplanner.geometry.link_geometry import LinkPart, link_parts
from tubeplanner.geometry.meshes import Arrays, cached, content_hash, packed, unpacked
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, open_meshes
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent

Pair: TypeAlias = tuple[str, str]  # names of two links or solids
LinkParts: TypeAlias = Mapping[str, Sequence[LinkPart]]
LinkCovers: TypeAlias = Mapping[str, Sequence[ConvexShape]]

_BASE = 0
# Reasons to leave pairs out.
NEIGHBOURS, ALWAYS_TOUCHING, IGNORED = "neighbours", "always touching", "ignored"


@dataclass(frozen=True)
class LeftOutPair:
    """Two solids that are not checked against each other."""

    links: Pair  # their names
    # "neighbours" (a joint connects them), "always touching" (the solids, in all sampled
    # configurations) or "ignored" (by the problem, the SRDF or an attached solid)
    reason: str


class CollisionChecker(BodyShapes):
    """The pairs of shapes that must stay apart, and their distances.

    Several threads may use one checker; it pickles by content, without any file.

    Left out are links that no joint moves against obstacles and each other, links on the same or on
    neighbouring bodies, link pairs that always touch, and the pairs that the problem ignores. Pairs
    of links whose usual covers overlap where the links do not are judged by closer covers, if that
    is often or in a configuration that the arm has to have.

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
        ignore: Sequence[Pair] = (),
        ends: Sequence[FloatArray] = (),
    ) -> None:
        """Build the geometry.

        Args:
            robot: The arm.
            obstacles: Solids in the base frame.
            attached: Solids in the tool frame; they count as links.
            self_collision: Whether links are checked against each other.
            ignore: Pairs of names of links or obstacles that may touch.
            ends: Configurations (n,) in which no pair of links is to overlap by its covers alone.

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
        self.link_contents = {
            link: tuple(part.source() for part in own) for link, own in parts.items()
        }
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
        always_touching: Sequence[Pair] = ()
        if self_collision:
            candidates = self._select(combinations(moving, 2))
            always_touching = self._judge_links(alone, parts, covers, candidates, ends)
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
        parts: LinkParts,
        covers: LinkCovers,
        candidates: IntArray,
        ends: Sequence[FloatArray],
    ) -> Sequence[Pair]:
        """Set the pairs of links that are checked, and return the pairs that always touch.

        Attached solids stay checked: only their touch_links may touch them.
        """
        owners = [(self.shapes[i].owner, self.shapes[j].owner) for i, j in candidates]
        pairs = [pair for pair in dict.fromkeys(owners) if not {*pair} & self._attached_names]
        judged = _judged_pairs(alone, parts, covers, pairs, ends)
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
        self, always_touching: Sequence[Pair], self_collision: bool
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


def _link_shapes(robot: RobotModel, covers: LinkCovers) -> list[BodyShape]:
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
    ignore: Sequence[Pair],
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
    ignore: tuple[Pair, ...]
    # configurations (n,) in which usual covers of links overlap, and the scene with usual covers;
    # that scene itself has neither
    ends: tuple[FloatArray, ...] = ()
    usual: "CollisionScene | None" = None

    @cached_property
    def checker(self) -> CollisionChecker:
        """The shapes and their pairs, ready to be checked; raises as `CollisionChecker` does."""
        return CollisionChecker(
            self.robot,
            self.obstacles,
            attached=self.attached,
            self_collision=self.self_collision,
            ignore=self.ignore,
            ends=self.ends,
        )

    def free_at(self, configurations: Sequence[FloatArray]) -> "CollisionScene":
        """Return the scene with closer covers of links that overlap by usual covers alone.

        Links of which no covers overlap in the configurations (n,) have the usual ones.
        """
        usual = self.usual or self
        checker, q = usual.checker, np.array(configurations).reshape(-1, self.robot.joint_count)
        known = np.full((len(q), len(checker.link_pairs)), -np.inf)
        near = checker.near_distances(q, checker.link_pairs, np.zeros(known.shape), known) < 0
        ends = q[near.any(axis=1)]
        if np.array_equal(ends, np.array(self.ends).reshape(-1, q.shape[1])):
            return self
        if len(ends) == 0:
            return usual
        key = ends.tobytes()
        if key not in usual._closer:
            usual._closer[key] = replace(usual, ends=tuple(ends), usual=usual)
        return usual._closer[key]

    @cached_property
    def _closer(self) -> "dict[bytes, CollisionScene]":
        """The scenes with closer covers, by the bits of their `ends`."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        _ = self.checker  # built from files now: where the pickle goes, there may be none
        return {name: value for name, value in vars(self).items() if name != "_closer"}

    def is_as(self, other: "CollisionScene") -> bool:
        """Return True if another scene is made of the same objects, the arm with any limits."""
        others = (f.name for f in fields(self) if f.name not in ("robot", "ends", "usual"))
        same = all(getattr(self, name) is getattr(other, name) for name in others)
        return same and self.robot.moves_as(other.robot)


# ---- Cover errors of the links.


@dataclass(frozen=True)
class LinkCover:
    """The number of a link's shapes and their errors."""

    link: str  # its name
    shapes: int  # number of its convex shapes
    outer_error: float  # the largest distance found from their surface to the link itself [m]
    # number of the closer shapes for the links that come near it; 0 if it has none
    closer_shapes: int
    # `outer_error` of the closer shapes, where other links come near [m]; None without any
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


# ---- Link pairs that always touch; link pairs that need closer covers.
#
# Random configurations within the limits decide. Overlapping covers prove nothing about the links:
# where covers overlap, the solids themselves are tested. Pairs are left out if the solids touch for
# certain, in doubt they are checked: open meshes have no inside there.

# Link pairs that touch in all of this many random configurations are assumed to touch always.
TOUCH_SAMPLES = 400
_TOUCH_SEED = 0
# Arms with equal poses of their bodies in this many configurations have equal poses in all.
_TELLING = 8
# Covers of a pair are refined if they overlap although the links are apart in more than this
# fraction of the first _FALSE_SAMPLES configurations: below it hardly a motion is lost, and each
# further shape costs time in every plan.
_FALSE_FRACTION = 0.05
_FALSE_SAMPLES = 200
# Points of each link of a pair, and configurations, that show where covers must be close.
_PROBES, _PROBED = 200, 40
_PROBE_SEED = 0


class _LinkPairs(NamedTuple):
    """The judgement of pairs of links."""

    # pairs whose links themselves touch in all sampled configurations
    always_touching: tuple[Pair, ...]
    refined: tuple[Pair, ...]  # pairs that are judged by `fine` instead of the links' usual covers
    # by link name, close covers of links where the other links of their refined pairs come near, in
    # the frame of the body
    fine: Mapping[str, Cover]


def _judged_pairs(
    robot: RobotModel,
    parts: LinkParts,
    covers: LinkCovers,
    pairs: Sequence[Pair],
    ends: Sequence[FloatArray] = (),
) -> _LinkPairs:
    """Return the pairs of links that always touch, and closer covers where they are needed.

    Covers are the usual ones, in the frames of the bodies; joints move the pairs apart. `ends` are
    configurations (n,) in which covers must not overlap where the links do not.
    """
    if not pairs:
        return _LinkPairs((), (), {})

    def computed() -> Arrays:
        return _as_arrays(_LinkJudge(robot, parts, covers, ends).judged(pairs))

    return _of_arrays(cached("pairs", _key(robot, parts, pairs, ends), computed))


class _LinkJudge:
    """Links in random configurations, by their elements and their usual covers; then at ends."""

    def __init__(
        self, robot: RobotModel, parts: LinkParts, covers: LinkCovers, ends: Sequence[FloatArray]
    ) -> None:
        self._robot, self._parts = robot, parts
        shapes: list[BodyShape] = []
        self._indices: dict[str, range] = {}
        for link, cover in covers.items():
            self._indices[link] = range(len(shapes), len(shapes) + len(cover))
            shapes += [BodyShape(link, robot.link_body[link], shape) for shape in cover]
        self._covers = BodyShapes(robot, shapes)
        configurations = np.vstack([_random_configurations(robot), *ends])
        self._rotation, self._position = robot.body_poses(configurations)
        self._surfaces: dict[str, FloatArray] = {}

    def judged(self, pairs: Sequence[Pair]) -> _LinkPairs:
        """Judge pairs of links."""
        touching = tuple(pair for pair in pairs if self._always_touch(pair))
        refined: list[Pair] = []
        probes: dict[str, list[FloatArray]] = {}
        for pair in pairs:
            if pair in touching:
                continue
            apart = [*self._often_overlapping(pair), *self._overlapping_at_ends(pair)]
            if apart:
                refined.append(pair)
                for link, other in (pair, pair[::-1]):
                    points = self._surface_points(other)
                    for k in apart:
                        (rotation, position), (frame, origin) = (
                            self._pose(each, k) for each in (other, link)
                        )
                        in_frame = (points @ rotation.T + position - origin) @ frame
                        probes.setdefault(link, []).append(in_frame)
        fine = {link: self._fine_cover(link, np.vstack(parts)) for link, parts in probes.items()}
        return _LinkPairs(touching, tuple(refined), fine)

    def _always_touch(self, pair: Pair) -> bool:
        """Return True if a pair's solids touch in all configurations."""
        spheres = self._covers.gaps_of_spheres(self._centers[:1], self._pairs_of(pair))
        if (spheres > 0).all():
            return False
        return all(self._touch(pair, k) for k in range(TOUCH_SAMPLES))

    def _often_overlapping(self, pair: Pair) -> list[int]:
        """Return samples with overlap of covers alone, at most `_PROBED`; none if they are few."""
        indices = self._pairs_of(pair)
        spheres = self._covers.gaps_of_spheres(self._centers[:_FALSE_SAMPLES], indices)
        near = np.flatnonzero((spheres <= 0).any(axis=1)).tolist()
        few = _FALSE_FRACTION * _FALSE_SAMPLES
        result: list[int] = []
        for k in near if len(near) > few else ():
            # The shapes that most likely overlap come first.
            gaps = self._covers.gaps_of_spheres(self._centers[k, None], indices)[0]
            likely = indices[np.argsort(gaps)[: int((gaps <= 0).sum())]]
            overlap = self._covers.any_overlap(self._rotation[k], self._position[k], likely)
            if overlap and not self._touch(pair, k, filled=True):
                result.append(k)
            if len(result) == _PROBED:
                break
        return result if len(result) > few else []

    def _overlapping_at_ends(self, pair: Pair) -> list[int]:
        """Return the ends, which come after the samples, with overlap of covers alone."""
        indices, result = self._pairs_of(pair), []
        for k in range(TOUCH_SAMPLES, len(self._rotation)):
            distance = self._covers.distances(self._rotation[k], self._position[k], indices)
            if distance.min() < 0 and not self._touch(pair, k, filled=True):
                result.append(k)
        return result

    def _touch(self, pair: Pair, sample: int, *, filled: bool = False) -> bool:
        """Return True if solids touch for certain, or `filled`: as covers have them at best."""
        solids = [
            [part.solid.filled if filled else part.solid for part in self._parts[link]]
            for link in pair
        ]
        poses = [self._pose(link, sample) for link in pair]
        return any(one.touches(other, *poses) for one in solids[0] for other in solids[1])

    def _surface_points(self, link: str) -> FloatArray:
        """Return points on the surface of a link, in the frame of the body, shape (N, 3) [m]."""
        if link not in self._surfaces:
            rng = np.random.default_rng(_PROBE_SEED)
            solids = [part.solid for part in self._parts[link]]
            surfaces = [solid.triangles for solid in solids if len(solid.faces)]
            corners = np.vstack([solid.vertices for solid in solids])
            points = [corners[:: max(1, len(corners) // _PROBES)]]
            if surfaces:
                points.append(surface_samples(np.concatenate(surfaces), _PROBES, rng))
            self._surfaces[link] = np.vstack(points)
        return self._surfaces[link]

    def _fine_cover(self, link: str, probes: FloatArray) -> Cover:
        shapes, errors = [], []
        for part in self._parts[link]:
            if part.mesh is None:
                shapes += part.cover()
                errors.append(part.outer_error())
                continue
            rotation, position = part.placement[:3, :3], part.placement[:3, 3]
            cover = part.mesh.fine_cover((probes - position) @ rotation)
            shapes += [shape.transformed(part.placement) for shape in cover.shapes]
            errors.append(cover.outer_error)
        return Cover(tuple(shapes), max(errors))

    @cached_property
    def _centers(self) -> FloatArray:
        """Centres of the covers' bounding spheres, shape (configurations, shapes, 3) [m]."""
        return self._covers.sphere_centers(self._rotation, self._position)

    def _pose(self, link: str, sample: int) -> tuple[FloatArray, FloatArray]:
        body = self._robot.link_body[link]
        return self._rotation[sample, body], self._position[sample, body]

    def _pairs_of(self, pair: Pair) -> IntArray:
        first, second = (self._indices[link] for link in pair)
        return np.array([(i, j) for i in first for j in second], dtype=np.int64)


def _key(
    robot: RobotModel, parts: LinkParts, pairs: Sequence[Pair], ends: Sequence[FloatArray]
) -> str | None:
    """Return a hash of everything that the judgement depends on; None if a mesh has no hash."""
    if any(part.mesh and part.mesh.key is None for own in parts.values() for part in own):
        return None
    configurations = _random_configurations(robot)
    contents: list[str | FloatArray] = [configurations, *ends]
    contents += robot.body_poses(configurations[:_TELLING])
    for link, own in parts.items():
        contents += [link, str(robot.link_body[link])]
        contents += [content for part in own for content in part.contents()]
    return content_hash([*contents, *(name for pair in pairs for name in pair)])


def _random_configurations(robot: RobotModel) -> FloatArray:
    limits = robot.limits
    lower, upper = limits.lower_position, limits.upper_position
    low = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))  # one turn, if the range has it
    high = np.minimum(upper, low + 2 * np.pi)
    rng = np.random.default_rng(_TOUCH_SEED)
    return rng.uniform(low, high, (TOUCH_SAMPLES, len(low)))


def _as_arrays(judged: _LinkPairs) -> Arrays:
    links = [link for link, cover in judged.fine.items() for _ in cover.shapes]
    arrays = packed([shape for cover in judged.fine.values() for shape in cover.shapes])
    arrays["errors"] = np.array([cover.outer_error for cover in judged.fine.values()])
    for name, pairs in (("touching", judged.always_touching), ("refined", judged.refined)):
        arrays[name] = np.array(pairs, dtype=np.str_).reshape(-1, 2)
    return arrays | {"links": np.array(links, dtype=np.str_)}


def _of_arrays(arrays: Arrays) -> _LinkPairs:
    shapes: dict[str, list[ConvexShape]] = {}
    for link, shape in zip(arrays["links"].tolist(), unpacked(arrays), strict=True):
        shapes.setdefault(link, []).append(shape)
    fine = {
        link: Cover(tuple(own), error)
        for (link, own), error in zip(shapes.items(), arrays["errors"].tolist(), strict=True)
    }
    touching, refined = (
        tuple((first, second) for first, second in arrays[name].tolist())
        for name in ("touching", "refined")
    )
    return _LinkPairs(touching, refined, fine)
