"""Poses without overlap, as near as possible to those given, in the metric of a belief.

A sample of a belief about a mug on a table may lie in the table. The nearest pose without overlap minimises
``delta^T Sigma^-1 delta`` subject to ``g + J (delta - delta_now) >= 0`` for all gaps g of spheres nearby, which
``delta = Sigma J^T lambda`` with non-negative lambda solves: projected Gauss-Seidel finds it. Gaps are linear
near a pose only, so that this is done again at what was found, until nothing overlaps (`project`).

The same rows let bodies that are known to be at rest sink until contacts hold them, each along gravity and
about horizontal axes alone (`lower`): what lies across keeps what was known of it.

What cannot come free, as in a slot too narrow, keeps its overlap for ever, without a force
(`SolverMemory.kept_overlap`): any that decays would give energy.
"""

import math
from typing import NamedTuple

import numpy as np

from .compiled import inner, kernel
from .contact_patch import add_contacts, element_candidates, pair_candidates
from .contact_search import forget_lists, join, lowest
from .element_contacts import in_element
from .implicit_step import prepare_members
from .implicit_workspace import (
    CANDIDATE_GAP,
    CANDIDATE_POINT,
    CANDIDATE_SCORE,
    CONTACTS,
    DIRECTION,
    GAP,
    MOMENT_I,
    MOMENT_J,
    NO_OVERFLOW,
    OVERFLOW,
    TOO_LONG_LISTS,
    TOO_MANY_CANDIDATES,
    implicit_workspace,
)
from .layout import EP, ER, ERROR, EV, EW, P, Q, V, W
from .moments import boxplus
from .rotation import rotate, rotate_back, write_matrix
from .shapes import surface

#: Overlap that is none: about what a load makes [m].
TOUCHING = 5e-5
_SOLVED = 1e-5  # overlap at which the search ends [m]
#: Gaps that count [m]: at first and at least; how many times the deepest overlap more; and of these at most.
_REACH, _LEAST_REACH, _DEPTHS, _MORE_REACH, _PAIR_MORE_REACH = 2e-3, 2e-4, 2.0, 0.012, 3e-3
#: Overlap that is deep [m], and what share of the deepest is as good as that.
_DEEP, _DEEPEST = 3e-3, 0.4
_NEARER = 0.3  # share of the reach that pairs of bodies have, in which there are so many more spheres
_ROUNDS, _CAREFUL_ROUNDS, _SWEEPS = 10, 24, 200
_CAREFUL = 0.5  # share of a step that a careful round takes
_NEAREST = 5e-4  # last step of what is nearest enough [m]
_TOLERANCE = 1e-7  # of a gap, in a sweep [m]
_SOFTNESS = 1e-4  # relative, so that rows that say the same do no harm
_FARTHEST, _WIDEST = 0.02, 0.2  # of a round [m], [rad]
_LEFT_OVER, _TOO_FAR = 2e-4, 8.0  # overlap [m], and standard deviations moved, of what cannot come free
_SINGULAR = 1e-10  # share of a variance that is none
_CERTAIN = 1e-18  # variance of a gap that cannot move [m^2]
_LEAST_TILT, _MOST_TILT = 0.02, 0.3  # of a patch, in search of its supports [rad]
_CONE = 0.5  # cosine of the widest angle between normals that say the same of the way out
_WAYS = 4  # out, at most
_SHALLOW = 5e-4  # overlap whose own normal is the way out [m]
_MARCHES = 16  # to the surface
#: To free what can be freed: fast, carefully, thoroughly, then without the pairs that could not be.
_ATTEMPTS = 6
_EXPECTED = 5.0  # standard deviations up to which a speed of approach may be none
_DROP, _PAIR_DROP, _LOWERINGS = 0.01, 2e-3, 200  # of a round, alone and near others [m]; rounds
_CALMER = 0.6  # share of a round's drop that the next one has
_SIDE_REACH, _PAIR_SIDE_REACH = 0.05, 5e-3  # how far the mean looks for its sides [m]
_STILL = 2e-6  # motion of a round that is none [m]
_OPEN, _CHOSEN, _LEFT_OUT = 0, 1, 3  # marks of candidates


class Metric(NamedTuple):
    """In which directions, and how far, bodies may be elsewhere.

    Attributes
    ----------
    covariance : (M, 12, M, 12) float64
        Of the error states of M bodies.
    linked : (M, M) bool
        Which of them are correlated.
    place : (B,) int64
        Which of the M each body is; -1 for one that stays.
    """

    covariance: np.ndarray
    linked: np.ndarray
    place: np.ndarray


