"""Changes of tube, obstacles and clearances."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.studies.changes import Change, Proposal, Question, exact, figures, from_to
from tubeplanner.task.fields import ClearanceFields

# ---- Directions in which something may be moved, in words and as vectors.

AXES: tuple[tuple[str, FloatArray], ...] = tuple(
    (f"in {sign}{axis}", factor * np.eye(3)[k])
    for k, axis in enumerate("xyz")
    for sign, factor in (("+", 1.0), ("-", -1.0))
)


def along(position: FloatArray, way: FloatArray, size: float) -> list[float]:
    """Return a position (3,) moved along a unit vector by a size [m]."""
    return [exact(value) for value in (np.asarray(position) + size * way).tolist()]


# ---- Changes of the tube: tolerances, reference points, joint signs, what the tool must pass.

_MOST_TIMES = 10.0  # of a tolerance, its growth
_FARTHEST = 1.0  # [m] that a reference point is moved
_NUMBERS = {"+": 1, "-": -1, "0": 0}  # what a sign may be written as; 0: free


def tube_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that give the tool more room, or lead it elsewhere."""
    yield from radius_changes(question, 1)
    yield from _all_radii(question)
    yield from _boxes(question)
    yield from _rotation_tolerances(question)
    yield from _tool_radius(question)
    yield from _points(question)
    yield from _signs(question)
    yield from _pass_through(question)


def radius_changes(question: Question, way: int) -> Iterator[Change]:
    """Yield the changes of the radius of each segment, wider or (-1) narrower."""
    radii = question.per_segment(question.given_tube["radius"])
    for segment, radius in enumerate(radii):
        if radius is not None:
            yield Change(
                kind="radius",
                field=_radius_path(question, segment),
                before=radius,
                unit="m",
                scale=radius,
                most=_MOST_TIMES * radius if way > 0 else 0.99 * radius,
                propose=partial(_radius, question, radii, segment, way),
                about=frozenset({f"segment {segment}"}),
                is_loss=way < 0,
            )


def _all_radii(question: Question) -> Iterator[Change]:
    """Yield the change of all radii by one share."""
    radii = question.per_segment(question.given_tube["radius"])
    if len([radius for radius in radii if radius is not None]) > 1:
        before = question.posed.document["tube"].get("radius")
        propose = partial(_all_radii_by, question, radii)
        yield Change("radii", "tube.radius", _plain(before), "", 1.0, _MOST_TIMES, propose)


def _all_radii_by(question: Question, radii: Sequence[float | None], share: float) -> Proposal:
    factor = exact(1 + share)
    wider = [None if radius is None else exact(factor * radius) for radius in radii]
    changes = _radii_given(question, wider)
    brief = f"times {figures(factor)}"
    return Proposal(changes, changes["tube.radius"], f"all radii {brief}", brief)


def _radius_path(question: Question, segment: int) -> str:
    """Return the path of a segment's radius, as a list of them has it."""
    return f"tube.radius.{segment}" if question.segment_count > 1 else "tube.radius"


def _radius(
    question: Question, radii: Sequence[float | None], segment: int, way: int, size: float
) -> Proposal:
    before = radii[segment]
    assert before is not None
    after = exact(before + way * size)
    given = [after if k == segment else radius for k, radius in enumerate(radii)]
    text = f"segment {segment}: {from_to(before, after, 'm')}"
    return Proposal(_radii_given(question, given), after, text, figures(after, "m"))


def _radii_given(question: Question, radii: Sequence[float | None]) -> dict[str, Any]:
    """Return the changes that give segments these radii."""
    changes = {"tube.radius": radii[0] if len(set(radii)) == 1 else list(radii)}
    if question.posed.document["tube"].get("radius") is None:  # they are in the file of points
        points = {key: _plain(value) for key, value in question.given_tube.items()}
        return {f"tube.{key}": value for key, value in points.items()} | changes
    return changes


def _plain(value: Any) -> Any:
    return None if value is None else np.asarray(value).tolist()


def _boxes(question: Question) -> Iterator[Change]:
    """Yield the changes of both sides of each box by one share; the size is the shorter side's."""
    assert question.fields.tube is not None
    given = question.posed.document["tube"].get("cross_section")
    for segment, box in enumerate(question.per_segment(given)):
        if box is not None:
            yield Change(
                kind="radius",
                field=f"tube.cross_section.{segment}.box",
                before=list(box["box"]),
                unit="m",
                scale=min(box["box"]),
                most=_MOST_TIMES * min(box["box"]),
                propose=partial(_box, question.per_segment(given), segment),
                about=frozenset({f"segment {segment}"}),
            )


