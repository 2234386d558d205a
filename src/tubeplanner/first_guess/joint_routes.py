"""Free configurations and edges between them; joint routes of free edges, by RRT-Connect."""

import ctypes
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes, NativeShapes
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.convex_shapes import ConvexShape, bounding_boxes, box
from tubeplanner.native.library import Bytes, Doubles, Integers, native_function
from tubeplanner.outcome import Location
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

_SIZE, _ADDRESS = ctypes.c_int64, ctypes.c_void_p
_SPACE = (
    _ADDRESS, Doubles, *(_SIZE,) * 4, *(Integers,) * 2, *(Doubles,) * 2, _SIZE, *(Doubles,) * 3,
    ctypes.c_double, Doubles, Integers,
)  # fmt: skip
_free_edges = native_function("tubeplanner_free_edges", *_SPACE, Doubles, _SIZE, Bytes)
_grow_trees = native_function(
    "tubeplanner_grow_trees", *_SPACE, *(Doubles,) * 3, *(ctypes.c_double,) * 2, *(_SIZE,) * 3,
    *(Doubles,) * 2, *(Integers,) * 2, Doubles,
)  # fmt: skip

# ---- Pairs in groups: what moves as one against one obstacle is first tested as one box.


class PairGroups(BodyShapes):
    """The pairs of a checker, their shapes thinned, and boxes around what moves as one.

    Rows are the G groups, then the members of those that have more than one pair; a group of one
    pair is the pair itself.

    Attributes:
        rows: Two shapes of each row, int, shape (R, 2).
        members: First row of each group's members, and the end, int, shape (G+1,).
        pair: Index of the checker's pair of each row that is one, else -1, int, shape (R,).
        weights: `motion_weights` of the rows, shape (R, n) [m per rad or m].
    """

    def __init__(self, checker: CollisionChecker, exact: BoolArray) -> None:
        """Group the pairs; those of a mask (P,) keep their shapes as they are."""
        shapes: list[BodyShape] = []
        own: dict[tuple[int, bool], int] = {}  # index of each shape of the checker, by its thinning

        def added(body: int, shape: ConvexShape) -> int:
            shapes.append(BodyShape("", body, shape))
            return len(shapes) - 1

        groups: dict[tuple[int, int, str], list[tuple[int, int, int]]] = {}
        for p, pair in enumerate(checker.pairs.tolist()):
            first, second = (checker.shapes[k] for k in pair)
            obstacle = second.owner if p < len(checker.obstacle_pairs) else ""
            group = groups.setdefault((first.body, second.body, obstacle), [])
            for k, each in zip(pair, (first, second), strict=True):
                key = k, bool(exact[p])
                if key not in own:
                    own[key] = added(each.body, each.shape if exact[p] else each.shape.thinned)
            i, j = (own[k, bool(exact[p])] for k in pair)
            group.append((p, i, j))
        around: dict[tuple[int, ...], int] = {}

        def surrounded(indices: Iterable[int]) -> int:
            parts = tuple(sorted(set(indices)))
            if len(parts) > 1 and parts not in around:
                box = _box_around([shapes[k].shape for k in parts])
                around[parts] = added(shapes[parts[0]].body, box)
            return around.get(parts, parts[0])

        heads, pairs, begins = [], [], [0]
        for group in groups.values():
            if len(group) == 1:
                heads.append(group[0])
            else:
                _, firsts, seconds = zip(*group, strict=True)
                heads.append((-1, surrounded(firsts), surrounded(seconds)))
                pairs += group
            begins.append(len(pairs))
        super().__init__(checker.robot, shapes)
        table = np.array([*heads, *pairs], dtype=np.int64).reshape(-1, 3)
        self.pair, self.rows = table[:, 0].copy(), np.ascontiguousarray(table[:, 1:])
        self.members = len(heads) + np.array(begins, dtype=np.int64)
        self.weights = np.ascontiguousarray(self.motion_weights(self.rows))

    @cached_property
    def group(self) -> IntArray:
        """Group of each row, shape (R,)."""
        counts = np.diff(self.members)
        return np.concatenate([np.arange(len(counts)), np.repeat(np.arange(len(counts)), counts)])

    def by_row(self, of_pairs: FloatArray) -> FloatArray:
        """Return values (P,) of pairs by row, of a group the largest of its members, (R,)."""
        values = np.where(self.pair >= 0, of_pairs[self.pair], -np.inf)
        most = np.full(len(self.members) - 1, -np.inf)
        np.maximum.at(most, self.group, values)
        return np.where(self.pair >= 0, values, most[self.group])

    @cached_property
    def native(self) -> NativeShapes:
        """The shapes for the native library."""
        return NativeShapes.of(self)


