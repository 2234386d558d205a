"""What the README shows is run."""

import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tubeplanner import parse_problem, plan
from tubeplanner.commands.cli import cli

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
RUN_GUIDES = ("zones.md",)  # of docs: what they show runs without ROS


def block(language):
    return re.search(rf"```{language}\n(.*?)```", README, re.S).group(1)


def test_the_ten_lines_run(capsys):
    code = block("python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 11
    exec(compile(code, "README.md", "exec"), {})
    assert "certified motion of" in capsys.readouterr().out


def test_the_problem_file_is_planned():
    assert plan(parse_problem(YAML(typ="safe", pure=True).load(block("yaml")))).succeeded


@pytest.mark.parametrize("line", re.findall(r"^tubeplanner (.*)$", README, re.M))
def test_the_commands_and_options_exist(line):
    words = line.split("#")[0].split()
    command = cli.commands[words[0]]
    known = {name for parameter in command.params for name in parameter.opts}
    assert {word for word in words if word.startswith("-")} <= known


def test_links_lead_to_files():
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\((?!http)([^)]+)\)", page.read_text()):
            assert (page.parent / target).exists(), (page.name, target)


@pytest.mark.parametrize("name", RUN_GUIDES)
def test_the_blocks_of_a_guide_run_and_print_what_it_says(name, capsys):
    text = (ROOT / "docs" / name).read_text()
    shared = {}
    for code in re.findall(r"```python\n(.*?)```", text, re.S):
        exec(compile(code, name, "exec"), shared)
    output = capsys.readouterr().out
    for shown in re.findall(r"```text\n(.*?)```", text, re.S):
        assert shown in output
