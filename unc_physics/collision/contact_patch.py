"""Reduce spheres that may touch to a few contacts, and write a row of numbers for each.

The candidates of two bodies, or of a body and an element, are grouped in patches of similar normals. Of each
patch the deepest candidate is kept, and its supports under small tilts in eight directions, which would touch
first if it turned. Depth is predicted at the interval's end, since fast closing spheres matter more than near
ones.
"""

import math

import numpy as np

from ..compiler import inner
from ..compiler.simd import LANES, lowest_bit
from ..spatial.layout import P, V, W
from ..spatial.rotation import cross, rotate, rotate_back, tangents
from ..spatial.vectors import dot, minus, plus, times
from .contact_candidates import UNASSIGNED, keep_candidate, partner_sphere
from .contact_model import reduced_radius
from .contact_row import (
    AXIS,
    COMPLIANCE,
    DIRECTION,
    DIRECTION_J,
    DRIFT,
    FALL,
    FIRST,
    FORCE,
    FRICTION,
    GAP,
    INVERSE_MASS_I,
    INVERSE_MASS_J,
    MOMENT_I,
    MOMENT_J,
    PUSH_I,
    PUSH_J,
    RADIUS,
    REACH,
    RESTITUTION,
    ROLL_RADIUS,
    SLIP_COMPLIANCE,
    SPIN_COMPLIANCE,
    SPIN_I,
    SPIN_J,
    TURN_I,
    TURN_J,
)
from .contact_search import (
    ACTIVE_GAP,
    LIST_MARGIN,
    LIST_STEPS,
    box_gap,
    column_of,
    element_list,
    half_way,
    half_way_by,
    pair_list,
    relative_pose,
    side_of,
)
from .contact_simd import lower_supports, plane_mask
from .element_contacts import in_element, is_covered, write_element_rotation
from .face_outlines import FACING, element_outlines, pair_outlines, spheres_on_faces
from .faces import FACES_OF_A_SPHERE, over_face
from .implicit_workspace import CANDIDATE_GAP, CANDIDATE_SCORE, CONTACTS, OVERFLOW, TOO_MANY_CONTACTS
from .shapes import KINDS, bounds, surface

#: Largest gap of contacts in an impact [m].
IMPACT_GAP = 2e-4
#: Tilts of a patch in the search for its supports: least and largest [rad].
TILT, _MOST_TILT = 0.02, 0.5
#: Bonus depth of contacts that carried load [m], and its limit as a share of the body's radius.
_LOADED_BONUS, _LOADED_SHARE = 2e-5, 0.01
_TURNING = 2e-3  # rotation speed of a body's points above which the bonus is zero [m/s]
_SAME_PATCH = 0.9  # least cosine of the angle between normals of a patch
_OVER = 0.5  # least cosine of the angle between the normals of two spheres and of a face
_HOLLOW = 1.5e-4  # largest depth of a face contact below the sphere contact [m]; no contact begins deeper
_SLIDING = 5e-4  # the same of a solid face that slides on another, to which free motion adds [m]
_LEVEL = 1e-4  # depth of a resting face at an edge that it passes [m], to which free motion adds
_BOX = KINDS["box"]
_HALF = math.sqrt(0.5)
_IN_PATCH, _CHOSEN = 1, 2  # states of a candidate


@inner(forceinline=True)
def needed_gap(limit):
    """Return the gap [m] for which lists are built, which must also cover a step's next searches."""
    return limit if limit <= 0.0 else max(limit, ACTIVE_GAP)


