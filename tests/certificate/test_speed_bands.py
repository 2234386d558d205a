"""Speed bands in the certificate: floors for all t, ends of stretches, slower runs."""

import numpy as np
import pytest
from gantry import gantry
from scipy.interpolate import BPoly, CubicSpline, PPoly

from tubeplanner import (
    JointTrajectory,
    PlanningProblem,
    Tolerance,
    Tube,
    load_problem,
    load_robot,
    verify,
)
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.certificate.tool_conditions import judge_least_speed
from tubeplanner.certificate.verification import SEGMENT_MARGINS, longest_duration

FLOOR, TOP, SPEED = 0.2375, 0.25, 0.245  # [m/s]
BAND = {"speed": TOP, "tolerance": 0.05}
RADIUS = 0.01  # [m]
LINE = [[0.1, 0.1, 0], [0.2, 0.1, 0], [0.5, 0.1, 0], [0.6, 0.1, 0]]
CORNER = [[0.2, 0.2, 0], [0.2, 0.1, 0], [0.5, 0.1, 0], [0.6, 0.1, 0]]
FREE = {"effort": {"along": float("inf"), "across": float("inf")}}


@pytest.fixture
def seam(tmp_path):
    """Return a maker of problems of a gantry with a band in the second of three segments."""

    def make(start=(0.1, 0.1), points=LINE, speed=BAND, **tube):
        fields = {"points": points, "radius": RADIUS, "tool_speed": [None, speed, None], **tube}
        robot = {"urdf": "gantry.urdf", "tool_frame": "head", "limits": FREE}
        begin = {"joints": [float(q) for q in start]}
        return load_problem(gantry(tmp_path, robot=robot, tube=fields, start=begin))

    return make


def moved(start, *pieces):
    """Return the motion of a tool from a position (x, y) [m].

    Args:
        start: Position [m].
        pieces: Duration [s], and the velocities (x, y) with their first two derivatives by the
            fraction of the piece, at its begin, perhaps inside it at even fractions, and its end.
    """
    position, times, rows = np.array(start, dtype=float), [0.0], []
    for duration, *knots in pieces:
        fractions = np.linspace(0, 1, len(knots))
        velocity = PPoly.from_bernstein_basis(BPoly.from_derivatives(fractions, np.array(knots)))
        path = PPoly(duration * velocity.c, fractions).antiderivative()
        for k, width in enumerate(np.diff(fractions)):
            size = duration * width
            rows.append(path.c[:, k] / duration ** np.arange(6, -1, -1)[:, None])
            rows[-1][-1] = position
            position = position + path(fractions[k + 1]) - path(fractions[k])
            times.append(times[-1] + size)
    return JointTrajectory(["along", "across"], np.array(times), np.stack(rows, axis=1))


def held(x, y=0.0):
    return [[x, y], [0, 0], [0, 0]]


def straight(speed=SPEED, *inside, run=0.09):
    """Return a run along the line, at a speed from `run` [m] on; more pieces in its middle."""
    begin, end = ((2 * run / speed, held(a), held(b)) for a, b in ((0, speed), (speed, 0)))
    way = 0.5 - 2 * run - shift(inside)[0]
    half = way / 2 / speed, held(speed), held(speed)
    return moved((0.1, 0.1), begin, half, *inside, half, end)


def shift(pieces):
    """Return by how much pieces move a tool, (x, y) [m]."""
    return moved((0, 0), *pieces).position(np.inf) if pieces else np.zeros(2)


def dip(least, duration=4e-4):
    """Return a piece in which the speed falls to a least value and rises again."""
    return duration, held(SPEED), held(least), held(SPEED)


