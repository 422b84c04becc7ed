"""Linearization on the implicit step: a root of the covariance goes through the derivative of each interval.

The derivative is that of the step as it was solved (`derivatives.implicit_derivative`); the times of impacts
depend on the state.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.contact_candidates import partner_sphere
from ..collision.contact_row import AXIS, DIRECTION, GAP, MOMENT_I, RESTITUTION
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner, kernel
from ..compiler.arrays import booleans, empty, integers, zeros
from ..derivatives.flight_derivative import Errors
from ..derivatives.implicit_derivative import (
    ContactErrors,
    fly_group_errors,
    impact_errors,
    impact_time_errors,
    travel_errors,
)
from ..derivatives.kinematic_derivative import (
    KinematicErrors,
    begin_held_errors,
    end_held_errors,
    place_kinematic_errors,
    travel_kinematic_errors,
)
from ..derivatives.rolling import KEPT, KEPT_COLUMNS, forget_rolling, rolling
from ..derivatives.wrench_derivative import fly_pushed_errors
from ..dynamics.actions import follows
from ..dynamics.impact_time import impact_speed, landing_speed, speed_before, time_before, time_to_close
from ..dynamics.implicit_rollout import rollout_kernel
from ..dynamics.implicit_stages import (
    after_flight,
    after_groups,
    after_impact,
    after_travel,
    before_contact,
    before_flight,
    before_group,
    before_groups,
    before_return,
    before_step,
    before_travel,
    on_sleep,
    undo_step,
)
from ..spatial.layout import ER, ERROR, EV, EW, Q, V, W
from ..spatial.rotation import rotate, rotate_back
from ..spatial.vectors import put, vector

_SAME_PATCH = 0.9  # cosine of the angle between normals
_SAME_NORMAL = 1.0 - 1e-9
#: Contacts beside one that may make a face, and how wide that is at least, of its length.
_FACE, _NARROW = 2, 0.2
_SMOOTH = 1.001  # of a sphere's radius: the largest by which it rolls by itself


class ImplicitLinearization(NamedTuple):
    """State of linearization in a rollout of the implicit step."""

    #: root, before: (12 M, r) float64: now, and when the step began
    root: np.ndarray
    before: np.ndarray
    errors: Errors
    contacts: ContactErrors
    kinematic: KinematicErrors
    #: (B,) float64: first time at which what contacts do was doubtful [s]; infinite if never
    contact_mode_uncertain_since: np.ndarray
    #: (3,) float64: end of the step, the present of the group at hand, and the end of its interval [s]
    time: np.ndarray


class Directions(NamedTuple):
    """Changes of a scene's actions by the r columns of a root, as in `KinematicErrors`."""

    offset: np.ndarray
    center: np.ndarray
    late: np.ndarray


@kernel(noinline=True)
def linearized(source, world, work, contacts):
    """Return what linearization works on, with room for so many contacts.

    ``source`` has the root, the times (B,) since which contact modes are uncertain, `Directions`, and the
    tilts of `rolling`.
    """
    root, uncertain_since, directions, tilts = source
    actions, moving, columns = world.environment.actions, world.bodies.moving, root.shape[1]
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
        zeros((contacts, 12)),
        tilts.copy(),
        zeros((count, KEPT, KEPT_COLUMNS)),
        empty((contacts, 3, 6)),
        integers(count),
        empty((6 * count, 6 * count + columns)),
        booleans(count),
        zeros(columns + 1),
    )
    held = zeros((len(directions.offset), 6, columns))
    kinematic = KinematicErrors(directions.offset, directions.center, directions.late, held)
    return ImplicitLinearization(root, empty(root.shape), errors, room, kinematic, uncertain_since, zeros(3))


#: Advances the nominal state, its memory, and the root in place (`rollout_kernel`).
advance_root = rollout_kernel(linearized)


@before_groups.of(ImplicitLinearization)
def _let_go(method, x, begin, world, work):
    """Store the pose errors of held bodies at the beginning of a step, and release bodies."""
    begin_held_errors(method.root, begin, world, work, method.errors, method.kinematic)


@after_groups.of(ImplicitLinearization)
def _carry_along(method, x, end, world, work):
    """Move the errors of held bodies with their holders at the end of a step."""
    end_held_errors(method.root, x, end, world, work, method.errors, method.kinematic)


@before_step.of(ImplicitLinearization)
def _keep_root(method, x, step, world, work):
    """Keep the root, and forget how bodies roll, so that steps do not depend on those before."""
    forget_rolling(method.contacts.rolled)
    method.time[0] = world.start + (step + 1) * world.dt
    for r in range(method.root.shape[0]):
        for c in range(method.root.shape[1]):
            method.before[r, c] = method.root[r, c]


