"""Candidates of contacts: what a search writes before few are chosen."""

from ..compiler import inner
from .implicit_workspace import (
    CANDIDATE_GAP,
    CANDIDATE_NORMAL,
    CANDIDATE_POINT,
    CANDIDATE_SCORE,
    OVERFLOW,
    TOO_MANY_CANDIDATES,
)

#: State of a candidate that is not yet in a patch.
UNASSIGNED = 0


@inner(forceinline=True)
def keep_candidate(count, normal, center, r, gap, score, a, b, work):
    """Store spheres a and b as candidate number ``count``; return the new count, or 0 without room.

    The contact is at the distance ``r`` from ``center``, against the normal. Both belong to sphere a, or to
    the outline of a face (`face_outlines`).
    """
    if count >= len(work.candidates):
        work.counts[OVERFLOW] = TOO_MANY_CANDIDATES
        return 0
    out, ids = work.candidates[count], work.candidate_ids[count]
    for k in range(3):
        out[CANDIDATE_NORMAL + k], out[CANDIDATE_POINT + k] = normal[k], center[k] - r * normal[k]
    out[CANDIDATE_GAP], out[CANDIDATE_SCORE] = gap, score
    ids[0], ids[1], ids[2], ids[3] = a, b, UNASSIGNED, -1
    return count + 1


@inner(forceinline=True)
def partner_sphere(b, radii):
    """Return the sphere of the second body from the number ``b`` of a contact.

    Contacts of outlines have higher numbers, so that no two contacts of the same bodies have the same.
    """
    return b % len(radii)
