"""Families of problems, equal and looser variants of a base, and what comes of planning them.

A solution of the base is one of every variant. In equal ones, turning joints have the same values
and sliding ones those times the size, at the same times or, reversed, at the opposite ones.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation, Slerp

from campaign_examine import TOLERANCE, UNBUILT
from campaign_planner import PlannerProcess
from campaign_problems import PER_SEGMENT, Built, build, reversed_problem, write
from campaign_witness import BUNDLED, Unsuitable, bundled_arm, random_chain
from outside.files import find_urdf, placement_of, read_description
from outside.tube_fields import OF_TOOL
from outside_judge import judge, passes
from shared import HERE

EQUAL, LOOSER, TIGHTER = "equal", "looser", "tighter"
WIDER, HIGHER, SPLIT = 1.2, 1.1, 0.4
NO_JERK_LIMIT = 1e9  # [rad/s^3 or m/s^3]
MOVED, TURNED = (0.7, -0.4, 0.25), 2.0  # [m], [rad] about the vertical
DIRECTED = ("viscous_friction", "coulomb_friction", "saturation_effort")
# Powers of a length in a quantity of a turning and of a sliding joint.
POWERS = {
    **dict.fromkeys(("position", "velocity", "acceleration", "jerk", "no_load_velocity"), (0, 1)),
    **dict.fromkeys(("effort", "effort_rate", "coulomb_friction", "saturation_effort"), (2, 1)),
    **dict.fromkeys(("armature", "viscous_friction"), (2, 0)),
}
MAX_WALL = 10.0  # times the limit of processor time
Fields = dict[str, Any]


@dataclass(frozen=True)
class Variant:
    """A variant of problems.

    Attributes:
        name: What the table calls it.
        change: Makes its fields of a base problem, None where it does not apply. Its further files
            are written beside the base's.
        relation: Whether it is as fast as the base (equal), at most as slow (looser), or the base
            is at most as slow (tighter).
        beyond: Further variants that it loosens.
        quality: At which it is planned.
    """

    name: str
    change: Callable[[Built], Fields | None]
    relation: str = EQUAL
    beyond: tuple[str, ...] = ()
    quality: str = "balanced"


@dataclass(frozen=True)
class Options:
    """How families are planned.

    Attributes:
        names: Variants beside the base.
        keep: Folder of the families.
        cpu_limit: Processor time after which a plan is ended [s].
        against: Another checkout that plans them as well, or None.
        judged: Whether the outside judge sees every answer.
    """

    names: tuple[str, ...]
    keep: Path
    cpu_limit: float
    against: Path | None = None
    judged: bool = False


def examine(seed: int, options: Options) -> Fields:
    """Return the line of a family: the answers to its variants."""
    folder = options.keep / f"family_{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    try:
        built = family(seed, folder)
    except Unsuitable as error:
        return {"seed": seed, "status": UNBUILT, "message": str(error)}
    answers: Fields = {}
    for variant in VARIANTS:
        fields = variant.change(built) if variant.name in options.names else None
        if fields is not None:
            path = file_of(variant, folder)
            write(fields, path)
            answers[variant.name] = _answer(variant, path, options)
    return {"seed": seed, "status": "planned", "arm": built.arm, "answers": answers}


def family(seed: int, folder: Path) -> Built:
    """Write the base problem of a family into a folder, with its witness; always the same.

    Nothing is held: the weight that a tray keeps is that on earth, also where gravity is scaled.

    Raises:
        Unsuitable: The arm of this seed became no problem.
    """
    if seed % 2:
        arm = bundled_arm(list(BUNDLED)[seed // 2 % len(BUNDLED)])
        return build(seed, folder, robot=arm, holds=False)
    (folder / "chain.urdf").write_text(random_chain(np.random.default_rng(seed)))
    return build(seed, folder, robot={"urdf": "chain.urdf", "tool_frame": "tip"}, holds=False)


@dataclass(frozen=True)
class Similarity:
    """A map of the cell: x -> scale turn x + shift.

    A mirror is a reflection in every solid's own frame, by which its sizes and all turning axes
    stay, before a proper turn of those frames.

    Attributes:
        scale: Positive.
        turn: Orthogonal, of determinant 1 or, a mirror, -1; shape (3, 3).
        shift: Shape (3,) [m].
    """

    scale: float
    turn: np.ndarray
    shift: np.ndarray

    @property
    def factor(self) -> float:
        """Factor of coordinates in the frames of solids; negative of a mirror."""
        return self.scale * round(float(np.linalg.det(self.turn)))

    def direction(self, vector: Iterable[float]) -> list[float]:
        """Return the image of a direction."""
        return (self.turn @ list(vector)).tolist()

    def point(self, position: Iterable[float]) -> list[float]:
        """Return the image of a point [m]."""
        return (self.scale * self.turn @ list(position) + self.shift).tolist()

    def quaternion(self, rotation: np.ndarray) -> list[float]:
        """Return the image of an orientation (3, 3) as x, y, z, w."""
        image = self.factor / self.scale * self.turn @ rotation
        return Rotation.from_matrix(image).as_quat().tolist()

    def pose(self, fields: Fields) -> Fields:
        """Return the image of a pose's fields."""
        pose = placement_of(fields)
        rest = {key: value for key, value in fields.items() if key != "rpy"}
        position = self.point(pose.translation)
        return rest | {"position": position, "quaternion": self.quaternion(pose.rotation)}


