"""The modules in reading order, each with the first sentence of its docstring."""

import ast
from pathlib import Path

_ROOT = Path(__file__).parents[1]
_PACKAGE = _ROOT / "src" / "tubeplanner"
_WITHOUT_FOLDER = "What every folder may use."


def reading_order() -> str:
    """Return the folders as Markdown: a heading, a sentence and a table of modules each."""
    return "\n\n".join(_folder(name, modules) for name, modules in _order().items())


def _order() -> dict[str, tuple[str, ...]]:
    """Return the order that the tests hold: module names by folder."""
    tests = ast.parse((_ROOT / "tests" / "test_architecture.py").read_text())
    values = [
        node.value
        for node in tests.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ORDER"
    ]
    order: dict[str, tuple[str, ...]] = ast.literal_eval(values[0])
    return order


def _folder(name: str, modules: tuple[str, ...]) -> str:
    folder = _PACKAGE / name
    sentence = _first_sentence(folder / "__init__.py") if name else _WITHOUT_FOLDER
    rows = [f"| `{module}` | {_first_sentence(folder / f'{module}.py')} |" for module in modules]
    heading = f"## {name or 'No folder'}"
    return "\n".join([heading, "", sentence, "", "| module | what it is |", "|---|---|", *rows])


def _first_sentence(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
    return docstring.splitlines()[0].replace("|", "\\|")
