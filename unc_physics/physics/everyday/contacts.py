"""Rows of contacts: from what the search finds to gaps, levers and masses at any time within the step."""

import math

from ...compiler import inner
from ...shapes.columns import (
    CORNERS_FROM,
    COS_HALF,
    FIRST_FACE,
    FIRST_POINT,
    HALF_SPACE,
    HULL,
    KIND,
    LAST_FACE,
    LAST_POINT,
    LATHE,
    NO_FACE,
    ROUNDING,
)
from ...shapes.columns import FACE_OF as FOUND_FACE
from ...shapes.columns import GAP as FOUND_GAP
from ...shapes.columns import NORMAL as FOUND_NORMAL
from ...shapes.columns import PIECE_A as FOUND_A
from ...shapes.columns import PIECE_B as FOUND_B
from ...shapes.columns import POINT as FOUND_POINT
from ...shapes.hollow import hollow_surface, is_hollow
from ...shapes.support import core_point, gap_along, unit
from ...spatial.rotation import cross
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ARM_A,
    ARM_B,
    ARM_BEFORE,
    BELT_U,
    BELT_W,
    BEND,
    BODY_A,
    BODY_B,
    BY_NORMAL,
    CENTRE,
    CLEAR,
    CURVES,
    DRIFT,
    DRIVEN,
    EASE_N,
    EASE_T,
    EDGE,
    FACE_OF,
    FEATURE,
    FIRST_NORMAL,
    FRAME,
    FREE_W,
    FRICTION,
    GAP,
    GAP0,
    GAP_NOW,
    GHOST,
    IMASS,
    IMPULSE,
    IWORLD,
    K11,
    K12,
    K22,
    L1,
    L2,
    LATHE_A,
    LATHE_B,
    LEVER_A,
    LEVER_B,
    LN,
    MASS_N,
    MASS_T,
    MODE,
    MOMENT,
    MOST,
    MOVED,
    MU,
    MU0,
    NORMAL,
    ON_AXIS,
    ON_RIM,
    PAIR_A,
    PAIR_B,
    PIECE_A,
    PIECE_B,
    POINT,
    POINTED,
    RADIUS,
    REACH,
    RESTITUTION,
    RHO_A,
    RHO_B,
    RIM_A,
    RIM_B,
    ROLL,
    ROLL_SPEED,
    ROLLING,
    ROT,
    ROW0,
    ROWS,
    SAME_POINT,
    SHOVE,
    SINCE,
    SLOP,
    SPIN,
    STRUCK,
    SURFACE_A,
    SURFACE_B,
    SURFACE_OF,
    SURFACE_U,
    SURGE,
    TAN1,
    TAN2,
    TILTED,
    TORSION,
    TRAVEL,
    TURNED,
    TWIST,
    VEL,
    WARM,
    WARM_MOMENT,
    WAY,
    WENT,
    E,
)
from .motion import back, roll_arm, roll_axis, symmetric_times, turn, turned, write
from .search import FULL, line_up, meet, place, reaches, shoves
from .solve import closing, parting

# Cosines of the most by which a rim's point travels; where it is more the point stays on the body.
NEARBY = 0.7  # an eighth of the circle, and by which normals differ between which forces are handed on
ANYWHERE = -math.inf


@inner
def _rolls_on(Y, solids, i, p, n, r):
    """Return 1 where a turn about its body's axis does not move the contact of piece p at the lever r.

    So with whole lathes. A sector's surface goes on where the point faces along the normal n, and is not at
    one of the sector's ends.
    """
    if solids.spots[p, ON_AXIS] == 0.0:
        return 0.0
    across = dot(cross(roll_axis(Y, i), minus(r, roll_arm(Y, i))), n)
    return 1.0 if solids.pieces[p, COS_HALF] <= -1.0 or abs(across) < FEATURE else 0.0


@inner
def _on_rim(Y, solids, i, p, n, q):
    """Return whether q, from its axis, is a lathe's farthest point along n, and its circle rises along n."""
    b, c = back(Y, i, n), back(Y, i, q)
    centre = plus(three(Y, i, CENTRE), roll_arm(Y, i))
    there = minus(core_point(solids.pieces[p], solids.rows, b), back(Y, i, minus(centre, three(Y, i, FRAME))))
    d, a = minus(there, c), back(Y, i, roll_axis(Y, i))
    along = minus(b, times(dot(a, b), a))
    return dot(d, d) < ON_RIM * ON_RIM and dot(c, along) > SLOP


@inner
def _tangents(n):
    """Return two tangents that only depend on the normal n."""
    t1 = unit(cross(n, (0.0, 1.0, 0.0) if abs(n[1]) < 0.5 else (1.0, 0.0, 0.0)))
    return t1, cross(n, t1)


