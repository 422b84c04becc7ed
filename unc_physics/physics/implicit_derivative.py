"""Derivative of the implicit step's intervals, contacts held as they were solved.

With ``u = v_i + w_i x a_i - v_j - w_j x a_j`` the relative velocity at a contact, n its normal and f its
impulse, the interval's end obeys, for each body of mass m and inertia ``I`` in world axes,

    m (v' - v*) = sum f,   I (w' - w*) = sum a x f

Its derivative is a linear system in ``dv', dw'``: f changes by ``B du' + b`` where, by what the contact does,

    lasting:   d lambda_n = dh kappa pi R d^2 + K (-dg - dh (s + s') / 2 - h ds / 2 - ... - (h / 2 + tau) ds')
               with K = 2 h kappa pi R d, s = n . u, g the gap and tau the damping time
    impact:    ds' = (s' / s) ds, a constraint; 0 where nothing rebounds
    sticking:  the slip of u' stays zero, a constraint
    sliding:   f_t = -mu lambda_n t, t the direction of slip, which turns with it

The geometry changes too (``contact_change``): normals and lever arms in u and f, and the inertia that turns
with the body. Constraints are springs so stiff that they move by `_YIELDING` of what they would without.
Contacts without load stay so.
"""

import math
from typing import NamedTuple

import numpy as np

from .compiled import inner
from .contact_change import (
    bend_change,
    contact_change,
    contact_geometry,
    error_velocity,
    point_velocity,
    turning,
)
from .contact_model import shallow_factor
from .contact_patch import IMPACT_GAP
from .contact_row import BEND, COMPLIANCE, DAMPING_TIME, FALL, FRICTION, GAP, RADIUS, SLIP_COMPLIANCE
from .contact_system import add_answer, add_force, eliminate
from .flight_derivative import in_world, mean_spin, turn_coefficients, turned_on
from .implicit_workspace import CONTACTS, ELASTIC, FREE, LASTING, NOW, START, START_POSITION, START_QUATERNION
from .layout import EP, ER, ERROR, EV, EW
from .rotation import cross, write_matrix
from .twist_derivative import add_twist, no_twist, surface_change, surface_velocity, twist_change, twist_of
from .vectors import dot, minus, plus, put, three, times, vector
from .wrench_derivative import fly_pushed_errors

_YIELDING = 1e-7  # of what a constraint holds
_AT_LIMIT = 1.0 - 1e-9  # of what friction can hold: contacts at more than this slide
_NO_SLIP = 1e-12  # what slides as slowly has no direction [m/s]


class ContactErrors(NamedTuple):
    """Room for the derivative of a group's contacts.

    Attributes
    ----------
    gap : (C,) float64
        Gaps of the contacts at hand when they were found [m].
    surface : (C, 11) float64
        What is known of the surfaces at each contact (`contact_change.contact_geometry`).
    tilts : float64 array
        A copy of `rolling.TILTS`.
    slot : (B,) int64
        Which six of the system's unknowns are each body's velocities; -1 for none.
    system : (6 B, 6 B + r) float64
        The linear system, the right-hand sides beside it.
    doubtful : (B,) bool
        Whether contacts of each body would have done something else within a standard deviation: opened, not
        closed, or not closed together in an impact.
    first_gap : (r,) float64
        Changes of the gap of an impact's first contact [m].
    """

    gap: np.ndarray
    surface: np.ndarray
    tilts: np.ndarray
    slot: np.ndarray
    system: np.ndarray
    doubtful: np.ndarray
    first_gap: np.ndarray


@inner(forceinline=True)
def relative_velocity(v, i, j, arm_i, arm_j):
    """Velocity of body i's point relative to its partner's, from rows of velocities."""
    u = point_velocity(v, i, arm_i)
    return minus(u, point_velocity(v, j, arm_j)) if j >= 0 else u


