"""The surrogate and local sampling on the implicit step, over contacts in the explicit step's format.

The equations of both methods take contact forces ``kappa V n``. A solved contact gets the volume
``lambda / (kappa dt)``, whose force has the contact's impulse in one step. Lasting contacts that stick are
left out, because friction balances the tangential force of a tilted normal. `friction.sticks` decides.

Both methods carry one block (12, 12) of a covariance, or of its root, for each moving body. Stages add the
work of each method on its own state: `drift`, `begin_impact`, `push_pair`, and `stop`.
"""

from typing import Any, NamedTuple

import numpy as np

from ..collision.contact_candidates import partner_sphere
from ..collision.contact_row import DIRECTION, GAP
from ..collision.implicit_workspace import CONTACTS, ELASTIC, LASTING
from ..collision.narrow_phase import DISTANCE, NORMAL, RECORD, VOLUME
from ..collision.sphere_tree import Scratch
from ..compiler import inner, kernel, stage
from ..compiler.arrays import empty, integers, small_integers
from ..dynamics.friction import sticks
from ..dynamics.implicit_stages import after_impact, after_travel, before_step, on_sleep, undo_step
from ..spatial.layout import ERROR
from ..spatial.rotation import rotate_back


class SolvedContacts(NamedTuple):
    """Rotations and contact records that replace the explicit step's workspace."""

    R: np.ndarray  # (B, 3, 3) float64: ``R_world_body``: the implicit workspace's own
    search: Scratch  # with pairs of spheres and records of contacts


class Solved(NamedTuple):
    """State of one of the two methods in a rollout of the implicit step."""

    own: Any  # what it has on the explicit step, too
    blocks: np.ndarray  # (M, 12, 12) float64: of the moving bodies, advanced in place
    before: np.ndarray  # (M, 12, 12) float64: those of the step's beginning
    contacts: SolvedContacts


@kernel
def solved(own, blocks, work, room):
    """Return the initial state, with room for the records of as many contacts of a pair."""
    nothing = small_integers((1, 2))
    search = Scratch(nothing, small_integers((room, 2)), nothing, integers(1), empty((room, RECORD)))
    return Solved(own, blocks, np.empty_like(blocks), SolvedContacts(work.R, search))


@stage
def drift(own, x, step, world, work):
    """Take all blocks through the transition of the whole step."""


@stage
def begin_impact(own):
    """Prepare for the contacts of an impact."""


@stage
def push_pair(own, i, j, count, world, contacts):
    """Let the uncertainty of the recorded contacts of bodies i and j act."""


@stage
def stop(own, block):
    """Make a body's velocities certain in its block: they are zero."""


@before_step.of(Solved)
def _drift(method, x, step, world, work):
    _copy_blocks(method.before, method.blocks)
    drift(method.own, x, step, world, work)


@undo_step.of(Solved)
def _put_back(method, work):
    _copy_blocks(method.blocks, method.before)


@on_sleep.of(Solved)
def _rest(method, i, work):
    """Restore a sleeping body's block of the beginning of the step, with certain zero velocities."""
    block = method.own.error_block[i]
    for r in range(ERROR):
        for c in range(ERROR):
            method.blocks[block, r, c] = method.before[block, r, c]
    stop(method.own, method.blocks[block])


@after_travel.of(Solved)
def _push(method, world, work):
    _push_pairs(method, LASTING, world, work)


@after_impact.of(Solved)
def _hit(method, world, work):
    begin_impact(method.own)
    _push_pairs(method, ELASTIC, world, work)


@inner(noinline=True)
def _push_pairs(method, law, world, work):
    """Let the uncertainty of all contacts act, pair by pair."""
    c = 0
    while c < work.counts[CONTACTS]:
        i, j = work.ids[c, 0], work.ids[c, 1]
        found, c = _record_pair(c, law, world, work, method.contacts)
        if found > 0:
            push_pair(method.own, i, j, found, world, method.contacts)


@inner(forceinline=True)
def _copy_blocks(into, source):
    """Copy blocks (K, 12, 12) of one array to another: a step's beginning is kept, or put back."""
    for k in range(len(source)):
        for r in range(ERROR):
            for c in range(ERROR):
                into[k, r, c] = source[k, r, c]


@inner(error_model="numpy")
def _record_pair(first, law, world, work, contacts):
    """Record the contacts of one pair of bodies, from row ``first`` on.

    Contacts with the environment, without an impulse, and lasting contacts that stick are left out.

    Returns
    -------
    found : int
        Number of recorded contacts.
    last : int
        The row after the pair's.
    """
    ids, rows, impulses = work.ids, work.rows, work.impulses[law]
    i, j, found, c = ids[first, 0], ids[first, 1], 0, first
    while c < work.counts[CONTACTS] and ids[c, 0] == i and ids[c, 1] == j:
        row = rows[c]
        if j >= 0 and impulses[c, 0] > 0.0 and not (law == LASTING and sticks(row, impulses[c])):
            record, a = contacts.search.records[found], ids[c, 2]
            b = partner_sphere(ids[c, 3], world.tree.radii)
            n = rotate_back(contacts.R[i], -row[DIRECTION], -row[DIRECTION + 1], -row[DIRECTION + 2])
            record[NORMAL], record[NORMAL + 1], record[NORMAL + 2] = n[0], n[1], n[2]
            record[DISTANCE] = row[GAP] + world.tree.radii[a] + world.tree.radii[b]
            record[VOLUME] = impulses[c, 0] / (world.stiffness * world.dt)
            contacts.search.pairs[found, 0], contacts.search.pairs[found, 1] = a, b
            found += 1
        c += 1
    return found, c
