"""The surrogate on the implicit step: Eqs. 11 to 24 over the contacts that `solved_contacts` records."""

from typing import NamedTuple

import numpy as np

from ..collision.implicit_workspace import CONTACTS, ELASTIC, LASTING
from ..compiler import inner, kernel
from ..dynamics.implicit_rollout import rollout_kernel
from ..dynamics.implicit_stages import after_impact, after_travel, before_step, on_sleep, undo_step
from ..spatial.layout import ERROR, EV, EW
from .solved_contacts import Solved, copy_blocks, record_pair, records_room
from .surrogate_contacts import Spread, add_tilts, cache_pose_covariance, drift_roots, kick_root, spread_of


class SolvedSpread(NamedTuple):
    """State of the surrogate in a rollout of the implicit step; ``before`` holds the roots at the step's
    beginning.
    """

    spread: Spread
    before: np.ndarray
    solved: Solved


@kernel
def _prepare(source, world, work, contacts):
    """Return the initial state; ``source`` has the roots (M, 12, 12) and ``k_sigma``."""
    roots, k_sigma = source
    spread = spread_of(roots, world.bodies.moving, k_sigma)
    return SolvedSpread(spread, np.empty_like(roots), Solved(work.R, records_room(contacts)))


#: Advances the nominal state, its memory, and the roots in place (`rollout_kernel`).
advance_solved_roots = rollout_kernel(_prepare)


@before_step.of(SolvedSpread)
def _drift(method, x, step, world, work):
    """Keep the roots, and multiply them by the transition of the whole step (Eq. 14)."""
    copy_blocks(method.before, method.spread.roots)
    drift_roots(method.spread, x, step, world, work)


@undo_step.of(SolvedSpread)
def _put_back(method, work):
    """The roots are those of the step's beginning."""
    copy_blocks(method.spread.roots, method.before)


@on_sleep.of(SolvedSpread)
def _rest(method, i, work):
    """Give a sleeping body the pose uncertainty of the step's beginning, and certain zero velocities."""
    S, before = method.spread.roots[method.spread.error_block[i]], method.before[method.spread.error_block[i]]
    for r in range(ERROR):
        for c in range(ERROR):
            S[r, c] = 0.0 if EV <= r < EV + 3 or r >= EW else before[r, c]


@after_travel.of(SolvedSpread)
def _push(method, x, count, h, world, work):
    """Let the tilts of the lasting contacts' normals act."""
    _kick(method, LASTING, world, work)


@after_impact.of(SolvedSpread)
def _hit(method, x, count, threshold, world, work):
    """Let the tilts of an impact's normals act."""
    _kick(method, ELASTIC, world, work)


@inner(noinline=True)
def _kick(method, law, world, work):
    """Pair by pair, as `surrogate_contacts` does of the explicit step's contacts."""
    spread, solved, c = method.spread, method.solved, 0
    while c < work.counts[CONTACTS]:
        i, j = work.ids[c, 0], work.ids[c, 1]
        found, c = record_pair(c, law, world, work, solved)
        if found == 0:
            continue
        spread.tilt[:] = 0.0
        spread.torque[:] = 0.0
        for body in (i, j):
            if world.bodies.moving[body] and not spread.known[body]:
                root = spread.roots[spread.error_block[body]]
                cache_pose_covariance(root, solved.R[body], body, spread)
        add_tilts((i, j), found, spread.k_sigma, world.tree, solved, spread)
        for side, body in ((0, i), (1, j)):
            if world.bodies.moving[body]:
                root = spread.roots[spread.error_block[body]]
                kick_root(root, world, solved.R[body], body, spread, side)