@inner(forceinline=True)
def _turning(v, i, j, change):
    """What changed lever arms do to `relative_velocity`."""
    u = turning(v, i, change.arm_i)
    return minus(u, turning(v, j, change.arm_j)) if j >= 0 else u


@inner(forceinline=True)
def _first(errors, j):
    """Where the block of body j begins, or of an element: that of zeros."""
    return ERROR * errors.block[j] if j >= 0 else errors.begin.shape[0] - ERROR


@inner
def _bend_change(g, change, v, i, j, errors, first_i, first_j, c):
    """Change of a contact's centripetal acceleration."""
    w, dw = (v[i, 3], v[i, 4], v[i, 5]), vector(errors, first_i + EW, c)
    total = bend_change(g.n, w, g.center_i, change.n, dw, change.center_i)
    if j >= 0:
        w, dw = (v[j, 3], v[j, 4], v[j, 5]), vector(errors, first_j + EW, c)
        total -= bend_change(g.n, w, g.center_j, change.n, dw, change.center_j)
    return total


@inner(error_model="numpy")
def impact_time_errors(x, c, time, world, work, errors, surface_of):
    """Write how the time until contact ``c`` closes changes (`Errors.length`)."""
    row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
    v, begin = work.velocity[START], errors.begin
    g = contact_geometry(row, work.ids[c], row[GAP], surface_of, (x[i, 0], x[i, 1], x[i, 2]), world, work)
    first_i, first_j = ERROR * errors.block[i], _first(errors, j)
    u = relative_velocity(v, i, j, g.arm_i, g.arm_j)
    weighs = j < 0 or not work.moving[j]
    slope = dot(g.n, u) + row[FALL] * time
    for k in range(begin.shape[1]):
        change = contact_change(g, begin, first_i, first_j, k)
        du = minus(error_velocity(begin, first_i, g.arm_i, k), error_velocity(begin, first_j, g.arm_j, k))
        du = plus(du, _turning(v, i, j, change))
        fall = _bend_change(g, change, v, i, j, begin, first_i, first_j, k)
        if weighs:
            n, a = change.n, world.gravity
            fall += n[0] * a[0] + n[1] * a[1] + n[2] * a[2]
        speed = dot(g.n, du) + dot(change.n, u)
        errors.length[k] = -(change.gap + speed * time + 0.5 * fall * time * time) / slope


@inner
def travel_errors(count, h, time, world, work, errors, contacts):
    """Take the errors of the group at hand through an interval that was solved, until ``time``, to
    `Errors.end`.

    ``work.R`` is that of the interval's end.
    """
    numbers, velocity = work.numbers, work.velocity
    decay = world.decay if h == world.dt else world.decay ** (h / world.dt)
    size = 0
    for a in range(count):
        i = work.members[a]
        v = (velocity[START, i, 0], velocity[START, i, 1], velocity[START, i, 2])
        w = (velocity[START, i, 3], velocity[START, i, 4], velocity[START, i, 5])
        k = START_QUATERNION
        q = (numbers[i, k], numbers[i, k + 1], numbers[i, k + 2], numbers[i, k + 3])
        fly_pushed_errors(v, w, q, i, h, time, decay, world, errors)
        contacts.slot[i] = -1
        if work.loaded[i] > 0:
            contacts.slot[i] = size
            size += 6
    if size == 0:
        return
    solve_errors(count, size, LASTING, h, 0.0, world, work, errors, contacts)
    begin, end, solved = errors.begin, errors.end, contacts.system
    for a in range(count):
        i = work.members[a]
        place = contacts.slot[i]
        if place < 0:
            continue
        first = ERROR * errors.block[i]
        middle = mean_spin(i, velocity)
        phi = times(h, middle)
        coefficients = turn_coefficients(phi)
        for c in range(begin.shape[1]):
            dh, column = errors.length[c], size + c
            dv, dw = vector(solved, place, column), vector(solved, place + 3, column)
            for k in range(3):
                end[first + EP + k, c] = (
                    begin[first + EP + k, c]
                    + 0.5 * h * (begin[first + EV + k, c] + dv[k])
                    + 0.5 * dh * (velocity[START, i, k] + velocity[NOW, i, k])
                )
            delta = plus(times(0.5 * h, plus(vector(begin, first + EW, c), dw)), times(dh, middle))
            put(end, first + ER, c, turned_on(vector(begin, first + ER, c), delta, phi, coefficients))
            put(end, first + EV, c, dv)
            put(end, first + EW, c, dw)


