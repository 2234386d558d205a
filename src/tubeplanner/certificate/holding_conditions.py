"""Conditions on what the arm holds: wrenches of contacts against their cones, for all t.

The wrench is computed from second derivatives of points of the part. With the contact's pose K, a
homogeneous matrix, a point r that is fixed in the contact's frame has the acceleration K'' r: in
the contact's axes, and less gravity, A r with a matrix A (3, 4). Over the part's masses dm,

    force = A int r dm,  moment = int r x (A r) dm

are linear in A, with the second moments int r r^T dm of the part. Joint j, a screw S_j in the
contact's frame, is nearer to the base than those after it:

    K^-1 K'' = sum_j q_j'' S_j + sum_j q_j'^2 S_j^2 + 2 sum_(i<j) q_i' q_j' S_i S_j

(the second derivative of the product of exponentials; Brockett, 1984).
"""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.enclosed_quantities import (
    derivative,
    point_majorant,
    product,
    tool_majorant,
)
from tubeplanner.certificate.enclosure import Quantity, enclosed
from tubeplanner.certificate.judged_motion import (
    RELATIVE,
    JudgedCondition,
    JudgedMotion,
    bracketed,
    not_required,
)
from tubeplanner.certificate.tube_visits import Visit, least_concave_margin
from tubeplanner.outcome import Location
from tubeplanner.robot.kinematics import cross_product
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.holding import Holding

# Error of enclosed margins, as a share of the nominal: tighter than the certificate's tolerance,
# so that the planner may use most of that.
_ENCLOSURE = 1e-8
AT_REST = ", at rest"


