"""RotationalTube: reference orientations and rotation tolerances along each segment.

Between two reference points the reference orientation turns about a fixed axis, the short way
round, in proportion to the arc length: R_ref(u) = R_A exp(u log(R_A^T R_B)). A tool is compared
with the reference at the nearest point of the segment (Suh & Bishop 1988, equations 4 to 7; digest:
the deviation at the matched lambda). Its deviation is the rotation vector log(R_ref^T R), its
components along the axes of the reference. Rotations and positions are in the base frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.errors import ProblemError, shown
from tubeplanner.orientation import (
    inverse_right_jacobian,
    matrix_of_quaternion,
    rotation_matrix,
    rotation_vector,
)

# The u between which a reference orientation turns: a segment's own, one that turns on beyond its
# ends, and those that stay at one end.
Span: TypeAlias = tuple[float, float]
SEGMENT: Span = (0.0, 1.0)
TURNING: Span = (-np.inf, np.inf)
STAYING: tuple[Span, Span] = ((0.0, 0.0), (1.0, 1.0))
# One angle [rad], or bounds on the three components [rad].
RotationBound: TypeAlias = float | tuple[float, float, float]
Segment: TypeAlias = int | IntArray

_UNIT_TOLERANCE = 1e-3  # accepted difference of a quaternion's length from 1
_HALF_TURN_TOLERANCE = 1e-6  # [rad]: nearer to 180 degrees the short way round is undetermined


@dataclass(frozen=True, eq=False)
class RotationalTube:
    """Reference orientations and tolerances of the tool's rotation.

    Every parameter `segment` is an index or an array with an index per sample.
    """

    begin: FloatArray  # orientation at the start of each segment, shape (m, 3, 3)
    # rotation vector from start to end, in the frame of `begin`, shape (m, 3) [rad]
    rotation_change: FloatArray
    # on |x|, |y|, |z| of the rotation vector and on its length, the angle; infinite where free,
    # shape (m, 4) [rad]
    bounds: FloatArray
    points: FloatArray  # reference points, shape (m+1, 3) [m]

    @property
    def is_bounded(self) -> bool:
        """True if any rotation is bounded."""
        return bool(np.isfinite(self.bounds).any())

    @property
    def angles(self) -> FloatArray:
        """Angles by which the reference turns in each segment, shape (m,) [rad]."""
        return np.linalg.norm(self.rotation_change, axis=1)

    def projection(self, tool: FloatArray, segment: Segment) -> FloatArray:
        """Return the parameter u of the point on a segment's line nearest to tools (N, 3): (N,).

        0 at the segment's start and 1 at its end; outside [0, 1] the nearest point is that end.
        """
        start = self.points[:-1][segment]
        axis = self.points[1:][segment] - start
        return np.sum((tool - start) * axis, axis=-1) / np.sum(axis**2, axis=-1)

    def reference(self, tool: FloatArray, segment: Segment, span: Span = SEGMENT) -> FloatArray:
        """Return the reference orientation of tools (N, 3) [m], shape (N, 3, 3)."""
        return self.reference_at(np.clip(self.projection(tool, segment), *span), segment)

    def reference_at(self, fraction: FloatArray, segment: Segment) -> FloatArray:
        """Return the reference orientation at fractions (N,) of a segment, shape (N, 3, 3)."""
        return self.begin[segment] @ rotation_matrix(
            fraction[:, None] * self.rotation_change[segment]
        )

    def error(
        self, rotation: FloatArray, tool: FloatArray, segment: Segment, span: Span = SEGMENT
    ) -> FloatArray:
        """Return log(R_ref^T R), in the frame of the reference, shape (N, 3) [rad].

        Args:
            rotation: Orientation R of the tool, shape (N, 3, 3).
            tool: Its position, shape (N, 3) [m].
            segment: Index of the tool's segment.
            span: The u between which the reference turns.
        """
        return rotation_vector(self._relative(rotation, tool, segment, span))

    def error_jacobian(
        self,
        rotation: FloatArray,
        tool: FloatArray,
        jacobian: FloatArray,
        segment: Segment,
        span: Span = SEGMENT,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the error and its derivative by the joints.

        With v = log(E), E = R_ref^T R: dv/dt = J(v) (w - E^T turn du/dt), w being the tool's
        angular velocity in its own frame and J the inverse right Jacobian of SO(3). Where the
        nearest point passes an end of the segment the derivative jumps: the derivative inside is
        returned.

        Args:
            rotation: Shape (N, 3, 3).
            tool: Shape (N, 3) [m].
            jacobian: Of the tool in the base frame, linear rows first, shape (N, 6, n).
            segment: Index of the tool's segment.
            span: The u between which the reference turns.

        Returns:
            Error (N, 3) [rad] and derivative (N, 3, n).
        """
        relative = self._relative(rotation, tool, segment, span)
        error = rotation_vector(relative)
        projection = self.projection(tool, segment)
        moves = ((projection >= span[0]) & (projection <= span[1]))[:, None] * (span[0] < span[1])
        axis = self.points[1:][segment] - self.points[:-1][segment]
        gradient = moves * axis / np.sum(axis**2, axis=-1, keepdims=True)
        fraction_rate = np.einsum("ni,nij->nj", gradient, jacobian[:, :3])
        rotation_change = np.einsum(
            "nji,nj->ni", relative, np.broadcast_to(self.rotation_change[segment], tool.shape)
        )
        spin = rotation.transpose(0, 2, 1) @ jacobian[:, 3:]
        spin -= rotation_change[:, :, None] * fraction_rate[:, None]
        return error, inverse_right_jacobian(error) @ spin

    def use(self, rotation: FloatArray, tool: FloatArray, segment: Segment) -> FloatArray:
        """Return the largest share of a segment's bounds that the tools' rotations use, (N,)."""
        error = self.error(rotation, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        use: FloatArray = (np.hstack([abs(error), angle]) / self.bounds[segment]).max(axis=1)
        return use

    def margin(self, rotation: FloatArray, tool: FloatArray, segment: Segment) -> FloatArray:
        """Return the margins of the tools' rotations in a segment's bounds, shape (N,) [rad].

        The least of bound - |component| and bound - angle; infinite where all is free.
        """
        return self.margin_of(self.error(rotation, tool, segment), segment)

    def margin_of(self, error: FloatArray, segment: Segment) -> FloatArray:
        """Return the margin of rotation vectors (N, 3), shape (N,) [rad]."""
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        return (self.bounds[segment] - np.hstack([abs(error), angle])).min(axis=1)

    def _relative(
        self, rotation: FloatArray, tool: FloatArray, segment: Segment, span: Span
    ) -> FloatArray:
        return self.reference(tool, segment, span).transpose(0, 2, 1) @ rotation


def rotational_tube(
    points: FloatArray, orientations: FloatArray, tolerance: Sequence[RotationBound]
) -> RotationalTube:
    """Return the rotational part of a tube.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        orientations: Unit quaternions x y z w, shape (m+1, 4).
        tolerance: Per segment an angle, or bounds on the three components [rad].

    Raises:
        ProblemError: Neighbouring orientations are 180 degrees apart.
    """
    matrices = matrix_of_quaternion(orientations)
    rotation_change = rotation_vector(matrices[:-1].transpose(0, 2, 1) @ matrices[1:])
    for k, angle in enumerate(np.linalg.norm(rotation_change, axis=1)):
        if angle > np.pi - _HALF_TURN_TOLERANCE:
            raise ProblemError(
                f"tube.orientations: from point {k} to {k + 1} the tool turns by 180 degrees, so "
                "that the direction is undetermined; add a reference point between them"
            )
    bounds = np.full((len(tolerance), 4), np.inf)
    for k, bound in enumerate(tolerance):
        if isinstance(bound, tuple):
            bounds[k, :3] = bound
        else:
            bounds[k, 3] = bound
    return RotationalTube(
        read_only(matrices[:-1]), read_only(rotation_change), read_only(bounds), points
    )


def given_rotation(
    points: FloatArray, orientations: object, tolerance: object
) -> tuple[FloatArray | None, tuple[RotationBound, ...] | None, RotationalTube | None]:
    """Return quaternions, rotation bounds and their geometry; None where nothing is bounded.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        orientations: As `unit_quaternions` takes them; None if the rotation is free.
        tolerance: As `rotation_bounds` takes it; None likewise.

    Raises:
        ProblemError: Only one of both is given, or one is wrong.
    """
    if orientations is None and tolerance is None:
        return None, None, None
    if orientations is None or tolerance is None:
        present, missing = "rotation_tolerance", "orientations"
        remedy = "a quaternion [x, y, z, w] for every reference point"
        if tolerance is None:
            present, missing = missing, present
            remedy = "an angle or three bounds [rad] for every segment"
        raise ProblemError(
            f"tube.{present} is given without tube.{missing}; give {remedy}, or leave both out"
        )
    quaternions = unit_quaternions(orientations, len(points))
    bounds = rotation_bounds(tolerance, len(points) - 1)
    rotation = rotational_tube(points, quaternions, bounds)
    return quaternions, bounds, rotation if rotation.is_bounded else None


def unit_quaternions(orientations: Any, point_count: int) -> FloatArray:
    """Return orientations as unit quaternions x y z w, shape (m+1, 4).

    Raises:
        ProblemError: The count is wrong, or an orientation is no quaternion of length 1.
    """
    try:
        quaternions = np.array(orientations, dtype=np.float64)
    except (TypeError, ValueError):
        quaternions = np.zeros(0)
    if quaternions.ndim != 2 or quaternions.shape[1] != 4:
        raise ProblemError(
            f"tube.orientations: {orientations} is no list of quaternions [x, y, z, w]"
        )
    if len(quaternions) != point_count:
        raise ProblemError(
            f"tube.orientations has {len(quaternions)} quaternions for {point_count} reference "
            "points; give one each"
        )
    lengths = np.linalg.norm(quaternions, axis=1)
    for k, length in enumerate(lengths):
        if not abs(length - 1) <= _UNIT_TOLERANCE:
            raise ProblemError(
                f"tube.orientations[{k}] {quaternions[k].tolist()} has the length {length:.4g}; a "
                "rotation is a quaternion [x, y, z, w] of length 1: divide it by its length"
            )
    return read_only(quaternions / lengths[:, None])


def rotation_bounds(tolerance: Any, segment_count: int) -> tuple[RotationBound, ...]:
    """Return a rotation tolerance per segment: an angle, or bounds on three components [rad].

    A single angle or triple serves for all segments.

    Raises:
        ProblemError: The count is wrong, or an entry is neither a positive number nor three of
            them.
    """
    entries = _entries(tolerance, segment_count)
    if len(entries) != segment_count:
        raise ProblemError(
            f"tube.rotation_tolerance has {len(entries)} entries for {segment_count} segments; "
            "give one angle or triple for all, or an angle or three bounds each"
        )
    names = (f"tube.rotation_tolerance[{k}]" for k in range(segment_count))
    return tuple(rotation_bound(name, entry) for name, entry in zip(names, entries, strict=True))


def _entries(tolerance: Any, segment_count: int) -> list[Any]:
    """Return the entries of a rotation tolerance; a single number or triple serves all segments.

    Three numbers for three segments are an angle each.
    """
    if np.isscalar(tolerance):
        return [tolerance] * segment_count
    entries = list(tolerance)
    is_triple = len(entries) == 3 and all(np.isscalar(entry) for entry in entries)
    if is_triple and segment_count != 3:
        return [entries] * segment_count
    if len(entries) == 1 and np.shape(entries[0]) == (3,):
        return entries * segment_count
    return entries


def rotation_bound(name: str, entry: Any) -> RotationBound:
    """Return a bound on a rotation, an angle or three components [rad]; messages name it `name`.

    Raises:
        ProblemError: The bound is neither a positive number nor three of them.
    """
    try:
        values = np.array(entry, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.zeros(0)
    if values.shape not in ((), (3,)) or isinstance(entry, bool | str):
        raise ProblemError(
            f"{name} is {shown(entry)}; it must be one angle or bounds [x, y, z] on the components "
            "of the rotation vector [rad], .inf where free"
        )
    if not (values > 0).all():
        raise ProblemError(f"{name} is {shown(entry)} rad; it must be > 0, .inf where free")
    if values.ndim == 0:
        return float(values)
    x, y, z = values.tolist()
    return x, y, z
