"""Views as page files, in a browser or a notebook: a scene, its panel, meshcat's viewer.

meshcat's commands are recorded instead of sent, and packed into the page together with its viewer.
"""

import base64
import gzip
import html
import json
import re
import tempfile
import webbrowser
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.verification import Certificate, CycleCertificate
from tubeplanner.errors import OptionError, OutputError, TrajectoryError
from tubeplanner.execution.simulation import Execution
from tubeplanner.output.drawing import EXECUTED_COLOR, WARNING_COLOR, rgb
from tubeplanner.output.page.motion_scene import build_scene
from tubeplanner.output.page.panel import panel_data, with_verdict
from tubeplanner.output.page.scene import Item, Layer, Scene
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion, Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import LimitCost, short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.writing import signals_held, write_files

# ---- The page as one file: parts of the folder `assets`, meshcat's viewer, panel and scene.

_FOLDER = Path(__file__).with_name("assets")
# In the order of their dependences.
_SCRIPTS = (
    *("elements", "legend", "findings", "camera", "views", "overlay", "depth", "ghosts", "names"),
    *("closest", "hover", "record", "timeline", "curves", "time", "start"),
)


def page_html(title: str, panel: Mapping[str, Any], commands: Iterable[Mapping[str, Any]]) -> str:
    """Return a page that needs no network: its panel, and the meshcat commands of its scene."""
    import meshcat
    import umsgpack

    records = [umsgpack.packb(command, force_float_precision="single") for command in commands]
    packed = b"".join(len(each).to_bytes(4, "little") + each for each in records)
    engine = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    licence = engine.with_name("main.min.js.LICENSE.txt")
    parts = {
        "title": html.escape(title),
        "style": _part("page.css"),
        "licence": licence.read_text(encoding="utf-8").replace("<", "&lt;"),
        "data": json.dumps(panel, allow_nan=False).replace("<", "\\u003c"),
        "scene": base64.b64encode(gzip.compress(packed, mtime=0)).decode(),
        "engine": engine.read_text(encoding="utf-8").replace("</script", "<\\/script"),
        "program": "\n".join(_part(f"{name}.js") for name in _SCRIPTS),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], _part("page.html"))


