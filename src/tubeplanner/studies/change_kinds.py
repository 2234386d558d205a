"""Changes of tube, cell, limits of joints, payload, start, goal and duration."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.inverse_kinematics import WantedRotation, solve_position
from tubeplanner.first_guess.pose_configurations import middle_of
from tubeplanner.geometry.tube.bands import BEST, REQUIRED, has_bands
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.studies.changes import (
    MAX_GROWTH,
    Change,
    Proposal,
    Question,
    exact,
    figures,
    from_to,
    rounded,
)
from tubeplanner.task.endpoints import GoalRegion, Seed, ToolPose, configuration_of
from tubeplanner.task.holding import CONTACT_KINDS
from tubeplanner.task.problem_format import ClearanceFields, SceneFields
from tubeplanner.task.problem_reader import end_of

_MAX_MOVE = 1.0  # [m], or [rad]
_TENTH = 0.1  # [m], or [rad]
_MAX_SLOWER = 0.9  # of the speeds of bands

# ---- Directions of moves, in words and as unit vectors.

AXES: tuple[tuple[str, FloatArray], ...] = tuple(
    (f"in {sign}{axis}", factor * np.eye(3)[k])
    for k, axis in enumerate("xyz")
    for sign, factor in (("+", 1.0), ("-", -1.0))
)


def along(position: FloatArray, direction: FloatArray, size: float) -> list[float]:
    """Return a position (3,) moved along a unit vector by a size [m]."""
    return [exact(value) for value in (np.asarray(position) + size * direction).tolist()]


def _moves(
    kind: str,
    field: str,
    before: Any,
    about: set[str],
    propose: Callable[[str, FloatArray, float], Proposal],
    directions: Sequence[tuple[str, FloatArray]] = AXES,
) -> Iterator[Change]:
    """Yield the moves in some directions; a proposal is of a direction in words and of a size."""
    for name, direction in directions:
        yield Change(
            kind=kind,
            field=field,
            before=before,
            unit="m",
            scale=_TENTH,
            most=_MAX_MOVE,
            propose=partial(propose, name, direction),
            about=frozenset(about),
            is_move=True,
            is_of_robot=kind == "attached",
        )


def _no_less_than_zero(value: float) -> float:
    return max(exact(value), 0.0)  # sizes are rounded


# ---- Changes of the tube: tolerances, reference points, joint signs, pass-through points.

_NUMBERS = {"+": 1, "-": -1, "0": 0}  # both spellings of a sign; 0: free


def tube_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that widen the tube, or lead the tool elsewhere."""
    yield from radius_changes(question, 1)
    yield from _boxes(question)
    yield from _rotation_tolerances(question)
    assert question.fields.tube is not None
    tool_radius = question.fields.tube.tool_radius
    if tool_radius > 0:
        number = ("tube.tool_radius", tool_radius, "m", -1, "tool_radius")
        yield Change.of_number("radius", *number, after=_no_less_than_zero, most=tool_radius)
    yield from _points(question)
    yield from _signs(question)
    before = question.fields.tube.pass_through_points
    if before != "none" and question.segment_count > 1:
        path = "tube.pass_through_points"
        less = Proposal({path: "none"}, "none", f"pass_through_points: {before} -> none")
        yield Change.switch("pass_through", path, before, less)


