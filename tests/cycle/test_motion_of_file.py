"""Motions of cycles read from files."""

import pytest

from small_cycle import planned_cycle
from tubeplanner import TrajectoryError, read_cycle_motion, write_cycle_motion
from two_link_cycles import three_moves


def test_a_file_without_marks_or_of_another_cycle_is_refused(tmp_path):
    motion = planned_cycle().motion
    motion.trajectory.save(tmp_path / "bare.json")
    with pytest.raises(TrajectoryError, match=r"bare.json has no marks.*plan -o"):
        read_cycle_motion(tmp_path / "bare.json", motion.cycle)
    write_cycle_motion(tmp_path / "t.json", motion)
    with pytest.raises(TrajectoryError, match=r"t.json: marks are .*; the cycle has"):
        read_cycle_motion(tmp_path / "t.json", three_moves())
