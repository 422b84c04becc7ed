"""The search: which pieces of which bodies may touch within a step.

For each pair of bodies that come near each other a list of their pieces that may meet soon is kept until the
bodies have travelled too far. What is kept from step to step only saves work: it never changes what is found,
except for the contacts themselves, so that a rollout that is cut in two gives the same bits.
"""

import math
from typing import NamedTuple

import numpy as np

from ...compiler import inner, kernel
from ...compiler.arrays import empty, integers, zeros
from ...shapes.columns import (
    CENTER,
    CONTACT,
    FIRST_POINT,
    HALF_EXTENT,
    HALF_SPACE,
    HULL,
    KIND,
    LAST_POINT,
    NO_FACE,
    OWNER,
    POLYGON,
)
from ...shapes.columns import GAP as FOUND_GAP
from ...shapes.columns import NORMAL as FOUND_NORMAL
from ...shapes.columns import POINT as FOUND_POINT
from ...shapes.columns import RADIUS as PIECE_RADIUS
from ...shapes.hollow import touch_hollow
from ...shapes.manifold import contacts_of_pieces, load_point, manifold_of_pieces, reduce, write_contact
from ...shapes.nearest import above_half_space, half_space, nearest
from ...shapes.support import best_face, gap_along, unit
from ...spatial.rotation import cross
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ACCEL,
    CENTRE,
    DRIFT,
    DRIVEN,
    FACES,
    FIRST,
    FRAME,
    GAP0,
    GHOST,
    HALF,
    IMASS,
    L_A,
    L_B,
    L_CLEAR,
    L_HOLDS,
    L_KEY,
    L_NUMBER,
    L_PARTED,
    LAST,
    LIST,
    LISTS,
    MARGIN,
    MIDDLE,
    MOST,
    N_A,
    N_B,
    N_ENTRY,
    N_GAP,
    N_HOW,
    N_NORMAL,
    N_ORDER,
    N_P,
    N_Q,
    N_REACH,
    NEARS,
    NORMAL,
    OTHERS,
    OWN,
    PAIR,
    PARTED,
    PATCH,
    PIECE_A,
    PIECE_B,
    RADIUS,
    REACH,
    ROT,
    SEARCHES,
    SHOVE,
    SLOP,
    SLOW,
    SOME,
    SPIN,
    SURE,
    SURGE,
    TRAVEL,
    VEL,
    WHERE,
)
from .motion import back, turn, write

FULL = -1  # instead of a number: there was no room for all
_ALIKE = 2e-4  # 1 - cosine of normals of which one stands for both: 1.1 degrees, .2 mm over 1 cm
_STRAIGHT = 1e-6  # squared sine up to which contacts are on one line: .1 mm off a line of .1 m


class Solids(NamedTuple):
    """Pieces of all bodies (`shapes.columns`), and what a step adds to each (`columns.SPOT`)."""

    pieces: np.ndarray
    rows: np.ndarray
    spots: np.ndarray


class Search(NamedTuple):
    """What the search works with."""

    pairs: np.ndarray  # (nb, nb, PAIR)
    order: np.ndarray  # (2, nb) int64: bodies along x; those that do not move freely
    lists: np.ndarray  # (L + 1, rooms + 1, LIST); the last one is scratch
    near: np.ndarray  # (rooms, NEARS): pairs of pieces of a pair of bodies
    out: np.ndarray  # (rooms, CONTACT): their contacts
    frame: (
        np.ndarray
    )  # (3 + SURE, 4): axes of one body in those of the other; normals that may stand for others
    work: np.ndarray  # (12, 3) and
    polygons: np.ndarray  # (3, POLYGON, 3): scratch of `shapes`


@kernel
def search_scratch(bodies, room):
    """Return a new `Search` with a number of rows of its lists, near pairs and contacts."""
    order = integers((2, bodies))
    for i in range(bodies):
        order[0, i] = i
    return Search(
        zeros((bodies, bodies, PAIR)),
        order,
        zeros((min(bodies * bodies, LISTS) + 1, room + 1, LIST)),
        empty((room, NEARS)),
        empty((room + POLYGON, CONTACT)),
        empty((3 + SURE, 4)),
        empty((12, 3)),
        empty((3, POLYGON, 3)),
    )