def _box_around(shapes: list[ConvexShape]) -> ConvexShape:
    """Return the box around some shapes of one body."""
    vertices = np.concatenate([shape.vertices for shape in shapes])
    radius = max(shape.radius for shape in shapes)
    bounds = bounding_boxes([ConvexShape(vertices, radius)])
    corners = box(2 * bounds.half[0]).vertices + bounds.center[0]
    return ConvexShape(corners @ bounds.axes[0])


# ---- Free configurations: links clear of obstacles and of each other, by a margin. Free edges:
# straight lines in joint space between.
#
# A pair whose distance is d at a place of an edge keeps a required distance r on both sides, as far
# as the joints travel by |dq| with weights @ |dq| <= d - r (`BodyShapes.motion_weights`). Bisection
# looks where no place around has shown that. On an edge no pair is nearer than required by more
# than half the resolution.

# Where an end of the trajectory has less clearance than the margin, this fraction of that clearance
# is kept everywhere; a pair that is too near there, or just as near as it must be, may be as near.
_FRACTION_AT_ENDS = 0.9
_SAME = 1e-9  # distances that are one but for rounding [m]
_RESOLUTION = 1e-5  # change of a distance between places that are looked at [m]


class FreeSpace:
    """The configurations in which links are farther apart than a problem requires.

    Attributes:
        robot: The arm.
    """

    def __init__(self, problem: PlanningProblem, margin: float, ends: FloatArray) -> None:
        """Take the pairs of a problem, without its tube, and a margin beyond the clearance [m].

        Pairs of shapes that are nearer at the ends (E, n), at least one, from start to goal, need
        not be farther apart elsewhere, even if they are nearer than the clearance there.
        """
        self.robot, self._checker = problem.robot, problem.collision
        self._pairs, self._ends = self._checker.pairs, ends
        self._requirement = RequiredDistances(problem, ends[0], ends[-1])
        self._set_margin(margin)

    def with_margin(self, margin: float) -> "FreeSpace":
        """Return the same space with another margin [m]."""
        other = copy(self)
        other._set_margin(margin)
        return other

    def is_free(self, q: FloatArray) -> bool:
        """Return True if a configuration (n,) has the margin."""
        return self.shortfall(q) is None

    def shortfall(self, q: FloatArray) -> Location | None:
        """Return the closest links and the tool's position where the margin is missing, or None."""
        rotation, position = self.robot.body_poses(q[None])
        required = self._required(q) + self._margin
        quick = self._checker.sphere_distances(rotation, position, self._pairs)[0] - required
        near = np.flatnonzero(quick < 0)
        alone = np.zeros(len(near), dtype=np.int64)
        boxes = self._checker.box_distances(rotation, position, alone, self._pairs[near])
        near = near[boxes < required[near]]
        distance = self._checker.distances(rotation[0], position[0], self._pairs[near])
        short = distance - required[near]
        if short.min(initial=0.0) >= 0:
            return None
        links, obstacle = self._checker.owners(self._pairs[near[short.argmin()]])
        return Location(links=links, obstacle=obstacle).at(self.robot.tool_position(q[None])[0])

    def clearances(self, q: FloatArray) -> FloatArray:
        """Return the distances of all pairs beyond the clearance at a configuration (n,), [m]."""
        rotation, position = self.robot.body_poses(q[None])
        return self._checker.distances(rotation[0], position[0], self._pairs) - self._required(q)

    def are_free_edges(self, edges: FloatArray) -> BoolArray:
        """Return True for edges (E, 2, n) that are free, each from a free configuration, (E,)."""
        if _free_edges is None:
            return np.array([self._is_free_edge(*edge) for edge in edges], dtype=bool)
        result = np.empty(len(edges), dtype=bool)
        _free_edges(*self.native, np.ascontiguousarray(edges), len(edges), result)
        return result

    @cached_property
    def native(self) -> tuple[object, ...]:
        """The arguments that native functions take of the space."""
        groups, required, ends = self._groups, self._row_required, self._row_ends
        contacts = self._requirement.near_ends
        tools = np.array([[*near.tool, near.within] for near in contacts]).reshape(-1, 4)
        robot, directions = self.robot, np.zeros((len(required), 3))
        for q, clearances in zip(self._ends, self._at_ends, strict=True):
            # Where shapes overlap, only a direction tells how deep.
            touching = (groups.pair >= 0) & (clearances <= _SAME)[groups.pair]
            rows = np.flatnonzero(touching)
            directions[rows] = groups.separations(*self._poses(q), groups.rows[rows])[1]
        table = robot.joint_table
        sizes = len(table), robot.joint_count, len(required), len(groups.members) - 1
        return (
            ctypes.addressof(groups.native), table, *sizes, groups.rows, groups.members, required,
            groups.weights, len(contacts), tools, ends, self._tool, _RESOLUTION, directions,
            np.arange(sizes[-1]),
        )  # fmt: skip

    def _is_free_edge(self, start: FloatArray, end: FloatArray) -> bool:
        """Return True if an edge from a free configuration is free, without the native library."""
        groups = self._groups
        row = np.flatnonzero(groups.pair >= 0)
        weight = np.maximum(groups.weights @ abs(end - start), np.finfo(float).tiny)
        low, high = np.zeros(len(row)), np.ones(len(row))
        below, above = np.zeros(len(row)), self._cover(row, start, end, high, weight, high)
        while above.min(initial=0.0) >= 0:
            width = high - low
            is_open = (below + above < width) & (weight[row] * width >= _RESOLUTION)
            if not is_open.any():
                return True
            row, width = row[is_open], width[is_open]
            low, high, below, above = (each[is_open] for each in (low, high, below, above))
            middle = (low + high) / 2
            here = self._cover(row, start, end, middle, weight, width / 2)
            if here.min() < 0:
                return False
            row, low, high = np.tile(row, 2), np.append(low, middle), np.append(middle, high)
            below, above = np.append(below, here), np.append(here, above)
        return False

    def _cover(
        self,
        row: IntArray,
        start: FloatArray,
        end: FloatArray,
        place: FloatArray,
        weight: FloatArray,
        enough: FloatArray,
    ) -> FloatArray:
        """Return how far about places (M,) of an edge rows (M,) keep distances, as fractions of it.

        Up to `enough` (M,), and negative where they do not at the place.
        """
        places, at = np.unique(place, return_inverse=True)
        q = start + places[:, None] * (end - start)
        poses, pairs, weight = self.robot.body_poses(q), self._groups.rows[row], weight[row]
        required = self._row_required[row]
        distance = self._groups.sphere_distances(*poses, self._groups.rows)[at, row]
        near = np.flatnonzero(distance < required + weight * enough)
        distance[near] = self._groups.separations_at(*poses, pairs[near], at[near])[0]
        cover = (distance - required) / weight
        for contact, own in zip(self._requirement.near_ends, self._row_ends[:, row], strict=True):
            tool_weight = self._tool[4:] @ abs(end - start) + np.finfo(float).tiny
            away = np.linalg.norm(self.robot.tool_position(q) - contact.tool, axis=1)[at]
            inside = (contact.within - away) / tool_weight
            near_cover = np.minimum((distance - own) / weight, inside)
            cover = np.where(own <= required, np.maximum(cover, near_cover), cover)
        return cover

    def _set_margin(self, margin: float) -> None:
        at_ends = np.minimum(_FRACTION_AT_ENDS * self._least, margin)
        self._margin = np.where(self._least > _SAME, at_ends, self._least - _SAME)
        for derived in ("_row_required", "_row_ends", "native"):
            vars(self).pop(derived, None)

    @cached_property
    def _least(self) -> FloatArray:
        """The least clearance of each pair at the ends, shape (P,) [m]."""
        return np.asarray(self._at_ends.min(axis=0))

    @cached_property
    def _at_ends(self) -> FloatArray:
        """The clearances of all pairs at the ends, shape (E, P) [m]."""
        return np.array([self.clearances(q) for q in self._ends])

    @cached_property
    def _groups(self) -> PairGroups:
        growth = np.array([each.shape.thinning.growth for each in self._checker.shapes])
        # Thinned shapes must leave the ends free.
        spare = (1 - _FRACTION_AT_ENDS) * self._least
        return PairGroups(self._checker, growth[self._pairs].sum(axis=1) > spare)

    @cached_property
    def _row_required(self) -> FloatArray:
        least = self._requirement.by_segment.min(axis=0)
        return self._groups.by_row(least + self._margin)

    @cached_property
    def _row_ends(self) -> FloatArray:
        """Distances that rows keep near the ends, infinite where none is, (K, R) [m]."""
        pair = self._groups.pair
        rows = [
            np.where((pair >= 0) & near.pair[pair], near.distance + self._margin[pair], np.inf)
            for near in self._requirement.near_ends
        ]
        return np.array(rows).reshape(len(rows), len(pair))

    @cached_property
    def _tool(self) -> FloatArray:
        """The tool's body, its position there [m] and its largest speed by joint, (n+4,)."""
        robot = self.robot
        body = robot.link_body[robot.tool_frame]
        rotation, position = self._poses(self._ends[0])
        tool = robot.tool_position(self._ends[:1])[0]
        local = rotation[body].T @ (tool - position[body])
        none = np.zeros(1, dtype=np.int64)
        reach = np.zeros(1), np.array([np.linalg.norm(local)])
        rates = robot.approach_rates((none, none + body), reach)[0]
        return np.array([body, *local, *rates])

    def _poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        rotation, position = self.robot.body_poses(q[None])
        return rotation[0], position[0]

    def _required(self, q: FloatArray) -> FloatArray:
        return self._requirement.anywhere(self.robot.tool_position(q[None]))[0]


