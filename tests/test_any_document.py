"""Any document either loads or raises one of our errors, never another library's."""

import copy
import json

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tubeplanner import TubePlannerError, parse_problem
from tubeplanner.problem.problem_fields import read_problem_fields
from tubeplanner.problem.problem_format import (
    ProblemFields,
    RobotFields,
    TubeFields,
)
from tubeplanner.robot.urdf import read_urdf

BASE = {
    "robot": {
        "urdf": "example:two_link",
        "tool_frame": "hand",
        "gravity": [0, 0, 0],
        "limits": {"velocity": {"joint1": 50.0, "joint2": 50.0}},
    },
    "tube": {
        "points": [[0.3, -0.3, 0], [0.3, 0.3, 0]],
        "radius": 0.03,
        "joint_signs": {"joint2": "-"},
    },
    "start": {"seed": [0.0, -1.0]},
    "obstacles": [{"name": "post", "cylinder": [0.03, 0.3], "position": [0.45, 0, 0]}],
}
URDF = """<robot name="arm"><link name="base"/><link name="bar"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""

SETTINGS = settings(
    max_examples=300,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats(allow_nan=True)
    | st.text(max_size=8)
    | st.sampled_from(["+", "-", "joint1", "hand", "example:ur5", "any"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=6,
)


def places(node, path=()):
    """Return the paths of all places in a document."""
    found = [path]
    if isinstance(node, dict | list):
        items = node.items() if isinstance(node, dict) else enumerate(node)
        found += [place for key, child in items for place in places(child, (*path, key))]
    return found


NEW_KEYS = [
    (section, name)
    for section, fields in (("robot", RobotFields), ("tube", TubeFields))
    for name in fields.model_fields
] + [(name,) for name in ProblemFields.model_fields]


@SETTINGS
@given(st.sampled_from([path for path in places(BASE) if path] + NEW_KEYS), VALUES, st.booleans())
def test_a_changed_problem_loads_or_is_refused(path, value, reads_tube):
    document = copy.deepcopy(BASE)
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    try:
        parse_problem(document, reads_tube=reads_tube)
    except TubePlannerError as error:
        assert "\n" not in str(error)


@SETTINGS
@given(st.text() | st.binary() | VALUES.map(json.dumps), st.sampled_from([".yaml", ".json"]))
def test_any_file_is_read_or_refused(tmp_path_factory, content, suffix):
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    try:
        read_problem_fields(path)
    except TubePlannerError as error:
        assert str(path) in str(error)


@SETTINGS
@given(st.integers(0, len(URDF)), st.integers(0, 12), st.text(max_size=6))
def test_any_damage_to_a_urdf_is_harmless_or_named(tmp_path_factory, start, length, new):
    path = tmp_path_factory.getbasetemp() / "any.urdf"
    damaged = URDF[:start] + new + URDF[start + length :]
    path.write_bytes(damaged.encode("utf-8", "replace"))
    try:
        read_urdf(path).kinematic_xml()
    except TubePlannerError as error:
        assert str(path) in str(error)