def radius_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the radius of each segment, wider (sign 1) or narrower (-1).

    Several radii are widened by a common factor as well.
    """
    radii = question.per_segment(question.tube_fields["radius"])

    def changed(segment: int, after: float) -> dict[str, Any]:
        return _new_radii(question, [*radii[:segment], after, *radii[segment + 1 :]])

    for segment, radius in enumerate(radii):
        if radius is not None:
            path = f"tube.radius.{segment}" if question.segment_count > 1 else "tube.radius"
            number = (path, radius, "m", sign, f"segment {segment}:")
            about = frozenset({f"segment {segment}"})
            changes = partial(changed, segment)
            yield Change.of_number("radius", *number, changes=changes, about=about)

    def scaled(size: float) -> Proposal:
        factor = exact(1 + size)
        after = [None if radius is None else exact(factor * radius) for radius in radii]
        changes = _new_radii(question, after)
        brief = f"times {figures(factor)}"
        return Proposal(changes, changes["tube.radius"], f"all radii {brief}", brief)

    if sign > 0 and sum(radius is not None for radius in radii) > 1:
        before = _plain(question.spec.document["tube"].get("radius"))
        yield Change("radii", "tube.radius", before, "", 1.0, MAX_GROWTH, scaled)


def band_changes(question: Question) -> Iterator[Change]:
    """Yield the changes of speed bands: slower, as near as joints can, wider bends inside them."""
    document = question.spec.document["tube"]
    before = _plain(document.get("tool_speed"))
    if not has_bands(before):
        return
    entries = before if isinstance(before, list) else [before]

    def slower(size: float) -> Proposal:
        factor = exact(1 - size)
        after = [_scaled_band(each, factor) for each in entries]
        value = after if isinstance(before, list) else after[0]
        brief = f"times {figures(factor)}"
        return Proposal({"tube.tool_speed": value}, value, f"bands of tool_speed {brief}", brief)

    least = min(_ends_of(each)[0] for each in entries if isinstance(each, Mapping))

    def wider_band(size: float) -> Proposal:
        end = exact(least - size)
        after = [
            {"between": [min(end, _ends_of(each)[0]), _ends_of(each)[1]]}
            if isinstance(each, Mapping)
            else each
            for each in entries
        ]
        value = after if isinstance(before, list) else after[0]
        brief = figures(end, "m/s")
        return Proposal(
            {"tube.tool_speed": value}, value, f"bands of tool_speed from {brief}", brief
        )

    yield Change("band", "tube.tool_speed", before, "", 1.0, _MAX_SLOWER, slower, is_loss=True)
    most = _MAX_SLOWER * least
    yield Change("band", "tube.tool_speed", before, "m/s", least, most, wider_band, is_loss=True)
    process = document.get("process") or {}
    if process.get("steady", REQUIRED) == REQUIRED:
        path = "tube.process.steady"
        best = Proposal({path: BEST}, BEST, f"process.steady: {REQUIRED} -> {BEST}")
        yield Change.switch("band", path, REQUIRED, best)
    radii = question.per_segment(question.tube_fields["radius"])
    is_banded = [has_bands([each]) for each in question.per_segment(before)]

    def wider(point: int, after: float) -> dict[str, Any]:
        beside = [max(radius, after) for radius in radii[point - 1 : point + 1]]
        return _new_radii(question, [*radii[: point - 1], *beside, *radii[point + 1 :]])

    for point in range(1, question.segment_count):
        own = radii[point - 1 : point + 1]
        if all(is_banded[point - 1 : point + 1]) and None not in own:
            path = f"tube.radius.{point - 1}, tube.radius.{point}"
            number = (path, min(own), "m", 1, f"segments {point - 1} and {point}: radius")
            about = frozenset({f"point {point}"})
            yield Change.of_number("bend", *number, changes=partial(wider, point), about=about)


def _ends_of(band: Mapping[str, Any]) -> tuple[float, float]:
    """Return the lower and the upper end of a band [m/s]."""
    if band.get("between") is not None:
        return band["between"][0], band["between"][1]
    return exact(band["speed"] * (1 - band["tolerance"])), band["speed"]


def _scaled_band(entry: Any, factor: float) -> Any:
    """Return an entry of `tool_speed` whose band is multiplied by a factor; a limit stays."""
    if not isinstance(entry, Mapping):
        return entry
    if entry.get("between") is not None:
        return {"between": [exact(factor * each) for each in entry["between"]]}
    return {"speed": exact(factor * entry["speed"]), "tolerance": entry["tolerance"]}


def _new_radii(question: Question, radii: Sequence[float | None]) -> dict[str, Any]:
    """Return the values by field path that give the segments other radii."""
    changes = {"tube.radius": radii[0] if len(set(radii)) == 1 else list(radii)}
    if question.spec.document["tube"].get("radius") is None:  # they are in the file of points
        return _from_file(question) | changes
    return changes


def _from_file(question: Question) -> dict[str, Any]:
    """Return the values by field path that stand in a tube's file of points."""
    return {f"tube.{key}": _plain(value) for key, value in question.tube_fields.items()}


