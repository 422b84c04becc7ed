"""Contacts of solid flat faces: at corners and crossings of two outlines, and of spheres on a face.

Spheres of two faces touch only where spheres of both are near. Solid faces also carry each other between
their spheres, up to the edge of the smaller one. The support of a body is then right to the inset of its
outermost spheres.
"""

import math

import numpy as np

from ..compiler import inner
from ..compiler.simd import LANES, lowest_bit
from ..spatial.rotation import cross, rotate, rotate_back, tangents
from ..spatial.vectors import dot, minus, plus, times
from .contact_candidates import keep_candidate
from .contact_simd import plane_mask
from .element_contacts import in_element, write_element_rotation
from .implicit_workspace import CANDIDATE_GAP, CANDIDATE_NORMAL
from .shapes import KINDS

_BOX = KINDS["box"]
#: Least cosine of the angle between the normal of a face and the opposite of that of a face which faces it.
FACING = 0.95
_DEEPEST = 0.1  # largest depth, relative to the radius of the smaller body
_SLACK = 1e-6  # distance outside an outline that counts as inside [m]
_SAME = 1e-9  # difference of gaps [m], and of normals, of the same contact
_PARALLEL = 1e-9  # edges that cross at a smaller angle have no crossing [rad]
# columns of an outline: a corner on the face, body i's frame, and its two coordinates across the other face
_PLACE, _ACROSS = 0, 3
# a body's own outline, and that of its partner
_OWN, _OTHER = 0, 1


@inner(noinline=True)
def pair_outlines(i, j, t, found, limit, horizon, motion, kept, world, work):
    """Append candidates of the outlines of two bodies' faces to ``found`` ones; return their number.

    Of several pairs of faces, the one that separates the bodies best counts. ``t`` is body j's place, and
    ``work.R_ij`` its rotation, in body i's frame. ``motion`` is the relative
    velocity of the bodies, and both angular velocities, in body i's frame. ``kept`` is the overlap without a
    force [m].
    """
    faces, ranges = world.implicit.faces, world.implicit.face_range
    R_ij = work.R_ij
    deepest = -_DEEPEST * min(world.bodies.radius[i], world.bodies.radius[j])
    highest = limit - kept + horizon * _pace(motion, world.bodies.radius[i], world.bodies.radius[j])
    first, count = found, found
    for f in range(ranges[i, 0], ranges[i, 1]):
        if faces.corners[f] == 0:
            continue
        p = faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2]
        v = rotate_back(R_ij, p[0], p[1], p[2])
        for g in range(ranges[j, 0], ranges[j, 1]):
            q = faces.normal[g, 0], faces.normal[g, 1], faces.normal[g, 2]
            if faces.corners[g] == 0 or dot(v, q) > -FACING:
                continue
            q = rotate(R_ij, q[0], q[1], q[2])
            _load_body(f, (0.0, 0.0, 0.0), _OWN, False, world, work)
            _load_body(g, t, _OTHER, True, world, work)
            count, deepest = _overlap(
                first, count, deepest, highest, p, q, True, limit, horizon, motion, t, kept, world, work
            )
            if count < 0:
                return 0
    return count


