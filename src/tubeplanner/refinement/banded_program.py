"""The program of one step for the native library: rows join it while it is being solved."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.step_program import NativeProgram
from tubeplanner.refinement.joint_blocks import JointBlocks
from tubeplanner.refinement.step_block import Block, SparseRows, Step, stacked_rows
from tubeplanner.refinement.symmetric_entries import SymmetricEntries

# Where the method begins: eta, and how far beyond what rows lack the elastic variable is.
_FIRST_DURATION_STEP, _FIRST_SPARE = 0.2, 0.1
# Of what must not move: neither rows nor curvature move it, this balances bounds alone.
_STIFFNESS = 1e9


class BandedProgram:
    """A program that goes on from its last solution when rows join it; see `StepProgram`."""

    goes_on = True

    def __init__(self, blocks: Sequence[Block], columns: Sequence[IntArray]) -> None:
        """Set it up; arguments as `step_program`."""
        self._columns = columns
        self._blocks = joint = JointBlocks(blocks, columns)
        self._bounds = joint.bounds
        self._held = [row for held in joint.held for row in held.rows()]
        linear = joint.linear
        for row in self._held:
            linear[row.column] -= row.data * (row.data @ linear[row.column])
        self._program = NativeProgram(self._first(), linear, *self._bounds, self._band())
        hessian = joint.hessian
        for places, directions in _groups(self._held):
            hessian = _flattened(hessian, places, directions)
        self._program.add_quadratic(hessian.row, hessian.column, hessian.value)
        for row in self._held:
            column, other = np.meshgrid(row.column, row.column)
            square = _STIFFNESS * np.outer(row.data, row.data)
            self._program.add_quadratic(column.ravel(), other.ravel(), square.ravel())
        self._slack = np.zeros(0)
        for leg, block in enumerate(blocks):
            self._add_ends(leg, block)
        # Which of the program's rows are each leg's, and how many sets of them it has.
        self._places = [np.zeros(0, dtype=np.int64) for _ in blocks]
        self._known = [0] * len(blocks)
        self.join(blocks)

    def join(self, blocks: Sequence[Block]) -> None:
        """Take rows that blocks have gained."""
        self._blocks = JointBlocks(blocks, self._columns)
        for leg, block in enumerate(blocks):
            given = block.slack[len(self._places[leg]) :]
            added = stacked_rows(block.rows[self._known[leg] :])
            self._known[leg] = len(block.rows)
            if len(given):
                places = self._add(self._blocks.over_all(added, leg), given)
                self._places[leg] = np.concatenate([self._places[leg], places])

    def correct(self, blocks: Sequence[Block]) -> None:
        """Take rows that blocks have gained, and other slack of all."""
        self.join(blocks)
        for block, places in zip(blocks, self._places, strict=True):
            self._slack[places] = block.slack
        self._program.set_slack(self._slack)

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if the method does not get there."""
        found = self._program.solve(tolerance)
        if found is None:
            return None
        x, multipliers = found
        joint = self._blocks
        for row in self._held:
            x[row.column] -= row.data * (row.data @ x[row.column])
        return joint.steps(np.clip(x, *self._bounds), [multipliers[own] for own in self._places])

    def _add(self, rows: SparseRows, slack: FloatArray) -> IntArray:
        """Add rows; return their places among all."""
        if self._held:
            rows = _without(rows, self._held)
        self._program.add_rows(rows.count, rows.column, rows.data, slack)
        self._slack = np.concatenate([self._slack, slack])
        return np.arange(len(self._slack) - len(slack), len(self._slack))

    def _add_ends(self, leg: int, block: Block) -> None:
        """Add how far phases may change."""
        changes = self._blocks.over_all(block.width_changes, leg)
        for sign in (1.0, -1.0):
            if len(changes.count):
                self._add(replace(changes, data=sign * changes.data), block.widths)

    def _first(self) -> FloatArray:
        """Return where the method begins."""
        first = np.zeros(self._blocks.size)
        for block, own in zip(self._blocks.blocks, self._columns, strict=True):
            lacks = max(-float(block.slack.min(initial=0.0)), 0.0)
            first[own[-2:]] = _FIRST_DURATION_STEP, lacks + _FIRST_SPARE
        return first

    def _band(self) -> int:
        """Return how many of the first variables only neighbours couple.

        The configuration in which a cycle closes is behind all others.
        """
        legs = list(zip(self._blocks.blocks, self._columns, strict=True))
        controls = [own[: block.bounds.lower.size] for block, own in legs]
        last = max((int(own.max()) for own in controls if len(own)), default=-1)
        band = last + 1
        for own in controls:
            if (np.diff(own) < 0).any():
                band = min(band, int(own[0]))
        return band


def _without(rows: SparseRows, held: Sequence[SparseRows]) -> SparseRows:
    """Return rows that do not change along some directions, which are at right angles."""
    for columns, directions in _groups(held):
        rows = _turned_away(rows, columns, directions)
    return rows


def _groups(held: Sequence[SparseRows]) -> list[tuple[IntArray, FloatArray]]:
    """Return the variables (n,) of which some directions (r, n) are held."""
    groups: dict[tuple[int, ...], list[FloatArray]] = {}
    for row in held:
        groups.setdefault(tuple(row.column.tolist()), []).append(row.data)
    return [(np.array(columns), np.array(own)) for columns, own in groups.items()]


def _flattened(
    entries: SymmetricEntries, columns: IntArray, directions: FloatArray
) -> SymmetricEntries:
    """Return curvature that is none along directions (r, n) of some variables (n,)."""
    place = np.full(entries.size, -1)
    place[columns] = np.arange(len(columns))
    row, column = place[entries.row], place[entries.column]
    own = np.zeros((entries.size, len(columns)))
    np.add.at(own, (entries.row[column >= 0], column[column >= 0]), entries.value[column >= 0])
    own -= own @ directions.T @ directions
    own[columns] -= directions.T @ (directions @ own[columns])
    first, second = np.nonzero(own)
    others = place[first] < 0  # what couples them with other variables stands on both sides
    rest = (row < 0) & (column < 0)
    return SymmetricEntries(
        np.concatenate([entries.row[rest], first, columns[second][others]]),
        np.concatenate([entries.column[rest], columns[second], first[others]]),
        np.concatenate([entries.value[rest], own[first, second], own[first, second][others]]),
        entries.size,
    )


def _turned_away(rows: SparseRows, columns: IntArray, directions: FloatArray) -> SparseRows:
    """Return rows without their parts along directions (r, n) of some variables (n,)."""
    number = np.repeat(np.arange(len(rows.count)), rows.count)
    places_of = np.full(max(columns.max(), rows.column.max(initial=0)) + 1, -1)
    places_of[columns] = np.arange(len(columns))
    place = places_of[rows.column]
    is_meant = place >= 0
    if not is_meant.any():
        return rows
    own = np.zeros((len(rows.count), len(columns)))
    np.add.at(own, (number[is_meant], place[is_meant]), rows.data[is_meant])
    own -= own @ directions.T @ directions
    row, column = np.nonzero(own)
    number = np.concatenate([number[~is_meant], row])
    sequence = np.argsort(number, kind="stable")
    data = np.concatenate([rows.data[~is_meant], own[row, column]])[sequence]
    places = np.concatenate([rows.column[~is_meant], columns[column]])[sequence]
    return SparseRows(data, places, np.bincount(number, minlength=len(rows.count)))
