"""The rigid arm in MuJoCo: bodies, joints, friction.

MuJoCo's Coulomb friction is soft about a velocity of zero. A joint that should stick creeps with
1e-4 of its acceleration without friction; friction is whole from the velocity that friction alone
would take away in about one integration step. It is the same in both directions; the difference
between the directions is added as a constant effort, which is exact.
"""

import copy
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.errors import OptionError, RobotError, not_installed
from tubeplanner.execution.plants import Plant
from tubeplanner.robot.model import RobotModel

_FRICTION_IMPEDANCE = 0.9999  # the most that MuJoCo takes
_FRICTION_STEPS = 2.0  # integration steps of its time constant: the least that MuJoCo takes
# Placeholder of inertial frames: MuJoCo compiles shortcuts for those equal to the bodies' frames.
_OBLIQUE = np.array([0.1, 0.2, 0.3]), np.array([0.8, 0.6, 0.0, 0.0])


def require_mujoco(what: str = "executing trajectories") -> None:
    """Raise OptionError, with the work that needs it, unless MuJoCo is installed."""
    try:
        import mujoco
    except ImportError:
        raise OptionError(not_installed("simulate", what, "MuJoCo 3")) from None
    _ = mujoco.MjSpec


class MujocoArm:
    """An arm with a state, which moves under efforts; made by `mujoco_arms`.

    Attributes:
        model: MuJoCo's model.
        degrees: Indices of the joints among MuJoCo's degrees of freedom, shape (n,).
        bias: Excess of friction forwards over the mean of both directions, shape (n,) [N m or N].
    """

    def __init__(self, model: Any, joints: Sequence[str], plant: Plant) -> None:
        """Give a copy of the arm's kinematic model the plant; joints are in group order."""
        import mujoco

        self._mujoco, self.model = mujoco, copy.copy(model)
        self.degrees = np.array([model.joint(name).dofadr[0] for name in joints])
        for body, inertia in enumerate(plant.bodies[1:], start=1):
            moments, axes = np.linalg.eigh(inertia.inertia)
            axes[:, 0] *= np.linalg.det(axes)  # a rotation, no reflection
            # By name: MuJoCo sorts bodies its own way.
            index = self.model.body(_body_name(body)).id
            self.model.body_mass[index] = inertia.mass
            self.model.body_ipos[index] = inertia.com
            self.model.body_inertia[index] = moments
            mujoco.mju_mat2Quat(self.model.body_iquat[index], axes.ravel())
        backwards, forwards = plant.motors.backwards_friction, plant.motors.forwards_friction
        self.model.dof_armature[self.degrees] = plant.motors.armature
        self.model.dof_damping[self.degrees] = plant.motors.viscous_friction
        self.model.dof_frictionloss[self.degrees] = (forwards + backwards) / 2
        self.bias = (forwards - backwards) / 2
        self._data = mujoco.MjData(self.model)
        # Sets the inverse inertias of the friction constraints, at joints at zero.
        mujoco.mj_setConst(self.model, self._data)

    @property
    def position(self) -> FloatArray:
        """Positions of the joints, shape (n,) [rad or m]."""
        return np.array(self._data.qpos[self.degrees])

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the joints, shape (n,) [rad/s or m/s]."""
        return np.array(self._data.qvel[self.degrees])

    @property
    def state(self) -> FloatArray:
        """Time, positions and velocities in MuJoCo's order, shape (1 + 2 n,)."""
        kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.empty(self._mujoco.mj_stateSize(self.model, kind))
        self._mujoco.mj_getState(self.model, self._data, state, kind)
        return state

    def place(self, q: FloatArray, v: FloatArray) -> None:
        """Set the positions and velocities of the joints, (n,) each, at time zero."""
        self._mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[self.degrees], self._data.qvel[self.degrees] = q, v

    def acceleration(self, effort: FloatArray) -> FloatArray:
        """Return the accelerations (n,) under efforts of the motors (n,) [rad/s^2 or m/s^2]."""
        self._data.qfrc_applied[self.degrees] = effort - self.bias
        self._mujoco.mj_forward(self.model, self._data)
        return np.array(self._data.qacc[self.degrees])

    def step(self, effort: FloatArray) -> None:
        """Integrate a step (Runge-Kutta, fourth order) under constant efforts (n,)."""
        self._data.qfrc_applied[self.degrees] = effort - self.bias
        self._mujoco.mj_step(self.model, self._data)