@inner(noinline=True)
def element_candidates(x, i, e, limit, horizon, world, work):
    """Find spheres of body i with a gap to element e below ``limit`` [m]; return their number.

    The gap is the current one, or the predicted one after ``horizon`` seconds.
    """
    kind, size, R_e, R = world.environment.kind, world.environment.size, world.environment.R[e], work.R[i]
    t = in_element(world.environment.position, world.environment.R, e, x[i, P], x[i, P + 1], x[i, P + 2])
    half = 0.5 * horizon
    vx, vy = x[i, V] + half * world.gravity[0], x[i, V + 1] + half * world.gravity[1]
    vz = x[i, V + 2] + half * world.gravity[2]
    kept = work.kept_overlap[i, len(x) + e]
    axis, sign, offset = side_of(kind, size, e, t, R_e, R, world.implicit.extent[i])
    count = 0
    if axis >= 0:
        # one plane: distances are linear in the centres of the hull's spheres, tested eight at once
        height = sign * t[axis] - offset + kept
        nx, ny, nz = sign * R_e[0, axis], sign * R_e[1, axis], sign * R_e[2, axis]
        bx, by, bz = rotate_back(R, nx, ny, nz)
        cx, cy = ny * x[i, W + 2] - nz * x[i, W + 1], nz * x[i, W] - nx * x[i, W + 2]
        cz = nx * x[i, W + 1] - ny * x[i, W]
        qx, qy, qz = rotate_back(R, cx, cy, cz)  # n . (omega x c) = c . (n x omega)
        qx, qy, qz = bx + horizon * qx, by + horizon * qy, bz + horizon * qz
        later = height + horizon * (nx * vx + ny * vy + nz * vz)
        box = world.implicit.box[i]
        least = height + bx * box[0] + by * box[1] + bz * box[2]
        least -= abs(bx) * box[3] + abs(by) * box[4] + abs(bz) * box[5]
        soon = later + qx * box[0] + qy * box[1] + qz * box[2]
        soon -= abs(qx) * box[3] + abs(qy) * box[4] + abs(qz) * box[5]
        if min(least, soon) >= limit:
            return 0
        first, last = world.implicit.hull_range[i, 0], world.implicit.hull_range[i, 1]
        hull = world.implicit.hull
        for k in range(first, last, LANES):
            mask = plane_mask(hull, k, (bx, by, bz, height), (qx, qy, qz, later), limit)
            if last - k < LANES:
                mask &= (np.uint64(1) << np.uint64(last - k)) - np.uint64(1)
            while mask != 0:
                m = k + lowest_bit(mask)
                mask &= mask - np.uint64(1)
                c, r = (hull[0, m], hull[1, m], hull[2, m]), hull[3, m]
                gap = height + bx * c[0] + by * c[1] + bz * c[2] - r
                predicted = later + qx * c[0] + qy * c[1] + qz * c[2] - r
                s = world.implicit.hull_sphere[m]
                count = keep_candidate(count, (bx, by, bz), c, r, gap, predicted, s, 0, work)
                if count == 0:
                    return 0
    else:
        several = len(kind) > 1
        g = world.gravity
        level = _LEVEL + kept + world.dt * world.dt * math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
        R_ei = work.R_ij
        write_element_rotation(R, R_e, R_ei)
        t_half, reach = half_way_by(x, i, e, (vx, vy, vz), horizon, world, R_ei)
        element_list(i, e, t_half, needed_gap(limit) + reach, LIST_MARGIN + LIST_STEPS * reach, world, work)
        ux, uy, uz = rotate_back(R, vx, vy, vz)
        wx, wy, wz = rotate_back(R, x[i, W], x[i, W + 1], x[i, W + 2])
        start = work.lists[i, len(x) + e, 0]
        stop = start + work.lists[i, len(x) + e, 1]
        spheres, near = work.pool_spheres, work.low
        ax, ay, az = spheres[0, start:stop], spheres[1, start:stop], spheres[2, start:stop]
        ar = spheres[3, start:stop]
        _near_box(R_ei, t_half, bounds(kind, size, e), (ax, ay, az, ar), limit + reach - kept, near)
        write_element_rotation(R, R_e, R_ei)
        for k in range(stop - start):
            if near[k] < 0.0:
                continue
            s = work.pool[start + k, 0]
            cx, cy, cz, r = ax[k], ay[k], az[k], ar[k]
            px, py, pz = rotate(R_ei, cx, cy, cz)
            distance, (nx, ny, nz) = surface(kind, size, e, px + t[0], py + t[1], pz + t[2])
            gap = distance - r + kept
            bx, by, bz = rotate_back(R_ei, nx, ny, nz)
            mx, my, mz = ux + wy * cz - wz * cy, uy + wz * cx - wx * cz, uz + wx * cy - wy * cx
            predicted = gap + horizon * (bx * mx + by * my + bz * mz)
            if min(gap, predicted) < limit:
                # the normal of a face is along an axis
                if max(abs(nx), abs(ny), abs(nz)) < 1.0:
                    if several:
                        qx, qy, qz = rotate(R, cx, cy, cz)
                        center = (x[i, P] + qx, x[i, P + 1] + qy, x[i, P + 2] + qz)
                        if is_covered(world.environment, e, center, (nx, ny, nz), distance):
                            continue
                    place = (px + t[0], py + t[1], pz + t[2])
                    way = (horizon * mx, horizon * my, horizon * mz)
                    if _passes_edge(s, e, (nx, ny, nz), place, way, level, R_ei, world):
                        continue
                count = keep_candidate(count, (bx, by, bz), (cx, cy, cz), r, gap, predicted, s, 0, work)
                if count == 0:
                    return 0
        motion = (ux, uy, uz), (wx, wy, wz), (0.0, 0.0, 0.0)
        count = element_outlines(x, i, e, count, limit, horizon, motion, kept, world, work)
    return count