@inner(noinline=True)
def spheres_on_faces(i, j, t, found, limit, horizon, motion, kept, world, work):
    """Append candidates of one body's spheres over flat faces of the other; return the new number.

    A face carries a ball between its own spheres, too. Faces that face each other have `pair_outlines`. The
    other arguments are those of it.
    """
    faces, ranges = world.implicit.faces, world.implicit.face_range
    box = world.implicit.box
    hull, hull_range, of_hull = world.implicit.hull, world.implicit.hull_range, world.implicit.hull_sphere
    centers, radii = world.tree.centers, world.tree.radii
    R_ij = work.R_ij
    u, w, o = motion
    deepest = -_DEEPEST * min(world.bodies.radius[i], world.bodies.radius[j])
    count = found
    for which in (_OTHER, _OWN):
        face_of, of, moved = (j, i, True) if which == _OTHER else (i, j, False)
        for g in range(ranges[face_of, 0], ranges[face_of, 1]):
            if faces.corners[g] == 0:
                continue
            s = faces.outline[g, 0]
            m = faces.normal[g, 0], faces.normal[g, 1], faces.normal[g, 2]
            level = radii[s] + m[0] * centers[s, 0] + m[1] * centers[s, 1] + m[2] * centers[s, 2]
            q = rotate(R_ij, m[0], m[1], m[2]) if moved else m
            n = q if moved else times(-1.0, q)  # towards body i
            # height of the other body's centre over the face
            center = (0.0, 0.0, 0.0) if moved else t
            height = (-dot(q, t) if moved else dot(q, t)) - level
            if height <= 0.0:
                continue
            # gaps of spheres, now and later, are linear in their centres
            turn = cross(n, minus(w, o))
            later = height + kept + horizon * (dot(n, plus(u, cross(o, t))) + dot(turn, center))
            height += kept
            b = q if moved else rotate_back(R_ij, q[0], q[1], q[2])
            d = turn if moved else rotate_back(R_ij, turn[0], turn[1], turn[2])
            d = plus(b, times(horizon, d))
            if min(_lowest(box[of], b, height), _lowest(box[of], d, later)) >= limit:
                continue
            if _is_faced(q, of, not moved, world, work):
                continue
            _load_body(g, t if moved else (0.0, 0.0, 0.0), which, moved, world, work)
            e1, e2 = tangents(n)
            for k in range(work.outline_corners[which]):
                place = _corner(which, k, work)
                work.outlines[which, k, _ACROSS] = dot(e1, place)
                work.outlines[which, k, _ACROSS + 1] = dot(e2, place)
            first, last = hull_range[of, 0], hull_range[of, 1]
            for lane in range(first, last, LANES):
                mask = plane_mask(hull, lane, (b[0], b[1], b[2], height), (d[0], d[1], d[2], later), limit)
                if last - lane < LANES:
                    mask &= (np.uint64(1) << np.uint64(last - lane)) - np.uint64(1)
                while mask != 0:
                    h = lane + lowest_bit(mask)
                    mask &= mask - np.uint64(1)
                    c, r, k = (hull[0, h], hull[1, h], hull[2, h]), hull[3, h], of_hull[h]
                    gap = height + dot(b, c) - r
                    if gap < deepest:
                        continue
                    if not moved:
                        c = plus(t, rotate(R_ij, c[0], c[1], c[2]))
                    if not _is_inside(which, dot(e1, c), dot(e2, c), work):
                        continue
                    if _is_known(found, 0 if moved else 1, k, n, gap, work):
                        continue
                    at, own, other = minus(c, times(r, q)), k, s + len(radii)
                    if not moved:  # a place on body i's face
                        at, own, other = minus(at, times(gap - kept, q)), s, k + 2 * len(radii)
                    count = _keep(count, n, at, radii[own], gap, own, other, limit, horizon, motion, t, work)
                    if count < 0:
                        return 0
    return count


@inner(forceinline=True)
def _lowest(box, n, height):
    """Return a lower bound of the heights of a body in a box (middle and half sizes) over a plane."""
    middle = height + n[0] * box[0] + n[1] * box[1] + n[2] * box[2]
    return middle - abs(n[0]) * box[3] - abs(n[1]) * box[4] - abs(n[2]) * box[5]


@inner(forceinline=True)
def _is_known(found, column, sphere, n, gap, work):
    """Return whether a candidate of a sphere has this normal and gap: that with a sphere of the same face."""
    for k in range(found):
        c = work.candidates[k]
        if work.candidate_ids[k, column] == sphere and abs(c[CANDIDATE_GAP] - gap) < _SAME:
            m = c[CANDIDATE_NORMAL], c[CANDIDATE_NORMAL + 1], c[CANDIDATE_NORMAL + 2]
            if dot(m, n) > 1.0 - _SAME:
                return True
    return False


@inner(forceinline=True)
def _is_faced(q, of, turned, world, work):
    """Return whether an outlined face of a body is opposite to a normal, body i's frame."""
    faces, ranges = world.implicit.faces, world.implicit.face_range
    for f in range(ranges[of, 0], ranges[of, 1]):
        if faces.corners[f] > 0:
            p = faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2]
            if turned:
                p = rotate(work.R_ij, p[0], p[1], p[2])
            if dot(p, q) < -FACING:
                return True
    return False


