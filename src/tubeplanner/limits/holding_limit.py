"""HoldingLimit: the cones of held parts as a limit on the speed; wrenches at samples of a path.

Run at the speed s, the wrench of the tool on a part is W = M (z0 + s^2 z2). z has twelve numbers in
the tool centre point's axes: the acceleration of that point less gravity, the angular acceleration,
and the six products of the angular velocity. M is the same everywhere; z0 is gravity alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.limits.path_samples import LimitKey, PathSamples
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.task.holding import Holding, loss_at_rest
from tubeplanner.task.motion import MotionSection
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import json_value
from tubeplanner.trajectory.joint_trajectory import TrajectorySamples

# Rows and columns of the products of angular velocities.
_ROWS, _COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
_PRODUCTS = len(_ROWS)
_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_j, _i, _k] = 1.0, -1.0


def wrench_map(holding: Holding, offset: FloatArray) -> FloatArray:
    """Return the matrix M from the twelve numbers of the tool's motion to the wrench, (6, 12).

    Args:
        holding: Part and contact, in the tool frame.
        offset: Pose of the tool centre point in the tool frame, shape (4, 4).
    """
    rotation, origin = offset[:3, :3], offset[:3, 3]
    part, axes = holding.mass_properties, rotation.T @ holding.axes
    com, middle = (rotation.T @ (x - origin) for x in (part.com, holding.contact.position))
    inertia = rotation.T @ part.inertia_matrix() @ rotation
    # The products as symmetric matrices: w w^T.
    products = np.zeros((3, 3, _PRODUCTS))
    products[_ROWS, _COLUMNS, range(_PRODUCTS)] = 1.0
    products[_COLUMNS, _ROWS, range(_PRODUCTS)] = 1.0
    along, traces = np.einsum("ijk,j->ik", products, com), np.einsum("iik->k", products)
    turning = _cross_matrix(com)
    acceleration = np.hstack([np.eye(3), -turning, along - np.outer(com, traces)])
    force = part.mass * acceleration
    gyroscopic = np.einsum("ijk,kl,jlm->im", _LEVI_CIVITA, inertia, products)
    moment = np.hstack([np.zeros((3, 3)), inertia, gyroscopic])
    moment += _cross_matrix(com - middle) @ force
    return np.vstack([axes.T @ force, axes.T @ moment])


def _cross_matrix(x: FloatArray) -> FloatArray:
    """Return the matrix of a vector product with x (3,) from the left, shape (3, 3)."""
    return np.einsum("ijk,j->ik", _LEVI_CIVITA, x)


@dataclass(frozen=True, eq=False)
class ConeParts:
    """J cones at N samples: |x0 + s^2 x2| <= t0 + s^2 t2, as shares of the nominal."""

    x0: FloatArray  # shape (N, J, 3)
    x2: FloatArray  # shape (N, J, 3)
    t0: FloatArray  # shape (N, J)
    t2: FloatArray  # shape (N, J)

    @property
    def vectors(self) -> FloatArray:
        """The vectors (x, t) at rest and by s^2, shape (2, N, J, 4)."""
        x, t = np.stack([self.x0, self.x2]), np.stack([self.t0, self.t2])
        return np.concatenate([x, t[..., None]], axis=-1)

    def largest_squares(self) -> FloatArray:
        """Return the largest s^2 inside each cone, shape (N, J): 0 or inf where none or any is."""
        x0, x2, t0, t2 = self.x0, self.x2, self.t0, self.t2
        a = (x2**2).sum(axis=2) - t2**2
        b = (x0 * x2).sum(axis=2) - t0 * t2
        rest = np.linalg.norm(x0, axis=2)
        c = (rest - t0) * (rest + t0)
        root = b**2 - a * c
        with np.errstate(divide="ignore", invalid="ignore"):
            square = -c / (b + np.sqrt(root))
        square = np.where((root >= 0) & (square > 0), square, np.inf)
        return np.where(rest > t0, 0.0, square)

    def directions(self, square: FloatArray) -> FloatArray:
        """Return the unit vectors of x at s^2 (N, J), shape (N, J, 3); zero where x is."""
        infinite = np.isinf(square)
        x = self.x0 + np.where(infinite, 1.0, square)[..., None] * self.x2
        size = np.linalg.norm(x, axis=2, keepdims=True)
        return np.divide(x, size, out=np.zeros_like(x), where=size > 0)


class HoldingLimit:
    """A `SpeedLimit` on J cones of held parts: the tangent half space of each.

    The tangent touches the cone where the sample, run faster and faster, leaves the cone.

    Attributes:
        names: What happens outside each cone, J of them: "tray slides".
        least_at_rest: Samples outside a cone at rest count as inside by this share of the nominal;
            None: no speed is slow enough for them.
    """

    kind = "holding"
    order = 2
    signs = (1.0,)

    def __init__(
        self,
        problem: PlanningProblem,
        least_at_rest: float | None = None,
        holdings: Sequence[Holding] | None = None,
    ) -> None:
        """Take the parts that a problem's tool holds, or others in their place."""
        self.least_at_rest = least_at_rest
        self._problem = problem
        self._holdings = problem.holding if holdings is None else holdings
        offset = problem.robot.tool_offset.placement
        across, along, offsets, first = [], [], [], []
        keys: list[LimitKey] = []
        self.names: list[str] = []
        for k, holding in enumerate(self._holdings):
            first += len(holding.cones) * [len(keys)]
            keys += (LimitKey(self.kind, contact=k, parameter=name) for name in holding.priced)
            by_motion = wrench_map(holding, offset)
            for cone in holding.cones:
                rows = np.zeros((3, 12))
                rows[: len(cone.across)] = cone.across @ by_motion
                across.append(rows / cone.nominal)
                along.append(cone.along @ by_motion / cone.nominal)
                offsets.append(cone.offset / cone.nominal)
                self.names.append(f"{holding.kind} {cone.name}")
        self.keys = tuple(keys)
        self._first = np.array(first, dtype=np.int64)
        self._across, self._along = np.array(across), np.array(along)
        self._offset = np.array(offsets)

    def leading(self, use: FloatArray) -> BoolArray:
        """Return True for the most used of the cones of each contact and name, shape (N, J).

        Those of one name are nearly parallel: a step's program has one of them at a sample, others
        join where a step leaves them.
        """
        result = np.zeros(use.shape, dtype=bool)
        kinds = list(zip(self._first.tolist(), self.names, strict=True))
        for kind in dict.fromkeys(kinds):
            own = np.array([k for k, each in enumerate(kinds) if each == kind])
            result[np.arange(len(use)), own[use[:, own].argmax(axis=1)]] = True
        return result

    def raised(self, key: LimitKey, fraction: float) -> "HoldingLimit":
        """Return the limit with a number of a contact or the part's mass larger by a fraction."""
        holdings = list(self._holdings)
        assert key.contact is not None and key.parameter is not None
        holdings[key.contact] = holdings[key.contact].raised(key.parameter, fraction)
        return HoldingLimit(self._problem, self.least_at_rest, holdings)

    def parts(self, at: PathSamples) -> ConeParts:
        """Return the cones at samples."""
        gravity, motion = _gravity(at), _numbers(at.tool_motion)
        return ConeParts(
            np.einsum("jki,ni->njk", self._across[:, :, :3], gravity),
            np.einsum("jki,ni->njk", self._across, motion),
            gravity @ self._along[:, :3].T + self._offset,
            motion @ self._along.T,
        )

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the shares that tangents of the cones leave, 1 on the cone."""
        parts = self._slowed(at)
        e = self._tangents(at)
        return SpeedPolynomial(
            {
                0: 1 + (e * parts.x0).sum(axis=2) - parts.t0,
                2: (e * parts.x2).sum(axis=2) - parts.t2,
            }
        )

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the shares by the path, tangents fixed, (N, J, n) each."""
        normal = np.einsum("njk,jki->nji", self._tangents(at), self._across) - self._along
        moving, still = self._motion_by_path(at), self._gravity_by_path(at)
        change = {k: speed**2 * (normal @ by) for k, by in enumerate(moving)}
        change[0] += normal[:, :, :3] @ still
        return change

    def vectors_by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return the derivatives of (x, t) at a speed by the path, (N, J, 4, n) each."""
        change = {
            k: speed**2 * np.einsum("jki,nil->njkl", self._vectors, by)
            for k, by in enumerate(self._motion_by_path(at))
        }
        change[0] += self.at_rest_by_path(at)
        return change

    def at_rest_by_path(self, at: PathSamples) -> FloatArray:
        """Return the derivatives of (x, t) at rest by q, (N, J, 4, n)."""
        return np.einsum("jki,nil->njkl", self._vectors[:, :, :3], self._gravity_by_path(at))

    @cached_property
    def _vectors(self) -> FloatArray:
        """The matrices from z to (x, t), shape (J, 4, 12)."""
        return np.concatenate([self._across, self._along[:, None]], axis=1)

    def _motion_by_path(self, at: PathSamples) -> FloatArray:
        """Return the derivatives of z2 by q, q' and q'', shape (3, N, 12, n)."""
        by = at.tool_motion_derivatives
        spin, by_spin = at.tool_motion[:, 3:6], by[:, :, 3:6]
        products = (
            spin[:, _ROWS, None] * by_spin[:, :, _COLUMNS]
            + spin[:, _COLUMNS, None] * by_spin[:, :, _ROWS]
        )
        return np.concatenate([by[:, :, :3], by[:, :, 6:], products], axis=2)

    def _gravity_by_path(self, at: PathSamples) -> FloatArray:
        """Return the derivatives of z0 by q, shape (N, 3, n)."""
        rotation, _ = at.tool_pose
        turning = rotation.swapaxes(1, 2) @ at.tool_jacobian[:, 3:]
        return np.cross(turning, -_gravity(at)[:, :, None], axis=1)

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of the first key of each cone's contact, shape (1, J)."""
        return self._first[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of the sample that leaves a cone at rest by most."""
        parts = self.parts(at)
        excess = np.linalg.norm(parts.x0, axis=2) - parts.t0
        sample, cone = np.unravel_index(int(excess.argmax()), excess.shape)
        q, problem = at.position[sample], at.problem
        reason = loss_at_rest(problem.robot, problem.holding, q) or "the held part is lost at rest"
        return Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"{reason}; keep the tool more level (tube.orientations and tube.rotation_tolerance), "
            "or hold the part better",
            Location(contact=f"{self.names[cone]}, at rest").at(at.tool_pose[1][sample]),
            configuration=q,
        )

    def _slowed(self, at: PathSamples) -> ConeParts:
        """Return the cones at samples, each holding at rest if they are to count so."""
        parts = self.parts(at)
        if self.least_at_rest is None:
            return parts
        least = np.linalg.norm(parts.x0, axis=2) + self.least_at_rest
        return replace(parts, t0=np.maximum(parts.t0, least))

    def _tangents(self, at: PathSamples) -> FloatArray:
        """Return the unit vectors of x where samples leave the cones, shape (N, J, 3)."""
        parts = self._slowed(at)
        return parts.directions(parts.largest_squares())


def _gravity(at: PathSamples) -> FloatArray:
    """Return the acceleration at rest less gravity, in tool axes, shape (N, 3) [m/s^2]."""
    rotation, _ = at.tool_pose
    return -at.problem.robot.gravity @ rotation


def _numbers(motion: FloatArray) -> FloatArray:
    """Return the twelve numbers of the tool's motions (N, 9), shape (N, 12)."""
    spin = motion[:, 3:6]
    return np.hstack([motion[:, :3], motion[:, 6:], spin[:, _ROWS] * spin[:, _COLUMNS]])


# ---- Shares of what contacts carry.

_SAMPLES, _MIN_PER_PIECE = 1000, 12


@dataclass(frozen=True, eq=False)
class HoldingUse:
    """The share of what a contact carries that is used at N samples; 1: the part may be lost."""

    holding: Holding
    share: FloatArray  # at speed, shape (N,)
    cone: IntArray  # index of the cone with that share, shape (N,)
    share_at_rest: FloatArray  # standing still in each configuration, shape (N,)
    wrench: FloatArray  # of the tool on the part, in the contact's axes, (N, 6) [N, N m]

    @property
    def apparent_gravity(self) -> FloatArray:
        """Gravity less the acceleration of the centre of mass, in the contact's axes, (N, 3)."""
        gravity: FloatArray = -self.wrench[:, :3] / self.holding.mass_properties.mass
        return gravity

    def under(self, wrench: FloatArray) -> "HoldingUse":
        """Return the use of the contact in the same configurations under other wrenches, (N, 6)."""
        shares = np.array([cone.share(wrench) for cone in self.holding.cones])
        return replace(self, share=shares.max(axis=0), cone=shares.argmax(axis=0), wrench=wrench)


def holding_uses(at: PathSamples, holdings: Sequence[Holding] | None = None) -> list[HoldingUse]:
    """Return the use of every contact at samples, run at a speed of 1.

    Of the contacts of the samples' problem, or of others in their place.
    """
    still = np.pad(_gravity(at), ((0, 0), (0, 9)))
    moving = still + _numbers(at.tool_motion)
    uses = []
    for holding in at.problem.holding if holdings is None else holdings:
        to_wrench = wrench_map(holding, at.problem.robot.tool_offset.placement).T
        wrench, rest = moving @ to_wrench, still @ to_wrench
        shares = np.array([cone.share(wrench) for cone in holding.cones])
        at_rest = np.max([cone.share(rest) for cone in holding.cones], axis=0)
        uses.append(HoldingUse(holding, shares.max(axis=0), shares.argmax(axis=0), at_rest, wrench))
    return uses


@dataclass(frozen=True)
class HoldingPeak:
    """The largest share of what a contact carries that a motion uses.

    Attributes:
        kind: "cup", "tray", "gripper" or "liquid".
        share: At speed; 1 is all that it carries, safety included.
        happens: What the part does beyond: "slides", "tips" or "spills".
        time: Of the share [s].
        share_at_rest: Standing still anywhere on the path.
    """

    kind: str
    share: float
    happens: str
    time: float
    share_at_rest: float

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON value; shares beyond any are the word ".inf"."""
        fields: dict[str, Any] = json_value(asdict(self))
        return fields

    def __str__(self) -> str:
        return (
            f"{self.kind} at {100 * self.share:.1f} % of what it carries (then it {self.happens}, "
            f"t = {self.time:.4f} s), at rest {100 * self.share_at_rest:.1f} %"
        )


def holding_peaks(sections: Iterable[MotionSection]) -> list[HoldingPeak]:
    """Return the peak of every contact over a motion, at 1,000 samples or more of each section.

    A contact of several sections has the highest peak of all.
    """
    peaks: dict[str, HoldingPeak] = {}
    for section in sections:
        count = max(_MIN_PER_PIECE, -(-_SAMPLES // len(section.trajectory.widths)))
        samples = section.trajectory.per_piece(count)
        for use in holding_of_section(section, samples):
            top, contact = int(use.share.argmax()), use.holding
            share, time = float(use.share[top]), section.begin + float(samples.time[top])
            happens, at_rest = contact.cones[use.cone[top]].name, float(use.share_at_rest.max())
            peak = HoldingPeak(contact.kind, share, happens, time, at_rest)
            other = peaks.get(repr(contact), peak)
            higher = peak if peak.share > other.share else other
            at_rest = max(at_rest, other.share_at_rest)
            peaks[repr(contact)] = replace(higher, share_at_rest=at_rest)
    return list(peaks.values())


def holding_of_section(section: MotionSection, samples: TrajectorySamples) -> list[HoldingUse]:
    """Return the use of every contact at samples of a section's trajectory."""
    states = np.stack([samples.position, samples.velocity, samples.acceleration])
    return holding_uses(PathSamples(section.problem, states)) if section.problem.holding else []
