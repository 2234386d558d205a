"""Efforts of arms whose limits are the same both ways, by the powers of the speed."""

import numpy as np
import pytest

from cases import anywhere, with_motors
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.path_samples import PathSamples

SPEED = 1.7
FRICTION = {"backwards_friction": np.arange(6.0) + 11, "forwards_friction": np.arange(6.0) + 1}


@pytest.mark.parametrize("viscous", [0.0, 3.0])
@pytest.mark.parametrize("counts", [True, False])
def test_coulomb_friction_counts_where_it_is_asked_for(ur5, viscous, counts):
    """And not where rounding alone says which way a joint moves."""
    arm = with_motors(ur5, viscous_friction=viscous, **FRICTION)
    q, v, a = np.random.default_rng(3).uniform(-1, 1, (3, 4, 6))
    v[1] *= 1e-9
    limit = np.array([150.0, np.inf, 150.0, 28.0, 28.0, 28.0])
    own = JointEffort(limit, with_coulomb_friction=counts)
    found = own.used(PathSamples(anywhere(arm), np.stack([q, v, a]))).at(SPEED)
    effort = ur5.inverse_dynamics(q, SPEED * v, SPEED**2 * a) + viscous * SPEED * v
    dry = np.where(v > 0, np.arange(6) + 1, -np.arange(6) - 11) * counts
    dry[1] = 0
    kept = [0, 2, 3, 4, 5]
    np.testing.assert_allclose(found, ((effort + dry) / limit)[:, kept], rtol=1e-10, atol=1e-12)