class Rows(NamedTuple):
    """What keeps a group's bodies apart, row by row: room for the solver.

    Attributes
    ----------
    jacobian : (C, 12) float64
        Change of the gap with position and body-side rotation of the first body, then of the second.
    image : (C, 12 G) float64
        What a unit of the row's multiplier does to the group's error states.
    gap, own, multiplier, expected : (C,) float64
        Gap without any motion, change of it with the multiplier, the multiplier, what the mean state says.
    first, second : (C,) int64
        Places of the bodies in the group; -1 for what stays.
    delta, now, best : (12 G,) float64
        The group's motion: solved, done, and done when nothing overlapped.
    factor, solved : (6, 6) and (6,) float64
        Of the covariance of one body's pose.
    """

    jacobian: np.ndarray
    image: np.ndarray
    gap: np.ndarray
    own: np.ndarray
    multiplier: np.ndarray
    expected: np.ndarray
    first: np.ndarray
    second: np.ndarray
    delta: np.ndarray
    now: np.ndarray
    best: np.ndarray
    factor: np.ndarray
    solved: np.ndarray


@inner
def find_rows(x, count, reach, pair_reach, as_they_are, sides, world, work):
    """Find what is nearer than ``reach`` to the environment, or than ``pair_reach`` to another body, of the
    group at hand; returns the deepest overlap [m].

    With a negative reach, only what overlaps deeper. ``as_they_are`` leaves normals and depths alone
    (`choose_ways_out`).
    """
    members, group, moving, radius = work.members, work.group, world.bodies.moving, world.bodies.radius
    work.counts[CONTACTS] = 0
    prepare_members(x, count, world, work)
    for a in range(count):
        i = members[a]
        tilt = min(max(3.0 * reach / radius[i], _LEAST_TILT), _MOST_TILT)
        for e in range(len(world.surroundings.kind)):
            px, py, pz = in_element(
                world.surroundings.position, world.surroundings.R, e, x[i, P], x[i, P + 1], x[i, P + 2]
            )
            distance = surface(world.surroundings.kind, world.surroundings.size, e, px, py, pz)[0]
            if distance < radius[i] + reach:
                found = element_candidates(x, i, e, reach, 0.0, world, work)
                if not as_they_are:
                    found = choose_ways_out(x, i, -1 - e, found, sides, world, work)
                if found > 0:
                    add_contacts(x, i, -1 - e, found, tilt, world, work)
        tilt = min(max(3.0 * pair_reach / radius[i], _LEAST_TILT), _MOST_TILT)
        for j in range(len(x)):
            if j == i or (moving[j] and (j < i or group[j] != group[i])):
                continue
            near = radius[i] + radius[j] + pair_reach
            square = 0.0
            for k in range(3):
                square += (x[i, P + k] - x[j, P + k]) ** 2
            if square < near * near:
                found = pair_candidates(x, i, j, pair_reach, 0.0, world, work)
                if not as_they_are:
                    found = choose_ways_out(x, i, j, found, sides, world, work)
                if found > 0:
                    add_contacts(x, i, j, found, tilt, world, work)
    deepest = 0.0
    for c in range(work.counts[CONTACTS]):
        deepest = max(deepest, -work.rows[c, GAP])
    return deepest


@inner(forceinline=True)
def way_out(x, i, j, a, b, gap, normal, way, world, work):
    """How far body i has to go along ``way`` until its sphere a leaves sphere b of body j, or element
    ``-1 - j`` [m].

    ``gap`` and ``normal`` are the present ones; directions are in body i's frame.
    """
    radii, distance = world.tree.radii, 0.0
    if j >= 0:
        reach = radii[a] + radii[b]
        d = gap + reach
        along = d * (normal[0] * way[0] + normal[1] * way[1] + normal[2] * way[2])
        return -along + math.sqrt(max(along * along - d * d + reach * reach, 0.0))
    for _ in range(_MARCHES):
        left = _moved_gap(x, i, j, a, distance, way, world, work)
        if left >= -_SOLVED:
            break
        distance -= left
    return distance


@inner
def _moved_gap(x, i, j, a, distance, way, world, work):
    """Gap of sphere a of body i from element ``-1 - j`` after the body went some distance [m]."""
    e, centers = -1 - j, world.tree.centers
    mx, my, mz = rotate(
        work.R[i],
        centers[a, 0] + distance * way[0],
        centers[a, 1] + distance * way[1],
        centers[a, 2] + distance * way[2],
    )
    px, py, pz = in_element(
        world.surroundings.position, world.surroundings.R, e, x[i, P] + mx, x[i, P + 1] + my, x[i, P + 2] + mz
    )
    return surface(world.surroundings.kind, world.surroundings.size, e, px, py, pz)[0] - world.tree.radii[a]


