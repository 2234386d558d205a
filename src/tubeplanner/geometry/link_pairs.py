"""Link pairs that always touch; link pairs that need closer covers.

Random configurations within the limits decide. Overlapping covers prove nothing about the links:
where covers overlap, the solids themselves are tested. Pairs are left out if the solids touch for
certain, in doubt they are checked: open meshes have no inside there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.geometry.cover_cache import Arrays, cached, content_hash, packed, unpacked
from tubeplanner.geometry.distances import touch
from tubeplanner.geometry.fine_covers import Cover, surface_samples
from tubeplanner.geometry.link_geometry import LinkPart
from tubeplanner.robot.model import RobotModel

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

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class LinkPairs:
    """The judgement of pairs of links.

    Attributes:
        always_touching: Pairs whose links themselves touch in all sampled configurations.
        refined: Pairs that are judged by `fine` instead of the links' usual covers.
        fine: By link name, close covers of links where the other links of their refined pairs come
            near, in the frame of the body.
    """

    always_touching: tuple[Pair, ...]
    refined: tuple[Pair, ...]
    fine: Mapping[str, Cover]


def judged_pairs(
    robot: RobotModel,
    parts: Mapping[str, Sequence[LinkPart]],
    covers: Mapping[str, Sequence[ConvexShape]],
    pairs: Sequence[Pair],
) -> LinkPairs:
    """Return the pairs of links that always touch, and closer covers where they are needed.

    Args:
        robot: The arm.
        parts: Collision elements of its links.
        covers: Their usual covers, in the frames of their bodies.
        pairs: Of links that joints move against each other.
    """
    if not pairs:
        return LinkPairs((), (), {})
    key = _key(robot, parts, pairs)
    return _of_arrays(
        cached("pairs", key, lambda: _as_arrays(LinkJudge(robot, parts, covers).judged(pairs)))
    )


class LinkJudge:
    """Links in random configurations."""

    def __init__(
        self,
        robot: RobotModel,
        parts: Mapping[str, Sequence[LinkPart]],
        covers: Mapping[str, Sequence[ConvexShape]],
    ) -> None:
        """Take links by their elements and their usual covers, see `judged_pairs`."""
        self._robot, self._parts = robot, parts
        shapes: list[BodyShape] = []
        self._indices: dict[str, range] = {}
        for link, cover in covers.items():
            self._indices[link] = range(len(shapes), len(shapes) + len(cover))
            shapes += [BodyShape(link, robot.link_body[link], shape) for shape in cover]
        self._covers = BodyShapes(robot, shapes)
        self._rotation, self._position = robot.body_poses(_random_configurations(robot))
        self._surfaces: dict[str, FloatArray] = {}

    def judged(self, pairs: Sequence[Pair]) -> LinkPairs:
        """Judge pairs of links."""
        touching = tuple(pair for pair in pairs if self._always_touch(pair))
        refined: list[Pair] = []
        probes: dict[str, list[FloatArray]] = {}
        for pair in pairs:
            if pair in touching:
                continue
            apart = self._falsely_overlapping(pair)
            if len(apart) > _FALSE_FRACTION * _FALSE_SAMPLES:
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
        return LinkPairs(touching, tuple(refined), fine)

    def _always_touch(self, pair: Pair) -> bool:
        """Return True if a pair's solids touch in all configurations."""
        spheres = self._covers.gaps_of_spheres(self._centers[:1], self._pairs_of(pair))
        if (spheres > 0).all():
            return False
        return all(self._touch(pair, k) for k in range(TOUCH_SAMPLES))

    def _falsely_overlapping(self, pair: Pair) -> IntArray:
        """Return the first configurations with overlap of covers alone, at most `_PROBED`."""
        indices = self._pairs_of(pair)
        spheres = self._covers.gaps_of_spheres(self._centers[:_FALSE_SAMPLES], indices)
        near = np.flatnonzero((spheres <= 0).any(axis=1)).tolist()
        result: list[int] = []
        if len(near) <= _FALSE_FRACTION * _FALSE_SAMPLES:  # too few to matter
            near = []
        for k in near:
            # The shapes that most likely overlap come first.
            gaps = self._covers.gaps_of_spheres(self._centers[k, None], indices)[0]
            likely = indices[np.argsort(gaps)[: int((gaps <= 0).sum())]]
            overlap = self._covers.any_overlap(self._rotation[k], self._position[k], likely)
            if overlap and not self._touch(pair, k, filled=True):
                result.append(k)
            if len(result) == _PROBED:
                break
        return np.array(result, dtype=np.int64)

    def _touch(self, pair: Pair, sample: int, *, filled: bool = False) -> bool:
        """Return True if solids touch for certain, or `filled`: as covers have them at best."""
        solids = [
            [part.solid.filled if filled else part.solid for part in self._parts[link]]
            for link in pair
        ]
        poses = [self._pose(link, sample) for link in pair]
        return touch(solids[0], solids[1], poses[0], poses[1])

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
    robot: RobotModel, parts: Mapping[str, Sequence[LinkPart]], pairs: Sequence[Pair]
) -> str | None:
    """Return a hash of everything that the judgement depends on; None if a mesh has no hash."""
    if any(part.mesh and part.mesh.key is None for own in parts.values() for part in own):
        return None
    configurations = _random_configurations(robot)
    contents: list[str | FloatArray] = [configurations]
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


def _as_arrays(judged: LinkPairs) -> Arrays:
    links = [link for link, cover in judged.fine.items() for _ in cover.shapes]
    arrays = packed([shape for cover in judged.fine.values() for shape in cover.shapes])
    arrays["errors"] = np.array([cover.outer_error for cover in judged.fine.values()])
    for name, pairs in (("touching", judged.always_touching), ("refined", judged.refined)):
        arrays[name] = np.array(pairs, dtype=np.str_).reshape(-1, 2)
    return arrays | {"links": np.array(links, dtype=np.str_)}


def _of_arrays(arrays: Arrays) -> LinkPairs:
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
    return LinkPairs(touching, refined, fine)
