"""Kernels: contact points of two pieces.

Where the surfaces that face each other along the normal overlap, their corners and crossings are contacts.
Rows are as in `columns`: point, gap, normal, pieces, and whose face it is.
"""

import math

from ..compiler import inner
from ..spatial.rotation import cross
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
    CONTACT,
    COS_HALF,
    FACE_OF,
    FACE_OF_A,
    FACE_OF_B,
    FARNESS,
    FIRST_FACE,
    FIRST_POINT,
    GAP,
    HALF_SPACE,
    HULL,
    KIND,
    LAST_FACE,
    LAST_POINT,
    LATHE,
    NO_FACE,
    NORMAL,
    OWNER,
    PIECE_A,
    PIECE_B,
    POINT,
    POSITION,
    ROTATION,
    ROUNDING,
)
from .nearest import half_space, nearest
from .support import face, get, matrix_times, put, round_outline, support, transposed_times, unit

#: Most contacts of two pieces: two rectangles overlap in an octagon.
MOST_OF_PIECES = 8
_OCTAGON, _MOST_OF_DISC = 8, 4  # corners of a disc, and of those that are kept: they lie where the load is
_FLAT = 1e-12  # 1 - cosine up to which two faces are parallel: .1 um over .1 m
_LEVEL = 1e-9  # difference of cosines of two faces from which on one is flatter
_ACROSS = 1e-12  # squared cosine up to which a load moves across a normal
_TIE = 1e-12  # difference that does not count [m, or m^2]
_ON_SIDE = 1e-4  # distance from which on a load is off a side of its contacts [m]
_KEPT = -1.0  # marks a contact that is kept
_FLAT_ON_FACE = 1e-5  # 1 - cosine up to which the normal is that of the face
_OBLIQUE = 0.5  # cosine below which a surface does not face along the normal
_PARALLEL = 4e-4  # squared sine up to which two segments are parallel (1.1 degrees)
_DEEPER = 1e-4  # a nearest point that is nearer than all corners by more is a contact of its own [m]
_TURN = 2.5e-3  # squared distance that counts as a turn of a normal by 1: .1 rad is 5 mm [m^2]
_TILT = 0.03  # rad, slope from the deepest contact up to which one at a distance matters: a step at 7 rad/s


@inner
def _clip(polygon, count, o, e, out):
    """Clip a polygon or segment by ``(x - o) . e <= 0``; return the number of corners in ``out``."""
    kept = 0
    if count == 0:
        return 0
    last = get(polygon, count - 1)
    side_last = dot(minus(last, o), e)
    for k in range(count):
        p = get(polygon, k)
        side = dot(minus(p, o), e)
        # the closing edge of a segment is the segment itself
        if (side < 0.0) != (side_last < 0.0) and not (count == 2 and k == 0) and count > 1:
            put(out, kept, plus(last, times(side_last / (side_last - side), minus(p, last))))
            kept += 1
        if side < 0.0 or (count == 1 and side <= 0.0):
            put(out, kept, p)
            kept += 1
        last, side_last = p, side
    return kept


@inner
def write_contact(out, k, point, gap, n, a, b, whose):
    """Write a contact into row k."""
    for j in range(3):
        out[k, POINT + j], out[k, NORMAL + j] = point[j], n[j]
    out[k, GAP], out[k, PIECE_A], out[k, PIECE_B], out[k, FACE_OF] = gap, a, b, whose


@inner
def load_point(a, b, n, lean, base, frames, pieces):
    """Return the centre of mass of the body that ``lean`` presses against the other one; b's across ``n``."""
    pressed = dot(lean, n)
    loaded = a if pressed > 0.0 and pressed * pressed > _ACROSS * dot(lean, lean) else b
    return minus(triple(frames[int(pieces[loaded, OWNER])], POSITION), base)


@inner
def _room(out, corners, load):
    """Return how far the point ``load`` is within the outline of four contacts, and that side's normal."""
    n, least = triple(out[corners[0]], NORMAL), math.inf
    way = n
    for j in corners:
        for k in corners:
            across = cross(minus(triple(out[k], POINT), triple(out[j], POINT)), n)
            if dot(across, across) > _TIE:
                across, reach = unit(across), -math.inf
                for q in corners:
                    reach = max(reach, dot(minus(triple(out[q], POINT), load), across))
                if reach < least:
                    least, way = reach, across
    return least, way


@inner
def _fourth(out, first, last, corners, load):
    """Return the last of four contacts, or the one that gives a load at least twice the room to tip.

    That one lies beyond the side over which the load would tip first.
    """
    i, j, k, found = corners
    least, way = _room(out, corners, load)
    best = enough = 2.0 * max(least, _ON_SIDE)
    for q in range(first, last):
        wide = (out[q, GAP] - out[i, GAP]) / _TILT
        value = dot(minus(triple(out[q], POINT), load), way) - wide
        if out[q, FARNESS] != _KEPT and value > best + _TIE:
            best, found = value, q
    return found if found == corners[3] or _room(out, (i, j, k, found), load)[0] > enough else corners[3]