@inner(noinline=True)
def _passes_edge(s, e, n, center, way, level, R_ei, world):
    """Return whether sphere ``s`` passes an edge of box e, as its solid face is not below the box's side.

    The sphere is beside the side. Its round surface touches the edge at a slant, but its face, which is
    nearly parallel to the side, touches nothing before it is over the side.

    Parameters
    ----------
    s, e : int
    n : tuple of 3 floats
        Normal of the box at the sphere, from an edge or a corner. It is in the box's frame, as ``center``.
    center : tuple of 3 floats
        Of the sphere [m].
    way : tuple of 3 floats
        Of the sphere until the horizon; body frame [m].
    level : float
        Depth of a face that still passes: its depth at rest and by free motion [m].
    R_ei : (3, 3) array
        Rotation from body to box axes.
    world : World
    """
    if world.environment.kind[e] != _BOX:
        return False
    faces, r = world.implicit.faces, world.tree.radii[s]
    for k in range(FACES_OF_A_SPHERE):
        f = faces.of_sphere[s, k]
        if f < 0 or faces.corners[f] == 0:
            continue
        p = rotate(R_ei, faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2])
        v = rotate(R_ei, way[0], way[1], way[2])
        for axis in range(3):
            if n[axis] * p[axis] < 0.0 and abs(p[axis]) > FACING:
                sign = math.copysign(1.0, n[axis])
                height = sign * (center[axis] + r * p[axis]) - world.environment.size[e, axis]
                if min(height, height + sign * v[axis]) > -level:
                    return True
    return False


@inner(forceinline=True)
def _near_box(R, t, corners, spheres, reach, near):
    """Write a number for each sphere that is negative unless a box is nearer than ``reach`` [m].

    ``R`` and ``t`` transform the spheres (x, y, z and radii) into the frame of the box, given by its lowest
    and highest corner.
    """
    xx, xy, xz, yx, yy, yz = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2]
    zx, zy, zz = R[2, 0], R[2, 1], R[2, 2]
    (ax, ay, az), (bx, by, bz) = corners
    ux, uy, uz, r = spheres
    for k in range(len(r)):
        px = t[0] + xx * ux[k] + xy * uy[k] + xz * uz[k]
        py = t[1] + yx * ux[k] + yy * uy[k] + yz * uz[k]
        pz = t[2] + zx * ux[k] + zy * uy[k] + zz * uz[k]
        dx, dy, dz = max(ax - px, px - bx, 0.0), max(ay - py, py - by, 0.0), max(az - pz, pz - bz, 0.0)
        least = max(r[k] + reach, 0.0)
        near[k] = least * least - (dx * dx + dy * dy + dz * dz)


