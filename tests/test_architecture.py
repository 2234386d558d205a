"""Reading order is the architecture: a module imports only modules above it in this list."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import tubeplanner

ORDER = {
    "": (
        "errors",
        "arrays",
        "polyline",
        "resources",
        "outcome",
        "progress",
    ),
    "robot": (
        "urdf_values",
        "urdf_link",
        "urdf",
        "srdf",
        "joint_limits",
        "pinocchio_model",
        "robot_model",
    ),
    "collision": (
        "convex_shape",
        "mesh_cover",
        "link_geometry",
        "obstacle",
        "gilbert",
        "separation",
        "collision_checker",
    ),
    "tube": (
        "rotations",
        "rotational_tube",
        "tube",
    ),
    "problem": (
        "problem_faults",
        "problem_format",
        "joint_values",
        "problem",
    ),
    "trajectory": (
        "bernstein",
        "joint_trajectory",
        "averaging",
        "fitted_spline",
    ),
    "verification": (
        "majorants",
        "enclosure",
        "closest_approach",
        "switching_samples",
        "tube_visits",
        "rotation_visits",
        "certificate",
        "verification",
        "refusal",
    ),
    "constraints": (
        "peaks",
        "time_scaling",
        "tube_membership",
    ),
    "branches": (
        "inverse_kinematics",
        "reference_turn",
        "segment_walk",
        "reference_branch",
        "joint_lines",
        "known_branches",
    ),
    "waypoint_search": (
        "waypoint_interpolation",
        "candidate_waypoints",
        "link_clearance",
        "segment_rules",
        "branch_and_bound",
    ),
    "suh_bishop": (
        "knot_trajectory",
        "knot_direction",
        "knot_modification",
        "suh_bishop",
    ),
    "refinement": (
        "phased_spline",
        "spline_start",
        "sampled_spline",
        "linear_rows",
        "limit_constraints",
        "tube_constraints",
        "rotation_constraints",
        "link_constraints",
        "spline_constraints",
        "control_variables",
        "linear_program",
        "sequential_program",
        "refinement",
        "sensitivities",
    ),
    "baselines": (
        "stop_at_corners",
        "time_parameterization",
        "fastest_parameterization",
        "tool_curve",
        "tool_path",
        "conventional_lines",
        "fixed_path_bang_bang",
        "smoothed_bang_bang",
        "bounded_deviation",
        "baselines",
    ),
    "planning": (
        "path_minimum",
        "plan_options",
        "plan_result",
        "stopping_plan",
        "refined_plan",
        "searched_plan",
        "suh_bishop_plan",
        "planner",
    ),
    "measurement": (
        "separation_bounds",
        "pair_clearance",
        "configuration_set",
        "counterexample_search",
        "largest_box",
        "segment_measurement",
        "folding_joints",
        "measured_tube",
        "tube_measurement",
        "sign_patterns",
    ),
    "tube_sources": (
        "zones",
        "free_space",
        "simplification",
        "tool_corners",
        "reference_tube",
        "measured_plan",
        "tube_answer",
        "trail",
        "teach",
        "joint_route",
        "goal_configurations",
        "route_candidates",
        "route",
    ),
    "studies": (
        "tolerance_sweep",
        "trajectory_measures",
        "comparison",
        "printed_results",
        "reproduction",
        "reproduction_page",
    ),
    "files": (
        "problem_file",
        "trajectory_file",
        "fingerprint",
        "file_notes",
        "export_samples",
        "export",
        "output_files",
        "problem_file",
        "taught_problem",
    ),
    "views": (
        "palette",
        "surface",
        "visual_mesh",
        "link_visuals",
        "viewpoint",
        "figure_files",
        "panels",
        "plotting",
        "study_plots",
        "comparison_plot",
        "reproduction_figures",
        "scene",
        "viewer",
    ),
    "commands": (
        "report",
        "interrupts",
        "console",
        "view_command",
        "study_commands",
        "measure_command",
        "tube_commands",
        "reproduce_command",
        "cli",
    ),
}
PACKAGE = Path(tubeplanner.__file__).parent
# Who may know which library.
KNOWS = {
    "pinocchio": {"robot.pinocchio_model", "robot.robot_model"},
    "fcl": {"collision.separation"},
    "yourdfpy": {"collision.link_geometry"},
    "trimesh": {"collision.mesh_cover", "views.visual_mesh"},
    "matplotlib": {
        "views.comparison_plot",
        "views.figure_files",
        "views.panels",
        "views.plotting",
        "views.reproduction_figures",
        "views.study_plots",
    },
    "meshcat": {"views.viewer"},
    "umsgpack": {"views.viewer"},
    "click": {
        "commands.console",
        "commands.measure_command",
        "commands.reproduce_command",
        "commands.study_commands",
        "commands.tube_commands",
        "commands.view_command",
        "commands.cli",
    },
    "rich": {"commands.report", "commands.console"},
    "piqp": {"refinement.linear_program"},
    "toppra": {"baselines.fastest_parameterization"},
    "yaml": {"files.trajectory_file"},
    "ompl": {"tube_sources.joint_route"},
    "pydantic": {"problem.problem_faults", "problem.problem_format"},
}


MODULES = tuple(
    f"{folder}.{name}".removeprefix(".") for folder, names in ORDER.items() for name in names
)


def file_of(module: str) -> Path:
    return PACKAGE / f"{module.replace('.', '/')}.py"


def imported(module: str) -> set[str]:
    """Return every module that a module's file imports anywhere, by full name."""
    names = set()
    for node in ast.walk(ast.parse(file_of(module).read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_here(module: str) -> set[str]:
    """Return the modules of this package that a module imports."""
    ours = {name.removeprefix("tubeplanner.") for name in imported(module)}
    return ours & set(MODULES)


def reachable(module: str) -> set[str]:
    found, queue = set(), [module]
    while queue:
        for name in imported_here(queue.pop()) - found:
            found.add(name)
            queue.append(name)
    return found


def test_the_list_names_every_module():
    files = {path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py")}
    files = {path for path in files if path.name != "__init__"}
    assert files == {Path(module.replace(".", "/")) for module in MODULES}


@pytest.mark.parametrize("folder", [name for name in ORDER if name])
def test_a_folder_says_what_it_is_and_no_more(folder):
    tree = ast.parse((PACKAGE / folder / "__init__.py").read_text())
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_only_modules_above_it(module):
    above = set(MODULES[: MODULES.index(module)])
    assert imported_here(module) <= above


def test_the_judge_does_not_reach_the_code_it_judges():
    folders = {name.rpartition(".")[0] for name in reachable("verification.verification")}
    assert folders == {"", "robot", "collision", "tube", "problem", "trajectory", "verification"}


@pytest.mark.parametrize("library", KNOWS)
def test_a_library_is_known_in_one_place(library):
    users = {m for m in MODULES if library in {name.split(".")[0] for name in imported(m)}}
    assert users == KNOWS[library]


def test_importing_the_package_loads_no_heavy_library():
    code = (
        "import sys, tubeplanner, tubeplanner.problem.problem, tubeplanner.planning.planner;"
        "print(sorted({'meshcat', 'matplotlib', 'yourdfpy', 'trimesh'} & set(sys.modules)))"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert output.stdout.strip() == "[]"


def test_the_command_line_starts_without_numpy():
    code = "import sys, tubeplanner.commands.cli; print('numpy' in sys.modules)"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert output.stdout.strip() == "False"


def test_every_public_name_exists_and_is_listed_for_type_checkers():
    source = ast.parse((PACKAGE / "__init__.py").read_text())
    block = next(node for node in source.body if isinstance(node, ast.If))
    listed = {alias.name for node in block.body for alias in node.names}
    assert listed == set(tubeplanner.__all__) - {"__version__"}
    assert all(getattr(tubeplanner, name) is not None for name in tubeplanner.__all__)


def test_an_unknown_public_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'paln'"):
        tubeplanner.paln  # noqa: B018


def test_no_function_is_long_and_no_module_huge():
    for module in MODULES:
        text = file_of(module).read_text()
        assert len(text.splitlines()) <= 400, module
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                first = node.body[1] if ast.get_docstring(node) and node.body[1:] else node.body[0]
                assert node.end_lineno - first.lineno < 40, f"{module}.{node.name}"
