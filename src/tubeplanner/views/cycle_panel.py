"""What the panel of a cycle's page says: its moves with their colours, parts, the time line."""

from typing import Any

from tubeplanner.cycle.steps import Attach, Move
from tubeplanner.tube.tube import Tube
from tubeplanner.views.cycle_scene import CycleScene
from tubeplanner.views.cycle_timeline import cycle_timeline
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.page_panel import arm_words, layer_data, listed, page_data
from tubeplanner.views.palette import segment_color
from tubeplanner.views.problem_timeline import binding_marks
from tubeplanner.views.scene import Layer


def cycle_panel_data(scene: CycleScene) -> dict[str, Any]:
    """Return the text of a cycle's page and how it frames the scene, as JSON values."""
    cycle, moves = scene.cycle, _moves(scene)
    handed_over = dict.fromkeys(step.name for step in cycle.steps if isinstance(step, Attach))
    standing = [each.name for each in cycle.obstacles if each.name not in handed_over]
    balls = any(goal_ball(move.goal) for move in moves)
    words = {
        Layer.CARRIED: listed("Carried", [*(each.name for each in cycle.attached), *handed_over]),
        Layer.TUBE: "Tubes of the moves (radius): the tool must stay inside",
        Layer.REFERENCE: "Reference paths" + ", goals' balls" * balls,
        Layer.OBSTACLES: listed("Obstacles", standing),
    }
    entries = {Layer.TUBE: _move_entries(scene)}
    layers = [layer_data(layer, scene, words, entries) for layer in scene.layers]
    kind = "closed cycle" if cycle.closed else "cycle"
    about = f"{arm_words(cycle.robot)}; {kind} of {len(moves)} move{'s' * (len(moves) > 1)}"
    timelines = [
        {**cycle_timeline(motion).as_dict(scene.duration), "binds": binding_marks(stretches)}
        for motion, stretches in zip(scene.motions, scene.stretches, strict=True)
    ]
    return {**page_data(scene, about, layers), "timelines": timelines}


def _moves(scene: CycleScene) -> list[Move]:
    return [move for leg in scene.cycle.legs for move in leg.moves]


def _move_entries(scene: CycleScene) -> list[dict[str, str]]:
    """Return colour, name and tube of every move, and how long it takes in the only motion."""
    times = scene.motions[0].move_times if len(scene.motions) == 1 else {}
    entries = []
    for k, move in enumerate(_moves(scene)):
        begin, end = times.get(move.name, (0.0, 0.0))
        lasts = f", {1000 * (end - begin):.0f} ms" if move.name in times else ""
        text = f"{move.name}: {_sizes(move.tube)}{lasts}"
        entries.append({"color": segment_color(k), "text": text})
    return entries


def _sizes(tube: Tube) -> str:
    """Return the radii of a tube's segments, of boxes half the smaller side."""
    radii = 1000 * tube.effective_radius
    low, high = f"{radii.min():.3g}", f"{radii.max():.3g}"
    return f"{low} mm" if low == high else f"{low} to {high} mm"