def turn(begin, end, duration, slowed=0.0):
    """Return a piece whose direction turns between angles [rad], slower in its middle."""
    f = np.polynomial.Polynomial([0, 1])
    angle = begin + (end - begin) * f**3 * (10 - 15 * f + 6 * f**2)
    rate, at = SPEED * (1 - slowed * 64 * f**3 * (1 - f) ** 3), np.linspace(0, 1, 17)
    r, dr, ddr = rate(at), rate.deriv()(at), rate.deriv(2)(at)
    w, dw = angle.deriv()(at), angle.deriv(2)(at)
    rows = np.array([r + 0j, dr + 1j * r * w, ddr + 2j * dr * w + 1j * r * dw - r * w**2])
    rows = (rows * np.exp(1j * angle(at))).T
    return duration, *np.stack([rows.real, rows.imag], axis=2)


def failures(problem, motion):
    return list(verify(problem, motion).failures())


def test_a_motion_inside_its_band_passes(seam):
    certificate = verify(seam(), straight())
    assert certificate.passed
    condition = certificate.conditions["tool_speed"]
    assert condition.margin == pytest.approx(1 - SPEED / TOP, abs=1e-3)
    assert certificate.from_speed == pytest.approx(FLOOR / SPEED, rel=1e-3)
    slower = verify(seam(), straight(0.239)).conditions["tool_speed"]
    assert slower.margin == pytest.approx(0.239 / FLOOR - 1, rel=0.03)
    assert "above the band's lower end" in slower.coverage


@pytest.mark.parametrize(("below", "passes"), [(1e-4, False), (-1e-4, True)])
def test_a_dip_between_samples_is_seen(seam, below, passes):
    """A dip of 0.4 ms to a thousandth of the band below its lower end."""
    motion = straight(SPEED, dip(FLOOR * (1 - below)))
    certificate = verify(seam(), motion)
    assert list(certificate.failures()) == ([] if passes else ["tool_speed"])
    condition = certificate.conditions["tool_speed"]
    assert condition.margin == pytest.approx(-below, abs=1e-5)
    assert condition.where.time == pytest.approx(motion.duration / 2, abs=1e-4)
    assert condition.where.segment == 1


@pytest.mark.parametrize(("slowed", "failed"), [(0.0, []), (0.1, ["tool_speed"])])
def test_a_loop_counts_where_it_is_slow(seam, slowed, failed):
    """The speed is that of the tool along its own path."""
    loop = turn(0, 2 * np.pi, 0.1, slowed)
    assert failures(seam(radius=0.02), straight(SPEED, loop)) == failed


def test_a_tool_that_turns_back_is_at_rest_for_an_instant(seam):
    back = (0.02, held(SPEED), held(-SPEED), held(SPEED))
    condition = verify(seam(), straight(SPEED, back)).conditions["tool_speed"]
    assert condition.margin == pytest.approx(-1, abs=1e-3)


def cornered(x):
    """Return the pieces of a run down at x [m], round a corner and along the second segment."""
    bend, run = turn(-np.pi / 2, 0, 0.008 / SPEED), 2 * 0.09 / SPEED
    across, down = shift([bend]) * [1, -1]
    return (
        (2 * 0.05 / SPEED, held(0), held(0, -SPEED)),
        ((0.05 - down) / SPEED, held(0, -SPEED), held(0, -SPEED)),
        bend,
        ((0.51 - x - across) / SPEED, held(SPEED), held(SPEED)),
        (run, held(SPEED), held(0)),
    )


@pytest.mark.parametrize(("x", "failed"), [(0.199, []), (0.2 + RADIUS / 2, ["tube"])])
def test_a_stretch_begins_behind_its_first_point(seam, x, failed):
    """A tool that cuts the corner comes into the stretch half a radius beyond its begin."""
    motion = moved((x, 0.2), *cornered(x))
    certificate = verify(seam((x, 0.2), CORNER), motion)
    assert list(certificate.failures()) == failed
    condition = certificate.conditions["tube"]
    if failed:
        assert condition.margin == pytest.approx(0.2 - x, abs=1e-5)
        assert condition.where.point == 1
        assert "outside the begin of a stretch" in condition.coverage
    assert verify(seam((x, 0.2), CORNER, process={"steady": "best"}), motion).passed


