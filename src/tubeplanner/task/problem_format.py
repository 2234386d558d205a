"""The problem file's format: fields, units, defaults; the kind of a document."""

import math
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticCustomError

from tubeplanner.documents import DocumentError, parse_json, parse_yaml, read_text
from tubeplanner.errors import ProblemError, RobotError, faults_of
from tubeplanner.fields import (
    DeclaredSection,
    Finite,
    Flag,
    Number,
    Quaternion,
    Section,
    Vector,
    Version,
    is_plain_number,
    no_flag,
    one_of,
    section_of,
)
from tubeplanner.geometry.tube.bands import Process, TubeEvent
from tubeplanner.robot.overrides import LimitFields, MotorFields
from tubeplanner.robot.pinocchio_model import BasePose, Payload, ToolOffset
from tubeplanner.task.demands import ENDS, GOAL, START, Contact, Objective, Robustness
from tubeplanner.task.holding import CONTACT_KINDS, Cup, Gripper, Holding, Liquid, Tray

# ---- Kinds of documents: problem, cycle, study.

CYCLE_FORMAT: Final = "tubeplanner/cycle"
STUDY_FORMAT: Final = "tubeplanner/study"


def is_cycle(document: Any) -> bool:
    """Return True if a document has the format of a cycle, or the key `moves`."""
    return _is_of(document, CYCLE_FORMAT, "moves")


def is_study(document: Any) -> bool:
    """Return True if a document has the format of a study, or the key `study`."""
    return _is_of(document, STUDY_FORMAT, "study")


def require_problem(document: Any, source: str) -> None:
    """Raise ProblemError if a document is a cycle or a study; messages name the source."""
    if is_cycle(document):
        raise ProblemError(
            f"{source}: this is a cycle, where one problem is needed; plan, check, info, view, "
            "plot, simulate, study and sweep --vary take cycles, and load_cycle in Python"
        )
    if is_study(document):
        raise ProblemError(
            f"{source}: this is a study, where one problem is needed; study takes it, and "
            "load_study in Python"
        )


def require_study(document: Any, source: str) -> None:
    """Raise ProblemError if a document is a problem or a cycle; messages name the source."""
    if isinstance(document, dict) and not is_study(document):
        kind = "a cycle" if is_cycle(document) else "a problem"
        raise ProblemError(
            f"{source}: this is {kind}, where a study is needed: a file with format: "
            f"{STUDY_FORMAT} and study: {{problem: ..., vary: ...}}; plan takes {kind}"
        )


def _is_of(document: Any, format_: str, key: str) -> bool:
    if not isinstance(document, dict):
        return False
    value = document.get("format")
    return key in document or (isinstance(value, str) and value == format_)


# ---- Poses.


class PoseFields(Section):
    """A pose of the tool centre point; exactly one of rpy, quaternion."""

    position: Vector = Field(description="base frame [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")


@section_of(ToolOffset)
class ToolOffsetFields(DeclaredSection):
    """The tool centre point in the tool frame."""


@section_of(BasePose)
class BaseFields(DeclaredSection):
    """The pose of the root link in the cell; at most one of rpy, quaternion."""


# ---- Clearances and contacts, and their values in a problem.


class PairClearanceFields(Section):
    """A clearance of two solids."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    clearance: Finite = Field(description="least distance between them [m]")


class ClearanceFields(Section):
    """Clearances; the more specific holds: of a pair, else of a segment, else the default."""

    default: Finite = Field(0.0, description="least distance of links to obstacles [m]")
    pairs: list[PairClearanceFields] = Field(
        [], description="of single pairs, also of links from each other"
    )
    segments: list[Finite | None] | None = Field(
        None, description="m distances of links to obstacles, null where it is the default [m]"
    )


Clearance: TypeAlias = Annotated[
    Finite | ClearanceFields,
    one_of(
        lambda value: isinstance(value, int | float | dict | ClearanceFields),
        "a number, or a map with default, pairs, segments",
    ),
    BeforeValidator(no_flag),  # the last validator comes first
]


class ContactFields(Section):
    """Two solids that may be nearer than their clearance where the motion begins or ends."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    segments: list[Annotated[int, Field(strict=True)]] | None = Field(
        None,
        description="0, the first, where it begins, or the last (also -1), where it ends; left "
        "out: both",
    )
    within: Finite = Field(description="distance of the tool from where it is there [m]")


