"""Poses without overlap at time 0: read `separate`, then `_approach`, which brings one sample to its pose.

A sample moves from a pose without overlap to its own, in rounds. Bodies stop and slide where they touch, so
that none goes through a wall, however thin. A round finds the smallest correction that keeps all gaps open,
in the metric of the belief: what is known well gives way least. The last rounds take out depth that is left.
"""

import math
from typing import NamedTuple

import numpy as np

from ...compiler import inner, kernel
from ...compiler.arrays import zeros
from ...shapes.columns import ROUNDING
from ...spatial.layout import STATE as STATE_SIZE
from ...spatial.layout import P, Q, V, W
from ...spatial.rotation import conjugate, cross, log, multiply
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ACCEL,
    BODY_A,
    BODY_B,
    CENTRE,
    COUNTS,
    DRIFT,
    DRIVEN,
    GAP0,
    IMASS,
    LEVER_A,
    LEVER_B,
    MODE,
    NORMAL,
    ON_AXIS,
    PIECE_A,
    PIECE_B,
    QUAT,
    RADIUS,
    REACH,
    ROW0,
    ROWS,
    SINCE,
    SLOP,
    SPIN,
    STATE,
    SURFACE_OF,
    SURGE,
    SWEEPS,
    TRAVEL,
    VEL,
    WARM,
    WAY,
)
from .contacts import find, forget
from .motion import pose, quaternion, roll_arm, rotate, write
from .rollouts import FIRST_LISTS, FIRST_ROOM, arrays_to_work
from .search import FULL, forget_all, place

FREE = SLOP  # m, depth that counts as none: what a step leaves
STRIDE = 4e-3  # m, way of a point in a round: depths stay less and so go the way they came, in thin walls too
_STOPPED = 2e-4  # m, way of a round at which a sample is as near to its pose as it gets
_DETOUR = 2  # times the rounds of a straight way that sliding may take
_PATIENCE = 6  # rounds without a lesser depth after which a sample is given up
_CALMER = 0.9  # factor on a drop after a round in which contacts press: of rims few points take part
_HELD = 0.5  # share of a drop below which contacts hold bodies nearly, and the drop is halved
_LOWERINGS = 200  # rounds: from .8 m above a support
_EVEN = (
    2e-6  # m, m/s: change of gaps, and of their speeds, that ends sweeps: a tenth of the depth that is left
)
_SAME = 1e-9  # m, way between poses that are the same up to round-off
_SURE = 5.0  # standard deviations by which a mean velocity closes a contact that is certainly an impact
_FIRM = 1e-18  # m^2, variance of a gap that nothing moves: round-off


class Mobility(NamedTuple):
    """How easily bodies move, in world axes.

    Attributes
    ----------
    covariance, velocity : (B, B, 6, 6) float64
        Of positions and rotations, and of linear and angular velocities; zero where a body does not move.
    mean : (B, 6) float64
        Of velocities.
    moves : (B,) bool
        Bodies that move freely; contacts between two others do not count.
    joint : bool
        Whether bodies are correlated.
    """

    covariance: np.ndarray
    velocity: np.ndarray
    mean: np.ndarray
    moves: np.ndarray
    joint: bool


class Separation(NamedTuple):
    """What `separate` found for each of N samples.

    Attributes
    ----------
    overlap : (N, B) float32
        Deepest overlap of each body before [m].
    kept : (N, B) float32
        And after, if it is more than `FREE`.
    partner : (N, B) float32
        1 + number of the body or, from B on, element that it is with; 0 for none.
    first_time : (N, B, B + E) float32
        0 where two overlapped; otherwise as given.
    """

    overlap: np.ndarray
    kept: np.ndarray
    partner: np.ndarray
    first_time: np.ndarray


class _Rows(NamedTuple):
    """Constraints of one round: gaps that stay open."""

    lever: np.ndarray  # (rooms, 12): change of the gap by positions and rotations of both bodies
    image: np.ndarray  # (rooms, B, 6): motion for a unit multiplier
    value: np.ndarray  # (rooms, 3): room to close, its change for a unit multiplier, multiplier
    motion: np.ndarray  # (B, 6): of the round


@kernel
def _rows(room, bodies):
    return _Rows(zeros((room, 12)), zeros((room, bodies, 6)), zeros((room, 3)), zeros((bodies, 6)))