@inner(forceinline=True)
def choose_ways_out(x, i, j, count, sides, world, work):
    """Let overlapping candidates of body i lead out the same way; returns how many candidates stay.

    Deep inside each other, spheres have normals that say little about the way out. It is that of the deepest
    and of all whose normals are similar, by their depths; where normals point back into what the mean lies
    on, that of the mean, so that what is deeper than half a thin board does not come out below. Candidates
    whose normals point elsewhere are left out where they do not overlap at its end.
    """
    candidates, ids, radii = work.candidates, work.candidate_ids, world.tree.radii
    column = j
    if j < 0:
        column = len(x) - 1 - j
    side = sides[i, column]
    R = work.R[j]
    if j < 0:
        R = world.surroundings.R[-1 - j]
    wx, wy, wz = rotate(R, side[0], side[1], side[2])
    sx, sy, sz = rotate_back(work.R[i], wx, wy, wz)
    for k in range(count):
        c = candidates[k]
        if c[0] * sx + c[1] * sy + c[2] * sz >= -_CONE:
            continue
        if c[CANDIDATE_GAP] < -TOUCHING:
            way = way_out(
                x, i, j, ids[k, 0], ids[k, 1], c[CANDIDATE_GAP], (c[0], c[1], c[2]), (sx, sy, sz), world, work
            )
            _turn_candidate(c, ids[k, 0], (sx, sy, sz), way, world)
        elif j < 0:  # beyond a thin board: in the way of nothing
            ids[k, 2] = _LEFT_OUT
    for _ in range(_WAYS):
        seed = -1
        for k in range(count):
            if ids[k, 2] == _OPEN and candidates[k, CANDIDATE_GAP] < -TOUCHING:
                if seed < 0 or candidates[k, CANDIDATE_GAP] < candidates[seed, CANDIDATE_GAP]:
                    seed = k
        if seed < 0:
            break
        nx, ny, nz = candidates[seed, 0], candidates[seed, 1], candidates[seed, 2]
        vx = vy = vz = 0.0
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] == _OPEN and c[CANDIDATE_GAP] < -TOUCHING and c[0] * nx + c[1] * ny + c[2] * nz > _CONE:
                vx, vy, vz = vx - c[CANDIDATE_GAP] * c[0], vy - c[CANDIDATE_GAP] * c[1], vz - c[CANDIDATE_GAP] * c[2]
        size = math.sqrt(vx * vx + vy * vy + vz * vz)
        nx, ny, nz = vx / size, vy / size, vz / size
        farthest = 0.0
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] == _OPEN and c[0] * nx + c[1] * ny + c[2] * nz > _CONE:
                ids[k, 2] = _CHOSEN
                if c[CANDIDATE_GAP] < -_SHALLOW:
                    way = way_out(
                        x, i, j, ids[k, 0], ids[k, 1], c[CANDIDATE_GAP], (c[0], c[1], c[2]), (nx, ny, nz), world, work
                    )
                    _turn_candidate(c, ids[k, 0], (nx, ny, nz), way, world)
                farthest = max(farthest, -c[CANDIDATE_GAP])
        for k in range(count):
            c = candidates[k]
            if ids[k, 2] != _OPEN:
                continue
            if j < 0:
                gap = _moved_gap(x, i, j, ids[k, 0], farthest, (nx, ny, nz), world, work)
            else:
                reach = radii[ids[k, 0]] + radii[ids[k, 1]]
                d = c[CANDIDATE_GAP] + reach
                mx, my, mz = d * c[0] + farthest * nx, d * c[1] + farthest * ny, d * c[2] + farthest * nz
                gap = math.sqrt(mx * mx + my * my + mz * mz) - reach
            if gap >= -TOUCHING:
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
def _turn_candidate(c, a, normal, way, world):
    """Let a candidate of sphere a lead out along another normal, ``way`` [m] far."""
    for d in range(3):
        c[d] = normal[d]
        c[CANDIDATE_POINT + d] = world.tree.centers[a, d] - world.tree.radii[a] * normal[d]
    c[CANDIDATE_GAP] = c[CANDIDATE_SCORE] = -way


@inner
def write_jacobians(count, local, place, world, work, rows):
    """Make rows of the contacts at hand, for positions and body-side rotations."""
    for c in range(work.counts[CONTACTS]):
        row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
        J = rows.jacobian[c]
        _write_jacobian(J, 0, row, 1.0, MOMENT_I, work.R[i])
        rows.gap[c] = row[GAP]
        rows.first[c] = local[i] if place[i] >= 0 else -1
        rows.second[c] = -1
        if j >= 0 and world.bodies.moving[j]:
            _write_jacobian(J, 6, row, -1.0, MOMENT_J, work.R[j])
            rows.second[c] = local[j] if place[j] >= 0 else -1


@inner(forceinline=True)
def _write_jacobian(J, at, row, sign, moment, R):
    for k in range(3):
        J[at + k] = sign * row[DIRECTION + k]
    u, v, w = rotate_back(R, row[moment], row[moment + 1], row[moment + 2])
    J[at + 3], J[at + 4], J[at + 5] = sign * u, sign * v, sign * w


