"""Which segment each sample is in, so that the least margin is greatest."""

import math
from dataclasses import dataclass

import numpy as np

from outside.trajectory import Samples

State = tuple[int, bool, bool]


@dataclass(frozen=True, eq=False)
class Visits:
    """Which segments are the current ones when.

    Attributes:
        samples: Instants, shape (N,).
        rows: Of these, in order; one at which segments change is there with both, shape (V,).
        segments: The segment of each, shape (V,).
    """

    samples: Samples
    rows: np.ndarray
    segments: np.ndarray

    def current(self, samples: Samples, count: int) -> np.ndarray:
        """Return which of so many segments are current at samples: bool, shape (N, count).

        Between two of the visits' samples that is the segment of the one before.
        """
        time = self.samples.time[self.rows]
        first = np.searchsorted(time, samples.time, side="left")
        last = np.searchsorted(time, samples.time, side="right") - 1
        found = np.zeros((len(samples), count), dtype=bool)
        for k, (low, high) in enumerate(zip(np.minimum(first, last), last, strict=True)):
            found[k, self.segments[low : high + 1]] = True
        return found


def ordered_visits(
    least: np.ndarray, inside: dict[int, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return samples and segments of the ordered visits whose least margin is greatest.

    A state is a segment and whether the points at its two ends have been passed, if they must be.
    value[state][k] is the best least margin of visits that are in it at sample k. They came from
    the sample before in the same state, or at this sample from the segment before, or by passing a
    point.
    """
    inside, count = inside or {}, least.shape[1]
    value: dict[State, list[float]] = {}
    for state in _states(count, inside):
        gates = [(value[source], gate) for source, gate in _before(state, inside)]
        entries = [math.inf] + [-math.inf] * (len(least) - 1)
        if gates:
            both = [np.minimum(row, np.inf if gate is None else gate) for row, gate in gates]
            entries = np.max(both, axis=0).tolist()
        row, last = [], -math.inf
        for margin, entry in zip(least[:, state[0]].tolist(), entries, strict=True):
            last = min(margin, max(last, entry))
            row.append(last)
        value[state] = row
    k, state = len(least) - 1, (count - 1, True, True)
    visits = [(k, state[0])]
    while k > 0 or _before(state, inside):
        stays = value[state][k - 1] if k > 0 else -math.inf
        entered = [
            (min(value[source][k], math.inf if gate is None else gate[k]), source)
            for source, gate in _before(state, inside)
        ]
        enters, source = max(entered, key=lambda one: one[0], default=(-math.inf, state))
        k, state = (k - 1, state) if k > 0 and stays >= enters else (k, source)
        visits.append((k, state[0]))
    rows, segments = np.array(visits[::-1]).T
    return rows, segments


def union_visits(least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return samples and, for each, the segment whose margin is greatest."""
    return np.arange(len(least)), least.argmax(axis=1)


def _states(count: int, inside: dict[int, np.ndarray]) -> list[State]:
    """Return all states, each after those that lead to it."""
    return [
        (s, first, last)
        for s in range(count)
        for first in ((False, True) if s in inside else (True,))
        for last in ((False, True) if s + 1 in inside else (True,))
    ]


def _before(state: State, inside: dict[int, np.ndarray]) -> list[tuple[State, np.ndarray | None]]:
    """Return the states that lead to one, and the margin of what is passed on the way."""
    s, first, last = state
    found: list[tuple[State, np.ndarray | None]] = []
    if s > 0 and last == (s + 1 not in inside):  # what lies ahead is passed later
        found.append(((s - 1, True, first), None))
    if first and s in inside:
        found.append(((s, False, last), inside[s]))
    if last and s + 1 in inside:
        found.append(((s, first, False), inside[s + 1]))
    return found
