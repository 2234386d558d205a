"""Pages and README say what is true: what they show is run, what they quote is printed."""

import ast
import json
import re
import shlex
from contextlib import redirect_stdout
from hashlib import sha256
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest
from arms import rail_arm
from ruamel.yaml import YAML

import tubeplanner
from tubeplanner import PlanOptions, load_cycle, load_study, read_preset
from tubeplanner.cli import plan as plan_command
from tubeplanner.cli.main import cli, main
from tubeplanner.fields import check_fields
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.planning import strategy as planner
from tubeplanner.studies.study_file import study_schema
from tubeplanner.task.cycle_file import cycle_schema
from tubeplanner.task.problem_format import ProblemFields, problem_schema

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text()
PAGES = {str(path.relative_to(ROOT)): path.read_text() for path in sorted(DOCS.rglob("*.md"))}
ALL_PAGES = {"README.md": README, **PAGES}
# Pages whose commands plan much: over 2 s, and over 0.5 s of processor time.
SLOW = tuple(
    f"docs/how_to/{name}.md"
    for name in (
        *("contacts", "cycles", "dispensing", "executed", "place", "smooth", "studies"),
        "studies_on_a_cluster",
    )
)
DEAR = (
    *("docs/concepts/planning.md", "docs/concepts/sensitivities.md", "docs/first_plan.md"),
    *("docs/how_to/plan_again.md", "docs/how_to/zones.md"),
)
BLOCK = re.compile(r"^(<!-- not run: .* -->\n)?```(\w+)\n(.*?)^```$", re.M | re.S)
# What another processor's rounding may move: numbers with a point, and whole ones with a unit.
NUMBER = r"-?\d+(?:\.\d*(?:e[+-]?\d+)?|(?= (?:ms|mm|%)))"
NUMBER_TOLERANCE = 0.1  # relative
# What a part of a problem file is completed with.
REST = {
    "robot": {"urdf": "example:ur5", "tool_frame": "tool0"},
    "tube": {"points": [[0.4, 0, 0.4], [0.4, 0.2, 0.4]], "radius": 0.05},
    "start": {"seed": [0.0] * 6},
}
QUOTED = re.findall(r"^> `(.*)`$", PAGES["docs/how_to/troubleshooting.md"], re.M)
RAIL = """\
robot: {urdf: arm.urdf, tool_frame: flange}
tube: {points: [[0.4, 0.5, 0.7], [0.4, 0.5, 0.5]], radius: 0.05}
start: {seed: [0, 1, 0.5, 1.4, -0.4, 0]}
"""
WALL = """\
robot:
  urdf: example:ur5
  tool_frame: tool0
tube:
  points: [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [0.45, 0.3, 0.2]]
  radius: [0.03, 0.08, 0.03]
  joint_signs: {elbow_joint: "+"}
start: {joints: [-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0]}
obstacles:
  - {name: wall, box: [0.6, 0.05, 0.44], position: [0.6, 0, 0.22]}
  - {name: table, box: [0.9, 1.6, 0.04], position: [0.75, 0, -0.02]}
clearance: 0.01
"""
CONTACTS = "contacts:\n  - {links: [part, table], within: 0.03}\n"
XACRO = 'name="rail_arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename='
SOLID = '<cylinder radius="0.03" length="0.02"/>'
IN_DEGREES = """\
joint_limits:
  elbow_joint: {has_velocity_limits: true,
    max_velocity: !degrees 180.0}
"""


def require_same(printed, text):
    """Compare what is printed with what a page shows: `...` is anything, numbers are near."""
    printed, text = " ".join(printed.split()), " ".join(text.split())
    words = re.split(rf"(\.\.\.|{NUMBER})", text)
    patterns = {"...": ".*?"}
    words[::2] = map(re.escape, words[::2])
    expected = [float(word) for word in words[1::2] if word not in patterns]
    words[1::2] = [patterns.get(word, f"({NUMBER})") for word in words[1::2]]
    found = re.fullmatch("".join(words), printed, re.S)
    numbers = [float(number) for number in found.groups()] if found else None
    same = numbers == pytest.approx(expected, rel=NUMBER_TOLERANCE)
    assert same, f"the page shows\n{text}\nbut this is printed\n{printed}"