@inner(noinline=True)
def pair_candidates(x, i, j, limit, horizon, world, work):
    """Find pairs of spheres of bodies i and j with a gap below ``limit`` [m]; return their number.

    The gap is the current one, or the predicted one after ``horizon`` seconds.
    """
    low, high = min(i, j), max(i, j)
    kept = work.kept_overlap[low, high]
    t, reach = half_way(x, low, high, horizon, world, work)
    if box_gap(world.implicit.box[low], world.implicit.box[high], work.R_ij, t) + kept >= limit + reach:
        return 0
    pair_list(low, high, t, needed_gap(limit) + reach, world, work)
    R_ij, R_i, pool = work.R_ij, work.R[i], work.pool
    t = relative_pose(x, i, j, work.R, R_ij)
    half = 0.5 * horizon * (np.float64(work.moving[i]) - np.float64(work.moving[j]))
    vx, vy, vz = x[i, V] - x[j, V], x[i, V + 1] - x[j, V + 1], x[i, V + 2] - x[j, V + 2]
    u = rotate_back(
        R_i, vx + half * world.gravity[0], vy + half * world.gravity[1], vz + half * world.gravity[2]
    )
    w = rotate_back(R_i, x[i, W], x[i, W + 1], x[i, W + 2])
    o = rotate_back(R_i, x[j, W], x[j, W + 1], x[j, W + 2])
    R = (
        (R_ij[0, 0], R_ij[0, 1], R_ij[0, 2]),
        (R_ij[1, 0], R_ij[1, 1], R_ij[1, 2]),
        (R_ij[2, 0], R_ij[2, 1], R_ij[2, 2]),
    )
    start = work.lists[low, high, 0]
    stop = start + work.lists[low, high, 1]
    own, other = (0, 4) if i < j else (4, 0)
    spheres, least, faces = work.pool_spheres, work.low, world.implicit.faces
    cx, cy, cz = spheres[own, start:stop], spheres[own + 1, start:stop], spheres[own + 2, start:stop]
    ex, ey, ez = spheres[other, start:stop], spheres[other + 1, start:stop], spheres[other + 2, start:stop]
    cr, er = spheres[own + 3, start:stop], spheres[other + 3, start:stop]
    for k in range(stop - start):
        gap, predicted, _ = _pair_gap(
            (cx[k], cy[k], cz[k]), cr[k], (ex[k], ey[k], ez[k]), er[k], R, t, u, w, o, horizon, kept
        )
        least[k] = min(gap, predicted)
    count = 0
    for k in range(stop - start):
        if least[k] < limit:
            c, r = (cx[k], cy[k], cz[k]), cr[k]
            gap, predicted, n = _pair_gap(c, r, (ex[k], ey[k], ez[k]), er[k], R, t, u, w, o, horizon, kept)
            if math.isnan(predicted):  # the same centre: no force, and any way out of the overlap is as good
                if horizon > 0.0:
                    continue
                predicted, n = gap, (1.0, 0.0, 0.0)
            a, b = pool[start + k, 0], pool[start + k, 1]
            if i > j:
                a, b = b, a
            if faces.of_sphere[a, 0] >= 0 or faces.of_sphere[b, 0] >= 0:
                e, s = (ex[k], ey[k], ez[k]), er[k]
                n, c, gap, speed = _face_contact(a, b, n, c, r, e, s, gap, R_ij, t, u, w, o, kept, world)
                predicted = gap + horizon * speed
            count = keep_candidate(count, n, c, r, gap, predicted, a, b, work)
            if count == 0:
                return 0
    found = pair_outlines(i, j, t, count, limit, horizon, (u, w, o), kept, world, work)
    if found == 0 and count > 0:
        return 0
    return spheres_on_faces(i, j, t, found, limit, horizon, (u, w, o), kept, world, work)


