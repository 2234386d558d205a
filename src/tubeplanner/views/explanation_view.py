"""The page of an explanation: what blocks and where, and what helps; or how much room there is."""

from dataclasses import replace
from typing import Any

from tubeplanner.errors import OptionError
from tubeplanner.explanation.explanation import Explanation
from tubeplanner.explanation.in_vain_text import in_vain_text
from tubeplanner.explanation.remedy import Remedy, Room
from tubeplanner.explanation.setting_text import setting_text, tried_text
from tubeplanner.views.blocked_arm import blocked_arm, contact_point
from tubeplanner.views.blocked_items import with_blocked
from tubeplanner.views.page_panel import panel_data
from tubeplanner.views.problem_scene import build_scene
from tubeplanner.views.viewer import View


def view_explanation(found: Explanation) -> View:
    """Return the view of what was found out about a problem.

    Without an answer the arm is where it is blocked, what blocks has a colour of its own, and the
    place is marked; with one, it follows the motion.

    Args:
        found: What was found out.

    Raises:
        OptionError: The problem cannot be posed, as its tube cannot be drawn.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    problem, result = found.drawn, found.result
    if problem is None:
        raise OptionError(
            f"{found.name} cannot be drawn, as its tube contradicts itself; apply a change that "
            "helps and explain it again"
        )
    motion = None if result is None else result.trajectory
    named = {} if motion is None else {"shortest motion": motion}
    scene = build_scene(problem, named, at_rest=blocked_arm(problem, found))
    contact = contact_point(problem, found.place, found.configuration)
    items = with_blocked(scene.items, problem, found.place, contact, scene.thickness)
    scene = replace(scene, items=items)
    return View(scene, {**panel_data(scene), "findings": _findings(found)})


def _findings(found: Explanation) -> dict[str, Any]:
    """Return what the panel says, as JSON values."""
    if found.is_possible:
        title, lines = "How much worse one of these may become", list(map(_room, found.rooms))
    elif found.remedies:
        title, lines = "Any one of these makes it possible", list(map(_remedy, found.remedies))
    else:
        title, lines = "No single change was found that makes it possible", []
    return {
        "reason": f"{found.status}: {found.message}",
        "title": title,
        "lines": lines,
        "more": list(_more(found)),
    }


def _more(found: Explanation) -> list[str]:
    """Return what is said below: what limits the motion, what helps nothing, what ended it."""
    lines = []
    if found.is_possible and found.result is not None:
        dearest = [f"{each}" for each in found.result.sensitivities if each.saved > 0]
        if dearest:
            lines.append(f"What limits it most; 10 % more would save: {dearest[0]}")
    if found.in_vain:
        lines.append(f"By itself none of these helps: {in_vain_text(found.in_vain)}")
    if found.stopped_by is not None:
        lines.append("The search was ended early: there may be more")
    return lines


def _remedy(remedy: Remedy) -> dict[str, Any]:
    details = [
        f"certified motion of {remedy.duration:.3f} s",
        *([f"{remedy.cost:.2g} times its scale: 0.1 m, 0.1 rad or the value"] * bool(remedy.unit)),
        *_not_enough("not enough", tried_text(remedy.too_little_text, remedy.is_smallest)),
    ]
    return {"text": remedy.text, "details": details, "setting": setting_text(remedy.changes)}


def _room(room: Room) -> dict[str, Any]:
    duration = [] if room.duration is None else [f"certified motion of {room.duration:.3f} s"]
    beyond = tried_text(room.too_much_text, room.is_exact)
    details = [*duration, room.field, *_not_enough("nothing found with", beyond)]
    return {"text": room.text, "details": details, "setting": ""}


def _not_enough(word: str, value: str) -> list[str]:
    return [f"{word}: {value}"] if value else []