@inner(noinline=True, error_model="numpy")
def _complete(C, n, Y, solids, surface, materials):
    """Fill what follows from a row's normal, gap, levers, pieces: tangents, materials, velocity of a belt."""
    a = int(C[n, BODY_A])
    pa, pb = int(C[n, PIECE_A]), int(C[n, PIECE_B])
    normal = three(C, n, NORMAL)
    t1, t2 = _tangents(normal)
    write(C, n, FIRST_NORMAL, normal)
    write(C, n, TAN1, t1)
    write(C, n, TAN2, t2)
    C[n, RHO_A], C[n, RHO_B] = solids.pieces[pa, ROUNDING], solids.pieces[pb, ROUNDING]
    sa, sb = int(solids.spots[pa, SURFACE_OF]), int(solids.spots[pb, SURFACE_OF])
    things, pair = _own_pair(materials, sa, sb)
    C[n, MU0], C[n, E] = _mean(materials, FRICTION, sa, sb, pair), _mean(materials, RESTITUTION, sa, sb, pair)
    C[n, MU], C[n, TWIST] = C[n, MU0], _mean(materials, TORSION, sa, sb, pair)
    C[n, ROLL] = 0.0
    if _is_round(solids.pieces, pa) or _is_round(solids.pieces, pb):
        C[n, ROLL] = _mean(materials, ROLLING, sa, sb, pair)
    C[n, SURFACE_A], C[n, SURFACE_B], C[n, STRUCK] = sa, sb, 0.0
    e = sa - (things - len(surface))
    v = w = (0.0, 0.0, 0.0)
    if len(surface) > 0 and e >= 0:
        w = three(surface, e, 3)
        arm = plus(three(C, n, LEVER_A), times(C[n, RHO_A], normal))
        point = plus(three(Y, a, CENTRE), arm)
        v = plus(three(surface, e, 0), cross(w, point))
    write(C, n, BELT_W, w)
    write(C, n, BELT_U, (0.0, dot(v, t1), dot(v, t2)))
    C[n, MODE] = 0.0
    write(C, n, IMPULSE, (0.0, 0.0, 0.0))
    write(C, n, MOMENT, (0.0, 0.0, 0.0))


@inner
def _own_pair(materials, i, j):
    """Return the number of surfaces, and the column of two surfaces' own pair, or -1."""
    k, found = materials.shape[1] - 1, -1
    while k >= 0 and materials[PAIR_A, k] >= 0.0:
        if materials[PAIR_A, k] == min(i, j) and materials[PAIR_B, k] == max(i, j):
            found = k
        k -= 1
    return k + 1, found


@inner
def _mean(materials, quantity, i, j, pair):
    """Return a quantity of a contact: the pair's own, or the geometric mean of those that are given."""
    if pair >= 0 and materials[quantity, pair] >= 0.0:
        return materials[quantity, pair]
    x, y = materials[quantity, i], materials[quantity, j]
    return math.sqrt(x * y) if x >= 0.0 and y >= 0.0 else max(x, y, 0.0)


@inner
def most_elastic(materials):
    """Return the highest coefficient of restitution."""
    most = 0.0
    for k in range(materials.shape[1]):
        most = max(most, materials[RESTITUTION, k])
    return most


@inner
def _is_round(pieces, p):
    """Return whether a piece rolls: flat ones tip over their edges."""
    return pieces[p, KIND] == LATHE or pieces[p, ROUNDING] > 0.0


@inner
def _feature(Y, solids, i, p, q):
    """Return the number of directions in which piece p ends at the point q of its core, and that of an edge.

    They are 3 at a corner, 2 on an edge, and at most 1 elsewhere and on lathes. The point is from the frame's
    origin, all in world axes.
    """
    piece, rows = solids.pieces[p], solids.rows
    first, last = int(piece[FIRST_POINT]), int(piece[LAST_POINT])
    none, q = (0.0, 0.0, 0.0), back(Y, i, q)
    if piece[KIND] != HULL:
        return 0, none
    if last - first == 1:
        return 3, none
    if last - first == 2:
        a, b = three(rows, first, 0), three(rows, first + 1, 0)
        da, db = minus(q, a), minus(q, b)
        if min(dot(da, da), dot(db, db)) < FEATURE * FEATURE:
            return 3, none
        return 2, turn(Y, i, ROT, unit(minus(b, a)))
    count, before, edge = 0, none, none
    for k in range(int(piece[FIRST_FACE]), int(piece[LAST_FACE])):
        n = three(rows, k, 0)
        if dot(n, minus(q, three(rows, int(rows[k, CORNERS_FROM]), 0))) > -FEATURE:
            if count == 1:
                edge = cross(before, n)
            count, before = count + 1, n
    if count != 2:
        return min(count, 3), none
    return 2, turn(Y, i, ROT, unit(edge))


