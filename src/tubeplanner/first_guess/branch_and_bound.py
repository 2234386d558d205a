"""Phase 1: branch and bound over waypoints.

M candidate waypoints lie on the reference path. Any increasing subset that holds the first and the
last may be passed, at equal times, by sequential quartics: 2^(M-2) trajectories. A node of the
search is the beginning of such a trajectory; a child has one waypoint more, and so one segment
more. The nodes with the lowest bounds on their duration are expanded first, children that break a
rule are cut (Suh & Bishop 1988, phase 1).

Rules are tested at samples and can be too lenient. A complete trajectory counts only with its exact
duration and its certificate.
"""

import heapq
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.verification import Certificate
from tubeplanner.certificate.verification import quick_certificate as verify
from tubeplanner.first_guess.segment_rules import SegmentBatch, SegmentRules
from tubeplanner.first_guess.waypoints import (
    last_two_quartics,
    look_ahead_quartic,
    sequential_quartics,
)
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.limits.tube_membership import first_departure, may_pass_points
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# Nodes expanded at a time, or fewer, if they have this many children.
_NODES_AT_ONCE, _CHILDREN_AT_ONCE = 32, 1024
_END = np.array([1.0])


@dataclass(frozen=True)
class SearchStatistics:
    """Statistics of a search so far.

    Attributes:
        nodes: Nodes expanded.
        children: Continuations built and tested.
        cuts: Number of continuations cut at samples, by rule.
        motions: Complete trajectories that no rule cut.
        refused: Complete trajectories no faster than the best, or that failed their certificate.
        forgone: Nodes and trajectories passed over because they begin like one that failed.
        lower_bound: Lower bound on certified trajectories of this family [s]; None if none is
            faster than the bound given to the search.
        best_duration: Duration of the best trajectory so far [s]; None if there is none.
        budget_reached: True if the node budget ended the search: there may be better trajectories.
    """

    nodes: int
    children: int
    cuts: dict[str, int]
    motions: int
    refused: int
    forgone: int
    lower_bound: float | None
    best_duration: float | None
    budget_reached: bool

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics as JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        cuts = ", ".join(f"{rule} {count}" for rule, count in self.cuts.items())
        text = (
            f"{self.nodes} nodes, {self.children} segments tested, cut by rule: {cuts}; "
            f"{self.motions} trajectories tried, {self.refused} refused; {self.forgone} forgone, "
            "which begin like a refused one"
        )
        if self.budget_reached:
            text += "; the node budget ended it"
        return text


@dataclass(frozen=True, eq=False, slots=True)
class _Node:
    """The beginning of a trajectory: built up to the last waypoint but one."""

    waypoints: tuple[int, ...]  # indices of its waypoints
    velocity: FloatArray  # at the last waypoint but one, shape (n,)
    acceleration: FloatArray  # at the last waypoint but one, shape (n,)
    factor: float  # speed factor that the limits allow
    tube_segments: BoolArray  # True for tube segments the tool may be in there, shape (m,)


