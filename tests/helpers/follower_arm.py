"""An arm with joints that mimic others: turning and sliding, of one another, in two branches."""

LIMIT = '<limit lower="-2" upper="2" effort="50" velocity="3"/>'
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
