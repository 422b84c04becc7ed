"""Local sampling on the implicit step: Eqs. 30 to 35 over the contacts that `solved_contacts` records."""

from ..compiler import kernel
from ..dynamics.implicit_rollout import rollout_kernel
from ..spatial.layout import ERROR, EV, EW
from ..spatial.random import combine
from . import solved_contacts
from .local_clouds import ContactCloud, cloud_of, drift_covariances, factor_pose_covariance, kick_covariance
from .sampled_contacts import sample_contacts


@kernel
def _prepare(source, world, work, room):
    """Return the initial state; ``source`` has covariances (M, 12, 12) and draws (`cloud_of`)."""
    covariance, draws = source
    return solved_contacts.solved(cloud_of(covariance, world.bodies.moving, draws), covariance, work, room)


#: Advances the nominal state, its memory, and the covariances in place (`rollout_kernel`).
advance_solved_covariances = rollout_kernel(_prepare)


@solved_contacts.drift.of(ContactCloud)
def _drift(cloud, x, step, world, work):
    """Take the covariances through the transition of the whole step (Eq. 30)."""
    drift_covariances(cloud, x, step, world, work)


@solved_contacts.begin_impact.of(ContactCloud)
def _begin_impact(cloud):
    """Take a new key, so that the impact has draws of its own."""
    cloud.key[0] = combine(cloud.key[0], 1)


@solved_contacts.stop.of(ContactCloud)
def _stop(cloud, covariance):
    """Clear the rows and columns of the velocities."""
    for r in range(ERROR):
        for c in range(ERROR):
            if EV <= r < EV + 3 or r >= EW or EV <= c < EV + 3 or c >= EW:
                covariance[r, c] = 0.0


@solved_contacts.push_pair.of(ContactCloud)
def _push_pair(cloud, i, j, count, world, contacts):
    """Let the spread of the forces act."""
    cloud.spread[:] = 0.0
    factor_pose_covariance((i, j), contacts, cloud)
    key = combine(combine(cloud.key[0], i), j)
    sample_contacts((i, j), count, key, world.tree, contacts, cloud)
    for side, body in ((1, i), (2, j)):
        if world.bodies.moving[body]:
            kick_covariance(body, side, world, contacts.R[body], cloud)
