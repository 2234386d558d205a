"""Names that a page might take for markup, and a page of an explanation that is full of them."""

from xml.sax.saxutils import quoteattr

import yaml
from gantry import FIELDS, POST, URDF

from tubeplanner import Explanation, PlanOptions, Remedy, load_problem, plan

_BEGINNINGS = ["", "a ", "</script>", "-->", "\\", "'\"`", "]]>", "{{", "\u00e9", "&#60;"]
_MARKUP = [
    "<script>alert(1)</script>",
    "</script ><img src=x onerror=alert(1)>",
    "<svg/onload=alert(1)>",
    "<!-- <script>",
    "\"><b id='x'>",
    "' onclick='alert(1)",
    "</title><h1>",
    "<textarea>",
    "javascript:alert(1)",
    "${alert(1)}",
    "\\u003cb>",
]
_ENDS = ["", "</SCRIPT>", "<"]
HOSTILE = [begin + word + end for begin in _BEGINNINGS for word in _MARKUP for end in _ENDS]


def explained(folder, names):
    """Return what was found out about a gantry whose parts have these names, at least four.

    Its base is called as the first, its first axis as the second; obstacles have the others, of
    which the first is in the way. What helps names them all.
    """
    link, axis, *others = names
    text = URDF.replace('"base"', quoteattr(link)).replace('"along"', quoteattr(axis))
    (folder / "gantry.urdf").write_text(text)
    posts = [{**POST, "name": name, "position": [-k, 0.3, 0]} for k, name in enumerate(others)]
    posts[0] = {**posts[0], "position": [0, 0, 0]}
    robot = {"urdf": "gantry.urdf", "tool_frame": "head"}
    fields = {**FIELDS, "robot": robot, "obstacles": posts}
    path = folder / "gantry.yaml"
    path.write_text(yaml.safe_dump(fields))
    problem = load_problem(path)
    remedies = tuple(_remedy(name) for name in names)
    in_vain = tuple(f"obstacles.{name}.position" for name in others)
    result = plan(problem, PlanOptions(quality="fast"))
    return Explanation(link, problem, result, None, remedies, in_vain)


def _remedy(name):
    field, moved = f"obstacles.{name}.position", [0.1, 0, 0]
    text = f"move obstacle '{name}' by 100 mm in +x"
    return Remedy(field, [0, 0, 0], moved, "m", 1.0, text, {field: moved}, 1.0, None, "", True)