class ArmsTogether:
    """R arms of one robot, at least one, moved by one call in as many threads as processors.

    Each moves as it would alone; with friction, up to rounding: MuJoCo's solver, which finds the
    friction, then begins anew in every call.
    """

    def __init__(self, arms: Sequence[MujocoArm]) -> None:
        from mujoco import MjData, mjtState
        from mujoco.rollout import Rollout

        self._models = [arm.model for arm in arms]
        self._degrees, self._bias = arms[0].degrees, np.array([arm.bias for arm in arms])
        self._state = np.array([arm.state for arm in arms])
        self._input = int(mjtState.mjSTATE_QFRC_APPLIED)
        threads = min(len(arms), os.cpu_count() or 1)
        self._work_space = [MjData(arms[0].model) for _ in range(threads)]
        self._pool = Rollout(nthread=threads if threads > 1 else 0)

    def become(self, arms: Sequence[MujocoArm]) -> None:
        """Replace the arms by others of the same kinematics; positions and velocities stay."""
        self._models, self._bias = [arm.model for arm in arms], np.array([arm.bias for arm in arms])

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    @property
    def position(self) -> FloatArray:
        """Positions of the joints, shape (R, n) [rad or m]."""
        return np.array(self._state[:, 1 + self._degrees])

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the joints, shape (R, n) [rad/s or m/s]."""
        return np.array(self._state[:, 1 + len(self._degrees) + self._degrees])

    def move(self, effort: FloatArray, runs: IntArray) -> None:
        """Integrate S steps of some arms as `MujocoArm.step` does, under efforts (S, R, n)."""
        if len(runs) == 0:
            return
        steps = len(effort)
        applied = np.empty((len(runs), steps, len(self._degrees)))
        applied[:, :, self._degrees] = (effort - self._bias)[:, runs].swapaxes(0, 1)
        states = np.empty((len(runs), steps, self._state.shape[1]))
        self._pool.rollout(
            [self._models[run] for run in runs.tolist()],
            self._work_space,
            self._state[runs],
            applied,
            control_spec=self._input,
            skip_checks=True,
            nstep=steps,
            state=states,
            chunk_size=-(-len(runs) // len(self._work_space)),
        )
        self._state[runs] = states[:, -1]


def mujoco_arms(robot: RobotModel, plants: Sequence[Plant], step: float) -> list[MujocoArm]:
    """Return the arms of plants in MuJoCo, with the model's kinematics and an integration step [s].

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: A joint follows another joint.
    """
    require_mujoco()
    require_no_followers(robot)
    model = _kinematic_model(robot, step)
    return [MujocoArm(model, robot.joint_names, plant) for plant in plants]


def require_no_followers(robot: RobotModel) -> None:
    """Raise RobotError if a joint follows another joint, which MuJoCo does not model exactly."""
    multiplier, _ = robot.body_rules
    names = [robot.joint_names[joint] for joint in robot.body_joints[1:]]
    for name in robot.joint_names:
        if names.count(name) > 1:
            raise RobotError(
                f"joint '{name}' has {names.count(name) - 1} that follow it (<mimic>); MuJoCo "
                "ties joints by springs, so that such an arm is not simulated: remove <mimic>, "
                f"and lock what followed '{name}' by robot.locked_joints"
            )
    assert (multiplier == 1.0).all()


def _kinematic_model(robot: RobotModel, step: float) -> Any:
    """Return the compiled model; its masses are placeholders."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.compiler.degree = False
    disabled, option = mujoco.mjtDisableBit, spec.option
    option.timestep, option.gravity = step, robot.gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    option.disableflags = (
        disabled.mjDSBL_CONTACT | disabled.mjDSBL_LIMIT | disabled.mjDSBL_AUTORESET
    )
    option.tolerance = 1e-12  # of the solver, which finds the friction
    bodies, chain = [spec.worldbody], robot.chain
    for body in range(1, robot.body_count):
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, chain.rotation[body].ravel())
        added = bodies[chain.parents[body]].add_body(
            name=_body_name(body), pos=chain.position[body], quat=quaternion
        )
        added.mass, added.inertia, added.explicitinertial = 1.0, np.ones(3), True
        added.ipos, added.iquat = _OBLIQUE
        kind = "mjJNT_HINGE" if robot.body_is_revolute[body] else "mjJNT_SLIDE"
        joint = added.add_joint(
            name=robot.joint_names[robot.body_joints[body]],
            type=getattr(mujoco.mjtJoint, kind),
            axis=chain.axes[body - 1],
        )
        joint.solref_friction = [_FRICTION_STEPS * step, 1.0]
        joint.solimp_friction[:2] = _FRICTION_IMPEDANCE
        bodies.append(added)
    return spec.compile()


def _body_name(body: int) -> str:
    return f"body {body}"