class HeldPart:
    """A part in the arm's hold: its wrench, and the margins of the J cones of its contact.

    Attributes:
        offsets: Of the cones, as shares of the nominal, shape (J,).
    """

    def __init__(self, robot: RobotModel, holding: Holding) -> None:
        self._robot, self._cones = robot, holding.cones
        self._body = robot.link_body[robot.tool_frame]
        contact = np.eye(4)
        contact[:3, :3], contact[:3, 3] = holding.axes, holding.contact.position
        self._contact = robot.link_placement[robot.tool_frame] @ contact
        part = holding.mass_properties
        center = np.append(holding.axes.T @ np.subtract(part.com, contact[:3, 3]), 1.0)
        # Second moments about the centre of mass, of which the inertia is the complement.
        inertia = holding.axes.T @ part.inertia_matrix() @ holding.axes
        spread = np.trace(inertia) / 2 * np.eye(3) - inertia
        self._moments = part.mass * np.outer(center, center)
        self._moments[:3, :3] += spread
        self._mass, self._lever = part.mass, float(np.linalg.norm(center[:3]))
        self._spread = float(abs(np.linalg.eigvalsh(spread)).sum())
        self._reach = float(np.linalg.norm((self._contact @ center)[:3]))
        # Of cones |x| <= t + offset, as shares of the nominal: three rows for x, one for t.
        self._rows = np.zeros((len(self._cones), 4, 6))
        for rows, cone in zip(self._rows, self._cones, strict=True):
            rows[: len(cone.across)] = cone.across / cone.nominal
            rows[3] = cone.along / cone.nominal
        self.offsets = np.array([cone.offset / cone.nominal for cone in self._cones])

    def margin(self, wrench: FloatArray, cone: IntArray) -> FloatArray:
        """Return margins at wrenches (..., R, 6), each in its cone (R,): a share of the nominal."""
        terms = np.einsum("...rk,rck->...rc", wrench, self._rows[cone])
        margin: FloatArray = terms[..., 3] + self.offsets[cone]
        return margin - np.linalg.norm(terms[..., :3], axis=-1)

    def cone_terms(self, wrench: FloatArray) -> FloatArray:
        """Return x and t of all J cones |x| <= t + offset for wrenches (..., 6): (..., J, 4)."""
        return np.einsum("...k,jck->...jc", wrench, self._rows)

    def judged(self, motion: JudgedMotion, name: str, *, is_at_rest: bool) -> JudgedCondition:
        """Judge the cones along a motion, or at rest everywhere on it.

        Args:
            motion: The motion.
            name: The contact's name in messages.
            is_at_rest: True: the arm may stand still anywhere.
        """
        # No cone's margin changes faster with a component of the wrench than this [1/N, 1/N m].
        rate = np.linalg.norm(self._rows[:, :3], axis=1) + abs(self._rows[:, 3])
        rate = rate.max(axis=0)
        with np.errstate(divide="ignore"):  # no cone minds some components
            tolerance = _ENCLOSURE / (6 * rate)
        wrench = enclosed(motion.trajectory, self.quantity(0 if is_at_rest else 2), tolerance)
        wrench = replace(wrench, error=(wrench.error @ rate)[:, None])
        # Every cone is kept during the whole motion.
        every = [Visit(k, 0.0, motion.trajectory.duration) for k in range(len(self._cones))]
        least = least_concave_margin(wrench, every, self.margin, np.ones(len(every)))
        what = f"{name} {self._cones[least.segment].name}{AT_REST if is_at_rest else ''}"
        location = Location(time=least.time, contact=what)
        return bracketed(least.lower_bound, least.attained, RELATIVE, location)

    def quantity(self, derivatives: int) -> Quantity:
        """Return the wrench at rest, of 0 derivatives, or at speed, of 2; c = 6 [N, N m]."""
        gravity = float(np.linalg.norm(self._robot.gravity))

        def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
            unit = tool_majorant(self._robot, joints).axis
            force = self._mass * gravity * unit
            moment = self._lever * force
            if derivatives:
                center = point_majorant(self._robot, joints, self._body, self._reach)
                pulled = self._mass * product(unit, derivative(center, 2)) / width**2
                # Of masses at both sides of the centre of mass, along the principal axes.
                turned = self._spread * product(unit, derivative(unit, 2)) / width**2
                force = force[: len(pulled)] + pulled
                moment = self._lever * force + turned[: len(pulled)]
            return np.stack([force] * 3 + [moment] * 3, axis=2)

        return Quantity(derivatives, self.wrench, majorant)

    def wrench(
        self, q: FloatArray, v: FloatArray | None = None, a: FloatArray | None = None
    ) -> FloatArray:
        """Return the tool's wrench on the part in the contact's axes, about its middle, (N, 6).

        Args:
            q: Configurations, shape (N, n).
            v: Velocities, shape (N, n); None: at rest.
            a: Accelerations, shape (N, n); None: at rest.
        """
        robot = self._robot
        rotation, position = robot.body_poses(q)
        axes = rotation[:, self._body] @ self._contact[:3, :3]
        change = np.zeros((len(q), 3, 4))
        if v is not None and a is not None:
            moved = np.flatnonzero(robot.carries[self._body])
            joint, factor = robot.body_joints[moved + 1], robot.body_rules[0][moved + 1]
            middle = rotation[:, self._body] @ self._contact[:3, 3] + position[:, self._body]
            axis = np.einsum("nmij,mj->nmi", rotation[:, moved + 1], robot.chain.axes[moved]) @ axes
            origin = (position[:, moved + 1] - middle[:, None]) @ axes
            turns = robot.body_is_revolute[moved + 1][:, None]
            screw = np.zeros((len(q), len(moved), 3, 4))
            for k, along in enumerate(np.eye(3)):
                screw[..., k] = cross_product(np.where(turns, axis, 0.0), along)
            screw[..., 3] = np.where(turns, cross_product(origin, axis), axis)
            moving = (factor * v[:, joint])[..., None, None] * screw
            twice = 2 * np.cumsum(moving, axis=1) - moving
            change = np.einsum("nm,nmij->nij", factor * a[:, joint], screw)
            change += (twice[..., :3] @ moving).sum(axis=1)
        change[..., 3] -= robot.gravity @ axes
        # int (A r)_i r_j dm, and int (A r)_i dm.
        moments = change @ self._moments
        moment = [moments[:, j, i] - moments[:, i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
        return np.column_stack([moments[..., 3], *moment])


def judge_holding(motion: JudgedMotion) -> JudgedCondition:
    """Judge the cones of all contacts, at speed and at rest: then at every lower speed, too.

    Run s times as fast, a wrench is G + s^2 W: between those at rest and at speed. Cones are
    convex.
    """
    holdings = motion.problem.holding
    judged = []
    for k, holding in enumerate(holdings):
        name = holding.kind if len(holdings) == 1 else f"{holding.kind} (holding[{k}])"
        part = HeldPart(motion.robot, holding)
        judged += [part.judged(motion, name, is_at_rest=each) for each in (False, True)]
    if not judged:
        return not_required(RELATIVE, "nothing is held")
    return min(judged, key=lambda condition: condition.margin or 0.0)