def _plain(value: Any) -> Any:
    return None if value is None else np.asarray(value).tolist()


def _boxes(question: Question) -> Iterator[Change]:
    """Yield the changes of both sides of each box by a factor; the size is the shorter side's."""
    assert question.fields.tube is not None
    boxes = question.per_segment(question.spec.document["tube"].get("cross_section"))

    def wider(segment: int, before: Sequence[float], size: float) -> Proposal:
        after = [exact(side + size * side / min(before)) for side in before]
        boxes_after = [
            box if k != segment else {**box, "box": after} for k, box in enumerate(boxes)
        ]
        sides = " by ".join(from_to(*pair, "m") for pair in zip(before, after, strict=True))
        brief = " by ".join(figures(side, "m") for side in after)
        text = f"box of segment {segment}: {sides}"
        return Proposal({"tube.cross_section": boxes_after}, after, text, brief)

    for segment, box in enumerate(boxes):
        if box is not None:
            yield Change(
                kind="radius",
                field=f"tube.cross_section.{segment}.box",
                before=list(box["box"]),
                unit="m",
                scale=min(box["box"]),
                most=MAX_GROWTH * min(box["box"]),
                propose=partial(wider, segment, box["box"]),
                about=frozenset({f"segment {segment}"}),
            )


def _rotation_tolerances(question: Question) -> Iterator[Change]:
    """Yield the changes that raise the least bounds of each segment, and others to the same."""
    assert question.fields.tube is not None
    tolerance = question.fields.tube.rotation_tolerance
    if tolerance is None:
        return
    count = question.segment_count
    # Three numbers are an angle each for three segments, else the bounds of every segment.
    if not isinstance(tolerance, list):
        bounds: list[Any] = [tolerance] * count
    elif len(tolerance) == 3 and count != 3 and not isinstance(tolerance[0], tuple):
        bounds = [tolerance] * count
    else:
        bounds = list(tolerance)

    def raised(segment: int, after: float) -> dict[str, Any]:
        bounds_after = [np.array(each, dtype=float) for each in bounds]
        bounds_after[segment] = np.maximum(bounds_after[segment], after)
        return {"tube.rotation_tolerance": [each.tolist() for each in bounds_after]}

    for segment, bound in enumerate(bounds):
        finite = [b for b in np.atleast_1d(bound).tolist() if np.isfinite(b)]
        if finite:
            name = f"rotation tolerance of segment {segment}:"
            number = (f"tube.rotation_tolerance.{segment}", min(finite), "rad", 1, name)
            more: dict[str, Any] = {
                "changes": partial(raised, segment),
                "about": frozenset({f"segment {segment}"}),
            }
            scale = max(min(finite), 0.01)
            yield Change.of_number("rotation_tolerance", *number, scale=scale, most=3.0, **more)


_MAX_END = 4  # reference points of an end that move together


