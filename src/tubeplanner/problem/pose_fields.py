"""The fields of poses in a problem file."""

from pydantic import Field

from tubeplanner.problem.field_types import Quaternion, Section, Vector


class PoseFields(Section):
    """A pose of the tool centre point; exactly one of rpy, quaternion."""

    position: Vector = Field(description="base frame [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")


class ToolOffsetFields(Section):
    """The tool centre point in the tool frame."""

    position: Vector = Field((0.0, 0.0, 0.0), description="where it is in tool_frame [m]")
    rpy: Vector = Field((0.0, 0.0, 0.0), description="fixed x, y, z as in URDF [rad]")


class BaseFields(Section):
    """The pose of the root link in the cell; at most one of rpy, quaternion."""

    position: Vector = Field((0.0, 0.0, 0.0), description="of its origin [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")