@undo_step.of(ImplicitLinearization)
def _put_root_back(method, work):
    """Restore the root of the beginning of the step."""
    for r in range(method.root.shape[0]):
        for c in range(method.root.shape[1]):
            method.root[r, c] = method.before[r, c]


@on_sleep.of(ImplicitLinearization)
def _rest(method, i, work):
    """Give a sleeping body certain zero velocities."""
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
    """Copy body i's errors to the root, with the rotation about body axes."""
    root, first = method.root, ERROR * method.errors.block[i]
    for c in range(root.shape[1]):
        for k in range(ERROR):
            root[first + k, c] = errors[first + k, c]
        t = vector(errors, first + ER, c)
        put(root, first + ER, c, rotate_back(R, t[0], t[1], t[2]))


@before_flight.of(ImplicitLinearization)
def _fly(method, x, i, world, work):
    """Take a body's errors through a whole step of free flight."""
    errors = method.errors
    for c in range(len(errors.length)):
        errors.length[c] = errors.left[c] = 0.0
    _open(method, i, work)
    v, w = (x[i, V], x[i, V + 1], x[i, V + 2]), (x[i, W], x[i, W + 1], x[i, W + 2])
    q = (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3])
    fly_pushed_errors(v, w, q, i, world.dt, method.time[0], world.decay, world, errors)


@after_flight.of(ImplicitLinearization)
def _end_flight(method, x, i, world, work):
    """Copy body i's errors back with the new orientation."""
    _close(method, method.errors.end, i, work.R[i])


@before_group.of(ImplicitLinearization)
def _begin_group(method, count, world, work):
    """Reset the time: the whole step remains, for every state of the belief."""
    method.time[1] = method.time[0] - world.dt
    for c in range(len(method.errors.left)):
        method.errors.left[c] = 0.0


@before_travel.of(ImplicitLinearization)
def _begin_travel(method, x, count, until, left, threshold, world, work):
    """Find out how the interval's length changes, and keep what it will be differentiated with."""
    errors, contacts, rows = method.errors, method.contacts, work.rows
    method.time[2] = method.time[0] - left + until
    for a in range(count):
        _open(method, work.members[a], work)
    _place_kinematic(method, errors.begin, x, count, world, work)
    first, nearest = -1, np.inf
    for c in range(len(errors.length)):
        errors.length[c] = 0.0
    for c in range(work.counts[CONTACTS]):
        if until < left:
            speed = speed_before(c, START, 0.0, threshold, world, work)
            slowest = landing_speed(world.dt, threshold)
            closing = min(impact_speed(rows[c, RESTITUTION], threshold), slowest)
            miss = abs(time_to_close(rows[c], speed, closing) - until)
            if miss < nearest:
                first, nearest = c, miss
    if first >= 0:
        look_at_surfaces(first, False, contacts, world, work)
        v = work.velocity[START]
        impact_time_errors(x, first, until, v, errors.begin, world, work, errors, contacts.surface[first])
        for c in range(len(errors.left)):
            errors.left[c] -= errors.length[c]
    else:
        for c in range(len(errors.left)):
            errors.length[c], errors.left[c] = errors.left[c], 0.0


@before_return.of(ImplicitLinearization)
def _shorten_travel(method, x, count, first, until, left, meets, threshold, world, work):
    """Find out how the interval's length changes that what was found at its end makes shorter."""
    errors, contacts, v = method.errors, method.contacts, work.velocity[FREE]
    if not meets:
        for c in range(len(errors.left)):
            errors.left[c] += errors.length[c]
            errors.length[c] = 0.0
        method.time[2] = method.time[0] - left + first
        return
    fly_group_errors(count, until, method.time[2], world, work, errors)
    method.time[1] = method.time[2]
    _place_kinematic(method, errors.end, x, count, world, work)
    method.time[1] = method.time[0] - left
    nearest, closest = -1, np.inf
    for c in range(work.counts[CONTACTS]):
        miss = abs(time_before(c, until, threshold, world, work) - first)
        if miss < closest:
            nearest, closest = c, miss
    look_at_surfaces(nearest, False, contacts, world, work)
    surface = contacts.surface[nearest]
    for c in range(len(errors.left)):
        errors.left[c] += errors.length[c]
    impact_time_errors(x, nearest, first - until, v, errors.end, world, work, errors, surface)
    for c in range(len(errors.left)):
        errors.left[c] -= errors.length[c]
    method.time[2] = method.time[0] - left + first