# ---- Joint routes: two trees of free edges, from the start and from the goals.
#
# Kuffner & LaValle, "RRT-Connect" (ICRA 2000); nodes at obstacles draw only near by, as in
# Yershova, Jaillet, Simeon & LaValle, "Dynamic-domain RRTs" (ICRA 2005). Joints are measured by
# their velocity limits: a joint twice as fast moves twice as far.

# Distance from obstacles beyond the clearance [m], and edges of a search. Wide passages are found
# with few edges, or there is none: a search for one that is not there would take all the time.
_SCHEDULE = ((0.02, 1_000), (0.005, 5_000), (0.002, 20_000), (0.0, 200_000))
_RANGE = 0.7  # of a new edge [rad of a joint of median speed]
_DOMAIN = 4.0  # distance of samples from a node that an edge could not leave, likewise
_MAX_REFUSED = 50  # samples in a row that lie in no node's domain
_EDGES_AT_ONCE = 1_000  # until the time is looked at
_SHORTCUTS = 50  # more of them leave a route hardly shorter, with more corners
# Joint ranges of the search beyond start and goals, unless limits are nearer [rad or m].
_BEYOND = np.pi
_GOLDEN, _MASK = 0x9E3779B97F4A7C15, (1 << 64) - 1
_COUNT, _TURN, _RANDOM, _EDGES, _MET = 0, 2, 3, 4, 5  # places in the state of `_Trees`


