"""The arm of a problem as Pinocchio has it: kinematics, efforts, limits and solids."""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import trimesh

from outside.files import (
    BadInput,
    Description,
    Joint,
    find_file,
    find_urdf,
    placement_of,
    read_description,
    standing,
)
from outside.joint_limits import (
    EffortLimit,
    Law,
    Point,
    given_limits,
    given_motors,
    read_effort,
    read_laws,
    read_motors,
    read_points,
)
from outside.problem import Problem
from outside.tube_fields import OF_TOOL, limit_of


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the n joints, in group order, infinite where there is none.

    Attributes:
        lower: Of the position, shape (n,) [rad or m].
        upper: Likewise.
        velocity: Shape (n,) [rad/s or m/s].
        acceleration: Shape (n,) [rad/s^2 or m/s^2].
        jerk: Shape (n,) [rad/s^3 or m/s^3].
        effort: The most anywhere, either way, shape (n,) [N m or N].
        effort_rate: Shape (n,) [N m/s or N/s].
        tool_speed: Of the tool centre point, whatever the segment [m/s].
        tool_acceleration: Likewise [m/s^2].
        laws: Of velocities that depend on the position.
        points: Whose speed is limited.
        by_place: What each joint's motor has where and which way.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    effort: np.ndarray
    effort_rate: np.ndarray
    tool_speed: float
    tool_acceleration: float
    laws: list[Law] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    by_place: list[EffortLimit] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Solid:
    """Something that can collide.

    Attributes:
        owner: The link, attached solid or obstacle that it belongs to.
        kind: "link", "attached" or "obstacle".
        joint: Pinocchio's index of the joint that carries it; 0 stands still.
        placement: In the frame of that joint.
        geometry: Of coal: a primitive, or the triangles of a mesh.
        centre: Of its bounding sphere, in the frame of that joint, shape (3,) [m].
        radius: Of its bounding sphere [m].
    """

    owner: str
    kind: str
    joint: int
    placement: pin.SE3
    geometry: Any
    centre: np.ndarray
    radius: float