@inner(noinline=True)
def _point_to_point(C, n, ra, rb, Y, solids):
    """Note whether corners or edges face each other in row n, whose cores' points are ``ra`` and ``rb``."""
    a, b = int(C[n, BODY_A]), int(C[n, BODY_B])
    qa = minus(plus(three(Y, a, CENTRE), ra), three(Y, a, FRAME))
    qb = minus(plus(three(Y, b, CENTRE), rb), three(Y, b, FRAME))
    count_a, edge_a = _feature(Y, solids, a, int(C[n, PIECE_A]), qa)
    count_b, edge_b = _feature(Y, solids, b, int(C[n, PIECE_B]), qb)
    if count_a >= 2 and count_b >= 2:
        C[n, POINTED] = 2.0 if count_a > 2 and count_b == 2 else 1.0
    write(C, n, EDGE, edge_a if count_a == 2 else edge_b)
    if count_a == 2 and count_b == 2:
        across = cross(edge_a, edge_b)
        if dot(across, across) > FEATURE:
            C[n, POINTED] = 0.0  # edges that cross do not pass each other


@inner
def _given_along(C, k, at, n):
    """Return what columns ``at`` on give along normal and tangents of row k, with the tangents that n has."""
    t1, t2 = _tangents(n)
    across = plus(times(C[k, at + 1], three(C, k, TAN1)), times(C[k, at + 2], three(C, k, TAN2)))
    return C[k, at], dot(across, t1), dot(across, t2)


@inner(noinline=True)
def _row(C, n, a, b, found, i, Y, solids, old, first, had):
    """Write row n from found contact i, with the forces of the nearest contact of the step before."""
    p, normal, gap = three(found, i, FOUND_POINT), three(found, i, FOUND_NORMAL), found[i, FOUND_GAP]
    pa, pb, face = int(found[i, FOUND_A]), int(found[i, FOUND_B]), found[i, FOUND_FACE]
    half = times(0.5 * gap, normal)
    ra, rb = plus(minus(p, half), minus(three(Y, b, CENTRE), three(Y, a, CENTRE))), plus(p, half)
    ra = minus(ra, times(solids.pieces[pa, ROUNDING], normal))
    rb = plus(rb, times(solids.pieces[pb, ROUNDING], normal))
    C[n, BODY_A], C[n, BODY_B], C[n, PIECE_A], C[n, PIECE_B], C[n, POINTED] = a, b, pa, pb, 0.0
    C[n, FACE_OF] = face
    write(C, n, NORMAL, normal)
    write(C, n, EDGE, (0.0, 0.0, 0.0))
    C[n, CURVES] = C[n, CURVES + 1] = 0.0
    if face == NO_FACE:
        _point_to_point(C, n, ra, rb, Y, solids)
    elif is_hollow(pa, solids.pieces) or is_hollow(pb, solids.pieces):
        _curve(C, n, ra, rb, Y, solids)
    C[n, RIM_A] = C[n, RIM_B] = 0.0
    C[n, LATHE_A] = _rolls_on(Y, solids, a, pa, normal, ra)
    C[n, LATHE_B] = _rolls_on(Y, solids, b, pb, normal, rb)
    if C[n, LATHE_A] > 0.0:
        ra = minus(ra, roll_arm(Y, a))
        C[n, RIM_A] = 1.0 if face == 2.0 and _on_rim(Y, solids, a, pa, normal, ra) else 0.0
    if C[n, LATHE_B] > 0.0:
        rb = minus(rb, roll_arm(Y, b))
        C[n, RIM_B] = 1.0 if face == 1.0 and _on_rim(Y, solids, b, pb, times(-1.0, normal), rb) else 0.0
    write(C, n, LEVER_A, ra)
    write(C, n, LEVER_B, rb)
    C[n, GAP0], C[n, SINCE], C[n, WENT] = gap, 0.0, math.inf
    write(C, n, WARM, (0.0, 0.0, 0.0))
    write(C, n, WARM_MOMENT, (0.0, 0.0, 0.0))
    best, which = SAME_POINT * SAME_POINT, -1
    for j in range(first, first + had):
        d = minus(rb, three(old, j, LEVER_B))
        if dot(d, d) < best and old[j, MODE] == 0.0 and dot(three(old, j, NORMAL), normal) >= NEARBY:
            best, which = dot(d, d), j
    if which >= 0:
        write(C, n, WARM, _given_along(old, which, WARM, normal))
        write(C, n, WARM_MOMENT, _given_along(old, which, WARM_MOMENT, normal))
        old[which, MODE] = 1.0  # used


@inner(noinline=True)
def _curve(C, n, ra, rb, Y, solids):
    """Note the curvatures of the hollow surface of row n, if there is one, at the cores' points."""
    p, x = int(C[n, PIECE_A]), plus(three(Y, int(C[n, BODY_B]), CENTRE), rb)
    if C[n, FACE_OF] == 2.0:
        p, x = int(C[n, PIECE_B]), plus(three(Y, int(C[n, BODY_A]), CENTRE), ra)
    if is_hollow(p, solids.pieces):
        none = (0.0, 0.0, 0.0)
        gap, _, along, curves = hollow_surface(p, x, none, Y, solids.pieces, solids.rows)
        if gap < math.inf:
            write(C, n, EDGE, along)
            C[n, CURVES], C[n, CURVES + 1] = curves


