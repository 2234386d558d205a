"""Changes of tube, obstacles and clearances."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.studies.changes import Change, Proposal, Question, exact, figures, from_to
from tubeplanner.task.endpoints import GoalRegion, Seed, ToolPose, configuration_of
from tubeplanner.task.problem_format import ClearanceFields
from tubeplanner.task.problem_reader import end_of

# ---- Directions of moves, in words and as unit vectors.

AXES: tuple[tuple[str, FloatArray], ...] = tuple(
    (f"in {sign}{axis}", factor * np.eye(3)[k])
    for k, axis in enumerate("xyz")
    for sign, factor in (("+", 1.0), ("-", -1.0))
)


def along(position: FloatArray, direction: FloatArray, size: float) -> list[float]:
    """Return a position (3,) moved along a unit vector by a size [m]."""
    return [exact(value) for value in (np.asarray(position) + size * direction).tolist()]


# ---- Changes of the tube: tolerances, reference points, joint signs, pass-through points.

_MAX_GROWTH = 10.0  # of a tolerance, relative
_MAX_MOVE = 1.0  # [m]
_NUMBERS = {"+": 1, "-": -1, "0": 0}  # both spellings of a sign; 0: free


def tube_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that widen the tube, or lead the tool elsewhere."""
    yield from radius_changes(question, 1)
    yield from _boxes(question)
    yield from _rotation_tolerances(question)
    assert question.fields.tube is not None
    tool_radius = question.fields.tube.tool_radius
    if tool_radius > 0:

        def smaller(size: float) -> Proposal:
            after = max(exact(tool_radius - size), 0.0)  # sizes are rounded
            text = f"tool_radius {from_to(tool_radius, after, 'm')}"
            return Proposal({"tube.tool_radius": after}, after, text, figures(after, "m"))

        sizes = (tool_radius, "m", tool_radius, tool_radius)
        yield Change("radius", "tube.tool_radius", *sizes, smaller, is_loss=True)
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

    def changed(segment: int, before: float, size: float) -> Proposal:
        after = exact(before + sign * size)
        radii_after = [after if k == segment else radius for k, radius in enumerate(radii)]
        text = f"segment {segment}: {from_to(before, after, 'm')}"
        return Proposal(_new_radii(question, radii_after), after, text, figures(after, "m"))

    for segment, radius in enumerate(radii):
        if radius is not None:
            yield Change(
                kind="radius",
                field=f"tube.radius.{segment}" if question.segment_count > 1 else "tube.radius",
                before=radius,
                unit="m",
                scale=radius,
                most=_MAX_GROWTH * radius if sign > 0 else 0.99 * radius,
                propose=partial(changed, segment, radius),
                about=frozenset({f"segment {segment}"}),
                is_loss=sign < 0,
            )

    def scaled(size: float) -> Proposal:
        factor = exact(1 + size)
        after = [None if radius is None else exact(factor * radius) for radius in radii]
        changes = _new_radii(question, after)
        brief = f"times {figures(factor)}"
        return Proposal(changes, changes["tube.radius"], f"all radii {brief}", brief)

    if sign > 0 and sum(radius is not None for radius in radii) > 1:
        before = _plain(question.spec.document["tube"].get("radius"))
        yield Change("radii", "tube.radius", before, "", 1.0, _MAX_GROWTH, scaled)


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
                most=_MAX_GROWTH * min(box["box"]),
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

    def wider(segment: int, before: float, size: float) -> Proposal:
        after = exact(before + size)
        bounds_after = [np.array(each, dtype=float) for each in bounds]
        bounds_after[segment] = np.maximum(bounds_after[segment], after)
        values = {"tube.rotation_tolerance": [each.tolist() for each in bounds_after]}
        text = f"rotation tolerance of segment {segment}: {from_to(before, after, 'rad')}"
        return Proposal(values, after, text, figures(after, "rad"))

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
                propose=partial(wider, segment, before),
                about=frozenset({f"segment {segment}"}),
            )


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
        moves = [*AXES, ("towards the arm's base", inwards / max(np.linalg.norm(inwards), 1e-9))]
        is_likely = len(run) <= min(2, last) and not question.has_point_file
        points = question.points[run].tolist()
        about = {f"{name} {k}" for k in run for name in ("point", "segment")}
        for name, direction in moves:
            yield Change(
                kind="point" if is_likely else "points",
                field=f"tube.points.{run[0]}" if len(run) == 1 else "tube.points",
                before=points[0] if len(run) == 1 else points,
                unit="m",
                scale=0.1,
                most=_MAX_MOVE,
                propose=partial(shifted, run, name, direction),
                about=frozenset({*about, f"segment {run[0] - 1}"}),
                is_move=True,
            )


def _moved_end(question: Question, end: str, direction: FloatArray, size: float) -> dict[str, Any]:
    """Return the values by field path of an end that moves with its point; joints become a seed."""
    fields = getattr(question.fields, end)
    try:
        value = end_of(end, fields, question.fields, question.robot, question.spec.folder)
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

_TENTH = 0.1  # [m]


def cell_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that move solids, or lower clearances."""
    yield from obstacle_changes(question)
    for solid in question.fields.robot.attached:  # along the axes of the tool frame
        about = frozenset({f"link {solid.name}"})
        path = f"robot.attached.{solid.name}.position"
        yield from _moves("attached", solid.name, path, solid.position, about)
    yield from clearance_changes(question, -1)


def obstacle_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each obstacle along the axes of the base frame."""
    for obstacle in question.fields.obstacles:
        about = frozenset({f"obstacle {obstacle.name}"})
        path = f"obstacles.{obstacle.name}.position"
        yield from _moves("obstacle", obstacle.name, path, obstacle.position, about)


def _moves(
    kind: str, solid: str, path: str, position: Sequence[float], about: frozenset[str]
) -> Iterator[Change]:
    frame = " of the tool frame" if kind == "attached" else ""
    noun = "attached solid" if kind == "attached" else kind

    def shifted(name: str, direction: FloatArray, size: float) -> Proposal:
        after = along(np.array(position), direction, size)
        text = f"move {noun} '{solid}' by {figures(size, 'm')} {name}{frame}"
        return Proposal({path: after}, after, text, figures(size, "m"))

    for name, direction in AXES:
        yield Change(
            kind=kind,
            field=path,
            before=list(position),
            unit="m",
            scale=_TENTH,
            most=_MAX_MOVE,
            propose=partial(shifted, name, direction),
            about=about,
            is_move=True,
            is_of_robot=kind == "attached",
        )


def clearance_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of each clearance, larger (sign 1) or smaller (-1)."""

    def changed(path: str, name: str, before: float, size: float) -> Proposal:
        after = max(exact(before + sign * size), 0.0)  # sizes are rounded
        text = f"{name} {from_to(before, after, 'm')}"
        return Proposal({path: after}, after, text, figures(after, "m"))

    for path, name, before, about in _clearances(question):
        if sign > 0 or before > 0:
            yield Change(
                kind="clearance",
                field=path,
                before=before,
                unit="m",
                scale=before or _TENTH,
                most=_MAX_MOVE if sign > 0 else before,
                propose=partial(changed, path, name, before),
                about=about,
                is_loss=sign < 0,
            )


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
