"""Rows that keep bodies apart, in the metric of their error states, and the motion that solves them.

A motion ``delta = Sigma J^T lambda`` with non-negative lambda is the least one in the metric of Sigma that
keeps all gaps, ``g + J delta >= 0``; projected Gauss-Seidel finds lambda.
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

#: Farthest way of a body in a round [m].
FARTHEST = 0.02
_WIDEST = 0.2  # and its widest turn [rad]
_SWEEPS = 200
_TOLERANCE = 1e-7  # of a gap, or a speed, in a sweep [m], [m/s]
_SOFTNESS = 1e-4  # relative, so that rows that say the same do no harm
_CERTAIN = 1e-18  # variance of a gap that cannot move [m^2]


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


@kernel(noinline=True)
def rows_room(contacts, bodies):
    """Room for rows."""
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
            if moving[i] and moving[j] and balls_within(x, i, j, margin, radius):
                join(group, i, j)
    for i in range(len(x)):
        group[i] = lowest(group, i)


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
        rows.own[c] = along(rows.jacobian[c], rows.image[c], rows.first[c], rows.second[c], linear, angular)
        rows.multiplier[c] = 0.0


@inner(forceinline=True)
def along(J, motion, first, second, linear, angular):
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
def solve_rows(m, count, coupled, linear, angular, rows):
    """Find the multipliers, and the motion ``delta`` that they make of the one it holds."""
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
    """Bring the group at hand back to where it was."""
    for a in range(count):
        i = work.members[a]
        for k in range(13):
            x[i, k] = start[i, k]
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
