"""Solids of a file: their sizes, the scale of a mesh, and what a carried one touches."""

import numpy as np
import pytest
import trimesh

from tubeplanner.problem.problem_format import AttachedFields, ObstacleFields
from tubeplanner.problem.solid_fields import attached_of, obstacle_of


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_mesh_is_scaled_about_its_own_origin(tmp_path, scale):
    trimesh.creation.box((0.2, 0.4, 0.6)).export(tmp_path / "brick.stl")
    fields = ObstacleFields(name="brick", mesh="brick.stl", scale=scale, position=(1.0, 0.0, 0.0))
    (shape,) = obstacle_of(fields, tmp_path, ()).shapes
    sides = scale * np.array([0.2, 0.4, 0.6])
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), sides, atol=1e-6)
    np.testing.assert_allclose(shape.vertices.mean(axis=0), [1, 0, 0], atol=1e-6)


def test_a_carried_solid_keeps_what_it_touches_and_what_it_was_made_from(tmp_path):
    fields = AttachedFields(name="cup", cylinder=(0.03, 0.1), touch_links=["hand", "arm2"])
    solid = attached_of(fields, tmp_path, ())
    assert solid.touch_links == ("hand", "arm2")
    assert solid.contents is not None