class BranchAndBound:
    """A search that may be stopped at any time.

    Attributes:
        best: The fastest certified trajectory, run at the limits; None until there is one.
        certificate: The certificate of that trajectory.
        certificate_time: Time that the certificate took [s].
        best_waypoints: Indices of its waypoints.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        waypoints: FloatArray,
        *,
        upper_bound: float = np.inf,
        node_budget: int = 10_000,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare a search.

        The first and the last of the M >= 2 waypoints (M, n) are always used. Only trajectories
        faster than the upper bound are of interest [s]; the search ends at about the node budget.
        """
        self.best: JointTrajectory | None = None
        self.certificate: Certificate | None = None
        self.certificate_time = 0.0
        self.best_waypoints: tuple[int, ...] = ()
        self._problem, self._waypoints = problem, waypoints
        self._rules = SegmentRules(problem, waypoints, checkpoint)
        self._upper_bound, self._node_budget = upper_bound, node_budget
        self._open: list[tuple[float, tuple[int, ...], _Node]] = []
        # Beginnings of trajectories that failed between samples: all that begin so fail alike.
        self._failed: set[tuple[int, ...]] = set()
        self._nodes = self._children = self._trajectories = self._refused = self._forgone = 0
        # The trajectory without inner waypoints, then a node for every second waypoint.
        goal, rest = len(waypoints) - 1, np.zeros(waypoints.shape[1])
        self._try_trajectory((0, goal))
        tube_segments = np.full(problem.tube.segment_count, problem.tube.visit != "ordered")
        tube_segments[0] = True
        for second in range(1, goal):
            if self._rules.free_waypoints[second]:
                self._push(0.0, _Node((0, second), rest, rest, np.inf, tube_segments))

    @property
    def finished(self) -> bool:
        """True if no open node can lead to a better trajectory, or the budget is used up."""
        return not self._has_open_nodes or self._nodes >= self._node_budget

    @property
    def statistics(self) -> SearchStatistics:
        """Statistics so far."""
        best = None if self.best is None else self.best.duration
        return SearchStatistics(
            nodes=self._nodes,
            children=self._children,
            cuts=dict(self._rules.cuts),
            motions=self._trajectories,
            refused=self._refused,
            forgone=self._forgone,
            lower_bound=self._open[0][0] if self._has_open_nodes else best,
            best_duration=best,
            budget_reached=self._has_open_nodes and self._nodes >= self._node_budget,
        )

    def expand(self) -> None:
        """Expand the most promising nodes."""
        nodes: list[_Node] = []
        children = 0
        while self._has_open_nodes and len(nodes) < _NODES_AT_ONCE and children < _CHILDREN_AT_ONCE:
            node = heapq.heappop(self._open)[2]
            if not self._begins_like_a_failed_one(node.waypoints):
                nodes.append(node)
                children += len(self._waypoints) - 1 - node.waypoints[-1]
        if not nodes:
            return
        self._nodes += len(nodes)
        goal = len(self._waypoints) - 1
        parents, goals = np.arange(len(nodes)), np.full(len(nodes), goal)
        last_segments = self._continued(nodes, parents, goals, last_two_quartics)
        after = [np.arange(node.waypoints[-1] + 1, goal) for node in nodes]
        parents = np.repeat(parents, [len(row) for row in after])
        aims = np.concatenate(after)
        inner_segments = self._continued(nodes, parents, aims, look_ahead_quartic)
        for batch in (last_segments, inner_segments):
            self._children += len(batch)
            survivors = self._rules.clear(self._rules.surviving(batch, self._upper_bound))
            bound = self._rules.lower_bound(survivors)
            if not batch.complete:
                velocity, acceleration = (survivors.at(_END, order)[:, 0, 0] for order in (1, 2))
                for i, parent in enumerate(survivors.parent):
                    node = _Node(
                        (*nodes[parent].waypoints, int(survivors.waypoints[i, 2])),
                        velocity[i],
                        acceleration[i],
                        float(survivors.factor[i]),
                        survivors.tube_segments[i],
                    )
                    self._push(float(bound[i]), node)
                continue
            for i in np.argsort(bound, kind="stable"):  # the most promising first
                if bound[i] < self._upper_bound:
                    parent = nodes[survivors.parent[i]]
                    self._try_trajectory((*parent.waypoints, len(self._waypoints) - 1))

    @property
    def _has_open_nodes(self) -> bool:
        return bool(self._open) and self._open[0][0] < self._upper_bound

    def _push(self, bound: float, node: _Node) -> None:
        # No two nodes share all waypoints, so waypoints decide between equal bounds.
        heapq.heappush(self._open, (bound, node.waypoints, node))

    def _continued(
        self,
        nodes: Sequence[_Node],
        parent: IntArray,
        after: IntArray,
        primitive: Callable[..., FloatArray],
    ) -> SegmentBatch:
        """Return continuations of nodes (C,) that aim at waypoints (C,)."""
        ends = np.array([node.waypoints[-2:] for node in nodes])[parent]
        velocity = np.array([node.velocity for node in nodes])[parent]
        acceleration = np.array([node.acceleration for node in nodes])[parent]
        begin, following = self._waypoints[ends.T]
        coefficients = primitive(begin, velocity, acceleration, following, self._waypoints[after])
        new = coefficients.shape[1]
        return SegmentBatch(
            parent=parent,
            waypoints=np.column_stack([ends, after]),
            built=np.array([len(node.waypoints) for node in nodes])[parent] - 2 + new,
            # Not yet at the goal: at least one more to the next waypoint, and one from there.
            remaining=np.full(len(parent), 0 if new == 2 else 2),
            coefficients=coefficients.transpose(2, 0, 1, 3),
            factor=np.array([node.factor for node in nodes])[parent],
            tube_segments=np.array([node.tube_segments for node in nodes])[parent],
            inside=np.zeros((len(parent), 0, new, self._problem.tube.segment_count), dtype=bool),
        )

    def _try_trajectory(self, waypoints: tuple[int, ...]) -> None:
        """Keep a certified trajectory if no earlier trajectory is as fast."""
        q = self._waypoints[list(waypoints)]
        is_still = np.ptp(q, axis=0).max() == 0
        if is_still or self._begins_like_a_failed_one(waypoints):
            return
        self._trajectories += 1
        shape = sequential_quartics(self._problem.robot.joint_names, q)
        trajectory = None
        with suppress(Infeasible):  # gravity is too strong somewhere
            trajectory = scaled_to_limits(self._problem, shape)
        if trajectory is None or trajectory.duration >= self._upper_bound:
            self._refused += 1
            return
        fault = first_departure(self._problem, shape, MARGIN_TOLERANCE)
        if fault is None and not may_pass_points(self._problem, shape):
            self._refused += 1  # a certificate would take far longer to say so
            return
        if fault is None:
            begin = time.perf_counter()
            certificate = verify(self._problem, trajectory)
            if certificate.passed:
                self.certificate_time = time.perf_counter() - begin
                self.best, self.certificate = trajectory, certificate
                self.best_waypoints = waypoints
                self._upper_bound = trajectory.duration
                return
            # Another continuation may choose other switching times, but not other links or another
            # union.
            conditions = ["obstacles", "self_collision"]
            if self._problem.tube.visit == "any":
                conditions.append("tube")
            times = [
                float(fault_time)
                for name in certificate.failures()
                if name in conditions
                and (fault_time := certificate.conditions[name].where.time) is not None
            ]
            if times:
                fault = int(np.searchsorted(trajectory.breakpoints[1:-1], min(times), side="right"))
        self._refused += 1
        # A segment depends on the waypoints up to the one after its end, the last two on all.
        if fault is not None and fault + 3 < len(waypoints):
            self._failed.add(waypoints[: fault + 3])

    def _begins_like_a_failed_one(self, waypoints: tuple[int, ...]) -> bool:
        failed = any(waypoints[:k] in self._failed for k in range(3, len(waypoints) + 1))
        self._forgone += failed
        return failed