@kernel
def separate(states, nominal, metric, world, look_only, outcome):
    """Move states (N, B, 13), in place, to poses without overlap.

    Parameters
    ----------
    states : (N, B, 13) float64
    nominal : (B, 13) float64
        State without overlap from which each one comes; with no rows, depth is taken out by the shortest way.
    metric : Mobility
    world : EverydayWorld
    look_only : bool
        Whether nothing moves, and only ``overlap`` and ``first_time`` are noted.
    outcome : Separation
    """
    count, room, lists = np.zeros(COUNTS, np.int64), FIRST_ROOM * world.count + 64, FIRST_LISTS
    work, rows = arrays_to_work(world, room, lists, count), _rows(room, world.count)
    n = 0
    while n < len(states) and world.stop[0] == 0:
        if _separate_one(n, states[n], nominal, metric, world, look_only, outcome, work, rows):
            n += 1
        else:
            room, lists = 2 * room, 2 * lists
            work, rows = arrays_to_work(world, room, lists, count), _rows(room, world.count)


@kernel
def lower(states, down, metric, world, unsettled):
    """Let bodies sink along ``down`` (3,) until contacts hold them, in states (N, B, 13), in place.

    They sink and tilt as the metric says, without friction. ``unsettled`` (N,) is set where they do not come
    to rest.
    """
    count, room, lists = np.zeros(COUNTS, np.int64), FIRST_ROOM * world.count + 64, FIRST_LISTS
    work, rows = arrays_to_work(world, room, lists, count), _rows(room, world.count)
    n = 0
    while n < len(states) and world.stop[0] == 0:
        held = _lower_one(states[n], down, metric, world, work, rows)
        if held == FULL:
            room, lists = 2 * room, 2 * lists
            work, rows = arrays_to_work(world, room, lists, count), _rows(room, world.count)
        else:
            unsettled[n] = held == 0
            n += 1


@inner
def _load(x, metric, world, work, surge):
    """Begin with a state, at rest."""
    Y = work.Y
    forget_all(work.search)
    for i in range(len(Y)):
        for c in range(Y.shape[1]):
            Y[i, c] = world.bodies[i, c]
        if i < world.count:
            for c in range(STATE_SIZE):
                Y[i, STATE + c] = x[i, c]
            Y[i, IMASS], Y[i, SURGE] = (1.0, surge) if metric.moves[i] else (0.0, 0.0)
            write(Y, i, VEL, (0.0, 0.0, 0.0))
            write(Y, i, SPIN, (0.0, 0.0, 0.0))
            pose(Y, i)
        place(i, Y, work.solids)


@inner
def _separate_one(n, x, nominal, metric, world, look_only, outcome, work, rows):
    """Move one state; return whether there was room."""
    _load(x, metric, world, work, 0.0)
    found = find(world.count, 1.0, 0, 0.0, work.Y, work.solids, work.found, work.C, work.search, work.count)
    if found == FULL:
        return False
    deep = _note(n, found, work.found, world, outcome.overlap, outcome.partner, outcome.first_time)
    for i in range(world.count):
        outcome.partner[n, i] = 0.0
    if look_only or (len(nominal) == 0 and deep <= FREE):
        return True
    _load(nominal if len(nominal) > 0 else x, metric, world, work, 0.0)
    found, swapped = _approach(x, metric, world, work, rows)
    if found == FULL:
        return False
    C = work.C if swapped else work.found
    _note(n, found, C, world, outcome.kept, outcome.partner, outcome.first_time[:0])
    _stop(x, found, C, work.Y, work.solids, metric, rows)
    for i in range(world.count):
        if metric.moves[i] and _way(i, x, work.Y)[2] > _SAME:
            _save_pose(i, x, work.Y)
    return True


@inner
def _save_pose(i, x, Y):
    """Write the pose of body i into a state."""
    for c in range(3):
        x[i, P + c] = Y[i, CENTRE + c]
    for c in range(4):
        x[i, Q + c] = Y[i, QUAT + c]


@inner
def _deepest(found, C):
    """Return the largest depth of contacts."""
    deepest = 0.0
    for k in range(found):
        deepest = max(deepest, -C[k, GAP0])
    return deepest


@inner
def _note(n, found, C, world, depth, partner, first_time):
    """Note the deepest overlap of each body and its partner, and pairs that touch; return the deepest."""
    deepest = 0.0
    for k in range(found):
        deep = -C[k, GAP0]
        if deep <= FREE:
            continue
        deepest = max(deepest, deep)
        i = int(C[k, BODY_B])
        j = int(world.spots[int(C[k, PIECE_A]), SURFACE_OF])
        if len(first_time) > 0:
            first_time[n, min(i, j), max(i, j)] = 0.0
        for one, other in ((i, j), (j, i)):
            if one < world.count and deep > depth[n, one]:
                depth[n, one], partner[n, one] = deep, 1.0 + other
    return deepest


@inner
def _way(i, x, Y):
    """Return translation and rotation from body i's pose to that of a state, and the way of its points."""
    v = minus(three(x, i, P), three(Y, i, CENTRE))
    q = x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]
    w = log(multiply(q, conjugate(quaternion(Y, i))))
    return v, w, math.sqrt(dot(v, v)) + Y[i, RADIUS] * math.sqrt(dot(w, w))