class _Trees:
    """Free configurations, each reached from another by a free edge: start (0) and goals (1).

    Attributes:
        q: Configurations, shape (2, capacity, n).
        domain: Largest distances of samples from them, shape (2, capacity).
        parent: Nodes that they are reached from, -1 for roots, int, shape (2, capacity).
        state: Numbers of nodes (2), the next tree, the state of the random numbers, edges tested,
            nodes that met (2), int.
    """

    def __init__(self, roots: Sequence[FloatArray], seed: int) -> None:
        """Take the roots of both trees, (1, n) and (G, n)."""
        capacity = len(roots[1])
        self.q = np.zeros((2, capacity, roots[0].shape[1]))
        self.domain = np.full((2, capacity), np.inf)
        self.parent = np.full((2, capacity), -1)
        self.state = np.array([*map(len, roots), 0, _signed(seed), 0, -1, -1])
        for own, root in zip(self.q, roots, strict=True):
            own[: len(root)] = root

    def reserve(self, count: int) -> None:
        """Make memory for more nodes of both trees."""
        for name in ("q", "domain", "parent"):
            old = getattr(self, name)
            shape = (2, int(self.state[:2].max()) + count, *old.shape[2:])
            new = np.zeros(shape, old.dtype)
            new[:, : old.shape[1]] = old[:, : shape[1]]
            setattr(self, name, new)

    def nodes(self, tree: int) -> FloatArray:
        """Return the configurations of a tree, (N, n)."""
        return self.q[tree, : self.state[_COUNT + tree]]

    def fraction(self) -> float:
        """Return a random number in [0, 1).

        By splitmix64: Steele, Lea & Flood, "Fast splittable pseudorandom number generators" (2014).
        """
        z = (int(self.state[_RANDOM]) + _GOLDEN) & _MASK
        self.state[_RANDOM] = _signed(z)
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
        return ((z ^ (z >> 31)) >> 11) * 2.0**-53

    def route(self) -> list[FloatArray]:
        """Return the configurations from the start to a goal, where the trees have met."""
        halves: list[list[FloatArray]] = []
        for tree in range(2):
            node, half = int(self.state[_MET + tree]), []
            while node >= 0:
                half.append(self.q[tree, node].copy())
                node = int(self.parent[tree, node])
            halves.append(half)
        return [*halves[0][::-1], *halves[1][1:]]