@inner(noinline=True)
def element_outlines(x, i, e, found, limit, horizon, motion, kept, world, work):
    """Append candidates of the outlines of body i's faces on sides of element e, as `pair_outlines`.

    Only boxes have such sides. Corners of the body's faces are left out, as its spheres touch elements.
    """
    if world.environment.kind[e] != _BOX:
        return found
    faces, ranges, size = world.implicit.faces, world.implicit.face_range, world.environment.size
    R_ei = work.R_ij
    write_element_rotation(work.R[i], world.environment.R[e], R_ei)
    t = in_element(world.environment.position, world.environment.R, e, x[i, 0], x[i, 1], x[i, 2])
    deepest = -_DEEPEST * world.bodies.radius[i]
    highest = limit - kept + horizon * _pace(motion, world.bodies.radius[i], 0.0)
    first, count = found, found
    for f in range(ranges[i, 0], ranges[i, 1]):
        if faces.corners[f] == 0:
            continue
        p = faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2]
        n = rotate(R_ei, p[0], p[1], p[2])
        axis, sign = -1, 0.0
        for k in range(3):
            if abs(n[k]) > FACING:
                axis, sign = k, -math.copysign(1.0, n[k])
        if axis < 0:
            continue
        q = sign * R_ei[axis, 0], sign * R_ei[axis, 1], sign * R_ei[axis, 2]
        _load_body(f, (0.0, 0.0, 0.0), _OWN, False, world, work)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for k in range(4):
            u = size[e, a] if k == 0 or k == 3 else -size[e, a]
            v = size[e, b] if k < 2 else -size[e, b]
            v *= sign  # counter-clockwise about the side's normal
            at = sign * size[e, axis]
            corner = (at, u, v) if axis == 0 else ((v, at, u) if axis == 1 else (u, v, at))
            corner = minus(corner, t)
            _put_corner(_OTHER, k, rotate_back(R_ei, corner[0], corner[1], corner[2]), k, work)
        work.outline_corners[_OTHER] = 4
        count, deepest = _overlap(
            first, count, deepest, highest, p, q, False, limit, horizon, motion, t, kept, world, work
        )
        if count < 0:
            return 0
    return count


@inner(forceinline=True)
def _pace(motion, radius, other):
    """Return a bound on the speed at which points of bodies of two radii approach each other [m/s]."""
    u, w, o = motion
    return math.sqrt(dot(u, u)) + radius * math.sqrt(dot(w, w)) + other * math.sqrt(dot(o, o))


@inner(forceinline=True)
def _load_body(f, t, which, turned, world, work):
    """Write the outline of face f, in body i's frame."""
    faces, centers, radii = world.implicit.faces, world.tree.centers, world.tree.radii
    for k in range(faces.corners[f]):
        s = faces.outline[f, k]
        r = radii[s]
        place = (
            centers[s, 0] + r * faces.normal[f, 0],
            centers[s, 1] + r * faces.normal[f, 1],
            centers[s, 2] + r * faces.normal[f, 2],
        )
        if turned:
            place = plus(t, rotate(work.R_ij, place[0], place[1], place[2]))
        _put_corner(which, k, place, s, work)
    work.outline_corners[which] = faces.corners[f]


@inner(forceinline=True)
def _put_corner(which, k, place, sphere, work):
    """Write corner k of an outline."""
    out = work.outlines[which, k]
    for c in range(3):
        out[_PLACE + c] = place[c]
    work.outline_spheres[which, k] = sphere


@inner(forceinline=True)
def _corner(which, k, work):
    """Return the place of a corner of an outline."""
    out = work.outlines[which, k]
    return out[_PLACE], out[_PLACE + 1], out[_PLACE + 2]


@inner(forceinline=True)
def _is_inside(which, a, b, work):
    """Return whether a point across the partner's face is inside an outline."""
    out, count = work.outlines[which], work.outline_corners[which]
    turn = 1.0 if which == _OTHER else -1.0  # the body's own outline is seen from behind
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        u, v = out[m, _ACROSS] - out[k, _ACROSS], out[m, _ACROSS + 1] - out[k, _ACROSS + 1]
        area = turn * (u * (b - out[k, _ACROSS + 1]) - v * (a - out[k, _ACROSS]))
        if area < 0.0 and area * area > _SLACK * _SLACK * (u * u + v * v):
            return False
    return True


