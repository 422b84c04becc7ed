"""Record contacts of the implicit step in the explicit step's format, for the surrogate and local sampling.

The equations of both methods take contact forces ``kappa V n``. A solved contact gets the volume
``lambda / (kappa dt)``, whose force has the contact's impulse in one step. Lasting contacts that stick are
left out, because friction balances the tangential force of a tilted normal. `friction.sticks` decides.
"""

from typing import NamedTuple

import numpy as np

from ..collision.contact_row import DIRECTION, GAP
from ..collision.implicit_workspace import CONTACTS, LASTING
from ..collision.narrow_phase import DISTANCE, NORMAL, RECORD, VOLUME
from ..collision.sphere_tree import Scratch
from ..compiler import inner, kernel
from ..compiler.arrays import empty, integers, small_integers
from ..dynamics.friction import sticks
from ..spatial.layout import ERROR
from ..spatial.rotation import rotate_back


class Solved(NamedTuple):
    """Rotations and contact records that replace the explicit step's workspace.

    Attributes
    ----------
    R : (B, 3, 3) float64
        ``R_world_body``: the implicit workspace's own.
    search : Scratch
        With pairs of spheres and records of contacts.
    """

    R: np.ndarray
    search: Scratch


@kernel
def records_room(contacts):
    """Room for the records of as many contacts of a pair."""
    nothing = small_integers((1, 2))
    return Scratch(nothing, small_integers((contacts, 2)), nothing, integers(1), empty((contacts, RECORD)))


@inner(forceinline=True)
def copy_blocks(into, source):
    """Copy blocks (K, 12, 12) of one array to another: a step's beginning is kept, or put back."""
    for k in range(len(source)):
        for r in range(ERROR):
            for c in range(ERROR):
                into[k, r, c] = source[k, r, c]


@inner(error_model="numpy")
def record_pair(first, law, world, work, solved):
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
            record, a, b = solved.search.records[found], ids[c, 2], ids[c, 3]
            n = rotate_back(solved.R[i], -row[DIRECTION], -row[DIRECTION + 1], -row[DIRECTION + 2])
            record[NORMAL], record[NORMAL + 1], record[NORMAL + 2] = n[0], n[1], n[2]
            record[DISTANCE] = row[GAP] + world.tree.radii[a] + world.tree.radii[b]
            record[VOLUME] = impulses[c, 0] / (world.stiffness * world.dt)
            solved.search.pairs[found, 0], solved.search.pairs[found, 1] = a, b
            found += 1
        c += 1
    return found, c
