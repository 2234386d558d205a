"""The modules in reading order, each with the first sentence of its docstring."""

import ast
import tomllib
from copy import deepcopy
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from grimp import ImportGraph, build_graph

_ROOT = Path(__file__).parents[1]
_PACKAGE = _ROOT / "src" / "tubeplanner"
_WITHOUT_FOLDER = "Modules that every folder may import."


def reading_order() -> str:
    """Return a heading, a sentence and a table of modules for each folder, as Markdown."""
    layers = _layers()
    flat = [layer for layer in layers if not (_PACKAGE / layer).is_dir()]
    folders = {layer: _imported_first(layer) for layer in layers if layer not in flat}
    return "\n\n".join(_folder(name, modules) for name, modules in {"": flat, **folders}.items())


def _layers() -> list[str]:
    """Return the layers of import-linter: folders and modules without a folder, lowest first."""
    settings = tomllib.loads((_ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = next(c["layers"] for c in settings["contracts"] if c["type"] == "layers")
    return list(reversed(layers))


def _imported_first(folder: str) -> list[str]:
    """Return the modules of a folder, each after its imports, else by alphabet.

    An inner folder counts as one module, and stands there with its own modules.
    """
    package = f"tubeplanner.{folder}".replace("/", ".")
    graph = deepcopy(_import_graph())  # squashing is for this folder alone
    modules = graph.find_children(package)
    for name in modules:
        graph.squash_module(name)
    sorter = TopologicalSorter(
        {name: graph.find_modules_directly_imported_by(name) & modules for name in modules}
    )
    sorter.prepare()
    order: list[str] = []
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        sorter.done(*ready)
        order += [name.removeprefix(f"{package}.") for name in ready]
    return [module for name in order for module in _modules(folder, name)]


@cache
def _import_graph() -> ImportGraph:
    """Return the graph of imports of the package."""
    return build_graph("tubeplanner", cache_dir=None, exclude_type_checking_imports=True)


def _modules(folder: str, name: str) -> list[str]:
    """Return the module of a name, or the modules of the inner folder of that name."""
    if not (_PACKAGE / folder / name).is_dir():
        return [name]
    return [f"{name}/{module}" for module in _imported_first(f"{folder}/{name}")]


def _folder(name: str, modules: list[str]) -> str:
    folder = _PACKAGE / name
    sentence = _first_sentence(folder / "__init__.py") if name else _WITHOUT_FOLDER
    rows = [f"| `{module}` | {_first_sentence(folder / f'{module}.py')} |" for module in modules]
    heading = f"## {name or 'No folder'}"
    return "\n".join([heading, "", sentence, "", "| module | what it is |", "|---|---|", *rows])


def _first_sentence(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
    return docstring.splitlines()[0].replace("|", "\\|")
