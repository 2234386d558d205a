"""The public names as the reference lists them: the sections of the package's stub."""

import re
from enum import Enum
from inspect import isclass
from pathlib import Path

import tubeplanner

_SECTION = re.compile(r"^# (.+)\n((?:# .+\n)*)((?:from .+\n)+)", re.M)
_IMPORT = re.compile(r" as (\w+)(  # returned)?$", re.M)


def public_sections() -> str:
    """Return the sections of the package's stub as Markdown, with directives for autodoc."""
    stub = Path(tubeplanner.__file__).with_suffix(".pyi").read_text()
    return "\n\n".join(_section(*section) for section in _SECTION.findall(stub))


def _section(title: str, prose: str, imports: str) -> str:
    directives = [_directive(name, bool(returned)) for name, returned in _IMPORT.findall(imports)]
    heading = [f"## {title}", "", prose.replace("# ", "")]
    return "\n".join([*heading, "```{eval-rst}", *directives, "```"])


def _directive(name: str, returned: bool) -> str:
    item = getattr(tubeplanner, name)
    if not isclass(item):
        return f".. autofunction:: {name}"
    if issubclass(item, Exception):
        return f".. autoexception:: {name}"
    options = [":members:"] + [":undoc-members:"] * issubclass(item, Enum)
    return "\n   ".join([f".. autoclass:: {name}{'()' * returned}", *options])
