"""Mutants drawn from the source: what each operator changes, and how they are drawn."""

import ast
from itertools import islice
from pathlib import Path

import pytest

from mutant_operators import Source
from mutants import ONLY, Mutant, Sources, hand_mutants

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "tubeplanner"
TEXT = '''
"""A module with 1 line."""
LIMIT = 3.0


class Arm:
    def reach(self, q: float = 2.0, joint: "int < 3" = 1) -> list[float]:
        """Return 1 + 1 reaches."""
        if q < 0.5 and joint:
            raise ValueError(f"q is {q + 1}")
        length: float = q - self.base(joint, q)
        self.seen = [*"ä", length]
        self.tell("é", q.max(axis=0))
        return length
'''


class EveryLine:
    def covered(self, module):
        return -1


def changes(text=TEXT):
    """Return (operator, line before, line after) of each fragment."""
    return [(each.operator, each.before, each.after) for each in Source(text).fragments()]


# All changes of the text, by line: heads, hints, texts and docstrings stay.
CHANGES = {
    "if q < 0.5 and joint:": {
        ("comparison", "if (q > 0.5) and joint:"),
        ("off by one", "if (q <= 0.5) and joint:"),
        ("and/or", "if (q < 0.5 or joint):"),
        ("constant", "if q < 1.0 and joint:"),
    },
    'raise ValueError(f"q is {q + 1}")': {("dropped statement", "pass")},
    "length: float = q - self.base(joint, q)": {
        ("sign", "length: float = (q + self.base(joint, q))"),
        ("swapped argument", "length: float = q - self.base(q, joint)"),
    },
    'self.seen = [*"ä", length]': {("dropped statement", "pass")},
    'self.tell("é", q.max(axis=0))': {
        ("off by one", 'self.tell("é", q.max(axis=1))'),
        ("dropped statement", "pass"),
    },
}


def test_each_operator_changes_its_own_and_nothing_else():
    expected = [(name, line, after) for line, new in CHANGES.items() for name, after in new]
    assert sorted(changes()) == sorted(expected)
    assert all(each.where == "Arm.reach" for each in Source(TEXT).fragments())


@pytest.mark.parametrize(
    ("line", "operators"),
    [
        ("x = -x", ["dropped statement", "sign"]),
        ("y = not x", ["comparison"]),
        ("y = x // 2", ["off by one"]),
        ("y = x / 'name'", []),
        ("y = x is not True", ["comparison", "constant"]),
        ("x *= y", ["dropped statement", "factor"]),
        ("y = x[1:]", ["off by one"]),
        ("y = max(x, y)", []),
        ("y = f(x, 'name')", []),
        ("y = zip(x, strict=True)", []),
        ("y = 1 if x else 2", ["comparison", "off by one", "off by one"]),
        ("return", ["dropped statement"]),
    ],
)
def test_what_is_changed_in_a_line(line, operators):
    assert sorted(each[0] for each in changes(f"def f(x):\n    {line}\n")) == operators


def test_all_mutants_are_python():
    for each in Source(TEXT).fragments():
        text = TEXT[: each.begin] + each.after + TEXT[each.begin + len(each.before) :]
        assert ast.dump(ast.parse(text)) != ast.dump(ast.parse(TEXT))


@pytest.fixture
def sources(tmp_path):
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "arm.py").write_text(TEXT)
    (tmp_path / "leg.py").write_text("def step(x):\n    x = x + 1\n    x = x + 1\n    return x\n")
    return Sources(tmp_path)


def test_a_draw_is_the_same_again_and_begins_a_longer_one(sources):
    draws = [list(islice(sources.drawn(EveryLine(), "", 4), count)) for count in (5, 5, 9)]
    assert draws[0] == draws[1] == draws[2][:5]
    assert draws[0] != list(islice(sources.drawn(EveryLine(), "", 5), 5))
    assert {mutant.module for mutant in sources.drawn(EveryLine(), "arms", 4)} == {"arms/arm.py"}


def test_equal_lines_are_told_apart(sources):
    drawn = [each for each in sources.drawn(EveryLine(), "", 0) if each.operator == "sign"]
    texts = {sources.mutated(each) for each in drawn if each.module == "leg.py"}
    assert len(texts) == 2


def test_a_mutant_follows_its_function_into_another_module(sources, tmp_path):
    mutant = next(sources.drawn(EveryLine(), "arms", 4))
    (tmp_path / "arms" / "arm.py").rename(tmp_path / "limb.py")
    assert Sources(tmp_path).place(mutant)[0] == "limb.py"


def test_a_fragment_that_is_not_there_is_named(sources):
    mutant = Mutant("", 0, "by hand", "step", "x - 1", "x", ONLY)
    with pytest.raises(ValueError, match="step: `x - 1`: the fragment is in 0 places, not in one"):
        sources.place(mutant)


def test_mutants_by_hand_are_few_and_all_there():
    sources = Sources(PACKAGE)
    assert all(sources.place(mutant) for mutant in hand_mutants())
    assert len(hand_mutants()) <= 86
