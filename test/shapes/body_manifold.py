"""Contacts of two bodies of several pieces, to be compared with their outlines."""

import math

from unc_physics.compiler import inner, kernel
from unc_physics.compiler.arrays import empty
from unc_physics.shapes.columns import (
    CONTACT,
    FACE_OF,
    FACE_OF_A,
    FACE_OF_B,
    HALF_SPACE,
    KIND,
    NO_FACE,
    NORMAL,
    OWNER,
    PIECE_A,
    PIECE_B,
    POLYGON,
    POSITION,
    RADIUS,
)
from unc_physics.shapes.manifold import _DEEPER, load_point, manifold_of_pieces, reduce, write_contact
from unc_physics.shapes.nearest import nearest
from unc_physics.shapes.support import center, gap_along
from unc_physics.spatial.vectors import dot, minus, plus, times, triple

#: Most contacts of two bodies: a bowl in a bowl needs about 24.
MOST_OF_BODIES = 32
_GHOST = 1e-4  # another pair's normal that parts two pieces up to this depth replaces their own [m]
_ALIKE = 2e-4  # 1 - cosine of normals of which one stands for both (1.1 degrees)
#: Columns of a pair of pieces that are near each other: gap, pieces, normal, nearest points, and whether its
#: normal stands for others.
_NEAR_GAP, _NEAR_A, _NEAR_B, _NEAR_NORMAL, _NEAR_P, _NEAR_Q, _STANDS = 0, 1, 2, 3, 6, 9, 12
NEAR = 13
#: Contacts of two bodies before they are reduced, and pairs of pieces near each other.
_CANDIDATES, _NEAR_PAIRS = 192, 512


@inner
def _sort(near, count):
    """Sort pairs of pieces by their gaps."""
    for c in range(1, count):
        k = c
        while k > 0 and near[k - 1, _NEAR_GAP] > near[k, _NEAR_GAP]:
            for j in range(NEAR):
                near[k, j], near[k - 1, j] = near[k - 1, j], near[k, j]
            k -= 1


@inner
def _parting_normal(near, c, count, base, frames, pieces, rows):
    """Return a nearer pair's normal that also parts pair c, or its own; and whether it is its own.

    At the seam of two pieces of one surface, a third piece is nearest to an edge that is none of the body.
    The normal of the surface parts it from both pieces.
    """
    gap, a, b, n = (
        near[c, _NEAR_GAP],
        int(near[c, _NEAR_A]),
        int(near[c, _NEAR_B]),
        triple(near[c], _NEAR_NORMAL),
    )
    for k in range(count):
        e = triple(near[k], _NEAR_NORMAL)
        nearer = near[k, _STANDS] > 0.0 if k < c else (k > c and near[k, _NEAR_GAP] < gap + _GHOST)
        if nearer and dot(e, n) < 1.0 - 1e-9:
            if gap_along(a, b, e, base, frames, pieces, rows) > min(near[k, _NEAR_GAP], 0.0) - _GHOST:
                return e, False
    return n, True


@inner
def contacts_of_bodies(i, j, far, lean, base, frames, pieces, rows, first, near, work, polygons, out):
    """Write the contacts of two bodies with gaps of at most ``far``; return number and least gap.

    The number is at most 32. It is -1 where `near` has no room for all pairs of pieces that are near.
    """
    count, least = 0, math.inf
    for pa in range(first[i], first[i + 1]):
        for pb in range(first[j], first[j + 1]):
            a, b = (pb, pa) if pieces[pb, KIND] == HALF_SPACE else (pa, pb)
            n = (0.0, 0.0, 1.0)
            if pieces[a, KIND] != HALF_SPACE:
                away = minus(center(b, base, frames, pieces), center(a, base, frames, pieces))
                length = math.sqrt(dot(away, away))
                if length - pieces[a, RADIUS] - pieces[b, RADIUS] > far:
                    continue
                n = times(1.0 / length, away) if length > 0.0 else n
            gap, n, p, q = nearest(a, b, n, False, far, base, frames, pieces, rows, work)
            least = min(least, gap)
            if gap > far:
                continue
            if count == len(near):
                return -1, least
            near[count, _NEAR_GAP], near[count, _NEAR_A], near[count, _NEAR_B] = gap, a, b
            for k in range(3):
                near[count, _NEAR_NORMAL + k], near[count, _NEAR_P + k] = n[k], p[k]
                near[count, _NEAR_Q + k] = q[k]
            near[count, _STANDS] = 1.0
            count += 1
    _sort(near, count)
    end = 0
    for c in range(count):
        a, b, gap = int(near[c, _NEAR_A]), int(near[c, _NEAR_B]), near[c, _NEAR_GAP]
        n, own = _parting_normal(near, c, count, base, frames, pieces, rows)
        for k in range(3):
            near[c, _NEAR_NORMAL + k] = n[k]
        for k in range(c):
            if near[k, _STANDS] > 0.0 and dot(triple(near[k], _NEAR_NORMAL), n) > 1.0 - _ALIKE:
                near[c, _STANDS] = 0.0
                break
        written, lowest, _ = manifold_of_pieces(
            a, b, n, False, far, lean, base, frames, pieces, rows, polygons, out, end
        )
        if (
            own
            and pieces[a, KIND] != HALF_SPACE
            and (written == 0 or lowest > gap + _DEEPER)
            and end + written < len(out)
        ):
            middle = times(0.5, plus(triple(near[c], _NEAR_P), triple(near[c], _NEAR_Q)))
            write_contact(out, end + written, middle, gap, n, a, b, NO_FACE)
            written += 1
        end += written
    if end > MOST_OF_BODIES:
        a, b = int(out[0, PIECE_A]), int(out[0, PIECE_B])
        load = load_point(a, b, triple(out[0], NORMAL), lean, base, frames, pieces)
        end = reduce(out, 0, end, MOST_OF_BODIES, lean, load)
    for k in range(end):  # normals point from body i to body j
        if int(pieces[int(out[k, PIECE_A]), OWNER]) != i:
            for c in range(3):
                out[k, NORMAL + c] = -out[k, NORMAL + c]
            out[k, PIECE_A], out[k, PIECE_B] = out[k, PIECE_B], out[k, PIECE_A]
            if out[k, FACE_OF] != NO_FACE:
                out[k, FACE_OF] = FACE_OF_A + FACE_OF_B - out[k, FACE_OF]
    return end, least


@kernel
def manifold_of_bodies(frames, pieces, rows, first, far, lean):
    """Return the contacts (n, CONTACT) of two bodies, relative to the first one's frame, and the gap."""
    near, out = empty((_NEAR_PAIRS, NEAR)), empty((_CANDIDATES, CONTACT))
    work, polygons = empty((12, 3)), empty((3, POLYGON, 3))
    base = triple(frames[0], POSITION)
    count, gap = contacts_of_bodies(
        0, 1, far, (lean[0], lean[1], lean[2]), base, frames, pieces, rows, first, near, work, polygons, out
    )
    return out[: max(count, 0)].copy(), gap