@inner
def _approach(x, metric, world, work, rows):
    """Move all bodies from where they are to the state ``x`` as far as they get.

    Returns the number of contacts at the end, and whether they are in ``work.C``, not in ``work.found``.
    """
    Y, search, C, old, swapped = work.Y, work.search, work.found, work.C, False
    left, before, best, rounds = 0, 0, math.inf, 0
    for i in range(world.count):
        left = max(left, _DETOUR * math.ceil(_way(i, x, Y)[2] / STRIDE))
    while True:
        for i in range(world.count):
            v, w, way = _way(i, x, Y)
            wanted = 1.0 if left > 0 else 0.0
            _aim(i, times(wanted, v), times(wanted, w), Y, rows)
            if not metric.moves[i]:
                Y[i, DRIVEN], Y[i, REACH] = (1.0, min(way, STRIDE) + DRIFT) if way > 0.0 else (0.0, 0.0)
        found = find(world.count, 1.0, before, 0.0, Y, work.solids, C, old, search, work.count)
        if found == FULL:
            return FULL, swapped
        forget(before, old, search)
        if left <= 0:
            deepest = _deepest(found, C)
            rounds = 0 if deepest < best - FREE else rounds + 1
            best = min(best, deepest)
            if deepest <= FREE or rounds == _PATIENCE:
                return found, swapped
        _keep_apart(found, left > 0, C, Y, work.solids, metric, rows)
        way = _move(world.count, Y, rows)
        _remember(found, C, Y, search)
        left = left - 1 if way > _STOPPED else 0  # until nothing moves: all have arrived, or are stopped
        before, swapped = found, not swapped
        C, old = old, C


@inner
def _lower_one(x, down, metric, world, work, rows):
    """Lower the bodies of one state; return 1 if contacts hold them, 0 if not, or `FULL`."""
    _load(x, metric, world, work, 0.0)
    Y, C, old, before, drop = work.Y, work.found, work.C, 0, STRIDE
    for _ in range(_LOWERINGS):
        for i in range(world.count):
            own = drop if metric.moves[i] else 0.0
            write(Y, i, ACCEL, (down[0], down[1], down[2]))
            _aim(i, (own * down[0], own * down[1], own * down[2]), (0.0, 0.0, 0.0), Y, rows)
        found = find(world.count, 1.0, before, 0.0, Y, work.solids, C, old, work.search, work.count)
        if found == FULL:
            return FULL
        forget(before, old, work.search)
        deepest = _deepest(found, C)
        pressed = _keep_apart(found, True, C, Y, work.solids, metric, rows)
        way = _move(world.count, Y, rows)
        _remember(found, C, Y, work.search)
        if pressed:
            drop *= _HELD if way < _HELD * drop else _CALMER
        if drop < SLOP and deepest <= FREE:
            for i in range(world.count):
                _save_pose(i, x, Y)
            return 1
        before = found
        C, old = old, C
    return 0


@inner
def _aim(i, v, w, Y, rows):
    """Let a round begin with the motion that body i is to make; what is near is looked for a stride ahead."""
    write(rows.motion, i, 0, v)
    write(rows.motion, i, 3, w)
    share = STRIDE / max(STRIDE, math.sqrt(dot(v, v)) + Y[i, RADIUS] * math.sqrt(dot(w, w)))
    write(Y, i, VEL, times(share, v))
    write(Y, i, SPIN, times(share, w))


@inner
def _write_lever(rows, k, at, r, n, sign):
    """Write the change of gap k by position and rotation of a body whose point is at ``r``."""
    write(rows.lever, k, at, times(sign, n))
    write(rows.lever, k, at + 3, times(sign, cross(r, n)))


@inner
def _fill(k, C, Y, solids, covariance, joint, rows):
    """Fill levers and images of contact k, with no room to close."""
    a, b, n = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, NORMAL)
    pa, pb = int(C[k, PIECE_A]), int(C[k, PIECE_B])
    ra, rb = three(C, k, LEVER_A), three(C, k, LEVER_B)
    if solids.spots[pa, ON_AXIS] > 0.0:
        ra = plus(ra, roll_arm(Y, a))
    if solids.spots[pb, ON_AXIS] > 0.0:
        rb = plus(rb, roll_arm(Y, b))
    _write_lever(rows, k, 0, plus(ra, times(solids.pieces[pa, ROUNDING], n)), n, -1.0)
    _write_lever(rows, k, 6, minus(rb, times(solids.pieces[pb, ROUNDING], n)), n, 1.0)
    bodies, own, J = len(covariance), 0.0, rows.lever
    for j in range(bodies):
        if not joint and j != a and j != b:
            continue
        for r in range(6):
            s = 0.0
            for c in range(6):
                s += covariance[j, b, r, c] * J[k, 6 + c]
                if a < bodies:
                    s += covariance[j, a, r, c] * J[k, c]
            rows.image[k, j, r] = s
            if j == a:
                own += J[k, r] * s
            if j == b:
                own += J[k, 6 + r] * s
    rows.value[k, 0], rows.value[k, 1], rows.value[k, 2] = 0.0, own, 0.0