def clearances_of(fields: float | ClearanceFields) -> dict[str, Any]:
    """Return the arguments `clearance` and `pair_clearances` of a problem [m]."""
    if not isinstance(fields, ClearanceFields):
        return {"clearance": fields}
    pairs = {pair.links: pair.clearance for pair in fields.pairs}
    return {"clearance": fields.default, "pair_clearances": pairs}


def segment_clearances(fields: float | ClearanceFields) -> list[float | None] | None:
    """Return the `clearance` of a tube [m], None for the problem's."""
    return fields.segments if isinstance(fields, ClearanceFields) else None


def contacts_of(fields: list[ContactFields], segments: int | None) -> tuple[Contact, ...]:
    """Return the contacts of a problem with a number of segments; None: not known yet."""
    return tuple(
        Contact(each.links, each.within, _ends(k, each.segments, segments))
        for k, each in enumerate(fields)
    )


def _ends(k: int, indices: list[int] | None, segments: int | None) -> tuple[str, ...]:
    """Return the ends at which the solids of contact k touch, from indices of segments."""
    if indices is None:
        return ENDS
    last = [-1] if segments is None else [-1, segments - 1]
    for index in indices:
        if index != 0 and index not in last:
            accepted = "-1, the last" if segments is None else f"{segments - 1} (or -1), the last"
            raise ProblemError(
                f"contacts[{k}].segments has {index}; solids may touch where the motion begins "
                f"or ends: give 0, the first, or {accepted}"
            )
    ends = ((START, 0 in indices), (GOAL, any(index in last for index in indices)))
    return tuple(end for end, is_present in ends if is_present)


# ---- Fields of the problem file, with units and defaults. Other tools read it: names never change.

JointValues: TypeAlias = list[Finite] | dict[str, Finite]


Sign: TypeAlias = Annotated[
    Literal["+", "-", "0", 1, -1, 0] | tuple[Number, Number],
    one_of(
        lambda value: (
            (isinstance(value, list | tuple) and len(value) == 2)
            or value in ("+", "-", "0", 1, -1, 0)
        ),
        "'+', '-', '0', 1, -1, 0 or a range [lower, upper]",
    ),
    BeforeValidator(no_flag),  # the last validator comes first
]


RotationBoundField: TypeAlias = Annotated[
    Number | tuple[Number, Number, Number],
    one_of(
        lambda value: (
            len(value) == 3 and all(map(is_plain_number, value))
            if isinstance(value, list | tuple)
            else is_plain_number(value)
        ),
        "one angle or three bounds [x, y, z] [rad], .inf where free",
    ),
]


XacroValue: TypeAlias = Annotated[
    Flag | int | float | str,
    one_of(
        lambda value: isinstance(value, str | bool | int | float), "a text, a number, true or false"
    ),
]

PROBLEM_FORMAT: Final = "tubeplanner/problem"
_MAX_BYTES = 10_000_000


@section_of(Payload)
class PayloadFields(DeclaredSection):
    """A mass carried in the tool frame."""


_Index: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=_MAX_BYTES)]


class TriangleFields(Section):
    """A mesh in the file itself."""

    vertices: list[Vector] = Field(description="corners [m]")
    triangles: list[tuple[_Index, _Index, _Index]] = Field(
        description="three numbers of vertices each, from 0, in their order seen from outside"
    )


_Mesh: TypeAlias = Annotated[
    TriangleFields | str,
    one_of(
        lambda value: isinstance(value, str | dict | TriangleFields),
        "a file, or a map with vertices, triangles",
    ),
]