def _points(question: Question) -> Iterator[Change]:
    """Yield the moves of reference points: each, those of an end, and all, along the axes.

    Start and goal move with their points: a place to put down has a place above it.
    """
    last = question.segment_count
    ends = [
        (n, run)
        for n in range(2, _MAX_END + 1)
        for run in (range(n), range(last + 1 - n, last + 1))
    ]
    runs = [range(k, k + 1) for k in range(last + 1)] * (not question.has_point_file)
    runs += [*(run for n, run in ends if n <= last), range(last + 1)]
    base = question.robot.body_poses(np.zeros((1, question.robot.joint_count)))[1][0, 1]

    def shifted(run: range, name: str, direction: FloatArray, size: float) -> Proposal:
        after = [along(point, direction, size) for point in question.points[run]]
        points = question.points.tolist()
        points[run.start : run.stop] = after
        if question.has_point_file:
            changes = {**_from_file(question), "tube.points": points}
        elif len(run) == len(points):
            changes = {"tube.points": points}
        else:
            changes = {f"tube.points.{k}": point for k, point in zip(run, after, strict=True)}
        noun = (
            f"reference point {run[0]}" if len(run) == 1 else f"points {run[0]}-{run[-1]} together"
        )
        if len(run) == len(points):
            noun = "the whole tube"
        text = f"move {noun} by {figures(size, 'm')} {name}"
        for end, point in (("start", 0), ("goal", last)):
            end_values = _moved_end(question, end, direction, size) if point in run else {}
            changes |= end_values
            text += f"; {end}: its joints as a seed" * (end in end_values)
        return Proposal(changes, after[0] if len(run) == 1 else after, text, figures(size, "m"))

    for run in runs:
        inwards = base - question.points[run].mean(axis=0)
        inwards = inwards / max(np.linalg.norm(inwards), 1e-9)
        is_likely = len(run) <= min(2, last) and not question.has_point_file
        points = question.points[run].tolist()
        about = {f"{name} {k}" for k in run for name in ("point", "segment")}
        yield from _moves(
            "point" if is_likely else "points",
            f"tube.points.{run[0]}" if len(run) == 1 else "tube.points",
            points[0] if len(run) == 1 else points,
            {*about, f"segment {run[0] - 1}"},
            partial(shifted, run),
            [*AXES, ("towards the arm's base", inwards)],
        )


def _moved_end(question: Question, end: str, direction: FloatArray, size: float) -> dict[str, Any]:
    """Return the values by field path of an end that moves with its point; joints become a seed."""
    fields = getattr(question.fields, end)
    try:
        value = end_of(end, fields, question.robot, question.spec.folder)
        if isinstance(value, ToolPose):
            return {f"{end}.pose.position": along(value.position, direction, size)}
        if isinstance(value, GoalRegion):
            return {f"{end}.position": along(value.position, direction, size)}
        if value is None or isinstance(value, Seed):
            return {}
        q = question.robot.limits.clip(configuration_of(question.robot, end, value))
    except ProblemError:  # loading the problem reports that
        return {}
    return {end: {"seed": q.tolist()}}


def _signs(question: Question) -> Iterator[Change]:
    """Yield other signs of each joint that has a sign, in all segments."""
    assert question.fields.tube is not None
    field = question.fields.tube.joint_signs
    maps = [dict(signs) for signs in (field if isinstance(field, list) else [field])]
    for joint in dict.fromkeys(name for signs in maps for name in signs):
        before = next(signs[joint] for signs in maps if joint in signs)
        for sign in _NUMBERS:
            if before in (sign, _NUMBERS[sign]):
                continue
            others = [{**signs, joint: sign} if joint in signs else dict(signs) for signs in maps]
            changes = {"tube.joint_signs": others if isinstance(field, list) else others[0]}
            yield Change.switch(
                "sign",
                f"tube.joint_signs.{joint}",
                list(before) if isinstance(before, list | tuple) else before,
                Proposal(changes, sign, f"joint_signs: '{sign}' on {joint}"),
                frozenset({joint}),
            )


# ---- Changes of the cell: obstacles, attached solids, clearances.


def cell_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that move solids, or lower clearances."""
    yield from obstacle_changes(question)
    for solid in question.fields.robot.attached:  # along the axes of the tool frame
        position = list(solid.position)
        path = f"robot.attached.{solid.name}.position"
        propose = partial(_shifted_solid, path, position, f"attached solid '{solid.name}'")
        yield from _moves("attached", path, position, {f"link {solid.name}"}, propose)
    yield from clearance_changes(question, -1)


def obstacle_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each obstacle along the axes of the base frame."""
    for obstacle in question.fields.obstacles:
        if isinstance(obstacle, SceneFields):  # its solids have no fields of the problem
            continue
        position = list(obstacle.position)
        path = f"obstacles.{obstacle.name}.position"
        propose = partial(_shifted_solid, path, position, f"obstacle '{obstacle.name}'")
        yield from _moves("obstacle", path, position, {f"obstacle {obstacle.name}"}, propose)