@inner(noinline=True)
def _overlap(first, count, deepest, highest, p, q, pair, limit, horizon, motion, t, kept, world, work):
    """Write candidates of the overlap of two outlines, if it separates better than those from ``first`` on.

    ``p`` and ``q`` are the outward normals of body i's face and of its partner's. Faces that are farther
    apart than ``highest`` [m] do not touch within the horizon.

    Returns
    -------
    count : int
        The new number of candidates; -1 without room.
    deepest : float
        Gap at the deepest place of the kept outlines [m], which others must exceed.
    """
    own, other = work.outline_corners[_OWN], work.outline_corners[_OTHER]
    e1, e2 = tangents(q)
    p0, q0 = _corner(_OWN, 0, work), _corner(_OTHER, 0, work)
    level, least = -math.inf, math.inf
    for which in range(2):
        for k in range(work.outline_corners[which]):
            place = _corner(which, k, work)
            if which == _OWN:
                height = dot(q, minus(place, q0))
                level, least = max(level, height), min(least, height)
            work.outlines[which, k, _ACROSS] = dot(e1, place)
            work.outlines[which, k, _ACROSS + 1] = dot(e2, place)
    if level < deepest or FACING * least > highest:  # gaps are along either normal
        return count, deepest
    # two passes: the deepest place decides whether candidates are written
    lowest, written = math.inf, first
    for writes in (False, True):
        for k in range(own if pair else 0):
            s = work.outline_spheres[_OWN, k]
            u = work.outlines[_OWN, k]
            if _is_inside(_OTHER, u[_ACROSS], u[_ACROSS + 1], work):
                center = world.tree.centers[s, 0], world.tree.centers[s, 1], world.tree.centers[s, 2]
                r = world.tree.radii[s]
                gap = dot(q, minus(center, q0)) - r + kept
                lowest = min(lowest, gap)
                if writes:
                    b = work.outline_spheres[_OTHER, 0] + len(world.tree.radii)
                    at = minus(center, times(r, q))
                    written = _keep(written, q, at, r, gap, s, b, limit, horizon, motion, t, work)
                    if written < 0:
                        return -1, deepest
        n = times(-1.0, p)
        for k in range(other):
            u = work.outlines[_OTHER, k]
            if _is_inside(_OWN, u[_ACROSS], u[_ACROSS + 1], work):
                place = _corner(_OTHER, k, work)
                beyond = dot(p, minus(place, p0))
                lowest = min(lowest, beyond + kept)
                if writes:
                    s, b = work.outline_spheres[_OWN, 0], work.outline_spheres[_OTHER, k] + 1
                    if pair:
                        b += 2 * len(world.tree.radii) - 1
                    at = minus(place, times(beyond, p))
                    r = world.tree.radii[s]
                    written = _keep(written, n, at, r, beyond + kept, s, b, limit, horizon, motion, t, work)
                    if written < 0:
                        return -1, deepest
        for k in range(own):
            a0, a1 = _corner(_OWN, k, work), _corner(_OWN, k + 1 if k + 1 < own else 0, work)
            for m in range(other):
                b0, b1 = _corner(_OTHER, m, work), _corner(_OTHER, m + 1 if m + 1 < other else 0, work)
                crosses, at, gap, n = _crossing(a0, a1, b0, b1, p, q, e1, e2)
                if not crosses:
                    continue
                lowest = min(lowest, gap + kept)
                if writes:
                    s, b = work.outline_spheres[_OWN, k], work.outline_spheres[_OTHER, m] + 5
                    if pair:
                        b += 3 * len(world.tree.radii) - 5
                    r = world.tree.radii[s]
                    written = _keep(written, n, at, r, gap + kept, s, b, limit, horizon, motion, t, work)
                    if written < 0:
                        return -1, deepest
        if not writes and (lowest < deepest or lowest == math.inf):
            return count, deepest
    return written, lowest


@inner(forceinline=True)
def _keep(count, n, at, r, gap, a, b, limit, horizon, motion, t, work):
    """Store a candidate at a place on body i's face if its gap is small enough; return -1 without room."""
    u, w, o = motion
    speed = dot(n, plus(u, minus(cross(w, at), cross(o, minus(at, t)))))
    predicted = gap + horizon * speed
    if min(gap, predicted) >= limit:
        return count
    more = keep_candidate(count, n, plus(at, times(r, n)), r, gap, predicted, a, b, work)
    return more if more > 0 else -1


@inner(forceinline=True, error_model="numpy")
def _crossing(a0, a1, b0, b1, p, q, e1, e2):
    """Return whether two edges cross as seen along ``q``, the place on the first, the gap and the normal.

    The normal is that of both edges, if it is between both faces' normals.
    """
    d, f, c = minus(a1, a0), minus(b1, b0), minus(b0, a0)
    du, dv, fu, fv = dot(e1, d), dot(e2, d), dot(e1, f), dot(e2, f)
    cu, cv = dot(e1, c), dot(e2, c)
    area = du * fv - dv * fu
    if area * area <= _PARALLEL * _PARALLEL * (du * du + dv * dv) * (fu * fu + fv * fv):
        return False, a0, 0.0, q
    along, beside = (cu * fv - cv * fu) / area, (cu * dv - cv * du) / area
    if along < 0.0 or along > 1.0 or beside < 0.0 or beside > 1.0:
        return False, a0, 0.0, q
    n = cross(d, f)
    n = times(math.copysign(1.0 / math.sqrt(dot(n, n)), dot(n, q)), n)
    between = -dot(p, q) - _PARALLEL
    if dot(n, q) < between or -dot(n, p) < between:
        n = q
    at = plus(a0, times(along, d))
    return True, at, dot(n, minus(at, plus(b0, times(beside, f)))), n
