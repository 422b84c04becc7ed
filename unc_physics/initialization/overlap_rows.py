"""Constraint rows that keep bodies apart, in the metric of their error states, and their solver.

The motion is ``delta = Sigma J^T lambda`` with non-negative lambda, computed by projected Gauss-Seidel. In
the metric of Sigma, it is the smallest motion with ``g + J delta >= 0`` for all gaps.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.contact_row import DIRECTION, GAP, MOMENT_I, MOMENT_J
from ..collision.contact_search import balls_within, forget_lists, join, lowest
from ..collision.implicit_workspace import CONTACTS, NO_OVERFLOW, OVERFLOW
from ..compiler import inner, kernel
from ..compiler.arrays import integers, zeros
from ..spatial.layout import EP, ER, ERROR, Q
from ..spatial.moments import boxplus
from ..spatial.rotation import rotate_back, write_matrix

#: Largest translation of a body in an iteration [m].
FARTHEST = 0.02
_WIDEST = 0.2  # largest rotation [rad]
_SWEEPS = 200
_TOLERANCE = 1e-7  # change of a gap [m] or a speed [m/s] in a sweep
_SOFTNESS = 1e-4  # relative, so that redundant rows are harmless
_CERTAIN = 1e-18  # variance below which a gap cannot change [m^2]


class Metric(NamedTuple):
    """Metric of possible motions of bodies.

    Attributes
    ----------
    covariance : (M, 12, M, 12) float64
        Covariance of the error states of M bodies.
    linked : (M, M) bool
        Whether two bodies are correlated.
    place : (B,) int64
        Index of each body among the M; -1 if it does not move.
    """

    covariance: np.ndarray
    linked: np.ndarray
    place: np.ndarray


class Rows(NamedTuple):
    """Constraint rows of a group, and arrays of the solver.

    Attributes
    ----------
    jacobian : (C, 12) float64
        Derivative of the gap with respect to position and body-frame rotation of the first body, then of the
        second.
    image : (C, 12 G) float64
        Motion of the group's error states for a unit multiplier.
    gap, own, multiplier, expected : (C,) float64
        Gap without motion, its derivative by the multiplier, the multiplier, and the value for the mean
        state.
    first, second : (C,) int64
        Indices of the bodies in the group; -1 for one that does not move.
    delta, now, best : (12 G,) float64
        Motion of the group: solved, applied, and applied when nothing overlapped.
    factor, solved : (6, 6) and (6,) float64
        Factorization of the covariance of one body's pose.
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


@kernel(noinline=True)
def rows_room(contacts, bodies):
    """Return arrays for rows."""
    size = ERROR * bodies
    return Rows(
        zeros((contacts, 12)),
        zeros((contacts, size)),
        zeros(contacts),
        zeros(contacts),
        zeros(contacts),
        zeros(contacts),
        integers(contacts),
        integers(contacts),
        zeros(size),
        zeros(size),
        zeros(size),
        zeros((6, 6)),
        zeros(6),
    )


@inner
def gather(i, moving, work, local):
    """Make body i's group the current one; return its number of members."""
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
            if moving[i] and moving[j] and balls_within(x, i, j, margin, radius):
                join(group, i, j)
    for i in range(len(x)):
        group[i] = lowest(group, i)


@inner
def reset(x, kept_overlap, work):
    """Reset the workspace for another state."""
    work.counts[OVERFLOW] = NO_OVERFLOW
    forget_lists(work)
    for i in range(len(x)):
        work.head[i] = -1
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
        for c in range(kept_overlap.shape[1]):
            work.kept_overlap[i, c] = kept_overlap[i, c]


@inner
def write_jacobians(count, local, place, world, work, rows):
    """Write rows for the current contacts, for positions and body-frame rotations."""
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
    """Write ``Sigma J^T`` and ``J Sigma J^T`` of each row.

    The rows concern the parts of the error state that begin at ``linear`` and ``angular``.
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
        rows.own[c] = along(rows.jacobian[c], rows.image[c], rows.first[c], rows.second[c], linear, angular)
        rows.multiplier[c] = 0.0


@inner(forceinline=True)
def along(J, motion, first, second, linear, angular):
    """Return the change of a gap for a motion (12 G,)."""
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
def solve_rows(m, count, coupled, linear, angular, rows):
    """Solve for the multipliers, and add the resulting motion to ``delta``."""
    delta = rows.delta
    for _ in range(_SWEEPS):
        change = 0.0
        for c in range(m):
            own = rows.own[c]
            if own <= _CERTAIN:
                continue
            first, second, old = rows.first[c], rows.second[c], rows.multiplier[c]
            gap = rows.gap[c] + along(rows.jacobian[c], delta, first, second, linear, angular)
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
        if change < _TOLERANCE:
            break


@inner
def move_group(x, start, count, members, limit, share, radius, rows, work):
    """Move the group from the states ``start`` along the solved motion; return the largest displacement [m].

    The applied motion is a share of the solved one, within a limit.
    """
    largest = 0.0
    for a in range(count):
        way = turn = 0.0
        for k in range(3):
            way += (rows.delta[ERROR * a + EP + k] - rows.now[ERROR * a + EP + k]) ** 2
            turn += (rows.delta[ERROR * a + ER + k] - rows.now[ERROR * a + ER + k]) ** 2
        way, turn = math.sqrt(way), math.sqrt(turn)
        largest = max(largest, way + radius[members[a]] * turn)
        share = min(share, min(limit * FARTHEST / max(way, 1e-300), limit * _WIDEST / max(turn, 1e-300)))
    for k in range(ERROR * count):
        rows.now[k] += share * (rows.delta[k] - rows.now[k])
    for a in range(count):
        i = members[a]
        boxplus(start[i], rows.now[ERROR * a : ERROR * (a + 1)], x[i])
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
    return share * largest


@inner
def restore(x, start, count, work):
    """Move the current group back to the states ``start``."""
    for a in range(count):
        i = work.members[a]
        for k in range(13):
            x[i, k] = start[i, k]
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