@inner(forceinline=True, error_model="numpy")
def _pair_gap(c, r, e, s, R, t, u, w, o, horizon, kept):
    """Return a gap of two spheres [m], the gap after ``horizon`` seconds, and the normal towards body i.

    The spheres belong to bodies i and j. Spheres with the same centre have no normal; the result is then NaN.
    All vectors except ``e`` are in body i's frame; ``R`` (rows) and ``t`` transform ``e`` to it. ``u`` is the
    relative velocity of the bodies, ``w`` and ``o`` are their angular velocities.
    """
    px = R[0][0] * e[0] + R[0][1] * e[1] + R[0][2] * e[2]
    py = R[1][0] * e[0] + R[1][1] * e[1] + R[1][2] * e[2]
    pz = R[2][0] * e[0] + R[2][1] * e[1] + R[2][2] * e[2]
    dx, dy, dz = c[0] - px - t[0], c[1] - py - t[1], c[2] - pz - t[2]
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    gap = d - r - s + kept
    nx, ny, nz = dx / d, dy / d, dz / d
    mx = u[0] + w[1] * c[2] - w[2] * c[1] - (o[1] * pz - o[2] * py)
    my = u[1] + w[2] * c[0] - w[0] * c[2] - (o[2] * px - o[0] * pz)
    mz = u[2] + w[0] * c[1] - w[1] * c[0] - (o[0] * py - o[1] * px)
    return gap, gap + horizon * (nx * mx + ny * my + nz * mz), (nx, ny, nz)


@inner
def _face_contact(a, b, n, c, r, e, s, gap, R_ij, t, u, w, o, kept, world):
    """Return the contact of sphere a of body i and b of body j with a flat face that one of them touches.

    The other sphere must be over the face, and the spheres' normal near the face's normal. Of several faces,
    the one with the largest gap is used, as it separates the bodies best, unless it is much deeper than the
    spheres. Free motion takes two solid faces that slide on each other deeper than hollow bodies. All vectors
    except ``e`` are in body i's frame, as in `_pair_gap`.

    Returns
    -------
    n : tuple of 3 floats
        Normal towards body i.
    center : tuple of 3 floats
        Centre from which the contact is at sphere a's radius, against the normal [m].
    gap : float
        [m]
    speed : float
        Rate of change of the gap [m/s].
    """
    faces, centers = world.implicit.faces, world.tree.centers
    q = rotate(R_ij, e[0], e[1], e[2])
    p = plus(q, t)
    apart = minus(c, p)
    # spheres with a larger lateral offset belong to different places of the face of a body that may be hollow
    least = dot(apart, apart) - (2.0 * min(r, s)) ** 2
    best, m, center, slides = -np.inf, n, c, False
    for k in range(FACES_OF_A_SPHERE):
        f = faces.of_sphere[b, k]
        if f >= 0:
            v = rotate(R_ij, faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2])
            along = dot(v, apart)
            height = along - r - s
            near = faces.corners[f] > 0 or along * along > least
            if height > best and near and dot(v, n) > _OVER:
                back = rotate_back(R_ij, c[0] - t[0], c[1] - t[1], c[2] - t[2])
                if over_face(f, back, centers, faces):
                    best, m, center = height, v, c
                    slides = faces.corners[f] > 0 and _touches_opposite(a, v, faces)
        f = faces.of_sphere[a, k]
        if f >= 0:
            v = (-faces.normal[f, 0], -faces.normal[f, 1], -faces.normal[f, 2])
            along = dot(v, apart)
            height = along - r - s
            near = faces.corners[f] > 0 or along * along > least
            if height > best and near and dot(v, n) > _OVER and over_face(f, p, centers, faces):
                best, m, center = height, v, plus(p, times(s + height + r, v))
                back = rotate_back(R_ij, -v[0], -v[1], -v[2])
                slides = faces.corners[f] > 0 and _touches_opposite(b, back, faces)
    if best + kept < gap - (_SLIDING if slides else _HOLLOW):
        m, center = n, c
    else:
        gap = best + kept
    about_i, about_j = cross(w, center), cross(o, minus(center, t))
    return m, center, gap, dot(m, plus(u, minus(about_i, about_j)))


@inner(forceinline=True)
def _touches_opposite(s, v, faces):
    """Return whether sphere s touches a solid face with a normal opposite to ``v``; body frame."""
    for k in range(FACES_OF_A_SPHERE):
        f = faces.of_sphere[s, k]
        if f >= 0 and faces.corners[f] > 0:
            if dot(v, (faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2])) < -FACING:
                return True
    return False


