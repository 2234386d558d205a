"""Which files are cycles, and what those that take problems say of them."""

import pytest

from small_cycle import SMALL
from tubeplanner import ProblemError, load_problem
from tubeplanner.files.problem_file import read_fields
from tubeplanner.problem.document_kind import is_cycle


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"format": "tubeplanner/cycle"}, True),
        ({"moves": []}, True),
        ({"format": "tubeplanner/problem", "tube": {}}, False),
        ({}, False),
        (["moves"], False),
        (None, False),
    ],
)
def test_a_cycle_is_known_by_its_format_or_its_moves(document, expected):
    assert is_cycle(document) is expected


@pytest.mark.parametrize("read", [load_problem, read_fields])
def test_what_takes_problems_refuses_cycles_and_says_what_takes_them(read, tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    with pytest.raises(ProblemError, match=r"c\.yaml: this is a cycle, .*; plan, check, info"):
        read(path)