def similar(built: Built, similarity: Similarity) -> Fields:
    """Return a problem whose cell and arm are the image of another's; durations stay the same."""
    fields, factor, size = deepcopy(built.fields), similarity.factor, similarity.scale
    robot, tube = fields["robot"], fields["tube"]
    slides = dict(zip(built.judge.arm.joint_names, built.judge.arm.slides.tolist(), strict=True))
    if factor != 1:
        name = f"arm_{factor:g}.urdf"
        path = find_urdf(robot["urdf"], built.path.parent, [])
        tree = ElementTree.parse(path)
        scale_arm(tree.getroot(), factor)
        tree.write(built.path.with_name(name))
        robot["urdf"] = name
    if (similarity.turn != np.eye(3)).any() or similarity.shift.any():
        robot["base"] = similarity.pose(robot.get("base", {}))
    gravity = similarity.direction(robot.get("gravity", (0, 0, -9.81)))
    robot["gravity"] = [size * each for each in gravity]
    for section, keys in (("tool_offset", ("position",)), ("payload", ("com",))):
        for key in set(keys) & robot.get(section, {}).keys():
            robot[section][key] = [factor * each for each in robot[section][key]]
    if "inertia" in robot.get("payload", {}):
        robot["payload"]["inertia"] = [size**2 * each for each in robot["payload"]["inertia"]]
    for solid in robot.get("attached", []):
        _scale_solid(solid, factor, built.path.parent)
        solid["position"] = [factor * each for each in solid.get("position", (0, 0, 0))]
    for quantities in (robot.get("limits", {}), robot.get("motors", {})):
        for quantity in POWERS.keys() & quantities.keys():
            quantities[quantity] = {
                joint: _scaled_limit(value, quantity, slides[joint], size)
                for joint, value in quantities[quantity].items()
            }
    for solid in fields.get("obstacles", []):
        _scale_solid(solid, factor, built.path.parent)
    fields["obstacles"] = [similarity.pose(solid) for solid in fields.get("obstacles", [])]
    fields["clearance"] = size * fields.get("clearance", 0.0)
    tube["points"] = [similarity.point(point) for point in tube["points"]]
    for key in ("radius", *OF_TOOL):
        tube[key] = [each and size * each for each in tube.get(key, [None] * len(tube["radius"]))]
    if "cross_section" in tube:
        tube["cross_section"] = [
            box and {"box": [size * x for x in box["box"]], "up": similarity.direction(box["up"])}
            for box in tube["cross_section"]
        ]
    if "orientations" in tube:
        rotations = Rotation.from_quat(tube["orientations"]).as_matrix()
        tube["orientations"] = [similarity.quaternion(rotation) for rotation in rotations]
    for ranges in tube.get("joint_signs", []):
        for joint, value in ranges.items():
            if slides[joint] and isinstance(value, list):
                ranges[joint] = [size * each for each in value]
    factors = np.where(list(slides.values()), size, 1.0)
    for end in {"start", "goal"} & fields.keys():
        fields[end] = {"joints": (factors * fields[end]["joints"]).tolist()}
    return fields


