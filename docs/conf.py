"""How Sphinx builds these pages: `make docs`."""

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import tubeplanner
from problem_fields import problem_fields
from reading_order import reading_order
from tubeplanner.problem.problem_format import problem_schema

project = "tubeplanner"
author = "The tubeplanner authors"
copyright = author
release = tubeplanner.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
]
default_role = "literal"
nitpicky = True
# Types of libraries, and those of our own that are only met as attributes.
nitpick_ignore_regex = [
    ("py:class", r"(collections|matplotlib|numpy|pathlib|pinocchio|scipy)\..*"),
    ("py:class", r"tubeplanner\.\w+\.\w.*"),
    ("py:class", "(Float|Int|Bool)Array|Figure"),
]

html_theme = "furo"
html_title = f"tubeplanner {release}"
html_theme_options = {"navigation_with_keys": True}
html_static_path = ["static"]
html_css_files = ["style.css"]

myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_use_ivar = True
python_maximum_signature_line_length = 88

# A public name is documented, and linked to, under the name by which it is imported.
for name in tubeplanner.__all__:
    public = getattr(tubeplanner, name)
    if hasattr(public, "__module__"):
        public.__module__ = "tubeplanner"


def _write_generated(app: object, page: str, source: list[str]) -> None:
    """Put what is made from the sources where a page asks for it."""
    source[0] = source[0].replace("{{ problem_fields }}", problem_fields(problem_schema()))
    source[0] = source[0].replace("{{ reading_order }}", reading_order())


def _shorten_arrays(
    app: object, what: str, name: str, item: object, options: object, *signature: str | None
) -> tuple[str | None, ...]:
    """Write arrays as the sources do: the alias has been replaced by what it stands for."""
    return tuple(text and _ARRAY.sub(_array_name, text) for text in signature)


def _array_name(match: re.Match[str]) -> str:
    return f"{match.group(1).capitalize()}Array"


_ARRAY = re.compile(r"~?(?:numpy\.)?ndarray\[.*?dtype\[~?(?:numpy\.)?(\w+?)(?:64|_)?\]\]")


def setup(app: Any) -> None:
    """Connect what is generated."""
    app.connect("source-read", _write_generated)
    app.connect("autodoc-process-signature", _shorten_arrays)
