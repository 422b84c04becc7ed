"""Linearization on the implicit step: a root of the covariance goes through the derivative of each interval.

The derivative is that of the step as it was solved (`physics.implicit_derivative`), its impacts at times that
depend on the state.
"""

import math
from typing import NamedTuple

import numpy as np

from ..physics.actions import follows
from ..physics.arrays import booleans, empty, integers, zeros
from ..physics.compiled import inner, kernel
from ..physics.contact_row import AXIS, DIRECTION, GAP, MOMENT_I
from ..physics.driven_derivative import (
    DrivenErrors,
    begin_held_errors,
    end_held_errors,
    place_driven_errors,
    travel_driven_errors,
)
from ..physics.flight_derivative import Errors
from ..physics.impact_time import time_to_close
from ..physics.implicit_derivative import ContactErrors, impact_errors, impact_time_errors, travel_errors
from ..physics.implicit_solver import contact_speed
from ..physics.implicit_stages import (
    after_flight,
    after_groups,
    after_impact,
    after_travel,
    before_flight,
    before_group,
    before_groups,
    before_step,
    before_travel,
    on_sleep,
    undo_step,
)
from ..physics.implicit_step import integrate
from ..physics.implicit_workspace import CONTACTS, START, implicit_workspace, more_room
from ..physics.layout import ER, ERROR, EV, EW, Q, V, W
from ..physics.rolling import rolling
from ..physics.rotation import rotate, rotate_back
from ..physics.vectors import put, vector
from ..physics.wrench_derivative import fly_pushed_errors

_SAME_PATCH = 0.9  # cosine of the angle between normals
_SAME_NORMAL = 1.0 - 1e-9
#: Contacts beside one that may make a face, and how wide that is at least, of its length.
_FACE, _NARROW = 2, 0.2


class Linearized(NamedTuple):
    """What linearization works on in a rollout of the implicit step.

    Attributes
    ----------
    root, before : (12 M, r) float64
        Now, and when the step began.
    errors : Errors
    contacts : ContactErrors
    driven : DrivenErrors
    doubtful_since : (B,) float64
        First time at which what contacts do was doubtful [s]; infinite if never.
    time : (3,) float64
        End of the step, the present of the group at hand, and the end of its interval [s].
    """

    root: np.ndarray
    before: np.ndarray
    errors: Errors
    contacts: ContactErrors
    driven: DrivenErrors
    doubtful_since: np.ndarray
    time: np.ndarray


class Directions(NamedTuple):
    """What the r columns of a root change of a scene's actions, as `DrivenErrors` takes it."""

    offset: np.ndarray
    center: np.ndarray
    late: np.ndarray


@kernel(apart=True)
def linearized(root, doubtful_since, directions, world, contacts, tilts):
    """What linearization works on (`Linearized`), with room for so many contacts."""
    actions, moving, columns = world.surroundings.actions, world.bodies.moving, root.shape[1]
    count, own = len(moving), len(root) // ERROR
    paths = 0
    for j in range(count):
        if follows(j, actions):
            paths += 1
    block = np.where(moving, np.cumsum(moving) - 1, own + paths)
    place = own
    for j in range(count):
        if follows(j, actions):
            block[j] = place
            place += 1
    rows = ERROR * (own + paths + 1)
    errors = Errors(
        zeros((rows, columns)),
        zeros((rows, columns)),
        block,
        zeros(columns),
        zeros(columns),
        empty((3, columns)),
        empty((6, columns)),
        empty((1, 3, 3)),
    )
    room = ContactErrors(
        empty(contacts),
        zeros((contacts, 11)),
        tilts.copy(),
        integers(count),
        empty((6 * count, 6 * count + columns)),
        booleans(count),
        zeros(columns + 1),
    )
    held = zeros((len(directions.offset), 6, columns))
    driven = DrivenErrors(directions.offset, directions.center, directions.late, held)
    return Linearized(root, empty(root.shape), errors, room, driven, doubtful_since, zeros(3))


@kernel
def advance_root(mean, root, doubtful_since, directions, first_time, memory, world, begin, steps, tilts):
    """Advance the nominal state (B, 13), its memory, and the root in place, by implicit steps."""
    contacts, candidates, pool = 64, 256, 2048
    done = 0
    while done < steps:
        work = implicit_workspace(mean, memory.kept_overlap[0], world, contacts, candidates, pool)
        method = linearized(root, doubtful_since, directions, world, contacts, tilts)
        done += integrate(
            mean,
            first_time,
            memory.contact[0],
            memory.force[0],
            memory.count,
            memory.quiet[0],
            memory.residual[0],
            memory.key[0],
            world,
            method,
            begin + done,
            steps - done,
            work,
        )
        contacts, candidates, pool = more_room(work.counts, contacts, candidates, pool)


