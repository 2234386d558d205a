"""Plans that begin or end in contact: certified, judged by other code, or refused by name."""

from copy import deepcopy
from dataclasses import replace

import pytest
import yaml

from outside.trajectory import read_trajectory
from outside_judge import Judge, passes
from tubeplanner import MeasureOptions, PlanOptions, RouteOptions, load_problem, measure_tube, plan
from tubeplanner.files.export import trajectory_json
from tubeplanner.tube_sources.route import find_route

DOWN = [0.7071068, -0.7071068, 0.0, 0.0]
UPRIGHT = [0.0524, 0.0524, float("inf")]
PICK = {
    "robot": {
        "urdf": "example:ur5",
        "tool_frame": "tool0",
        "payload": {
            "mass": 1.0,
            "com": [0, 0, 0.05],
            "inertia": [0.004, 0.004, 0.007, 0, 0, 0],
        },
        "attached": [
            {
                "name": "part",
                "box": [0.06, 0.06, 0.1],
                "position": [0, 0, 0.05],
                "touch_links": ["wrist_3_link"],
            }
        ],
    },
    "tube": {
        "points": [[0.45, -0.3, 0.1], [0.45, -0.3, 0.4], [0.45, 0.3, 0.4], [0.45, 0.3, 0.1]],
        "radius": [0.03, 0.08, 0.03],
        "joint_signs": {"elbow_joint": "+"},
        "orientations": [DOWN] * 4,
        "rotation_tolerance": [UPRIGHT, [0.1, 0.1, float("inf")], UPRIGHT],
    },
    "start": {"seed": [-0.791217, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]},
    "goal": {"seed": [0.4, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]},
    "obstacles": [
        {"name": "wall", "box": [0.6, 0.05, 0.2], "position": [0.6, 0, 0.1]},
        {"name": "table", "box": [0.9, 1.6, 0.04], "position": [0.75, 0, -0.02]},
    ],
    "clearance": 0.01,
    "contacts": [{"links": ["part", "table"], "within": 0.03}],
}
SHORTEST = PlanOptions(slack=0.0)


def changed(**fields):
    """Return the fields of the problem; a key with a dot is one of a section."""
    made = deepcopy(PICK)
    for key, value in fields.items():
        *sections, last = key.split("__")
        section = made
        for name in sections:
            section = section[name]
        section[last] = value
    return made


@pytest.fixture
def solved(tmp_path):
    """Return a function from a problem's fields to problem, plan, and the outside judge's word."""

    def solve(fields, options=SHORTEST):
        path = tmp_path / "pick.yaml"
        path.write_text(yaml.safe_dump(fields))
        problem = load_problem(path)
        result = plan(problem, options)
        if result.trajectory is None:
            return problem, result, None
        (tmp_path / "plan.json").write_text(trajectory_json(result.trajectory))
        # What is kept back for errors asks nothing more of the motion.
        asked = {key: value for key, value in fields.items() if key != "robustness"}
        path.write_text(yaml.safe_dump(asked))
        found = Judge(path).judge(read_trajectory(tmp_path / "plan.json"))
        return problem, result, found

    return solve


def test_a_part_is_carried_from_a_table_to_a_table(solved):
    """Contact costs next to nothing: within 1 % of the motion that ignores the pair."""
    _, result, found = solved(PICK)
    assert result.succeeded, result.message
    assert passes(found)
    ignoring = changed(collision={"ignore": [["part", "table"]]})
    del ignoring["contacts"]
    _, other, _ = solved(ignoring)
    assert result.duration <= 1.01 * other.duration
    assert result.certificate.conditions["obstacles"].where.obstacle == "table"


def test_without_contacts_the_start_is_refused_in_words_that_name_them(solved):
    fields = changed()
    del fields["contacts"]
    _, result, _ = solved(fields)
    assert result.status == "tube_blocked"
    assert "contacts" in result.message


@pytest.mark.slow
def test_clearances_of_segments_are_kept_and_cost_time(solved):
    """Over the wall, which stands in the middle segment's way, 60 mm instead of 10."""
    low = changed(tube__radius=[0.03, 0.25, 0.03])
    high = low | {"clearance": {"default": 0.01, "segments": [None, 0.06, None]}}
    _, near, _ = solved(low)
    _, far, found = solved(high)
    assert near.succeeded
    assert far.succeeded
    assert passes(found)
    assert far.duration > near.duration


def is_sound(result, found):
    """Return whether a plan is confirmed, or its refusal names the pair in contact."""
    if result.succeeded:
        return passes(found)
    return "'part' and 'table' are" in result.message and "nearer" in result.message


@pytest.mark.slow
@pytest.mark.parametrize("method", ["stop-at-corners", "branch-and-bound"])
def test_other_methods_certify_or_refuse_by_name(solved, method):
    _, result, found = solved(PICK, PlanOptions(method=method, slack=0.0, time_limit=20.0))
    assert is_sound(result, found)


@pytest.mark.slow
def test_in_a_union_of_capsules_too(solved):
    _, result, found = solved(changed(tube__visit="any"))
    assert is_sound(result, found)


@pytest.mark.slow
def test_a_goal_that_is_open_may_be_in_contact_and_must_not_overlap(solved):
    """A millimetre above the table: less than the clearance, and more than nothing."""
    fields = changed()
    del fields["goal"]
    fields["tube"]["points"][-1] = [0.45, 0.3, 0.104]
    _, result, found = solved(fields)
    assert result.succeeded, result.message
    assert passes(found)
    del fields["contacts"]
    fields["tube"]["points"][0] = [0.45, -0.3, 0.12]
    _, without, _ = solved(fields)
    assert not without.succeeded


@pytest.mark.slow
def test_what_is_kept_back_leaves_contacts_as_they_are(solved):
    """The plan of a robot whose masses are uncertain begins on the table all the same."""
    fields = changed(robustness={"mass": 0.05, "com": 0.005})
    _, result, found = solved(fields)
    assert result.succeeded, result.message
    assert passes(found)
    start = result.certificate.conditions["obstacles"]
    assert start.margin == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_a_measured_tube_claims_nothing_of_pairs_in_contact(solved):
    """Tubes of a metre would else end at the table."""
    problem, _, _ = solved(PICK)
    found = measure_tube(problem, MeasureOptions(max_radius=0.05))
    assert found.succeeded
    assert found.message.endswith(
        "; not measured, since they may be in contact: 'part' and 'table'"
    )


@pytest.mark.slow
def test_a_route_begins_and_ends_in_contact(solved):
    problem, result, _ = solved(PICK)
    ends = result.trajectory.position([0.0, result.duration])
    options = RouteOptions(time_limit=60.0)
    way = find_route(replace(problem, start=ends[0], goal=ends[1]), options)
    assert way.succeeded, way.message
