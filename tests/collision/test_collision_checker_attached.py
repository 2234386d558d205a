"""Solids that the tool carries count as links."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import (
    AttachedSolid,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    ProblemError,
    Seed,
    Tube,
    parse_problem,
    placement_of,
    plan,
)

# A bar that the tool holds across its way, 0.3 m long.
BAR = Obstacle.box("bar", [0.02, 0.3, 0.02], placement_of([0, 0, 0.02])).shapes
STOPPING = PlanOptions("stop-at-corners")  # what is refused is refused sooner
POST = Obstacle.cylinder("post", 0.02, 0.3, placement_of([0.42, 0.05, 0]))


def problem(two_link, attached=(), points=((0.3, -0.3, 0), (0.3, 0.3, 0)), **more):
    tube = Tube(points, 0.03, joint_signs={"joint2": "-"})
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), attached=attached, **more)


def test_what_is_carried_must_clear_the_obstacles(two_link):
    assert plan(problem(two_link, obstacles=[POST]), SHORTEST).succeeded
    carried = AttachedSolid("bar", BAR)
    result = plan(problem(two_link, [carried], obstacles=[POST]), STOPPING)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.place.links == ("bar",)
    assert result.place.obstacle == "post"
    allowed = problem(two_link, [carried], obstacles=[POST], ignore_collisions=[("bar", "post")])
    assert plan(allowed, SHORTEST).succeeded


def test_what_is_carried_must_clear_the_links_but_not_its_carrier(two_link):
    """A wide tail behind the elbow; it may touch what it is said to touch."""
    tail = Obstacle.box("tail", [0.1, 0.4, 0.02], placement_of([-0.39, 0, -0.02])).shapes
    points = ((0.45, -0.2, 0), (0.45, 0.2, 0))
    result = plan(problem(two_link, [AttachedSolid("tail", tail)], points), SHORTEST)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert set(result.place.links) == {"link1", "tail"}
    touching = AttachedSolid("tail", tail, touch_links=("link1", "base"))
    assert plan(problem(two_link, [touching], points), SHORTEST).succeeded


def test_it_is_placed_in_the_tool_frame(panda):
    ball = AttachedSolid("ball", Obstacle.sphere("b", 0.01, placement_of([0, 0, 0.3])).shapes)
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    rotation, tool = panda.tool_pose(q[None])
    center = tool[0] + rotation[0] @ [0, 0, 0.3]
    target = Obstacle.sphere("target", 0.02, placement_of(center + np.array([0.1, 0, 0])))
    tube = Tube(tool[0] + np.array([[0, 0, 0], [0.02, 0, 0]]), 0.05)
    checker = PlanningProblem(panda, tube, q, obstacles=[target], attached=[ball]).collision
    poses = [pose[0] for pose in panda.body_poses(q[None])]
    pair = [p for p in checker.obstacle_pairs if checker.owners(p)[0] == ("ball",)]
    np.testing.assert_allclose(checker.distances(*poses, np.array(pair)), [0.07], atol=1e-6)


def test_the_file_says_the_same():
    fields = {
        "robot": {
            "urdf": "example:two_link",
            "tool_frame": "hand",
            "gravity": [0, 0, 0],
            "attached": [
                {"name": "bar", "box": [0.02, 0.3, 0.02], "position": [0, 0, 0.02]},
                {"name": "tail", "sphere": 0.01, "touch_links": ["link1"]},
            ],
        },
        "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
        "start": {"seed": [0, -1]},
        "obstacles": [{"name": "post", "cylinder": [0.02, 0.3], "position": [0.42, 0.05, 0]}],
    }
    result = plan(parse_problem(fields), STOPPING)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.place.links == ("bar",)


@pytest.mark.parametrize(
    ("solid", "message"),
    [
        (AttachedSolid("link1", BAR), "'link1' is also the name of a link"),
        (AttachedSolid("post", BAR), "the name 'post' is given 2 times"),
        (AttachedSolid("bar", BAR, ("lnk1",)), "unknown link or obstacle 'lnk1'"),
    ],
)
def test_names_must_be_unique_and_known(two_link, solid, message):
    with pytest.raises(ProblemError, match=message):
        _ = problem(two_link, [solid], obstacles=[POST]).collision


def test_what_is_carried_is_never_excused_by_touching_always(ur5):
    """A ball so large that it is inside the forearm in every configuration."""
    q = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    tool = ur5.tool_position(q[None])[0]
    ball = AttachedSolid("ball", Obstacle.sphere("b", 0.25, placement_of()).shapes)
    tube = Tube(tool + np.array([[0, 0, 0], [0, 0, 0.1]]), 0.05)
    result = plan(PlanningProblem(ur5, tube, q, attached=[ball]), SHORTEST)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert "ball" in result.place.links
