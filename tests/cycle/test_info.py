"""What is in a cycle file."""

import pytest
from small_cycle import SMALL

from tubeplanner import ProblemError
from tubeplanner.cycle.cycle_info import cycle_info


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    return path


def test_moves_stand_by_legs_with_what_is_carried(path):
    info = cycle_info(path)
    fields = info.as_dict()["cycle"]
    assert info.refused is None
    assert fields["closed"]
    assert [[move["name"] for move in leg["moves"]] for leg in fields["legs"]] == [
        ["over"],
        ["down", "beside"],
        ["back"],
    ]
    assert [leg["attached"] for leg in fields["legs"]] == [[], ["part"], []]
    assert [leg["payload"] and leg["payload"]["mass"] for leg in fields["legs"]] == [
        None,
        0.5,
        None,
    ]
    assert fields["legs"][1]["moves"][1]["length"] == pytest.approx(0.35)
    assert fields["after"] == ["pause (0.1 s)"]


def test_a_cycle_that_does_not_load_is_described_with_the_reason(path):
    info = cycle_info(path, {"moves.back.tube.radius": -1})
    assert info.cycle is None
    assert "move 'back': tube.radius" in info.refused
    assert info.as_dict()["cycle"] is None
    assert info.robot.tool_frame == "hand"


def test_a_file_that_breaks_its_format_is_bad_input(path):
    path.write_text(SMALL.replace("dwell: 0.1", "dwel: 0.1"))
    with pytest.raises(ProblemError, match="dwel"):
        cycle_info(path)
