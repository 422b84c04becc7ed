"""From spheres that may touch to a few contacts that stand for them, and a row of numbers for each.

The candidates of two bodies, or of a body and an element, fall into patches of similar normals. Of each patch
the deepest candidate stays, and the supports of the patch tilted a little in eight directions: those that
would touch first if it turned. Depth is that which the interval's end will have, since what is closing fast
matters more than what is near.
"""

import math

import numpy as np

from .compiled import inner
from .contact_model import reduced_radius
from .contact_search import (
    ACTIVE_GAP,
    LIST_MARGIN,
    LIST_STEPS,
    closing_bound,
    column_of,
    element_list,
    pair_list,
    relative_pose,
    side_of,
)
from .element_contacts import in_element
from .implicit_workspace import (
    BEND,
    CANDIDATE_GAP,
    CANDIDATE_NORMAL,
    CANDIDATE_POINT,
    CANDIDATE_SCORE,
    COMPLIANCE,
    CONTACTS,
    DIRECTION,
    FALL,
    FORCE,
    FRICTION,
    GAP,
    INVERSE_MASS_I,
    INVERSE_MASS_J,
    MOMENT_I,
    MOMENT_J,
    OVERFLOW,
    PACE,
    RADIUS,
    RESTITUTION,
    SLIP_COMPLIANCE,
    TOO_MANY_CANDIDATES,
    TOO_MANY_CONTACTS,
    TURN_I,
    TURN_J,
)
from .layout import P, V, W
from .rotation import rotate, rotate_back, tangents
from .shapes import surface

#: Gap up to which contacts take part in an impact [m].
IMPACT_GAP = 2e-4
#: Tilt of a patch in search of its supports, of a step [rad].
TILT = 0.02
#: How much deeper a contact counts that carried load [m]: no more than a share of the body's radius.
_LOADED_BONUS, _LOADED_SHARE = 2e-5, 0.01
_SAME_PATCH = 0.9  # cosine of the angle between normals
_HALF = math.sqrt(0.5)
_FREE, _IN_PATCH, _CHOSEN = 0, 1, 2  # what a candidate is


@inner(forceinline=True)
def needed_gap(limit):
    """Gap up to which lists hold what is needed up to ``limit`` [m]; a step's next searches want more."""
    return limit if limit <= 0.0 else max(limit, ACTIVE_GAP)


@inner(forceinline=True)
def element_candidates(x, i, e, limit, horizon, world, work):
    """Find the spheres of body i whose gap to element e is below ``limit`` [m], or will be after ``horizon``
    seconds; returns how many there are.
    """
    kind, size, R_e, R = world.surroundings.kind, world.surroundings.size, world.surroundings.R[e], work.R[i]
    t = in_element(world.surroundings.position, world.surroundings.R, e, x[i, P], x[i, P + 1], x[i, P + 2])
    half = 0.5 * horizon
    vx, vy = x[i, V] + half * world.gravity[0], x[i, V + 1] + half * world.gravity[1]
    vz = x[i, V + 2] + half * world.gravity[2]
    kept = work.kept_overlap[i, len(x) + e]
    axis, sign, offset = side_of(kind, size, e, t, R_e, R, world.implicit.extent[i])
    count = 0
    if axis >= 0:
        # one plane: distances are linear in the spheres' centres, so that its hull is asked in one loop
        height = sign * t[axis] - offset + kept
        nx, ny, nz = sign * R_e[0, axis], sign * R_e[1, axis], sign * R_e[2, axis]
        bx, by, bz = rotate_back(R, nx, ny, nz)
        cx, cy = ny * x[i, W + 2] - nz * x[i, W + 1], nz * x[i, W] - nx * x[i, W + 2]
        cz = nx * x[i, W + 1] - ny * x[i, W]
        qx, qy, qz = rotate_back(R, cx, cy, cz)  # n . (omega x c) = c . (n x omega)
        qx, qy, qz = bx + horizon * qx, by + horizon * qy, bz + horizon * qz
        later = height + horizon * (nx * vx + ny * vy + nz * vz)
        hull, first = world.implicit.hull, world.implicit.hull_range[i, 0]
        last = world.implicit.hull_range[i, 1]
        for k in range(first, last):
            ux, uy, uz, r = hull[k, 0], hull[k, 1], hull[k, 2], hull[k, 3]
            gap = height + bx * ux + by * uy + bz * uz - r
            predicted = later + qx * ux + qy * uy + qz * uz - r
            if min(gap, predicted) < limit:
                s = world.implicit.hull_sphere[k]
                count = _keep_candidate(count, (bx, by, bz), (ux, uy, uz), r, gap, predicted, s, 0, work)
                if count == 0:
                    return 0
    else:
        travel = horizon * work.numbers[i, PACE]
        element_list(x, i, e, needed_gap(limit) + travel, LIST_MARGIN + LIST_STEPS * travel, world, work)
        R_ei = work.R_ij
        ux, uy, uz = rotate_back(R, vx, vy, vz)
        wx, wy, wz = rotate_back(R, x[i, W], x[i, W + 1], x[i, W + 2])
        centers, radii, pool = world.tree.centers, world.tree.radii, work.pool
        start = work.lists[i, len(x) + e, 0]
        for k in range(start, start + work.lists[i, len(x) + e, 1]):
            s = pool[k, 0]
            cx, cy, cz, r = centers[s, 0], centers[s, 1], centers[s, 2], radii[s]
            px, py, pz = rotate(R_ei, cx, cy, cz)
            distance, (nx, ny, nz) = surface(kind, size, e, px + t[0], py + t[1], pz + t[2])
            gap = distance - r + kept
            bx, by, bz = rotate_back(R_ei, nx, ny, nz)
            mx, my, mz = ux + wy * cz - wz * cy, uy + wz * cx - wx * cz, uz + wx * cy - wy * cx
            predicted = gap + horizon * (bx * mx + by * my + bz * mz)
            if min(gap, predicted) < limit:
                count = _keep_candidate(count, (bx, by, bz), (cx, cy, cz), r, gap, predicted, s, 0, work)
                if count == 0:
                    return 0
    return count