def _part(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


# ---- Views of a problem or a cycle.

_FRAME_HEIGHT = 560  # of the frame in a notebook [px]
# Translucent items are drawn after solid ones, in this order.
# The paths come after the tube, so that it does not tint their colours.
_RENDER_ORDER = {
    Layer.OBSTACLES: 1,
    Layer.TUBE: 2,
    Layer.REFERENCE: 3,
    Layer.TOOL: 4,
    Layer.EXECUTED: 5,
    Layer.CARRIED: 6,
    Layer.ROTATION: 7,
    Layer.HOLDING: 8,
    Layer.SWEPT: 9,
    Layer.BLOCKED: 10,
}
_FLOOR_COLOR = 0xC3CAD4
_LIGHT_DISTANCE = 50.0  # [m]
_FRONT_SIDE, _BOTH_SIDES = 0, 2
_IDENTIFIERS = ("uuid", "geometry", "material")  # keys, of an object or of a part


@dataclass(frozen=True, eq=False)
class View:
    """A view of a problem, or a cycle, and its trajectories; notebooks display it.

    Attributes:
        scene: The scene.
        panel: Content of the panel, as JSON values.
    """

    scene: Scene
    panel: Mapping[str, Any]

    __repr__ = short_repr

    @cached_property
    def html(self) -> str:
        """Complete page, which can be mailed and opened without a network."""
        return page_html(self.scene.name, self.panel, recorded_commands(self.scene))

    def save(self, path: str | Path) -> None:
        """Write the page to a file, whole or not at all.

        Raises:
            OutputError: The file could not be written.
        """
        write_files({Path(path): self.html.encode()})

    def open(self) -> tuple[Path, bool]:
        """Show the page in a browser.

        Returns:
            The temporary file of the page, and True if a browser was found.

        Raises:
            OutputError: The file could not be written.
        """
        page = re.sub(r"[^\w.-]+", "_", self.scene.name)
        path = _temporary_page(f"{page}.html", self.html)
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
    execution: Execution | None = None,
    notes: Sequence[str] = (),
    empty_handed: Collection[str] = (),
    certificates: Sequence[Certificate] = (),
    sensitivities: Sequence[LimitCost] = (),
) -> View:
    """Return a view of a problem with trajectories side by side; without any, at its start.

    With an execution, also the paths of the tool, in another colour outside the tube.

    Args:
        problem: The planning problem.
        trajectories: Of the problem's joints, in any order.
        names: Names of the trajectories; default: numbers.
        execution: Of the one trajectory.
        notes: Shown on the page before its own notes.
        empty_handed: Names of trajectories that are drawn without the problem's carried solids.
        certificates: Of the trajectories; none: the page has no verdict.
        sensitivities: Costs of limits, the largest first.

    Raises:
        OptionError: The numbers of names and trajectories differ, or two names are equal; or there
            is an execution, and not one trajectory.
        TrajectoryError: A trajectory moves other joints than the problem's; the message names it.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    if names is None:
        many = len(trajectories) > 1
        names = [f"trajectory {i + 1}" if many else "trajectory" for i in range(len(trajectories))]
    require_names(names, len(trajectories))
    motions = {}
    for name, trajectory in zip(names, trajectories, strict=True):
        try:
            motions[name] = ProblemMotion(problem, trajectory)
        except TrajectoryError as error:
            raise TrajectoryError(f"{name}: {error}") from error
    return view_motions(
        problem,
        motions,
        execution,
        notes=notes,
        empty_handed=empty_handed,
        certificates=certificates,
        sensitivities=sensitivities,
    )


def view_cycle(
    cycle: Cycle,
    motions: Sequence[CycleMotion] = (),
    names: Sequence[str] | None = None,
    notes: Sequence[str] = (),
    execution: Execution | None = None,
    certificates: Sequence[CycleCertificate] = (),
    sensitivities: Sequence[LimitCost] = (),
) -> View:
    """Return a view of a cycle with motions side by side; without any, at its start.

    With an execution, also the paths of the tool, in another colour outside the tube of the move.

    Args:
        cycle: The cycle.
        motions: Of the cycle.
        names: Names of the motions; default: numbers.
        notes: Shown on the page before its own notes.
        execution: Of the one motion.
        certificates: Of the motions; none: the page has no verdict.
        sensitivities: Costs of limits, the largest first.

    Raises:
        ProblemError: `cycle` is no Cycle.
        OptionError: The numbers of names and motions differ, or two names are equal; or there is
            an execution, and not one motion.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    Cycle.require(cycle)
    if names is None:
        names = [f"motion {i + 1}" for i in range(len(motions))]
    require_names(names, len(motions))
    return view_motions(
        cycle,
        dict(zip(names, motions, strict=True)),
        execution,
        notes=notes,
        certificates=certificates,
        sensitivities=sensitivities,
    )


def view_motions(
    task: Task,
    motions: Mapping[str, Motion],
    execution: Execution | None = None,
    *,
    notes: Sequence[str] = (),
    empty_handed: Collection[str] = (),
    certificates: Sequence[Certificate | CycleCertificate] = (),
    sensitivities: Sequence[LimitCost] = (),
) -> View:
    """Return a view of motions by name, as `view` or `view_cycle`."""
    if execution is not None and len(motions) != 1:
        noun = "motion" if isinstance(task, Cycle) else "trajectory"
        raise OptionError(f"execution goes with one {noun}, not {len(motions)}; give one")
    scene = build_scene(task, motions, execution, notes=notes, empty_handed=empty_handed)
    trajectories = [motion.trajectory for motion in motions.values()]
    panel = panel_data(scene)
    return View(scene, with_verdict(panel, task, trajectories, certificates, sensitivities))


def require_names(names: Sequence[str], count: int) -> None:
    """Raise OptionError unless there are as many names as trajectories, all different."""
    if len(names) != count or len(set(names)) != len(names):
        raise OptionError(
            f"names {list(names)}: one each, all different, is needed for {count} trajectories"
        )


def names_of_files(paths: Sequence[Path]) -> list[str]:
    """Return names for trajectories from files: file names, or numbered paths if two are equal."""
    names = [path.name for path in paths]
    if len(set(names)) == len(names):
        return names
    return [f"{i + 1}: {path}" for i, path in enumerate(paths)]


def _temporary_page(name: str, page: str) -> Path:
    """Write a page into a temporary folder of its own, where a browser may read the page later.

    Raises:
        OutputError: The folder or the page could not be written; neither is left behind.
    """
    with signals_held():
        try:
            folder = Path(tempfile.mkdtemp(prefix="tubeplanner-"))
        except OSError as error:
            raise OutputError(
                f"no temporary folder could be made for {name}: {error.strerror}; name a file "
                "for the page"
            ) from error
        try:
            write_files({folder / name: page.encode()})
        except OutputError:
            folder.rmdir()
            raise
    return folder / name


