"""How links are covered: pairs left out before and now, how far covers stand off, loading times.

    python benchmarks/covers.py [ROBOT ...] [--time-limit SECONDS]

For every robot of example-robot-data, with the leaf farthest from the root as the tool. "Before":
pairs whose usual covers touch in all of 400 configurations, which was the reason to leave them out.
Times are those of the processor. A robot that takes longer than the limit is named as such.
"""

import argparse
import os
import signal
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from itertools import combinations
from pathlib import Path

from tubeplanner import RobotModel, load_robot
from tubeplanner.collision.collision_checker import ALWAYS_TOUCHING, CollisionChecker
from tubeplanner.collision.cover_cache import VARIABLE
from tubeplanner.collision.link_covers import link_covers
from tubeplanner.collision.link_geometry import link_parts, link_shapes
from tubeplanner.collision.link_pairs import LinkJudge
from tubeplanner.errors import TubePlannerError
from tubeplanner.resources import example_robot_names, find_description


def deepest_link(name: str) -> str:
    """Return the link that most movable joints carry."""
    root = ElementTree.parse(find_description(f"example:{name}", Path("."))).getroot()
    parent = {}
    for joint in root.findall("joint"):
        moves = joint.get("type") in ("revolute", "continuous", "prismatic")
        parent[joint.find("child").get("link")] = (joint.find("parent").get("link"), moves)

    def joints(link: str) -> int:
        above, moves = parent.get(link, (None, False))
        return 0 if above is None else joints(above) + moves

    return max((link.get("name") for link in root.findall("link")), key=joints)


def timed_checker(robot: RobotModel) -> tuple[CollisionChecker, float]:
    """Return a robot's geometry and how long it took to build [s]."""
    begin = time.process_time()
    return CollisionChecker(robot), time.process_time() - begin


def row(name: str) -> str:
    """Return a robot's row of the table."""
    robot = load_robot(f"example:{name}", deepest_link(name))
    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = folder
        (_, cold), (checker, warm) = timed_checker(robot), timed_checker(robot)
        closer = [cover.outer_error for cover in checker.closer_covers.values()]
        errors = [cover.outer_error for cover in link_covers(checker)]
        parts, covers = link_parts(robot), link_shapes(robot)
    now = [pair.links for pair in checker.left_out if pair.reason == ALWAYS_TOUCHING]
    judge = LinkJudge(robot, parts, covers)
    checked = {frozenset(checker.owners(pair)[0]) for pair in checker.link_pairs}
    candidates = [pair for pair in combinations(covers, 2) if frozenset(pair) in checked]
    before = [*now, *(pair for pair in candidates if judge.overlapping(pair))]
    near = f"{1000 * max(closer):.1f}" if closer else ""
    return (
        f"| {name} | {len(before)} | {len(now)} | {', '.join('-'.join(pair) for pair in now)} "
        f"| {1000 * max(errors, default=0.0):.1f} | {near} | {cold:.2f} | {warm:.2f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--time-limit", type=int, default=60, help="for each robot [s]")
    options = parser.parse_args()
    signal.signal(signal.SIGALRM, _give_up)
    print(
        "| robot | left out before | now | always touching | outer error [mm] | where links come "
        "near | cold [s] | warm |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in options.robots or example_robot_names():
        signal.alarm(options.time_limit)
        try:
            print(row(name), flush=True)
        except (TubePlannerError, TimeoutError) as error:
            print(f"| {name} | {error} |", flush=True)
        finally:
            signal.alarm(0)


def _give_up(*_: object) -> None:
    raise TimeoutError("takes longer than the time limit")


if __name__ == "__main__":
    main()