@inner(forceinline=True)
def _curved(C, k, d):
    """Return how a way d of b's point changes the normal of row k over a hollow surface; zero over others."""
    if C[k, CURVES] == 0.0 and C[k, CURVES + 1] == 0.0:
        return 0.0, 0.0, 0.0
    e = three(C, k, EDGE)
    s = cross(three(C, k, FIRST_NORMAL), e)
    return plus(times(C[k, CURVES] * dot(d, e), e), times(C[k, CURVES + 1] * dot(d, s), s))


@inner
def _face_along(C, k, d):
    """Turn the normal of row k over a hollow surface by a way d of b's point since the search."""
    if C[k, CURVES] != 0.0 or C[k, CURVES + 1] != 0.0:
        _aim(C, k, plus(three(C, k, FIRST_NORMAL), _curved(C, k, d)))


@inner(noinline=True)
def _pair(a, b, far, dt, n, Y, solids, C, old, search, count):
    """Write the rows of a pair, the ones of the step before where nothing moved; return the number so far."""
    pairs = search.pairs
    first, had = int(pairs[a, b, ROW0]), int(pairs[a, b, ROWS])
    if n + MOST > len(C):
        return FULL
    if had > 0 and old[first, SINCE] < SLOP and Y[a, SHOVE] + Y[b, SHOVE] == 0.0:
        for j in range(first, first + had):
            for x in range(C.shape[1]):
                C[n, x] = old[j, x]
            n += 1
        return n
    slack = max(Y[a, SURGE], Y[b, SURGE]) + Y[a, SHOVE] + Y[b, SHOVE]  # one falls on what holds the other one
    slack = dt * slack + DRIFT
    k, gap = meet(a, b, far, dt, slack, Y, solids, old, first, had, search, count)
    if k == FULL:
        return FULL
    if k == 0:
        pairs[a, b, CLEAR] = Y[a, TRAVEL] + Y[b, TRAVEL] + gap
    for i in range(k):
        _row(C, n, a, b, search.out, i, Y, solids, old, first, had)
        n += 1
    return n


@inner(noinline=True)
def _without_ghosts(first, n, Y, solids, C):
    """Drop rows of a body with fixed ones where another one's normal parts the pieces; return the number.

    As `search` does within a pair of bodies.
    """
    for k in range(first, n):
        C[k, MODE] = 0.0
    for k in range(first, n):
        pa, pb = int(C[k, PIECE_A]), int(C[k, PIECE_B])
        for j in range(first, n):
            e = three(C, j, NORMAL)
            same = C[j, BODY_A] == C[k, BODY_A] or dot(e, three(C, k, NORMAL)) >= 1.0 - 1e-9
            if same or C[j, MODE] > 0.0 or C[j, GAP0] >= C[k, GAP0] + GHOST:
                continue
            if solids.pieces[pa, KIND] != HALF_SPACE:
                base = three(Y, int(C[k, BODY_B]), CENTRE)
                apart = gap_along(pa, pb, e, base, Y, solids.pieces, solids.rows)
                if apart > min(C[j, GAP0], 0.0) - GHOST:
                    C[k, MODE] = 1.0
                    break
    m = first
    for k in range(first, n):
        if C[k, MODE] == 0.0:
            if m < k:
                for x in range(C.shape[1]):
                    C[m, x] = C[k, x]
            m += 1
    return m


@inner(noinline=True)
def find(bodies, dt, before, restitution, Y, solids, C, old, search, count):
    """Write the rows of all contacts that may act within dt; return their number, or `FULL`.

    ``old`` has the rows of the step ``before``; ``restitution`` is the highest one.
    """
    order, pairs = search.order, search.pairs
    for k in range(before):
        old[k, MODE] = 0.0
    for i in range(bodies):
        place(i, Y, solids)
    most = reaches(bodies, dt, Y)
    fixed = line_up(bodies, order, Y)
    most = shoves(bodies, dt, most, order, restitution, Y)
    n = 0
    for i in range(bodies):
        b, first = order[0, i], n
        if Y[b, IMASS] == 0.0:
            continue
        for k in range(fixed):
            a = order[1, k]
            far = Y[a, REACH] + Y[b, REACH]
            if Y[a, TRAVEL] + Y[b, TRAVEL] + far >= pairs[a, b, CLEAR]:
                n = _pair(a, b, far, dt, n, Y, solids, C, old, search, count)
                if n == FULL:
                    return FULL
        if fixed > 1 and n - first > 1:
            n = _without_ghosts(first, n, Y, solids, C)
        for j in range(i + 1, bodies):
            a = order[0, j]
            if Y[a, CENTRE] - Y[a, RADIUS] > Y[b, CENTRE] + Y[b, RADIUS] + Y[b, REACH] + most:
                break
            if Y[a, IMASS] == 0.0:
                continue
            far, d = Y[a, REACH] + Y[b, REACH], minus(three(Y, a, CENTRE), three(Y, b, CENTRE))
            r = Y[a, RADIUS] + Y[b, RADIUS] + far
            if dot(d, d) < r * r:
                p, q = min(a, b), max(a, b)
                if Y[a, TRAVEL] + Y[b, TRAVEL] + far >= pairs[p, q, CLEAR]:
                    n = _pair(p, q, far, dt, n, Y, solids, C, old, search, count)
                    if n == FULL:
                        return FULL
    return n


