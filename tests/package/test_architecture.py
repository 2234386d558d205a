"""The rules of the sources, beside those of import-linter in pyproject.toml."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from stored_trajectories import REFINEMENT, stored_path

import tubeplanner
from tubeplanner.native.build import SOURCES

PACKAGE = Path(tubeplanner.__file__).parent
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.name != "__init__.py"]
FOLDERS = sorted({path.parent for path in MODULES} - {PACKAGE})
TESTS = Path(__file__).parents[1]
# Which folders may know which library.
KNOWS = {
    "pinocchio": {"robot"},
    "fcl": {"geometry"},
    "coal": {"geometry"},
    "trimesh": {"geometry", "output"},
    "matplotlib": {"output"},
    "meshcat": {"output"},
    "umsgpack": {"output"},
    "click": {"cli"},
    "rich": {"cli"},
    "piqp": {"optimizer"},
    "toppra": {"first_guess"},
    "yaml": {"documents.py"},
    "mujoco": {"execution"},
    "distributed": {"studies"},
    "xacro": {"robot"},
    "pydantic": {"fields.py", "robot", "task", "studies"},
}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_folder_says_what_it_is_and_no_more_and_has_tests(folder):
    tree = ast.parse((folder / "__init__.py").read_text())
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1
    assert list((TESTS / folder.relative_to(PACKAGE).parts[0]).glob("test_*.py"))


def test_tests_lie_in_folders():
    assert [path.name for path in TESTS.glob("*.py")] == ["conftest.py"]


def test_a_library_is_known_in_few_folders():
    users = {library: set() for library in KNOWS}
    for path in MODULES:
        imported = re.findall(r"^\s*(?:import|from) (\w+)", path.read_text(), re.M)
        for library in users.keys() & set(imported):
            users[library].add(path.relative_to(PACKAGE).parts[0])
    assert users == KNOWS


def loaded_after(*codes):
    """Return the modules that are loaded after each piece of code, in one process."""
    code = "\n".join(f"import sys\n{each}\nprint('LOADED', *sys.modules)" for each in codes)
    command = [sys.executable, "-c", code]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    lines = [line for line in output.splitlines() if line.startswith("LOADED ")]
    return [set(line.split()[1:]) for line in lines]


@pytest.mark.dear("a process loads the planner")
def test_judging_loads_nothing_of_what_makes_trajectories_and_planning_no_heavy_library():
    judging, planning = loaded_after(
        "import tubeplanner.certificate.verification",
        "import tubeplanner.task.problem_reader, tubeplanner.planning.strategy",
    )
    loaded = {name.split(".")[1] for name in judging if name.startswith("tubeplanner.")}
    settings = tomllib.loads((TESTS.parent / "pyproject.toml").read_text())["tool"]["importlinter"]
    forbidden = next(c for c in settings["contracts"] if c["type"] == "forbidden")
    assert "certificate" in loaded
    assert loaded & {name.split(".")[1] for name in forbidden["forbidden_modules"]} == set()
    assert {"meshcat", "matplotlib", "trimesh"} & planning == set()


@pytest.mark.parametrize(
    "command",
    [
        pytest.param("check", marks=pytest.mark.dear("a process judges")),
        pytest.param("plan", marks=pytest.mark.slow),  # a process plans
    ],
)
def test_a_command_loads_no_library_that_it_can_do_without(command, bundled):
    """Mesh readers and hull libraries are not loaded once the cache has their results."""
    name = "ur5/over_the_wall"
    _ = bundled(name).collision
    files = [str(stored_path(name, REFINEMENT))] * (command == "check")
    words = [command, f"example:{name}", *files]
    (loaded,) = loaded_after(f"from tubeplanner.cli.main import main; assert main({words}) == 0")
    never = {"trimesh", "matplotlib", "meshcat", "ruamel", "toppra", "scipy"}
    assert loaded & never == set()


def test_the_command_line_starts_without_numpy():
    (loaded,) = loaded_after("import tubeplanner.cli.main")
    assert "tubeplanner.cli.main" in loaded
    assert "numpy" not in loaded


@pytest.mark.dear("a process describes the installation")
def test_the_installation_is_described_without_its_dependencies():
    (loaded,) = loaded_after("from tubeplanner.cli.main import main; assert main(['info']) == 0")
    never = {"pinocchio", "coal", "fcl", "scipy", "trimesh", "rich", "matplotlib", "piqp"}
    assert loaded & never == set()


def test_every_public_name_exists_and_is_seen_by_dir():
    assert dir(tubeplanner) == tubeplanner.__all__
    assert "__version__" in tubeplanner.__all__
    assert all(getattr(tubeplanner, name) is not None for name in tubeplanner.__all__)


def test_an_unknown_public_name_is_refused_and_a_near_one_suggested():
    command = [sys.executable, "-c", "import tubeplanner; tubeplanner.PlanOption"]
    output = subprocess.run(command, capture_output=True, text=True)
    assert "No tubeplanner attribute PlanOption. Did you mean: 'PlanOptions'?" in output.stderr


def test_native_code_is_short_and_listed():
    texts = {path.name: path.read_text().splitlines() for path in SOURCES.iterdir()}
    code = [line for text in texts.values() for line in text if re.match(r"\s*[^\s/]", line)]
    assert len(code) < 2700
    page = (TESTS.parent / "docs" / "development" / "architecture.md").read_text()
    rows = re.findall(r"^\| (`\w+\.(?:cpp|h)`[^|]*) \|", page, re.M)
    names = [name for row in rows for name in re.findall(r"`(\w*\.(?:cpp|h))`", row)]
    pairs = {f"{Path(names[k - 1]).stem}.h" for k, name in enumerate(names) if name == ".h"}
    assert {name for name in names if name != ".h"} | pairs == set(texts)
