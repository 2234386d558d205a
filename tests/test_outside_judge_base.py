"""The outside judge reads where a robot stands by itself."""

import copy
from dataclasses import replace

import pytest
import yaml

import outside_judge
from outside.files import BadInput
from placed_problem import SHIFT, TURN, bundled_fields, placed_fields
from small_cycle import SMALL, planned_cycle
from stored_trajectories import REFINEMENT
from tubeplanner import parse_cycle, parse_problem, plan, verify_cycle, write_cycle_motion
from tubeplanner.files.export import trajectory_json
from tubeplanner.resources import bundled_problems

NAME = "ur5/over_the_wall"
AS_QUATERNION = {"position": [0.3, -0.2, 1.1], "quaternion": [0.4, -0.8, 2.0, 1.2]}
PLACES = {"shifted": SHIFT, "turned": TURN, "by a quaternion": AS_QUATERNION}


@pytest.fixture
def judge(tmp_path):
    """Return a function from a problem's fields and a motion to what is found."""

    def of(fields, trajectory):
        problem, motion = tmp_path / "problem.yaml", tmp_path / "motion.json"
        problem.write_text(yaml.safe_dump(fields))
        motion.write_text(trajectory_json(trajectory))
        return outside_judge.judge(problem, motion)

    return of


@pytest.mark.parametrize("place", PLACES)
def test_a_motion_is_as_good_wherever_its_cell_stands(place, stored, judge):
    _, trajectory = stored(NAME, REFINEMENT)
    fields = bundled_fields(NAME)
    expected = judge(fields, trajectory)
    found = judge(placed_fields(fields, PLACES[place]), trajectory)
    assert outside_judge.passes(found)
    assert found.keys() == expected.keys()
    for name, one in found.items():
        if one.margin is not None:
            assert one.margin == pytest.approx(expected[name].margin, rel=1e-6, abs=1e-6)


def test_what_is_planned_for_a_base_passes_and_a_robot_moved_by_a_centimetre_does_not(judge):
    fields = placed_fields(bundled_fields(NAME), TURN)
    trajectory = plan(parse_problem(fields, bundled_problems()[NAME].parent)).trajectory
    assert outside_judge.passes(judge(fields, trajectory))
    for axis in range(3):
        aside = copy.deepcopy(fields)
        aside["robot"]["base"]["position"][axis] += 0.01
        assert not outside_judge.passes(judge(aside, trajectory))


@pytest.mark.parametrize("place", PLACES)
def test_a_cycle_is_as_good_wherever_its_cell_stands(place, tmp_path):
    """What is taken is an obstacle before, and must be where the hand is."""
    fields, motion = yaml.safe_load(SMALL), tmp_path / "motion.json"
    there = parse_cycle(placed_fields(fields, PLACES[place]))
    moved = replace(planned_cycle().motion, cycle=there)
    assert verify_cycle(there, moved).passed
    write_cycle_motion(motion, moved)
    margins = []
    for name, each in (("here", fields), ("there", placed_fields(fields, PLACES[place]))):
        cycle = tmp_path / f"{name}.yaml"
        cycle.write_text(yaml.safe_dump(each))
        found = outside_judge.judge(cycle, motion)
        assert outside_judge.passes(found)
        margins.append({key: one.margin for key, one in found.items() if one.margin is not None})
    assert margins[1] == pytest.approx(margins[0], rel=1e-6, abs=1e-6)


def test_a_field_of_the_base_that_is_not_known_is_refused(stored, judge):
    _, trajectory = stored(NAME, REFINEMENT)
    fields = placed_fields(bundled_fields(NAME), {**SHIFT, "yaw": 1.0})
    with pytest.raises(BadInput, match=r"robot\.base\.yaw is not known here"):
        judge(fields, trajectory)
