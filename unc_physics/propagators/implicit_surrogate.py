"""The surrogate on the implicit step: Eqs. 11 to 24 over the contacts that `solved_contacts` records."""

from ..compiler import kernel
from ..dynamics.implicit_rollout import rollout_kernel
from ..spatial.layout import ERROR, EV, EW
from . import solved_contacts
from .surrogate_contacts import Spread, add_tilts, cache_pose_covariance, drift_roots, kick_root, spread_of


@kernel
def _prepare(source, world, work, room):
    """Return the initial state; ``source`` has the roots (M, 12, 12) and ``k_sigma``."""
    roots, k_sigma = source
    return solved_contacts.solved(spread_of(roots, world.bodies.moving, k_sigma), roots, work, room)


#: Advances the nominal state, its memory, and the roots in place (`rollout_kernel`).
advance_solved_roots = rollout_kernel(_prepare)


@solved_contacts.drift.of(Spread)
def _drift(spread, x, step, world, work):
    """Multiply the roots by the transition of the whole step (Eq. 14)."""
    drift_roots(spread, x, step, world, work)


@solved_contacts.stop.of(Spread)
def _stop(spread, root):
    """Clear the rows of the velocities."""
    for r in range(ERROR):
        if EV <= r < EV + 3 or r >= EW:
            for c in range(ERROR):
                root[r, c] = 0.0


@solved_contacts.push_pair.of(Spread)
def _push_pair(spread, i, j, count, world, contacts):
    """Let the tilts of the normals act."""
    spread.tilt[:] = 0.0
    spread.torque[:] = 0.0
    for body in (i, j):
        if world.bodies.moving[body] and not spread.known[body]:
            cache_pose_covariance(spread.roots[spread.error_block[body]], contacts.R[body], body, spread)
    add_tilts((i, j), count, spread.k_sigma, world.tree, contacts, spread)
    for side, body in ((0, i), (1, j)):
        if world.bodies.moving[body]:
            kick_root(spread.roots[spread.error_block[body]], world, contacts.R[body], body, spread, side)