@inner(noinline=True)
def add_contacts(x, i, j, count, tilt, speeds_only, world, work):
    """Choose contacts among the first ``count`` candidates of body i with body j, or element ``-1 - j``.

    Supports of a patch are found by tilting it by ``tilt`` [rad]. ``speeds_only`` is as in `write_contact`.
    """
    candidates, ids, best, score = work.candidates, work.candidate_ids, work.best, work.best_score
    bonus = 0.0 if _rolls(x, i, j, world) else min(_LOADED_BONUS, _LOADED_SHARE * world.bodies.radius[i])
    _favour_loaded(i, j, count, bonus, work.head, work.link, work.old_contact, candidates, ids)
    if count == 1:
        write_contact(x, i, j, 0, speeds_only, world, work)
        _mark_first(work.counts[CONTACTS] - 1, work)
        return
    left = count
    while left > 0:
        before = work.counts[CONTACTS]
        seed = -1
        for k in range(count):
            if ids[k, 2] == UNASSIGNED and (
                seed < 0
                or _deeper(ids, k, candidates[k, CANDIDATE_SCORE], seed, candidates[seed, CANDIDATE_SCORE])
            ):
                seed = k
        nx, ny, nz = candidates[seed, 0], candidates[seed, 1], candidates[seed, 2]
        first, second = tangents((nx, ny, nz))
        best[8] = seed
        for d in range(8):
            best[d], score[d] = -1, np.inf
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] != UNASSIGNED or c[0] * nx + c[1] * ny + c[2] * nz < _SAME_PATCH:
                continue
            ids[k, 2] = _IN_PATCH
            left -= 1
            u = tilt * (first[0] * c[3] + first[1] * c[4] + first[2] * c[5])
            w = tilt * (second[0] * c[3] + second[1] * c[4] + second[2] * c[5])
            ties = lower_supports(score, best, k, c[CANDIDATE_SCORE], u, w, _HALF * (u + w), _HALF * (u - w))
            while ties != 0:
                d = lowest_bit(ties)
                ties &= ties - np.uint64(1)
                if _deeper(ids, k, score[d], best[d], score[d]):
                    best[d] = k
        for d in range(8, -1, -1):
            k = best[d]
            if ids[k, 2] == _IN_PATCH:
                ids[k, 2] = _CHOSEN
                write_contact(x, i, j, k, speeds_only, world, work)
        _mark_first(before, work)


@inner(forceinline=True)
def patch_tilt(x, i, j, turned):
    """Return the tilt for the supports of a patch of body i with body j, or an element [rad].

    The bodies have rotated freely for ``turned`` seconds. Contacts may undo this rotation, so spheres that
    would then touch first are supports as well.
    """
    return min(max(TILT, turned * _spin(x, i, j)), _MOST_TILT)


@inner(forceinline=True)
def _spin(x, i, j):
    """Return the angular speed of body i relative to body j, or to the world for a negative ``j`` [rad/s]."""
    square = 0.0
    for k in range(3):
        w = x[i, W + k] - x[j, W + k] if j >= 0 else x[i, W + k]
        square += w * w
    return math.sqrt(square)


@inner(forceinline=True)
def _rolls(x, i, j, world):
    """Return whether body i rotates relative to its partner, so that other spheres will touch."""
    return world.bodies.radius[i] * _spin(x, i, j) > _TURNING


@inner(forceinline=True)
def _mark_first(c, work):
    """Mark a contact as the first of its patch, if it was stored."""
    if c >= 0 and c < work.counts[CONTACTS]:
        work.rows[c, FIRST] = 1.0


@inner(forceinline=True)
def _deeper(ids, k, score, other, other_score):
    """Return whether candidate ``k`` is deeper than ``other``; sphere indices break ties."""
    if score != other_score:
        return score < other_score
    return ids[k, 0] < ids[other, 0] or (ids[k, 0] == ids[other, 0] and ids[k, 1] < ids[other, 1])


