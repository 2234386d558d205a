"""Solids as problem files have them."""

from pathlib import Path

from tubeplanner.collision.obstacle import AttachedSolid, Obstacle, placement_of
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.problem.problem_format import AttachedFields, ObstacleFields
from tubeplanner.resources import find_mesh


def obstacle_of(
    fields: ObstacleFields, directory: Path, folders: tuple[Path, ...], field: str | None = None
) -> Obstacle:
    """Return a solid as a file has it.

    Args:
        fields: Of the file.
        directory: Where its relative paths start.
        folders: That hold the packages of `package://` names.
        field: What messages call the field; None: an obstacle of its name.

    Raises:
        ProblemError: It has not exactly one shape, or a number is out of its bounds.
    """
    field = field or f"obstacles: '{fields.name}'"
    kinds = ("box", "sphere", "cylinder", "capsule", "mesh")
    given = [kind for kind in kinds if getattr(fields, kind) is not None]
    if len(given) != 1:
        raise ProblemError(
            f"{field} must have exactly one of {', '.join(kinds)}; "
            f"it has {', '.join(given) or 'none'}"
        )
    try:
        placement = placement_of(fields.position, fields.rpy, fields.quaternion)
    except ProblemError as error:
        raise ProblemError(f"{field}: {error}") from None
    if fields.mesh is not None:
        try:
            path = find_mesh(fields.mesh, directory / "the problem file", folders)
            return Obstacle.mesh(fields.name, path, placement, fields.scale)
        except RobotError as error:
            raise ProblemError(f"{field}: {error}") from None
    if fields.scale != 1.0:
        raise ProblemError(f"{field}: scale belongs to a mesh alone; remove it")
    sizes = getattr(fields, given[0])
    if given[0] in ("cylinder", "capsule"):
        return getattr(Obstacle, given[0])(fields.name, *sizes, placement)
    return getattr(Obstacle, given[0])(fields.name, sizes, placement)


def attached_of(
    fields: AttachedFields, directory: Path, folders: tuple[Path, ...], field: str | None = None
) -> AttachedSolid:
    """Return a solid that the tool carries, as a file has it; arguments as `obstacle_of`."""
    field = field or f"robot.attached: '{fields.name}'"
    solid = obstacle_of(fields, directory, folders, field)
    return AttachedSolid(solid.name, solid.shapes, tuple(fields.touch_links), solid.contents)
