"""Contacts that the implicit step solved, on record as the explicit step's are: what the surrogate and local
sampling read.

Their equations are over forces ``kappa V n``; a solved contact's volume is that which makes its impulse in a
step, ``lambda / (kappa dt)``. A lasting contact that does not slip is left out: friction holds what the tilt
of its normal would let go.
"""

from typing import NamedTuple

import numpy as np

from ..physics.arrays import empty, integers, small_integers
from ..physics.compiled import inner, kernel
from ..physics.contact_row import DIRECTION, FRICTION, GAP
from ..physics.implicit_workspace import CONTACTS, LASTING
from ..physics.layout import ERROR
from ..physics.narrow_phase import DISTANCE, NORMAL, RECORD, VOLUME
from ..physics.rotation import rotate_back
from ..physics.sphere_tree import Scratch

_AT_LIMIT = 1.0 - 1e-9  # of what friction can hold


class Solved(NamedTuple):
    """What stands in the place of the explicit step's workspace.

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


@inner
def sticks(row, impulse):
    """Whether friction holds a contact."""
    limit = _AT_LIMIT * row[FRICTION] * impulse[0]
    return impulse[1] * impulse[1] + impulse[2] * impulse[2] < limit * limit


@inner(error_model="numpy")
def record_pair(first, law, world, work, solved):
    """Put the contacts of one pair of bodies on record, from row ``first`` on.

    Returns
    -------
    found : int
        How many are on record: those between bodies with an impulse.
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