@before_contact.of(ImplicitLinearization)
def _find_surfaces(method, x, count, world, work):
    """Keep what the lasting contacts will be differentiated with."""
    for c in range(work.counts[CONTACTS]):
        method.contacts.gap[c] = work.rows[c, GAP]
        look_at_surfaces(c, True, method.contacts, world, work)


@inner
def _place_kinematic(method, rows, x, count, world, work):
    """Write the errors that kinematic bodies have at present into ``rows``."""
    if len(world.environment.actions.kinematic) > 0:
        place_kinematic_errors(rows, x, count, method.time[1], world, work, method.errors, method.kinematic)


@inner(noinline=True)
def look_at_surfaces(c, in_order, contacts, world, work):
    """Find out what surfaces the spheres of a contact stand for (`ContactErrors.surface`).

    ``in_order`` says that this was done for the contact before it, which may have the same.

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
    out[11] = row[GAP]
    if in_order and c > 0 and ids[c - 1, 0] == i and ids[c - 1, 1] == j:
        if _same_normal(row, work.rows[c - 1]) > _SAME_NORMAL:
            for m in range(10):
                out[m] = contacts.surface[c - 1, m]
            out[11] = contacts.surface[c - 1, 11]
            return
    for m in range(10):
        out[m] = 0.0
    if others >= _FACE and _covers_an_area(c, work):
        return
    n = (row[DIRECTION], row[DIRECTION + 1], row[DIRECTION + 2])
    first = (row[AXIS], row[AXIS + 1], row[AXIS + 2])
    second = (row[2 * AXIS], row[2 * AXIS + 1], row[2 * AXIS + 2])
    rolling(n, first, second, i, ids[c, 2], work.R[i], world, contacts.tilts, contacts.rolled, out[0:5])
    if j < 0 and not _is_bumpy(c, out[0] + out[2], world, work):
        for m in range(5):
            out[m] = 0.0
    if j >= 0:
        n = (-n[0], -n[1], -n[2])
        b = partner_sphere(ids[c, 3], world.tree.radii)
        rolling(n, first, second, j, b, work.R[j], world, contacts.tilts, contacts.rolled, out[5:10])


@inner
def _is_bumpy(c, radius, world, work):
    """Whether the shape by which a body rolls has a larger radius than a sphere that touches where contact
    ``c`` does: else it rolls on its spheres.
    """
    ids, found = work.ids, False
    for k in range(work.counts[CONTACTS]):
        if ids[k, 0] == ids[c, 0] and ids[k, 1] == ids[c, 1]:
            found = found or radius > _SMOOTH * world.tree.radii[ids[k, 2]]
    return found


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
    """Return the vector from contact c to contact k, across the normal and turned by a right angle [m]."""
    return (
        rows[k, MOMENT_I] - rows[c, MOMENT_I],
        rows[k, MOMENT_I + 1] - rows[c, MOMENT_I + 1],
        rows[k, MOMENT_I + 2] - rows[c, MOMENT_I + 2],
    )


@inner(forceinline=True)
def _same_normal(a, b):
    """Return the cosine of the angle between two contacts' normals."""
    total = 0.0
    for m in range(3):
        total += a[DIRECTION + m] * b[DIRECTION + m]
    return total


@after_travel.of(ImplicitLinearization)
def _end_travel(method, x, count, h, world, work):
    """Take the group's errors through the interval."""
    method.time[1] = method.time[2]
    _place_kinematic(method, method.errors.end, x, count, world, work)
    if len(world.environment.actions.kinematic) > 0:
        travel_kinematic_errors(count, h, world, work, method.errors)
    travel_errors(count, h, method.time[1], world, work, method.errors, method.contacts)
    for a in range(count):
        i = work.members[a]
        _close(method, method.errors.end, i, work.R[i])
        _note_uncertain_mode(method, i)


@inner(forceinline=True)
def _note_uncertain_mode(method, i):
    """Record when the contact mode of body i first was uncertain."""
    if method.contacts.doubtful[i]:
        method.contact_mode_uncertain_since[i] = min(method.contact_mode_uncertain_since[i], method.time[0])


@after_impact.of(ImplicitLinearization)
def _end_impact(method, x, count, threshold, world, work):
    """Take the group's errors through an impact."""
    for c in range(work.counts[CONTACTS]):
        look_at_surfaces(c, True, method.contacts, world, work)
    for a in range(count):
        _open(method, work.members[a], work)
    for rows in (method.errors.begin, method.errors.end):
        _place_kinematic(method, rows, x, count, world, work)
    impact_errors(x, count, threshold, world, work, method.errors, method.contacts)
    for a in range(count):
        i = work.members[a]
        _close(method, method.errors.begin, i, work.R[i])
        _note_uncertain_mode(method, i)
