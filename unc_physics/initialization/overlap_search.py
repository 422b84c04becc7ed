"""Search for overlaps and for directions that resolve them, as rows of contacts."""

import math

import numpy as np

from ..collision.contact_candidates import partner_sphere
from ..collision.contact_patch import add_contacts, element_candidates, pair_candidates
from ..collision.contact_row import DIRECTION, GAP
from ..collision.contact_search import balls_within, column_of
from ..collision.element_contacts import element_distance
from ..collision.implicit_workspace import (
    CANDIDATE_GAP,
    CANDIDATE_NORMAL,
    CANDIDATE_POINT,
    CANDIDATE_SCORE,
    CONTACTS,
    NO_OVERFLOW,
    OVERFLOW,
    implicit_workspace,
    more_room,
)
from ..compiler import inner, kernel
from ..compiler.arrays import full, singles, zeros
from ..dynamics.implicit_step import prepare_members
from ..spatial.layout import P
from ..spatial.rotation import rotate, rotate_back
from ..spatial.vectors import plus, times, triple

#: Overlap that is tolerated, about that of a loaded contact [m].
OVERLAP_TOLERANCE = 5e-5
#: Overlap at which the search for the surface ends [m].
SOLVED = 1e-5
_LEAST_TILT, _MOST_TILT = 0.02, 0.3  # tilt of a patch in the search for its supports [rad]
_CONE = 0.5  # least cosine of the angle between normals of one direction
_WAYS = 4  # largest number of directions
_SHALLOW = 5e-4  # overlap up to which a contact's own normal is the direction [m]
_MARCHES = 16  # iterations to the surface
_SIDE_REACH, _PAIR_SIDE_REACH = 0.05, 5e-3  # range in which sides of the mean state are determined [m]
_OPEN, _CHOSEN, _LEFT_OUT = 0, 1, 3  # states of candidates


@inner(noinline=True)
def find_rows(x, count, reach, pair_reach, as_they_are, sides, world, work):
    """Find rows of the current group within a distance of other objects; return the deepest overlap [m].

    The distance is ``reach`` for the environment and ``pair_reach`` for other bodies; negative values find
    only deeper overlaps. ``as_they_are`` keeps normals and depths unchanged (`choose_ways_out`).
    """
    members, group, moving, radius = work.members, work.group, world.bodies.moving, world.bodies.radius
    work.counts[CONTACTS] = 0
    prepare_members(x, count, world, work)
    for a in range(count):
        i = members[a]
        tilt = min(max(3.0 * reach / radius[i], _LEAST_TILT), _MOST_TILT)
        for e in range(len(world.environment.kind)):
            if element_distance(world.environment, e, x[i, P], x[i, P + 1], x[i, P + 2]) < radius[i] + reach:
                found = element_candidates(x, i, e, reach, 0.0, world, work)
                if not as_they_are:
                    found = choose_ways_out(x, i, -1 - e, found, sides, world, work)
                if found > 0:
                    add_contacts(x, i, -1 - e, found, tilt, False, world, work)
        tilt = min(max(3.0 * pair_reach / radius[i], _LEAST_TILT), _MOST_TILT)
        for j in range(len(x)):
            if j == i or (moving[j] and (j < i or group[j] != group[i])):
                continue
            if balls_within(x, i, j, pair_reach, radius) and world.implicit.stop[0] == 0:
                found = pair_candidates(x, i, j, pair_reach, 0.0, world, work)
                if not as_they_are:
                    found = choose_ways_out(x, i, j, found, sides, world, work)
                if found > 0:
                    add_contacts(x, i, j, found, tilt, False, world, work)
    deepest = 0.0
    for c in range(work.counts[CONTACTS]):
        deepest = max(deepest, -work.rows[c, GAP])
    return deepest


@inner(forceinline=True)
def way_out(x, i, j, c, ids, way, world, work):
    """Return the distance along ``way``, body i's frame, at which a candidate leaves its partner [m].

    ``c`` and ``ids`` are its row and its spheres. The partner is body j, or element ``-1 - j``.
    """
    radii, distance, gap = world.tree.radii, 0.0, c[CANDIDATE_GAP]
    normal, r = triple(c, CANDIDATE_NORMAL), radii[ids[0]]
    if j >= 0:
        reach = r + radii[partner_sphere(ids[1], radii)]
        d = gap + reach
        along = d * (normal[0] * way[0] + normal[1] * way[1] + normal[2] * way[2])
        return -along + math.sqrt(max(along * along - d * d + reach * reach, 0.0))
    for _ in range(_MARCHES):
        left = _moved_gap(x, i, j, c, r, distance, way, world, work)
        if left >= -SOLVED:
            break
        distance -= left
    return distance


@inner
def _moved_gap(x, i, j, c, r, distance, way, world, work):
    """Return the gap of a candidate of radius ``r`` from element ``-1 - j`` after a displacement [m]."""
    at = plus(_center(c, r), times(distance, way))
    mx, my, mz = rotate(work.R[i], at[0], at[1], at[2])
    px, py, pz = x[i, P] + mx, x[i, P + 1] + my, x[i, P + 2] + mz
    return element_distance(world.environment, -1 - j, px, py, pz) - r


@inner(forceinline=True)
def _center(c, r):
    """Return the centre of a candidate's sphere of radius ``r``, body frame [m]."""
    return plus(triple(c, CANDIDATE_POINT), times(r, triple(c, CANDIDATE_NORMAL)))