def _shifted_solid(
    path: str, position: list[float], noun: str, name: str, direction: FloatArray, size: float
) -> Proposal:
    after = along(np.array(position), direction, size)
    frame = " of the tool frame" if noun.startswith("attached") else ""
    text = f"move {noun} by {figures(size, 'm')} {name}{frame}"
    return Proposal({path: after}, after, text, figures(size, "m"))


def clearance_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of each clearance, larger (sign 1) or smaller (-1)."""
    for path, name, before, about in _clearances(question):
        if sign > 0 or before > 0:
            number = (path, before, "m", sign, name)
            more: dict[str, Any] = {
                "scale": before or _TENTH,
                "most": _MAX_MOVE if sign > 0 else before,
            }
            more |= {"after": _no_less_than_zero, "about": about}
            yield Change.of_number("clearance", *number, **more)


def _clearances(question: Question) -> Iterator[tuple[str, str, float, frozenset[str]]]:
    """Yield path, name, value and concerned names of each clearance."""
    clearance = question.fields.clearance
    if not isinstance(clearance, ClearanceFields):
        yield "clearance", "clearance", clearance, frozenset()
        return
    yield "clearance.default", "clearance", clearance.default, frozenset()
    for k, pair in enumerate(clearance.pairs):
        about = frozenset(f"{kind} {name}" for kind in ("link", "obstacle") for name in pair.links)
        name = f"clearance of {pair.links[0]} and {pair.links[1]}"
        yield f"clearance.pairs.{k}.clearance", name, pair.clearance, about
    for k, value in enumerate(clearance.segments or []):
        if value is not None:
            about = frozenset({f"segment {k}"})
            yield f"clearance.segments.{k}", f"clearance of segment {k}", value, about


# ---- Changes of the joints' limits and of the payload.

_MAX_WIDENING = 2 * np.pi  # [rad], or [m]: of a position limit
_ROUNDING = 1e-6  # of a period
_DECIMALS = 6  # of joints


def limit_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that widen limits of joints, lighten the payload, or hold parts better."""
    yield from effort_changes(question, 1)
    yield from payload_changes(question, -1)
    yield from holding_changes(question, 1)
    yield from tool_limit_changes(question, 1)
    robot, own = question.robot, question.fields.robot.limits.position
    lower, upper = _own_positions(robot.limits)

    def wider(k: int, limits: tuple[float, float], end: int, sign: int, size: float) -> Proposal:
        after, joint = list(limits), robot.joint_names[k]
        after[end] = exact(limits[end] + sign * size)
        unit = "rad" if robot.revolute[k] else "m"
        name = ("lower", "upper")[end]
        text = f"{joint}: {name} limit {from_to(limits[end], after[end], unit)}"
        changes = _limit_of(question, "position", joint, after)
        return Proposal(changes, after, text, figures(after[end], unit))

    margins = np.broadcast_to(robot.limits.position_margin, robot.joint_count).tolist()
    for k, joint in enumerate(robot.joint_names):
        limits, unit = (lower[k], upper[k]), "rad" if robot.revolute[k] else "m"
        if margins[k] > 0:  # limits are not widened before the margin from them is gone
            field = f"robot.limits.position_margin.{joint}"
            changes = partial(_limit_of, question, "position_margin", joint)
            name = f"{joint}: margin from position limits"
            number = (field, margins[k], unit, -1, name)
            yield Change.of_number("position", *number, changes=changes, about=frozenset({joint}))
            continue
        for end, sign in enumerate((-1, 1)):
            if np.isfinite(limits[end]):
                yield Change(
                    kind="position",
                    field=f"robot.limits.position.{joint}",
                    before=list(limits),
                    unit=unit,
                    scale=_TENTH,
                    most=_MAX_WIDENING,
                    propose=partial(wider, k, limits, end, sign),
                    about=frozenset({joint}),
                    is_of_robot=not isinstance(own, Mapping) or joint not in own,
                )