class Arm:
    """An arm of n joints; everything is in the base frame and in group order.

    Attributes:
        joint_names: The n joints of the planning group.
        slides: Which of them slide, shape (n,).
        limits: Their limits.
        motors: Their motors.
        solids: Of links and attached solids.
        moved_by: Per Pinocchio joint (0: the base), the joints that move it: bool, (joints, n).
        allowed: Pairs of links that the SRDF allows to touch.
        has_masses: Whether everything that a joint carries has a mass, as efforts need.
        tool_frame: The link that carries the tool.
        tool_joint: Pinocchio's index of the joint that moves it.
        links: Names of all links.
    """

    def __init__(self, problem: Problem) -> None:
        fields = problem.robot
        folders = [problem.folder / folder for folder in fields.get("package_dirs") or []]
        path = find_urdf(fields["urdf"], problem.folder, folders)
        description = read_description(path, folders)
        if fields.get("base"):
            description = standing(description, fields["base"])
        self.tool_frame, self.links = str(fields["tool_frame"]), description.links
        if self.tool_frame not in self.links:
            raise BadInput(f"robot.tool_frame: '{self.tool_frame}' is no link")
        self.joint_names = _group(description, self.tool_frame, fields.get("joints"))
        joints = [description.joints[name] for name in self.joint_names]
        self.slides = np.array([joint.kind == "prismatic" for joint in joints])
        self._model, self.solids = _model(description, self.joint_names, fields)
        moving = [name.removeprefix("joint:") for name in self._model.names[1:]]
        self._follow, self._offset = _rules(description, self.joint_names, moving)
        followers = [name for name in moving if name not in self.joint_names]
        chain = sorted(self.joint_names, key=lambda name: _depth(description, name))
        given = given_limits(problem, folders, chain, followers)
        own = _limits(self.joint_names, joints, given, set(followers))
        limits = _followed(own, description, self.joint_names, followers, given)
        law = given.get("velocity_by_position")
        laws = read_laws(law, self.joint_names, limits.lower, limits.upper)
        points = read_points(given.get("point_speed"), self.links)
        margin = given.get("position_margin") or {}
        inside = np.array([float(margin.get(name, 0.0)) for name in self.joint_names])
        lower, upper = limits.lower + inside, limits.upper - inside
        self.limits = replace(limits, lower=lower, upper=upper, laws=laws, points=points)
        layers = given_motors(problem, len(chain))
        scale = float((given.get("scale") or {}).get("effort", 1.0))
        known = (self.joint_names, chain, description.joints, self._follow, moving)
        self.motors = read_motors(layers, *known, scale)
        tool = self._model.frames[self._model.getFrameId(self.tool_frame, pin.FrameType.BODY)]
        self._carry(fields.get("payload"), tool)
        offset = placement_of(fields.get("tool_offset") or {})
        self.tool_joint, self._frame = tool.parentJoint, tool.placement
        self._tool = tool.placement * offset
        for solid in fields.get("attached") or []:
            geometry, placement = solid_geometry(solid, problem.folder, folders)
            place = tool.placement * placement
            name = str(solid["name"])
            self.solids.append(placed(name, "attached", tool.parentJoint, place, geometry))
        self._data, self._pool = self._model.createData(), pin.ModelPool(self._model, 1)
        self.moved_by = self._moved_by()
        self.has_masses = all(inertia.mass > 0 for inertia in list(self._model.inertias)[1:])
        srdf = fields.get("srdf")
        self.allowed = [] if srdf is None else _allowed(srdf, problem, folders, self.links)

    def poses(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where what each joint carries is, for configurations (N, n).

        Returns:
            Rotations (N, joints, 3, 3) and origins (N, joints, 3) [m]; joint 0 is the base.
        """
        model, data = self._model, self._data
        rotation = np.empty((len(q), model.njoints, 3, 3))
        position = np.empty((len(q), model.njoints, 3))
        places = list(enumerate(data.oMi))
        for k, row in enumerate(q @ self._follow.T + self._offset):
            pin.forwardKinematics(model, data, row)
            for j, place in places:
                rotation[k, j], position[k, j] = place.rotation, place.translation
        return rotation, position

    def tool(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (N, 3, 3) and position (N, 3) [m] of the tool centre point."""
        model, data, joint = self._model, self._data, self.tool_joint
        rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        place = data.oMi[joint]
        for k, row in enumerate(q @ self._follow.T + self._offset):
            pin.forwardKinematics(model, data, row)
            rotation[k], position[k] = place.rotation, place.translation
        position += rotation @ self._tool.translation
        return rotation @ self._tool.rotation, position

    def points(self, q: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return where points (P, 3) of the tool frame are, shape (N, P, 3) [m]."""
        model, data, joint = self._model, self._data, self.tool_joint
        carried = points @ self._frame.rotation.T + self._frame.translation
        found = np.empty((len(q), *points.shape))
        for k, row in enumerate(q @ self._follow.T + self._offset):
            pin.forwardKinematics(model, data, row)
            found[k] = carried @ data.oMi[joint].rotation.T + data.oMi[joint].translation
        return found

    @property
    def gravity(self) -> np.ndarray:
        """Gravity, shape (3,) [m/s^2]."""
        return self._model.gravity.linear

    def tool_velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the velocity of the tool centre point, shape (N, 3) [m/s]."""
        return self._velocity(self.tool_joint, self._tool.translation, q, v)

    def point_velocity(self, point: Point, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the velocity of a point that moves with a link, shape (N, 3) [m/s]."""
        frame = self._model.frames[self._model.getFrameId(point.link, pin.FrameType.BODY)]
        place = frame.placement.act(np.array(point.position))
        return self._velocity(frame.parentJoint, place, q, v)

    def _velocity(self, joint: int, place: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the velocity of a place in the frame of a joint, shape (N, 3) [m/s].

        The twist of what the joint carries, at that place: v + w x r.
        """
        model, data = self._model, self._data
        places, rates = q @ self._follow.T + self._offset, v @ self._follow.T
        velocity = np.empty((len(q), 3))
        for k, (row, rate) in enumerate(zip(places, rates, strict=True)):
            pin.forwardKinematics(model, data, row, rate)
            twist = data.v[joint]
            there = twist.linear + np.cross(twist.angular, place)
            velocity[k] = data.oMi[joint].rotation @ there
        return velocity

    def efforts(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return what motors must give, but for Coulomb friction, shape (N, n) [N m or N].

        The rigid arm's by recursive Newton-Euler; a joint also exerts what those that follow it
        take, at the rate at which they do.
        """
        places, rates = self._follow @ q.T + self._offset[:, None], self._follow @ v.T
        columns = (np.asfortranarray(each) for each in (places, rates, self._follow @ a.T))
        found = np.reshape(pin.rneaInParallel(1, self._pool, *columns), (-1, len(q)))
        return found.T @ self._follow + self.motors.armature * a + self.motors.viscous * v

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return configurations within the limits, within one turn where there are none."""
        lower, upper = self.limits.lower, self.limits.upper
        low = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))
        return rng.uniform(low, np.minimum(upper, low + 2 * np.pi), (count, len(low)))

    def _carry(self, payload: dict[str, Any] | None, tool: pin.Frame) -> None:
        if payload is None:
            return
        xx, yy, zz, xy, xz, yz = payload.get("inertia", [0.0] * 6)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
        com = np.array(payload.get("com", [0.0] * 3), dtype=float)
        carried = pin.Inertia(float(payload["mass"]), com, inertia)
        self._model.appendBodyToJoint(tool.parentJoint, carried, tool.placement)

    def _moved_by(self) -> np.ndarray:
        moved = np.zeros((self._model.njoints, len(self.joint_names)), dtype=bool)
        for joint in range(1, self._model.njoints):
            moved[joint] = moved[self._model.parents[joint]]
            moved[joint] |= self._follow[joint - 1] != 0
        return moved


def solid_geometry(fields: dict[str, Any], folder: Any, folders: list[Any]) -> tuple[Any, pin.SE3]:
    """Return an obstacle's or an attached solid's geometry and its pose.

    Raises:
        BadInput: It has no kind, or more than one, or its mesh cannot be read.
    """
    kinds = [
        k for k in ("box", "sphere", "cylinder", "capsule", "mesh") if fields.get(k) is not None
    ]
    if len(kinds) != 1:
        raise BadInput(f"'{fields['name']}' must be one of box, sphere, cylinder, capsule, mesh")
    sizes = fields[kinds[0]]
    if isinstance(sizes, dict):
        triangles = np.array(sizes["triangles"], dtype=np.int64).reshape(-1, 3)
        corners = np.array(sizes["vertices"], dtype=float).reshape(-1, 3)
        geometry = _mesh(corners[triangles] * float(fields.get("scale", 1.0)))
    elif kinds[0] == "mesh":
        path = find_file(sizes, folder, folders)
        scale = np.full(3, float(fields.get("scale", 1.0)))
        geometry = _read_mesh(path, scale)
    else:
        make = {"box": coal.Box, "sphere": coal.Sphere}
        make |= {"cylinder": coal.Cylinder, "capsule": coal.Capsule}
        values = sizes if isinstance(sizes, list) else [sizes]
        geometry = make[kinds[0]](*map(float, values))
    return geometry, placement_of(fields)


def _read_mesh(path: Path, scale: np.ndarray) -> Any:
    """Return the mesh of a file.

    coal's reader mixes up the corners of triangles where an OBJ file has several materials (seen in
    coal 3: of 1,308 triangles of a Panda's link6.obj with 17 materials, 1,089 were others).
    """
    if path.suffix.lower() == ".obj":
        loaded = trimesh.load(path, force="mesh", process=False)
        return _mesh(loaded.vertices[loaded.faces] * scale)
    return coal.MeshLoader(coal.BV_OBBRSS).load(str(path), scale)


def _mesh(triangles: np.ndarray) -> Any:
    """Return the mesh of some triangles (T, 3, 3) [m]."""
    geometry = coal.BVHModelOBBRSS()
    geometry.beginModel(len(triangles), 3 * len(triangles))
    for triangle in triangles:
        geometry.addTriangle(*triangle)
    geometry.endModel()
    return geometry


def placed(owner: str, kind: str, joint: int, placement: pin.SE3, geometry: Any) -> Solid:
    """Return a geometry as a solid, its bounding sphere measured."""
    geometry.computeLocalAABB()
    centre = placement.act(np.array(geometry.aabb_center))
    return Solid(owner, kind, joint, placement, geometry, centre, float(geometry.aabb_radius))


def _group(description: Description, tool_frame: str, given: list[str] | None) -> list[str]:
    if given is None:
        masters = [_rule(description, name)[0] for name in description.chain(tool_frame)]
        group = [name for name in dict.fromkeys(masters) if name in description.joints]
    else:
        group = [str(name) for name in given]
    for name in group:
        if name not in description.joints:
            raise BadInput(f"robot.joints: '{name}' is no movable joint")
        if description.joints[name].mimic is not None:
            raise BadInput(f"robot.joints: '{name}' mimics another joint")
    if not group:
        raise BadInput(f"no joint moves '{tool_frame}'")
    return group


def _depth(description: Description, joint: str) -> int:
    """Return how many movable joints are from the root to a joint."""
    links = [link for link, (above, _, _) in description.parents.items() if above == joint]
    return len(description.chain(links[0]))


def _rule(description: Description, name: str) -> tuple[str, float, float]:
    """Return whom a joint follows in the end, how fast, and from where: itself if nobody."""
    factor, offset, seen = 1.0, 0.0, [name]
    while (mimic := description.joints[seen[-1]].mimic) is not None:
        master, multiplier, shift = mimic
        if master in seen or master not in description.joints:
            raise BadInput(f"joint '{seen[-1]}' mimics '{master}', itself or no movable joint")
        factor, offset = factor * multiplier, offset + factor * shift
        seen.append(master)
    return seen[-1], factor, offset


def _rules(
    description: Description, group: list[str], moving: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return how the M joints of a model follow the group: factors (M, n), offsets (M,)."""
    follow, offset = np.zeros((len(moving), len(group))), np.zeros(len(moving))
    for k, name in enumerate(moving):
        master, factor, offset[k] = _rule(description, name)
        follow[k, group.index(master)] = factor
    return follow, offset


def _followed(
    limits: Limits,
    description: Description,
    group: list[str],
    followers: list[str],
    fields: dict[str, Any],
) -> Limits:
    """Return limits of the group that also keep its followers within theirs.

    Scales apply to followers as well; their efforts are their masters', see `efforts`.
    """
    lower, upper = limits.lower.copy(), limits.upper.copy()
    rates = {
        quantity: getattr(limits, quantity).copy()
        for quantity in ("velocity", "acceleration", "jerk")
    }
    for name in followers:
        master, factor, offset = _rule(description, name)
        k, joint = group.index(master), description.joints[name]
        own = [joint.lower, joint.upper] if joint.lower < joint.upper else [-math.inf, math.inf]
        ends = (fields.get("position") or {}).get(name, own)
        low, high = sorted((float(end) - offset) / factor for end in ends)
        lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
        for quantity, bound in rates.items():
            urdf = getattr(joint, quantity) or math.inf
            most = float((fields.get(quantity) or {}).get(name, urdf))
            scale = float((fields.get("scale") or {}).get(quantity, 1.0))
            bound[k] = min(bound[k], most * scale / abs(factor))
    return replace(limits, lower=lower, upper=upper, **rates)


def _limits(
    names: list[str], joints: list[Joint], fields: dict[str, Any], followers: set[str]
) -> Limits:
    """Return the group's own limits."""
    scale = fields.get("scale") or {}

    def row(quantity: str, given: list[float | None]) -> np.ndarray:
        own = fields.get(quantity) or {}
        # Joints that follow others have no motors.
        known = set(names) if quantity == "effort_rate" else {*names, *followers}
        if unknown := set(own) - known:
            raise BadInput(f"robot.limits.{quantity}: {unknown.pop()} is no joint of the group")
        values = [own.get(name, value) for name, value in zip(names, given, strict=True)]
        for name, value in zip(names, values, strict=True):
            if not isinstance(value, int | float) or not value > 0:
                raise BadInput(f"joint '{name}' has the {quantity} limit {value}")
        return np.array(values, dtype=float) * float(scale.get(quantity, 1.0))

    by_place = _efforts(names, joints, fields)
    ranges = fields.get("position") or {}
    both = zip(names, joints, strict=True)
    position = np.array([ranges.get(name, (joint.lower, joint.upper)) for name, joint in both])
    free = [math.inf] * len(names)
    return Limits(
        position[:, 0].astype(float),
        position[:, 1].astype(float),
        row("velocity", [joint.velocity for joint in joints]),
        row("acceleration", [joint.acceleration for joint in joints]),
        row("jerk", [joint.jerk for joint in joints]),
        np.array([limit.largest for limit in by_place]),
        row("effort_rate", list(free)),
        *(limit_of(fields.get(name), f"robot.limits.{name}") for name in OF_TOOL),
        by_place=by_place,
    )


def _efforts(names: list[str], joints: list[Joint], fields: dict[str, Any]) -> list[EffortLimit]:
    own = fields.get("effort") or {}
    if unknown := set(own) - set(names):
        raise BadInput(f"robot.limits.effort: {unknown.pop()} is no joint of the group")
    scale = float((fields.get("scale") or {}).get("effort", 1.0))
    both = zip(names, joints, strict=True)
    return [read_effort(name, own.get(name, joint.effort)).scaled(scale) for name, joint in both]


def _model(
    description: Description, group: list[str], fields: dict[str, Any]
) -> tuple[pin.Model, list[Solid]]:
    """Return the model of the group and its followers, others locked, and the links' solids."""
    full, geometries = _whole_robot(description)
    owners = [full.frames[item.parentFrame].name for item in geometries.geometryObjects]
    values, given = pin.neutral(full), fields.get("locked_joints") or {}
    rules = {name: _rule(description, name) for name in description.joints}
    outside = [
        name for name, (master, factor, _) in rules.items() if master not in group or not factor
    ]
    if unknown := set(given) - set(outside):
        raise BadInput(f"robot.locked_joints: {unknown.pop()} is no joint outside the group")
    ids = [full.getJointId(f"joint:{name}") for name in outside]
    for name, index in zip(outside, ids, strict=True):
        values[full.joints[index].idx_q] = _locked(description, name, group, given)
    model, geometries = pin.buildReducedModel(full, geometries, ids, values)
    for item in geometries.geometryObjects:
        if item.meshPath.lower().endswith(".obj"):
            item.geometry = _read_mesh(Path(item.meshPath), item.meshScale)
    gravity = fields.get("gravity") or [0.0, 0.0, -9.81]
    model.gravity = pin.Motion(np.array(gravity, dtype=float), np.zeros(3))
    solids = [
        placed(owner, "link", item.parentJoint, item.placement, item.geometry)
        for owner, item in zip(owners, geometries.geometryObjects, strict=True)
    ]
    return model, solids


def _whole_robot(description: Description) -> tuple[pin.Model, pin.GeometryModel]:
    try:
        model = pin.buildModelFromXML(description.xml)
        kind = pin.GeometryType.COLLISION
        return model, pin.buildGeomFromUrdfString(model, description.xml, kind, None, [])
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"Pinocchio cannot read the robot: {error}") from error


def _locked(
    description: Description, name: str, group: list[str], given: dict[str, float]
) -> float:
    """Return the value of a joint outside the group: given, zero, or what its master makes it."""
    master, factor, offset = _rule(description, name)
    if master in group:  # followed at the rate 0
        return offset
    joint = description.joints[master]
    has_limits = not joint.lower == joint.upper == 0.0
    default = float(np.clip(0.0, joint.lower, joint.upper)) if has_limits else 0.0
    return factor * float(given.get(master, default)) + offset


def _allowed(
    srdf: str, problem: Problem, folders: list[Any], links: Iterable[str]
) -> list[tuple[str, str]]:
    root = ElementTree.parse(find_file(srdf, problem.folder, folders)).getroot()
    enabled, disabled = (
        [(pair.get("link1", ""), pair.get("link2", "")) for pair in root.findall(tag)]
        for tag in ("enable_collisions", "disable_collisions")
    )
    for free in root.findall("disable_default_collisions"):
        pairs = ((free.get("link", ""), other) for other in links)
        disabled += [p for p in pairs if p not in enabled and p[::-1] not in enabled]
    return disabled