@inner
def write_images(m, count, members, metric, linear, angular, rows):
    """``Sigma J^T`` of each row, and ``J Sigma J^T``; the rows are about the error state's parts that begin
    at ``linear`` and ``angular``.
    """
    covariance, place = metric.covariance, metric.place
    for c in range(m):
        for a in range(count):
            b = place[members[a]]
            for r in range(ERROR):
                rows.image[c, ERROR * a + r] = 0.0
            if b < 0:
                continue
            for side in range(2):
                other = rows.first[c] if side == 0 else rows.second[c]
                if other < 0:
                    continue
                o = place[members[other]]
                if not metric.linked[b, o]:
                    continue
                for r in range(ERROR):
                    total = 0.0
                    for k in range(3):
                        total += covariance[b, r, o, linear + k] * rows.jacobian[c, 6 * side + k]
                        total += covariance[b, r, o, angular + k] * rows.jacobian[c, 6 * side + 3 + k]
                    rows.image[c, ERROR * a + r] += total
        rows.own[c] = _along(rows.jacobian[c], rows.image[c], rows.first[c], rows.second[c], linear, angular)
        rows.multiplier[c] = 0.0


@inner(forceinline=True)
def _along(J, motion, first, second, linear, angular):
    """Change of a gap by a motion (12 G,)."""
    total = 0.0
    for k in range(3):
        if first >= 0:
            at = ERROR * first
            total += J[k] * motion[at + linear + k] + J[3 + k] * motion[at + angular + k]
        if second >= 0:
            at = ERROR * second
            total += J[6 + k] * motion[at + linear + k] + J[9 + k] * motion[at + angular + k]
    return total


@inner
def solve_rows(m, count, coupled, linear, angular, tolerance, rows):
    """Find the multipliers, and the motion ``delta`` that they make of the one it holds."""
    delta = rows.delta
    for _ in range(_SWEEPS):
        change = 0.0
        for c in range(m):
            own = rows.own[c]
            if own <= _CERTAIN:
                continue
            first, second, old = rows.first[c], rows.second[c], rows.multiplier[c]
            gap = rows.gap[c] + _along(rows.jacobian[c], delta, first, second, linear, angular)
            new = max(0.0, old - (gap + _SOFTNESS * old * own) / (own * (1.0 + _SOFTNESS)))
            more = new - old
            if more == 0.0:
                continue
            rows.multiplier[c] = new
            change = max(change, abs(more) * own)
            for a in range(count):
                if coupled or a == first or a == second:
                    for r in range(ERROR):
                        delta[ERROR * a + r] += more * rows.image[c, ERROR * a + r]
        if change < tolerance:
            break


@inner
def move_group(x, start, count, members, limit, share, radius, rows, work):
    """Bring the motion done by a share, or up to a limit, to the one solved, from the states ``start``;
    returns how far any point goes at most [m].
    """
    largest = 0.0
    for a in range(count):
        way = turn = 0.0
        for k in range(3):
            way += (rows.delta[ERROR * a + EP + k] - rows.now[ERROR * a + EP + k]) ** 2
            turn += (rows.delta[ERROR * a + ER + k] - rows.now[ERROR * a + ER + k]) ** 2
        way, turn = math.sqrt(way), math.sqrt(turn)
        largest = max(largest, way + radius[members[a]] * turn)
        share = min(share, min(limit * _FARTHEST / max(way, 1e-300), limit * _WIDEST / max(turn, 1e-300)))
    for k in range(ERROR * count):
        rows.now[k] += share * (rows.delta[k] - rows.now[k])
    for a in range(count):
        i = members[a]
        boxplus(start[i], rows.now[ERROR * a : ERROR * (a + 1)], x[i])
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
    return share * largest


@inner
def restore(x, start, count, work):
    """Bring the group at hand back to where it was."""
    for a in range(count):
        i = work.members[a]
        for k in range(13):
            x[i, k] = start[i, k]
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)


@inner
def note_motion(count, members, metric, rows, moved):
    """Write how many standard deviations the motion done moved each body, whatever is known of the others.

    It is the Mahalanobis distance, by a Cholesky factor that leaves out what cannot move.
    """
    L, z = rows.factor, rows.solved
    for a in range(count):
        b = metric.place[members[a]]
        moved[members[a]] = 0.0
        if b < 0:
            continue
        square = 0.0
        for r in range(6):
            u = r if r < 3 else ER + r - 3
            rest = rows.now[ERROR * a + u]
            for c in range(r + 1):
                w = c if c < 3 else ER + c - 3
                total = metric.covariance[b, u, b, w]
                for k in range(c):
                    total -= L[r, k] * L[c, k]
                if c < r:
                    L[r, c] = total / L[c, c] if L[c, c] > 0.0 else 0.0
                    rest -= L[r, c] * z[c]
                else:
                    L[r, r] = math.sqrt(total) if total > _SINGULAR * metric.covariance[b, u, b, u] else 0.0
            z[r] = rest / L[r, r] if L[r, r] > 0.0 else 0.0
            square += z[r] * z[r]
        moved[members[a]] = math.sqrt(square)


