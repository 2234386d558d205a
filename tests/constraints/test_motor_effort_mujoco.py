"""Efforts of motors against MuJoCo's inverse dynamics, which reads the same URDF its own way.

Its Coulomb friction is soft about a velocity of zero: it is looked at where that is saturated.
"""

import mujoco
import numpy as np
import pytest

from cases import with_motors
from follower_arm import follower_arm
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.constraints.motor_effort import motor_effort

LEFT_OUT = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
STATE = mujoco.mjtConstraintState
SATURATED = (STATE.mjCNSTRSTATE_LINEARNEG, STATE.mjCNSTRSTATE_LINEARPOS)
JOINTS = ["lift", "first", "second", "slide", "wrist", "tip_joint", "side_joint"]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Seven joints that turn and slide in two branches: ours, and MuJoCo's with the same motors."""
    path = tmp_path_factory.mktemp("mujoco") / "arm.urdf"
    path.write_text(follower_arm({}))
    plain, rng = load_robot(path, "tip", joints=JOINTS), np.random.default_rng(6)
    armature, viscous, dry = rng.uniform(0.1, 2, (3, len(JOINTS)))
    robot = with_motors(
        plain,
        armature=armature,
        viscous_friction=viscous,
        backwards_friction=dry,
        forwards_friction=dry,
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= LEFT_OUT
    place = [model.joint(name).dofadr[0] for name in JOINTS]
    model.dof_armature[place] = armature
    model.dof_damping[place] = viscous
    model.dof_frictionloss[place] = dry
    return robot, model, place


def simulated(model, place, state):
    """Return the efforts of one state, and which joints' friction is saturated."""
    data = mujoco.MjData(model)
    for own, part in zip((data.qpos, data.qvel, data.qacc), state, strict=True):
        own[place] = part
    mujoco.mj_inverse(model, data)
    saturated = np.isin(data.efc_state, SATURATED)
    assert len(saturated) == len(place)
    return data.qfrc_inverse[place], saturated


def test_where_friction_is_saturated_efforts_are_mujocos(arms):
    robot, model, place = arms
    rng = np.random.default_rng(7)
    for _ in range(40):
        q, v, a = rng.uniform(-2, 2, (3, len(JOINTS)))
        v = np.sign(v) * (0.5 + abs(v))
        expected, saturated = simulated(model, place, (q, v, a))
        assert saturated.all()
        motion = JointTrajectory(JOINTS, [0.0, 0.05], np.stack([a / 2, v, q])[:, None])
        found = motor_effort(robot, motion, motion.at(np.zeros(1)))
        np.testing.assert_allclose(found[0], expected, rtol=1e-8, atol=1e-8)


def test_at_rest_what_remains_is_weight(arms):
    robot, model, place = arms
    q = np.random.default_rng(8).uniform(-1, 1, len(JOINTS))
    still = np.zeros(len(JOINTS))
    expected, saturated = simulated(model, place, (q, still, still))
    assert not saturated.any()
    motion = JointTrajectory(JOINTS, [0.0, 1.0], q[None, None])
    found = motor_effort(robot, motion, motion.at(np.zeros(1)))
    np.testing.assert_allclose(found[0], expected, atol=1e-8)