@inner
def forget_all(search):
    """Make a `Search` fit for another rollout."""
    pairs, lists = search.pairs, search.lists
    for a in range(len(pairs)):
        search.order[0, a] = a
        for b in range(len(pairs)):
            for x in range(pairs.shape[2]):
                pairs[a, b, x] = 0.0
    for k in range(len(lists)):
        lists[k, 0, L_KEY] = 0.0


@inner
def place(i, Y, solids):
    """Fill the centres of the bounding spheres of body i's pieces in the world."""
    start = three(Y, i, FRAME)
    for p in range(int(Y[i, FIRST]), int(Y[i, LAST])):
        write(solids.spots, p, WHERE, plus(start, turn(Y, i, ROT, three(solids.pieces, p, CENTER))))


@inner
def _from_box(Y, i, p, r):
    """Return a lower bound of the gap of a sphere and a body's box."""
    e = minus(back(Y, i, minus(p, three(Y, i, FRAME))), three(Y, i, MIDDLE))
    out = 0.0
    for k in range(3):
        over = max(abs(e[k]) - Y[i, HALF + k], 0.0)
        out += over * over
    return math.sqrt(out) - r


@inner
def _bound(Y, a, b, pa, pb, solids, search):
    """Return a lower bound of the gap of two pieces: that of their boxes."""
    pieces, R = solids.pieces, search.frame
    d = minus(three(solids.spots, pb, WHERE), three(solids.spots, pa, WHERE))
    if pieces[pa, KIND] == HALF_SPACE:
        n = half_space(pa, (0.0, 0.0, 0.0), Y, pieces, solids.rows)[1]
        return dot(d, n) - pieces[pb, PIECE_RADIUS]
    e, f, gap = back(Y, a, d), back(Y, b, d), -math.inf
    for i in range(3):
        own = abs(e[i]) - pieces[pa, HALF_EXTENT + i]
        other = abs(f[i]) - pieces[pb, HALF_EXTENT + i]
        for k in range(3):
            own -= abs(R[i, k]) * pieces[pb, HALF_EXTENT + k]
            other -= abs(R[k, i]) * pieces[pa, HALF_EXTENT + k]
        gap = max(gap, own, other)
    return gap


@inner(noinline=True)
def _neighbours(a, b, far, travel, Y, solids, search):
    """Return the slot of the list of two bodies' pieces that may come near soon; `FULL` if there is no room.

    It is made anew when the bodies have travelled too far. What the old list knew of two pieces goes into the
    new one; both are sorted by pieces.
    """
    pieces, spots, lists = solids.pieces, solids.spots, search.lists
    slots, bodies = len(lists) - 1, len(search.pairs)
    slot, key = (a * bodies + b) % slots, a * bodies + b + 1.0
    L, was = lists[slot], lists[slots]
    same = L[0, L_KEY] == key
    if same and travel + far <= L[0, L_HOLDS]:
        return slot
    old = int(L[0, L_NUMBER]) if same else 0
    for k in range(1, old + 1):
        for x in range(lists.shape[2]):
            was[k, x] = L[k, x]
    wide, few, n, k = 2.0 * far + MARGIN, 0, 0, 1
    for pb in range(int(Y[b, FIRST]), int(Y[b, LAST])):  # those near the other body's box
        if _from_box(Y, a, three(spots, pb, WHERE), pieces[pb, PIECE_RADIUS]) <= wide:
            spots[few, SOME] = pb
            few += 1
    for pa in range(int(Y[a, FIRST]), int(Y[a, LAST])):
        if _from_box(Y, b, three(spots, pa, WHERE), pieces[pa, PIECE_RADIUS]) > wide:
            continue
        for c in range(few):
            pb = int(spots[c, SOME])
            d = minus(three(spots, pb, WHERE), three(spots, pa, WHERE))
            r = wide + pieces[pa, PIECE_RADIUS] + pieces[pb, PIECE_RADIUS]
            if dot(d, d) > r * r:
                continue
            gap = _bound(Y, a, b, pa, pb, solids, search)
            if gap > wide:
                continue
            n += 1
            if n == len(L):
                L[0, L_KEY] = 0.0
                return FULL
            L[n, L_A], L[n, L_B], L[n, L_CLEAR] = pa, pb, travel + gap
            write(L, n, L_PARTED, (0.0, 0.0, 0.0))
            while k <= old and (was[k, L_A] < pa or (was[k, L_A] == pa and was[k, L_B] < pb)):
                k += 1
            if k <= old and was[k, L_A] == pa and was[k, L_B] == pb:
                L[n, L_CLEAR] = max(L[n, L_CLEAR], was[k, L_CLEAR])
                write(L, n, L_PARTED, three(was, k, L_PARTED))
    L[0, L_KEY], L[0, L_NUMBER], L[0, L_HOLDS] = key, n, travel + wide
    return slot