def test_a_stretch_ends_beyond_its_last_point(seam):
    """The same run backwards."""
    x, points = 0.2 + RADIUS / 2, CORNER[::-1]
    sign = np.array([-1, 1, -1])[:, None]
    back = [
        (time, *(sign * np.array(knot) for knot in knots[::-1])) for time, *knots in cornered(x)
    ]
    motion = moved((0.6, 0.1), *back[::-1])
    condition = verify(seam((0.6, 0.1), points), motion).conditions["tube"]
    assert condition.margin == pytest.approx(0.2 - x, abs=1e-5)
    assert condition.where.point == 2
    assert "outside the end of a stretch" in condition.coverage


@pytest.mark.parametrize(
    ("late", "failed"),
    [(-RADIUS / 2, []), (-1e-5, []), (1e-5, ["tool_speed"]), (RADIUS / 2, ["tool_speed"])],
)
def test_a_band_holds_from_the_first_point_on(seam, late, failed):
    """The tool is in both capsules for 10 mm beside the point; only those before it are free."""
    f = np.linspace(0, 1, 1001)
    reached = np.interp(FLOOR / SPEED, f**3 * (10 - 15 * f + 6 * f**2), f)
    way = 2 * reached**4 * (2.5 - 3 * reached + reached**2)  # of the run, until the floor
    assert failures(seam(), straight(run=(0.1 + late) / way)) == failed


def test_a_seam_that_is_too_fast_breaks_nothing_else(seam):
    assert failures(seam(), straight(1.05 * TOP)) == ["tool_speed"]


def test_the_longest_duration_is_where_the_band_ends(seam):
    problem, motion = seam(), straight(SPEED, dip(0.242, 0.1))
    longest = longest_duration(problem, motion)
    assert longest == pytest.approx(motion.duration * 0.242 / FLOOR, rel=1e-3)
    assert failures(problem, motion.scaled(0.999 * longest / motion.duration)) == []
    slower = motion.scaled(1.001 * longest / motion.duration)
    assert failures(problem, slower) == ["tool_speed"]
    assert verify(problem, slower).from_speed == pytest.approx(1.001, abs=1e-4)


@pytest.mark.parametrize("tube", [{"process": {"steady": "best"}}, {"speed": TOP}])
def test_without_a_required_band_slow_is_right(seam, tube):
    problem, motion = seam(**tube), straight(0.1)
    certificate = verify(problem, motion)
    assert certificate.passed
    assert certificate.from_speed is None
    assert longest_duration(problem, motion) == np.inf


@pytest.mark.parametrize("seed", range(6))
def test_the_least_speed_is_that_of_many_samples(seed):
    """A turning arm: the lower bound is below all samples, and near to the least of them."""
    rng = np.random.default_rng(seed)
    robot = load_robot("example:ur5", "tool0")
    knots = np.array([-0.8, -1.3, 1.8, -2.1, -1.6, 0.0]) + rng.normal(0, 0.3, (8, 6)).cumsum(axis=0)
    spline = CubicSpline(np.linspace(0, 2.0, 8), knots, bc_type="clamped")
    motion = JointTrajectory(robot.joint_names, spline.x, spline.c)
    points = robot.tool_position(motion.position(np.array([0.0, 0.5, 1.5, 2.0])))
    speeds = [None, {"between": [0.05, 5.0]}, None]
    problem = PlanningProblem(robot, Tube(points, 5.0, tool_speed=speeds), knots[0])
    judged = JudgedMotion(problem.joined, motion, Tolerance(), SEGMENT_MARGINS)
    (visit,) = (visit for visit in judged.visits if visit.segment == 1)
    begin, end = visit.begin, visit.end
    for count in (2001, 201):  # as near as 200,000 samples, where the least one is
        t = np.linspace(begin, end, count)
        rate = robot.tool_velocity(motion.position(t), motion.velocity(t))[0]
        speed = np.linalg.norm(rate, axis=1)
        begin, end = t[np.clip(speed.argmin() + np.array([-1, 1]), 0, count - 1)]
    sampled, margin = speed.min() / 0.05 - 1, judge_least_speed(judged).margin
    assert sampled - 0.02 * abs(sampled) - 1e-6 <= margin <= sampled + 1e-6
