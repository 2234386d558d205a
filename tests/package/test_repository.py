"""What lies beside the package: the recipe for conda-forge, the page of licences."""

import re
import runpy
import tomllib
from pathlib import Path

import yaml

import tubeplanner

ROOT = Path(__file__).parents[2]
CONDA = ROOT / "packaging" / "conda"


def test_the_recipe_asks_for_what_pyproject_asks_for():
    files = runpy.run_path(str(CONDA / "dependencies.py"))["contents"]()
    different = [path.name for path, text in files.items() if path.read_text() != text]
    assert not different, "run packaging/conda/dependencies.py --write"


def test_the_recipe_is_of_this_version():
    context = yaml.safe_load((CONDA / "recipe.yaml").read_text())["context"]
    assert context["version"] == tubeplanner.__version__


def test_every_direct_dependency_has_a_licence_in_its_page():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    texts = sum(project["optional-dependencies"].values(), project["dependencies"])
    direct = {re.split(r"[\[<>=]", text)[0].replace(".", "-") for text in texts} - {"tubeplanner"}
    page = (ROOT / "docs" / "development" / "licences.md").read_text()
    rows = set(re.findall(r"^\| ([\w-]+) \| \S+ \| [^|]+ \| [^|]+ \|$", page, re.M))
    assert direct - rows == set(), "run packaging/licence_table.py"