def scale_arm(robot: ElementTree.Element, factor: float) -> None:
    """Scale a URDF's lengths, inertias and efforts in place, masses and times staying the same.

    Args:
        robot: Its root element.
        factor: Of coordinates; negative: reflected at every frame's origin.
    """
    size = abs(factor)
    slides = {each.get("name"): each.get("type") == "prismatic" for each in robot.iter("joint")}
    for origin in robot.iter("origin"):
        _multiply(origin, factor, "xyz")
    for inertia in robot.iter("inertia"):
        _multiply(inertia, size**2, *inertia.keys())
    for geometry in robot.iter("geometry"):
        for shape in geometry:
            _multiply(shape, size, "size", "radius", "length")
            if shape.tag == "mesh":
                shape.set("scale", shape.get("scale", "1 1 1"))
                _multiply(shape, factor, "scale")
    for joint in robot.findall("joint"):
        is_sliding = slides[joint.get("name")]
        if is_sliding and factor < 0:
            for axis in joint.findall("axis"):
                _multiply(axis, -1.0, "xyz")
        for limit in joint.findall("limit"):
            for key in set(limit.keys()):
                power = POWERS.get({"lower": "position", "upper": "position"}.get(key, key))
                if power is not None:
                    _multiply(limit, size ** power[is_sliding], key)
        for mimic in joint.findall("mimic"):
            mimic.set("multiplier", mimic.get("multiplier", "1"))
            _multiply(mimic, size ** (is_sliding - slides[mimic.get("joint")]), "multiplier")
            _multiply(mimic, size**is_sliding, "offset")


def renamed(built: Built) -> Fields:
    """Return the problem with other names of links and joints, sorted the other way round."""
    fields = deepcopy(built.fields)
    robot, tube = fields["robot"], fields["tube"]
    tree = ElementTree.parse(find_urdf(robot["urdf"], built.path.parent, []))
    names: dict[str, dict[str, str]] = {}
    for kind in ("link", "joint"):
        present = sorted({str(each.get("name")) for each in tree.getroot().findall(kind)})
        names[kind] = {name: f"{kind}_{k:03}" for k, name in enumerate(reversed(present))}
    links, joints = names["link"], names["joint"]
    for tag, key, known in (
        *(("link", "name", links), ("parent", "link", links), ("child", "link", links)),
        *(("joint", "name", joints), ("mimic", "joint", joints)),
    ):
        for element in tree.iter(tag):
            if element.get(key) in known:
                element.set(key, known[element.get(key, "")])
    tree.write(built.path.with_name("renamed.urdf"))
    robot |= {"urdf": "renamed.urdf", "tool_frame": links[robot["tool_frame"]]}
    for quantities in (robot.get("limits", {}), robot.get("motors", {})):
        for quantity in POWERS.keys() & quantities.keys():
            by_joint = quantities[quantity]
            quantities[quantity] = {joints[joint]: value for joint, value in by_joint.items()}
    for solid in robot.get("attached", []):
        solid["touch_links"] = [links[link] for link in solid["touch_links"]]
    if "joint_signs" in tube:
        tube["joint_signs"] = [
            {joints[joint]: value for joint, value in signs.items()}
            for signs in tube["joint_signs"]
        ]
    return fields | {"obstacles": fields.get("obstacles", [])[::-1]}


def split(built: Built) -> Fields:
    """Return the problem with every segment as two on its line."""
    tube = deepcopy(built.fields["tube"])
    points = np.array(tube["points"])
    middle = points[:-1] + SPLIT * np.diff(points, axis=0)
    count = len(points)
    for key in set(PER_SEGMENT) & tube.keys() - {"points", "orientations"}:
        tube[key] = [value for value in tube[key] for _ in range(2)]
    tube["points"] = np.insert(points, range(1, count), middle, axis=0).tolist()
    if "orientations" in tube:
        turns = Slerp(range(count), Rotation.from_quat(tube["orientations"]))
        at = np.sort(np.concatenate([np.arange(count), np.arange(count - 1) + SPLIT]))
        tube["orientations"] = turns(at).as_quat().tolist()
    return built.fields | {"tube": tube}