@inner
def reduce(out, first, last, most, lean, load):
    """Keep the deepest contact, the one where a load leaves, and the ones that differ most; return the end.

    The load moves from the point ``load`` along ``lean``. Contacts differ in place or direction. The fourth
    one is the farthest, unless another one leaves the load much more room to tip.
    """
    if last - first <= most:
        return last
    n = triple(out[first], NORMAL)
    along = minus(lean, times(dot(lean, n), n))
    length = math.sqrt(dot(along, along))
    best, found = -math.inf, first
    for k in range(first, last):
        out[k, FARNESS] = math.inf
        # ties of symmetric outlines go to the first row, not to round-off
        if -out[k, GAP] > best + _TIE:
            best, found = -out[k, GAP], k
    deepest, least = found, out[found, GAP]
    out[found, FARNESS] = _KEPT
    second = third = found
    for c in range(1, most):
        p, n = triple(out[found], POINT), triple(out[found], NORMAL)
        best, leaves = -math.inf, found
        if c == 1 and length * length > _ACROSS * dot(lean, lean):
            for k in range(first, last):
                d = minus(triple(out[k], POINT), load)
                t, h = dot(d, along) / length, dot(d, n)
                value = t - math.sqrt(max(dot(d, d) - h * h - t * t, 0.0))  # far along its way, and near it
                value -= (out[k, GAP] - least) / _TILT
                if value > best + _TIE:
                    best, leaves = value, k
        found = farthest = leaves
        best = -math.inf
        for k in range(first, last):
            if out[k, FARNESS] == _KEPT:
                continue
            d, e = minus(triple(out[k], POINT), p), minus(triple(out[k], NORMAL), n)
            out[k, FARNESS] = min(out[k, FARNESS], dot(d, d) + _TURN * dot(e, e))
            wide = (out[k, GAP] - least) / _TILT  # it counts against a place
            value = out[k, FARNESS] - wide * wide
            if value > best * (1.0 + 1e-4) + _TIE:
                best, farthest = value, k
        if c == 3:
            farthest = _fourth(out, first, last, (deepest, second, third, farthest), load)
        if out[found, FARNESS] <= _TIE:  # kept, or in the place of one that is
            found = farthest
        out[found, FARNESS] = _KEPT
        second, third = third, found
    end = first
    for k in range(first, last):
        if out[k, FARNESS] == _KEPT:
            if k != end:
                for j in range(CONTACT):
                    out[end, j] = out[k, j]
            end += 1
    return end


@inner
def _on_half_space(a, b, far, lean, base, frames, pieces, rows, polygons, out, first):
    """Write the contacts of piece b with the half-space a; return their number and the least gap."""
    o, n = half_space(a, base, frames, pieces, rows)
    load = load_point(a, b, n, lean, base, frames, pieces)
    piece = pieces[b]
    end, polygon, least, most = first, polygons[0], math.inf, MOST_OF_PIECES
    if piece[KIND] == HULL and piece[LAST_FACE] > piece[FIRST_FACE]:
        frame = frames[int(piece[OWNER])]
        start = minus(triple(frame, POSITION), base)
        d = transposed_times(frame, ROTATION, n)
        height = dot(minus(start, o), n) - piece[ROUNDING]
        for v in range(int(piece[FIRST_POINT]), int(piece[LAST_POINT])):
            gap = height + dot(d, get(rows, v))
            if gap < far and end < len(out):
                x = plus(start, matrix_times(frame, ROTATION, get(rows, v)))
                write_contact(
                    out, end, minus(x, times(piece[ROUNDING] + 0.5 * gap, n)), gap, n, a, b, FACE_OF_A
                )
                least = min(least, gap)
                end += 1
    else:
        count, _ = face(b, times(-1.0, n), lean, load, base, frames, pieces, rows, polygon)
        for k in range(count):
            p = get(polygon, k)
            gap = dot(minus(p, o), n)
            if gap < far and end < len(out):
                write_contact(out, end, minus(p, times(0.5 * gap, n)), gap, n, a, b, FACE_OF_A)
                least = min(least, gap)
                end += 1
        most = _MOST_OF_DISC
    return reduce(out, first, end, most, lean, load) - first, least, n


