"""A scene as one HTML page that needs no network and no server. Only this module knows meshcat.

meshcat's commands are recorded instead of sent, and packed into the page together with its viewer.
"""

import base64
import gzip
import html
import json
import re
import tempfile
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.files.output_files import write_files
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.palette import OBSTACLE_COLOR, REFERENCE_COLOR, SPEED_COLORS, segment_color
from tubeplanner.views.panels import size_of
from tubeplanner.views.scene import CARRIED_COLOR, SWEPT_COLOR, Item, Layer, Scene, build_scene

_TEMPLATE = Path(__file__).with_name("view_page.html")
_FRAME_HEIGHT = 560  # of the frame in a notebook [px]
_MAX_SEGMENTS_NAMED = 6
# Translucent things are drawn after solid ones, in this order.
# The paths come after the tube, so that it does not tint their colours.
_RENDER_ORDER = {
    Layer.OBSTACLES: 1,
    Layer.TUBE: 2,
    Layer.REFERENCE: 3,
    Layer.TOOL: 4,
    Layer.CARRIED: 5,
    Layer.SWEPT: 7,
}
_FLOOR_COLOR = 0xC3CAD4
_LIGHT_DISTANCE = 50.0  # [m]
_FRONT_SIDE, _BOTH_SIDES = 0, 2
_IDENTIFIERS = ("uuid", "geometry", "material")  # of an object, or of what it refers to


@dataclass(frozen=True, eq=False)
class View:
    """A view of a problem and its trajectories; notebooks display it.

    Attributes:
        scene: What is shown.
    """

    scene: Scene

    @cached_property
    def html(self) -> str:
        """The complete page; it can be mailed and opened without a network."""
        return _page(self.scene)

    def save(self, path: str | Path) -> None:
        """Write the page to a file, whole or not at all.

        Raises:
            OutputError: The file could not be written.
        """
        write_files({Path(path): self.html.encode()})

    def open(self) -> tuple[Path, bool]:
        """Show the page in a browser.

        Returns:
            The temporary file it was written to, and whether a browser was found.

        Raises:
            OutputError: The file could not be written.
        """
        name = re.sub(r"[^\w.-]+", "_", self.scene.problem.name)
        path = Path(tempfile.mkdtemp(prefix="tubeplanner-")) / f"{name}.html"
        self.save(path)
        try:
            return path, webbrowser.open(path.as_uri())
        except webbrowser.Error:
            return path, False

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {_FRAME_HEIGHT}px; border: 1px solid #ccc"
        return f'<iframe srcdoc="{html.escape(self.html)}" style="{style}"></iframe>'


def view(
    problem: PlanningProblem,
    *trajectories: JointTrajectory,
    names: Sequence[str] | None = None,
) -> View:
    """Return a view of a problem with trajectories side by side; without any, at its start.

    Args:
        problem: The planning problem.
        trajectories: Of the problem's joints, in any order.
        names: Names of the trajectories; default: numbers.

    Raises:
        OptionError: There are not as many names as trajectories, or two are the same.
        TrajectoryError: A trajectory moves other joints than the problem's; it is named.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    if names is None:
        many = len(trajectories) > 1
        names = [f"trajectory {i + 1}" if many else "trajectory" for i in range(len(trajectories))]
    if len(names) != len(trajectories) or len(set(names)) != len(names):
        raise OptionError(
            f"names {list(names)}: one each, all different, is needed for {len(trajectories)} "
            "trajectories"
        )
    return View(build_scene(problem, dict(zip(names, trajectories, strict=True))))


def names_of_files(paths: Sequence[Path]) -> list[str]:
    """Return names for trajectories from files: the files', whole paths where these meet."""
    names = [path.name for path in paths]
    if len(set(names)) == len(names):
        return names
    return [f"{i + 1}: {path}" for i, path in enumerate(paths)]


class _Recorder:
    """Takes the place of meshcat's window: keeps what would be sent to a server.

    meshcat identifies objects by time and machine; here they are counted, so that the same scene
    gives the same page.
    """

    def __init__(self) -> None:
        self.commands: list[dict[str, Any]] = []
        self._counted: dict[str, str] = {}

    def send(self, command: Any) -> None:
        self.commands.append(self._with_counted(command.lower()))

    def _with_counted(self, value: Any, key: str | None = None) -> Any:
        if isinstance(value, dict):
            return {name: self._with_counted(inner, name) for name, inner in value.items()}
        if isinstance(value, list):
            return [self._with_counted(inner) for inner in value]
        if key in _IDENTIFIERS and isinstance(value, str):
            return self._counted.setdefault(value, str(UUID(int=len(self._counted))))
        return value


