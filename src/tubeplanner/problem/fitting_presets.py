"""The bundled presets that are for a robot."""

import numpy as np

from tubeplanner.problem.presets import read_preset
from tubeplanner.resources import bundled_presets
from tubeplanner.robot.robot_model import RobotModel

_COMPARED = ("velocity", "effort")


def fitting_presets(robot: RobotModel) -> list[str]:
    """Return the names of bundled presets whose velocities and efforts are those of a URDF.

    What gives neither, motors alone, fits no robot for certain.
    """
    joints = [robot.urdf.joints[name] for name in robot.urdf.chain(robot.tool_frame)]
    joints = [joint for joint in joints if joint.name in robot.joint_names]
    names = [joint.name for joint in joints]
    fitting = []
    for preset in bundled_presets():
        layer = read_preset(preset)
        if layer.joint_count != len(joints):
            continue
        given = {what: layer.limits.by_name(what, names, preset) for what in _COMPARED}
        if all(
            np.isclose(given[what].get(joint.name, np.nan), getattr(joint, what) or np.nan)
            for what in _COMPARED
            for joint in joints
        ):
            fitting.append(preset)
    return fitting