@before_groups.of(Linearized)
def _let_go(method, x, begin, world, work):
    """Held bodies keep their places, and some are released."""
    begin_held_errors(method.root, begin, world, work, method.errors, method.driven)


@after_groups.of(Linearized)
def _carry_along(method, x, end, world, work):
    """Held bodies moved with what holds them."""
    end_held_errors(method.root, x, end, world, work, method.errors, method.driven)


@before_step.of(Linearized)
def _keep_root(method, x, step, world, work):
    """Keep the root."""
    method.time[0] = (step + 1) * world.dt
    for r in range(method.root.shape[0]):
        for c in range(method.root.shape[1]):
            method.before[r, c] = method.root[r, c]


@undo_step.of(Linearized)
def _put_root_back(method, work):
    """The root is that of the step's beginning."""
    for r in range(method.root.shape[0]):
        for c in range(method.root.shape[1]):
            method.root[r, c] = method.before[r, c]


@on_sleep.of(Linearized)
def _rest(method, i, work):
    """What sleeps has no velocities, for certain."""
    first = ERROR * method.errors.block[i]
    for k in range(3):
        for c in range(method.root.shape[1]):
            method.root[first + EV + k, c] = method.root[first + EW + k, c] = 0.0


@inner
def _open(method, i, work):
    """Copy body i's errors to `Errors.begin`, its rotation's about world axes; ``work.R`` is the present."""
    root, begin, first = method.root, method.errors.begin, ERROR * method.errors.block[i]
    for c in range(root.shape[1]):
        for k in range(ERROR):
            begin[first + k, c] = root[first + k, c]
        t = vector(root, first + ER, c)
        put(begin, first + ER, c, rotate(work.R[i], t[0], t[1], t[2]))


@inner
def _close(method, errors, i, R):
    """Copy body i's errors back."""
    root, first = method.root, ERROR * method.errors.block[i]
    for c in range(root.shape[1]):
        for k in range(ERROR):
            root[first + k, c] = errors[first + k, c]
        t = vector(errors, first + ER, c)
        put(root, first + ER, c, rotate_back(R, t[0], t[1], t[2]))


@before_flight.of(Linearized)
def _fly(method, x, i, world, work):
    """Take a body's errors through a whole step of free flight."""
    errors = method.errors
    for c in range(len(errors.length)):
        errors.length[c] = errors.left[c] = 0.0
    _open(method, i, work)
    v, w = (x[i, V], x[i, V + 1], x[i, V + 2]), (x[i, W], x[i, W + 1], x[i, W + 2])
    q = (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3])
    fly_pushed_errors(v, w, q, i, world.dt, method.time[0], world.decay, world, errors)


@after_flight.of(Linearized)
def _end_flight(method, x, i, world, work):
    """It has turned."""
    _close(method, method.errors.end, i, work.R[i])


@before_group.of(Linearized)
def _begin_group(method, count, world, work):
    """The whole step is left, whatever the state."""
    method.time[1] = method.time[0] - world.dt
    for c in range(len(method.errors.left)):
        method.errors.left[c] = 0.0


@before_travel.of(Linearized)
def _begin_travel(method, x, count, until, left, threshold, world, work):
    """Find out how the interval's length changes, and keep what it will be differentiated with."""
    errors, contacts, rows, ids = method.errors, method.contacts, work.rows, work.ids
    method.time[2] = method.time[0] - left + until
    for a in range(count):
        _open(method, work.members[a], work)
    _place_driven(method, errors.begin, x, count, world, work)
    first, nearest = -1, np.inf
    for c in range(work.counts[CONTACTS]):
        contacts.gap[c] = rows[c, GAP]
        look_at_surfaces(c, contacts, world, work)
        if until < left:
            speed = contact_speed(rows[c], 0, work.velocity[START], ids[c, 0], ids[c, 1])
            miss = abs(time_to_close(rows[c], speed, threshold) - until)
            if miss < nearest:
                first, nearest = c, miss
    if first >= 0:
        impact_time_errors(x, first, until, world, work, errors, contacts.surface[first])
        for c in range(len(errors.left)):
            errors.left[c] -= errors.length[c]
    else:
        for c in range(len(errors.left)):
            errors.length[c], errors.left[c] = errors.left[c], 0.0


@inner
def _place_driven(method, rows, x, count, world, work):
    """Write the errors that driven bodies have at present into ``rows``."""
    if len(world.surroundings.actions.driven) > 0:
        place_driven_errors(rows, x, count, method.time[1], world, work, method.errors, method.driven)