class _Recorder:
    """Window of meshcat that records commands instead of sending them to a server.

    meshcat identifies objects by time and machine; here they are numbered, so that equal scenes
    give equal pages.
    """

    def __init__(self) -> None:
        self.commands: list[dict[str, Any]] = []
        self._identifiers: dict[str, str] = {}

    def send(self, command: Any) -> None:
        lowered = command.lower()
        if "property" in lowered:  # meshcat writes names in small letters, which three.js ignores
            lowered["property"] = command.key
        self.commands.append(self._numbered(lowered))

    def _numbered(self, value: Any, key: str | None = None) -> Any:
        if isinstance(value, dict):
            return {name: self._numbered(inner, name) for name, inner in value.items()}
        if isinstance(value, list):
            return [self._numbered(inner) for inner in value]
        if key in _IDENTIFIERS and isinstance(value, str):
            return self._identifiers.setdefault(value, str(UUID(int=len(self._identifiers))))
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
    _add_lines(root["floor"], scene.frame.floor, _FLOOR_COLOR)
    _add_lights(root, scene.frame.direction)
    for item in scene.items:
        _add_item(root, item)
    if scene.executed is not None:
        paths = scene.executed
        for name, ends, color in (
            ("inside", paths.inside, EXECUTED_COLOR),
            ("outside", paths.outside, WARNING_COLOR),
        ):
            if len(ends):
                node = root[f"{Layer.EXECUTED}/0/{name}"]
                _add_lines(node, ends, _as_number(rgb(color)), transparent=True)
                node["<object>"].set_property("renderOrder", _RENDER_ORDER[Layer.EXECUTED])
    for i in range(len(scene.trajectories)):
        placement = np.eye(4)
        placement[:3, 3] = i * scene.frame.offset
        for layer in scene.layers:
            root[f"{layer}/{i}"].set_transform(placement)
    _animate(root, scene)
    return recorder.commands


def _add_lines(node: Any, ends: FloatArray, color: int, **options: Any) -> None:
    """Add straight lines with ends of shape (E, 2, 3) [m]."""
    from meshcat import geometry

    points = geometry.PointsGeometry(ends.reshape(-1, 3).T.astype(np.float32))
    material = geometry.LineBasicMaterial(color=color, **options)
    node.set_object(geometry.LineSegments(points, material))


def _add_lights(root: Any, direction: FloatArray) -> None:
    """Light the scene from beside the viewer, and a little from the other side; not too bright."""
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
    lights["PointLightPositiveX/<object>"].set_property("distance", 0.0)  # without attenuation


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
        depthTest=item.layer is not Layer.HOLDING,  # seen through hand and part
        transparent=item.layer in _RENDER_ORDER,
    )
    node.set_object(shape, material)
    if item.layer in _RENDER_ORDER:
        node["<object>"].set_property("renderOrder", _RENDER_ORDER[item.layer])


def _as_number(color: FloatArray) -> int:
    red, green, blue = (round(255 * float(value)) for value in color)
    return (red << 16) + (green << 8) + blue


def _animate(root: Any, scene: Scene) -> None:
    """Place all bodies, and move the bodies of trajectories."""
    from meshcat.animation import Animation

    animation = Animation(default_framerate=1)  # frames are counted in seconds
    moving = sorted({(item.layer, item.trajectory, item.body) for item in scene.items if item.body})
    for layer, i, body in moving:
        path, trajectory = _body_path(layer, i, body), scene.trajectories[i]
        root[path].set_transform(trajectory.placement(0, body))
        present = trajectory.present.get(body)
        if present is not None:
            root[path].set_property("visible", bool(present[0]))
        for step, time in enumerate(trajectory.time):
            frame = animation.at_frame(root, float(time))[path]
            placement = trajectory.placement(step, body)
            stretch = np.linalg.norm(placement[:3, :3], axis=0)
            if layer is Layer.HOLDING:
                placement[:3, :3] /= stretch
                frame.set_property("scale", "vector3", stretch.tolist())
            frame.set_transform(placement)
            if present is not None:
                frame.set_property("visible", "boolean", bool(present[step]))
    if scene.duration > 0:
        root.set_animation(animation, play=False)
