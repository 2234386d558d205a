"""The rules of the sources, beside those of import-linter in pyproject.toml."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from grimp import build_graph
from importlinter.cli import lint_imports
from stored_trajectories import REFINEMENT, stored_path

import tubeplanner
from tubeplanner.native.build import SOURCES

PACKAGE = Path(tubeplanner.__file__).parent
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.name != "__init__.py"]
FOLDERS = sorted({path.parent for path in MODULES} - {PACKAGE})
TESTS = Path(__file__).parents[1]
# Who may know which library.
KNOWS = {
    "pinocchio": {
        "robot.frame_jacobian",
        "robot.frame_velocities",
        "robot.pinocchio_model",
        "robot.robot_model",
        "robot.tool_chain",
    },
    "fcl": {"collision.mesh_solid", "collision.separation"},
    "coal": {"collision.penetration"},
    "yourdfpy": {"collision.link_elements"},
    "trimesh": {"collision.mesh_bounds", "collision.mesh_cover", "views.visual_mesh"},
    "matplotlib": {
        "views.clearance_panel",
        "views.comparison_plot",
        "views.cycle_plot",
        "views.executed_planes",
        "views.execution_panels",
        "views.cycle_execution_plot",
        "views.cycle_marks",
        "views.execution_plot",
        "views.field_plot",
        "views.figure_files",
        "views.figure_grid",
        "views.motor_panels",
        "views.panels",
        "views.placement_map",
        "views.plotting",
        "views.reproduction_figures",
        "views.robot_plot",
        "views.space_frame",
        "views.space_panel",
        "views.duration_line",
        "views.status_marks",
        "views.strip_panel",
        "views.study_figure",
        "views.study_map",
        "views.study_plots",
        "views.time_panels",
        "views.value_scale",
    },
    "meshcat": {"views.page_file", "views.viewer"},
    "umsgpack": {"views.page_file"},
    "click": {
        "commands.check_command",
        "commands.console",
        "commands.explain_command",
        "commands.info_command",
        "commands.init_command",
        "commands.links_command",
        "commands.measure_command",
        "commands.place_command",
        "commands.reproduce_command",
        "commands.simulate_command",
        "commands.study_command",
        "commands.study_commands",
        "commands.tube_commands",
        "commands.version_option",
        "commands.view_command",
        "commands.workers",
        "commands.cli",
    },
    "rich": {
        "commands.report",
        "commands.comparison_report",
        "commands.console",
        "commands.cycle_info_text",
        "commands.cycle_report",
        "commands.explanation_report",
        "commands.info_text",
        "commands.place_report",
        "commands.study_report",
    },
    "piqp": {"refinement.sparse_program"},
    "toppra": {"baselines.fastest_parameterization"},
    "yaml": {"documents"},
    "mujoco": {"simulation.mujoco_model"},
    "ompl": {"tube_sources.joint_route"},
    "distributed": {"many.dask_executor"},
    "xacro": {"robot.xacro_file", "robot.xacro_process"},
    "pydantic": {
        "cycle.cycle_format",
        "problem.checked_fields",
        "problem.clearance_fields",
        "problem.field_types",
        "problem.limit_fields",
        "problem.moveit_limits",
        "studies.answer_fields",
        "problem.presets",
        "problem.pose_fields",
        "problem.problem_faults",
        "problem.problem_format",
        "problem.schema_place",
        "studies.study_format",
    },
}


def test_import_linter_finds_nothing():
    assert lint_imports(str(TESTS.parent / "pyproject.toml"), no_cache=True) == 0


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_folder_says_what_it_is_and_no_more(folder):
    tree = ast.parse((folder / "__init__.py").read_text())
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_tests_lie_as_the_modules_do(folder):
    modules = tuple(f"test_{path.stem}" for path in MODULES if path.parent == folder)
    files = list((TESTS / folder.relative_to(PACKAGE)).glob("test_*.py"))
    assert files
    assert [path.name for path in files if not path.stem.startswith(modules)] == []


def test_a_library_is_known_in_one_place():
    graph = build_graph("tubeplanner", include_external_packages=True, cache_dir=None)
    for library, users in KNOWS.items():
        found = graph.find_modules_that_directly_import(library)
        assert {name.removeprefix("tubeplanner.") for name in found} == users


def test_importing_the_package_loads_no_heavy_library():
    code = (
        "import sys, tubeplanner, tubeplanner.problem.problem_reader, tubeplanner.planning.planner;"
        "print(sorted({'meshcat', 'matplotlib', 'yourdfpy', 'trimesh'} & set(sys.modules)))"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert output.stdout.strip() == "[]"


def loaded_by(*arguments, cache):
    """Return the libraries that a command loads in a process of its own."""
    code = (
        "import sys; from tubeplanner.commands.cli import main;"
        "assert main(sys.argv[1:]) == 0; print('LOADED', *sys.modules)"
    )
    output = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=os.environ | {"TUBEPLANNER_CACHE": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return set(output.stdout.rsplit("LOADED", 1)[1].split())


def test_plan_and_check_load_no_library_that_they_can_do_without(tmp_path, monkeypatch):
    """What reads meshes and finds hulls is not loaded once the cache has what comes of them."""
    problem, stored = "example:ur5/over_the_wall", stored_path("ur5/over_the_wall", REFINEMENT)
    monkeypatch.setenv("TUBEPLANNER_CACHE", str(tmp_path))
    _ = tubeplanner.load_problem(problem).collision
    checked = loaded_by("check", problem, str(stored), cache=tmp_path)
    planned = loaded_by("plan", problem, cache=tmp_path)
    never = {"trimesh", "yourdfpy", "matplotlib", "meshcat", "ruamel", "toppra", "ompl"}
    assert (checked | planned) & never == set()
    assert {name for name in checked if name.startswith("scipy")} == set()
    # For the smoother tube of a second stage, and for PIQP where the native library is left out.
    parts = {name.split(".")[1] for name in planned if name.startswith("scipy.")}
    assert {part for part in parts if not part.startswith("_")} == {"sparse", "version"}


def test_judging_loads_nothing_of_what_makes_or_writes_trajectories():
    code = "import sys, tubeplanner.verification.verification; print(*sys.modules)"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    loaded = {name.split(".")[1] for name in output.stdout.split() if "tubeplanner." in name}
    settings = tomllib.loads((TESTS.parent / "pyproject.toml").read_text())["tool"]["importlinter"]
    forbidden = next(c for c in settings["contracts"] if c["type"] == "forbidden")
    assert "verification" in loaded
    assert loaded & {name.split(".")[1] for name in forbidden["forbidden_modules"]} == set()


def test_the_command_line_starts_without_numpy():
    code = "import sys, tubeplanner.commands.cli; print('numpy' in sys.modules)"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert output.stdout.strip() == "False"


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
    assert len(code) < 2500
    sources = {name: len(text) for name, text in texts.items()}
    page = (TESTS.parent / "docs" / "development" / "architecture.md").read_text()
    listed = {}
    for files, lines in re.findall(r"^\| (`\w+\.(?:cpp|h)`.*?) \| .* \| (\d+) \|$", page, re.M):
        files = files.replace(", `.h`", f", `{files[1:].split('.')[0]}.h`")
        listed[tuple(re.findall(r"`(.*?)`", files))] = int(lines)
    assert {name for names in listed for name in names} == set(sources)
    for names, lines in listed.items():
        assert sum(sources[name] for name in names) == pytest.approx(lines, rel=0.2, abs=10), names


def test_no_function_is_long_and_no_module_huge():
    for path in MODULES:
        text = path.read_text()
        assert len(text.splitlines()) <= 400, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                first = node.body[1] if ast.get_docstring(node) and node.body[1:] else node.body[0]
                assert node.end_lineno - first.lineno < 40, f"{path}: {node.name}"