@inner
def project_group(x, start, count, local, coupled, careful, thorough, deepest, metric, sides, world, work, rows, moved):
    """Move the group at hand to the nearest poses without overlap; returns the overlap that is left [m].

    ``moved`` (B,) is told how many standard deviations each body went; the contacts at hand are those of the
    end.
    """
    members = work.members
    for k in range(ERROR * count):
        rows.now[k] = 0.0
    pairs = len(x) > 1
    left, reach, step, any_free, deep = deepest, _REACH, math.inf, False, deepest > _DEEP and not thorough and pairs
    rounds, share = (_CAREFUL_ROUNDS, _CAREFUL) if careful else (_ROUNDS, 1.0)
    for round in range(rounds + 1):
        if deep:  # of pairs of bodies what is deepest leads out; the rest is looked at when that is done
            far = reach + min(_DEPTHS * left, _MORE_REACH)
            left = find_rows(x, count, far, -_DEEPEST * max(left, _DEEP), False, sides, world, work)
        if not deep or left <= _DEEP:
            far = reach + min(_DEPTHS * left, _MORE_REACH)
            pair_far = reach + min(_DEPTHS * left, _PAIR_MORE_REACH)
            pair_far *= 1.0 if thorough else _NEARER
            left = find_rows(x, count, far, pair_far, False, sides, world, work)
        deep = left > _DEEP and not thorough and pairs
        if work.counts[OVERFLOW] != NO_OVERFLOW:
            break
        free = round > 0 and left <= _SOLVED
        if free:
            any_free = True
            for k in range(ERROR * count):
                rows.best[k] = rows.now[k]
        if (free and step <= _NEAREST) or round == rounds:
            break
        m = work.counts[CONTACTS]
        write_jacobians(count, local, metric.place, world, work, rows)
        write_images(m, count, members, metric, EP, ER, rows)
        for c in range(m):
            rows.gap[c] -= _along(rows.jacobian[c], rows.now, rows.first[c], rows.second[c], EP, ER)
        for k in range(ERROR * count):
            rows.delta[k] = 0.0
        solve_rows(m, count, coupled, EP, ER, _TOLERANCE, rows)
        # back from where nothing overlaps, no farther than the rows know; and what is nearly right is not to
        # jump between far supports
        step = move_group(x, start, count, members, reach / _FARTHEST if free else 1.0, share, world.bodies.radius, rows, work)
        reach = max(0.5 * reach, _LEAST_REACH)
    if left > _LEFT_OVER and any_free and work.counts[OVERFLOW] == NO_OVERFLOW:
        for k in range(ERROR * count):
            rows.delta[k] = rows.best[k]
        move_group(x, start, count, members, math.inf, 1.0, world.bodies.radius, rows, work)
        left = find_rows(x, count, _LEAST_REACH, _LEAST_REACH, False, sides, world, work)
    note_motion(count, members, metric, rows, moved)
    return left


@inner
def stop_approach(x, mean, count, local, coupled, metric, world, work, rows):
    """Take from the group's velocities what goes into its contacts, as far as it may be none at all."""
    members, kept = work.members, 0
    for c in range(work.counts[CONTACTS]):
        row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
        if row[GAP] > 2.0 * TOUCHING:
            continue
        J = rows.jacobian[kept]
        rows.first[kept] = local[i] if metric.place[i] >= 0 else -1
        rows.second[kept] = -1
        for k in range(3):
            J[k], J[3 + k] = row[DIRECTION + k], row[MOMENT_I + k]
        if j >= 0 and world.bodies.moving[j]:
            rows.second[kept] = local[j] if metric.place[j] >= 0 else -1
            for k in range(3):
                J[6 + k], J[9 + k] = -row[DIRECTION + k], -row[MOMENT_J + k]
        expected = speed = 0.0
        for k in range(3):
            expected += J[k] * mean[i, V + k] + J[3 + k] * mean[i, W + k]
            speed += J[k] * x[i, V + k] + J[3 + k] * x[i, W + k]
            if j >= 0 and world.bodies.moving[j]:
                expected += J[6 + k] * mean[j, V + k] + J[9 + k] * mean[j, W + k]
                speed += J[6 + k] * x[j, V + k] + J[9 + k] * x[j, W + k]
        rows.gap[kept] = speed
        rows.expected[kept] = expected
        kept += 1
    write_images(kept, count, members, metric, EV, EW, rows)
    for c in range(kept):
        if rows.expected[c] < -_EXPECTED * math.sqrt(max(rows.own[c], 0.0)):  # surely an impact
            rows.own[c] = 0.0
    for k in range(ERROR * count):
        rows.delta[k] = 0.0
    solve_rows(kept, count, coupled, EV, EW, _TOLERANCE, rows)
    for a in range(count):
        i = members[a]
        for k in range(3):
            x[i, V + k] += rows.delta[ERROR * a + EV + k]
            x[i, W + k] += rows.delta[ERROR * a + EW + k]


@inner
def gather(i, moving, work, local):
    """Make the group of body i the one at hand; returns how many members it has."""
    count = 0
    for j in range(i, len(moving)):
        if moving[j] and work.group[j] == i:
            work.members[count], local[j] = j, count
            count += 1
    return count


