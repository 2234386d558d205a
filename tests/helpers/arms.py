"""Arms that are not bundled, as URDF: of a few words, with joints that follow, on a rail."""

import numpy as np
import trimesh

from tubeplanner import load_robot

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="2"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2" effort="50" velocity="3"/>'


def link(name, inner=INERTIAL):
    return f'<link name="{name}">{inner}</link>'


def links(*names):
    return "".join(map(link, names))


def solid(geometry, origin=""):
    """Return a collision element."""
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def solid_link(name, geometry, origin=""):
    return link(name, INERTIAL + solid(geometry, origin))


def joint(name, parent, child, kind="revolute", xyz="0 0 0", axis="0 0 1", limit=LIMIT):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def written(folder, *elements):
    """Return the path of the arm of links and joints, written to a folder."""
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(elements)}</robot>')
    return path


def loaded(folder, *elements, tool="tip", **options):
    return load_robot(written(folder, *elements), tool, **options)


def axle(folder, radius=0.08, sections=16):
    """Return a rod that turns inside of a ring, two joints away from it."""
    trimesh.creation.annulus(0.1, 0.2, 0.05, sections=sections).export(folder / "ring.stl")
    return loaded(
        folder,
        solid_link("ring", '<mesh filename="ring.stl"/>'),
        solid_link("middle", '<sphere radius="0.01"/>', '<origin xyz="0 0 1"/>'),
        solid_link("rod", f'<cylinder radius="{radius}" length="0.3"/>'),
        joint("one", "ring", "middle"),
        joint("two", "middle", "rod"),
        tool="rod",
    )


# What becomes of a closed mesh: triangles that are no closed shell, or not wound alike.
OPENED = {
    "no top": lambda mesh: mesh.faces[mesh.face_normals[:, 2] < 0.9],
    "no top, no side": lambda mesh: mesh.faces[mesh.face_normals[:, [0, 2]].max(axis=1) < 0.9],
    "some turned": lambda mesh: np.vstack(
        [mesh.faces[::3, ::-1], mesh.faces[1::3], mesh.faces[2::3]]
    ),
    "both sides": lambda mesh: np.vstack([mesh.faces, mesh.faces[:, ::-1]]),
}


def opened(mesh, kind, path):
    """Write a mesh, opened in a way of `OPENED` or as it is; return the path."""
    faces = OPENED[kind](mesh) if kind in OPENED else mesh.faces
    trimesh.Trimesh(mesh.vertices, faces, process=False).export(path)
    return path


# An arm with joints that mimic others: turning and sliding, of one another, in two branches.
WIDE = '<limit lower="-9" upper="9" effort="50" velocity="99"/>'
# By joint: what it mimics, how fast, and from where.
RULES = {
    "second": ("first", -2.0, 0.3),
    "slide": ("lift", 0.5, 0.1),
    "tip_joint": ("second", 0.5, 0.2),
}
JOINTS = {
    "lift": ("prismatic", "base", "column", "0.1 0 0.2", "0 0 1"),
    "first": ("revolute", "column", "upper", "0 0.1 0", "0 0 1"),
    "second": ("revolute", "upper", "fore", "0.4 0 0", "0 0.6 0.8"),
    "slide": ("prismatic", "fore", "rod", "0.3 0 0.1", "1 0 0"),
    "wrist": ("revolute", "rod", "hand", "0.2 0.1 0", "0 1 0"),
    "tip_joint": ("revolute", "hand", "tip", "0.1 0 0", "1 0 0"),
    "side_joint": ("revolute", "column", "side", "0 -0.4 0", "1 0 0"),
}
LINKS = ("base", *(joint[2] for joint in JOINTS.values()))


def follower_arm(rules=None, own=None):
    """Return its URDF, with other rules or other limits of some joints."""
    rules = RULES if rules is None else rules
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0.1 0.02 0"/><mass value="2"/>'
        '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><box size="0.1 0.04 0.04"/></geometry></collision></link>'
        for name in LINKS
    )
    joints = ""
    for name, (kind, parent, child, xyz, axis) in JOINTS.items():
        mimic = ""
        if name in rules:
            master, multiplier, offset = rules[name]
            mimic = f'<mimic joint="{master}" multiplier="{multiplier}" offset="{offset}"/>'
        limit = (own or {}).get(name, WIDE if name in RULES else LIMIT)
        joints += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}{mimic}</joint>'
        )
    return f'<robot name="arm">{links}{joints}</robot>'


# An arm of six joints, the first along a rail.
# Name, type, axis, where it begins on its parent [m], half its range, effort, velocity, link,
# its mass [kg] and half its length [m].
_JOINTS = (
    ("rail", "prismatic", "1 0 0", 0.3, 0.5, 800, 1, "carriage", 10, 0.05),
    ("turn", "revolute", "0 0 1", 0.05, 3.1, 150, 3, "column", 5, 0.1),
    ("shoulder", "revolute", "0 1 0", 0.2, 2, 150, 3, "upper", 4, 0.2),
    ("elbow", "revolute", "0 1 0", 0.4, 2.6, 80, 3, "fore", 2.5, 0.15),
    ("tilt", "revolute", "0 1 0", 0.35, 2.2, 28, 4, "wrist", 1, 0.05),
    ("roll", "revolute", "0 0 1", 0.1, 6.2, 28, 4, "flange", 0.4, 0.02),
)


def rail_arm() -> str:
    """Return its URDF, a line for each element."""
    lines = ['<robot name="rail_arm">', '<link name="base"/>']
    parent = "base"
    for name, kind, axis, z, end, effort, velocity, link, mass, half in _JOINTS:
        lines += [
            f'<joint name="{name}" type="{kind}">',
            f'<parent link="{parent}"/> <child link="{link}"/>',
            f'<axis xyz="{axis}"/> <origin xyz="0 0 {z}"/>',
            f'<limit lower="-{end}" upper="{end}" effort="{effort}" velocity="{velocity}"/>',
            "</joint>",
            f'<link name="{link}">',
            f'<inertial> <origin xyz="0 0 {half}"/> <mass value="{mass}"/>',
            f'<inertia ixx="{mass * half**2}" iyy="{mass * half**2}" izz="{mass * 1e-3}" '
            'ixy="0" ixz="0" iyz="0"/> </inertial>',
            f'<collision> <origin xyz="0 0 {half}"/>',
            f'<geometry> <cylinder radius="0.03" length="{half}"/> </geometry> </collision>',
            "</link>",
        ]
        parent = link
    return "\n".join([*lines, "</robot>", ""])