@inner
def _keep_apart(n, warm, C, Y, solids, metric, rows):
    """Correct the motion of a round so that gaps stay open and depth goes, a stride of it at most.

    The solution of the round before is a first guess if ``warm``. Returns whether anything presses.
    """
    pressed = False
    for k in range(n):
        _fill(k, C, Y, solids, metric.covariance, metric.joint, rows)
        rows.value[k, 0] = C[k, GAP0] - min(C[k, GAP0] + STRIDE, 0.0)
        if warm and rows.value[k, 1] > _FIRM:
            _press(k, C[k, WARM], C, metric, rows)
    _sweep(n, C, metric, rows)
    for k in range(n):
        write(C, k, WARM, (rows.value[k, 2], 0.0, 0.0))
        pressed = pressed or rows.value[k, 2] > 0.0
    return pressed


@inner
def _stop(x, n, C, Y, solids, metric, rows):
    """Take from the velocities of a state what closes contacts of bodies that were moved, as if they touched.

    A mean velocity that certainly closes a contact is that of an impact, and stays.
    """
    J, value = rows.lever, rows.value
    for i in range(len(metric.moves)):
        write(rows.motion, i, 0, three(x, i, V))
        write(rows.motion, i, 3, three(x, i, W))
    for k in range(n):
        _fill(k, C, Y, solids, metric.velocity, metric.joint, rows)
        a, b, expected, moved = int(C[k, BODY_A]), int(C[k, BODY_B]), 0.0, False
        for i, at in ((a, 0), (b, 6)):
            if i < len(metric.moves):
                moved = moved or (metric.moves[i] and _way(i, x, Y)[2] > _SAME)
                for c in range(6):
                    expected += J[k, at + c] * metric.mean[i, c]
        if not moved or C[k, GAP0] > 2.0 * FREE or expected < -_SURE * math.sqrt(value[k, 1]):
            value[k, 1] = 0.0
    _sweep(n, C, metric, rows)
    for i in range(len(metric.moves)):
        if metric.moves[i]:
            write(x, i, V, three(rows.motion, i, 0))
            write(x, i, W, three(rows.motion, i, 3))


@inner
def _sweep(n, C, metric, rows):
    """Correct a motion so that no contact closes by more than its room."""
    value, J, motion = rows.value, rows.lever, rows.motion
    for _ in range(SWEEPS):
        most = 0.0
        for k in range(n):
            s, own = value[k, 0], value[k, 1]
            if own < _FIRM:
                continue
            a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
            for c in range(6):
                s += J[k, 6 + c] * motion[b, c]
                if a < len(motion):
                    s += J[k, c] * motion[a, c]
            d = max(value[k, 2] - s / own, 0.0) - value[k, 2]
            if d != 0.0:
                most = max(most, abs(d) * own)
                _press(k, d, C, metric, rows)
        if most < _EVEN:
            break


@inner
def _press(k, d, C, metric, rows):
    """Add to the multiplier of contact k."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    rows.value[k, 2] += d
    for j in range(len(rows.motion)):
        if metric.joint or j == a or j == b:
            for c in range(6):
                rows.motion[j, c] += d * rows.image[k, j, c]


@inner
def _move(bodies, Y, rows):
    """Move the bodies, by a stride at most, as far as what is near is known; return the longest way."""
    most = 0.0
    for i in range(bodies):
        v, w = three(rows.motion, i, 0), three(rows.motion, i, 3)
        way = math.sqrt(dot(v, v)) + Y[i, RADIUS] * math.sqrt(dot(w, w))
        Y[i, WAY] = 0.0
        if way == 0.0:
            continue
        if way > STRIDE:
            v, w, way = times(STRIDE / way, v), times(STRIDE / way, w), STRIDE
        write(Y, i, CENTRE, plus(three(Y, i, CENTRE), v))
        rotate(Y, i, quaternion(Y, i), w)
        Y[i, WAY] = way + SLOP
        Y[i, TRAVEL] += Y[i, WAY]
        most = max(most, way)
    return most


@inner
def _remember(n, C, Y, search):
    """Note the contacts of a round, whose normals the next one begins with."""
    pairs = search.pairs
    for k in range(n):
        a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
        C[k, SINCE], C[k, MODE] = Y[a, WAY] + Y[b, WAY], 0.0  # without motion they are kept
        if pairs[a, b, ROWS] == 0:
            pairs[a, b, ROW0] = k
        pairs[a, b, ROWS] += 1