@inner(forceinline=True)
def pair_candidates(x, i, j, limit, horizon, world, work):
    """Find the pairs of spheres of bodies i and j whose gap is below ``limit`` [m], or will be after
    ``horizon`` seconds; returns how many there are.
    """
    R_ij, R = work.R_ij, work.R[i]
    centers, radii, pool = world.tree.centers, world.tree.radii, work.pool
    low, high = min(i, j), max(i, j)
    kept = work.kept_overlap[low, high]
    pair_list(x, low, high, needed_gap(limit) + horizon * closing_bound(x, i, j, world), world, work)
    t = relative_pose(x, i, j, work.R, R_ij)
    half = 0.5 * horizon * (np.float64(world.bodies.moving[i]) - np.float64(world.bodies.moving[j]))
    vx, vy, vz = x[i, V] - x[j, V], x[i, V + 1] - x[j, V + 1], x[i, V + 2] - x[j, V + 2]
    ux, uy, uz = rotate_back(
        R, vx + half * world.gravity[0], vy + half * world.gravity[1], vz + half * world.gravity[2]
    )
    wx, wy, wz = rotate_back(R, x[i, W], x[i, W + 1], x[i, W + 2])
    ox, oy, oz = rotate_back(R, x[j, W], x[j, W + 1], x[j, W + 2])
    start = work.lists[low, high, 0]
    count = 0
    for k in range(start, start + work.lists[low, high, 1]):
        a, b = pool[k, 0], pool[k, 1]
        if i > j:
            a, b = b, a
        px, py, pz = rotate(R_ij, centers[b, 0], centers[b, 1], centers[b, 2])
        cx, cy, cz, r = centers[a, 0], centers[a, 1], centers[a, 2], radii[a]
        dx, dy, dz = cx - px - t[0], cy - py - t[1], cz - pz - t[2]
        d2 = dx * dx + dy * dy + dz * dz
        if d2 == 0.0:  # coincident centres have no normal
            continue
        d = math.sqrt(d2)
        gap = d - r - radii[b] + kept
        nx, ny, nz = dx / d, dy / d, dz / d
        mx = ux + wy * cz - wz * cy - (oy * pz - oz * py)
        my = uy + wz * cx - wx * cz - (oz * px - ox * pz)
        mz = uz + wx * cy - wy * cx - (ox * py - oy * px)
        predicted = gap + horizon * (nx * mx + ny * my + nz * mz)
        if min(gap, predicted) < limit:
            count = _keep_candidate(count, (nx, ny, nz), (cx, cy, cz), r, gap, predicted, a, b, work)
            if count == 0:
                return 0
    return count


