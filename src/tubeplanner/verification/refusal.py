"""Why a trajectory or a configuration is refused, in words and with its place."""

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.verification.certificate import Certificate
from tubeplanner.verification.judged_condition import Tolerance

_REMEDY = "move the reference points or choose another configuration"


def refusal(problem: PlanningProblem, certificate: Certificate) -> Infeasible | None:
    """Return why a certificate refuses a trajectory, or None if it passed."""
    failures = certificate.failures()
    if not failures:
        return None
    blocked = [name for name in failures if name in ("obstacles", "self_collision")]
    if blocked:
        condition = certificate.conditions[blocked[0]]
        place, margin = condition.where, condition.margin or 0.0
        when = f"at t = {place.time or 0.0:.3f} s"
        return _blocked(problem, place, margin, when)
    lines = "; ".join(certificate.describe(name) for name in failures)
    place = certificate.conditions[failures[0]].where
    message = f"the trajectory fails its certificate: {lines}"
    return Infeasible(PlanStatus.CERTIFICATE_FAILED, message, place)


def require_free(problem: PlanningProblem, name: str, q: FloatArray) -> None:
    """Check that a configuration (n,) is not itself in collision or too near to an obstacle.

    Args:
        problem: The planning problem.
        name: What the configuration is called: start or goal.
        q: Shape (n,).

    Raises:
        Infeasible: Status tube_blocked.
    """
    checker = problem.collision
    rotation, position = problem.robot.body_poses(q[None])
    distance = checker.distances(rotation[0], position[0], checker.pairs)
    margins = distance - checker.required(problem.clearance)
    if not (margins < -Tolerance().absolute).any():
        return
    worst = int(margins.argmin())
    links, obstacle = checker.owners(checker.pairs[worst])
    when = f"in the {name} configuration"
    remedy = f"choose another {name} or move what is in the way"
    if obstacle is not None:  # it may be what a motion picks up or puts down
        remedy += f", or list [{links[0]}, {obstacle}] in collision.ignore if they may touch"
    place = Place(links=links, obstacle=obstacle)
    raise _blocked(problem, place, float(margins[worst]), when, remedy)


def _blocked(
    problem: PlanningProblem, place: Place, margin: float, when: str, remedy: str = _REMEDY
) -> Infeasible:
    """Say which links are where, and how deep or how near."""
    links = place.links or ()
    if place.obstacle is None:
        message = (
            f"{' and '.join(links)} overlap by {-1000 * margin:.1f} mm {when}; {remedy}, "
            "or list the pair in collision.ignore if it may touch"
        )
        return Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
    distance = 1000 * (margin + problem.clearance)
    near = f"comes within {distance:.1f} mm of"
    deed = near if distance > 0 else f"reaches {-distance:.1f} mm into"
    wanted = f" (clearance {1000 * problem.clearance:g} mm)" if problem.clearance else ""
    message = f"'{links[0]}' {deed} '{place.obstacle}'{wanted} {when}; {remedy}"
    return Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