def effort_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the effort limit of each joint, more (sign 1) or less (-1)."""
    robot, limits = question.robot, question.fields.robot.limits
    scale = limits.scale.get("effort", 1.0)

    def changed(joint: str, before: float, value: Any, after: float) -> dict[str, Any]:
        factor = after / before
        effort: Any  # as in the file: a number, a pair or a table
        if value is None:
            effort = after
        elif isinstance(value, int | float):
            effort = exact(factor * value)
        elif isinstance(value, list | tuple):
            effort = [exact(factor * each) for each in value]
        else:
            values = [exact(factor * each) for each in value.effort]
            effort = {"position": value.position, "effort": values}
        return _limit_of(question, "effort", joint, effort)

    for k, (joint, limit) in enumerate(
        zip(robot.joint_names, robot.limits.effort.tolist(), strict=True)
    ):
        if not np.isfinite(limit):
            continue
        value = limits.effort.get(joint) if isinstance(limits.effort, dict) else None
        before = exact(limit / scale)
        unit = "N m" if robot.revolute[k] else "N"
        number = (f"robot.limits.effort.{joint}", before, unit, sign, f"{joint}:")
        changes = partial(changed, joint, before, value)
        more: dict[str, Any] = {"about": frozenset({joint}), "is_of_robot": value is None}
        yield Change.of_number("effort", *number, changes=changes, says_more=sign > 0, **more)


def tool_limit_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of limits on the tool's speed and acceleration, more (1) or less (-1).

    Without a required duration, a slower motion keeps any of them: there is none then.
    """
    fields = question.fields
    if fields.objective is None or fields.objective.duration is None:
        return
    for name, unit in (("tool_speed", "m/s"), ("tool_acceleration", "m/s^2")):
        values = {f"robot.limits.{name}": getattr(question.robot.limits, name)}
        of_tube = getattr(fields.tube, name)
        if isinstance(of_tube, list):
            values |= {f"tube.{name}.{k}": value for k, value in enumerate(of_tube)}
        else:
            values[f"tube.{name}"] = of_tube
        for path, value in values.items():
            if isinstance(value, int | float) and np.isfinite(value):  # no band
                is_of_robot = path.startswith("robot") and not getattr(fields.robot.limits, name)
                number = (path, value, unit, sign, f"{path}:")
                yield Change.of_number(name, *number, is_of_robot=is_of_robot)


def _own_positions(limits: JointLimits) -> tuple[list[float], list[float]]:
    """Return the lower and the upper position limits, without the margin from them."""
    margin = limits.position_margin
    return (limits.lower_position - margin).tolist(), (limits.upper_position + margin).tolist()


def _limit_of(question: Question, quantity: str, joint: str, value: Any) -> dict[str, Any]:
    """Return the values that give a joint another limit, and the others their present limits."""
    limits = getattr(question.fields.robot.limits, quantity)
    path = f"robot.limits.{quantity}"
    if isinstance(limits, Mapping):
        return {f"{path}.{joint}": value}
    # One value for all joints, or a list, becomes a map by name.
    robot, names = question.robot, question.robot.joint_names
    if quantity == "position":
        values = np.column_stack(_own_positions(robot.limits)).tolist()
    else:
        factor = question.fields.robot.limits.scale.get(quantity, 1.0)
        values = [exact(each / factor) for each in getattr(robot.limits, quantity).tolist()]
    return {path: {**dict(zip(names, values, strict=True)), joint: value}}


def payload_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the payload's mass, more (sign 1) or less (-1)."""
    payload = question.fields.robot.payload
    if payload is None or payload.mass <= 0:
        return
    before = payload.mass

    def changed(size: float) -> Proposal:
        after = exact(before + sign * size)
        changes = {"robot.payload.mass": after}
        brief = figures(after, "kg")
        return Proposal(changes, after, f"payload at most {brief}", brief)

    most = MAX_GROWTH * before if sign > 0 else 0.999 * before
    yield Change(
        *("payload", "robot.payload.mass", before, "kg", before, most, changed), is_loss=sign < 0
    )


