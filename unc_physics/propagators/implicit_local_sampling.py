"""Local sampling on the implicit step: Eqs. 30 to 35 over the contacts that `solved_contacts` records."""

from typing import NamedTuple

import numpy as np

from ..collision.implicit_workspace import CONTACTS, ELASTIC, LASTING
from ..compiler import inner, kernel
from ..dynamics.implicit_rollout import rollout_kernel
from ..dynamics.implicit_stages import after_impact, after_travel, before_step, on_sleep, undo_step
from ..spatial.layout import ERROR, EV, EW
from ..spatial.random import combine
from .local_clouds import ContactCloud, cloud_of, drift_covariances, factor_pose_covariance, kick_covariance
from .sampled_contacts import sample_contacts
from .solved_contacts import Solved, copy_blocks, record_pair, records_room


class SolvedCloud(NamedTuple):
    """State of local sampling in a rollout of the implicit step; ``before`` holds the covariances at the
    step's beginning.
    """

    cloud: ContactCloud
    before: np.ndarray
    solved: Solved


@kernel
def _prepare(source, world, work, contacts):
    """Return the initial state; ``source`` has covariances (M, 12, 12) and draws (`cloud_of`)."""
    covariance, draws = source
    cloud = cloud_of(covariance, world.bodies.moving, draws)
    return SolvedCloud(cloud, np.empty_like(covariance), Solved(work.R, records_room(contacts)))


#: Advances the nominal state, its memory, and the covariances in place (`rollout_kernel`).
advance_solved_covariances = rollout_kernel(_prepare)


@before_step.of(SolvedCloud)
def _drift(method, x, step, world, work):
    """Keep the covariances, and take them through the transition of the whole step (Eq. 30)."""
    copy_blocks(method.before, method.cloud.covariance)
    drift_covariances(method.cloud, x, step, world, work)


@undo_step.of(SolvedCloud)
def _put_back(method, work):
    """The covariances are those of the step's beginning."""
    copy_blocks(method.cloud.covariance, method.before)


@on_sleep.of(SolvedCloud)
def _rest(method, i, work):
    """Give a sleeping body the pose covariance of the step's beginning, and certain zero velocities."""
    block = method.cloud.error_block[i]
    P, before = method.cloud.covariance[block], method.before[block]
    for r in range(ERROR):
        for c in range(ERROR):
            still = EV <= r < EV + 3 or r >= EW or EV <= c < EV + 3 or c >= EW
            P[r, c] = 0.0 if still else before[r, c]


@after_travel.of(SolvedCloud)
def _push(method, x, count, h, world, work):
    """Let the spread of the lasting contacts' forces act."""
    _kick(method, LASTING, world, work)


@after_impact.of(SolvedCloud)
def _hit(method, x, count, threshold, world, work):
    """Let the spread of an impact's impulses act, by draws of its own."""
    method.cloud.key[0] = combine(method.cloud.key[0], 1)
    _kick(method, ELASTIC, world, work)


@inner(noinline=True)
def _kick(method, law, world, work):
    """Pair by pair, as `local_clouds` does of the explicit step's contacts."""
    cloud, solved, c = method.cloud, method.solved, 0
    while c < work.counts[CONTACTS]:
        i, j = work.ids[c, 0], work.ids[c, 1]
        found, c = record_pair(c, law, world, work, solved)
        if found == 0:
            continue
        cloud.spread[:] = 0.0
        factor_pose_covariance((i, j), solved, cloud)
        key = combine(combine(cloud.key[0], i), j)
        sample_contacts((i, j), found, key, world.tree, solved, cloud)
        for side, body in ((1, i), (2, j)):
            if world.bodies.moving[body]:
                kick_covariance(body, side, world, solved.R[body], cloud)