def recorded_commands(scene: Scene) -> list[dict[str, Any]]:
    """Return the meshcat commands that build a scene, in order."""
    import meshcat

    recorder = _Recorder()
    root = meshcat.Visualizer(window=recorder)
    root["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    root["/Background"].set_property("bottom_color", [0.87, 0.90, 0.94])
    root["/Axes"].set_property("visible", False)
    root["/Grid"].set_property("visible", False)
    _add_floor(root, scene)
    _add_lights(root, scene.direction)
    for item in scene.items:
        _add_item(root, item)
    for i in range(len(scene.trajectories)):
        placement = np.eye(4)
        placement[:3, 3] = i * scene.offset
        for layer in _layers(scene):
            root[f"{layer}/{i}"].set_transform(placement)
    _animate(root, scene)
    return recorder.commands


def _add_floor(root: Any, scene: Scene) -> None:
    from meshcat import geometry

    ends = scene.floor.reshape(-1, 3).T.astype(np.float32)
    material = geometry.LineBasicMaterial(color=_FLOOR_COLOR)
    root["floor"].set_object(geometry.LineSegments(geometry.PointsGeometry(ends), material))


def _add_lights(root: Any, direction: FloatArray) -> None:
    """Light the scene from beside the eye, and a little from the other side; nothing too bright."""
    lights = root["/Lights"]
    lights["AmbientLight/<object>"].set_property("intensity", 0.52)
    lights["PointLightNegativeX"].set_property("visible", False)
    aside = np.cross([0.0, 0.0, 1.0], direction)
    sources = (
        ("FillLight", direction - 0.6 * aside + [0.0, 0.0, 0.6], 0.42),
        ("PointLightPositiveX", 0.2 * direction + aside - [0.0, 0.0, 0.2], 0.16),
    )
    for name, towards, intensity in sources:
        light = lights[f"{name}/<object>"]
        light.set_property("position", (_LIGHT_DISTANCE * towards).tolist())
        light.set_property("intensity", intensity)
    lights["PointLightPositiveX/<object>"].set_property("distance", 0.0)  # however far it is


def _layers(scene: Scene) -> list[Layer]:
    found = {item.layer for item in scene.items}
    return [layer for layer in Layer if layer in found]


def _body_path(layer: Layer, trajectory: int, body: int) -> str:
    return f"{layer}/{trajectory}/body_{body}"


def _add_item(root: Any, item: Item) -> None:
    from meshcat import geometry

    surface = item.surface
    by_vertex = item.color.ndim == 2
    colors = item.color if by_vertex else None
    node = root[f"{_body_path(item.layer, item.trajectory, item.body)}/{item.name}"]
    shape = geometry.TriangularMeshGeometry(
        surface.vertices.astype(np.float32), surface.faces.astype(np.uint32), color=colors
    )
    solid = item.opacity == 1
    material = geometry.MeshLambertMaterial(
        color=0xFFFFFF if by_vertex else _as_number(item.color),
        vertexColors=by_vertex,
        opacity=item.opacity,
        side=_BOTH_SIDES if solid else _FRONT_SIDE,
        flatShading=not item.is_smooth,
        depthWrite=solid,
        transparent=item.layer in _RENDER_ORDER,
    )
    if item.layer is Layer.SWEPT:
        # Its front alone is wanted: first its depth is drawn, then what is at that depth.
        depth = geometry.MeshLambertMaterial(transparent=True, colorWrite=False, side=_FRONT_SIDE)
        node["depth"].set_object(shape, depth)
        node["depth/<object>"].set_property("renderOrder", _RENDER_ORDER[item.layer] - 1)
    node.set_object(shape, material)
    if item.layer in _RENDER_ORDER:
        node["<object>"].set_property("renderOrder", _RENDER_ORDER[item.layer])


def _as_number(color: FloatArray) -> int:
    red, green, blue = (round(255 * float(value)) for value in color)
    return (red << 16) + (green << 8) + blue


def _animate(root: Any, scene: Scene) -> None:
    """Place all bodies, and let them move if there is a trajectory."""
    from meshcat.animation import Animation

    animation = Animation(default_framerate=1)  # frames are counted in seconds
    carried = sorted(
        {(item.layer, item.trajectory, item.body) for item in scene.items if item.body}
    )
    for layer, i, body in carried:
        path, trajectory = _body_path(layer, i, body), scene.trajectories[i]
        root[path].set_transform(trajectory.placement(0, body))
        for step, time in enumerate(trajectory.time):
            frame = animation.at_frame(root, float(time))
            frame[path].set_transform(trajectory.placement(step, body))
    if scene.duration > 0:
        root.set_animation(animation, play=False)


def _page(scene: Scene) -> str:
    """Return the page: template, viewer, commands and what the panel says."""
    import meshcat
    import umsgpack

    commands = b"".join(
        len(packed).to_bytes(4, "little") + packed
        for packed in (umsgpack.packb(command) for command in recorded_commands(scene))
    )
    engine = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    licence = engine.with_name("main.min.js.LICENSE.txt")
    parts = {
        "title": html.escape(scene.problem.name),
        "licence": licence.read_text(encoding="utf-8").replace("<", "&lt;"),
        "data": json.dumps(panel_data(scene), allow_nan=False).replace("<", "\\u003c"),
        "scene": base64.b64encode(gzip.compress(commands, mtime=0)).decode(),
        "engine": engine.read_text(encoding="utf-8").replace("</script", "<\\/script"),
    }
    template = _TEMPLATE.read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], template)