# ---- Changes of held parts: safety is never proposed to be less.

# Numbers of contacts, each with its unit. More of any holds better.
_CONTACT_NUMBERS = {
    **{"force": "N", "vacuum": "Pa", "friction": "", "torsion": "m", "tilt": "rad"},
    **dict.fromkeys(("radius", "diameter", "foot", "pad"), "m"),
}
# Largest sensible values: no coating has more friction, and no liquid's surface is upright.
_MAX_OF_CONTACTS = {"friction": 1.5, "tilt": 1.5}


def holding_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of what holds a part, for the better (sign 1) or the worse (-1).

    The size of a foot or a pad is its shorter side's. The arm's payload has a part's mass too.
    """
    value, payload = question.fields.holding, question.fields.robot.payload
    several = isinstance(value, list)
    items: list[Any] = [] if value is None else list(value) if several else [value]

    def changed(field: str, before: Any, after: float) -> dict[str, Any]:
        if not isinstance(before, list | tuple):
            return {field: after}
        return {field: [exact(after * side / min(before)) for side in before]}

    def carried(field: str, before: float, after: float) -> dict[str, Any]:
        if payload is None:  # the part is no weight for the arm
            return {field: after}
        return {field: after, "robot.payload.mass": exact(payload.mass + after - before)}

    for k, item in enumerate(items):
        path = f"holding.{k}" if several else "holding"
        for contact in CONTACT_KINDS:
            fields = getattr(item, contact.kind)
            for name, unit in _CONTACT_NUMBERS.items():
                before = getattr(fields, name, None)
                if before is None:
                    continue
                field = f"{path}.{contact.kind}.{name}"
                least = min(before) if isinstance(before, list | tuple) else before
                number = (field, least, unit, sign, field)
                most = _MAX_OF_CONTACTS.get(name, np.inf) - least if sign > 0 else np.inf
                if most > 0:
                    change = Change.of_number(
                        "holding", *number, changes=partial(changed, field, before)
                    )
                    yield replace(change, most=min(change.most, most))
        if item.part is not None and item.liquid is None:
            field, mass = f"{path}.part.mass", item.part.mass
            number = (field, mass, "kg", -sign, field)
            yield Change.of_number("holding", *number, changes=partial(carried, field, mass))


# ---- Changes of start, goal and duration.


def end_changes(question: Question) -> Iterator[Change]:
    """Yield the changes of start and goal, and of a required duration."""
    for end in ("start", "goal"):
        yield from _joints(question, end)
    # Joints of start and goal are left to inverse kinematics.
    start, goal = question.fields.start.joints, question.fields.goal
    if start is not None:
        with suppress(ProblemError):
            q = question.robot.limits.clip(configuration_of(question.robot, "start", start))
            seeded = Proposal(
                {"start": {"seed": q.tolist()}},
                {"seed": q.tolist()},
                "start: inverse kinematics of reference point 0, from the joints given as a seed,",
            )
            yield Change.switch("start", "start", question.spec.document["start"], seeded)
    if goal is not None and goal.joints is not None:
        opened = Proposal({"goal": None}, None, "goal: left out, its configuration open,")
        yield Change.switch("goal", "goal", question.spec.document["goal"], opened)
    yield from _loose_ends(question)
    objective, period = question.fields.objective, question.fields.period
    if objective is None or objective.duration is None:
        return
    before = objective.duration

    def in_periods(after: float) -> float:
        return exact(after if not period else ceil(after / period - _ROUNDING) * period)

    number = ("objective.duration", before, "s", 1, "objective.duration")
    yield Change.of_number("duration", *number, after=in_periods, most=100 * before)


def _joints(question: Question, end: str) -> Iterator[Change]:
    value = getattr(question.fields, end)
    if value is None or value.joints is None:
        return
    try:
        q = configuration_of(question.robot, end, value.joints)
    except ProblemError:  # it names an unknown joint: loading the problem reports that
        return
    revolute = question.robot.revolute

    def shifted(k: int, joint: str, sign: int, size: float) -> Proposal:
        after = q.tolist()
        after[k] = exact(after[k] + sign * size)
        brief = figures(size, "rad" if revolute[k] else "m")
        text = f"{end}: {'' if sign > 0 else '-'}{brief} on {joint}"
        return Proposal({f"{end}.joints": after}, after, text, brief)

    for k, joint in enumerate(question.robot.joint_names):
        for sign in (1, -1):
            yield Change(
                kind=end,
                field=f"{end}.joints",
                before=q.tolist(),
                unit="rad" if revolute[k] else "m",
                scale=_TENTH,
                most=_MAX_MOVE,
                propose=partial(shifted, k, joint, sign),
                about=frozenset({end, joint}),
            )


def _loose_ends(question: Question) -> Iterator[Change]:
    """Yield a start by joints near its point, a goal within a tolerance, and both together."""
    start = _start_nearby(question)
    if start is not None:
        yield Change.switch("start", "start", question.spec.document["start"], start)
    goal, last = question.fields.goal, question.segment_count
    about = frozenset({"goal", f"segment {last - 1}", f"point {last}"})
    has_position = goal is not None and goal.position is not None
    before = goal.tolerance if goal is not None and has_position else 0.0
    proposals: list[tuple[str, Proposal | None]] = [("goal", None)]
    if start is not None and (goal is None or goal.joints is None):
        proposals.append(("ends", start))

    def within(other_start: Proposal | None, size: float) -> Proposal:
        after = exact(before + size)
        changes: dict[str, Any] = {"goal.tolerance": after}
        text = f"goal.tolerance {from_to(before, after, 'm')}"
        if not has_position:
            pose = None if goal is None else goal.pose
            centre = question.points[-1].tolist() if pose is None else list(pose.position)
            changes = {"goal": {"position": centre, "tolerance": after}}
            name = f"reference point {last}" if pose is None else "its position"
            text = f"goal: within {figures(after, 'm')} of {name}, in any configuration"
        if other_start is not None:
            changes, text = {**other_start.changes, **changes}, f"{other_start.text} {text}"
        return Proposal(changes, after, text, figures(after, "m"))

    for kind, other in proposals:
        yield Change(
            kind=kind,
            field="goal.tolerance" if other is None else "start.joints, goal.tolerance",
            before=before,
            unit="m",
            scale=before or _TENTH,
            most=_MAX_MOVE,
            propose=partial(within, other),
            about=about,
        )


def _start_nearby(question: Question) -> Proposal | None:
    """Return a seed's or pose's configuration as near as the arm comes; None of other starts."""
    robot, fields, limits = question.robot, question.fields, question.robot.limits
    try:
        value = end_of("start", fields.start, robot, question.spec.folder)
        if not isinstance(value, Seed | ToolPose):
            return None
        target, rotation = question.points[0], None
        seed = value.joints if isinstance(value, Seed) else value.seed
        if isinstance(value, ToolPose):
            target = value.position
            rotation = WantedRotation(value.rotation, np.zeros(3), np.ones(3, dtype=bool))
        if seed is None:
            seed = middle_of(limits.lower_position, limits.upper_position)
        q = limits.clip(configuration_of(robot, "start", seed))
    except ProblemError:  # loading the problem reports that
        return None
    bounds = limits.lower_position, limits.upper_position
    q = limits.clip(solve_position(robot, target, q, *bounds, rotation=rotation).q.round(_DECIMALS))
    apart = rounded(float(np.linalg.norm(robot.tool_position(q[None])[0] - target)))
    values = ", ".join(f"{value:g}" for value in q)
    text = f"start: joints [{values}], {figures(apart, 'm')} from its point;"
    return Proposal({"start": {"joints": q.tolist()}}, {"joints": q.tolist()}, text)