@inner
def join_near(x, margin, world, work):
    """Join moving bodies whose bounding balls are nearer than a margin [m] to groups."""
    moving, radius, group = world.bodies.moving, world.bodies.radius, work.group
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            if moving[i] and moving[j]:
                square, near = 0.0, radius[i] + radius[j] + margin
                for k in range(3):
                    square += (x[i, P + k] - x[j, P + k]) ** 2
                if square < near * near:
                    join(group, i, j)
    for i in range(len(x)):
        group[i] = lowest(group, i)


@inner
def keep_overlap(count, depth, everything, moved, work):
    """Let the pairs of the group at hand that did not come free overlap as they did at the start."""
    any_kept = False
    for c in range(work.counts[CONTACTS]):
        i, j = work.ids[c, 0], work.ids[c, 1]
        far = moved[i] > _TOO_FAR or (j >= 0 and moved[j] > _TOO_FAR)
        if work.rows[c, GAP] < (2.0 * TOUCHING if far else -_SOLVED):
            low, column = _pair(i, j, len(depth))
            if depth[low, column] > work.kept_overlap[low, column]:
                work.kept_overlap[low, column] = depth[low, column]
                any_kept = True
    if any_kept and not everything:
        return
    for a in range(count):
        i = work.members[a]
        for column in range(depth.shape[1]):
            low, high = i, column
            if column < len(depth):
                low, high = min(i, column), max(i, column)
            work.kept_overlap[low, high] = max(work.kept_overlap[low, high], depth[low, high])


@inner(forceinline=True)
def _pair(i, j, bodies):
    """Row and column of bodies i and j, or of body i and element ``-1 - j``."""
    if j < 0:
        return i, bodies - 1 - j
    return min(i, j), max(i, j)


@inner
def note_depths(depth, overlap, work):
    """Note the overlaps of the contacts at hand, of pairs and of bodies [m]."""
    for c in range(work.counts[CONTACTS]):
        i, j, deep = work.ids[c, 0], work.ids[c, 1], -work.rows[c, GAP]
        low, column = _pair(i, j, len(depth))
        depth[low, column] = max(depth[low, column], deep)
        overlap[i] = max(overlap[i], deep)
        if j >= 0:
            overlap[j] = max(overlap[j], deep)


@inner
def project_sample(
    x, start, mean, metric, sides, world, work, rows, local, settled, depth, overlap, moved, look_only
):
    """Bring one state's bodies to where they do not overlap; returns whether the room was enough."""
    moving, group = world.bodies.moving, work.group
    for i in range(len(x)):
        group[i] = i
        settled[i] = not moving[i]
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            a, b = metric.place[i], metric.place[j]
            if a >= 0 and b >= 0 and metric.linked[a, b]:
                join(group, i, j)
    join_near(x, _PAIR_MORE_REACH, world, work)
    for _ in range(len(x)):
        any_moved = False
        for i in range(len(x)):
            if settled[i] or group[i] != i:
                continue
            count = gather(i, moving, work, local)
            for a in range(count):
                settled[work.members[a]] = True
            deepest = find_rows(x, count, -TOUCHING, -TOUCHING, True, sides, world, work)
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                return False
            note_depths(depth, overlap, work)
            if deepest <= TOUCHING or look_only:
                continue
            any_moved = True
            coupled = False
            for a in range(count):
                for b in range(a):
                    k, m = metric.place[work.members[a]], metric.place[work.members[b]]
                    coupled = coupled or (k >= 0 and m >= 0 and metric.linked[k, m])
            for attempt in range(_ATTEMPTS):
                left = project_group(
                    x, start, count, local, coupled, attempt > 0, attempt > 1, deepest, metric, sides, world, work, rows, moved
                )
                if work.counts[OVERFLOW] != NO_OVERFLOW:
                    return False
                farthest = 0.0
                for a in range(count):
                    farthest = max(farthest, moved[work.members[a]])
                if left <= _LEFT_OVER and farthest <= _TOO_FAR:
                    stop_approach(x, mean, count, local, coupled, metric, world, work, rows)
                    break
                if attempt > 1:
                    keep_overlap(count, depth, attempt >= _ATTEMPTS - 2, moved, work)
                restore(x, start, count, work)
                for a in range(count):
                    moved[work.members[a]] = 0.0
        if not any_moved or not _join_overlapping(x, world, work):
            break
        for i in range(len(x)):
            if work.part[i] != group[i]:  # the others of its new group begin anew as well
                for j in range(len(x)):
                    if moving[j] and group[j] == group[i]:
                        settled[j] = False
        for i in range(len(x)):
            if moving[i] and not settled[i]:
                moved[i] = 0.0
                for k in range(13):
                    x[i, k] = start[i, k]
                write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
    return work.counts[OVERFLOW] == NO_OVERFLOW


