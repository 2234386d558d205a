"""Columns of recorded joints: every name that recorders give them, and no guess between two."""

import pytest

from tubeplanner.errors import TrajectoryError
from tubeplanner.trajectory.csv_columns import joint_columns

JOINTS = ("elbow", "wrist_1")
FORMS = {
    "ours": "{}.position",
    "bare": "{}",
    "PlotJuggler": "/joint_states/{}/position",
    "a path": "{}/position",
    "one word": "{}_position",
    "one word, turned": "position_{}",
    "an array by name": "/robot/joint_states/position/{}",
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("time", ["time", "t", "Timestamp", "#time", "# Time", "__time"])
def test_every_form_is_read(form, time):
    columns = [form.format(joint) for joint in JOINTS]
    read = joint_columns([*columns, time], JOINTS)
    assert (read.time, read.joints, read.ignored) == (time, list(JOINTS), ())
    assert read.tables == {"position": columns}


def test_velocities_and_accelerations_come_along_and_others_are_named():
    columns = {quantity: f"/js/elbow/{quantity}" for quantity in ("position", "velocity")}
    header = ["t", *columns.values(), "/js/elbow/effort", "/js/header/seq", "tool/elbow"]
    read = joint_columns(header, JOINTS)
    assert read.joints == ["elbow"]
    assert read.tables == {quantity: [column] for quantity, column in columns.items()}
    assert read.ignored == ("/js/elbow/effort", "/js/header/seq", "tool/elbow")


def test_efforts_of_our_own_files_are_no_surprise():
    read = joint_columns(["time", "elbow.position", "elbow.effort", "grip.effort"])
    assert read.ignored == ("grip.effort",)


def test_other_joints_of_our_own_files_are_read_too():
    read = joint_columns(["time", "grip.position", "elbow.position"], JOINTS)
    assert read.joints == ["grip", "elbow"]


def test_the_time_of_our_own_files_is_preferred():
    assert joint_columns(["t", "time", "elbow"], JOINTS).time == "time"


def test_a_joint_may_be_called_t():
    read = joint_columns(["time_stamp", "timestamp", "t"], ["t"])
    assert (read.time, read.joints, read.ignored) == ("timestamp", ["t"], ("time_stamp",))


FAULTS = {
    "two positions": (["t", "elbow", "elbow_position"], "'elbow' and 'elbow_position' are both"),
    "two paths": (["t", "/a/elbow/position", "/b/elbow/position"], "are both the position of 'el"),
    "a path and none": (
        ["t", "elbow/position", "a/elbow_position"],
        "are both the position of 'el",
    ),
    "two times": (["t", "timestamp", "elbow"], "'t' and 'timestamp' may all be times; leave out"),
    "no time": (["clock", "elbow"], r"named as the joints: elbow, wrist_1\); its columns are 'clo"),
    "no joint": (["t", "knee"], "needs the columns time and JOINT.position"),
    "twice": (["t", "elbow", "x", "x"], "the column 'x' is there 2 times"),
    "half": (["t", "elbow", "wrist_1", "elbow_velocity"], "velocity is missing for wrist_1"),
}


@pytest.mark.parametrize(("header", "message"), FAULTS.values(), ids=FAULTS)
def test_what_cannot_be_told_is_refused(header, message):
    with pytest.raises(TrajectoryError, match=message):
        joint_columns(header, JOINTS)


def test_without_joints_only_our_own_names_are_known():
    with pytest.raises(TrajectoryError, match=r"needs the columns time and JOINT\.position; its"):
        joint_columns(["time", "elbow", "wrist_1_position"])