@inner
def impact_errors(x, count, threshold, world, work, errors, contacts):
    """Take the errors of the group at hand through an impact, in place of `Errors.begin`."""
    begin, end, size = errors.begin, errors.end, 0
    for a in range(count):
        i = work.members[a]
        contacts.slot[i] = -1
        if work.part[i] > 0:
            contacts.slot[i] = size
            size += 6
            first = ERROR * errors.block[i]
            for c in range(begin.shape[1]):
                for k in range(ERROR):
                    end[first + k, c] = begin[first + k, c]
            for k in range(3):
                work.numbers[i, START_POSITION + k] = x[i, k]
            for k in range(4):
                work.numbers[i, START_QUATERNION + k] = x[i, 6 + k]
    for c in range(work.counts[CONTACTS]):
        contacts.gap[c] = work.rows[c, GAP]
    solve_errors(count, size, ELASTIC, 0.0, threshold, world, work, errors, contacts)
    for a in range(count):
        i = work.members[a]
        place = contacts.slot[i]
        if place < 0:
            continue
        first = ERROR * errors.block[i]
        for c in range(begin.shape[1]):
            put(begin, first + EV, c, vector(contacts.system, place, size + c))
            put(begin, first + EW, c, vector(contacts.system, place + 3, size + c))


@inner
def solve_errors(count, size, law, h, threshold, world, work, errors, contacts):
    """Solve for the errors of the velocities at an interval's end, or after an impact.

    They are in the system's columns from ``size`` on, each body's at its slot.
    """
    A, columns = contacts.system, errors.begin.shape[1]
    for r in range(size):
        for c in range(size + columns):
            A[r, c] = 0.0
    for a in range(count):
        i = work.members[a]
        if contacts.slot[i] >= 0:
            _add_inertia(i, contacts.slot[i], size, law, world, work, errors, A)
    contacts.first_gap[0] = math.inf
    for c in range(work.counts[CONTACTS]):
        if work.impulses[law, c, 0] > 0.0:
            _add_contact(c, size, law, h, threshold, world, work, errors, contacts)
    eliminate(A, size, size + columns)


@inner
def _add_inertia(i, place, size, law, world, work, errors, A):
    """A body's mass and inertia, and what it would do without contacts."""
    numbers, v, R = work.numbers, work.velocity, errors.R
    inertia, mass, first = world.bodies.inertia[i], world.bodies.mass[i], ERROR * errors.block[i]
    k = START_QUATERNION
    write_matrix((numbers[i, k], numbers[i, k + 1], numbers[i, k + 2], numbers[i, k + 3]), R, 0)
    for k in range(3):
        A[place + k, place + k] = mass
    for k in range(3):
        column = in_world(R[0], inertia, (1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)))
        for r in range(3):
            A[place + 3 + r, place + 3 + k] = column[r]
    before = FREE if law == LASTING else START
    kicked = (v[NOW, i, 3] - v[before, i, 3], v[NOW, i, 4] - v[before, i, 4], v[NOW, i, 5] - v[before, i, 5])
    tau = in_world(R[0], inertia, kicked)
    for c in range(errors.begin.shape[1]):
        t = vector(errors.begin, first + ER, c)
        for k in range(3):
            A[place + k, size + c] = mass * errors.end[first + EV + k, c]
        # w' - w* is I^-1 tau, and I turns with the body
        a = in_world(R[0], inertia, plus(vector(errors.end, first + EW, c), cross(t, kicked)))
        put(A, place + 3, size + c, minus(a, cross(t, tau)))


