"""The outside judge on bases, on clearances of pairs and segments, and on contacts."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from lifting_arm import (
    CASES,
    CONTACT,
    LIFT,
    RISE,
    Case,
    contacts,
    fields_of,
    lifting,
    trajectory_of,
    written,
)
from placed_problem import TURN, bundled_fields, placed_fields
from small_cycle import SMALL

import outside_judge
from outside.distances import DEEP, NEAR, Poses, least_margin, near_distances, signed_distance
from outside.files import BadInput
from outside_judge import Judge
from tubeplanner import parse_cycle, verify, verify_cycle, write_cycle_motion
from tubeplanner.output.files.trajectory_writer import trajectory_json

NAME = "two_link/around_a_post"
AS_QUATERNION = {"position": [0.3, -0.2, 1.1], "quaternion": [0.4, -0.8, 2.0, 1.2]}


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(Judge.judge, "__defaults__", (200,))


@pytest.fixture
def judged(tmp_path):
    """Return a function from a problem's fields and a motion to what is seen."""

    def of(fields, trajectory):
        motion = tmp_path / "motion.json"
        motion.write_text(trajectory_json(trajectory))
        return outside_judge.judge(written(tmp_path, fields), motion)

    return of


@pytest.mark.parametrize("base", [TURN, AS_QUATERNION], ids=["turned", "by a quaternion"])
def test_a_motion_is_as_good_wherever_its_cell_stands_and_no_robot_may_be_aside(
    base, stored, judged
):
    _, trajectory = stored(NAME)
    fields = bundled_fields(NAME)
    placed = placed_fields(fields, base)
    here, there = judged(fields, trajectory), judged(placed, trajectory)
    assert outside_judge.passes(there)
    assert there.keys() == here.keys()
    for name, each in there.items():
        if each.margin is not None:
            assert each.margin == pytest.approx(here[name].margin, rel=1e-6, abs=1e-6)
    for axis in range(3):
        placed["robot"]["base"]["position"][axis] += 0.05
        assert not outside_judge.passes(judged(placed, trajectory))
        placed["robot"]["base"]["position"][axis] -= 0.05


@pytest.mark.dear("judges a cycle")
def test_a_cycle_is_as_good_wherever_its_cell_stands(small_plan, tmp_path):
    """What is taken is an obstacle before, and must be where the hand is."""
    fields, path = placed_fields(yaml.safe_load(SMALL), TURN), tmp_path / "motion.json"
    cycle = parse_cycle(fields)
    motion = replace(small_plan.motion, cycle=cycle)
    assert verify_cycle(cycle, motion).passed
    write_cycle_motion(path, motion)
    assert outside_judge.passes(outside_judge.judge(written(tmp_path, fields), path))


def judged_way(judged, case, **more):
    """Return what is seen of a case of the arm that lifts, with other fields of its problem."""
    return judged(fields_of(case) | more, trajectory_of(case.way))


LOOKED_AT = [
    *("the default where a segment has none", "a pair before a segment", "a lift", "sideways"),
    *("a lift in contact at the goal alone", "a pair's own clearance when contact ends"),
    *("back into the ball", "beside the ball", "back into the ball in another segment"),
    *("set down where the goal is open", "overlap at an open goal"),
    *("over, in contact at the start alone", "over in a union"),
]


@pytest.mark.parametrize("name", LOOKED_AT)
def test_the_margin_is_that_of_the_closed_form(judged, name):
    """Up to what hand-overs are chosen by, and down to where it is not measured any closer."""
    case = CASES[name]
    condition = judged_way(judged, case)["obstacles"]
    known = [float(np.clip(margin, DEEP, NEAR)) for margin in (condition.margin, case.margin)]
    assert known[0] == pytest.approx(known[1], abs=2e-5)
    assert min(case.margin, NEAR) - 2e-5 <= condition.margin <= case.margin + 0.02
    assert condition.where == "hand and table"