@inner
def manifold_of_pieces(a, b, n, follow, far, lean, base, frames, pieces, rows, polygons, out, first):
    """Write the contacts of two pieces that face each other along ``n``, from row ``first`` on.

    Parameters
    ----------
    a, b : int
        Rows of the pieces; only ``a`` may be a half-space.
    n : tuple
        Normal from a to b.
    follow : bool
        Whether ``n`` is only a guess, of a moment ago: the normal is then that of the face, and there are no
        contacts if this is not the way in which the pieces part.
    far : float
        Largest gap of a contact [m].
    lean : tuple
        Direction in which the load of the body moves that rests on the other one, from its centre of mass on:
        that of a force, or of sliding. Any length; zero without one.
    base : tuple
        Point to which contacts are relative, world axes.
    polygons : (3, POLYGON, 3) array
        Scratch.

    Returns
    -------
    count : int
        At most `MOST_OF_PIECES`.
    gap : float
        The least one; infinite without contacts.
    normal : tuple
        Of the contacts.
    """
    if pieces[a, KIND] == HALF_SPACE:
        return _on_half_space(a, b, far, lean, base, frames, pieces, rows, polygons, out, first)
    own, other, spare = polygons[0], polygons[1], polygons[2]
    load = load_point(a, b, n, lean, base, frames, pieces)
    count_a, normal_a = face(a, n, lean, load, base, frames, pieces, rows, own)
    count_b, normal_b = face(b, times(-1.0, n), lean, load, base, frames, pieces, rows, other)
    most = MOST_OF_PIECES
    if count_a >= _OCTAGON and pieces[a, KIND] == LATHE or count_b >= _OCTAGON and pieces[b, KIND] == LATHE:
        most = _MOST_OF_DISC
    flatter = -dot(normal_b, n) > dot(normal_a, n) + _LEVEL
    swap = count_a < 3 or (count_b >= 3 and flatter)
    if count_a < 3 and count_b < 3:
        swap = count_a < count_b
    side = -1.0 if swap else 1.0
    if swap:
        reference, size, normal, clipped, count, top = other, count_b, normal_b, own, count_a, a
    else:
        reference, size, normal, clipped, count, top = own, count_a, normal_a, other, count_b, b
    o = get(reference, 0)
    if size == 2:  # two segments, if they are nearly parallel
        if count != 2:
            return 0, math.inf, n
        t, u = minus(get(reference, 1), o), minus(get(clipped, 1), get(clipped, 0))
        across = cross(unit(t), unit(u))
        if dot(across, across) > _PARALLEL:
            return 0, math.inf, n
        normal = unit(minus(times(side, n), times(side * dot(n, t) / dot(t, t), t)))
    if size < 2:
        return 0, math.inf, n
    if size > 2 and count == 2 and pieces[top, KIND] == LATHE and pieces[top, COS_HALF] > -1.0:
        count = round_outline(top, base, frames, pieces, clipped)
    slope = abs(dot(normal, n))
    if slope < (0.99 if follow else _OBLIQUE) or (follow and size == 2):
        return 0, math.inf, n
    for k in range(size):
        p = get(reference, k)
        e = (
            cross(minus(get(reference, (k + 1) % size), p), normal)
            if size > 2
            else minus(p, get(reference, 1 - k))
        )
        inside = True
        for c in range(count):
            if dot(minus(get(clipped, c), p), e) > 0.0:
                inside = False
        if not inside:
            count = _clip(clipped, count, p, e, spare)
            clipped, spare = spare, clipped
    on_face = size > 2 and (follow or slope > 1.0 - _FLAT_ON_FACE)
    if on_face:
        n, slope = times(side, normal), 1.0
    whose = NO_FACE
    if on_face:
        whose = FACE_OF_B if swap else FACE_OF_A
    end, least = first, math.inf
    for k in range(count):
        p = get(clipped, k)
        gap = dot(minus(p, o), normal) / slope
        if gap < far and end < len(out):
            write_contact(out, end, minus(p, times(side * 0.5 * gap, n)), gap, n, a, b, whose)
            least = min(least, gap)
            end += 1
    if follow and end == first:
        return 0, least, n
    if follow and dot(normal_a, normal_b) > _FLAT - 1.0:
        # the piece on the face must not reach below its corners there; a parallel face does not
        q = support(top, times(-1.0, normal), base, frames, pieces, rows)
        if least > dot(normal, minus(q, o)) - pieces[top, ROUNDING] + 1e-6:
            return 0, least, n
    return reduce(out, first, end, most, lean, load) - first, least, n


@inner
def contacts_of_pieces(a, b, n, known, far, lean, base, frames, pieces, rows, work, polygons, out, first):
    """Write the contacts of two pieces; return number, gap (a lower bound beyond ``far``), normal.

    ``n`` is a first guess of the normal, or that of a moment ago if ``known``. Nearest points are a contact
    of their own where no corner or crossing is as near.
    """
    if pieces[a, KIND] == HALF_SPACE:
        return _on_half_space(a, b, far, lean, base, frames, pieces, rows, polygons, out, first)
    if known:
        count, gap, m = manifold_of_pieces(
            a, b, n, True, far, lean, base, frames, pieces, rows, polygons, out, first
        )
        if count > 0:
            return count, gap, m
    gap, n, p, q = nearest(a, b, n, known, far, base, frames, pieces, rows, work)
    if gap > far:
        return 0, gap, n
    count, least, _ = manifold_of_pieces(
        a, b, n, False, far, lean, base, frames, pieces, rows, polygons, out, first
    )
    if (count == 0 or least > gap + _DEEPER) and first + count < len(out):
        write_contact(out, first + count, times(0.5, plus(p, q)), gap, n, a, b, NO_FACE)
        count += 1
    return count, gap, n
