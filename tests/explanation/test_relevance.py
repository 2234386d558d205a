"""What may help about a place is tried first, then what may help elsewhere, then all else."""

from asked_problems import simple_change
from tubeplanner.explanation.relevance import in_order
from tubeplanner.outcome import Place, PlanStatus


def change(field, kind, *about):
    return simple_change(field, kind=kind, about=frozenset(about))


def fields_of(changes, status, place):
    """Return the fields of the two groups about the place, of those elsewhere and of all else."""
    tiers = in_order(changes, status, place)
    assert [len(tier) for tier in tiers] == [2, 1, 1]
    return [[each.field for each in group] for tier in tiers for group in tier]


def test_the_likeliest_kinds_about_the_place_come_first():
    changes = [
        change("point 3", "point", "point 3", "segment 2"),
        change("effort", "effort", "joint1"),
        change("radius 2", "radius", "segment 2"),
        change("radius 0", "radius", "segment 0"),
        change("wall", "obstacle", "obstacle wall"),
        change("table", "obstacle", "obstacle table"),
        change("clearance", "clearance"),
        change("sign", "sign", "joint1"),
        change("radii", "radii"),
    ]
    place = Place(segment=2, obstacle="wall", links=("hand",))
    assert fields_of(changes, PlanStatus.TUBE_BLOCKED, place) == [
        ["clearance", "wall", "radii", "sign"],
        ["radius 2", "point 3"],
        ["table", "radius 0"],
        ["effort"],
    ]


def test_a_joint_that_is_too_weak_comes_before_the_others():
    changes = [
        change("radius", "radius", "segment 0"),
        change("payload", "payload"),
        change("joint1", "effort", "joint1"),
        change("joint2", "effort", "joint2"),
    ]
    place = Place(joint="joint2", segment=0)
    assert fields_of(changes, PlanStatus.GRAVITY_EXCEEDS_EFFORT, place) == [
        ["joint2", "payload"],
        [],
        ["joint1"],
        ["radius"],
    ]


def test_a_point_is_about_its_two_segments_too():
    changes = [change(f"radius {k}", "radius", f"segment {k}") for k in range(4)]
    changes += [change(f"point {k}", "point", f"point {k}") for k in range(4)]
    there, then, elsewhere, others = fields_of(changes, PlanStatus.UNREACHABLE, Place(point=2))
    assert there == ["radius 1", "radius 2"]
    assert then == ["point 2"]
    assert elsewhere == ["radius 0", "radius 3", "point 0", "point 1", "point 3"]
    assert others == []


def test_what_links_are_near_is_about_the_place():
    changes = [
        change("other pair", "clearance", "link arm", "obstacle wall"),
        change("pair", "clearance", "link hand", "obstacle post"),
    ]
    place = Place(links=("hand", "elbow"))
    assert fields_of(changes, PlanStatus.TUBE_BLOCKED, place) == [["pair"], [], ["other pair"], []]


def test_where_nothing_is_likelier_all_kinds_may_help():
    changes = [change("effort", "effort", "joint1"), change("radius", "radius", "segment 1")]
    found = fields_of(changes, PlanStatus.NO_TRAJECTORY, Place(segment=1))
    assert found == [["radius"], [], ["effort"], []]
