"""Parts of a group: bodies that its current contacts connect."""

from ..compiler import inner
from .contact_row import GAP, TORSION_ROW
from .contact_search import join, lowest
from .implicit_workspace import CONTACTS


@inner
def find_parts(limit, work):
    """Label bodies in ``work.part`` with negative numbers, equal for bodies connected by contacts.

    Only contacts with a gap of at most ``limit`` count. Bodies that do not move freely connect nothing.
    """
    part, rows, ids, moving = work.part, work.rows, work.ids, work.moving
    for i in range(len(part)):
        part[i] = i
    for c in range(work.counts[CONTACTS]):
        j = ids[c, 1]
        if rows[c, GAP] <= limit and j >= 0 and moving[j]:
            join(part, ids[c, 0], j)
    for i in range(len(part)):
        part[i] = lowest(part, i)
    for i in range(len(part)):
        part[i] = -1 - part[i]


@inner
def mark_part(i, part):
    """Make the label of body i positive, for all bodies with the same label."""
    label = part[i]
    for k in range(len(part)):
        if part[k] == label:
            part[k] = -label


@inner
def move_contact(c, to, work):
    """Move a current contact to another index of the list."""
    if c == to:
        return
    rows, ids, torsion_rows = work.rows, work.ids, work.torsion_rows
    for k in range(rows.shape[1]):
        rows[to, k] = rows[c, k]
    for k in range(4):
        ids[to, k] = ids[c, k]
    if len(torsion_rows) > 0:
        for k in range(TORSION_ROW):
            torsion_rows[to, k] = torsion_rows[c, k]