def _signed(number: int) -> int:
    """Return the signed integer of the lowest 64 bits of a number."""
    number &= _MASK
    return number - (1 << 64) if number >> 63 else number


class RouteSearch:
    """Searches from a configuration to any of several goals; the same for the same seed.

    Attributes:
        edges: Number of edges tested so far.
        reached: Configuration (n,) nearest to a goal that the last search without a route reached
            from the start.
    """

    def __init__(self, problem: PlanningProblem, start: FloatArray, goals: FloatArray) -> None:
        """Prepare searches from a free start (n,) to any of some free goals (G, n)."""
        ends, limits = np.vstack([start, *goals]), problem.robot.limits
        least, most = ends.min(axis=0), ends.max(axis=0)
        self._low = np.minimum(np.maximum(limits.lower_position, least - _BEYOND), least)
        self._high = np.maximum(np.minimum(limits.upper_position, most + _BEYOND), most)
        speed = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
        self._speed = speed / np.median(speed)
        self._start, self._goals = start, goals
        self._space = FreeSpace(problem, 0.0, ends)
        self.edges = 0
        self.reached = start

    def routes(
        self, seed: int, edges: int, is_over: Callable[[], bool] = lambda: False
    ) -> Iterator[FloatArray]:
        """Yield the corners (P, n) of free routes, shortened; the k-th by seed + k.

        The first edges of a route keep the most distance from obstacles; later routes keep what
        the one before did. The end comes after a number of edges, when time is over, or after a
        straight route: none is shorter.
        """
        last, k = self.edges + edges, 0
        stages = list(_SCHEDULE)
        while self.edges < last and not is_over():
            for margin, budget in stages:
                trees = _Trees((self._start[None], self._goals), seed + k)
                self._space = self._space.with_margin(margin)
                route = self._search(trees, min(budget, last - self.edges), is_over)
                if route is not None:
                    stages = [stage for stage in stages if stage[0] <= margin]
                    yield route
                    if len(route) == 2:
                        return
                    break
                if self.edges >= last or is_over():
                    return
            k += 1

    def _search(self, trees: _Trees, edges: int, is_over: Callable[[], bool]) -> FloatArray | None:
        """Return the corners of a free route after at most some edges and those that shorten it."""
        for goal in self._goals:
            if self._is_free(self._start, goal):
                return np.array([self._start, goal])
        while trees.state[_EDGES] < edges and not is_over():
            last = min(edges, int(trees.state[_EDGES]) + _EDGES_AT_ONCE)
            # The last connection may go on, by as many edges as lie between two corners.
            span = float(np.linalg.norm((self._high - self._low) / self._speed))
            trees.reserve(_EDGES_AT_ONCE + int(span / _RANGE) + 2)
            before = int(trees.state[_EDGES])
            self._grow(trees, last)
            self.edges += int(trees.state[_EDGES]) - before
            if trees.state[_MET] >= 0:
                return self._shortened(trees)
        nodes = trees.nodes(0)
        away = np.linalg.norm((nodes[:, None] - self._goals) / self._speed, axis=2).min(axis=1)
        self.reached = nodes[int(away.argmin())]
        return None

    def _grow(self, trees: _Trees, last: int) -> None:
        """Let both trees grow until they meet or `last` edges were tested."""
        if _grow_trees is not None:
            arrays = trees.q, trees.domain, trees.parent, trees.state, np.empty(len(self._low))
            _grow_trees(
                *self._space.native, self._low, self._high, self._speed, _RANGE, _DOMAIN,
                _MAX_REFUSED, last, trees.q.shape[1], *arrays,
            )  # fmt: skip
            return
        while trees.state[_EDGES] < last:
            tree = int(trees.state[_TURN])
            trees.state[_TURN] = 1 - tree
            node = self._grown(trees, tree)
            if node is None:
                continue
            met = self._connected(trees, 1 - tree, trees.q[tree, node])
            if met is not None:
                trees.state[_MET + tree], trees.state[_MET + 1 - tree] = node, met
                return

    def _grown(self, trees: _Trees, tree: int) -> int | None:
        """Return a new node towards a random configuration; None if the edge is not free."""
        for _ in range(_MAX_REFUSED):
            fractions = np.array([trees.fraction() for _ in self._low])
            q = self._low + fractions * (self._high - self._low)
            node, distance = self._nearest(trees, tree, q)
            if distance <= trees.domain[tree, node]:
                break
        new = self._step(trees, tree, node, q, distance)
        if new is None:
            trees.domain[tree, node] = _DOMAIN
        return new

    def _connected(self, trees: _Trees, tree: int, q: FloatArray) -> int | None:
        """Return the node at a configuration (n,) that free edges reach; None if they do not."""
        last: int | None
        last, distance = self._nearest(trees, tree, q)
        while distance > 0 and last is not None:
            last = self._step(trees, tree, last, q, distance)
            distance -= _RANGE
        return last

    def _step(
        self, trees: _Trees, tree: int, node: int, q: FloatArray, distance: float
    ) -> int | None:
        """Return a new node on the way from a node to a configuration (n,) at a distance."""
        new, own = int(trees.state[_COUNT + tree]), trees.q[tree]
        own[new] = own[node] + _RANGE / distance * (q - own[node]) if distance > _RANGE else q
        trees.state[_EDGES] += 1
        if not self._space.are_free_edges(own[None, [node, new]])[0]:
            return None
        trees.domain[tree, new], trees.parent[tree, new] = np.inf, node
        trees.state[_COUNT + tree] += 1
        return new

    def _nearest(self, trees: _Trees, tree: int, q: FloatArray) -> tuple[int, float]:
        """Return the node of a tree that is nearest to a configuration (n,), and its distance."""
        squared = (((trees.nodes(tree) - q) / self._speed) ** 2).sum(axis=1)
        node = int(squared.argmin())
        return node, float(np.sqrt(squared[node]))

    def _shortened(self, trees: _Trees) -> FloatArray:
        """Return the corners of the trees' route, shortened by random straight edges."""
        route = self._with_few_corners(trees.route())
        for _ in range(_SHORTCUTS if len(route) > 2 else 0):
            steps = np.linalg.norm(np.diff(route, axis=0) / self._speed, axis=1)
            along = np.append(0.0, np.cumsum(steps))
            places = sorted(trees.fraction() * along[-1] for _ in range(2))
            i, j = (int(np.searchsorted(along, place, side="right")) - 1 for place in places)
            if i == j:
                continue
            first, second = (
                route[k] + (place - along[k]) / steps[k] * (route[k + 1] - route[k])
                for k, place in ((i, places[0]), (j, places[1]))
            )
            if self._is_free(first, second):
                route = [*route[: i + 1], first, second, *route[j + 1 :]]
        return np.array(self._with_few_corners(route))

    def _with_few_corners(self, route: list[FloatArray]) -> list[FloatArray]:
        """Return a route (P, n) without the corners that one free edge passes by."""
        result, k = [route[0]], 0
        while k < len(route) - 1:
            after = len(route) - 1
            while after > k + 1 and not self._is_free(route[k], route[after]):
                after -= 1
            result.append(route[after])
            k = after
        return result

    def _is_free(self, start: FloatArray, end: FloatArray) -> bool:
        self.edges += 1
        return bool(self._space.are_free_edges(np.array([[start, end]]))[0])
