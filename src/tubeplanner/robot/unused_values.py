"""What the joints of a URDF say and planning does not use unasked: friction, further limits."""

from xml.etree.ElementTree import Element

_SOFT = "safety_controller"
# By tag; soft limits count where they differ from the joint's own.
_TAGS = {
    "dynamics": ("damping", "friction"),
    "limit": ("acceleration", "jerk"),
    _SOFT: ("soft_lower_limit", "soft_upper_limit"),
    "position_based_velocity_limits": ("deceleration_limit", "velocity_offset"),
}


def unused_values(joint: Element) -> dict[str, str]:
    """Return the values of a <joint> that are not used, as the file writes them; zeros left out.

    Args:
        joint: The element.

    Returns:
        By "tag attribute", such as "dynamics damping" or "limit drake:acceleration".
    """
    return {
        f"{tag} {_shown(name)}": text.strip()
        for tag, known in _TAGS.items()
        for element in joint.findall(tag)
        for name, text in element.attrib.items()
        if name.rpartition("}")[2] in known
        and not _is_same(text, "0")
        and not (tag == _SOFT and _is_same(text, _hard_limit(joint, name)))
    }


def _shown(name: str) -> str:
    """Return an attribute's name; ElementTree puts a namespace into braces before it."""
    namespace, _, local = name.rpartition("}")
    return f"drake:{local}" if "drake" in namespace else local


def _hard_limit(joint: Element, soft: str) -> str:
    """Return what <limit> says where <safety_controller> has a soft limit; 0 if nothing."""
    limit = joint.find("limit")
    name = soft.removeprefix("soft_").removesuffix("_limit")
    return "0" if limit is None else limit.get(name, "0")


def _is_same(text: str, other: str) -> bool:
    try:
        return float(text) == float(other)
    except ValueError:
        return False