@inner
def look_at_surfaces(c, contacts, world, work):
    """Find out what surfaces the spheres of a contact stand for (`ContactErrors.surface`).

    Where others of the same two bear beside it, with nearly the same normal, the normal of all is that of
    faces, and not that of single spheres.
    """
    out, row, ids = contacts.surface[c], work.rows[c], work.ids
    i, j = ids[c, 0], ids[c, 1]
    out[10] = 0.0
    others = 0
    for k in range(work.counts[CONTACTS]):
        if k != c and ids[k, 0] == i and ids[k, 1] == j and _same_normal(row, work.rows[k]) > _SAME_PATCH:
            others += 1
    if j >= 0 and others > 0:
        out[10] = 1.0
    if c > 0 and ids[c - 1, 0] == i and ids[c - 1, 1] == j:
        if _same_normal(row, work.rows[c - 1]) > _SAME_NORMAL:
            for m in range(10):
                out[m] = contacts.surface[c - 1, m]
            return
    for m in range(10):
        out[m] = 0.0
    if others >= _FACE and _covers_an_area(c, work):
        return
    n = (row[DIRECTION], row[DIRECTION + 1], row[DIRECTION + 2])
    first = (row[AXIS], row[AXIS + 1], row[AXIS + 2])
    second = (row[2 * AXIS], row[2 * AXIS + 1], row[2 * AXIS + 2])
    rolling(n, first, second, i, ids[c, 2], work.R[i], world, contacts.tilts, out[0:5])
    if j >= 0:
        n = (-n[0], -n[1], -n[2])
        rolling(n, first, second, j, ids[c, 3], work.R[j], world, contacts.tilts, out[5:10])


@inner
def _covers_an_area(c, work):
    """Whether a contact and others of the same two bodies are those of a face, not of an edge or a line."""
    rows, ids, longest, widest, far = work.rows, work.ids, 0.0, 0.0, -1
    for side in range(2):  # the farthest from it, and the farthest from the line through both
        for k in range(work.counts[CONTACTS]):
            if ids[k, 0] != ids[c, 0] or ids[k, 1] != ids[c, 1]:
                continue
            # across the normal, a lever arm is its moment turned by a right angle
            x, y, z = _away(rows, k, c)
            length = math.sqrt(x * x + y * y + z * z)
            if side == 0 and length > longest:
                longest, far = length, k
            elif side == 1 and far >= 0:
                u, v, w = _away(rows, far, c)
                a, b, d = y * w - z * v, z * u - x * w, x * v - y * u
                widest = max(widest, math.sqrt(a * a + b * b + d * d) / longest)
    return widest > _NARROW * longest


@inner(forceinline=True)
def _away(rows, k, c):
    """From contact c to contact k, across the normal and turned by a right angle [m]."""
    return (
        rows[k, MOMENT_I] - rows[c, MOMENT_I],
        rows[k, MOMENT_I + 1] - rows[c, MOMENT_I + 1],
        rows[k, MOMENT_I + 2] - rows[c, MOMENT_I + 2],
    )


@inner(forceinline=True)
def _same_normal(a, b):
    """Cosine of the angle between two contacts' normals."""
    total = 0.0
    for m in range(3):
        total += a[DIRECTION + m] * b[DIRECTION + m]
    return total


@after_travel.of(Linearized)
def _end_travel(method, x, count, h, world, work):
    """Take the group's errors through the interval."""
    method.time[1] = method.time[2]
    _place_driven(method, method.errors.end, x, count, world, work)
    if len(world.surroundings.actions.driven) > 0:
        travel_driven_errors(count, h, world, work, method.errors)
    travel_errors(count, h, method.time[1], world, work, method.errors, method.contacts)
    for a in range(count):
        i = work.members[a]
        _close(method, method.errors.end, i, work.R[i])
        _note_doubt(method, i)


@inner(forceinline=True)
def _note_doubt(method, i):
    """Note when what contacts of body i do was first doubtful."""
    if method.contacts.doubtful[i]:
        method.doubtful_since[i] = min(method.doubtful_since[i], method.time[0])


@after_impact.of(Linearized)
def _end_impact(method, x, count, threshold, world, work):
    """Take the group's errors through an impact."""
    for c in range(work.counts[CONTACTS]):
        look_at_surfaces(c, method.contacts, world, work)
    for a in range(count):
        _open(method, work.members[a], work)
    for rows in (method.errors.begin, method.errors.end):
        _place_driven(method, rows, x, count, world, work)
    impact_errors(x, count, threshold, world, work, method.errors, method.contacts)
    for a in range(count):
        i = work.members[a]
        _close(method, method.errors.begin, i, work.R[i])
        _note_doubt(method, i)
