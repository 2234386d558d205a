"""Held parts of executed motions: shares of what contacts carry, and parts as free bodies.

In the contact's axes the tool rests, and the part feels the wrench -W of its own inertia and weight
(`task.holding`) beside the contact's forces. So a model in MuJoCo has the contact and the part, not
the arm: the arm's model has the payload already. W is that of a part which has hardly moved, as
long as it is held.

Contacts are points with Coulomb friction (elliptic cones, no torsion, no rolling): the corners of a
foot, twelve points of a rim, 3 x 3 points of a pad. A cup pulls with its force until a point of the
rim is 1 mm away. The fingers of a gripper are coupled, and press with their force each.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import product
from math import ceil
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.mujoco_model import require_mujoco
from tubeplanner.execution.plants import Plant
from tubeplanner.execution.simulation import Execution
from tubeplanner.limits.holding_limit import HoldingUse, holding_uses
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.outcome import Location
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import ContactKind, Cup, Gripper, Holding, Liquid, Tray
from tubeplanner.task.problem import PlanningProblem

# ---- Shares of what contacts carry, executed.

# [s], over which wrenches are means: those of noise and of single control periods are over
# before a part has moved by a hundredth of a millimetre.
_AVERAGED = 0.004
_MOST = 1e3  # the largest share: beyond, nothing presses the part onto the tool


def executed_uses(
    problem: PlanningProblem, execution: Execution, run: int, safety: float | None = 1.0
) -> list[HoldingUse]:
    """Return the use of every contact at the instants of an executed motion.

    Wrenches are means over 4 ms in the contact's axes: those of instants inside a cone are inside.
    The contacts have the plant's friction, the parts its mass.

    Args:
        problem: The planning problem.
        execution: The execution.
        run: Index of the plant.
        safety: Of the contacts: errors are what a plan's safety is for; None: the plan's.
    """
    time = execution.time
    half = max(1, round(_AVERAGED / 2 / (time[1] - time[0]))) if len(time) > 1 else 1
    holdings = real_holdings(problem.holding, execution.plants[run], safety)
    uses = []
    for use in _uses_of_periods(problem, execution, run, holdings):
        wrench = np.pad(use.wrench, ((half - 1, half), (0, 0)), mode="edge")
        uses.append(use.under(sliding_window_view(wrench, 2 * half, axis=0).mean(axis=2)))
    return uses


def _uses_of_periods(
    problem: PlanningProblem, execution: Execution, run: int, holdings: Sequence[Holding]
) -> list[HoldingUse]:
    """Return the uses at rest where a motion begins, then in each of its K - 1 periods."""
    time, q, v = execution.time, execution.position[run], execution.velocity[run]
    still, acceleration = np.zeros_like(v[:1]), (v[1:] - v[:-1]) / (time[1:] - time[:-1])[:, None]
    moving = (q[1:] + q[:-1]) / 2, (v[1:] + v[:-1]) / 2, acceleration
    states = [np.vstack(each) for each in zip((q[:1], still, still), moving, strict=True)]
    return holding_uses(PathSamples(problem, np.stack(states)), holdings)


def real_holdings(
    holdings: Sequence[Holding], plant: Plant, safety: float | None = 1.0
) -> list[Holding]:
    """Return holdings with the plant's friction and mass, and a safety unless None."""
    result = []
    for holding in holdings:
        if not isinstance(holding.contact, Liquid):
            own = holding.contact.safety if safety is None else safety
            holding = replace(holding, contact=replace(holding.contact, safety=own))
            holding = holding.raised("friction", plant.contact_friction - 1)
            holding = holding.raised("mass", plant.part_mass - 1)
        result.append(holding)
    return result


def most_used(problem: PlanningProblem, execution: Execution, run: int) -> Extreme | None:
    """Return the largest share of what a contact carries that a run uses, at safety 1."""
    extremes = []
    for use in executed_uses(problem, execution, run):
        k = int(use.share.argmax())
        happens = f"{use.holding.kind} {use.holding.cones[use.cone[k]].name}"
        location = Location(time=float(execution.time[k]), contact=happens)
        extremes.append(Extreme(min(float(use.share[k]), _MOST), location))
    return max(extremes, key=lambda extreme: extreme.value, default=None)


# ---- Parts as free bodies in MuJoCo.

MOVED = 1e-3  # [m]: a part that moved farther has slipped
LOST = 1e-2  # [m]: a part that moved farther is lost
_GONE = 1.0  # [m]: a part that moved so far is not followed any more
_STEP = 1e-4  # [s]
_SETTLING = 0.1  # [s], before the motion begins
# [s], time constant of contacts: of 1 kg on four feet they yield by less than 0.01 mm.
_STIFFNESS = 1e-3
_BREAK = 1e-3  # [m]: a rim that far away leaks
_CHUNK = 0.01  # [s], after which is seen whether a vacuum is broken
_RIM, _PAD = 12, 3  # points of a rim, and of a pad along each side
_RATIO, _IMPEDANCE = 10.0, (0.95, 0.99, 1e-4, 0.5, 2.0)
_POINT = 1e-3  # [m], radius of a contact's points
_BALL = 0.25  # radius of the ball whose inertia a part has at least, of the contact's size