@inner(noinline=True)
def complete(n, C, Y, solids, surface, materials):
    """Fill what follows from the rows that a search has written."""
    for k in range(n):
        _complete(C, k, Y, solids, surface, materials)


@inner
def _rim(Y, i, n, q, later, around):
    """Return the farthest point along n on the circle about a body's axis through q, turned on by ``later``.

    Where it would travel beyond the cosine ``around``, as when the circle becomes flat along n, it stays on
    the body.
    """
    a = roll_axis(Y, i)
    e = turned(a, later)
    z = dot(q, a)
    r = math.sqrt(max(dot(q, q) - z * z, 0.0))
    p0, p = minus(n, times(dot(n, a), a)), minus(n, times(dot(n, e), e))
    s0, s = math.sqrt(dot(p0, p0)) + 1e-300, math.sqrt(dot(p, p)) + 1e-300
    if dot(p0, p) < around * s0 * s:
        return turned(plus(times(z, a), times(r / s0, p0)), later)
    return plus(times(z, e), times(r / s, p))


@inner(forceinline=True)
def _across(Y, i, d):
    """Return a rotation vector without its part about the axis of body i."""
    a = roll_axis(Y, i)
    return minus(d, times(dot(a, d), a))


@inner(forceinline=True)
def _core(Y, i, q, way, axle, t):
    """Return a core's lever at t from now, its turn until then, the arm to its axis, and how far it went.

    The lever is from the ``axle``, if there is one, and its way is relative to the centre of mass; ``way`` is
    its turn since the search.
    """
    later = arm = went = (0.0, 0.0, 0.0)
    if t > 0.0:
        later = times(t, three(Y, i, SPIN))
    if axle:
        arm = roll_arm(Y, i)
        if t > 0.0:
            arm, later = turned(arm, later), _across(Y, i, later)
        went = minus(arm, three(Y, i, ARM_BEFORE))
    whole = plus(way, later)
    if dot(whole, whole) == 0.0:  # as at the begin of a step
        return q, later, arm, went
    r = turned(q, whole)
    return r, later, arm, plus(minus(r, q), went)


@inner(noinline=True)
def levers(C, k, Y, t, around):
    """Return the cores' levers at t from now, how far b's point went from a's surface, and its way.

    The points stay on their bodies, except that those of lathes do not turn about the axis, and those on rims
    travel along these.
    """
    a, b, n = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, FIRST_NORMAL)
    qa, qb = three(C, k, LEVER_A), three(C, k, LEVER_B)
    axle_a, axle_b = C[k, LATHE_A] > 0.0, C[k, LATHE_B] > 0.0
    ta, tb = three(Y, a, TILTED if axle_a else TURNED), three(Y, b, TILTED if axle_b else TURNED)
    ra, da, ca, wa = qa, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if Y[a, IMASS] > 0.0 or Y[a, DRIVEN] > 0.0:
        ra, da, ca, wa = _core(Y, a, qa, ta, axle_a, t)
    rb, db, cb, wb = _core(Y, b, qb, tb, axle_b, t)
    d = minus(wb, wa)
    if C[k, RIM_B] > 0.0:  # the other body's point goes with it
        e = minus(_rim(Y, b, times(-1.0, n), turned(qb, tb), db, around), rb)
        rb, d = plus(rb, e), plus(d, times(dot(n, e), n))
        ra = plus(ra, minus(e, times(dot(n, e), n)))
    elif C[k, RIM_A] > 0.0:
        e = minus(_rim(Y, a, n, turned(qa, ta), da, around), ra)
        ra, d = plus(ra, e), minus(d, times(dot(n, e), n))
        rb = plus(rb, minus(e, times(dot(n, e), n)))
    d = plus(d, minus(three(Y, b, MOVED), three(Y, a, MOVED)))
    return plus(ra, ca), plus(rb, cb), dot(plus(n, times(0.5, _curved(C, k, d))), d), d


