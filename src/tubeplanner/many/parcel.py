"""A problem packed for another process, and what comes back, without what they share.

Most of a pickled problem is its robot and its collision geometry, which many problems have in
common. They travel as a part of their own, which a process that has it does not unpack again; an
answer refers to them, and gets those of the sender.
"""

import hashlib
import io
import pickle
from dataclasses import dataclass
from typing import Any

from tubeplanner.collision.collision_scene import CollisionScene
from tubeplanner.problem.problem import PlanningProblem

_ROBOT, _SCENE = "robot", "scene"
_KEPT = 16
_known: dict[str, CollisionScene] = {}  # by hash, those that came in parcels


@dataclass(frozen=True)
class Parcel:
    """A problem, packed.

    Attributes:
        content: The problem, pickled; it refers to robot and scene.
        scene: Both, pickled.
        scene_hash: Of that.
    """

    content: bytes
    scene: bytes
    scene_hash: str

    def unpacked(self) -> PlanningProblem:
        """Return the problem; robot and scene are those of the same hash, if they came before."""
        scene = _known.pop(self.scene_hash, None) or pickle.loads(self.scene)
        _known[self.scene_hash] = scene
        for oldest in list(_known)[:-_KEPT]:
            _known.pop(oldest, None)
        problem: PlanningProblem = _read(self.content, scene)
        return problem


class Packer:
    """Packs problems; remembers the scenes it packed."""

    def __init__(self) -> None:
        self._packed: dict[int, tuple[CollisionScene, bytes, str]] = {}

    def pack(self, problem: PlanningProblem) -> Parcel:
        """Return a problem, packed."""
        scene = problem.scene
        known = self._packed.get(id(scene))
        if known is None:
            pickled = pickle.dumps(scene)
            known = scene, pickled, hashlib.sha256(pickled).hexdigest()
            self._packed[id(scene)] = known  # holds it, so that its id stays its own
        return Parcel(_pickled(problem, scene), *known[1:])


def reply(answer: Any, problem: PlanningProblem) -> bytes:
    """Return an answer about a problem that came in a parcel, packed."""
    return _pickled(answer, problem.scene)


def read_reply(packed: bytes, problem: PlanningProblem) -> Any:
    """Return the answer about a problem, as it was packed by `reply`."""
    return _read(packed, problem.scene)


def _pickled(thing: Any, scene: CollisionScene) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream, scene).dump(thing)
    return stream.getvalue()


def _read(pickled: bytes, scene: CollisionScene) -> Any:
    return _Unpickler(io.BytesIO(pickled), scene).load()


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, scene: CollisionScene) -> None:
        super().__init__(stream)
        self._scene = scene

    def persistent_id(self, thing: Any) -> str | None:
        if thing is self._scene:
            return _SCENE
        return _ROBOT if thing is self._scene.robot else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, scene: CollisionScene) -> None:
        super().__init__(stream)
        self._scene = scene

    def persistent_load(self, name: str) -> Any:
        return {_SCENE: self._scene, _ROBOT: self._scene.robot}[name]
