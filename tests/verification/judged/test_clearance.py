"""Links against obstacles and against each other are judged apart."""

from cases import changed
from tubeplanner import verify


def test_what_obstacles_lack_links_do_not(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    plain = verify(problem, trajectory).conditions
    far = verify(changed(problem, clearance=0.3), trajectory).conditions
    assert far["obstacles"].margin < -0.1
    assert far["obstacles"].where.obstacle == "wall"
    assert far["self_collision"].margin == plain["self_collision"].margin > 0
    assert far["self_collision"].where.obstacle is None
    assert len(far["self_collision"].where.links) == 2