@inner(forceinline=True)
def _points(C, k, Y, ra, rb, ended):
    """Return what to add to the cores' levers, the way from a's point to b's then, and EDGE now.

    Points on edges and faces travel along these, so that they stay opposite the other body's point. Where
    driven bodies have ``ended`` the step, they are where it ends.
    """
    a, b, n = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, NORMAL)
    if Y[a, IMASS] == 0.0 and Y[a, DRIVEN] == 0.0 and C[k, FACE_OF] == 1.0:  # a point of what does not move
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), n
    d = minus(plus(three(Y, b, CENTRE), rb), plus(three(Y, a, CENTRE), ra))
    if Y[a, DRIVEN] > 0.0 and not ended:
        d = minus(d, three(Y, a, MOVED))
    share = 1.0  # of the way along that is a's
    if C[k, POINTED] == 2.0 or C[k, FACE_OF] == 2.0:
        share = 0.0
    elif C[k, POINTED] == 0.0 and C[k, FACE_OF] == 0.0:
        share = 0.5
    e = n
    if C[k, POINTED] > 0.0:
        e = turned(three(C, k, EDGE), three(Y, a if share > 0.0 else b, TURNED))
        along = times(dot(d, e), e)
    else:
        along = minus(d, times(dot(d, n), n))
    return times(share, along), times(share - 1.0, along), minus(d, along), e


@inner
def _aim(C, k, d):
    """Turn normal and tangents along d, from a's core to b's; return whether it is long enough to tell."""
    if dot(d, d) <= SLOP * SLOP:
        return False
    n = unit(d)
    write(C, k, WARM, _given_along(C, k, WARM, n))
    write(C, k, WARM_MOMENT, _given_along(C, k, WARM_MOMENT, n))
    write(C, k, BELT_U, _given_along(C, k, BELT_U, n))
    t1, t2 = _tangents(n)
    write(C, k, NORMAL, n)
    write(C, k, TAN1, t1)
    write(C, k, TAN2, t2)
    return True


@inner
def _passing(C, k, d, u, h):
    """Return the gap of corners or edges that pass each other: along the normal for the next h, and now.

    Their points are ``d`` apart and part at the velocity u. Where they come nearest within h without touching
    the gap is one that nothing closes.
    """
    n, swept, square = three(C, k, NORMAL), C[k, RHO_A] + C[k, RHO_B], dot(u, u)
    now, soonest = math.sqrt(dot(d, d)) - swept, h
    if square > 0.0:
        soonest = -dot(d, u) / square
    if 0.0 < soonest < h:
        nearest = plus(d, times(soonest, u))
        return (now if dot(nearest, nearest) < swept * swept else math.inf), now
    end = plus(d, times(h, u))
    return math.sqrt(dot(end, end)) - swept - h * dot(u, n), now


@inner
def _parting(C, k, Y, ra, rb):
    """Return the velocity of b's core relative to a's."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    u = plus(three(Y, b, VEL), cross(three(Y, b, SPIN), rb))
    return minus(u, plus(three(Y, a, VEL), cross(three(Y, a, SPIN), ra)))


@inner
def approach(C, k, Y, h, moved):
    """Fill the gap as it looks for the next h, and BEND; return the normal speed of b, and the gap.

    Unless bodies have ``moved`` only their velocities are new.
    """
    if moved or C[k, POINTED] > 0.0:
        ra, rb, d, way = levers(C, k, Y, 0.0, NEARBY)
        _face_along(C, k, way)
        sa, sb, apart, e = _points(C, k, Y, ra, rb, False)
        ra, rb = plus(ra, sa), plus(rb, sb)
        if C[k, POINTED] > 0.0:
            _aim(C, k, apart)
        _place_arms(C, k, ra, rb)
        write(C, k, SURFACE_U, three(C, k, BELT_U))
        C[k, GAP_NOW] = C[k, GAP0] + d
        if C[k, POINTED] > 0.0:
            u = _parting(C, k, Y, ra, rb)
            u = minus(u, times(dot(u, e), e))
            C[k, GAP], now = _passing(C, k, apart, u, h)
            C[k, BEND] = 0.0
            return dot(three(C, k, NORMAL), u) - C[k, BELT_U], now
    C[k, GAP], speed = C[k, GAP_NOW], closing(Y, C, k)
    C[k, BEND] = _bend(C, k, Y, speed + C[k, BELT_U], h)
    if C[k, CURVES] != 0.0 or C[k, CURVES + 1] != 0.0:
        u = parting(Y, C, k)
        C[k, BEND] += dot(_curved(C, k, u), u)
    return speed, C[k, GAP]


@inner
def _place_arms(C, k, ra, rb):
    """Note where impulses act: on the surfaces, at the levers of the cores."""
    n = three(C, k, NORMAL)
    write(C, k, ARM_A, plus(ra, times(C[k, RHO_A], n)))
    write(C, k, ARM_B, minus(rb, times(C[k, RHO_B], n)))


@inner(error_model="numpy")
def _bend(C, k, Y, u, h):
    """Return the acceleration of the gap by turns; zero where it changes the gap little within h."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    wa, wb = three(Y, a, SPIN), three(Y, b, SPIN)
    swings = Y[b, RADIUS] * dot(wb, wb)
    if Y[a, IMASS] > 0.0:
        swings = max(swings, Y[a, RADIUS] * dot(wa, wa))
    if h * h * swings < DRIFT:
        return 0.0
    v = minus(three(Y, b, VEL), three(Y, a, VEL))
    _, _, then, _ = levers(C, k, Y, h, ANYWHERE)
    return 2.0 * (then - (C[k, GAP] - C[k, GAP0]) + h * (dot(three(C, k, NORMAL), v) - u)) / (h * h)


