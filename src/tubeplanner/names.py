"""Names of joints, links and solids: short text that a terminal shows as it is."""

from tubeplanner.errors import TubePlannerError, shown

MAX_NAME_LENGTH = 200  # [characters]


def require_name(what: str, name: object, error: type[TubePlannerError]) -> str:
    """Return a name that messages, files and figures can hold.

    Control characters and marks that turn the direction of writing are refused: in a terminal they
    would make other text of what follows.

    Args:
        what: What messages call it, such as "joint_names[0]".
        name: The name.
        error: What is raised.

    Raises:
        TubePlannerError: Of the kind asked for: it is no text, empty, too long, or holds a
            character that cannot be shown.
    """
    if not isinstance(name, str) or not name:
        raise error(f"{what} is {shown(name)}; a name must be text that is not empty")
    if len(name) > MAX_NAME_LENGTH:
        raise error(
            f"{what} is {shown(name)}, {len(name)} characters long; shorten it to at most "
            f"{MAX_NAME_LENGTH}"
        )
    hidden = next((character for character in name if not character.isprintable()), None)
    if hidden is not None:
        raise error(
            f"{what} is {shown(name)}, with the character {hidden!r}, which cannot be shown; "
            "rename it"
        )
    return name
