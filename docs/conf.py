"""How Sphinx builds these pages: `make docs`."""

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import tubeplanner
from further_fields import further_fields
from gallery import gallery
from problem_fields import problem_fields
from public_sections import public_sections
from reading_order import reading_order
from tubeplanner.studies.study_file import study_schema
from tubeplanner.task.cycle_file import cycle_schema
from tubeplanner.task.problem_format import problem_schema

project = "tubeplanner"
author = "The tubeplanner authors"
copyright = author
release = tubeplanner.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "public_names",
]
default_role = "literal"
nitpicky = True
# Types of libraries, and those of our own that are only met as attributes.
nitpick_ignore_regex = [
    ("py:class", r"(collections|concurrent|matplotlib|numpy|pathlib|pinocchio|scipy)\..*"),
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
napoleon_attr_annotations = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 88


# Each is made once, for the page that asks: the import graph and the reference take seconds.
_GENERATED = {
    "{{ problem_fields }}": lambda: problem_fields(problem_schema()),
    "{{ cycle_fields }}": lambda: further_fields("Cycle", cycle_schema(), problem_schema()),
    "{{ study_fields }}": lambda: further_fields("Study", study_schema(), problem_schema()),
    "{{ gallery }}": gallery,
    "{{ public_sections }}": public_sections,
    "{{ reading_order }}": reading_order,
}


# On a code host a link to a Python name leads to its row; here, to its full reference.
_NAME_LINK = re.compile(r"\]\([\w./]*api\.md#(tubeplanner\.\w+)\)")


def _write_generated(app: object, page: str, source: list[str]) -> None:
    """Put generated parts where a page asks for them; lead links of names to their reference."""
    source[0] = _NAME_LINK.sub(r"](#\1)", source[0])
    for mark, generated in _GENERATED.items():
        if mark in source[0]:
            source[0] = source[0].replace(mark, generated())


def setup(app: Any) -> None:
    """Connect to Sphinx."""
    app.connect("source-read", _write_generated)