def _scale(size: float) -> Callable[[Built], Fields]:
    return lambda built: similar(built, Similarity(size, np.eye(3), np.zeros(3)))


def _mirrored(built: Built) -> Fields:
    return similar(built, Similarity(1.0, np.diag([1.0, -1.0, 1.0]), np.zeros(3)))


def _moved(built: Built) -> Fields:
    turn = Rotation.from_euler("z", TURNED).as_matrix()
    return similar(built, Similarity(1.0, turn, np.array(MOVED)))


def _reversed(built: Built) -> Fields | None:
    """Return the problem backwards; friction and torque-speed lines tell directions apart."""
    is_directed = set(DIRECTED) & built.fields["robot"].get("motors", {}).keys()
    return None if is_directed or "goal" not in built.fields else reversed_problem(built.fields)


def _jerk_limited(built: Built) -> Fields | None:
    """Return the problem with a limit that no motion reaches on jerks that had none."""
    given = built.fields["robot"].get("limits", {}).get("jerk", {})
    free = dict.fromkeys((n for n in built.judge.arm.joint_names if n not in given), NO_JERK_LIMIT)
    return _with_limits(built, {"jerk": free | given}) if free else None


def _wider(built: Built) -> Fields:
    tube = deepcopy(built.fields["tube"])
    tube["radius"] = [radius and WIDER * radius for radius in tube["radius"]]
    for box in filter(None, tube.get("cross_section", [])):
        box["box"] = [WIDER * side for side in box["box"]]
    return built.fields | {"tube": tube}


def _higher(built: Built) -> Fields:
    """Return the problem with higher limits of every rate and effort."""
    robot, arm = built.fields["robot"], built.judge.arm
    joints = read_description(find_urdf(robot["urdf"], built.path.parent, []), []).joints
    limits = robot.get("limits", {})
    higher: Fields = {}
    for quantity in ("velocity", "effort", "acceleration", "jerk"):
        own = {n: getattr(joints[n], quantity) for n in arm.joint_names}
        stated = {n: x for n, x in own.items() if x is not None and math.isfinite(x)}
        values = stated | limits.get(quantity, {})
        higher[quantity] = {name: _higher_limit(value) for name, value in values.items()}
    tube = built.fields["tube"]
    for name in OF_TOOL:
        tube = tube | {name: [most and HIGHER * most for most in tube.get(name) or []] or None}
    return _with_limits(built, higher) | {"tube": tube}


def _higher_limit(value: Any) -> Any:
    if isinstance(value, dict):
        return value | {"effort": [HIGHER * each for each in value["effort"]]}
    return [HIGHER * each for each in value] if isinstance(value, list) else HIGHER * value


def _without(*keys: str) -> Callable[[Built], Fields | None]:
    """Return a change that leaves fields out of a problem or its tube."""

    def change(built: Built) -> Fields | None:
        fields, tube = built.fields, built.fields["tube"]
        if not any(fields.get(key) or any(tube.get(key, ())) for key in keys):
            return None
        tube = {key: value for key, value in tube.items() if key not in keys}
        return {key: value for key, value in fields.items() if key not in keys} | {"tube": tube}

    return change


def _posed(built: Built) -> Fields | None:
    """Return the problem with the pose of its goal in place of the goal's joints."""
    goal = built.fields.get("goal")
    if goal is None:
        return None
    rotation, position = built.judge.arm.tool(np.array([goal["joints"]]))
    quaternion = Rotation.from_matrix(rotation[0]).as_quat().tolist()
    pose = {"position": position[0].tolist(), "quaternion": quaternion}
    return built.fields | {"goal": {"pose": pose, "seed": goal["joints"]}}


def _in_ball(built: Built) -> Fields:
    """Return the problem with a ball about the tube's end as its goal.

    An open goal of arms that move the tool in fewer than three directions is one as wide as the
    tube.
    """
    tube = built.fields["tube"]
    radius = tube["radius"][-1] or min(tube["cross_section"][-1]["box"]) / 2
    tolerance = radius / 2 if len(built.judge.arm.joint_names) > 2 else radius
    return built.fields | {"goal": {"position": tube["points"][-1], "tolerance": tolerance}}


