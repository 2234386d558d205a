"""Files of a cycle's motion."""

import csv
import io
import json

import numpy as np
import pytest
import yaml

from small_cycle import planned_cycle
from tubeplanner import (
    CycleMotion,
    OutputError,
    read_cycle_motion,
    verify,
    verify_cycle,
    write_cycle_motion,
)
from tubeplanner.files.cycle_fingerprint import cycle_hash
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.trajectory.trajectory_file import read_trajectory_file
from tubeplanner.verification.judged_condition import FOREIGN_TOLERANCE


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the folder with the files of a motion, and the notes about them."""
    folder = tmp_path_factory.mktemp("files")
    files = TrajectoryFiles(folder / "t.json", folder / "t.csv", folder / "t.yaml", rate=200)
    contents, notes = cycle_contents(files, planned_cycle().motion, "refinement")
    for path, data in contents.items():
        path.write_bytes(data)
    return folder, notes


def test_the_json_gives_the_motion_back(written):
    folder, _ = written
    motion = planned_cycle().motion
    file = read_trajectory_file(folder / "t.json")
    assert file.marks == motion.marks
    np.testing.assert_array_equal(file.trajectory.coefficients, motion.trajectory.coefficients)
    again = CycleMotion(motion.cycle, file.trajectory, file.marks)
    assert verify_cycle(motion.cycle, again).passed


def test_the_json_says_where_it_comes_from(written):
    folder, _ = written
    fields = json.loads((folder / "t.json").read_text())
    cycle = planned_cycle().motion.cycle
    assert fields["format"] == "tubeplanner/trajectory"
    assert (fields["version"], fields["method"]) == (1, "refinement")
    assert fields["problem_hash"] == cycle_hash(cycle)
    assert fields["problem"] == "small"
    assert fields["marks"][1]["event"] == "gripper"
    assert fields["marks"][1]["set"] == "close"


def test_the_csv_has_all_of_it(written):
    folder, notes = written
    header, *rows = csv.reader(io.StringIO((folder / "t.csv").read_text()))
    assert header[0] == "time"
    assert header[-2:] == ["joint1.effort", "joint2.effort"]
    assert len(notes) == 4
    longest = planned_cycle().motion.trajectory.duration
    assert longest < float(rows[-1][0]) < 1.1 * longest


def test_ros_has_a_message_for_every_leg_with_comments(written, tmp_path):
    folder, _ = written
    text = (folder / "t.yaml").read_text()
    messages = list(yaml.safe_load_all(text))
    motion = planned_cycle().motion
    assert len(messages) == 3
    assert (
        "# 2 of 3: move down, beside\n# before it: gripper 'close' (0.05 s), attach part\n" in text
    )
    assert "# after it: pause (0.1 s)\n" in text
    parts = text.split("---\n")
    for problem, part in zip(motion.cycle.problems(motion.seams), parts, strict=True):
        path = tmp_path / "leg.yaml"
        path.write_text(part)
        read = read_trajectory_file(path)
        assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).passed


def test_only_what_is_asked_for_is_made():
    contents, notes = cycle_contents(TrajectoryFiles(), planned_cycle().motion, "refinement")
    assert (contents, notes) == ({}, ())


def test_a_motion_is_written_and_read_by_name(tmp_path):
    motion = planned_cycle().motion
    assert write_cycle_motion(tmp_path / "t.json", motion) == ()
    again = read_cycle_motion(tmp_path / "t.json", motion.cycle)
    assert again.marks == motion.marks
    np.testing.assert_array_equal(again.trajectory.coefficients, motion.trajectory.coefficients)
    notes = write_cycle_motion(tmp_path / "t.csv", motion, rate=200)
    rows = (tmp_path / "t.csv").read_text().splitlines()
    assert rows[0].startswith("time,")
    assert float(rows[2].split(",")[0]) == pytest.approx(1 / 200)
    assert any("later than in the trajectory" in note for note in notes)
    with pytest.raises(OutputError, match=r"there is: \.json"):
        write_cycle_motion(tmp_path / "t.txt", motion)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.csv", "t.json"]