@inner
def _join_overlapping(x, world, work):
    """Join groups that overlap now, and let them count as not settled; returns whether any do.

    ``part`` of the workspace is told each body's group until now.
    """
    moving, radius, group, found = world.bodies.moving, world.bodies.radius, work.group, False
    for i in range(len(x)):
        work.part[i] = group[i]
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            if not (moving[i] and moving[j]) or work.part[i] == work.part[j]:
                continue
            square, near = 0.0, radius[i] + radius[j]
            for k in range(3):
                square += (x[i, P + k] - x[j, P + k]) ** 2
            if square < near * near and pair_candidates(x, i, j, -TOUCHING, 0.0, world, work) > 0:
                join(group, i, j)
                found = True
    for i in range(len(x)):
        group[i] = lowest(group, i)
    return found


@kernel
def project(states, mean, metric, sides, world, start, kept_overlap, look_only):
    """Move the bodies of states (N, B, 13) in place to the nearest poses without overlap.

    Parameters
    ----------
    states : (N, B, 13) float64
    mean : (B, 13) float64
        Of the belief that the states are of.
    metric : Metric
    sides : (B, B + E, 3) float64
        On which side of its partner the mean has each body (`sides_of`).
    world : World
        What does not move there, stays.
    start : Start
        Is told what was done.
    kept_overlap : (N, B, B + E) float32
        Is told what could not come free [m]; what it holds is kept.
    look_only : bool
        Whether nothing moves, and ``start`` is told the overlaps alone.
    """
    bodies, elements = len(mean), len(world.surroundings.kind)
    contacts, candidates, pool = 128, 1024, 8192
    local, settled = np.zeros(bodies, np.int64), np.zeros(bodies, np.bool_)
    depth, overlap, moved = np.zeros((bodies, bodies + elements)), np.zeros(bodies), np.zeros(bodies)
    begin = np.empty((bodies, 13))
    work = implicit_workspace(mean, kept_overlap[0, :0, :0], world, contacts, candidates, pool)
    rows = _room(contacts, bodies)
    for n in range(len(states)):
        x = states[n]
        begin[:] = x
        while True:
            x[:] = begin
            depth[:], overlap[:], moved[:] = 0.0, 0.0, 0.0
            reset(x, kept_overlap[n], work)
            if project_sample(
                x, begin, mean, metric, sides, world, work, rows, local, settled, depth, overlap, moved, look_only
            ):
                break
            if work.counts[OVERFLOW] == TOO_MANY_CANDIDATES:
                candidates *= 2
            elif work.counts[OVERFLOW] == TOO_LONG_LISTS:
                pool *= 2
            else:
                contacts *= 2
            work = implicit_workspace(mean, kept_overlap[0, :0, :0], world, contacts, candidates, pool)
            rows = _room(contacts, bodies)
        for i in range(bodies):
            start.overlap[n, i] = max(start.overlap[n, i], overlap[i])
            start.moved[n, i] = max(start.moved[n, i], moved[i])
            for c in range(bodies + elements):
                kept = work.kept_overlap[i, c]
                if kept > 0.0:
                    kept_overlap[n, i, c] = kept
                    start.kept[n, i] = max(start.kept[n, i], kept)
                    if c < bodies:
                        start.kept[n, c] = max(start.kept[n, c], kept)


@inner
def lower_group(x, start, count, local, metric, sides, world, work, rows):
    """Let the group at hand sink until contacts hold it; returns whether they do."""
    members, radius, gravity = work.members, world.bodies.radius, world.gravity
    size = math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
    down = (gravity[0] / size, gravity[1] / size, gravity[2] / size)
    most = _DROP
    for _ in range(_LOWERINGS):
        alone = count == 1
        for a in range(count):
            i = members[a]
            for j in range(len(x)):
                if j != i and alone:
                    square, near = 0.0, radius[i] + radius[j] + 3.0 * _DROP
                    for k in range(3):
                        square += (x[i, P + k] - x[j, P + k]) ** 2
                    alone = square >= near * near
        drop = min(most, _DROP if alone else _PAIR_DROP)
        find_rows(x, count, 2.5 * drop, 2.5 * drop, False, sides, world, work)
        if work.counts[OVERFLOW] != NO_OVERFLOW:
            return False
        for a in range(count):
            i = members[a]
            _write_lowering(metric.covariance, metric.place[i], work.R[i], down, 4.0 / radius[i] ** 2)
            for k in range(13):
                start[i, k] = x[i, k]
            for r in range(ERROR):
                rows.now[ERROR * a + r] = rows.delta[ERROR * a + r] = 0.0
            for k in range(3):
                rows.delta[ERROR * a + EP + k] = drop * down[k]
        m = work.counts[CONTACTS]
        write_jacobians(count, local, metric.place, world, work, rows)
        write_images(m, count, members, metric, EP, ER, rows)
        solve_rows(m, count, False, EP, ER, _TOLERANCE, rows)
        step = move_group(x, start, count, members, drop / _FARTHEST, 1.0, world.bodies.radius, rows, work)
        sunk = 0.0
        for a in range(count):
            i = members[a]
            way = 0.0
            for k in range(3):
                way += down[k] * (x[i, P + k] - start[i, P + k])
            sunk = max(sunk, way)
        if sunk < 0.5 * drop:  # what something holds is not to rock between its supports
            most = min(2.0 * step, _CALMER * drop)
        if most < _STILL:
            return True
    return False


