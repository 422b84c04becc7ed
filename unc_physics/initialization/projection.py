"""Poses without overlap, as near as possible to those given, in the metric of a belief.

A sample of a belief about a mug on a table may lie in the table. The nearest pose without overlap minimises
``delta^T Sigma^-1 delta`` subject to ``g + J (delta - delta_now) >= 0`` for all gaps g of spheres nearby
(`overlap_rows`). Gaps are linear near a pose only, so that this is done again at what was found, until
nothing overlaps.

What cannot come free, as in a slot too narrow, keeps its overlap for ever, without a force
(`SolverMemory.kept_overlap`): any that decays would give energy.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.contact_patch import pair_candidates
from ..collision.contact_row import DIRECTION, GAP, MOMENT_I, MOMENT_J
from ..collision.contact_search import balls_within, join, lowest, pair_of
from ..collision.implicit_workspace import CONTACTS, NO_OVERFLOW, OVERFLOW, implicit_workspace, more_room
from ..compiler import inner, kernel
from ..compiler.arrays import assign, booleans, empty, integers, singles, zeros
from ..dynamics.contact_history import InitialAdjustment
from ..spatial.layout import EP, ER, ERROR, EV, EW, Q, V, W
from ..spatial.rotation import write_matrix
from .overlap_rows import (
    FARTHEST,
    Metric,
    Rows,
    along,
    gather,
    join_near,
    move_group,
    reset,
    restore,
    rows_room,
    solve_rows,
    write_images,
    write_jacobians,
)
from .overlap_search import OVERLAP_TOLERANCE, SOLVED, find_rows

#: Gaps that count [m]: at first and at least; how many times the deepest overlap more; and of these at most.
_REACH, _LEAST_REACH, _DEPTHS, _MORE_REACH, _PAIR_MORE_REACH = 2e-3, 2e-4, 2.0, 0.012, 3e-3
#: Overlap that is deep [m], and what share of the deepest is as good as that.
_DEEP, _DEEPEST = 3e-3, 0.4
_NEARER = 0.3  # share of the reach that pairs of bodies have, in which there are so many more spheres
_ROUNDS, _CAREFUL_ROUNDS = 10, 24
_CAREFUL = 0.5  # share of a step that a careful round takes
_NEAREST = 5e-4  # the search ends when its last step is shorter [m]
_LEFT_OVER, _TOO_FAR = (
    2e-4,
    8.0,
)  # a group with more overlap [m] or standard deviations moved stays unresolved
_SINGULAR = 1e-10  # smaller shares of a variance count as zero
#: Attempts: fast, careful and thorough ones, then without the pairs that still overlap.
_ATTEMPTS = 8
_WORST = 0.5  # pairs with at least this share of the deepest remaining overlap count as not separable
_EXPECTED = 5.0  # closing speeds below this many standard deviations may be zero


class ProjectionInput(NamedTuple):
    """Input of the projection of all samples.

    Attributes
    ----------
    mean : (B, 13) float64
        Of the belief that the states are of.
    metric : Metric
    sides : (B, B + E, 3) float64
        On which side of its partner the mean has each body (`sides_of`).
    look_only : bool
        Whether nothing moves, and overlaps are noted alone.
    """

    mean: np.ndarray
    metric: Metric
    sides: np.ndarray
    look_only: bool


class ProjectionOutput(NamedTuple):
    """Output of the projection for each sample.

    Attributes
    ----------
    start : InitialAdjustment
        What was done.
    first_time : (N, B, B + E) float32
        0 where two overlapped: they touch at time 0.
    kept_overlap : (N, B, B + E) float32
        Overlap that could not come free [m]; earlier values are kept.
    """

    start: InitialAdjustment
    first_time: np.ndarray
    kept_overlap: np.ndarray


class ProjectionArrays(NamedTuple):
    """Arrays of the sample at hand.

    Attributes
    ----------
    begin : (B, 13) float64
        Its states as they were given.
    local : (B,) int64
        Place of each body in its group.
    settled : (B,) bool
    depth : (B, B + E) float64
        Deepest overlap of each pair [m].
    overlap : (B,) float64
        Deepest overlap of each body [m].
    moved : (B,) float64
        How many standard deviations each body was moved.
    rows : Rows
    """

    begin: np.ndarray
    local: np.ndarray
    settled: np.ndarray
    depth: np.ndarray
    overlap: np.ndarray
    moved: np.ndarray
    rows: Rows


@kernel
def project(states, given, found, world):
    """Move the bodies of states (N, B, 13) in place to the nearest poses without overlap.

    Parameters
    ----------
    states : (N, B, 13) float64
    given : ProjectionInput
    found : ProjectionOutput
        Is written.
    world : World
        What does not move there, stays.
    """
    bodies, elements = len(given.mean), len(world.environment.kind)
    room = 128, 1024, 8192
    local, settled = integers(bodies), booleans(bodies)
    depth, overlap, moved = zeros((bodies, bodies + elements)), zeros(bodies), zeros(bodies)
    begin = empty((bodies, 13))
    n = 0
    while n < len(states):
        work = implicit_workspace(given.mean, singles((0, 0)), world, room)
        scratch = ProjectionArrays(begin, local, settled, depth, overlap, moved, rows_room(room[0], bodies))
        n = _project_from(n, states, given, found, world, work, scratch)
        room = more_room(work.counts, room)


@inner
def _project_from(n, states, given, found, world, work, scratch):
    """Move the bodies of state ``n`` and the following ones as long as there is room; returns the first state
    that is left.
    """
    start, depth, overlap, moved = found.start, scratch.depth, scratch.overlap, scratch.moved
    bodies, columns = depth.shape
    while n < len(states):
        if world.implicit.stop[0] != 0:
            return len(states)
        x = states[n]
        assign(scratch.begin, x)
        for i in range(bodies):
            overlap[i] = moved[i] = 0.0
            for c in range(columns):
                depth[i, c] = 0.0
        reset(x, found.kept_overlap[n], work)
        if not project_sample(x, given, world, work, scratch):
            assign(x, scratch.begin)
            return n
        for i in range(bodies):
            start.overlap[n, i] = max(start.overlap[n, i], overlap[i])
            start.moved[n, i] = max(start.moved[n, i], moved[i])
            for c in range(columns):
                kept = work.kept_overlap[i, c]
                if depth[i, c] > OVERLAP_TOLERANCE and not given.look_only:
                    found.first_time[n, i, c] = 0.0
                if kept > 0.0:
                    found.kept_overlap[n, i, c] = kept
                    start.kept[n, i] = max(start.kept[n, i], kept)
                    if c < bodies:
                        start.kept[n, c] = max(start.kept[n, c], kept)
        n += 1
    return n


@inner(noinline=True)
def project_sample(x, given, world, work, scratch):
    """Bring one state's bodies to where they do not overlap; returns whether the room was enough."""
    metric, start, settled, moved = given.metric, scratch.begin, scratch.settled, scratch.moved
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
            count = gather(i, moving, work, scratch.local)
            for a in range(count):
                settled[work.members[a]] = True
            deepest = find_rows(
                x, count, -OVERLAP_TOLERANCE, -OVERLAP_TOLERANCE, True, given.sides, world, work
            )
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                return False
            note_depths(scratch.depth, scratch.overlap, work)
            if deepest <= OVERLAP_TOLERANCE or given.look_only:
                continue
            any_moved = True
            coupled = False
            for a in range(count):
                for b in range(a):
                    k, m = metric.place[work.members[a]], metric.place[work.members[b]]
                    coupled = coupled or (k >= 0 and m >= 0 and metric.linked[k, m])
            for attempt in range(_ATTEMPTS):
                if world.implicit.stop[0] != 0:
                    return True
                left = project_group(
                    x, count, coupled, attempt > 0, attempt > 1, deepest, given, world, work, scratch
                )
                if work.counts[OVERFLOW] != NO_OVERFLOW:
                    return False
                farthest = 0.0
                for a in range(count):
                    farthest = max(farthest, moved[work.members[a]])
                if left <= _LEFT_OVER and farthest <= _TOO_FAR:
                    stop_approach(x, count, coupled, given, world, work, scratch)
                    break
                if attempt > 1:
                    keep_overlap(count, scratch.depth, attempt >= _ATTEMPTS - 2, moved, work)
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
            near = balls_within(x, i, j, 0.0, radius)
            if near and pair_candidates(x, i, j, -OVERLAP_TOLERANCE, 0.0, world, work) > 0:
                join(group, i, j)
                found = True
    for i in range(len(x)):
        group[i] = lowest(group, i)
    return found