@inner
def _closing(Y, a, b, pa, pb, solids):
    """Return the velocity of piece b's centre relative to that of piece a, and the most that spins add."""
    pieces, spots = solids.pieces, solids.spots
    wb, wa = three(Y, b, SPIN), three(Y, a, SPIN)
    u = minus(
        plus(three(Y, b, VEL), cross(wb, minus(three(spots, pb, WHERE), three(Y, b, CENTRE)))),
        three(Y, a, VEL),
    )
    more = math.sqrt(dot(wb, wb)) * pieces[pb, PIECE_RADIUS]
    if dot(wa, wa) > 0.0:
        u = minus(u, cross(wa, minus(three(spots, pa, WHERE), three(Y, a, CENTRE))))
        more += math.sqrt(dot(wa, wa)) * pieces[pa, PIECE_RADIUS]
    return u, more


@inner(noinline=True)
def _candidates(a, b, far, dt, slack, Y, solids, old, first, had, search, count):
    """Write pairs of pieces that may meet within dt; return number, bound of others' gaps, list's slot."""
    travel = Y[a, TRAVEL] + Y[b, TRAVEL]
    slot = _neighbours(a, b, far, travel, Y, solids, search)
    if slot == FULL:
        return FULL, 0.0, slot
    L, near, pieces = search.lists[slot], search.near, solids.pieces
    base = three(Y, b, CENTRE)
    low, m = L[0, L_HOLDS] - travel, 0
    for k in range(1, int(L[0, L_NUMBER]) + 1):
        if travel + far < L[k, L_CLEAR]:
            low = min(low, L[k, L_CLEAR] - travel)
            continue
        pa, pb = int(L[k, L_A]), int(L[k, L_B])
        gap = _bound(Y, a, b, pa, pb, solids, search)
        u, more = _closing(Y, a, b, pa, pb, solids)
        reach = min(far, dt * (math.sqrt(dot(u, u)) + more) + slack)
        n = unit(
            plus(minus(three(solids.spots, pb, WHERE), three(solids.spots, pa, WHERE)), (1e-12, 0.0, 0.0))
        )
        sure = gap
        if gap <= reach:
            count[SEARCHES] += 1
            parted = three(L, k, L_PARTED)
            if pieces[pa, KIND] == HALF_SPACE:
                gap, n, _, _ = above_half_space(pa, pb, base, Y, pieces, solids.rows)
                reach = min(reach, dt * (max(-dot(u, n), 0.0) + more) + slack)
                sure = gap
            elif dot(parted, parted) > 0.0:  # no bound of the speed: what has no memory of it finds the same
                sure = max(gap, gap_along(pa, pb, parted, base, Y, pieces, solids.rows))
        if sure > reach:
            low = min(low, sure)
            L[k, L_CLEAR] = travel + sure
            continue
        known = 0.0
        for j in range(first, first + had):
            if old[j, PIECE_A] == pa and old[j, PIECE_B] == pb:
                if known == 0.0 or old[j, GAP0] < gap:
                    gap = old[j, GAP0]
                n, known = three(old, j, NORMAL), 1.0
        if m == len(near):
            return FULL, 0.0, slot
        near[m, N_GAP], near[m, N_A], near[m, N_B] = gap - known, pa, pb  # those in contact before come first
        near[m, N_HOW], near[m, N_ENTRY], near[m, N_REACH] = known, k, reach
        write(near, m, N_NORMAL, n)
        m += 1
    return m, low, slot


@inner
def _later(near, i, k):
    """Return whether row i comes after row k: by gaps, and equal ones by pieces."""
    for x in (N_GAP, N_A, N_B):
        if near[i, x] != near[k, x]:
            return near[i, x] > near[k, x]
    return False