@inner
def _change(Y, i, r, axle, t):
    """Return how a core's lever changes within t; with an ``axle`` its turn about that does not move it."""
    d = times(t, three(Y, i, SPIN))
    if not axle:
        return minus(turned(r, d), r)
    arm = roll_arm(Y, i)
    return minus(plus(turned(arm, d), turned(minus(r, arm), _across(Y, i, d))), r)


@inner(noinline=True, error_model="numpy")
def spread(C, k, Y, t):
    """Fill arms and masses for the points now, and what is missing to their velocities at t from now.

    Impulses act where the points are in the middle of a substep and stop them at its end: thus they do no
    work on what rolls.
    """
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    ra, rb, _, way = levers(C, k, Y, 0.0, NEARBY)
    _face_along(C, k, way)
    more, bend = (0.0, 0.0, 0.0), 0.0
    sa, sb, d, e = _points(C, k, Y, ra, rb, False)
    pa, pb = plus(ra, sa), plus(rb, sb)
    if C[k, POINTED] > 0.0 and _aim(C, k, d):  # the normal turns on until t
        u = _parting(C, k, Y, pa, pb)
        u = minus(u, times(dot(u, e), e))
        end = plus(d, times(t, u))
        bend = dot(end, u) / (math.sqrt(dot(end, end)) + 1e-300) - dot(three(C, k, NORMAL), u)
    elif C[k, CURVES] != 0.0 or C[k, CURVES + 1] != 0.0:
        u = _parting(C, k, Y, pa, pb)
        bend = t * dot(_curved(C, k, u), u)
    n = three(C, k, NORMAL)
    _place_arms(C, k, pa, pb)
    if t > 0.0:
        if C[k, GAP] > 0.0:  # what only swings down at the end does not close all the gap by then
            C[k, GAP] += 2.0 * t * t * max(-C[k, BEND], 0.0)
        if C[k, RIM_A] > 0.0 or C[k, RIM_B] > 0.0:
            ea, eb, _, _ = levers(C, k, Y, t, NEARBY)
            ea, eb = minus(ea, ra), minus(eb, rb)
        else:
            eb = _change(Y, b, pb, C[k, LATHE_B] > 0.0, t)
            ea = (0.0, 0.0, 0.0)
            if Y[a, IMASS] > 0.0 or Y[a, DRIVEN] > 0.0:
                ea = _change(Y, a, pa, C[k, LATHE_A] > 0.0, t)
        wa = three(Y, a, SPIN)
        if Y[a, DRIVEN] > 0.0 and C[k, FACE_OF] == 1.0:  # a table, unlike a roller, takes on what lies on it
            arm = three(C, k, ARM_A)
            ea = minus(turned(arm, times(t, wa)), arm)
        more = plus(cross(three(Y, b, SPIN), eb), times(t, cross(three(Y, b, FREE_W), pb)))
        more = minus(plus(more, times(bend, n)), cross(wa, ea))
        if Y[a, IMASS] > 0.0:
            more = minus(more, times(t, cross(three(Y, a, FREE_W), pa)))
        if C[k, FACE_OF] > 0.0:  # the point slides over a face that turns
            i = a if C[k, FACE_OF] == 1.0 else b
            more = minus(more, times(2.0 * t, cross(three(Y, i, SPIN), parting(Y, C, k))))
    given = dot(more, n), dot(more, three(C, k, TAN1)), dot(more, three(C, k, TAN2))
    w = three(C, k, BELT_W)
    if dot(w, w) > 0.0:  # the belt where b's point goes since the search
        more = cross(w, plus(three(Y, b, MOVED), times(t, three(Y, b, VEL))))
        given = given[0], given[1] - dot(more, three(C, k, TAN1)), given[2] - dot(more, three(C, k, TAN2))
    write(C, k, SURFACE_U, minus(three(C, k, BELT_U), given))
    masses(C, k, Y)


@inner(forceinline=True)
def _compliance(C, k, r, Y, i):
    """Return the speeds at the arm r that unit impulses make by spin: nn, n1, n2, 11, 12, 22."""
    n, t1, t2 = cross(r, three(C, k, NORMAL)), cross(r, three(C, k, TAN1)), cross(r, three(C, k, TAN2))
    i_n, i_1 = symmetric_times(Y, i, IWORLD, n), symmetric_times(Y, i, IWORLD, t1)
    return (
        dot(n, i_n),
        dot(t1, i_n),
        dot(t2, i_n),
        dot(t1, i_1),
        dot(t2, i_1),
        dot(t2, symmetric_times(Y, i, IWORLD, t2)),
    )