@inner
def _favour_loaded(i, j, count, bonus, head, link, contact, candidates, ids):
    """Add ``bonus`` to the depth of candidates that carried load in the last step; contacts then persist."""
    entry = head[i]
    while entry >= 0:
        if contact[entry, 1] == j:
            for k in range(count):
                if ids[k, 0] == contact[entry, 2] and ids[k, 1] == contact[entry, 3]:
                    candidates[k, CANDIDATE_SCORE] -= bonus
                    ids[k, 3] = entry
                    break
        entry = link[entry]


@inner(error_model="numpy")
def write_contact(x, i, j, k, speeds_only, world, work):
    """Write candidate ``k`` of body i with body j, or element ``-1 - j``, as a contact.

    With ``speeds_only``, the row has only the columns for the time of closing.
    """
    m = work.counts[CONTACTS]
    if m >= len(work.rows):
        work.counts[OVERFLOW] = TOO_MANY_CONTACTS
        return
    work.counts[CONTACTS] = m + 1
    row, c, R = work.rows[m], work.candidates[k], work.R[i]
    a, b = work.candidate_ids[k, 0], work.candidate_ids[k, 1]
    work.ids[m, 0], work.ids[m, 1], work.ids[m, 2], work.ids[m, 3] = i, j, a, b
    n = rotate(R, c[0], c[1], c[2])
    gap, r = c[CANDIDATE_GAP], world.tree.radii[a]
    # free motion into an element overestimates the overlap
    half = 0.5 * gap if j >= 0 else 0.5 * max(gap, 0.0)
    arm = rotate(R, c[3] - half * c[0], c[4] - half * c[1], c[5] - half * c[2])
    omega = (x[i, W], x[i, W + 1], x[i, W + 2])
    # the centripetal acceleration of the sphere's centre changes the gap
    h = rotate(R, c[3] + r * c[0], c[4] + r * c[1], c[5] + r * c[2])
    bend = _centripetal(n, omega, h)
    other = (0.0, 0.0, 0.0)
    partner = column_of(j, len(x))
    reach = world.bodies.radius[i]
    if j >= 0:
        rj = world.tree.radii[partner_sphere(b, world.tree.radii)]
        other = (
            arm[0] + x[i, P] - x[j, P],
            arm[1] + x[i, P + 1] - x[j, P + 1],
            arm[2] + x[i, P + 2] - x[j, P + 2],
        )
        reach = min(reach, world.bodies.radius[j])
        g = gap - half + rj
        bend -= _centripetal(
            n,
            (x[j, W], x[j, W + 1], x[j, W + 2]),
            (other[0] - g * n[0], other[1] - g * n[1], other[2] - g * n[2]),
        )
        r = reduced_radius(r, rj)
    row[GAP], row[FIRST], row[FALL], row[RADIUS] = gap, 0.0, bend, r
    if j < 0 or not work.moving[j]:
        row[FALL] += n[0] * world.gravity[0] + n[1] * world.gravity[1] + n[2] * world.gravity[2]
    row[RESTITUTION] = math.sqrt(world.implicit.restitution[i] * world.implicit.restitution[partner])
    row[ROLL_RADIUS] = reach
    if speeds_only:
        _write_direction(row, DIRECTION, n)
        _write_direction(row, MOMENT_I, cross(arm, n))
        if j >= 0:
            _write_direction(row, DIRECTION_J, n)
            _write_direction(row, MOMENT_J, cross(other, n))
        return
    first, second = tangents(n)
    row[FRICTION] = math.sqrt(world.implicit.friction[i] * world.implicit.friction[partner])
    row[INVERSE_MASS_I] = work.inverse_mass[i]
    row[INVERSE_MASS_J] = work.inverse_mass[j] if j >= 0 else 0.0
    for d, axis in ((0, n), (1, first), (2, second)):
        at = AXIS * d
        moment = cross(arm, axis)
        turn = rotate(work.inverse_inertia[i], moment[0], moment[1], moment[2])
        _write_direction(row, at + DIRECTION, axis)
        _write_direction(row, at + MOMENT_I, moment)
        _write_direction(row, at + PUSH_I, times(row[INVERSE_MASS_I], axis))
        _write_direction(row, at + TURN_I, turn)
        own = row[INVERSE_MASS_I] + moment[0] * turn[0] + moment[1] * turn[1] + moment[2] * turn[2]
        if j >= 0:
            moment = cross(other, axis)
            turn = rotate(work.inverse_inertia[j], moment[0], moment[1], moment[2])
            _write_direction(row, at + DIRECTION_J, axis)
            _write_direction(row, at + MOMENT_J, moment)
            _write_direction(row, at + PUSH_J, times(row[INVERSE_MASS_J], axis))
            _write_direction(row, at + TURN_J, turn)
            own += row[INVERSE_MASS_J] + moment[0] * turn[0] + moment[1] * turn[1] + moment[2] * turn[2]
        if d == 0:
            row[COMPLIANCE] = own
        elif d == 1:
            row[SLIP_COMPLIANCE] = own
        else:
            row[SLIP_COMPLIANCE] = max(row[SLIP_COMPLIANCE], own)
    row[DRIFT] = row[DRIFT + 1] = 0.0
    if j < 0 and len(world.environment.actions.surface) > 0:
        at = (x[i, P] + arm[0], x[i, P + 1] + arm[1], x[i, P + 2] + arm[2])
        _write_drift(row, world.environment.actions.surface[-1 - j], at, first, second)
    if world.implicit.torsional:
        _write_torsion_row(i, j, partner, n, world, work, work.torsion_rows[m])
    _recall_force(work.candidate_ids[k, 3], row, first, second, work.old_force)