@inner(forceinline=True)
def _write_lowering(covariance, b, R, down, turn):
    """How easily body b sinks, and turns about horizontal axes."""
    bx, by, bz = rotate_back(R, down[0], down[1], down[2])
    body = (bx, by, bz)
    for r in range(3):
        for c in range(3):
            covariance[b, EP + r, b, EP + c] = down[r] * down[c]
            covariance[b, ER + r, b, ER + c] = -turn * body[r] * body[c]
        covariance[b, ER + r, b, ER + r] += turn


@kernel
def lower(states, sides, world, start, kept_overlap):
    """Let all bodies that move in ``world`` sink until contacts hold them, in states (N, B, 13), in place.

    Each moves along gravity and turns about horizontal axes alone, without friction. ``start.unsettled`` is
    told where that did not end; the other arguments are those of `project`.
    """
    bodies = states.shape[1]
    contacts, candidates, pool = 128, 1024, 8192
    local, moving, before, begin = np.zeros(bodies, np.int64), world.bodies.moving, states[0].copy(), states[0].copy()
    place, count = np.full(bodies, -1), 0
    for i in range(bodies):
        if moving[i]:
            place[i] = count
            count += 1
    metric = Metric(np.zeros((count, ERROR, count, ERROR)), np.eye(count) > 0.0, place)
    work = implicit_workspace(before, kept_overlap[0, :0, :0], world, contacts, candidates, pool)
    rows = _room(contacts, bodies)
    for n in range(len(states)):
        x = states[n]
        before[:] = x
        i = 0
        while i < bodies:
            if i == 0:
                reset(x, kept_overlap[n], work)
                for k in range(bodies):
                    work.group[k] = k
                join_near(x, 3.0 * _DROP, world, work)
            if moving[i] and work.group[i] == i:
                count = gather(i, moving, work, local)
                held = lower_group(x, begin, count, local, metric, sides, world, work, rows)
                if work.counts[OVERFLOW] != NO_OVERFLOW:
                    if work.counts[OVERFLOW] == TOO_MANY_CANDIDATES:
                        candidates *= 2
                    elif work.counts[OVERFLOW] == TOO_LONG_LISTS:
                        pool *= 2
                    else:
                        contacts *= 2
                    work = implicit_workspace(before, kept_overlap[0, :0, :0], world, contacts, candidates, pool)
                    rows = _room(contacts, bodies)
                    x[:] = before
                    i = 0
                    continue
                for a in range(count):
                    start.unsettled[n, work.members[a]] = not held
                    if not held:
                        for k in range(13):
                            x[work.members[a], k] = before[work.members[a], k]
            i += 1


@kernel
def sides_of(mean, world):
    """On which side of each other body, and of each element, a state (B, 13) has its bodies.

    Returns
    -------
    (B, B + E, 3) float64
        Normals towards the body where it is nearest to its partner, in the partner's frame; 0 where it is
        far from it.
    """
    bodies, elements = len(mean), len(world.surroundings.kind)
    sides = np.zeros((bodies, bodies + elements, 3))
    none, least = np.zeros((bodies, bodies + elements, 3)), np.full((bodies, bodies + elements), np.inf)
    contacts, candidates, pool = 1024, 16384, 65536
    while True:
        work = implicit_workspace(mean, np.zeros((0, 0), np.float32), world, contacts, candidates, pool)
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
        contacts, candidates, pool = 2 * contacts, 2 * candidates, 2 * pool
    for c in range(work.counts[CONTACTS]):
        row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
        column = j
        if j < 0:
            column = bodies - 1 - j
        if row[GAP] >= least[i, column]:
            continue
        least[i, column] = row[GAP]
        R = world.surroundings.R[-1 - j] if j < 0 else work.R[j]
        s = rotate_back(R, row[DIRECTION], row[DIRECTION + 1], row[DIRECTION + 2])
        sides[i, column, 0], sides[i, column, 1], sides[i, column, 2] = s
    return sides


@inner
def reset(x, kept_overlap, work):
    """Begin anew with another state."""
    work.counts[OVERFLOW] = NO_OVERFLOW
    forget_lists(work)
    for i in range(len(x)):
        work.head[i] = -1
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
        for c in range(kept_overlap.shape[1]):
            work.kept_overlap[i, c] = kept_overlap[i, c]


@kernel
def _room(contacts, bodies):
    """Room for rows."""
    size = ERROR * bodies
    return Rows(
        np.zeros((contacts, 12)),
        np.zeros((contacts, size)),
        np.zeros(contacts),
        np.zeros(contacts),
        np.zeros(contacts),
        np.zeros(contacts),
        np.zeros(contacts, np.int64),
        np.zeros(contacts, np.int64),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.zeros((6, 6)),
        np.zeros(6),
    )