@inner
def _sink(near, i, m):
    """Let entry i of a heap of m rows, which column N_ORDER lists, sink to where it belongs."""
    while 2 * i + 1 < m:
        k = 2 * i + 1
        if k + 1 < m and _later(near, int(near[k + 1, N_ORDER]), int(near[k, N_ORDER])):
            k += 1
        if not _later(near, int(near[k, N_ORDER]), int(near[i, N_ORDER])):
            return
        near[i, N_ORDER], near[k, N_ORDER] = near[k, N_ORDER], near[i, N_ORDER]
        i = k


@inner(noinline=True)
def _sort(near, m):
    """Order pairs of pieces by their gaps; equal ones by pieces."""
    for c in range(m):
        near[c, N_ORDER] = c
    for c in range(m // 2 - 1, -1, -1):
        _sink(near, c, m)
    for c in range(m - 1, 0, -1):
        near[0, N_ORDER], near[c, N_ORDER] = near[c, N_ORDER], near[0, N_ORDER]
        _sink(near, 0, c)
    for c in range(m):
        k = int(near[c, N_ORDER])
        while k < c:  # swapped away
            k = int(near[k, N_ORDER])
        for x in range(near.shape[1] if k > c else 0):
            if x != N_ORDER:
                near[c, x], near[k, x] = near[k, x], near[c, x]


@inner
def _has_room(k, p, solids, search):
    """Return whether there is room for all contacts of piece p, unreduced, after the first k."""
    points = int(solids.pieces[p, LAST_POINT]) - int(solids.pieces[p, FIRST_POINT])
    return k + max(POLYGON, points) < len(search.out)


@inner
def _gap_level(a, b, n, least, base, Y, pieces, rows):
    """Return the gap of two pieces along others' normal n, and n, or the normal of a's face level with it.

    The normal of a small body's face is a little off that of a long piece, whose far end may rise along it.
    """
    gap = gap_along(a, b, n, base, Y, pieces, rows)
    if gap > least or pieces[a, KIND] != HULL:
        return gap, n
    i = int(pieces[a, OWNER])
    k = best_face(pieces[a], rows, back(Y, i, n))
    if k < 0:
        return gap, n
    e = turn(Y, i, ROT, three(rows, k, 0))
    return (gap_along(a, b, e, base, Y, pieces, rows), e) if dot(e, n) > 1.0 - _ALIKE else (gap, n)


@inner(noinline=True)
def _gaps(m, low, travel, dt, slack, a, b, lean, Y, solids, search, slot):
    """Find gaps and normals of m pairs of pieces; keep the near ones.

    Nearest points are looked for only where no normal found before, of these bodies in this step, parts the
    pieces. Returns the number of near ones, that of contacts written, and a bound of the others' gaps.
    """
    near, out, L, pieces, rows = search.near, search.out, search.lists[slot], solids.pieces, solids.rows
    _sort(near, m)
    base = three(Y, b, CENTRE)
    k, kept, sure = 0, 0, 0
    for c in range(m):
        pa, pb, n, known = (
            int(near[c, N_A]),
            int(near[c, N_B]),
            three(near, c, N_NORMAL),
            near[c, N_HOW] > 0.0,
        )
        entry, reach = int(near[c, N_ENTRY]), near[c, N_REACH]
        gap, how, p, q = -math.inf, OWN, n, n
        if pieces[pa, KIND] == HALF_SPACE:
            gap = near[c, N_GAP] + near[c, N_HOW]
        else:
            for i in range(sure):
                least = min(search.frame[3 + i, 3], 0.0) - GHOST
                t, e = _gap_level(pa, pb, three(search.frame, 3 + i, 0), least, base, Y, pieces, rows)
                if t > least:
                    n, gap, how = e, t, OTHERS
                    break
            if how == OWN and known:
                if not _has_room(k, pb, solids, search):
                    return FULL, 0, 0.0
                done, gap, n = manifold_of_pieces(
                    pa, pb, n, True, reach, lean, base, Y, pieces, rows, search.polygons, out, k
                )
                if done > 0:
                    k += done
                    how = FACES
            if how == OWN:
                gap, n, p, q = nearest(pa, pb, n, known, reach, base, Y, pieces, rows, search.work)
                if gap <= reach and not known:
                    u, more = _closing(Y, a, b, pa, pb, solids)
                    reach = min(reach, dt * (max(-dot(u, n), 0.0) + more) + slack)
            if gap > reach:
                low = min(low, gap)
                L[entry, L_CLEAR] = travel + gap
                write(L, entry, L_PARTED, n)
                continue
            if how != OTHERS and sure < SURE:
                write(search.frame, 3 + sure, 0, n)
                search.frame[3 + sure, 3] = gap
                sure += 1
        near[kept, N_GAP], near[kept, N_A], near[kept, N_B] = gap, pa, pb
        near[kept, N_HOW], near[kept, N_REACH] = how, reach
        write(near, kept, N_NORMAL, n)
        write(near, kept, N_P, p)
        write(near, kept, N_Q, q)
        kept += 1
    return kept, k, low


@inner
def _parting_normal(c, m, base, Y, solids, search):
    """Return a nearer pair's normal that parts the pieces of pair c too, or its own; whether it is its own.

    At the seam of two pieces of one surface, a third piece is nearest to an edge that is none of the body.
    """
    near = search.near
    gap, pa, pb, n = near[c, N_GAP], int(near[c, N_A]), int(near[c, N_B]), three(near, c, N_NORMAL)
    for j in range(m):
        e = three(near, j, N_NORMAL)
        nearer = near[j, N_ENTRY] > 0.0 if j < c else (j > c and near[j, N_GAP] < gap + GHOST)
        if near[j, N_HOW] != OTHERS and nearer and dot(e, n) < 1.0 - 1e-9:
            least = min(near[j, N_GAP], 0.0) - GHOST
            t, e = _gap_level(pa, pb, e, least, base, Y, solids.pieces, solids.rows)
            if t > least:
                write(near, c, N_NORMAL, e)
                return e, False
    return n, True


@inner(noinline=True)
def _touching(m, k, b, lean, Y, solids, search):
    """Write the contacts of m pairs of pieces with known gaps, after the first k; return how many."""
    near, out, pieces, rows = search.near, search.out, solids.pieces, solids.rows
    base = three(Y, b, CENTRE)
    _sort(near, m)
    for c in range(m):
        gap, pa, pb, n = near[c, N_GAP], int(near[c, N_A]), int(near[c, N_B]), three(near, c, N_NORMAL)
        # from here on: whether it stands for its normal; it does not for that of others, with which a pair
        # may come in that is too far, if nothing is known of it
        near[c, N_ENTRY], reach = 0.0 if near[c, N_HOW] == OTHERS else 1.0, near[c, N_REACH]
        if near[c, N_HOW] == FACES:
            continue
        own = near[c, N_HOW] == OWN and pieces[pa, KIND] != HALF_SPACE
        if own:
            n, own = _parting_normal(c, m, base, Y, solids, search)
        for j in range(c):  # seen before
            if near[j, N_ENTRY] > 0.0 and dot(three(near, j, N_NORMAL), n) > 1.0 - _ALIKE:
                near[c, N_ENTRY] = 0.0
                break
        if not _has_room(k, pb, solids, search):
            return FULL
        done, deep, _ = manifold_of_pieces(
            pa, pb, n, False, reach, lean, base, Y, pieces, rows, search.polygons, out, k
        )
        if own and (done == 0 or deep > gap + GHOST):
            middle = times(0.5, plus(three(near, c, N_P), three(near, c, N_Q)))
            write_contact(out, k + done, middle, gap, n, pa, pb, NO_FACE)
            done += 1
        k += done
    return k


@inner
def _extreme(first, end, out):
    """Drop contacts between two others, which carry its load, as of a can on its rims; return the end."""
    k = first
    while k < end:
        p, dropped = three(out, k, FOUND_POINT), False
        for i in range(first, end):
            for j in range(first, i):
                d, e = minus(p, three(out, i, FOUND_POINT)), minus(three(out, j, FOUND_POINT), p)
                c, deepest = cross(d, e), min(out[i, FOUND_GAP], out[j, FOUND_GAP])
                if dot(d, e) > 0.0 and dot(c, c) < _STRAIGHT * dot(d, d) * dot(e, e):
                    dropped = dropped or out[k, FOUND_GAP] >= deepest - SLOP
        if dropped:
            for j in range(k + 1, end):
                for x in range(CONTACT):
                    out[j - 1, x] = out[j, x]
            end -= 1
        else:
            k += 1
    return end


@inner(noinline=True)
def _patches(k, lean, a, b, Y, solids, out):
    """Keep few of k contacts along one normal, whatever pieces they are of; return how many are left.

    Four carry what more would carry too: the deepest, the one where the load leaves, the farthest, and one
    beyond the side over which the load would tip first.
    """
    base = three(Y, b, CENTRE)
    pa, pb = int(Y[a, FIRST]), int(Y[b, FIRST])
    first = 0
    while first < k:
        n, end = three(out, first, FOUND_NORMAL), first + 1
        for j in range(end, k):
            if dot(three(out, j, FOUND_NORMAL), n) > 1.0 - _ALIKE:
                for x in range(CONTACT if j > end else 0):
                    out[j, x], out[end, x] = out[end, x], out[j, x]
                end += 1
        load = load_point(pa, pb, n, lean, base, Y, solids.pieces)
        kept = _extreme(first, reduce(out, first, end, PATCH, lean, load), out)
        if kept < end:
            for j in range(end, k):
                for x in range(CONTACT):
                    out[kept + j - end, x] = out[j, x]
        first, k = kept, k - (end - kept)
    return k


@inner
def _leaning(Y, a, b):
    """Return where the load of a contact moves: along the velocity at which b slides, or with its forces."""
    u = minus(three(Y, b, VEL), three(Y, a, VEL))
    return u if dot(u, u) > SLOW * SLOW else three(Y, b, ACCEL)


@inner(noinline=True)
def meet(a, b, far, dt, slack, Y, solids, old, first, had, search, count):
    """Write the contacts of two bodies, relative to the centre of mass of b.

    Returns their number and, without any, a lower bound of the gap.
    """
    for i in range(3):
        for k in range(3):
            search.frame[i, k] = (
                Y[a, ROT + i] * Y[b, ROT + k]
                + Y[a, ROT + 3 + i] * Y[b, ROT + 3 + k]
                + Y[a, ROT + 6 + i] * Y[b, ROT + 6 + k]
            )
    lean = _leaning(Y, a, b)
    if Y[a, LAST] - Y[a, FIRST] == 1.0 and Y[b, LAST] - Y[b, FIRST] == 1.0:
        return _meet_one(a, b, far, lean, Y, solids, old, first, had, search, count)
    m, low, slot = _candidates(a, b, far, dt, slack, Y, solids, old, first, had, search, count)
    if m == FULL:
        return FULL, 0.0
    travel = Y[a, TRAVEL] + Y[b, TRAVEL]
    m, k, low = _gaps(m, low, travel, dt, slack, a, b, lean, Y, solids, search, slot)
    if m == FULL:
        return FULL, 0.0
    for c in range(m):
        low = min(low, search.near[c, N_GAP])
    k = _patches(_touching(m, k, b, lean, Y, solids, search), lean, a, b, Y, solids, search.out)
    touch_hollow(0, k, three(Y, b, CENTRE), Y, solids.pieces, solids.rows, search.out)
    return reduce(search.out, 0, k, MOST, lean, (0.0, 0.0, 0.0)), low


@inner(noinline=True)
def _meet_one(a, b, far, lean, Y, solids, old, first, had, search, count):
    """Write the contacts of bodies of one piece each, as `meet`."""
    pieces, rows, pairs = solids.pieces, solids.rows, search.pairs
    pa, pb, base = int(Y[a, FIRST]), int(Y[b, FIRST]), three(Y, b, CENTRE)
    gap = _bound(Y, a, b, pa, pb, solids, search)
    if gap > far:
        return 0, gap
    count[SEARCHES] += 1
    parted = three(pairs[a], b, PARTED)
    if had == 0 and dot(parted, parted) > 0.0:
        gap = gap_along(pa, pb, parted, base, Y, pieces, rows)
        if gap > far:
            return 0, gap
    d = minus(three(solids.spots, pb, WHERE), three(solids.spots, pa, WHERE))
    n = three(old, first + had - 1, NORMAL) if had > 0 else unit(plus(d, (1e-12, 0.0, 0.0)))
    if not _has_room(0, pb, solids, search):
        return FULL, 0.0
    k, gap, n = contacts_of_pieces(
        pa, pb, n, had > 0, far, lean, base, Y, pieces, rows, search.work, search.polygons, search.out, 0
    )
    if k == 0 and pieces[pa, KIND] == HALF_SPACE:
        gap = above_half_space(pa, pb, base, Y, pieces, rows)[0]
    if k == 0:
        write(pairs[a], b, PARTED, n)
    k = _patches(k, lean, a, b, Y, solids, search.out)
    touch_hollow(0, k, three(Y, b, CENTRE), Y, solids.pieces, solids.rows, search.out)
    return k, gap


@inner
def reaches(bodies, dt, Y):
    """Fill how far a point of each body can get within dt; return the most of the scene's ``bodies``."""
    most = 0.0
    for i in range(bodies):
        if Y[i, IMASS] > 0.0:
            v, w = three(Y, i, VEL), three(Y, i, SPIN)
            pace = math.sqrt(dot(v, v)) + Y[i, RADIUS] * math.sqrt(dot(w, w)) + Y[i, SURGE]
            Y[i, REACH] = dt * pace + DRIFT
            most = max(most, Y[i, REACH])
        elif Y[i, DRIVEN] == 0.0:
            Y[i, REACH] = 0.0
    return most


@inner
def _shove(i, j, dt, restitution, Y):
    """Bound what body j gets where body i comes to it within dt; return its reach then, or 0.

    The bound is that of a central impact with the highest restitution of the scene. Only what takes it
    farther than its radius within dt: less puts no body through a wall.
    """
    if Y[j, IMASS] == 0.0:
        return 0.0
    u, d = minus(three(Y, i, VEL), three(Y, j, VEL)), minus(three(Y, j, CENTRE), three(Y, i, CENTRE))
    w = three(Y, i, SPIN)
    pace = math.sqrt(dot(u, u)) + Y[i, RADIUS] * math.sqrt(dot(w, w)) + Y[i, SHOVE]
    r = Y[i, RADIUS] + Y[j, RADIUS] + dt * pace
    speed = (1.0 + restitution) * pace * Y[j, IMASS] / (Y[i, IMASS] + Y[j, IMASS])
    if dt * speed < Y[j, RADIUS] or speed <= Y[j, SHOVE] or dot(d, d) > r * r:
        return 0.0
    Y[j, REACH] += dt * (speed - Y[j, SHOVE])
    Y[j, SHOVE] = speed
    return Y[j, REACH]


@inner(noinline=True)
def shoves(bodies, dt, most, order, restitution, Y):
    """Add to reaches what bodies may get from others that come to them within dt; return the most reach.

    Bodies are looked at along x and back, so that a row of them hands a shove on.
    """
    fast = False
    for i in range(len(Y)):
        Y[i, SHOVE] = 0.0
        fast = fast or (i < bodies and 4.0 * most > Y[i, RADIUS])
    if not fast:
        return most
    for way in range(2):
        for k in range(bodies):
            a = order[0, k if way == 0 else bodies - 1 - k]
            for m in range(k + 1, bodies):
                b = order[0, m if way == 0 else bodies - 1 - m]
                low, high = (a, b) if way == 0 else (b, a)
                if Y[high, CENTRE] - Y[high, RADIUS] > Y[low, CENTRE] + Y[low, RADIUS] + 2.0 * most:
                    break
                most = max(most, _shove(a, b, dt, restitution, Y), _shove(b, a, dt, restitution, Y))
    return most


@inner
def _before(Y, i, j):
    """Return whether body i begins before body j along x."""
    x, y = Y[i, CENTRE] - Y[i, RADIUS], Y[j, CENTRE] - Y[j, RADIUS]
    return x < y or (x == y and i < j)


@inner
def line_up(bodies, order, Y):
    """Order the scene's bodies along x by where they begin; the order of the step before is nearly right.

    Row 1 lists what does not move freely; return its number.
    """
    for i in range(1, bodies):
        k, j = order[0, i], i
        while j > 0 and _before(Y, k, order[0, j - 1]):
            order[0, j] = order[0, j - 1]
            j -= 1
        order[0, j] = k
    n = 0
    for i in range(len(Y)):
        if Y[i, IMASS] == 0.0:
            order[1, n] = i
            n += 1
    return n
