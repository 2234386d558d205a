"""The public names by the sections of the package's stub, for the page of the Python interface."""

import re
from enum import Enum
from inspect import getdoc, isclass
from pathlib import Path

import tubeplanner

_SECTION = re.compile(r"^# (.+)\n((?:# .+\n)*)((?:from .+\n)+)", re.M)
_IMPORT = re.compile(r"^from \.([\w.]+) import \w+ as (\w+)(  # returned)?$", re.M)
_SOURCES = "../../src/tubeplanner"
_BUILT = (
    "Names link to their source. `make docs` writes this page with arguments, attributes and "
    "methods to `output/docs/reference/api.html`."
)
_PACKAGE = Path(tubeplanner.__file__).parent


def public_table() -> str:
    """Return a table for each section: the names, with links to the source, and a sentence each."""
    return "\n\n".join([_BUILT, *(_names(*section) for section in _sections())])


def public_directives() -> str:
    """Return the same sections with autodoc directives: the whole reference, for the built page."""
    module = "```{eval-rst}\n.. py:currentmodule:: tubeplanner\n```"
    version = "```{eval-rst}\n.. autodata:: __version__\n```"
    return "\n\n".join([module, *(_directives(*section) for section in _sections()), version])


def _sections() -> list[tuple[str, str, str]]:
    """Return title, prose and imports of each section of the stub."""
    return _SECTION.findall((_PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))


def _names(title: str, prose: str, imports: str) -> str:
    rows = [_row(module, name) for module, name, _ in _IMPORT.findall(imports)]
    return "\n".join([*_heading(title, prose), "| name | what it is |", "|---|---|", *rows])


def _row(module: str, name: str) -> str:
    sentence = (getdoc(getattr(tubeplanner, name)) or "").split("\n")[0].replace("|", "\\|")
    source = f"{_SOURCES}/{module.replace('.', '/')}.py"
    return f'| <a id="tubeplanner.{name}"></a>[`{name}`]({source}) | {sentence} |'


def _directives(title: str, prose: str, imports: str) -> str:
    lines = [_directive(name, bool(returned)) for _, name, returned in _IMPORT.findall(imports)]
    return "\n".join([*_heading(title, prose), "```{eval-rst}", *lines, "```"])


def _heading(title: str, prose: str) -> list[str]:
    return [f"## {title}", "", *([prose.replace("# ", "")] if prose else [])]


def _directive(name: str, returned: bool) -> str:
    item = getattr(tubeplanner, name)
    if not isclass(item):
        return f".. autofunction:: {name}"
    if issubclass(item, Exception):
        return f".. autoexception:: {name}"
    options = [":members:"] + [":undoc-members:"] * issubclass(item, Enum)
    return "\n   ".join([f".. autoclass:: {name}{'()' * returned}", *options])