@inner(error_model="numpy")
def masses(C, k, Y):
    """Fill effective masses for where impulses act now."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    m = Y[a, IMASS] + Y[b, IMASS]
    nn, n1, n2, tt, tw, ww = _compliance(C, k, three(C, k, ARM_B), Y, b)
    if Y[a, IMASS] > 0.0:
        na, a1, a2, ta, xa, wa = _compliance(C, k, three(C, k, ARM_A), Y, a)
        nn, n1, n2, tt, tw, ww = nn + na, n1 + a1, n2 + a2, tt + ta, tw + xa, ww + wa
    C[k, MASS_N], C[k, BY_NORMAL], C[k, BY_NORMAL + 1] = 1.0 / (m + nn), n1, n2
    k11, k22 = m + tt, m + ww
    det = 1.0 / (k11 * k22 - tw * tw)
    C[k, K11], C[k, K12], C[k, K22] = k22 * det, -tw * det, k11 * det
    C[k, MASS_T] = 1.0 / (0.5 * (k11 + k22) + math.sqrt(0.25 * (k11 - k22) ** 2 + tw * tw))
    if C[k, TWIST] > 0.0 or C[k, ROLL] > 0.0:
        C[k, EASE_N] = _ease(Y, C, k, three(C, k, NORMAL))
        C[k, EASE_T] = _ease(Y, C, k, three(C, k, TAN1)) + _ease(Y, C, k, three(C, k, TAN2))
        r, n = three(C, k, ARM_B), three(C, k, NORMAL)
        C[k, ROLL_SPEED] = C[k, EASE_T] * math.sqrt(dot(r, r) + dot(r, n) ** 2)


@inner
def _ease(Y, C, k, e):
    """Return the relative spin about a direction by a unit moment about it."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    found = dot(e, symmetric_times(Y, b, IWORLD, e))
    return found + dot(e, symmetric_times(Y, a, IWORLD, e)) if Y[a, IMASS] > 0.0 else found


@inner
def note(first, last, C):
    """Add the impulses of a group's contacts to those of the whole step."""
    for k in range(first, last):
        f = plus(times(C[k, LN], three(C, k, NORMAL)), times(C[k, L1], three(C, k, TAN1)))
        f = plus(f, times(C[k, L2], three(C, k, TAN2)))
        write(C, k, IMPULSE, plus(three(C, k, IMPULSE), f))


@inner(noinline=True)
def remember(n, C, Y, search):
    """Bring contacts to where they are now, for steps that do not search their pair; note their rows."""
    pairs = search.pairs
    for k in range(n):
        a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
        _index(k, C, pairs)
        C[k, WENT] = Y[a, WAY] + Y[b, WAY]
        C[k, SINCE] += C[k, WENT]
        if C[k, WENT] == 0.0:
            continue
        ra, rb, d, _ = levers(C, k, Y, 0.0, NEARBY)
        C[k, GAP0] += d
        if C[k, POINTED] > 0.0:
            _, _, apart, e = _points(C, k, Y, ra, rb, True)
            write(C, k, EDGE, e)
            _aim(C, k, apart)
            C[k, GAP0] = math.sqrt(dot(apart, apart)) - C[k, RHO_A] - C[k, RHO_B]
        if C[k, LATHE_A] > 0.0:
            ra = minus(ra, roll_arm(Y, a))
        if C[k, LATHE_B] > 0.0:
            rb = minus(rb, roll_arm(Y, b))
        write(C, k, LEVER_A, ra)
        write(C, k, LEVER_B, rb)


@inner
def _index(k, C, pairs):
    """Note row k as one of its pair."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    C[k, MODE] = 0.0
    if pairs[a, b, ROWS] == 0:
        pairs[a, b, ROW0] = k
    pairs[a, b, ROWS] += 1


@inner
def forget(n, C, search):
    """Drop what is known of the rows of the step before, after a search."""
    for k in range(n):
        search.pairs[int(C[k, BODY_A]), int(C[k, BODY_B]), ROWS] = 0


@inner(noinline=True)
def store(n, C, Y, out):
    """Write contacts into rows of `columns.REMEMBERED` floats."""
    for k in range(n):
        b, n_ = int(C[k, BODY_B]), three(C, k, NORMAL)
        r = three(C, k, LEVER_B)
        if C[k, LATHE_B] > 0.0:
            r = plus(r, roll_arm(Y, b))
        r = minus(r, times(C[k, RHO_B] + 0.5 * C[k, GAP0], n_))
        write(C, k, POINT, plus(three(Y, b, CENTRE), r))
        for x in range(out.shape[1]):
            out[k, x] = C[k, x]


@inner(noinline=True)
def restore(n, rows, C, Y, solids, surface, materials, search):
    """Read contacts from rows that `store` has written."""
    for k in range(n):
        for x in range(rows.shape[1]):
            C[k, x] = rows[k, x]
        _complete(C, k, Y, solids, surface, materials)
        write(C, k, IMPULSE, three(rows, k, IMPULSE))
        _index(k, C, search.pairs)
