"""The motion of a cycle in files: JSON with marks, samples with rests, a ROS message a leg."""

import csv
import io
import json

import numpy as np
import pytest
import yaml

from cycles import pick_and_place, slow_motion
from tubeplanner import (
    CycleMotion,
    OutputError,
    read_cycle_motion,
    verify,
    verify_cycle,
    write_cycle_motion,
)
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE
from tubeplanner.output.files.fingerprint import cycle_hash
from tubeplanner.output.files.samples import motion_samples
from tubeplanner.output.files.trajectory_writer import FORMATS, ExportedMotion
from tubeplanner.trajectory.reader import read_trajectory_file

RATE = 200.0
NAMES = ["over", "down, beside", "back"]
DWELLS = (0.05, 0.06, 0.1)  # after each leg [s]


@pytest.fixture
def motion(small_plan):
    return small_plan.motion


@pytest.fixture(scope="module")
def samples(small_plan):
    return motion_samples(small_plan.motion, RATE)


@pytest.fixture(scope="module")
def whole(samples):
    return samples.whole()


@pytest.fixture(scope="module")
def written(small_plan, tmp_path_factory):
    """Return the folder with the files of a motion, and the notes about them."""
    folder = tmp_path_factory.mktemp("files")
    exported = ExportedMotion(small_plan.motion, "refinement", RATE)
    for each in FORMATS:
        (folder / f"t{each.endings[0]}").write_text(each.text(exported))
    return folder, exported.notes


# Samples.


def test_times_increase_to_the_end_of_all_parts(samples, whole):
    table, effort = whole
    assert (np.diff(table.time) > 0).all()
    durations = [leg.samples.time[-1] for leg in samples.sections]
    assert samples.begins[0] == 0
    assert [*np.diff(samples.begins), table.time[-1] - samples.begins[-1]] == pytest.approx(
        np.add(durations, DWELLS)
    )
    assert effort.shape == table.position.shape


def test_the_arm_stays_in_the_seams_while_it_dwells(samples, whole, motion):
    table, _ = whole
    for junction, begin, dwell in zip(
        motion.junctions[1:3], samples.begins[1:], DWELLS[:2], strict=True
    ):
        inside = (table.time > begin - dwell) & (table.time < begin)
        assert inside.sum() >= dwell * RATE - 2
        np.testing.assert_allclose(table.position[inside], junction[None].repeat(inside.sum(), 0))
        assert not table.velocity[inside].any()


def test_the_motors_hold_what_is_carried_then(samples, whole, motion):
    """The gripper closes before the part is taken, and opens before it is let go."""
    table, effort = whole
    empty, loaded = (leg.robot for leg in motion.cycle.legs[:2])
    for begin, q, arm in zip(
        samples.begins[1:], motion.junctions[1:3], (empty, loaded), strict=True
    ):
        row = int(np.flatnonzero(table.time < begin - 1e-9)[-1])
        np.testing.assert_allclose(effort[row], arm.gravity_effort(q))
    first = int(np.flatnonzero(table.time > samples.begins[1] - 1e-9)[0])
    state = (table.position[first], table.velocity[first], table.acceleration[first])
    carried = loaded.inverse_dynamics(*(each[None] for each in state))[0]
    np.testing.assert_allclose(effort[first], carried)
    q = motion.junctions[1]
    assert abs(loaded.gravity_effort(q) - empty.gravity_effort(q)).max() > 0.1


def test_notes_tell_how_samples_differ_and_when_moves_begin(samples):
    *each, last = samples.notes
    assert [note.split(":")[0] for note in each] == [f"move '{name}'" for name in NAMES]
    assert "longer than the trajectory" in each[0]
    assert last.startswith("in CSV, moves begin later than in the trajectory: over at 0.0000 s, ")


def test_samples_of_legs_that_last_whole_periods_are_the_motion_itself():
    motion = slow_motion(pick_and_place())
    samples = motion_samples(motion, 100.0)
    table, _ = samples.whole()
    assert samples.notes == ()
    np.testing.assert_allclose(table.time, np.arange(len(table.time)) * 0.01, atol=1e-9)
    np.testing.assert_allclose(table.position, motion.trajectory.position(table.time), atol=1e-9)


# Files.


def test_the_json_gives_the_motion_back_and_says_where_it_comes_from(written, motion):
    path = written[0] / "t.json"
    file, fields = read_trajectory_file(path), json.loads(path.read_text())
    assert file.marks == motion.marks
    np.testing.assert_array_equal(file.trajectory.coefficients, motion.trajectory.coefficients)
    assert verify_cycle(motion.cycle, CycleMotion(motion.cycle, file.trajectory, file.marks)).passed
    assert fields["format"] == "tubeplanner/trajectory"
    assert (fields["version"], fields["method"]) == (1, "refinement")
    assert fields["problem_hash"] == cycle_hash(motion.cycle)
    assert fields["problem"] == "small"
    assert fields["marks"][1]["event"] == "gripper"
    assert fields["marks"][1]["set"] == "close"


def test_the_csv_has_all_of_it(written, motion):
    folder, notes = written
    header, *rows = csv.reader(io.StringIO((folder / "t.csv").read_text()))
    assert header[0] == "time"
    assert header[-2:] == ["joint1.effort", "joint2.effort"]
    assert len(notes) == 4
    longest = motion.trajectory.duration
    assert longest < float(rows[-1][0]) < 1.1 * longest


def test_ros_has_a_message_for_every_leg_with_comments(written, motion, tmp_path):
    text = (written[0] / "t.yaml").read_text()
    assert len(list(yaml.load_all(text, yaml.CSafeLoader))) == 3
    before = "# before it: gripper 'close' (0.05 s), attach part\n"
    assert f"# 2 of 3: move down, beside\n{before}" in text
    assert "# after it: pause (0.1 s)\n" in text
    problems = motion.cycle.problems(motion.junctions)
    for problem, part in zip(problems, text.split("---\n"), strict=True):
        path = tmp_path / "leg.yaml"
        path.write_text(part)
        read = read_trajectory_file(path)
        assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).passed


def test_a_motion_is_written_and_read_by_name(motion, tmp_path):
    assert write_cycle_motion(tmp_path / "t.json", motion) == ()
    again = read_cycle_motion(tmp_path / "t.json", motion.cycle)
    assert again.marks == motion.marks
    np.testing.assert_array_equal(again.trajectory.coefficients, motion.trajectory.coefficients)
    notes = write_cycle_motion(tmp_path / "t.csv", motion, rate=RATE)
    rows = (tmp_path / "t.csv").read_text().splitlines()
    assert rows[0].startswith("time,")
    assert float(rows[2].split(",")[0]) == pytest.approx(1 / RATE)
    assert any("later than in the trajectory" in note for note in notes)
    with pytest.raises(OutputError, match=r"there is: \.json"):
        write_cycle_motion(tmp_path / "t.txt", motion)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.csv", "t.json"]
