"""What the README shows is run."""

import re
from pathlib import Path

from ruamel.yaml import YAML

from tubeplanner import parse_problem, plan

README = (Path(__file__).parents[1] / "README.md").read_text()


def block(language):
    return re.search(rf"```{language}\n(.*?)```", README, re.S).group(1)


def test_the_ten_lines_run(capsys):
    code = block("python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 11
    exec(compile(code, "README.md", "exec"), {})
    assert "certified trajectory of" in capsys.readouterr().out


def test_the_problem_file_is_planned():
    assert plan(parse_problem(YAML(typ="safe", pure=True).load(block("yaml")))).succeeded


def test_links_lead_to_files():
    root = Path(__file__).parents[1]
    for target in re.findall(r"\]\((?!http)([^)]+)\)", README):
        assert (root / target).exists(), target