@inner(forceinline=True)
def _keep_candidate(count, normal, center, r, gap, score, a, b, work):
    """Keep spheres a and b as candidate number ``count``; returns how many there are then, 0 without room.

    ``center`` and ``r`` are sphere a's.
    """
    if count >= len(work.candidates):
        work.counts[OVERFLOW] = TOO_MANY_CANDIDATES
        return 0
    out, ids = work.candidates[count], work.candidate_ids[count]
    for k in range(3):
        out[CANDIDATE_NORMAL + k], out[CANDIDATE_POINT + k] = normal[k], center[k] - r * normal[k]
    out[CANDIDATE_GAP], out[CANDIDATE_SCORE] = gap, score
    ids[0], ids[1], ids[2] = a, b, _FREE
    return count + 1


@inner(forceinline=True)
def add_contacts(x, i, j, count, tilt, world, work):
    """Choose contacts among the first ``count`` candidates of body i with body j, or element ``-1 - j``.

    The supports of a patch are those of it tilted by ``tilt`` [rad].
    """
    candidates, ids, best, score = work.candidates, work.candidate_ids, work.best, work.best_score
    if count > 1:
        bonus = min(_LOADED_BONUS, _LOADED_SHARE * world.bodies.radius[i])
        _favour_loaded(i, j, count, bonus, work.head, work.link, work.old_contact, candidates, ids)
    left = count
    while left > 0:
        seed = -1
        for k in range(count):
            if ids[k, 2] == _FREE and (
                seed < 0
                or _deeper(ids, k, candidates[k, CANDIDATE_SCORE], seed, candidates[seed, CANDIDATE_SCORE])
            ):
                seed = k
        nx, ny, nz = candidates[seed, 0], candidates[seed, 1], candidates[seed, 2]
        first, second = tangents((nx, ny, nz))
        best[8] = seed
        for d in range(8):
            best[d] = -1
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] != _FREE or c[0] * nx + c[1] * ny + c[2] * nz < _SAME_PATCH:
                continue
            ids[k, 2] = _IN_PATCH
            left -= 1
            u = tilt * (first[0] * c[3] + first[1] * c[4] + first[2] * c[5])
            w = tilt * (second[0] * c[3] + second[1] * c[4] + second[2] * c[5])
            plus, minus, base = _HALF * (u + w), _HALF * (u - w), c[CANDIDATE_SCORE]
            for d, more in ((0, u), (1, -u), (2, w), (3, -w), (4, plus), (5, -plus), (6, minus), (7, -minus)):
                if best[d] < 0 or _deeper(ids, k, base + more, best[d], score[d]):
                    best[d], score[d] = k, base + more
        for d in range(8, -1, -1):
            k = best[d]
            if ids[k, 2] == _IN_PATCH:
                ids[k, 2] = _CHOSEN
                write_contact(x, i, j, k, world, work)


@inner(forceinline=True)
def _deeper(ids, k, score, other, other_score):
    """Whether candidate ``k`` comes before ``other``; ties go by the spheres' numbers."""
    if score != other_score:
        return score < other_score
    return ids[k, 0] < ids[other, 0] or (ids[k, 0] == ids[other, 0] and ids[k, 1] < ids[other, 1])


@inner
def _favour_loaded(i, j, count, bonus, head, link, contact, candidates, ids):
    """Let what carried load in the last step count as deeper by ``bonus``, so that contacts stay."""
    entry = head[i]
    while entry >= 0:
        if contact[entry, 1] == j:
            for k in range(count):
                if ids[k, 0] == contact[entry, 2] and ids[k, 1] == contact[entry, 3]:
                    candidates[k, CANDIDATE_SCORE] -= bonus
                    break
        entry = link[entry]