class ShapeFields(Section):
    """A solid without a name; exactly one of box, sphere, cylinder, capsule, mesh, points."""

    box: Vector | None = Field(None, description="full side lengths [m]")
    sphere: Finite | None = Field(None, description="radius [m]")
    cylinder: tuple[Finite, Finite] | None = Field(None, description="radius, length along z [m]")
    capsule: tuple[Finite, Finite] | None = Field(
        None, description="radius, length between the centres of its caps [m]"
    )
    mesh: _Mesh | None = Field(
        None, description="file, relative to this one, or vertices and triangles"
    )
    points: str | None = Field(
        None,
        description="point cloud (.ply, .pcd, .xyz), relative to this one, as boxes: the cells of "
        "a grid that hold points",
    )
    size: Finite | None = Field(None, description="side of the cells of points [m]")
    scale: Finite = Field(1.0, description="of a mesh")
    position: Vector = Field((0.0, 0.0, 0.0), description="of its centre, or the mesh's origin [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")


class NamedFields(Section):
    """What has a name, before all else that it has."""

    name: str = Field(description="unique; what messages call it")


class ObstacleFields(ShapeFields, NamedFields):
    """One solid; exactly one of box, sphere, cylinder, capsule, mesh, points."""


class SceneFields(Section):
    """Solids of a planning scene of MoveIt."""

    moveit_scene: str = Field(
        description="file (YAML of the message), relative to this one: its objects, attached "
        "objects and allowed collisions"
    )


def _obstacle_kind(fields: Any) -> str:
    is_scene = isinstance(fields, dict) and "moveit_scene" in fields
    return "SceneFields" if is_scene or isinstance(fields, SceneFields) else "ObstacleFields"


ObstacleItem: TypeAlias = Annotated[
    Annotated[ObstacleFields, Tag("ObstacleFields")] | Annotated[SceneFields, Tag("SceneFields")],
    Discriminator(_obstacle_kind),
]


class AttachedFields(ObstacleFields):
    """One solid carried by the tool, placed in tool_frame."""

    touch_links: list[str] = Field([], description="links that it may touch")


class RobotFields(Section):
    """The arm."""

    urdf: str = Field(description="path relative to this file, package://PKG/..., example:NAME")
    package_dirs: list[str] | dict[str, str] = Field(
        [], description="extra roots for package:// names, or a map from packages to their folders"
    )
    xacro_args: dict[str, XacroValue] = Field(
        {}, description="arguments of a urdf or srdf that ends in .xacro, by name"
    )
    srdf: str | None = Field(
        None,
        description="file whose disable_collisions and disable_default_collisions name links that "
        "may touch, and whose group_state names configurations",
    )
    tool_frame: str = Field(description="any URDF link")
    tool_offset: ToolOffsetFields = Field(
        ToolOffsetFields.model_construct(), description="the tool centre point in tool_frame"
    )
    base: BaseFields | None = Field(
        None,
        description="pose of the root link in the cell, whose frame is then the base frame; null: "
        "the base frame is the root link's",
    )
    joints: list[str] | None = Field(None, description="planning group; default: the chain's")
    locked_joints: dict[str, Finite] = Field({}, description="joints outside the group [rad, m]")
    gravity: Vector = Field((0.0, 0.0, -9.81), description="base frame [m/s^2]")
    payload: PayloadFields | None = Field(None, description="a mass carried in tool_frame")
    attached: list[AttachedFields] = Field([], description="solids carried in tool_frame")
    limits: LimitFields = Field(
        LimitFields.model_construct(), description="replace and scale the URDF's limits"
    )
    motors: MotorFields = Field(
        MotorFields.model_construct(), description="inertia, friction, less effort at speed"
    )
    preset: str | list[str] | None = Field(
        None,
        description="limits and motors below these: a bundled name, a file, or a list, of which "
        "the later win",
    )
    limits_file: str | None = Field(
        None, description="MoveIt's joint_limits.yaml: limits below those of the preset"
    )


class CrossSectionFields(Section):
    """A rectangle in place of the disc of a radius."""

    box: tuple[Finite, Finite] = Field(description="full width, across, and height, along up [m]")
    up: Vector = Field(description="made perpendicular to the segment")


