"""The fields of a tool's pose in a problem file."""

from pydantic import Field

from tubeplanner.problem.field_types import Quaternion, Section, Vector


class PoseFields(Section):
    """A pose of the tool centre point; exactly one of rpy, quaternion."""

    position: Vector = Field(description="base frame [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")