@inner(error_model="numpy", forceinline=True)
def write_contact(x, i, j, k, world, work):
    """Make candidate ``k`` of body i with body j, or element ``-1 - j``, a contact."""
    m = work.counts[CONTACTS]
    if m >= len(work.rows):
        work.counts[OVERFLOW] = TOO_MANY_CONTACTS
        return
    work.counts[CONTACTS] = m + 1
    row, c, R, bodies = work.rows[m], work.candidates[k], work.R[i], world.bodies
    a, b = work.candidate_ids[k, 0], work.candidate_ids[k, 1]
    work.ids[m, 0], work.ids[m, 1], work.ids[m, 2], work.ids[m, 3] = i, j, a, b
    n = rotate(R, c[0], c[1], c[2])
    gap, r = c[CANDIDATE_GAP], world.tree.radii[a]
    half = 0.5 * gap
    arm = rotate(R, c[3] - half * c[0], c[4] - half * c[1], c[5] - half * c[2])
    first, second = tangents(n)
    omega = (x[i, W], x[i, W + 1], x[i, W + 2])
    # the gap bends as the sphere's centre goes round the centre of mass
    h = rotate(R, c[3] + r * c[0], c[4] + r * c[1], c[5] + r * c[2])
    bend = _centripetal(n, omega, h)
    other = (0.0, 0.0, 0.0)
    partner = column_of(j, len(x))
    row[INVERSE_MASS_I], row[INVERSE_MASS_J] = bodies.inverse_mass[i], 0.0
    if j >= 0:
        rj = world.tree.radii[b]
        other = (
            arm[0] + x[i, P] - x[j, P],
            arm[1] + x[i, P + 1] - x[j, P + 1],
            arm[2] + x[i, P + 2] - x[j, P + 2],
        )
        row[INVERSE_MASS_J] = bodies.inverse_mass[j]
        g = 0.5 * gap + rj
        bend -= _centripetal(
            n,
            (x[j, W], x[j, W + 1], x[j, W + 2]),
            (other[0] - g * n[0], other[1] - g * n[1], other[2] - g * n[2]),
        )
        r = reduced_radius(r, rj)
    for d, axis in ((0, n), (1, first), (2, second)):
        _write_direction(row, DIRECTION + 3 * d, axis)
        moment = _cross(arm, axis)
        _write_direction(row, MOMENT_I + 3 * d, moment)
        turn = rotate(work.inverse_inertia[i], moment[0], moment[1], moment[2])
        _write_direction(row, TURN_I + 3 * d, turn)
        own = row[INVERSE_MASS_I] + moment[0] * turn[0] + moment[1] * turn[1] + moment[2] * turn[2]
        if j >= 0:
            moment = _cross(other, axis)
            _write_direction(row, MOMENT_J + 3 * d, moment)
            turn = rotate(work.inverse_inertia[j], moment[0], moment[1], moment[2])
            _write_direction(row, TURN_J + 3 * d, turn)
            own += row[INVERSE_MASS_J] + moment[0] * turn[0] + moment[1] * turn[1] + moment[2] * turn[2]
        if d == 0:
            row[COMPLIANCE] = own
        elif d == 1:
            row[SLIP_COMPLIANCE] = own
        else:
            row[SLIP_COMPLIANCE] = max(row[SLIP_COMPLIANCE], own)
    row[GAP], row[BEND], row[FALL], row[RADIUS] = gap, bend, bend, r
    if j < 0 or not bodies.moving[j]:
        row[FALL] += n[0] * world.gravity[0] + n[1] * world.gravity[1] + n[2] * world.gravity[2]
    row[FRICTION] = math.sqrt(world.implicit.friction[i] * world.implicit.friction[partner])
    row[RESTITUTION] = math.sqrt(world.implicit.restitution[i] * world.implicit.restitution[partner])
    _recall_force(
        i, j, m, row, first, second, work.head, work.link, work.old_contact, work.old_force, work.ids
    )


@inner(forceinline=True)
def _recall_force(i, j, m, row, first, second, head, link, contact, force, ids):
    """Write the force that a contact carried in the last step in place of impulses [N]; 0 where it is new."""
    row[FORCE] = row[FORCE + 1] = row[FORCE + 2] = 0.0
    entry = head[i]
    while entry >= 0:
        if contact[entry, 1] == j and contact[entry, 2] == ids[m, 2] and contact[entry, 3] == ids[m, 3]:
            row[FORCE] = force[entry, 0]
            fx, fy, fz = force[entry, 1], force[entry, 2], force[entry, 3]
            row[FORCE + 1] = first[0] * fx + first[1] * fy + first[2] * fz
            row[FORCE + 2] = second[0] * fx + second[1] * fy + second[2] * fz
            return
        entry = link[entry]


@inner(forceinline=True)
def _write_direction(row, at, v):
    row[at], row[at + 1], row[at + 2] = v[0], v[1], v[2]


@inner(forceinline=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner(forceinline=True)
def _centripetal(n, w, r):
    """``n . (w x (w x r))`` [m/s^2]."""
    return (w[0] * r[0] + w[1] * r[1] + w[2] * r[2]) * (w[0] * n[0] + w[1] * n[1] + w[2] * n[2]) - (
        w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    ) * (r[0] * n[0] + r[1] * n[1] + r[2] * n[2])
