"""Reasons of a failed certificate or a blocked configuration, in words, with location."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.judged_motion import Tolerance
from tubeplanner.certificate.verification import Certificate
from tubeplanner.geometry.solids import open_mesh_texts
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

_TOUCHING = 0.05  # [mm]
_PROVED = 10  # tolerances
_REMEDY = "move the reference points or choose another configuration"


def refusal(problem: PlanningProblem, certificate: Certificate) -> Infeasible | None:
    """Return the reason of a failed certificate, or None if the certificate passed."""
    failures = certificate.failures()
    if not failures:
        return None
    blocked = [name for name in failures if name in ("obstacles", "self_collision")]
    if blocked:
        condition = certificate.conditions[blocked[0]]
        location, margin = condition.where, condition.margin or 0.0
        when = f"at t = {location.time or 0.0:.3f} s of a motion that was tried"
        return _blocked(problem, location, margin, when)
    lines = "; ".join(certificate.describe(name) for name in failures)
    location = certificate.conditions[failures[0]].where
    message = f"the trajectory fails its certificate: {lines}"
    return Infeasible(PlanStatus.CERTIFICATE_FAILED, message, location)


def require_free(
    problem: PlanningProblem,
    name: str,
    q: FloatArray,
    required: FloatArray | None = None,
    *,
    is_given: bool = False,
) -> None:
    """Check that a configuration (n,) is not itself in collision or too near to an obstacle.

    Args:
        problem: The planning problem.
        name: Name of the configuration in the message: start, goal or another place.
        q: Shape (n,).
        required: Required distances of all pairs, shape (P,) [m]; None: as at start or goal.
        is_given: True if every trajectory has the configuration: then a refusal is a proof.

    Raises:
        Infeasible: Status tube_blocked.
    """
    if required is None:
        segment = 0 if name == "start" else problem.tube.segment_count - 1
        tool, distances = problem.robot.tool_position(q[None]), RequiredDistances(problem, q, q)
        if problem.tube.visit == "ordered":
            required = distances.at(np.array([segment]), tool)[0]
        else:  # any segment may be current there
            required = distances.anywhere(tool)[0]
    margins = clear_by(problem, q, required)
    if not (margins < -Tolerance().absolute).any():
        return
    checker = problem.collision
    worst = int(margins.argmin())
    links, obstacle = checker.owners(checker.pairs[worst])
    is_end = name in ("start", "goal")
    when = f"in the {name} configuration" if is_end else f"at {name}"
    remedy = f"choose another {name}" if is_end else _REMEDY
    margin = float(margins[worst])
    if obstacle is not None:
        remedy += f" or move '{obstacle}' {_away(problem, q, worst, -margin)}"
    if is_end and obstacle is not None:  # it may be what a motion picks up or puts down
        remedy += (
            f", or list [{links[0]}, {obstacle}] in contacts if they may be that near there, in "
            "collision.ignore if they may touch"
        )
    location = Location(links=links, obstacle=obstacle).at(problem.robot.tool_position(q[None])[0])
    refused = _blocked(problem, location, margin, when, remedy)
    # A certificate lets a given end be off by a tolerance, and solids by as much times a lever.
    proved = is_given and margin < -_PROVED * Tolerance().absolute
    raise refused.replaced(proved=proved, starts=0 if is_given else 1, configuration=q)


def clear_by(problem: PlanningProblem, q: FloatArray, required: FloatArray) -> FloatArray:
    """Return the clearances (P,) [m] in a configuration (n,): distances less `required` (P,)."""
    checker = problem.collision
    rotation, position = problem.robot.body_poses(q[None])
    distance: FloatArray = checker.distances(rotation[0], position[0], checker.pairs)
    return distance - required


def _away(problem: PlanningProblem, q: FloatArray, pair: int, missing: float) -> str:
    """Return the shift of a pair's obstacle along an axis that makes the pair clear, in words."""
    checker = problem.collision
    rotation, position = problem.robot.body_poses(q[None])
    closest = checker.closest_points(rotation, position, checker.pairs[pair][None])
    direction = closest.direction[0]
    if not direction.any():
        return "out of the way"
    k = int(abs(direction).argmax())
    sign = "+" if direction[k] > 0 else "-"
    return f"by {1000 * missing / abs(direction[k]):.3g} mm in {sign}{'xyz'[k]}"


def _blocked(
    problem: PlanningProblem, location: Location, margin: float, when: str, remedy: str = _REMEDY
) -> Infeasible:
    """Return the refusal with links, obstacle, and depth or distance."""
    links, clearance = location.links or (), problem.clearance
    meshes = problem.collision.open_meshes
    own = {name: meshes[name] for name in (*links, location.obstacle) if name in meshes}
    open_mesh = "".join(f"; {text}" for text in open_mesh_texts(own))
    if not problem.has_one_clearance:
        pair = (*links, location.obstacle) if location.obstacle else links
        message = (
            f"'{pair[0]}' and '{pair[1]}' are {-1000 * margin:.3g} mm nearer to each other than "
            f"they may be {when}; {remedy}, or give the pair less clearance"
        )
        return Infeasible(PlanStatus.TUBE_BLOCKED, message + open_mesh, location)
    if location.obstacle is None:
        message = (
            f"{' and '.join(links)} overlap by {-1000 * margin:.1f} mm {when}; {remedy}, "
            "or list the pair in collision.ignore if it may touch"
        )
        return Infeasible(PlanStatus.TUBE_BLOCKED, message + open_mesh, location)
    distance = 1000 * (margin + clearance)
    if clearance and distance > _TOUCHING:
        digits = 2 - int(np.floor(np.log10(distance)))
        floored = np.floor(distance * 10.0**digits) / 10.0**digits
        remedy += f", or clearance {1000 * clearance:g} -> {floored:g} mm"
    deed = "touches" if abs(distance) < _TOUCHING else f"reaches {-distance:.1f} mm into"
    deed = f"comes within {distance:.1f} mm of" if distance >= _TOUCHING else deed
    condition = f" (clearance {1000 * clearance:g} mm)" if clearance else ""
    message = f"'{links[0]}' {deed} '{location.obstacle}'{condition} {when}; {remedy}"
    return Infeasible(PlanStatus.TUBE_BLOCKED, message + open_mesh, location)