@inner
def _write_drift(row, surface, at, first, second):
    """Write the velocity of a moving surface at a point, along both tangents."""
    turning = cross((surface[3], surface[4], surface[5]), at)
    v = (surface[0] + turning[0], surface[1] + turning[1], surface[2] + turning[2])
    row[DRIFT] = first[0] * v[0] + first[1] * v[1] + first[2] * v[2]
    row[DRIFT + 1] = second[0] * v[0] + second[1] * v[1] + second[2] * v[2]


@inner(error_model="numpy")
def _write_torsion_row(i, j, partner, n, world, work, torsion):
    """Write the torsional friction row of a contact."""
    a, b = world.implicit.torsion[i], world.implicit.torsion[partner]
    torsion[REACH] = math.sqrt(a * b) if a >= 0.0 and b >= 0.0 else max(a, b, 0.0)
    turn = rotate(work.inverse_inertia[i], n[0], n[1], n[2])
    own = n[0] * turn[0] + n[1] * turn[1] + n[2] * turn[2]
    _write_direction(torsion, SPIN_I, turn)
    turn = (0.0, 0.0, 0.0)
    if j >= 0:
        turn = rotate(work.inverse_inertia[j], n[0], n[1], n[2])
        own += n[0] * turn[0] + n[1] * turn[1] + n[2] * turn[2]
    _write_direction(torsion, SPIN_J, turn)
    torsion[SPIN_COMPLIANCE] = own


@inner(forceinline=True)
def _recall_force(entry, row, first, second, force):
    """Write the contact's force of the last step in place of impulses [N]; 0 for a new contact."""
    row[FORCE] = row[FORCE + 1] = row[FORCE + 2] = 0.0
    if entry >= 0:
        row[FORCE] = force[entry, 0]
        fx, fy, fz = force[entry, 1], force[entry, 2], force[entry, 3]
        row[FORCE + 1] = first[0] * fx + first[1] * fy + first[2] * fz
        row[FORCE + 2] = second[0] * fx + second[1] * fy + second[2] * fz


@inner(forceinline=True)
def _write_direction(row, at, v):
    row[at], row[at + 1], row[at + 2] = v[0], v[1], v[2]


@inner(forceinline=True)
def _centripetal(n, w, r):
    """Return ``n . (w x (w x r))`` [m/s^2]."""
    return (w[0] * r[0] + w[1] * r[1] + w[2] * r[2]) * (w[0] * n[0] + w[1] * n[1] + w[2] * n[2]) - (
        w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    ) * (r[0] * n[0] + r[1] * n[1] + r[2] * n[2])