@pytest.mark.parametrize("second", [0.0213, 0.0217])
def test_a_trajectory_passes_if_some_choice_of_hand_overs_does(judged, tmp_path, second):
    """Both capsules hold the cube from 30 mm before the middle to 30 mm behind it."""
    asked = {"clearance": {"segments": [0.008, second]}}
    case = Case(RISE, [0, 1, 2], asked, 0.0, None, radius=0.03)
    assert outside_judge.passes(judged_way(judged, case)) == (second < 0.0215)
    assert bool(verify(*lifting(tmp_path, case)).failures()) == (second >= 0.0215)


@pytest.mark.parametrize(("asked", "margin"), [(0.149, 0.001), (0.151, -0.001)])
def test_links_keep_a_pairs_own_clearance_from_each_other(judged, asked, margin):
    pairs = [{"links": ["hand", "base"], "clearance": asked}]
    found = judged_way(judged, Case(RISE, [0, 1, 2], {"clearance": {"pairs": pairs}}, 0.0, None))
    assert found["self_collision"].margin == pytest.approx(margin, abs=1e-6)
    assert found["obstacles"].margin == pytest.approx(0.01, abs=1e-6)


def test_a_segment_without_length_and_one_that_goes_on_keep_their_clearance(judged):
    """The file's numbers are those of its points, also where some of them count for nothing."""
    case = Case(RISE, [0, 0, 1, 2], {}, 0.0, None)
    found = judged_way(judged, case, clearance={"segments": [0.008, 0.008, 0.017]})
    assert found["obstacles"].margin > NEAR
    found = judged_way(judged, case, clearance={"segments": [0.017, 0.017, 0.008]})
    assert found["obstacles"].margin == pytest.approx(-0.007, abs=1e-4)


ROBOT = {"urdf": "lifting.urdf", "tool_frame": "hand", "gravity": [0, 0, 0]}
PAIR = {"links": ["cart", "table"], "clearance": 0.1}


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"clearance": {"segments": [0.01]}}, "clearance.segments has 1 entries for 2 segments"),
        ({"clearance": {"colour": 1}}, "clearance.colour is not known here"),
        ({"clearance": {"pairs": [PAIR]}}, "cart and table are not held against each other"),
        ({"contacts": [CONTACT | {"colour": 1}]}, "contacts.colour is not known here"),
        ({"contacts": [CONTACT | {"segments": [2]}]}, "neither the first nor the last"),
        (contacts(links=["hand", "tabel"]), "hand and tabel are not held against each other"),
        ({"robot": ROBOT | {"base": {"yaw": 1.0}}}, "robot.base.yaw is not known here"),
    ],
)
def test_what_cannot_be_judged_is_refused_by_name(judged, asked, message):
    case = Case(LIFT, [0, 1, 2], asked, 0.0, None)
    with pytest.raises(BadInput, match=message):
        judged_way(judged, case)


def test_what_is_asked_may_change_from_sample_to_sample(tmp_path):
    """The least margin is that of all samples, whatever is asked of each."""
    case = CASES["back into the ball"]
    judge, trajectory = Judge(written(tmp_path, fields_of(case))), trajectory_of(case.way)
    poses = Poses(*judge.arm.poses(trajectory.position(np.linspace(0, 5, 301))))
    (pair,) = judge.clearance.obstacle_pairs
    distance = np.array([signed_distance(pair, poses, row) for row in range(301)])
    asked = distance[:, None] - np.random.default_rng(0).uniform(0, 0.01, (301, 1))
    nearest, _ = least_margin([pair], poses, asked)
    assert nearest.margin == pytest.approx((distance - asked[:, 0]).min(), abs=1e-9)
    assert nearest.row == (distance - asked[:, 0]).argmin()
    found = near_distances(pair, poses, np.full(301, 0.03))
    measured = np.isfinite(found)
    np.testing.assert_allclose(found[measured], distance[measured])
    assert (distance[~measured] >= 0.03).all()
    assert 0 < measured.sum() < 250