def _in_any_order(built: Built) -> Fields | None:
    tube = built.fields["tube"]
    return built.fields | {"tube": tube | {"visit": "any"}} if len(tube["radius"]) > 1 else None


def _with_limits(built: Built, limits: Fields) -> Fields:
    robot = built.fields["robot"]
    return built.fields | {"robot": robot | {"limits": robot.get("limits", {}) | limits}}


def _scaled_limit(value: Any, quantity: str, is_sliding: bool, size: float) -> Any:
    if isinstance(value, dict):  # efforts by position
        return {key: _scaled_limit(each, key, is_sliding, size) for key, each in value.items()}
    factor = size ** POWERS[quantity][is_sliding]
    return [factor * each for each in value] if isinstance(value, list) else factor * value


def _scale_solid(solid: Fields, factor: float, folder: Path) -> None:
    """Scale a solid about the origin of its own frame, in place; write a mesh's reflection."""
    for shape in {"box", "cylinder", "capsule"} & solid.keys():
        solid[shape] = [abs(factor) * each for each in solid[shape]]
    if "sphere" in solid:
        solid["sphere"] *= abs(factor)
    if "mesh" in solid:
        solid["scale"] = abs(factor) * solid.get("scale", 1.0)
    if "mesh" in solid and factor < 0:
        mesh = trimesh.load(folder / solid["mesh"], force="mesh")
        mesh.apply_scale(-1.0)  # turns the triangles' order too
        solid["mesh"] = f"reflected_{Path(solid['mesh']).name}"
        mesh.export(folder / solid["mesh"])


def _multiply(element: ElementTree.Element, factor: float, *keys: str) -> None:
    for key in set(keys) & set(element.keys()):
        values = [factor * float(value) for value in element.get(key, "").split()]
        element.set(key, " ".join(map(repr, values)))


def _same(built: Built) -> Fields:
    return built.fields


VARIANTS = (
    Variant("base", _same),
    Variant("reversed", _reversed),
    Variant("mirrored", _mirrored),
    Variant("x0.3", _scale(0.3)),
    Variant("x10", _scale(10.0)),
    Variant("moved", _moved),
    Variant("renamed", renamed),
    Variant("split", split),
    Variant("jerk 1e9", _jerk_limited),
    Variant("radius x1.2", _wider, LOOSER),
    Variant("limits x1.1", _higher, LOOSER),
    Variant("no obstacles", _without("obstacles", "clearance"), LOOSER),
    Variant("no rotation", _without("orientations", "rotation_tolerance"), LOOSER),
    Variant("no signs", _without("joint_signs"), LOOSER),
    Variant("pose", _posed, LOOSER),
    Variant("open", _without("goal"), LOOSER, ("pose",)),
    Variant("ball", _in_ball, LOOSER, ("pose", "open")),
    Variant("any", _in_any_order, LOOSER),
    Variant("fast", _same, TIGHTER, quality="fast"),
    Variant("best", _same, LOOSER, quality="best"),
)


def file_of(variant: Variant, folder: Path) -> Path:
    """Return the path of a variant's problem file in a family's folder."""
    return folder / f"{variant.name.replace(' ', '_')}.yaml"


def _answer(variant: Variant, path: Path, options: Options) -> Fields:
    """Return what this checkout, and the other one, plan of a file."""
    asked: Fields = {"problem": str(path), "time_limit": None, "slack": 0.0, "baselines": False}
    asked |= {"quality": variant.quality, "cpu_limit": options.cpu_limit}
    answers = []
    for checkout in filter(None, (HERE, options.against)):
        trajectory = path.with_suffix(".json" if checkout == HERE else ".other.json")
        asked["trajectory"] = str(trajectory)
        answer = _planner(checkout).plan(asked, MAX_WALL * options.cpu_limit)
        answer = dict.fromkeys(("duration", "cpu")) | answer
        kept = {key: answer[key] for key in ("status", "message", "duration", "cpu")}
        if options.judged and answer["status"] == "success":
            kept["judged"] = passes(judge(path, trajectory), TOLERANCE)
        answers.append(kept)
    return answers[0] | ({"other": answers[1]} if options.against else {})


@cache
def _planner(checkout: Path) -> PlannerProcess:
    return PlannerProcess(checkout)
