"""Names are names: no markup in pages, no codes in terminals, no formulas in tables."""

import base64
import csv
import gzip
import io
import json
import re
from html.parser import HTMLParser

import pytest
import umsgpack
import yaml
from gantry import HOSTILE, explained
from rich.table import Table

from tubeplanner import RobotError, load_robot
from tubeplanner.cli.main import main
from tubeplanner.cli.report import rendered
from tubeplanner.output.page.explanation_page import view_explanation
from tubeplanner.output.page.viewer import page_html
from tubeplanner.resources import bundled_robots

NAMES = [
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(1)>",
    "<!-- <script>",
    "\"'`&lt;b&gt;",
    "{{data}} {{engine}}",
    "[bold]markup[/bold]",
    "%s {0} \\",
]
CODES = ["\x1b[31mred", "back\rwards", "turned\u202eover", "two\nlines", "nul\x00l", "\u2028"]
PROBLEM = {
    "robot": {"urdf": "arm.urdf", "tool_frame": "hand", "limits": {"velocity": 50.0}},
    "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
    "start": {"seed": [0.0, -1.0]},
    "obstacles": [{"name": "post", "cylinder": [0.03, 0.3], "position": [0, 0.9, 0]}],
}


class Tags(HTMLParser):
    """The tags of a page and what its scripts hold."""

    def __init__(self, page):
        super().__init__()
        self.tags = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, tuple(name for name, _ in attrs)))

    def handle_comment(self, data):
        self.tags.append(("comment", data))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(folder, name, file="problem.yaml"):
    """Write a problem whose joint, link and obstacle have a name."""
    quoted = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    text = bundled_robots()["two_link"].read_text()
    for word in ("joint1", "link1"):
        text = text.replace(f'"{word}"', f'"{quoted} {word}"')
    (folder / "arm.urdf").write_text(text)
    problem = json.loads(json.dumps(PROBLEM))
    problem["obstacles"][0]["name"] = name
    (folder / file).write_text(yaml.safe_dump(problem))


def tags_of_page(folder, problem):
    assert main(["view", problem, "--html", "page.html"]) == 0
    return Tags((folder / "page.html").read_text()).tags


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_no_markup_in_a_page(folder, name, capsys):
    write(folder, "plain")
    plain = tags_of_page(folder, "problem.yaml")
    file = "a & <b>.yaml" if "/" in name else f"{name}.yaml"
    write(folder, name, file)
    assert tags_of_page(folder, file) == plain


def test_what_a_page_says_comes_out_of_it_as_it_went_in():
    panel = {"names": [*NAMES, *CODES]}
    commands = [{"type": "delete", "path": f"/{name}"} for name in NAMES]
    text = page_html(NAMES[1], panel, commands)
    begin = text.index('{"names"')
    assert json.JSONDecoder().raw_decode(text[begin:])[0] == panel
    assert NAMES[1] not in text
    (scene,) = re.findall(r'<script type="text/plain" id="scene">(.*?)</script>', text)
    packed, kept = gzip.decompress(base64.b64decode(scene)), []
    while packed:
        length = int.from_bytes(packed[:4], "little")
        kept.append(umsgpack.unpackb(packed[4 : 4 + length]))
        packed = packed[4 + length :]
    assert kept == commands


@pytest.mark.dear("plans four problems and makes four pages")
def test_no_name_is_markup_in_the_page_of_an_explanation(tmp_path):
    """Of links, joints, obstacles, the problem, and what helps: 22 names on each page.

    Every fifth has every beginning, every markup and every end.
    """
    plain = Tags(view_explanation(explained(tmp_path, [f"n{k}" for k in range(22)])).html).tags
    for begin in range(0, len(HOSTILE), 5 * 22):
        names = HOSTILE[begin : begin + 5 * 22 : 5]
        page = view_explanation(explained(tmp_path, names))
        assert names[2] in page.panel["findings"]["reason"]
        assert Tags(page.html).tags == plain
        assert findings_of(page.html) == page.panel["findings"]


