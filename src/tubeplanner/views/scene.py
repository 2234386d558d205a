"""What there is to see: surfaces, colours, placements; no viewer.

Everything is in the base frame, in m and s. Several trajectories stand side by side, each with its
own arm and tube, and start together.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.views.executed_paths import ExecutedPaths
from tubeplanner.views.scene_frame import SceneFrame
from tubeplanner.views.stretch import Stretch
from tubeplanner.views.surface import Surface


class Layer(StrEnum):
    """What is shown or hidden together."""

    ARM = "arm"
    CARRIED = "carried"
    TUBE = "tube"
    REFERENCE = "reference"
    TOOL = "tool"
    AXES = "axes"
    ROTATION = "rotation"
    EXECUTED = "executed"
    OBSTACLES = "obstacles"
    SWEPT = "swept"
    BLOCKED = "blocked"


@dataclass(frozen=True, eq=False)
class Item:
    """A surface of one material.

    Attributes:
        layer: What it belongs to.
        trajectory: Index of the trajectory that it stands with.
        name: Unique among the items of a layer and trajectory.
        surface: In the frame of the body that carries it, else in the base frame.
        color: Red, green, blue from 0 to 1, shape (3,), or of every vertex, (V, 3).
        opacity: 1 is solid.
        body: The body that carries it; 0 stands still.
        is_smooth: Whether it is shaded as round where its triangles share vertices.
    """

    layer: Layer
    trajectory: int
    name: str
    surface: Surface
    color: FloatArray
    opacity: float = 1.0
    body: int = 0
    is_smooth: bool = True


@dataclass(frozen=True, eq=False)
class ShownTrajectory:
    """Where the bodies are at T times; one time stands for an arm at rest.

    Attributes:
        name: Its name.
        time: Shape (T,), from 0 to the duration [s].
        rotation: Of all bodies, shape (T, bodies, 3, 3).
        position: Of all bodies, shape (T, bodies, 3) [m].
        tool: Tool centre point, shape (T, 3) [m].
        speed: Of the tool, shape (T,) [m/s].
        present: Of bodies that come and go, when they are there, shape (T,).
    """

    name: str
    time: FloatArray
    rotation: FloatArray
    position: FloatArray
    tool: FloatArray
    speed: FloatArray
    present: Mapping[int, BoolArray] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Duration [s]; 0 at rest."""
        return float(self.time[-1])

    def placement(self, step: int, body: int) -> FloatArray:
        """Return where a body is at one of the times, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, :3] = self.rotation[step, body]
        placement[:3, 3] = self.position[step, body]
        return placement


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """All there is to see.

    Attributes:
        name: Of what is shown.
        trajectories: At least one; of no duration if no trajectory was given.
        items: Surfaces.
        frame: Where things stand and from where they are seen.
        thickness: Of drawn lines, their radius [m].
        notes: What else is worth knowing.
        stretches: Of each motion, under the problems that judge them; none of an arm at rest.
        executed: The tool's executed paths, beside the first trajectory; None: none were asked.
    """

    name: str
    trajectories: tuple[ShownTrajectory, ...]
    items: tuple[Item, ...]
    frame: SceneFrame
    thickness: float
    notes: tuple[str, ...]
    stretches: tuple[tuple[Stretch, ...], ...] = ()
    executed: ExecutedPaths | None = None

    @property
    def layers(self) -> list[Layer]:
        """The layers in which there is something, in the order of `Layer`."""
        found = {item.layer for item in self.items}
        if self.executed is not None:
            found.add(Layer.EXECUTED)
        return [layer for layer in Layer if layer in found]

    @property
    def peak_speed(self) -> float:
        """Highest speed of any tool [m/s]."""
        return max(float(trajectory.speed.max()) for trajectory in self.trajectories)

    @property
    def duration(self) -> float:
        """Of the longest trajectory [s]."""
        return max(trajectory.duration for trajectory in self.trajectories)