def _box(boxes: Sequence[Any], segment: int, size: float) -> Proposal:
    before = boxes[segment]["box"]
    after = [exact(side + size * side / min(before)) for side in before]
    given = [box if k != segment else {**box, "box": after} for k, box in enumerate(boxes)]
    sides = " by ".join(from_to(*pair, "m") for pair in zip(before, after, strict=True))
    brief = " by ".join(figures(side, "m") for side in after)
    text = f"box of segment {segment}: {sides}"
    return Proposal({"tube.cross_section": given}, after, text, brief)


def _rotation_tolerances(question: Question) -> Iterator[Change]:
    assert question.fields.tube is not None
    given = question.fields.tube.rotation_tolerance
    if given is None:
        return
    count = question.segment_count
    # Three numbers are an angle each for three segments, else bounds that serve for all.
    if not isinstance(given, list):
        bounds: list[Any] = [given] * count
    elif len(given) == 3 and count != 3 and not isinstance(given[0], tuple):
        bounds = [given] * count
    else:
        bounds = list(given)
    for segment, bound in enumerate(bounds):
        finite = [b for b in np.atleast_1d(bound).tolist() if np.isfinite(b)]
        if finite:
            before = min(finite)
            yield Change(
                kind="rotation_tolerance",
                field=f"tube.rotation_tolerance.{segment}",
                before=before,
                unit="rad",
                scale=max(before, 0.01),
                most=3.0,
                propose=partial(_rotation, bounds, segment, before),
                about=frozenset({f"segment {segment}"}),
            )


def _rotation(bounds: Sequence[Any], segment: int, before: float, size: float) -> Proposal:
    """Return bounds of which those of a segment that bound more than others are wider."""
    after = exact(before + size)
    wider = np.maximum(np.array(bounds[segment], dtype=float), after).tolist()
    given = [
        wider if k == segment else np.array(each, dtype=float).tolist()
        for k, each in enumerate(bounds)
    ]
    text = f"rotation tolerance of segment {segment}: {from_to(before, after, 'rad')}"
    return Proposal({"tube.rotation_tolerance": given}, after, text, figures(after, "rad"))


def _tool_radius(question: Question) -> Iterator[Change]:
    assert question.fields.tube is not None
    before = question.fields.tube.tool_radius
    if before > 0:

        def smaller(size: float) -> Proposal:
            after = max(exact(before - size), 0.0)  # sizes are rounded
            text = f"tool_radius {from_to(before, after, 'm')}"
            return Proposal({"tube.tool_radius": after}, after, text, figures(after, "m"))

        field = "tube.tool_radius"
        yield Change("radius", field, before, "m", before, before, smaller, is_loss=True)


def _points(question: Question) -> Iterator[Change]:
    """Yield the moves of each reference point: to the base, and along the axes."""
    if question.given_tube["points"] is None or isinstance(
        question.posed.document["tube"]["points"], str
    ):
        return
    base = question.robot.body_poses(np.zeros((1, question.robot.joint_count)))[1][0, 1]
    for k, point in enumerate(question.points):
        inwards = base - point
        ways = [("towards the arm's base", inwards / max(np.linalg.norm(inwards), 1e-9)), *AXES]
        for name, direction in ways:
            yield Change(
                kind="point",
                field=f"tube.points.{k}",
                before=point.tolist(),
                unit="m",
                scale=0.1,
                most=_FARTHEST,
                propose=partial(_moved_point, k, point, name, direction),
                about=frozenset({f"point {k}", f"segment {k - 1}", f"segment {k}"}),
            )


def _moved_point(k: int, point: FloatArray, name: str, way: FloatArray, size: float) -> Proposal:
    after = along(point, way, size)
    text = f"move reference point {k} by {figures(size, 'm')} {name}"
    return Proposal({f"tube.points.{k}": after}, after, text, figures(size, "m"))


def _signs(question: Question) -> Iterator[Change]:
    """Yield other signs of each joint that has one, in all segments."""
    assert question.fields.tube is not None
    given = question.fields.tube.joint_signs
    maps = [dict(signs) for signs in (given if isinstance(given, list) else [given])]
    for joint in dict.fromkeys(name for signs in maps for name in signs):
        before = next(signs[joint] for signs in maps if joint in signs)
        for sign in _NUMBERS:
            if before not in (sign, _NUMBERS[sign]):
                yield _sign_change(maps, isinstance(given, list), joint, before, sign)