@inner(forceinline=True)
def choose_ways_out(x, i, j, count, sides, world, work):
    """Assign common directions to overlapping candidates of body i; return how many candidates remain.

    The normals of deeply overlapping spheres say little about the way out. The direction is the mean of the
    deepest candidate's normal and similar ones, weighted by depth. Where normals point into the support of
    the mean state, the mean's normal is used. Otherwise a body deeper than half a thin board would exit below
    it. Candidates with other normals are removed if they do not overlap after the motion.
    """
    candidates, ids, radii = work.candidates, work.candidate_ids, world.tree.radii
    side = sides[i, column_of(j, len(x))]
    R = work.R[j]
    if j < 0:
        R = world.environment.R[-1 - j]
    wx, wy, wz = rotate(R, side[0], side[1], side[2])
    sx, sy, sz = rotate_back(work.R[i], wx, wy, wz)
    for k in range(count):
        c = candidates[k]
        if c[0] * sx + c[1] * sy + c[2] * sz >= -_CONE:
            continue
        if c[CANDIDATE_GAP] < -OVERLAP_TOLERANCE:
            way = way_out(x, i, j, c, ids[k], (sx, sy, sz), world, work)
            _turn_candidate(c, radii[ids[k, 0]], (sx, sy, sz), way)
        elif j < 0:  # beyond a thin board, so not an obstacle
            ids[k, 2] = _LEFT_OUT
    for _ in range(_WAYS):
        seed = -1
        for k in range(count):
            if ids[k, 2] == _OPEN and candidates[k, CANDIDATE_GAP] < -OVERLAP_TOLERANCE:
                if seed < 0 or candidates[k, CANDIDATE_GAP] < candidates[seed, CANDIDATE_GAP]:
                    seed = k
        if seed < 0:
            break
        nx, ny, nz = candidates[seed, 0], candidates[seed, 1], candidates[seed, 2]
        vx = vy = vz = 0.0
        for k in range(count):
            c = candidates[k]
            if (
                ids[k, 2] == _OPEN
                and c[CANDIDATE_GAP] < -OVERLAP_TOLERANCE
                and c[0] * nx + c[1] * ny + c[2] * nz > _CONE
            ):
                vx, vy = vx - c[CANDIDATE_GAP] * c[0], vy - c[CANDIDATE_GAP] * c[1]
                vz = vz - c[CANDIDATE_GAP] * c[2]
        size = math.sqrt(vx * vx + vy * vy + vz * vz)
        nx, ny, nz = vx / size, vy / size, vz / size
        farthest = 0.0
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] == _OPEN and c[0] * nx + c[1] * ny + c[2] * nz > _CONE:
                ids[k, 2] = _CHOSEN
                if c[CANDIDATE_GAP] < -_SHALLOW:
                    way = way_out(x, i, j, c, ids[k], (nx, ny, nz), world, work)
                    _turn_candidate(c, radii[ids[k, 0]], (nx, ny, nz), way)
                farthest = max(farthest, -c[CANDIDATE_GAP])
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] != _OPEN:
                continue
            if j < 0:
                gap = _moved_gap(x, i, j, c, radii[ids[k, 0]], farthest, (nx, ny, nz), world, work)
            else:
                reach = radii[ids[k, 0]] + radii[partner_sphere(ids[k, 1], radii)]
                d = c[CANDIDATE_GAP] + reach
                mx, my, mz = d * c[0] + farthest * nx, d * c[1] + farthest * ny, d * c[2] + farthest * nz
                gap = math.sqrt(mx * mx + my * my + mz * mz) - reach
            if gap >= -OVERLAP_TOLERANCE:
                ids[k, 2] = _LEFT_OUT
        ids[seed, 2] = _CHOSEN
    left = 0
    for k in range(count):
        if ids[k, 2] == _LEFT_OUT:
            continue
        if left < k:
            for d in range(8):
                candidates[left, d] = candidates[k, d]
            ids[left, 0], ids[left, 1] = ids[k, 0], ids[k, 1]
        ids[left, 2] = _OPEN
        left += 1
    return left


@inner(forceinline=True)
def _turn_candidate(c, r, normal, way):
    """Set the normal of a candidate of radius ``r``, with a distance ``way`` [m] along it."""
    center = _center(c, r)
    for d in range(3):
        c[CANDIDATE_NORMAL + d] = normal[d]
        c[CANDIDATE_POINT + d] = center[d] - r * normal[d]
    c[CANDIDATE_GAP] = c[CANDIDATE_SCORE] = -way


@kernel
def sides_of(mean, world):
    """Return the side of each body and element on which bodies are in a state (B, 13).

    Returns
    -------
    (B, B + E, 3) float64
        Normals towards the body at the closest points, in the partner's frame; 0 if they are far apart.
    """
    bodies, elements = len(mean), len(world.environment.kind)
    sides = zeros((bodies, bodies + elements, 3))
    none, least = zeros((bodies, bodies + elements, 3)), full((bodies, bodies + elements), np.inf)
    room = 1024, 16384, 65536
    while True:
        work = implicit_workspace(mean, singles((0, 0)), world, room)
        work.head[:] = -1
        work.group[:] = 0
        count = 0
        for i in range(bodies):
            if world.bodies.moving[i]:
                work.members[count] = i
                count += 1
        find_rows(mean, count, _SIDE_REACH, _PAIR_SIDE_REACH, False, none, world, work)
        if work.counts[OVERFLOW] == NO_OVERFLOW:
            break
        room = more_room(work.counts, room)
    for c in range(work.counts[CONTACTS]):
        row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
        column = column_of(j, bodies)
        if row[GAP] >= least[i, column]:
            continue
        least[i, column] = row[GAP]
        R = world.environment.R[-1 - j] if j < 0 else work.R[j]
        s = rotate_back(R, row[DIRECTION], row[DIRECTION + 1], row[DIRECTION + 2])
        sides[i, column, 0], sides[i, column, 1], sides[i, column, 2] = s
    return sides
