"""Settling: bodies at rest sink until contacts hold them.

Each body moves along gravity and rotates about horizontal axes, and keeps its other coordinates. The rows are
the same as for projection (`overlap_rows`). The motion of an iteration is the drop that these constraints
allow.
"""

import math

import numpy as np

from ..collision.contact_search import balls_within
from ..collision.implicit_workspace import CONTACTS, NO_OVERFLOW, OVERFLOW, implicit_workspace, more_room
from ..compiler import inner, kernel
from ..compiler.arrays import assign, integers, singles, zeros
from ..spatial.layout import EP, ER, ERROR, P
from ..spatial.rotation import rotate_back
from .overlap_rows import (
    FARTHEST,
    Metric,
    gather,
    join_near,
    move_group,
    reset,
    rows_room,
    solve_rows,
    write_images,
    write_jacobians,
)
from .overlap_search import find_rows

# drop of an iteration, alone and near other bodies [m]; number of iterations
_DROP, _PAIR_DROP, _LOWERINGS = 0.01, 2e-3, 200
_CALMER = 0.6  # factor on the drop after an iteration that a contact stopped
_STILL = 2e-6  # drop below which settling ends [m]


@kernel
def lower(states, sides, world, start, kept_overlap):
    """Let all bodies that move in ``world`` sink until contacts hold them, in states (N, B, 13), in place.

    Each body moves along gravity and rotates about horizontal axes, without friction. ``start.unsettled`` is
    set where settling does not converge. ``sides`` is as in `ProjectionInput`, ``kept_overlap`` as in
    `ProjectionOutput`.
    """
    bodies = states.shape[1]
    room = 128, 1024, 8192
    local, moving, before = integers(bodies), world.bodies.moving, states[0].copy()
    begin = states[0].copy()
    place, count = np.full(bodies, -1), 0
    for i in range(bodies):
        if moving[i]:
            place[i] = count
            count += 1
    metric = Metric(zeros((count, ERROR, count, ERROR)), np.eye(count) > 0.0, place)
    n = 0
    while n < len(states):
        work = implicit_workspace(before, singles((0, 0)), world, room)
        rows = rows_room(room[0], bodies)
        n = _lower_from(
            n, states, before, begin, local, metric, sides, world, start, kept_overlap, work, rows
        )
        room = more_room(work.counts, room)


@inner
def _lower_from(n, states, before, begin, local, metric, sides, world, start, kept_overlap, work, rows):
    """Lower the bodies of state ``n`` and the following ones; return the first state left undone."""
    bodies, moving = states.shape[1], world.bodies.moving
    while n < len(states):
        x = states[n]
        assign(before, x)
        reset(x, kept_overlap[n], work)
        for k in range(bodies):
            work.group[k] = k
        join_near(x, 3.0 * _DROP, world, work)
        for i in range(bodies):
            if not moving[i] or work.group[i] != i:
                continue
            count = gather(i, moving, work, local)
            held = lower_group(x, begin, count, local, metric, sides, world, work, rows)
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                assign(x, before)
                return n
            for a in range(count):
                start.unsettled[n, work.members[a]] = not held
                if not held:
                    for k in range(13):
                        x[work.members[a], k] = before[work.members[a], k]
        n += 1
    return n


@inner(noinline=True)
def lower_group(x, start, count, local, metric, sides, world, work, rows):
    """Let the current group sink until contacts hold it; return whether they do."""
    members, radius, gravity = work.members, world.bodies.radius, world.gravity
    size = math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
    down = (gravity[0] / size, gravity[1] / size, gravity[2] / size)
    most = _DROP
    for _ in range(_LOWERINGS):
        if world.implicit.stop[0] != 0:
            return False
        alone = count == 1
        for a in range(count):
            i = members[a]
            for j in range(len(x)):
                if j != i and alone:
                    alone = not balls_within(x, i, j, 3.0 * _DROP, radius)
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
        solve_rows(m, count, False, EP, ER, rows)
        step = move_group(x, start, count, members, drop / FARTHEST, 1.0, world.bodies.radius, rows, work)
        sunk = 0.0
        for a in range(count):
            i = members[a]
            way = 0.0
            for k in range(3):
                way += down[k] * (x[i, P + k] - start[i, P + k])
            sunk = max(sunk, way)
        if sunk < 0.5 * drop:  # a supported body must not rock between its supports
            most = min(2.0 * step, _CALMER * drop)
        if most < _STILL:
            return True
    return False


@inner(forceinline=True)
def _write_lowering(covariance, b, R, down, turn):
    """Write a covariance with which body b sinks along gravity and rotates about horizontal axes."""
    bx, by, bz = rotate_back(R, down[0], down[1], down[2])
    body = (bx, by, bz)
    for r in range(3):
        for c in range(3):
            covariance[b, EP + r, b, EP + c] = down[r] * down[c]
            covariance[b, ER + r, b, ER + c] = -turn * body[r] * body[c]
        covariance[b, ER + r, b, ER + r] += turn