@inner(error_model="numpy")
def _add_contact(c, size, law, h, threshold, world, work, errors, contacts):
    """A loaded contact's ``B`` and ``b`` (module), into both bodies' rows."""
    row, ids, own, velocity = work.rows[c], work.ids[c], work.impulses[law, c], work.velocity
    i, j, gap, begin = ids[0], ids[1], contacts.gap[c], errors.begin
    numbers, after, before = work.numbers, velocity[NOW], velocity[START]
    position = (numbers[i, START_POSITION], numbers[i, START_POSITION + 1], numbers[i, START_POSITION + 2])
    g = contact_geometry(row, ids, gap, contacts.surface[c], position, world, work)
    n = g.n
    f_t = plus(times(own[1], g.first), times(own[2], g.second))
    f = plus(times(own[0], n), f_t)
    u = relative_velocity(after, i, j, g.arm_i, g.arm_j)
    u_before = relative_velocity(before, i, j, g.arm_i, g.arm_j)
    speed, speed_before = dot(n, u), dot(n, u_before)
    # normal impulse: d lambda = known - yield ds'
    way = square = stiff = closing = depth = 0.0
    if law == LASTING:
        way = 0.5 * h + row[DAMPING_TIME]
        factor = shallow_factor(world.stiffness) * row[RADIUS]
        depth = math.sqrt(own[0] / (h * factor))
        square = factor * depth * depth
        stiff = 2.0 * h * factor * depth
        give = stiff * way
    else:
        give = 1.0 / (_YIELDING * row[COMPLIANCE])
        closing = speed / speed_before if speed_before < -threshold else 0.0
    # friction
    mu, limit = row[FRICTION], row[FRICTION] * own[0]
    size_t = math.sqrt(dot(f_t, f_t))
    slides, sticks, hold, along = False, False, 0.0, (0.0, 0.0, 0.0)
    moves = j < 0 and len(world.surroundings.actions.surface) > 0
    drift = (0.0, 0.0, 0.0)
    if moves:
        drift = surface_velocity(world.surroundings.actions.surface[-1 - j], position, g.arm_i)
    u_s = minus(u, drift)  # what friction opposes, but for what of it is along the normal
    lift = dot(n, u_s)
    u_t = minus(u_s, times(lift, n))
    if mu > 0.0:
        slides = size_t >= _AT_LIMIT * limit and dot(u_t, u_t) > _NO_SLIP * _NO_SLIP
        sticks = not slides
    if slides:
        along = times(-1.0 / size_t, f_t)
        hold = limit / math.sqrt(dot(u_t, u_t))
    elif sticks:
        hold = 1.0 / (_YIELDING * row[SLIP_COMPLIANCE])
    # direction of the whole impulse's change with lambda
    pushed = minus(n, times(mu, along)) if slides else n
    slot_i = contacts.slot[i]
    slot_j = contacts.slot[j] if j >= 0 and work.moving[j] else -1
    A, twists = contacts.system, len(work.twists) > 0
    spinning = minus(three(after, i, 3), three(after, j, 3)) if j >= 0 else three(after, i, 3)
    twist = no_twist()
    if twists:
        twist = twist_of(work.twists[c], own, n, spinning, _YIELDING, _AT_LIMIT, _NO_SLIP)
        add_twist(twist, n, give, g.arm_i, g.arm_j, slot_i, slot_j, A)
    for k in range(3):  # columns of B, one of which is the answer to a unit change of u'
        unit = (1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2))
        B_i = _answer(unit, n, pushed, along, give, hold)
        turn_i = cross(g.arm_i, unit)  # of u' with w: unit . (w x arm) = w . (arm x unit)
        turn_j = cross(g.arm_j, unit)
        add_answer(A, slot_i, slot_i, slot_j, k, -1.0, g.arm_i, B_i, turn_i, turn_j)
        if slot_j >= 0:
            add_answer(A, slot_j, slot_i, slot_j, k, 1.0, g.arm_j, B_i, turn_i, turn_j)
    first_i, first_j = ERROR * errors.block[i], _first(errors, j)
    begins = law != LASTING and contacts.first_gap[0] == math.inf
    graze = 0.0  # variance of the closing speed
    wide = 0.0  # variance of what decides whether it acts, and when
    clipped = law == LASTING and row[GAP] > gap
    for k in range(begin.shape[1]):
        change = contact_change(g, begin, first_i, first_j, k)
        dn = change.n
        if begins:
            contacts.first_gap[k] = change.gap
        wide += (change.gap if law == LASTING else change.gap - contacts.first_gap[k]) ** 2
        known, turned = _turning(after, i, j, change), (0.0, 0.0, 0.0)
        if j >= 0 and slot_j < 0:  # what is fixed or driven has known errors at the end, too
            known = minus(known, error_velocity(errors.end, first_j, g.arm_j, k))
            turned = vector(errors.end, first_j + EW, k)
        slip = known
        if moves:
            at = plus(vector(begin, first_i + EP, k), change.arm_i)
            slip = minus(known, surface_change(world.surroundings.actions.surface[-1 - j], at))
        # n . du' has dn . u' beside it
        push = -give * dot(dn, u)
        if law == LASTING:
            du = minus(error_velocity(begin, first_i, g.arm_i, k), error_velocity(begin, first_j, g.arm_j, k))
            du = plus(du, _turning(before, i, j, change))
            dh = errors.length[k]
            bend = _bend_change(g, change, before, i, j, begin, first_i, first_j, k)
            deeper = -0.5 * dh * (speed_before + speed) - 0.5 * h * (dot(n, du) + dot(dn, u_before))
            deeper -= h * dh * row[BEND] + 0.5 * h * h * bend
            if not clipped:
                deeper -= change.gap
            push += dh * square + stiff * deeper
        elif closing != 0.0:
            du = minus(error_velocity(begin, first_i, g.arm_i, k), error_velocity(begin, first_j, g.arm_j, k))
            du = plus(du, _turning(before, i, j, change))
            faster = dot(n, du) + dot(dn, u_before)
            push += give * closing * faster
            graze += faster * faster
        answer = _answer(slip, n, (0.0, 0.0, 0.0), along, 0.0, hold)
        push -= give * dot(n, known)
        b = plus(times(push, pushed), answer)
        b = plus(b, times(own[0], dn))
        # what stays of the friction force turns with the normal
        tilted = dot(f_t, dn)
        if slides:
            b = plus(b, times(hold, minus(times(lift, dn), times(dot(along, dn) * lift, along))))
            b = plus(b, times(hold * dot(dn, u_t), n))
        else:
            b = minus(b, times(tilted, n))
            b = plus(b, times(hold * lift, dn))
        extra = twist_change(twist, n, dn, push, turned) if twists else (0.0, 0.0, 0.0)
        moment = plus(plus(cross(g.arm_i, b), cross(change.arm_i, f)), extra)
        add_force(A, slot_i, size + k, 1.0, b, moment)
        if slot_j >= 0:
            moment = plus(plus(cross(g.arm_j, b), cross(change.arm_j, f)), extra)
            add_force(A, slot_j, size + k, -1.0, b, moment)
    if wide > (depth if law == LASTING else IMPACT_GAP) ** 2 or graze > speed_before * speed_before:
        contacts.doubtful[i] = True
        if slot_j >= 0:
            contacts.doubtful[j] = True


@inner(forceinline=True)
def _answer(u, n, pushed, along, give, hold):
    """``B u``: what a change of the relative velocity makes of the impulse."""
    s = dot(n, u)
    across = minus(u, times(s, n))
    across = minus(across, times(dot(along, across), along))
    return minus(times(-give * s, pushed), times(hold, across))
