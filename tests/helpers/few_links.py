"""Arms of a few words: links with a mass and solids, joints between them."""

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
