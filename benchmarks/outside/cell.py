"""The cell as the steps of a cycle change it: what stands, what is carried and what it weighs."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from outside.arm import Arm, placed, solid_geometry
from outside.cycle import Cycle, Step
from outside.nearest import Poses, signed_distance
from outside.standing import placement_of

TOUCHING = 1e-3  # [m]: links that are nearer to what is attached may touch it


@dataclass(frozen=True)
class Cell:
    """What stands in the cell, and what the tool carries.

    Attributes:
        cycle: Of what file.
        obstacles: Fields of solids in the base frame.
        attached: Fields of solids in the tool frame.
        loads: Payloads that were attached, by name.
    """

    cycle: Cycle
    obstacles: list[dict[str, Any]]
    attached: list[dict[str, Any]]
    loads: dict[str, dict[str, Any]] = field(default_factory=dict)

    @staticmethod
    def of(cycle: Cycle) -> "Cell":
        """Return the cell in which a cycle begins."""
        attached = cycle.header["robot"].get("attached") or []
        return Cell(cycle, cycle.header.get("obstacles") or [], attached)

    @property
    def names(self) -> set[str]:
        """Names of all solids."""
        return {str(solid["name"]) for solid in [*self.obstacles, *self.attached]}

    def after(self, step: Step, arm: Arm, q: np.ndarray) -> "Cell":
        """Return the cell after a step.

        Args:
            step: What happens.
            arm: Any of the cycle's.
            q: The configuration in which the arm rests, shape (n,).
        """
        if step.kind == "attach":
            return self._with(step, arm, q)
        if step.kind == "detach":
            return self._without(step, self._tool_frame(arm, q))
        return self

    @property
    def payload(self) -> dict[str, Any] | None:
        """What the robot's own payload and all loads are as one body."""
        given = [self.cycle.header["robot"].get("payload"), *self.loads.values()]
        bodies = [_inertia(each) for each in given if each is not None and each["mass"] > 0]
        if not bodies:
            return None
        total = bodies[0]
        for body in bodies[1:]:
            total = total + body
        rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
        inertia = total.inertia[rows, columns].tolist()
        return {"mass": total.mass, "com": total.lever.tolist(), "inertia": inertia}

    def _with(self, step: Step, arm: Arm, q: np.ndarray) -> "Cell":
        payload, shape = step.fields.get("payload"), step.fields.get("shape")
        loads = self.loads if payload is None else self.loads | {step.name: payload}
        standing = [each for each in self.obstacles if each["name"] != step.name]
        taken = [each for each in self.obstacles if each["name"] == step.name]
        if taken:
            solid = _moved(taken[0], self._tool_frame(arm, q).inverse())
        elif shape is not None:
            solid = {**shape, "name": step.name}
        else:
            return replace(self, loads=loads)
        solid["touch_links"] = self._touching(solid, arm, q)
        return Cell(self.cycle, standing, [*self.attached, solid], loads)

    def _without(self, step: Step, frame: pin.SE3) -> "Cell":
        loads = {name: load for name, load in self.loads.items() if name != step.name}
        kept = [each for each in self.attached if each["name"] != step.name]
        gone = [each for each in self.attached if each["name"] == step.name]
        if not step.fields.get("leave_as_obstacle", True):
            gone = []
        left = [_moved(each, frame) for each in gone]
        return Cell(self.cycle, [*self.obstacles, *left], kept, loads)

    def _tool_frame(self, arm: Arm, q: np.ndarray) -> pin.SE3:
        rotation, position = arm.tool(q[None])
        offset = placement_of(self.cycle.header["robot"].get("tool_offset") or {})
        return pin.SE3(rotation[0], position[0]) * offset.inverse()

    def _touching(self, solid: dict[str, Any], arm: Arm, q: np.ndarray) -> list[str]:
        """Return the links that something attached touches, or nearly."""
        folder = self.cycle.folder
        folders = [folder / each for each in self.cycle.header["robot"].get("package_dirs") or []]
        geometry, placement = solid_geometry(solid, folder, folders)
        there = self._tool_frame(arm, q) * placement
        held = placed(solid["name"], "obstacle", 0, there, geometry)
        poses = Poses(*arm.poses(q[None]))
        links = [each for each in arm.solids if each.kind == "link"]
        near = [each for each in links if signed_distance((each, held), poses, 0) < TOUCHING]
        return sorted({each.owner for each in near})


def _moved(solid: dict[str, Any], by: pin.SE3) -> dict[str, Any]:
    """Return a solid's fields, its pose seen from elsewhere."""
    pose = by * placement_of(solid)
    kept = {key: solid[key] for key in solid if key not in ("rpy", "touch_links")}
    turn = pin.Quaternion(pose.rotation).coeffs().tolist()
    return kept | {"position": pose.translation.tolist(), "quaternion": turn}


def _inertia(payload: dict[str, Any]) -> pin.Inertia:
    xx, yy, zz, xy, xz, yz = payload.get("inertia", [0.0] * 6)
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
    com = np.array(payload.get("com", [0.0] * 3), dtype=float)
    return pin.Inertia(float(payload["mass"]), com, about_com)
