"""The ROS file is what ROS 2 takes: loaded into the message's own type, serialised, read back."""

from itertools import product

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from cases import slow_but
from tubeplanner.files.export import trajectory_ros
from tubeplanner.files.export_samples import samples_for_export

TYPE = "trajectory_msgs/msg/JointTrajectory"
RELEASES = (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY)
NAMES = ("ur5/over_the_wall", "panda/between_shelves")
QUICK = ((RELEASES[0], NAMES[1]), (RELEASES[1], NAMES[0]))


def as_message(store, fields):
    """Return a JointTrajectory as rosidl's set_message_fields makes it from YAML."""
    types = store.types
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{name: np.array(point[name]) for name in ("positions", "velocities")},
            accelerations=np.array(point["accelerations"]),
            effort=np.array([]),
            time_from_start=types["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in fields["points"]
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return types[TYPE](header=header, joint_names=fields["joint_names"], points=points)


@pytest.mark.parametrize(("release", "name"), slow_but(QUICK, product(RELEASES, NAMES)))
def test_the_file_is_a_ros_2_message_and_survives_the_wire(release, name, stored):
    problem, trajectory = stored(name, "refinement")
    sampled = samples_for_export(problem, trajectory, 500)
    names, samples = problem.robot.joint_names, sampled.samples
    fields = YAML(typ="safe", pure=True).load(trajectory_ros(names, samples, sampled.note))
    known = {"joint_names", "positions", "velocities", "accelerations", "time_from_start"}
    assert set(fields) | set(fields["points"][0]) == known | {"points"}
    store = get_typestore(release)
    wire = store.serialize_cdr(as_message(store, fields), TYPE)
    read = store.deserialize_cdr(wire, TYPE)
    assert read.joint_names == list(names)
    for ours, field in (
        (samples.position, "positions"),
        (samples.velocity, "velocities"),
        (samples.acceleration, "accelerations"),
    ):
        theirs = np.array([getattr(point, field) for point in read.points])
        np.testing.assert_array_equal(theirs, ours)
    stamps = [point.time_from_start for point in read.points]
    assert all(0 <= stamp.nanosec < 10**9 for stamp in stamps)
    time = np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps])
    np.testing.assert_allclose(time, samples.time, atol=5.1e-10)
    assert (np.diff(time) > 0).all()