@inner(noinline=True)
def project_group(x, count, coupled, careful, thorough, deepest, given, world, work, scratch):
    """Move the group at hand to the nearest poses without overlap; returns the overlap that is left [m].

    ``scratch.moved`` receives the distance that each body moved, in standard deviations. The contact rows
    are those of the end.
    """
    members, metric, sides = work.members, given.metric, given.sides
    start, rows = scratch.begin, scratch.rows
    for k in range(ERROR * count):
        rows.now[k] = 0.0
    pairs = len(x) > 1
    left, reach, step, any_free = deepest, _REACH, math.inf, False
    deep = deepest > _DEEP and not thorough and pairs
    rounds, share = (_CAREFUL_ROUNDS, _CAREFUL) if careful else (_ROUNDS, 1.0)
    for round in range(rounds + 1):
        if world.implicit.stop[0] != 0:
            break
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
        free = round > 0 and left <= SOLVED
        if free:
            any_free = True
            for k in range(ERROR * count):
                rows.best[k] = rows.now[k]
        if (free and step <= _NEAREST) or round == rounds:
            break
        m = work.counts[CONTACTS]
        write_jacobians(count, scratch.local, metric.place, world, work, rows)
        write_images(m, count, members, metric, EP, ER, rows)
        for c in range(m):
            rows.gap[c] -= along(rows.jacobian[c], rows.now, rows.first[c], rows.second[c], EP, ER)
        for k in range(ERROR * count):
            rows.delta[k] = 0.0
        solve_rows(m, count, coupled, EP, ER, rows)
        # back from where nothing overlaps, no farther than the rows know; and what is nearly right is not to
        # jump between far supports
        step = move_group(
            x,
            start,
            count,
            members,
            reach / FARTHEST if free else 1.0,
            share,
            world.bodies.radius,
            rows,
            work,
        )
        reach = max(0.5 * reach, _LEAST_REACH)
    if left > _LEFT_OVER and any_free and work.counts[OVERFLOW] == NO_OVERFLOW:
        for k in range(ERROR * count):
            rows.delta[k] = rows.best[k]
        move_group(x, start, count, members, math.inf, 1.0, world.bodies.radius, rows, work)
        left = find_rows(x, count, _LEAST_REACH, _LEAST_REACH, False, sides, world, work)
    note_motion(count, members, metric, rows, scratch.moved)
    return left


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
def stop_approach(x, count, coupled, given, world, work, scratch):
    """Take from the group's velocities what goes into its contacts, as far as it may be none at all."""
    mean, metric, local, rows = given.mean, given.metric, scratch.local, scratch.rows
    members, kept = work.members, 0
    for c in range(work.counts[CONTACTS]):
        row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
        if row[GAP] > 2.0 * OVERLAP_TOLERANCE:
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
    solve_rows(kept, count, coupled, EV, EW, rows)
    for a in range(count):
        i = members[a]
        for k in range(3):
            x[i, V + k] += rows.delta[ERROR * a + EV + k]
            x[i, W + k] += rows.delta[ERROR * a + EW + k]


@inner
def keep_overlap(count, depth, everything, moved, work):
    """Let the pairs of the group at hand that came least free overlap as they did at the start."""
    any_kept, deepest = False, 0.0
    for c in range(work.counts[CONTACTS]):
        deepest = max(deepest, -work.rows[c, GAP])
    for c in range(work.counts[CONTACTS]):
        i, j = work.ids[c, 0], work.ids[c, 1]
        far = moved[i] > _TOO_FAR or (j >= 0 and moved[j] > _TOO_FAR)
        if work.rows[c, GAP] < (2.0 * OVERLAP_TOLERANCE if far else -max(SOLVED, _WORST * deepest)):
            low, column = pair_of(i, j, len(depth))
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


@inner
def note_depths(depth, overlap, work):
    """Note the overlaps of the contacts at hand, of pairs and of bodies [m]."""
    for c in range(work.counts[CONTACTS]):
        i, j, deep = work.ids[c, 0], work.ids[c, 1], -work.rows[c, GAP]
        low, column = pair_of(i, j, len(depth))
        depth[low, column] = max(depth[low, column], deep)
        overlap[i] = max(overlap[i], deep)
        if j >= 0:
            overlap[j] = max(overlap[j], deep)