def read_page(text, page):
    """Compile and read the blocks of a page; yield those that run, and what they print."""
    for not_run, language, block in BLOCK.findall(text):
        if language == "python" or not_run:
            compile(block, page, "exec")
        elif language == "yaml":
            keep_problem(block)
        elif language == "json":
            json.loads(block)
        else:
            known = language in ("text", "console", "sh")
            assert known, f"{page}: nothing is done with blocks of '{language}'"
        if not not_run:
            yield language, block


def run_page(text, page="page"):
    """Run the blocks of a page from top to bottom, as a reader would."""
    names, printed = {}, ""
    for language, block in read_page(text, page):
        if language == "python":
            with redirect_stdout(StringIO()) as stream:
                exec(compile(block, page, "exec"), names)
            printed = stream.getvalue()
        elif language == "text":
            require_same(printed, block)
        elif language == "console":
            run_session(block)


def run_session(block):
    """Run the commands of a console block; compare what they print."""
    for command, output in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.M):
        with redirect_stdout(StringIO()) as stream:
            main(shlex.split(command, comments=True)[1:])
        require_same(stream.getvalue(), output)


def keep_problem(block):
    """Check a problem file, a part of one or a preset; keep a whole problem as problem.yaml."""
    fields = YAML(typ="safe", pure=True).load(block)
    if fields.get("format") == "tubeplanner/preset":
        Path("preset.yaml").write_text(block)
        read_preset("preset.yaml")
        return
    loaders = {"tubeplanner/cycle": load_cycle, "tubeplanner/study": load_study}
    if load := loaders.get(fields.get("format")):
        path = Path(fields["format"]).with_suffix(".yaml").name
        Path(path).write_text(block)
        load(path)
        return
    whole = {name: {**REST.get(name, {}), **value} for name, value in sections(fields).items()}
    check_fields(ProblemFields, {**REST, **fields, **whole}, "the page")
    if fields.keys() >= REST.keys():
        Path("problem.yaml").write_text(block)


def sections(fields):
    return {name: value for name, value in fields.items() if isinstance(value, dict)}


@pytest.fixture
def planned_once(shared, monkeypatch):
    """What several pages plan is planned once."""
    planned = planner.plan

    def once(problem, options=None, progress=None):
        key = sha256(f"{problem_hash(problem)} {options or PlanOptions()}".encode()).hexdigest()
        return shared(f"of_pages.{key}", lambda: planned(problem, options, progress))

    monkeypatch.setattr(tubeplanner, "plan", once)
    monkeypatch.setattr(planner, "plan", once)
    monkeypatch.setattr(plan_command, "plan_problem", once)


