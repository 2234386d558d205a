"""A gantry whose best angle is known; names of its parts that a page might take for markup."""

import copy
from xml.sax.saxutils import quoteattr

import numpy as np
import yaml

from tubeplanner import Explanation, PlanOptions, Remedy, load_problem, plan

# Its axes reach 0 to 1 m; the base is a cube of 0.1 m about its origin, 0.05 m below the tool.
URDF = """<robot name="gantry"><link name="base">
  <collision><origin xyz="0 0 -0.1"/><geometry><box size="0.1 0.1 0.1"/></geometry>
  </collision></link>
<link name="bridge"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="head"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="along" type="prismatic"><parent link="base"/><child link="bridge"/>
  <axis xyz="1 0 0"/><limit lower="0" upper="1" effort="100" velocity="100"/></joint>
<joint name="across" type="prismatic"><parent link="bridge"/><child link="head"/>
  <axis xyz="0 1 0"/><limit lower="0" upper="1" effort="100" velocity="100"/></joint></robot>"""
ALONG, ACROSS = 3.0, 4.0  # [m/s^2]
LENGTH = 0.5  # of the straight path, along x [m]
# Both axes at their limits: the path along their sum, as a fraction of the turn to the left of it.
BEST_YAW = -np.arctan2(ACROSS, ALONG)
BEST_DURATION = 2 * np.sqrt(LENGTH / np.hypot(ALONG, ACROSS))
FIELDS = {
    "robot": {
        "urdf": "gantry.urdf",
        "tool_frame": "head",
        "limits": {
            "effort": {"along": float("inf"), "across": float("inf")},
            "velocity": {"along": float("inf"), "across": float("inf")},
            "acceleration": {"along": ALONG, "across": ACROSS},
        },
    },
    "tube": {"points": [[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]], "radius": 0.001},
    "start": {"joints": [0.0, 0.0]},
}
FLOOR = {"name": "floor", "box": [4, 4, 0.2], "position": [0, 0, -0.25]}
POST = {"name": "post", "box": [0.2, 0.2, 0.4], "position": [-0.3, 0.3, -0.15]}


def gantry(folder, obstacles=(), name="gantry", **changes):
    """Write the problem of the gantry into a folder, top-level fields changed; return its path."""
    (folder / "gantry.urdf").write_text(URDF)
    fields = {**copy.deepcopy(FIELDS), **changes}
    if obstacles:
        fields["obstacles"] = copy.deepcopy(list(obstacles))
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(fields, sort_keys=False))
    return path


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
    ineffective = tuple(f"obstacles.{name}.position" for name in others)
    result = plan(problem, PlanOptions(quality="fast"))
    return Explanation(link, problem, result, None, remedies, ineffective)


def _remedy(name):
    field, moved = f"obstacles.{name}.position", [0.1, 0, 0]
    text = f"move obstacle '{name}' by 100 mm in +x"
    return Remedy(field, [0, 0, 0], moved, "m", 1.0, text, {field: moved}, 1.0, None, "", True)
