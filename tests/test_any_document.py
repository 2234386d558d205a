"""Any document either loads or raises one of our errors, never another library's."""

import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from any_documents import changed_documents, whole_documents
from any_values import VALUES, accepted, examples
from small_cycle import SMALL
from tubeplanner import TubePlannerError, load_problem, load_study, parse_cycle, parse_problem
from tubeplanner.cycle.cycle_format import cycle_schema
from tubeplanner.problem.problem_fields import read_problem_fields
from tubeplanner.problem.problem_format import problem_schema
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.studies.study_format import study_schema

PROBLEM = {
    "robot": {
        "urdf": "example:two_link",
        "tool_frame": "hand",
        "gravity": [0, 0, 0],
        "limits": {"velocity": {"joint1": 50.0, "joint2": 50.0}},
        "payload": {"mass": 0.5},
    },
    "tube": {
        "points": [[0.3, -0.3, 0], [0.3, 0.3, 0]],
        "radius": 0.03,
        "joint_signs": {"joint2": "-"},
    },
    "start": {"seed": [0.0, -1.0]},
    "goal": {"position": [0.3, 0.3, 0], "tolerance": 0.01},
    "obstacles": [{"name": "post", "cylinder": [0.03, 0.3], "position": [0.45, 0, 0]}],
    "clearance": {"default": 0.001, "pairs": [{"links": ["link2", "post"], "clearance": 0.002}]},
    "objective": {"slack": 0.01},
}
CYCLE = yaml.safe_load(SMALL)
STUDY = {
    "format": "tubeplanner/study",
    "study": {
        "problem": "example:two_link/paper_1_30mm",
        "vary": {
            "tube.radius": [0.02, 0.03],
            "robot.payload.mass": {"from": 0.1, "to": 2, "count": 3},
        },
        "options": {"method": "stop-at-corners"},
    },
}
URDF = """<robot name="arm"><link name="base"/><link name="bar"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A file that every example writes anew."""
    return tmp_path_factory.mktemp("any") / "any.json"


@examples(300)
@given(changed_documents(PROBLEM, problem_schema()), st.booleans())
def test_a_changed_problem_loads_or_is_refused(document, reads_tube):
    repr(accepted(parse_problem, document, reads_tube=reads_tube))


@examples(60)
@given(whole_documents(problem_schema()) | VALUES)
def test_any_problem_loads_or_is_refused(document):
    accepted(parse_problem, document)


@examples(200)
@given(changed_documents(CYCLE, cycle_schema()))
def test_a_changed_cycle_loads_or_is_refused(document):
    repr(accepted(parse_cycle, document))


@examples(60)
@given(whole_documents(cycle_schema()) | VALUES)
def test_any_cycle_loads_or_is_refused(document):
    accepted(parse_cycle, document)


@examples(150)
@given(document=changed_documents(STUDY, study_schema()) | whole_documents(study_schema()))
def test_any_study_poses_its_points_or_is_refused(file, document):
    if written(file, document) and (study := accepted(load_study, file)):
        for index in range(min(3, len(study.points))):
            accepted(study.posed, study.points[index])


@examples(100)
@given(document=changed_documents(PROBLEM, problem_schema()))
def test_a_changed_file_loads_or_is_refused(file, document):
    if written(file, document):
        accepted(load_problem, file)


def written(file, document):
    """Write a document as JSON; return whether JSON can hold it."""
    try:
        file.write_text(json.dumps(document))
    except (TypeError, ValueError):
        return False
    return True


@examples(300)
@given(st.text() | st.binary() | VALUES.map(repr), st.sampled_from([".yaml", ".json"]))
def test_any_file_is_read_or_refused(tmp_path_factory, content, suffix):
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    try:
        read_problem_fields(path)
    except TubePlannerError as error:
        assert str(path) in str(error)


@examples(300)
@given(st.integers(0, len(URDF)), st.integers(0, 12), st.text(max_size=6))
def test_any_damage_to_a_urdf_is_harmless_or_named(tmp_path_factory, start, length, new):
    path = tmp_path_factory.getbasetemp() / "any.urdf"
    damaged = URDF[:start] + new + URDF[start + length :]
    path.write_bytes(damaged.encode("utf-8", "replace"))
    try:
        read_urdf(path).kinematic_xml()
    except TubePlannerError as error:
        assert str(path) in str(error)