@pytest.mark.parametrize("page", SLOW)
def test_the_blocks_of_a_slow_page_can_be_read(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert all(block for _, block in read_page(PAGES[page], page))


def page_case(page):
    """Return a page as a parameter, marked by what its commands cost."""
    if page in SLOW:
        return pytest.param(page, marks=pytest.mark.slow)
    marks = [pytest.mark.dear("runs the commands of a page")] if page in DEAR else []
    return pytest.param(page, marks=marks)


@pytest.mark.parametrize("page", [page_case(page) for page in PAGES])
def test_a_page_runs_and_prints_what_it_shows(page, planned_once, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(PAGES[page], page)


def lines_of(program):
    """Return the arguments of every run of a program, on a line of its own or in a sentence."""
    whole, inline = rf"^(?:\$ )?{program} (\w.*)$", rf"`{program} (\w+ [^`]+)`"
    return [
        pytest.param(line, id=f"{page}: {line}")
        for page, text in ALL_PAGES.items()
        for line in re.findall(whole, text, re.M) + re.findall(inline, text)
    ]


@pytest.mark.parametrize("line", lines_of("tubeplanner"))
def test_a_command_can_be_given(line):
    words = shlex.split(line.partition(" > ")[0], comments=True)
    cli.commands[words[0]].make_context(words[0], words[1:])


@pytest.mark.parametrize("line", lines_of("python"))
def test_a_script_exists_and_knows_its_options(line):
    script, *words = shlex.split(line, comments=True)
    source = (ROOT / script).read_text()
    assert all(f'"{word}"' in source for word in words if word.startswith("--"))


def test_integers_that_are_no_measures_are_compared_exactly():
    require_same("3 steps, 28 ms,  [0.5  1. ]", "3 steps, 27 ms, [0.51 ...]")
    with pytest.raises(AssertionError):
        require_same("3 steps, 28 ms", "4 steps, 28 ms")


def test_what_a_page_shows_is_compared():
    page = "```python\nprint('0.504 s in 3 steps')\n```\n\n```text\n{} in ...\n```\n"
    run_page(page.format("0.54 s"))
    for other in ("0.56 s", "0.504 m", "1 s"):
        with pytest.raises(AssertionError, match=rf"{other} in(.|\n)*0\.504 s in 3"):
            run_page(page.format(other))


def python_shown():
    """Return the Python of every page and notebook."""
    for page, text in ALL_PAGES.items():
        for number, (_, language, block) in enumerate(BLOCK.findall(text)):
            if language == "python":
                yield pytest.param(block, id=f"{page}: block {number}")
    for notebook in sorted((ROOT / "notebooks").glob("*.py")):
        yield pytest.param(notebook.read_text(), id=notebook.name)


def modules_of_the_package(code):
    """Return the modules below the package, and the names not public, that code imports."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            yield from (name for name in names if name.startswith("tubeplanner."))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tubeplanner."):
            yield node.module
        elif isinstance(node, ast.ImportFrom) and node.module == "tubeplanner":
            names = [alias.name for alias in node.names]
            yield from (name for name in names if name not in tubeplanner.__all__)


@pytest.mark.parametrize("code", list(python_shown()))
def test_only_public_names_are_shown(code):
    assert list(modules_of_the_package(code)) == []


def test_a_module_of_the_package_is_found_wherever_it_is_imported():
    code = """
from tubeplanner import load_problem, resources
import numpy, tubeplanner, tubeplanner.output.drawing as palette

def draw():
    from tubeplanner.output.figures.panels import line_style
"""
    found = ["resources", "tubeplanner.output.drawing", "tubeplanner.output.figures.panels"]
    assert list(modules_of_the_package(code)) == found


@pytest.fixture
def tables(monkeypatch):
    """The module that writes parts of pages."""
    monkeypatch.syspath_prepend(DOCS)
    return import_module("tables")


@pytest.mark.dear("imports every command and builds the graph of imports")
def test_the_parts_of_pages_that_are_written_are_fresh(tables):
    for page, text in PAGES.items():
        assert tables.written(text) == text, f"{page} is not as the sources are: make docs-tables"


def test_every_part_is_on_a_page_and_every_command_has_its_options(tables):
    parts = [match.groups()[1:3] for text in PAGES.values() for match in tables.PART.finditer(text)]
    named = [name for name, argument in parts if argument is None]
    assert sorted([*named, "options"]) == sorted(tables.PARTS)
    commands = [argument for name, argument in parts if name == "options"]
    assert commands == cli.list_commands(None)


def test_a_table_of_options_has_names_defaults_and_bounds(tables):
    page = PAGES["docs/reference/command_line.md"]
    for text in (
        "\n| [`plan`](#plan) | Plan PROBLEM, ",
        "\nArguments: `PROBLEM` `TRAJECTORY`\n",
        "\n| `--json` | Print one JSON object. |\n",
        "\n| `-o, --output FILE` | Trajectory file (JSON). |\n",
        "Default: balanced. |\n",
        "At least 1. |\n",
        "Required. |\n",
    ):
        assert text in page


def test_every_public_name_is_documented_once(tables):
    from public_names import public_directives

    documented = re.findall(r"^\.\. auto\w+:: (\w+)", public_directives(), re.M)
    assert sorted(documented) == tubeplanner.__all__
    rows = re.findall(
        r'^\| <a id="tubeplanner\.(\w+)"></a>\[`\1`\]\((.+)\) \| \S.* \|$',
        PAGES["docs/reference/api.md"],
        re.M,
    )
    assert sorted([*(name for name, _ in rows), "__version__"]) == tubeplanner.__all__
    for name, source in rows:
        assert re.search(rf"\b{name}\b", (DOCS / "reference" / source).read_text())


def require_described(page, sections):
    """Check that a page has the text of every section and a row for every field."""
    for section in sections:
        assert section["description"] in page
        assert all(page.count(f"\n| `{name}` | ") for name in section["properties"])


def test_every_field_of_the_problem_file_is_documented():
    page, schema = PAGES["docs/reference/problem_file.md"], problem_schema()
    require_described(page, (schema, *schema["$defs"].values()))
    for text in (
        "\n### start, goal\n",
        "\n### tube.cross_section\n",
        "\n| `radius` | number, or list of these | m | required | ",
        "\n| `gravity` | [3 numbers] | m/s² | `[0.0, 0.0, -9.81]` | base frame |",
        "| [section](#robottool_offset) |",
        "\n### robot.tool_offset\n",
    ):
        assert text in page


def test_every_field_of_the_cycle_file_is_documented():
    schema, common = cycle_schema(), problem_schema()
    page = PAGES["docs/reference/cycle_file.md"]
    own = [schema["$defs"][name] for name in schema["$defs"] if name not in common["$defs"]]
    assert {"MoveFields", "AttachFields"} <= set(schema["$defs"])
    require_described(page, (schema, *own))
    kinds = ("move", "event", "attach", "detach")
    sections = ", or ".join(f"[section](#{kind})" for kind in kinds)
    assert f"\n| `moves` | list of ({sections}) |  | required | " in page
    assert "\n| `dwell` | number | s | `0.0` | how long the arm stays |" in page
    assert "[section](problem_file.md#tube)" in page


def test_every_field_of_the_study_file_is_documented():
    page, schema = PAGES["docs/reference/study_file.md"], study_schema()
    require_described(page, (schema, *schema["$defs"].values()))
    kinds = "(list of anything, or [section](#studyvary))"
    assert f"\n| `vary` | map to {kinds} |  | `{{}}` | " in page
    assert '\n| `design` | `"grid"`, or [section](#studydesign) |  | `"grid"` | ' in page


def first_block(language, text):
    return re.search(rf"```{language}\n(.*?)```", text, re.S).group(1)


def demo_command():
    """Return what `make demo` runs, as a command line."""
    text = (ROOT / "Makefile").read_text()
    problem = re.search(r"^PROBLEM \?= (.*)$", text, re.M).group(1)
    recipe = re.search(r"^demo:.*\n(?:\t.*\n)*?\t\$\(BIN\)/(tubeplanner .*)$", text, re.M).group(1)
    return recipe.replace("$(PROBLEM)", problem)


@pytest.mark.slow  # plans the cycle of `make demo`
def test_commands_of_the_readme_print_what_it_shows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("output").mkdir()
    assert "$ make demo\n" in README
    run_page(README.replace("$ make demo\n", f"$ {demo_command()}\n"), "README.md")


def test_the_demo_is_a_motion_that_a_machine_can_follow():
    peak = re.search(r"tool acceleration ([\d.]+) m/s\^2", README)
    assert float(peak.group(1)) < 3 * 9.81  # [m/s^2]


def test_the_readme_fits_a_page():
    prose = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", BLOCK.sub("", README))
    assert len(re.findall(r"\w[^\s|]*", prose)) <= 700
    assert all(len(line) < 120 for line in README.splitlines() if not line.startswith("|"))


def test_a_release_fits_a_page_of_the_changelog():
    _, *releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    assert max(len(release.splitlines()) for release in releases) <= 60


def anchors(text):
    """Return the anchors of a page on a code host: of its headings, and those that it sets."""
    titles = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S), re.M)
    slugs = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
    assert len(slugs) == len(set(slugs)), "two headings of a page have one anchor"
    return {*slugs, *re.findall(r'<a id="([\w.]+)"></a>', text)}


@pytest.mark.parametrize(
    "page",
    [*ALL_PAGES, "CONTRIBUTING.md", "RELEASING.md", "tests/README.md", "notebooks/README.md"],
)
def test_every_link_of_a_page_has_a_text_and_leads_somewhere(page):
    """On a code host too, which fills in no text and no directive."""
    path = ROOT / page
    text = path.read_text()
    assert not re.search(r"(?<!!)\[\s*\]\(", text), "write the title of the page that it leads to"
    assert not re.search(r"^```\{|\{\{", text, re.M), "a code host shows no directive"
    for target in re.findall(r"\]\((?!http)([^)\s]+)\)", text):
        name, _, anchor = target.partition("#")
        other = (path.parent / name).resolve() if name else path
        assert other.exists(), target
        assert not anchor or anchor in anchors(other.read_text()), target


PAGES_OF_PATHS = (
    *(page for page in PAGES if page.startswith("docs/development/")),
    *("CONTRIBUTING.md", "RELEASING.md", "tests/README.md", "benchmarks/README.md"),
)


@pytest.mark.parametrize("page", PAGES_OF_PATHS)
def test_a_path_on_a_page_for_contributors_is_there(page):
    """Paths begin at the root, in `src`, at the package or at the page."""
    written = r"<!-- begin modules.*<!-- end -->"
    text = re.sub(rf"^```.*?^```$|{written}", "", (ROOT / page).read_text(), flags=re.M | re.S)
    paths = re.findall(r"(?<![\w/.])((?:[a-z_]+/)+(?:[a-z_0-9]+(?:\.\w+)?)?)(?=[`\s])", text)
    begins = (ROOT, ROOT / "src", ROOT / "src" / "tubeplanner", (ROOT / page).parent)
    for path in set(paths) - {"output/wheel", "output/mutants"}:
        assert any((begin / path).exists() for begin in begins), path


def test_the_index_has_a_line_for_every_page():
    listed = re.findall(r"^- \[[^]]+\]\(([^.)]+)\.md\): \S.*\.$", PAGES["docs/index.md"], re.M)
    pages = [page.removeprefix("docs/").removesuffix(".md") for page in PAGES]
    assert sorted([*listed, "index"]) == sorted(pages)


PICK = first_block("yaml", PAGES["docs/how_to/contacts.md"])
CYCLE = first_block("yaml", PAGES["docs/how_to/cycles.md"])
WEIGHT = re.search(r"part, payload: .*", CYCLE).group(0)


def changed(text, *changes):
    """Return a text with every old part replaced by its new one."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def arm(old, new, name="arm.urdf"):
    """Return the files of a problem whose arm has a mistake."""
    robot = changed(rail_arm(), (old, new))
    return {name: robot, "problem.yaml": RAIL.replace("arm.urdf", name)}


def wall(old, new):
    return {"problem.yaml": changed(WALL, (old, new))}


def robot(field):
    """Return the files of a problem whose robot has a further field."""
    return wall("tool_frame: tool0\n", f"tool_frame: tool0\n  {field}\n")


def pick(*changes):
    return {"problem.yaml": changed(PICK, *changes)}


def cycle(*changes):
    return {"cycle.yaml": changed(CYCLE, *changes)}


def slow(files):
    """Mark what is planned before it is refused."""
    return pytest.param(files, marks=pytest.mark.slow)


# Of each quoted message, in the page's order; the last file is planned.
MISTAKES = [
    arm('name="rail_arm">', f'{XACRO}"hand.xacro"/>'),
    arm('name="rail_arm">', f'{XACRO}"$(find our_description)/a.xacro"/>', "arm.urdf.xacro"),
    arm(SOLID, '<mesh filename="package://our_description/meshes/flange.stl"/>'),
    arm(SOLID, '<mesh filename="meshes/flange.stl"/>'),
    {"flange.dae": "nonsense", **arm(SOLID, '<mesh filename="flange.dae"/>')},
    arm("</robot>", ""),
    {**arm("", ""), "problem.yaml": RAIL.replace("flange", "tool")},
    arm('effort="80"', 'effort="0"'),
    arm('<limit lower="-2.2" upper="2.2" effort="28" velocity="4"/>', ""),
    arm('<mass value="2.5"/>', '<mass value="0"/>'),
    robot("preset: fer"),
    {"joint_limits.yaml": IN_DEGREES, **robot("limits_file: joint_limits.yaml")},
    wall("clearance", "clearence"),
    wall("  radius", "\tradius"),
    {"arm.urdf": rail_arm()},
    wall(", 0.0]}", "]}"),
    wall("[0.03, 0.08, 0.03]", "[0.03, 0.08]"),
    wall("-0.773861", "-0.673861"),
    wall("-0.773861", "-44.3"),
    wall('elbow_joint: "+"', 'elbow_joint: "-"'),
    pick(
        ("[1, 0, 0, 0]", "[0, 0.7071068, -0.7071068, 0]"),
        (
            "start: {seed: [-0.8, -1.3, 1.9, -2.2",
            "start: {joints: [-0.7912, -1.312, 1.9004, -2.1592",
        ),
    ),
    pick(("orientations: [[1, 0, 0, 0]", "orientations: [[0.7, -0.9, 0, 0]")),
    pick(("[1, 0, 0, 0]]", "[0, 0, 0, 1]]")),
    wall("elbow_joint", "elbow"),
    pick((CONTACTS, "")),
    pick(("within: 0.03}", "within: 0.03, segments: [-1]}")),
    wall("position: [0.75, 0, -0.02]", "position: [0.75, 0, 0.18]"),
    wall("clearance: 0.01", "clearance: 0.08"),
    robot("attached: [{name: gripper, box: [0.3, 0.1, 0.1], position: [0, 0, -0.02]}]"),
    slow(wall("0.44], position: [0.6, 0, 0.22]", "0.9], position: [0.6, 0, 0.45]")),
    wall("[0.45, 0.3, 0.2]]", "[0.95, 0.5, 0.2]]"),
    slow(
        wall('{elbow_joint: "+"}', '[{elbow_joint: "+"}, {elbow_joint: "+"}, {elbow_joint: "-"}]')
    ),
    slow(wall('"+"}', '"+", shoulder_pan_joint: "-"}')),
    robot("payload: {mass: 30, com: [0, 0, 0.05]}"),
    slow(wall("clearance: 0.01", "objective: {duration: 0.3}")),
    cycle(("points: [[0.45, 0.3, 0.1]", "points: [[0.45, 0.2, 0.1]")),
    cycle((WEIGHT, "prt}")),
    cycle(("  - {detach: part}\n", "")),
    cycle(("closed: true", "closed: true\nperiod: 0.004")),
]


@pytest.mark.parametrize("files", MISTAKES, ids=range(len(MISTAKES)))
def test_a_mistake_gets_the_message_that_is_quoted(files, request, tmp_path, monkeypatch, capsys):
    number = int(request.node.callspec.id)
    assert len(QUOTED) == len(MISTAKES)
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        Path(name).write_text(text)
    assert main(["plan", list(files)[-1]]) in (1, 2)
    printed = capsys.readouterr()
    require_same(f"{printed.out} {printed.err} end", f"...{QUOTED[number]} ...")
