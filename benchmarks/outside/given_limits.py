"""Limits and motors that a problem gives: its own, its presets', and limits of MoveIt's."""

import math
from pathlib import Path
from typing import Any

from outside.files import BUNDLED, BadInput, find_file
from outside.problem import LIMITS, MOTORS, Problem, read_document

WHOLE = {"tool_speed", "point_speed"}  # of a robot, rather than of its joints
MOVEIT = {
    "max_velocity": "velocity",
    "max_acceleration": "acceleration",
    "max_jerk": "jerk",
    "max_effort": "effort",
}


def given_limits(
    problem: Problem, package_dirs: list[Path], chain: list[str], followers: list[str]
) -> dict[str, Any]:
    """Return limits as a section `robot.limits` with nothing but maps by joint name.

    Args:
        problem: The problem file.
        package_dirs: Folders that hold packages.
        chain: The planning group, from the root on.
        followers: Joints that follow one of it.

    Raises:
        BadInput: A file is missing, for another arm, or has a field that this judge does not know.
    """
    robot, folder = problem.robot, problem.folder
    layers = []
    if robot.get("limits_file") is not None:
        path = find_file(robot["limits_file"], folder, package_dirs)
        layers.append(_moveit(read_document(path), {*chain, *followers}))
    layers += [preset.get("limits") or {} for preset in _presets(problem, len(chain))]
    merged: dict[str, Any] = {}
    for layer in [*layers, robot.get("limits") or {}]:
        for quantity, given in layer.items():
            if quantity in WHOLE:
                merged[quantity] = given or merged.get(quantity)
            else:
                merged[quantity] = merged.get(quantity, {}) | _by_name(quantity, given, chain)
    return merged


def given_motors(problem: Problem, count: int) -> list[dict[str, Any]]:
    """Return sections `motors` of presets and of a problem for so many joints; later ones win.

    Raises:
        BadInput: As for `given_limits`.
    """
    layers = [preset.get("motors") or {} for preset in _presets(problem, count)]
    return [*layers, problem.robot.get("motors") or {}]


def _presets(problem: Problem, count: int) -> list[dict[str, Any]]:
    names = problem.robot.get("preset") or []
    names = [names] if isinstance(names, str) else names
    return [_preset(name, problem.folder, count) for name in names]


def _by_name(quantity: str, given: Any, chain: list[str]) -> dict[str, Any]:
    if given is None or isinstance(given, dict):
        return given or {}
    values = given if isinstance(given, list) else [given] * len(chain)
    if len(values) != len(chain):
        raise BadInput(f"limits.{quantity} has {len(values)} values for {len(chain)} joints")
    return dict(zip(chain, values, strict=True))


def _preset(name: str, folder: Path, count: int) -> dict[str, Any]:
    bundled = BUNDLED / "presets" / f"{name}.yaml"
    fields = read_document(bundled if bundled.is_file() else find_file(name, folder, []))
    if fields["format"] != "tubeplanner/preset" or fields.get("version", 1) != 1:
        raise BadInput(f"preset {name} has another format")
    if fields["joints"] != count:
        raise BadInput(f"preset {name} is for {fields['joints']} joints, not for {count}")
    for section, known in (("limits", LIMITS), ("motors", MOTORS)):
        if unknown := set(fields.get(section) or {}) - known:
            raise BadInput(f"preset {name}: {section}.{unknown.pop()} is not known here")
    return dict(fields)


def _moveit(fields: Any, known: set[str]) -> dict[str, Any]:
    """Return the limits of some joints in a file of MoveIt's; `has_...` may switch them off."""
    limits: dict[str, dict[str, Any]] = {name: {} for name in ("position", *MOVEIT.values())}
    for name, joint in fields["joint_limits"].items():
        if name not in known:
            continue
        if "min_position" in joint and joint.get("has_position_limits", True):
            limits["position"][name] = [joint["min_position"], joint["max_position"]]
        for key, quantity in MOVEIT.items():
            if key in joint and joint.get(f"has_{quantity}_limits", True):
                limits[quantity][name] = joint[key]
        if "max_deceleration" in joint and joint.get("has_deceleration_limits", True):
            own = limits["acceleration"].get(name, math.inf)
            limits["acceleration"][name] = min(own, abs(joint["max_deceleration"]))
    return limits