class BandFields(Section):
    """A band of the tool's speed: speed and tolerance, or its two ends."""

    speed: Number | None = Field(None, description="upper end, for which is planned [m/s]")
    tolerance: Number | None = Field(
        None, description="fraction of the speed by which the lower end is below it"
    )
    between: list[Number] | None = Field(
        None, description="lower and upper end, in place of both [m/s]"
    )


@section_of(Process)
class ProcessFields(DeclaredSection):
    """A process along stretches of constant speed: glue, weld, spray, scan."""


@section_of(TubeEvent)
class TubeEventFields(DeclaredSection):
    """An event while the tool moves, such as the trigger of a camera."""


class TubeFields(Section):
    """Where the tool may be, and its orientation there."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [{"required": ["points"]}, {"required": ["route"]}],
            "if": {
                "required": ["points"],
                "properties": {"points": {"type": "array"}, "cross_section": {"type": "null"}},
            },
            "then": {"required": ["radius"]},
        }
    )

    # Before the points, whose check asks for it.
    route: list[JointValues] | None = Field(
        None,
        description="in place of points and radius, a first guess: configurations from the start "
        "to the goal, free on the straight lines between them; the tool may be anywhere [rad, m]",
    )
    points: list[Vector] | str | None = Field(
        None,
        validate_default=True,
        description="m+1 reference points, base frame, or a CSV file of them, relative to this "
        "one: x, y, z, then optionally the tool's z axis i, j, k, or qx, qy, qz, qw, and radius "
        "[m]",
    )
    # Before the radius, whose check asks for it.
    cross_section: CrossSectionFields | list[CrossSectionFields | None] | None = Field(
        None, description="boxes in place of discs, one or m; null: the disc of the radius"
    )
    radius: Finite | list[Finite | None] | None = Field(
        None,
        validate_default=True,
        description="one or m path tolerances, from 1e-6 to 1e4, null where there is a box; may be "
        "left out if the file of points has them [m]",
    )
    tool_radius: Finite = Field(
        0.0, description="end effector as a sphere; at least 1e-6 below each radius [m]"
    )
    joint_signs: dict[str, Sign] | list[dict[str, Sign]] = Field(
        {}, description="one map or m: '+', '-', '0', 1, -1, 0, or [lower, upper] [rad, m]"
    )
    orientations: list[Quaternion] | None = Field(
        None, description="of the tool centre point frame at the points, m+1 quaternions x y z w"
    )
    rotation_tolerance: Number | list[RotationBoundField] | None = Field(
        None,
        description="m angles, or triples of bounds on log(R_ref^T R), .inf where free [rad]; one "
        "number or triple serves for all segments; three numbers for three segments: an angle each",
    )
    tool_speed: Number | BandFields | list[Number | BandFields | None] | None = Field(
        None,
        description="one or m limits on the tool's speed or bands of it, null where it is free "
        "[m/s]",
    )
    process: ProcessFields | None = Field(
        None, description="along stretches whose speed has a band"
    )
    events: list[TubeEventFields] = Field(
        [], description="marks while the tool moves, at places of the reference path"
    )
    tool_acceleration: Number | list[Number | None] | None = Field(
        None,
        description="one or m limits on the tool's acceleration, gravity not counted, null where "
        "it is free [m/s^2]",
    )
    visit: Literal["ordered", "any"] = Field(
        "ordered", description="segments one after the other, or the union of their capsules"
    )
    pass_through_points: Literal["all", "corners", "none"] = Field(
        "corners",
        description="which inner points the tool must pass within the smaller radius beside them; "
        "corners: where the tube turns by more than 150 degrees",
    )

    @field_validator("points", "radius")
    @classmethod
    def _required(cls, value: object, info: ValidationInfo) -> object:
        """Raise if points or radius are missing, unless there is a route or another radius."""
        has_other = info.data.get("route") is not None
        if info.field_name == "radius":
            has_other |= isinstance(info.data.get("points"), str)
            has_other |= bool(info.data.get("cross_section"))
        if value is None and not has_other:
            raise PydanticCustomError("missing", "it is required")
        return value


class EndpointFields(Section):
    """A configuration, or a seed for the inverse kinematics of the reference point.

    Or a pose of the tool (a seed may go with it), a named configuration, or where a trajectory
    ends. A goal may be a tool position instead; `route` finds the configuration.
    """

    joints: JointValues | None = Field(None, description="group order or by name [rad, m]")
    seed: JointValues | None = Field(None, description="group order or by name [rad, m]")
    position: Vector | None = Field(
        None, description="of the tool, of a goal alone, in the last segment's region [m]"
    )
    tolerance: Finite = Field(
        0.0, description="how far from the position the tool may end; 0: there [m]"
    )
    rotation_tolerance: RotationBoundField | None = Field(
        None,
        description="an angle or a triple of bounds, as in the tube, about its last orientation; "
        "left out: as the tube has it [rad]",
    )
    pose: PoseFields | None = Field(
        None, description="of the tool centre point, on the branch that the joint signs ask for"
    )
    group_state: str | None = Field(None, description="name of a configuration in robot.srdf")
    trajectory: str | None = Field(
        None, description="file whose last configuration it is, relative to this one"
    )


class CollisionFields(Section):
    """What is checked."""

    self_: Flag = Field(True, alias="self", description="links against links")
    ignore: list[tuple[str, str]] = Field([], description="pairs of links or obstacles left out")


@section_of(Objective, "slack", "duration", "minimise", "weights")
class ObjectiveFields(DeclaredSection):
    """What the answer is to be beside short."""


@section_of(Robustness)
class RobustnessFields(DeclaredSection):
    """By how much the real arm and its control may differ at most: the plan is to survive it."""

    preset: str | None = Field(
        None, description="name or file of a controller, such as franka_controller, below the rest"
    )


@section_of(Cup, "friction", "safety", "position", "normal")
class CupFields(DeclaredSection):
    """A suction cup: a ring that the vacuum presses onto the part."""

    force: Finite | None = Field(None, description="at working pressure [N]")
    radius: Finite | None = Field(None, description="of the ring [m]")
    vacuum: Finite | None = Field(
        None, description="below the pressure around, in place of the force [Pa]"
    )
    diameter: Finite | None = Field(None, description="in place of the radius [m]")


@section_of(Tray)
class TrayFields(DeclaredSection):
    """A tray: the part stands on it."""


@section_of(Gripper)
class GripperFields(DeclaredSection):
    """A gripper with two fingers: it presses the part from both sides."""


@section_of(Liquid)
class LiquidFields(DeclaredSection):
    """A liquid in an open vessel: its surface leans against the vessel."""


class HoldingFields(Section):
    """A part, and the contact that holds it; exactly one of cup, tray, gripper, liquid."""

    part: PayloadFields | None = Field(
        None, description="mass properties in tool_frame; of a liquid none"
    )
    cup: CupFields | None = Field(None, description="a suction cup")
    tray: TrayFields | None = Field(None, description="a tray: the part stands on it")
    gripper: GripperFields | None = Field(None, description="two fingers that press the part")
    liquid: LiquidFields | None = Field(None, description="a liquid in an open vessel")


Holdings: TypeAlias = Annotated[
    HoldingFields | list[HoldingFields],
    one_of(
        lambda value: isinstance(value, dict | list | HoldingFields),
        "a map with part and cup, tray, gripper or liquid, or a list of such",
    ),
]


def holdings_from(
    fields: HoldingFields | list[HoldingFields] | None,
    field: str = "holding",
    payload: Payload | None = None,
) -> tuple[Holding, ...]:
    """Return the holdings of a file's fields.

    Args:
        fields: One or several; None: none.
        field: What messages call them.
        payload: Mass properties of parts that the fields do not have; None: fields must.

    Raises:
        ProblemError: A contact is missing or given twice, or a value is out of its bounds.
    """
    items = [] if fields is None else fields if isinstance(fields, list) else [fields]
    holdings = []
    for k, item in enumerate(items):
        here = f"{field}[{k}]" if isinstance(fields, list) else field
        kinds = {kind.kind: kind for kind in CONTACT_KINDS}
        names = [name for name in kinds if getattr(item, name) is not None]
        if len(names) != 1:
            has = ", ".join(names) or "none"
            raise ProblemError(f"{here} must have exactly one of {', '.join(kinds)}; it has {has}")
        if item.part is not None and item.liquid is not None:
            raise ProblemError(f"{here}.part does not go with a liquid; leave it out")
        if item.part is None and item.liquid is None and payload is None:
            raise ProblemError(f"{here}.part is required: mass, com and inertia of what is held")
        numbers = getattr(item, names[0]).model_dump()
        try:
            if item.cup is not None:
                numbers = _cup_numbers(numbers)
            part = payload if item.part is None else Payload(**item.part.model_dump())
            holdings.append(Holding(kinds[names[0]](**numbers), part))
        except (ProblemError, RobotError) as error:
            # Messages of payloads name the robot's.
            reason = str(error).replace("robot.payload: ", "part.")
            raise ProblemError(f"{here}.{reason}") from None
    return tuple(holdings)


def _cup_numbers(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of a cup with its force [N] and radius [m]."""
    vacuum, diameter = numbers.pop("vacuum"), numbers.pop("diameter")
    for name, other in (("force", vacuum), ("radius", diameter)):
        if (numbers[name] is None) == (other is None):
            instead = {"force": "vacuum", "radius": "diameter"}[name]
            both = "are both given; leave out one" if other is not None else "are both missing"
            raise ProblemError(f"cup: {name} and {instead} {both}")
    if diameter is not None:
        numbers["radius"] = diameter / 2
    if vacuum is not None:
        numbers["force"] = vacuum * math.pi * numbers["radius"] ** 2
    return numbers