def parts_moved(
    problem: PlanningProblem,
    execution: Execution,
    checkpoint: Callable[[], None] = lambda: None,
) -> list[Extreme] | None:
    """Return how far the held part of each run moved in the tool, of several the farthest [m].

    None if no part is held; liquids are none. It is the distance of a point of the contact from
    where it settled before the motion, at most 1 m; with the time when it passed 1 mm, or else of
    the largest distance. The plants have the friction and the parts' masses.

    Raises:
        OptionError: MuJoCo is not installed.
    """
    require_mujoco("following held parts")
    farthest: list[Extreme] | None = None
    time = execution.time
    for holding in problem.holding:
        if isinstance(holding.contact, Liquid):
            continue
        parts, wrenches = [], []
        for run, plant in enumerate(execution.plants):
            (real,) = real_holdings([holding], plant)
            parts.append(_with_inertia(real))
            (use,) = _uses_of_periods(problem, execution, run, parts[-1:])
            wrenches.append(use.wrench)
        moved = _moved(parts, np.array(wrenches), float(time[1] - time[0]), checkpoint)
        slipped = moved > MOVED
        at = np.where(slipped.any(axis=1), slipped.argmax(axis=1), moved.argmax(axis=1))
        location = [Location(time=float(time[i]), contact=holding.kind) for i in at]
        extremes = [Extreme(float(row.max()), at) for row, at in zip(moved, location, strict=True)]
        farthest = [
            max(pair, key=lambda extreme: extreme.value)
            for pair in zip(farthest or extremes, extremes, strict=True)
        ]
    return farthest


def _moved(
    parts: Sequence[Holding], wrench: FloatArray, period: float, checkpoint: Callable[[], None]
) -> FloatArray:
    """Return the largest distances of contact points from where they settled, (R, K) [m].

    Args:
        parts: Part and contact of each run.
        wrench: Of the tool on parts that do not move: at rest, then in each of K - 1 periods,
            shape (R, K, 6) [N, N m].
        period: Duration of a period [s].
        checkpoint: Called every 10 ms of the motion.
    """
    contact, points = parts[0].contact, _points(parts[0].contact)
    steps = ceil(period / _STEP - 1e-9)
    bodies = _Bodies([_model(part, points, period / steps) for part in parts], steps)
    runs, count = wrench.shape[:2]
    force = np.zeros((runs, count, bodies.freedoms))
    force[:, :, :6] = -wrench
    if isinstance(contact, Gripper):
        force[:, :, 6:] = contact.force * np.array([-1.0, 1.0])
    if isinstance(contact, Cup):
        force[:, :, 2] -= contact.force
    everyone = np.arange(runs)
    moved = np.zeros((runs, count))
    with closing(bodies):
        settled = bodies.move(force[:, :1].repeat(ceil(_SETTLING / period), axis=1), everyone)
        rest = _placed(points, settled[:, -1:])
        is_held, chunk = np.full(runs, True), max(1, round(_CHUNK / period))
        for first in range(1, count, chunk):
            checkpoint()
            followed = np.flatnonzero(moved.max(axis=1) < _GONE)
            if not followed.size:
                break
            span = slice(first, first + chunk)
            here = _placed(points, bodies.move(force[followed, span], followed))
            moved[followed, span] = np.linalg.norm(here - rest[followed], axis=3).max(axis=2)
            if isinstance(contact, Cup):
                leaks = is_held[followed] & (here[..., 2] > _BREAK).any(axis=(1, 2))
                force[followed[leaks], :, 2] += contact.force
                is_held[followed[leaks]] = False
    return np.minimum(moved, _GONE)


def _size(contact: ContactKind) -> float:
    """Return the least radius or half length of a contact [m]."""
    if isinstance(contact, Cup):
        return contact.radius
    assert isinstance(contact, (Tray, Gripper))
    lengths = contact.foot if isinstance(contact, Tray) else contact.pad
    return float(np.min(lengths)) / (1 if isinstance(lengths, (int, float)) else 2)


def _points(contact: ContactKind) -> FloatArray:
    """Return the points of a contact in its axes, shape (P, 3) [m]."""
    if isinstance(contact, Gripper):
        thirds = np.linspace(-1, 1, _PAD) * (_PAD - 1) / _PAD
        x, y = np.array(contact.pad) / 2
        return np.array(
            [[a * x, b * y, c * min(x, y)] for a, b, c in product(thirds, thirds, (-1, 1))]
        )
    if isinstance(contact, Tray) and isinstance(contact.foot, tuple):
        x, y = np.array(contact.foot) / 2
        return np.array([[a * x, b * y, 0.0] for a, b in product((-1, 1), repeat=2)])
    angle = 2 * np.pi * np.arange(_RIM) / _RIM
    return _size(contact) * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])