def findings_of(page):
    """Return the data of the findings in the scripts of a page."""
    begin = page.index(">", page.index('<script type="application/json"')) + 1
    return json.loads(page[begin : page.index("</script", begin)])["findings"]


def require_printable(capfd):
    """Return the printed text."""
    out, err = capfd.readouterr()
    assert all(character.isprintable() for character in (out + err).replace("\n", ""))
    return out, err


@pytest.mark.parametrize("code", CODES)
def test_a_code_is_no_name_and_there_is_no_page(folder, code, capfd):
    (folder / "arm.urdf").write_text(bundled_robots()["two_link"].read_text())
    post = {"name": code, "sphere": 0.1, "position": [0.3, 0, 0]}
    (folder / "problem.json").write_text(json.dumps({**PROBLEM, "obstacles": [post]}))
    words = ["explain", "problem.json", "--processes", "1", "--time-limit", "1"]
    assert main([*words, "--html", "page.html"]) == 2
    require_printable(capfd)
    assert not (folder / "page.html").exists()


@pytest.mark.parametrize("code", CODES)
def test_a_name_is_no_code_in_a_terminal(folder, code, capfd):
    robot = PROBLEM["robot"] | {"urdf": "example:two_link"}
    for field, value in (
        ("obstacles", [{"name": code, "sphere": 0.1, "position": [0, 0.9, 0]}]),
        ("clearance", {"pairs": [{"links": [code, "link1"], "clearance": 0.1}]}),
        ("collision", {"ignore": [[code, "link1"]]}),
        (code, 1),
        ("include", f"{code}.yaml"),
        ("robot", robot | {"tool_frame": code}),
        ("robot", robot | {"locked_joints": {code: 0}}),
        ("robot", robot | {"preset": code}),
        ("robot", robot | {"limits": {"velocity": {code: 1}}}),
        ("tube", {**PROBLEM["tube"], "joint_signs": {code: "+"}}),
        ("start", {"joints": {code: 0}}),
        ("start", {"group_state": code}),
    ):
        fields = {**PROBLEM, "robot": robot, field: value}
        (folder / "problem.json").write_text(json.dumps(fields))
        for more in ([], ["--json"]):
            assert main(["info", "problem.json", *more]) in (0, 2)
            out, err = require_printable(capfd)
            assert json.loads(out) if more else len(err.splitlines()) <= 1
    for arguments in (["info"], ["plan"], ["check", "problem.yaml"], ["study"], ["view"]):
        assert main([*arguments, f"{code}.yaml"]) == 2
        require_printable(capfd)


def test_a_table_has_no_formula(folder, capsys):
    write(folder, "=1+1")
    number = re.compile(r"-(inf|\d+(\.\d*)?(e[+-]\d+)?)")
    for words in (
        ("sweep", "problem.yaml", "--radius", "0.0000001,0.03", "-o", "table.csv"),
        ("compare", "problem.yaml", "--methods", "stop-at-corners", "-o", "table.csv"),
    ):
        assert main(words) in (0, 1)
        rows = csv.reader(io.StringIO((folder / "table.csv").read_text()))
        for cell in (cell.lstrip() for row in rows for cell in row):
            assert cell[:1] not in ("=", "@", "+")
            assert cell[:1] != "-" or number.fullmatch(cell)


def test_tables_are_plain_on_a_terminal_too(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    table = Table("head", title="title")
    table.add_row("cell")
    assert "\x1b" not in rendered(table)


def test_what_pinocchio_complains_of_is_one_line(tmp_path):
    text = bundled_robots()["two_link"].read_text().replace("0.30 0 0", "&#9; 0 0", 1)
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(RobotError) as caught:
        load_robot(tmp_path / "arm.urdf", "hand")
    assert str(caught.value).isprintable()