def panel_data(scene: Scene) -> dict[str, Any]:
    """Return the text of the page's overlay and how it frames the scene, as JSON values."""
    problem, many = scene.problem, len(scene.trajectories) > 1
    trajectories = [
        {
            "name": trajectory.name,
            "lasts": f"{1000 * trajectory.duration:.0f} ms",
            "top": f"{trajectory.speed.max():.2f} m/s",
            "duration": trajectory.duration,
            "speed": [round(float(speed), 4) for speed in trajectory.speed],
        }
        for trajectory in scene.trajectories
    ]
    labels = [
        {
            "text": f"{trajectory['name']}: {trajectory['lasts']}",
            "point": (scene.top + i * scene.offset).tolist(),
        }
        for i, trajectory in enumerate(trajectories)
    ]
    moving = "" if scene.duration > 0 else "The arm at its start; no trajectory is shown. "
    return {
        "title": problem.name,
        "robot": f"{problem.robot.name}, {problem.robot.joint_count} joints",
        "hint": f"{moving}Grid: {scene.floor_step:g} m. Drag to turn, scroll to zoom, right button "
        "to shift.",
        "duration": scene.duration,
        "trajectories": trajectories,
        "labels": labels if many else None,
        "layers": [_layer_data(layer, scene) for layer in _layers(scene)],
        "notes": list(scene.notes),
        "direction": scene.direction.tolist(),
        "outline": scene.outline.round(5).tolist(),
    }


def _layer_data(layer: Layer, scene: Scene) -> dict[str, Any]:
    """Return a layer's name, label, colours and whether it is shown at first."""
    problem = scene.problem
    words = {
        Layer.ARM: "Arm",
        Layer.CARRIED: _listed("Carried", [solid.name for solid in problem.attached]),
        Layer.TUBE: "Tube: the tool must stay inside",
        Layer.REFERENCE: "Reference path",
        Layer.TOOL: "Path of the tool, by its speed" if scene.duration > 0 else "Tool",
        Layer.OBSTACLES: _listed("Obstacles", [obstacle.name for obstacle in problem.obstacles]),
        Layer.SWEPT: "Space the links sweep (hulls)",
    }
    plain = {
        Layer.CARRIED: CARRIED_COLOR,
        Layer.OBSTACLES: OBSTACLE_COLOR,
        Layer.SWEPT: SWEPT_COLOR,
    }
    entries = [{"color": plain[layer], "text": ""}] if layer in plain else []
    fields: dict[str, Any] = {
        "name": str(layer),
        "label": words[layer],
        "entries": _segment_entries(problem) if layer is Layer.TUBE else entries,
        "visible": layer is not Layer.SWEPT,
    }
    if layer is Layer.REFERENCE:
        fields["dashed"] = REFERENCE_COLOR
    if layer is Layer.TOOL and scene.duration > 0:
        top = scene.peak_speed
        ticks = ["0", f"{top / 2:.2f}", f"{top:.2f} m/s"]
        fields["scale"] = {"colors": list(SPEED_COLORS), "ticks": ticks}
    return fields


def _listed(kind: str, names: Sequence[str]) -> str:
    return f"{kind}: {', '.join(names)}"


def _segment_entries(problem: PlanningProblem) -> list[dict[str, str]]:
    """Return colours and sizes of the tube's segments, the first few of many."""
    tube = problem.tube
    radii = 1000 * tube.effective_radius
    kinds = ["box" if is_box else "radius" for is_box in tube.is_box]
    named = range(min(len(radii), _MAX_SEGMENTS_NAMED))
    entries = [
        {"color": segment_color(k), "text": f"segment {k}: {kinds[k]} {size_of(tube, k)}"}
        for k in named
    ]
    if len(radii) > len(named):
        low, high = radii.min(), radii.max()
        text = f"and so on: {len(radii)} segments, {low:.3g} to {high:.3g} mm"
        text += " (of boxes, half the smaller side)" * bool(tube.is_box.any())
        entries.append({"color": "", "text": text})
    return entries
