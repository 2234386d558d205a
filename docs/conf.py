"""How Sphinx builds these pages: `make docs`."""

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import tubeplanner
from public_names import public_directives

DOCS = Path(__file__).parent.resolve()
project = "tubeplanner"
author = "The tubeplanner authors"
copyright = author
release = version = tubeplanner.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_types",
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
toc_object_entries = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_attr_annotations = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 88


# On a code host a link to a Python name leads to its row; here, to its full reference.
_NAME_LINK = re.compile(r"\]\([\w./]*api\.md#(tubeplanner\.\w+)\)")
_MARKDOWN_LINK = re.compile(r"\[([^]]+)\]\(([\w./]+\.md)(?:#[^)]*)?\)")
_PUBLIC_NAMES = re.compile(r"<!-- begin public_names.*<!-- end -->", re.S)
_GROUP = re.compile(r"^## (.+)\n((?:.|\n(?!## ))*)", re.M)
_PAGE_LINK = re.compile(r"\]\((\w[\w./]*)\.md\)")


def _adapt(app: object, page: str, source: list[str]) -> None:
    """Give a page what only the built pages can have: navigation, and the reference of names."""
    folder = (DOCS / page).parent

    def linked(match: re.Match[str]) -> str:
        """Keep the text alone of a link that leaves these pages: only a code host has its end."""
        is_inside = (folder / match[2]).resolve().is_relative_to(DOCS)
        return match[0] if is_inside else match[1]

    text = _NAME_LINK.sub(r"](#\1)", _MARKDOWN_LINK.sub(linked, source[0]))
    if page == "reference/api":
        text = _PUBLIC_NAMES.sub(lambda _: public_directives(), text)
    if page == "index":
        text += "".join(_toctree(*group) for group in _GROUP.findall(text))
    source[0] = text


def _toctree(title: str, group: str) -> str:
    """Return the navigation of a group of pages: those that the index lists."""
    pages = "\n".join(_PAGE_LINK.findall(group))
    return f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{pages}\n```\n" if pages else ""


def setup(app: Any) -> None:
    """Connect to Sphinx."""
    app.connect("source-read", _adapt)