def _sign_change(
    maps: Sequence[Mapping[str, Any]], is_list: bool, joint: str, before: Any, sign: str
) -> Change:
    others = [{**signs, joint: sign} if joint in signs else dict(signs) for signs in maps]
    changes = {"tube.joint_signs": others if is_list else others[0]}
    text = f"joint_signs: '{sign}' on {joint}"
    return Change(
        kind="sign",
        field=f"tube.joint_signs.{joint}",
        before=list(before) if isinstance(before, list | tuple) else before,
        unit="",
        scale=1.0,
        most=1.0,
        propose=lambda size: Proposal(changes, sign, text),
        about=frozenset({joint}),
        is_switch=True,
    )


def _pass_through(question: Question) -> Iterator[Change]:
    assert question.fields.tube is not None
    before = question.fields.tube.pass_through_points
    if before != "none" and question.segment_count > 1:
        path = "tube.pass_through_points"
        less = Proposal({path: "none"}, "none", f"pass_through_points: {before} -> none")
        yield Change("pass_through", path, before, "", 1.0, 1.0, lambda size: less, is_switch=True)


# ---- Changes of what stands around the arm: where obstacles are, and how near links may come.

_TENTH = 0.1  # [m]


def cell_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that keep obstacles out of the way."""
    yield from obstacle_changes(question)
    yield from _attached_changes(question)
    yield from clearance_changes(question, -1)


def obstacle_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each obstacle along the axes of the base frame."""
    for obstacle in question.fields.obstacles:
        about = frozenset({f"obstacle {obstacle.name}"})
        path = f"obstacles.{obstacle.name}.position"
        yield from _moves("obstacle", obstacle.name, path, obstacle.position, about)


def _attached_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each solid that the tool carries along the axes of its frame."""
    for solid in question.fields.robot.attached:
        about = frozenset({f"link {solid.name}"})
        path = f"robot.attached.{solid.name}.position"
        yield from _moves("attached", solid.name, path, solid.position, about)


def _moves(
    kind: str, solid: str, path: str, position: Sequence[float], about: frozenset[str]
) -> Iterator[Change]:
    for name, direction in AXES:
        yield Change(
            kind=kind,
            field=path,
            before=list(position),
            unit="m",
            scale=_TENTH,
            most=_FARTHEST,
            propose=partial(_moved, kind, solid, path, np.array(position), name, direction),
            about=about,
        )


def _moved(
    kind: str,
    solid: str,
    path: str,
    position: FloatArray,
    name: str,
    way: FloatArray,
    size: float,
) -> Proposal:
    after = along(position, way, size)
    frame = " of the tool frame" if kind == "attached" else ""
    what = "attached solid" if kind == "attached" else kind
    text = f"move {what} '{solid}' by {figures(size, 'm')} {name}{frame}"
    return Proposal({path: after}, after, text, figures(size, "m"))


def clearance_changes(question: Question, way: int) -> Iterator[Change]:
    """Yield the changes of each clearance, more or (-1) less."""
    for path, name, before, about in _clearances(question):
        if way > 0 or before > 0:
            yield Change(
                kind="clearance",
                field=path,
                before=before,
                unit="m",
                scale=before or _TENTH,
                most=_FARTHEST if way > 0 else before,
                propose=partial(_clearance, path, name, before, way),
                about=about,
                is_loss=way < 0,
            )


def _clearances(question: Question) -> Iterator[tuple[str, str, float, frozenset[str]]]:
    """Yield path, name and value of each clearance, and what it is about."""
    given = question.fields.clearance
    if not isinstance(given, ClearanceFields):
        yield "clearance", "clearance", given, frozenset()
        return
    yield "clearance.default", "clearance", given.default, frozenset()
    for k, pair in enumerate(given.pairs):
        about = frozenset(f"{kind} {name}" for kind in ("link", "obstacle") for name in pair.links)
        name = f"clearance of {pair.links[0]} and {pair.links[1]}"
        yield f"clearance.pairs.{k}.clearance", name, pair.clearance, about
    for k, value in enumerate(given.segments or []):
        if value is not None:
            about = frozenset({f"segment {k}"})
            yield f"clearance.segments.{k}", f"clearance of segment {k}", value, about


def _clearance(path: str, name: str, before: float, way: int, size: float) -> Proposal:
    after = max(exact(before + way * size), 0.0)  # sizes are rounded
    changes: Mapping[str, Any] = {path: after}
    text = f"{name} {from_to(before, after, 'm')}"
    return Proposal(changes, after, text, figures(after, "m"))
