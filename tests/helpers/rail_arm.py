"""An arm of six joints, the first along a rail, as a URDF that is not bundled."""

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
