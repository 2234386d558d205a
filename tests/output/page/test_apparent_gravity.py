"""Held parts on a page: the arrow of the apparent gravity, where its tip may be, parts, the tab."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tubeplanner import view
from tubeplanner.geometry.convex_shapes import box
from tubeplanner.geometry.solids import AttachedSolid
from tubeplanner.output.curves import held_contacts
from tubeplanner.output.link_visuals import solids_at_tool
from tubeplanner.output.page.apparent_gravity import held_region
from tubeplanner.output.page.scene import Layer
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray
from tubeplanner.task.motion import MotionSection

G = 9.81
TOP = 0.04  # of the tray [m]
TRAY = Holding(Tray(0.3, (0.04, 0.04), position=(0, 0, TOP)), Payload(0.8, (0, 0, TOP + 0.03)))
CUP = Holding(Cup(42.4, 0.03, 0.5), Payload(0.8, (0.0, 0.0, 0.03)))
GRIPPER = Holding(Gripper(20.0, 0.4, (0.02, 0.02)), Payload(0.8, (0, 0.0, 0.01)))


@pytest.fixture(scope="module")
def slowed(stored):
    """A level motion that holds a part on a tray, and its problem."""
    problem, trajectory = stored("ur5/level_tray", "refinement")
    return replace(problem, attached=(), holding=(TRAY,)), trajectory.scaled(8.0)


def test_a_region_is_the_cone_of_its_contact():
    tray, cup = (
        region[np.linalg.norm(region, axis=1) < 2.9 * G]  # the others are at the largest size
        for region in map(held_region, (TRAY, CUP))
    )
    assert len(tray) > 400 and len(cup) > 400
    pressing = -tray[:, 2] - G * (1 - 1 / 1.2)  # the normal is upwards
    assert np.linalg.norm(tray[:, :2], axis=1) == pytest.approx(0.3 / 1.2 * pressing, rel=1e-6)
    left = 42.4 / 1.5 / 0.8 - cup[:, 2]  # along z gravity pulls the part off
    assert np.linalg.norm(cup[:, :2], axis=1) == pytest.approx(0.5 * left, rel=1e-6)
    assert held_region(replace(CUP, contact=replace(CUP.contact, force=1e4))) is None
    most = 2 * 0.4 * 20.0 / 2 / 0.8  # of a gripper, in the plane of its pads
    across = np.linalg.norm(held_region(GRIPPER)[:, :2], axis=1)
    assert across.max() == pytest.approx(most, rel=1e-2)


def test_the_tip_of_the_arrow_is_the_apparent_gravity_and_stays_in_the_cone(slowed):
    problem, trajectory = slowed
    scene = view(problem, trajectory).scene
    arrow, region = (item for item in scene.items if item.layer is Layer.HOLDING)
    (shown,) = scene.trajectories
    (use,) = held_contacts([MotionSection(problem, trajectory)], shown.time)
    assert use.share.max() < 1
    scale = 20 * scene.thickness / G
    hull = ConvexHull(region.surface.vertices).equations
    for step in range(0, len(shown.time), 10):
        tip = shown.placement(step, arrow.body) @ [0, 0, 1, 1]
        local = (np.linalg.inv(shown.placement(step, region.body)) @ tip)[:3]
        assert local / scale == pytest.approx(use.apparent_gravity[step], abs=1e-9)
        assert (hull[:, :3] @ local + hull[:, 3]).max() < 1e-3 * scale * G
    assert arrow.surface.vertices[:, 2].max() == pytest.approx(1.0)


def test_the_page_has_the_share_and_a_word_on_what_happens(slowed):
    problem, trajectory = slowed
    page = view(problem, trajectory)
    (holding,) = page.panel["trajectories"][0]["holding"]
    assert (holding["name"], set(holding["words"])) == ("tray", {"slides", "tips"})
    assert len(holding["share"]) == len(holding["atRest"]) == len(holding["happens"])
    assert 0 < max(holding["share"]) <= 100
    labels = {layer["name"]: layer["label"] for layer in page.panel["layers"]}
    assert labels["carried"] == "Carried: part (tray)"
    assert labels["holding"].startswith("Apparent gravity")
    properties = {each["property"] for each in page_commands(page) if "property" in each}
    assert "renderOrder" in properties  # as three.js spells it
    assert "holding" not in view(replace(problem, holding=()), trajectory).panel["trajectories"][0]


def page_commands(page):
    from tubeplanner.output.page.viewer import recorded_commands

    return recorded_commands(page.scene)


def test_a_part_is_drawn_on_its_contact_unless_a_solid_is_there(slowed):
    problem, _ = slowed
    sizes = {}
    for holding in (TRAY, CUP, GRIPPER, Holding(Liquid(0.3))):
        (part,) = solids_at_tool(SimpleNamespace(attached=(), holding=(holding,)))
        points = np.vstack([shape.vertices for shape in part.shapes])
        sizes[part.name] = np.round([points.min(axis=0), points.max(axis=0)], 6).tolist()
    assert sizes["part (tray)"] == [[-0.02, -0.02, 0.04], [0.02, 0.02, 0.1]]
    assert sizes["part (cup)"] == [[-0.06, -0.06, 0.0], [0.06, 0.06, 0.06]]
    assert sizes["part (gripper)"] == [[-0.01, -0.01, -0.01], [0.01, 0.01, 0.02]]
    solid = AttachedSolid("glass", (box((0.04, 0.04, 0.2)),))
    assert solids_at_tool(replace(problem, attached=(solid,))) == [solid]