class ProblemFields(Section):
    """A tubeplanner problem. SI units, radians; positions in the frame of the URDF's root link."""

    what = "a problem is a map with robot, tube and start"
    model_config = ConfigDict(title="tubeplanner problem")

    format: Literal["tubeplanner/problem"] = Field(PROBLEM_FORMAT, description="what this file is")
    version: Version = Field(1, description="of the format")
    include: str | list[str] = Field(
        [], description="problem files, or parts of them, below this one, relative to this one"
    )
    robot: RobotFields = Field(description="the arm, its tool and its limits")
    tube: TubeFields | None = Field(
        None, description="where the tool may be, and in which configuration; `route` finds one"
    )
    start: EndpointFields = Field(description="where the trajectory begins, at rest")
    goal: EndpointFields | None = Field(
        None, description="where it ends, at rest; left out: in any configuration"
    )
    obstacles: list[ObstacleItem] = Field([], description="solids in the base frame")
    clearance: Clearance = Field(
        0.0,
        description="least distance of links to obstacles [m]; or others for pairs and segments",
    )
    contacts: list[ContactFields] = Field(
        [], description="solids that may be nearer where the motion begins or ends"
    )
    collision: CollisionFields = Field(
        CollisionFields.model_construct(), description="what is checked"
    )
    objective: ObjectiveFields | None = Field(
        None, description="beside short; left out: smooth within a slack of 0.005"
    )
    period: Finite | None = Field(
        None, description="the controller's: duration and breakpoints are multiples of it [s]"
    )
    robustness: RobustnessFields | None = Field(
        None, description="errors that the plan is to survive; left out: none"
    )
    holding: Holdings | None = Field(
        None, description="parts that the tool holds by contact, and is not to lose"
    )


def problem_schema() -> dict[str, Any]:
    """Return the JSON schema of the problem file."""
    return ProblemFields.model_json_schema(by_alias=True)


def read_document(path: Path, what: str = "problem file") -> object:
    """Return the content of a YAML or JSON file, with a label, as dictionaries and lists."""
    with faults_of(f"{what} {path} cannot be read", DocumentError):
        text = read_text(path, _MAX_BYTES)
    with faults_of(f"{what} {path} is malformed", DocumentError):
        return parse_json(text) if path.suffix == ".json" else parse_yaml(text)