def _placed(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Return points (P, 3) of bodies with poses (R, K, 7), shape (R, K, P, 3) [m]."""
    position, w, u = pose[..., None, :3], pose[..., None, 3:4], pose[..., None, 4:7]
    turned = np.cross(u, points)
    placed: FloatArray = position + points + 2 * (w * turned + np.cross(u, turned))
    return placed


def _with_inertia(holding: Holding) -> Holding:
    """Return a holding whose part has the inertia of a solid body: at least that of a small ball.

    No principal moment of a solid body exceeds the sum of the others.
    """
    part = holding.mass_properties
    moments, axes = np.linalg.eigh(part.inertia_matrix())
    moments = np.maximum(moments, 0.4 * part.mass * (_BALL * _size(holding.contact)) ** 2)
    moments[:2] += max(moments[2] * (1 + 1e-6) - moments[:2].sum(), 0.0) / 2
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = ((axes * moments) @ axes.T).tolist()
    return replace(holding, part=Payload(part.mass, part.com, (xx, yy, zz, xy, xz, yz)))


def _model(holding: Holding, points: FloatArray, step: float) -> Any:
    """Return the compiled model of a part on its contact; its world is the contact's frame."""
    import mujoco

    contact, part, axes = holding.contact, holding.mass_properties, holding.axes
    assert not isinstance(contact, Liquid)
    spec = mujoco.MjSpec()
    option, kinds = spec.option, mujoco.mjtGeom
    option.timestep, option.gravity, option.tolerance = step, np.zeros(3), 1e-10
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, _RATIO
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    surface: dict[str, Any] = {"friction": [contact.friction, 0.0, 0.0], "condim": 3}
    surface |= {"solref": [_STIFFNESS, 1.0], "solimp": _IMPEDANCE}
    body = spec.worldbody.add_body(name="part")
    body.add_freejoint()
    moments, principal = np.linalg.eigh(axes.T @ part.inertia_matrix() @ axes)
    principal[:, 0] *= np.linalg.det(principal)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, principal.ravel())
    body.mass, body.inertia, body.explicitinertial = part.mass, moments, True
    body.ipos, body.iquat = np.subtract(part.com, contact.position) @ axes, quaternion
    for x, y, z in points.tolist():
        inside = z + _POINT * (1.0 if z <= 0 else -1.0)
        ball: dict[str, Any] = {"type": kinds.mjGEOM_SPHERE, "size": [_POINT, 0, 0]}
        body.add_geom(pos=[x, y, inside], **ball, contype=1, conaffinity=2, **surface)
    surface |= {"contype": 2, "conaffinity": 1}
    if not isinstance(contact, Gripper):
        spec.worldbody.add_geom(type=kinds.mjGEOM_PLANE, size=[1, 1, 1], **surface)
        return spec.compile()
    half = float(points[:, 2].max())
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        pad = spec.worldbody.add_body(name=name, pos=[0, 0, side * 2 * half])
        pad.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        pad.mass, pad.inertia, pad.explicitinertial = 0.1 * part.mass, np.full(3, 1e-3), True
        pad.add_geom(type=kinds.mjGEOM_BOX, size=[1, 1, half], **surface)
    coupling: dict[str, Any] = {"type": mujoco.mjtEq.mjEQ_JOINT, "name1": "upper", "name2": "lower"}
    coupling |= {"objtype": mujoco.mjtObj.mjOBJ_JOINT, "data": [0, -1, *(10 * [0])]}
    spec.add_equality(**coupling, solref=[_STIFFNESS, 1.0], solimp=_IMPEDANCE)
    return spec.compile()


class _Bodies:
    """The parts of R runs, moved by one call in as many threads as processors.

    Attributes:
        freedoms: Number of degrees of freedom of each: six of the part, those of pads.
    """

    def __init__(self, models: Sequence[Any], steps: int) -> None:
        """Take one model per run, each in its rest position, and the steps of a period."""
        from mujoco import MjData, mjtState
        from mujoco.rollout import Rollout

        self._models, self._steps, self.freedoms = models, steps, int(models[0].nv)
        self._input = int(mjtState.mjSTATE_QFRC_APPLIED)
        threads = min(len(models), os.cpu_count() or 1)
        self._work_space = [MjData(models[0]) for _ in range(threads)]
        self._pool = Rollout(nthread=threads if threads > 1 else 0)
        at_rest = np.concatenate([[0.0], models[0].qpos0, np.zeros(self.freedoms)])
        self._state = np.tile(at_rest, (len(models), 1))

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    def move(self, force: FloatArray, runs: IntArray) -> FloatArray:
        """Move some runs under forces (R, K, freedoms), and return the poses of parts (R, K, 7)."""
        force = force.repeat(self._steps, axis=1)
        states = np.empty((*force.shape[:2], self._state.shape[1]))
        self._pool.rollout(
            [self._models[run] for run in runs.tolist()],
            self._work_space,
            self._state[runs],
            force,
            control_spec=self._input,
            skip_checks=True,
            nstep=force.shape[1],
            state=states,
            chunk_size=-(-len(runs) // len(self._work_space)),
        )
        self._state[runs] = states[:, -1]
        return states[:, self._steps - 1 :: self._steps, 1:8]
