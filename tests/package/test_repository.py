"""What lies beside the package: the recipe for conda-forge."""

import runpy
from pathlib import Path

import yaml

import tubeplanner

CONDA = Path(__file__).parents[2] / "packaging" / "conda"


def test_the_recipe_asks_for_what_pyproject_asks_for():
    files = runpy.run_path(str(CONDA / "dependencies.py"))["contents"]()
    different = [path.name for path, text in files.items() if path.read_text() != text]
    assert not different, "run packaging/conda/dependencies.py --write"


def test_the_recipe_is_of_this_version():
    context = yaml.safe_load((CONDA / "recipe.yaml").read_text())["context"]
    assert context["version"] == tubeplanner.__version__
