"""Derivative of the implicit step's intervals, for contacts in their solved states.

Let ``u = v_i + w_i x a_i - v_j - w_j x a_j`` be the relative velocity at a contact, n its normal and f its
impulse. The interval's end obeys, for each body of mass m and inertia ``I`` in world axes,

    m (v' - v*) = sum f,   I (w' - w*) = sum a x f

Its derivative is a linear system in ``dv', dw'``. f changes by ``B du' + b``, which depends on the contact's
state:

    lasting:   d lambda_n = dh kappa pi R d^2 + K (-dg + dh (s* - s') / 2 + h ds* / 2 + tau dr
               - (h / 2 + tau) ds') with K = 2 h kappa pi R d, s' = n . u, s* and g the normal speed and the
               gap without contacts, tau the damping time and r the part of s* that comes from rolling
    impact:    ds' = (s' / s) ds, a constraint; 0 without rebound
    sticking:  the slip of u' stays zero, a constraint
    sliding:   f_t = -limit t, limit = mu lambda_n (`friction.slip_limit`), t the direction of slip, which
               turns with it; in an impact, mu depends on s (`friction.weaken_with_speed`)

The geometry also changes (``contact_change``): normals and lever arms in u and f, and the inertia that
rotates with the body. If f acts in the middle of the interval (``middle_arms``), its lever arm differs from
the one in u. Constraints are stiff springs that yield by `_YIELDING` of the unconstrained motion. Contacts
without load stay open.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.contact_model import shallow_factor
from ..collision.contact_patch import IMPACT_GAP
from ..collision.contact_row import (
    ANCHOR,
    AXIS,
    COMPLIANCE,
    DAMPING_TIME,
    FALL,
    GAP,
    IN_MIDDLE,
    LEAD,
    MOMENT_I,
    PLACES,
    RADIUS,
    RESTITUTION,
    SLIP_COMPLIANCE,
)
from ..collision.implicit_workspace import (
    CONTACTS,
    ELASTIC,
    FREE,
    FREE_POSITION,
    FREE_QUATERNION,
    LASTING,
    NOW,
    START,
    START_QUATERNION,
)
from ..compiler import inner
from ..dynamics.friction import slip_derivative, slip_limit_per_speed
from ..dynamics.impact_time import impact_speed
from ..dynamics.implicit_solver import RECOVERY
from ..dynamics.middle_arms import (
    lever_arm,
    mean_turn,
    no_rolling,
    placed_arm,
    placed_arm_change,
    rolling_change,
    rolling_direction,
    spun_arm,
    spun_arm_change,
    write_place_slopes,
)
from ..spatial.layout import EP, ER, ERROR, EV, EW
from ..spatial.rotation import cross, write_matrix
from ..spatial.vectors import dot, minus, plus, put, three, times, triple, vector
from .contact_change import (
    bend_change,
    contact_change,
    contact_geometry,
    error_velocity,
    point_velocity,
    rolls_smoothly,
    turning,
)
from .contact_system import add_answer, add_force, eliminate
from .flight_derivative import in_world, mean_spin, turn_coefficients, turned_on
from .twist_derivative import add_twist, no_twist, surface_change, surface_velocity, twist_change, twist_of
from .wrench_derivative import fly_pushed_errors

_YIELDING = 1e-7  # relative compliance of a constraint


class ContactErrors(NamedTuple):
    """Arrays for the derivative of a group's contacts.

    Attributes
    ----------
    gap : (C,) float64
        Gaps of the current contacts when they were found [m].
    surface : (C, 12) float64
        Description of the surfaces at each contact (`contact_change.contact_geometry`).
    tilts : float64 array
        A copy of `rolling.TILTS`.
    rolled : (B, 4, 14) float64
        Results that `rolling` keeps.
    places : (C, 3, 6) float64
        Places of contacts in the middle of the interval (`middle_arms.rolling_places`) [m], and their
        derivative (`middle_arms.write_place_slopes`).
    slot : (B,) int64
        Index of each body's six velocities in the system's unknowns; -1 if absent.
    system : (6 B, 6 B + r) float64
        Linear system with right-hand sides.
    doubtful : (B,) bool
        Whether contacts of each body could behave differently within a standard deviation. They could open,
        not close, or not close together in an impact.
    first_gap : (r,) float64
        Changes of the gap of an impact's first contact [m].
    """

    gap: np.ndarray
    surface: np.ndarray
    tilts: np.ndarray
    rolled: np.ndarray
    places: np.ndarray
    slot: np.ndarray
    system: np.ndarray
    doubtful: np.ndarray
    first_gap: np.ndarray


@inner(forceinline=True)
def relative_velocity(v, i, j, arm_i, arm_j):
    """Return the velocity of body i's point relative to its partner's, from rows of velocities."""
    u = point_velocity(v, i, arm_i)
    return minus(u, point_velocity(v, j, arm_j)) if j >= 0 else u


@inner(forceinline=True)
def _turning(v, i, j, change):
    """Return the change of `relative_velocity` with the lever arms."""
    u = turning(v, i, change.arm_i)
    return minus(u, turning(v, j, change.arm_j)) if j >= 0 else u


@inner(forceinline=True)
def _speed_change(g, change, v, i, j, errors, first_i, first_j, c):
    """Return the change of a contact's normal speed for column ``c``, from velocities and errors."""
    du = minus(error_velocity(errors, first_i, g.arm_i, c), error_velocity(errors, first_j, g.arm_j, c))
    du = plus(du, _turning(v, i, j, change))
    return dot(g.n, du) + dot(change.n, relative_velocity(v, i, j, g.arm_i, g.arm_j))


@inner(forceinline=True)
def _first(errors, j):
    """Return the start of body j's block; for an element, of the zero block."""
    return ERROR * errors.block[j] if j >= 0 else errors.begin.shape[0] - ERROR


@inner
def _bend_change(g, change, v, i, j, errors, first_i, first_j, c):
    """Return the change of a contact's centripetal acceleration."""
    w, dw = (v[i, 3], v[i, 4], v[i, 5]), vector(errors, first_i + EW, c)
    total = bend_change(g.n, w, g.center_i, change.n, dw, change.center_i)
    if j >= 0:
        w, dw = (v[j, 3], v[j, 4], v[j, 5]), vector(errors, first_j + EW, c)
        total -= bend_change(g.n, w, g.center_j, change.n, dw, change.center_j)
    return total


@inner(noinline=True, error_model="numpy")
def impact_time_errors(x, c, time, v, begin, world, work, errors, surface_of):
    """Add the change of contact ``c``'s closing time to `Errors.length`.

    ``v`` are the current velocities, ``begin`` the errors. A negative ``time`` means that it closed before.
    """
    row, i, j = work.rows[c], work.ids[c, 0], work.ids[c, 1]
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
        errors.length[k] -= (change.gap + speed * time + 0.5 * fall * time * time) / slope


@inner
def fly_group_errors(count, h, time, world, work, errors):
    """Propagate the current group's errors through an interval until ``time``, without contacts."""
    numbers, velocity = work.numbers, work.velocity
    decay = world.decay if h == world.dt else world.decay ** (h / world.dt)
    for a in range(count):
        i, k = work.members[a], START_QUATERNION
        v, w = three(velocity[START], i, 0), three(velocity[START], i, 3)
        q = (numbers[i, k], numbers[i, k + 1], numbers[i, k + 2], numbers[i, k + 3])
        fly_pushed_errors(v, w, q, i, h, time, decay, world, errors)


@inner(noinline=True)
def travel_errors(count, h, time, world, work, errors, contacts):
    """Propagate the current group's errors through a solved interval until ``time``, to `Errors.end`.

    ``work.R`` belongs to the interval's end.
    """
    velocity, size = work.velocity, 0
    fly_group_errors(count, h, time, world, work, errors)
    for a in range(count):
        i = work.members[a]
        contacts.slot[i] = -1
        if work.loaded[i] > 0:
            contacts.slot[i] = size
            size += 6
    if size == 0:
        return
    _find_places(h, world, work, errors, contacts)
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
def _find_places(h, world, work, errors, contacts):
    """Compute the places of loaded contacts in the middle of the interval (`ContactErrors.places`).

    A body with a rolling shape (`rolling`) needs none. Contacts with the same lead and anchor share them.
    """
    numbers, rows, ids, k = work.numbers, work.rows, work.ids, FREE_QUATERNION
    for c in range(work.counts[CONTACTS]):
        row, i, places = rows[c], ids[c, 0], contacts.places[c]
        if not _has_places(c, work, contacts, world):
            continue
        same = -1
        for b in range(c):
            if ids[b, 0] == i and rows[b, LEAD] == row[LEAD] and rows[b, ANCHOR] == row[ANCHOR]:
                if _has_places(b, work, contacts, world):
                    same = b
                    break
        if same >= 0:
            for r in range(places.shape[0]):
                for m in range(places.shape[1]):
                    places[r, m] = contacts.places[same, r, m]
            continue
        q = (numbers[i, k], numbers[i, k + 1], numbers[i, k + 2], numbers[i, k + 3])
        write_matrix(q, errors.R, 0)
        lead = rows[int(row[LEAD])]
        axes = triple(lead, 0), triple(lead, AXIS), triple(lead, 2 * AXIS)
        turn = mean_turn(h, work.velocity, i)
        put(places, 0, 0, triple(row, PLACES))
        write_place_slopes(*axes, turn, int(row[ANCHOR]), i, errors.R[0], world, places[:, 1:])


@inner
def _has_places(c, work, contacts, world):
    """Return whether the derivative of a contact needs its places in the middle of the interval."""
    row = work.rows[c]
    if row[IN_MIDDLE] == 0.0 or work.impulses[LASTING, c, 0] <= 0.0:
        return False
    lead = int(row[LEAD])
    return not rolls_smoothly(contacts.surface[lead], world.tree.radii[work.ids[lead, 2]])


@inner
def impact_errors(x, count, threshold, world, work, errors, contacts):
    """Propagate the current group's errors through an impact; `Errors.begin` is replaced."""
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
                work.numbers[i, FREE_POSITION + k] = x[i, k]
            for k in range(4):
                work.numbers[i, FREE_QUATERNION + k] = x[i, 6 + k]
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

    The result is in the system's columns from ``size`` on, at each body's slot.
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
    """Add a body's mass and inertia, and its motion without contacts, to the system."""
    numbers, v, R = work.numbers, work.velocity, errors.R
    inertia, mass, first = world.bodies.inertia[i], world.bodies.mass[i], ERROR * errors.block[i]
    k = FREE_QUATERNION
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
        t = vector(errors.end, first + ER, c)
        for k in range(3):
            A[place + k, size + c] = mass * errors.end[first + EV + k, c]
        # w' - w* is I^-1 tau, and I rotates with the body
        a = in_world(R[0], inertia, plus(vector(errors.end, first + EW, c), cross(t, kicked)))
        put(A, place + 3, size + c, minus(a, cross(t, tau)))


@inner(noinline=True, error_model="numpy")
def _add_contact(c, size, law, h, threshold, world, work, errors, contacts):
    """Add a loaded contact's ``B`` and ``b`` (see the module) to both bodies' rows."""
    row, ids, own, velocity = work.rows[c], work.ids[c], work.impulses[law, c], work.velocity
    i, j, gap, end = ids[0], ids[1], contacts.gap[c], errors.end
    after, before = velocity[NOW], velocity[FREE if law == LASTING else START]
    position = three(work.numbers, i, FREE_POSITION)
    g = contact_geometry(row, ids, gap, contacts.surface[c], position, world, work)
    lead = int(row[LEAD]) if law == LASTING else c
    g_lead = g
    if lead != c:
        g_lead = contact_geometry(
            work.rows[lead], work.ids[lead], contacts.gap[lead], contacts.surface[lead], position, world, work
        )
    n, push_arm, turn, along, places = g.n, g.arm_i, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), contacts.places[c]
    in_middle, ahead, own_arm = law == LASTING and row[IN_MIDDLE] > 0.0, 0.0, g.arm_i
    # the contact of a rolling shape is at the support, without bumps
    is_smooth = in_middle and g_lead.roll_i[0] + g_lead.roll_i[2] > 0.0
    if in_middle:
        turn = mean_turn(h, velocity, i)
        along = rolling_direction(g_lead.n, turn)
        push_arm = spun_arm(g.arm_i, g_lead.n, turn)
        if not is_smooth:
            own_arm = lever_arm(row, MOMENT_I, n, g.first, g.second)
            ahead = dot(own_arm, along) - places[2, 0]
            push_arm = placed_arm(push_arm, vector(places, 0, 0), g_lead.n, along)
    f_t = plus(times(own[1], g.first), times(own[2], g.second))
    f = plus(times(own[0], n), f_t)
    u = relative_velocity(after, i, j, g.arm_i, g.arm_j)
    u_before = relative_velocity(before, i, j, g.arm_i, g.arm_j)
    speed, speed_before = dot(n, u), dot(n, u_before)
    # normal impulse: d lambda = known - yield ds'
    way = square = stiff = closing = depth = recovery = weakening = 0.0
    if law == LASTING:
        way = 0.5 * h + row[DAMPING_TIME]
        factor = shallow_factor(world.stiffness) * row[RADIUS]
        depth = math.sqrt(own[0] / (h * factor))
        square = factor * depth * depth
        stiff = 2.0 * h * factor * depth
        give = stiff * way
        # growth rate of the gap with h, for overlap that is removed slowly
        begun = dot(n, relative_velocity(velocity[START], i, j, g.arm_i, g.arm_j))
        recovery = RECOVERY - 0.5 * (begun + speed_before)
        if in_middle:
            if not is_smooth:
                recovery += ahead * dot(three(before, i, 3), cross(along, g_lead.n))
        elif lead != c:
            recovery += speed_before
            recovery -= dot(g_lead.n, relative_velocity(before, i, j, g_lead.arm_i, g_lead.arm_j))
    else:
        give = 1.0 / (_YIELDING * row[COMPLIANCE])
        closes = speed_before < -impact_speed(row[RESTITUTION], threshold)
        closing = speed / speed_before if closes else 0.0
        slipperiness = world.implicit.impact_slipperiness
        if slipperiness > 0.0:
            weakening = slip_limit_per_speed(row, own[0], speed_before, slipperiness)
    # friction
    moves = j < 0 and len(world.environment.actions.surface) > 0
    drift = (0.0, 0.0, 0.0)
    if moves:
        drift = surface_velocity(world.environment.actions.surface[-1 - j], position, g.arm_i)
    u_s = minus(u, drift)  # velocity that friction opposes, including its normal part
    lift = dot(n, u_s)
    u_t = minus(u_s, times(lift, n))
    slides, pushed, along, hold = slip_derivative(row, own[0], f_t, u_t, n, _YIELDING * row[SLIP_COMPLIANCE])
    slot_i = contacts.slot[i]
    slot_j = contacts.slot[j] if j >= 0 and work.moving[j] else -1
    A, torsion_rows = contacts.system, len(work.torsion_rows) > 0
    spinning = minus(three(after, i, 3), three(after, j, 3)) if j >= 0 else three(after, i, 3)
    twist = no_twist()
    if torsion_rows:
        twist = twist_of(work.torsion_rows[c], own, n, spinning, _YIELDING)
        add_twist(twist, n, give, g.arm_i, g.arm_j, slot_i, slot_j, A)
    for k in range(3):  # columns of B, each the response to a unit change of u'
        unit = (1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2))
        B_i = _answer(unit, n, pushed, along, give, hold)
        turn_i = cross(g.arm_i, unit)  # of u' with w: unit . (w x arm) = w . (arm x unit)
        turn_j = cross(g.arm_j, unit)
        add_answer(A, slot_i, slot_i, slot_j, k, -1.0, push_arm, B_i, turn_i, turn_j)
        if slot_j >= 0:
            add_answer(A, slot_j, slot_i, slot_j, k, 1.0, g.arm_j, B_i, turn_i, turn_j)
    first_i, first_j = ERROR * errors.block[i], _first(errors, j)
    begins = law != LASTING and contacts.first_gap[0] == math.inf
    faster, graze = 0.0, 0.0  # change of the closing speed, and its variance
    wide = 0.0  # variance of the gap that decides whether, and when, it acts
    clipped = law == LASTING and row[GAP] > gap
    for k in range(end.shape[1]):
        change = contact_change(g, end, first_i, first_j, k)
        other = contact_change(g_lead, end, first_i, first_j, k) if lead != c else change
        dn, push_change, rolls = change.n, change.arm_i, no_rolling()
        if in_middle:
            dw = times(0.25, vector(errors.begin, first_i + EW, k))
            dw = plus(dw, times(0.75, vector(end, first_i + EW, k)))
            dturn, tilt = plus(times(h, dw), times(errors.length[k] / h, turn)), vector(end, first_i + ER, k)
            push_change = spun_arm_change(g.arm_i, g_lead.n, turn, change.arm_i, other.n, dturn)
            if not is_smooth:
                rolls = rolling_change(places, g_lead, turn, tilt, other.n, dturn)
                spun = spun_arm(g.arm_i, g_lead.n, turn)
                push_change = placed_arm_change(
                    spun, vector(places, 0, 0), g_lead.n, along, push_change, rolls
                )
        if begins:
            contacts.first_gap[k] = change.gap
        wide += (change.gap if law == LASTING else change.gap - contacts.first_gap[k]) ** 2
        known, turned = _turning(after, i, j, change), (0.0, 0.0, 0.0)
        if j >= 0 and slot_j < 0:  # errors of fixed or kinematic bodies at the end are known
            known = minus(known, error_velocity(errors.end, first_j, g.arm_j, k))
            turned = vector(errors.end, first_j + EW, k)
        slip = known
        if moves:
            at = plus(vector(end, first_i + EP, k), change.arm_i)
            slip = minus(known, surface_change(world.environment.actions.surface[-1 - j], at))
        # n . du' comes with dn . u'
        push = -give * dot(dn, u)
        if law == LASTING:
            dh = errors.length[k]
            free, roll = _speed_change(g, change, before, i, j, end, first_i, first_j, k), 0.0
            if in_middle:
                if not is_smooth:
                    w, dw = three(before, i, 3), vector(end, first_i + EW, k)
                    moved = dot(change.arm_i, along) + dot(own_arm, rolls.along) - rolls.places[2]
                    across = cross(along, g_lead.n)
                    tilted = plus(cross(rolls.along, g_lead.n), cross(along, other.n))
                    roll = moved * dot(w, across) + ahead * (dot(dw, across) + dot(w, tilted))
            elif lead != c:
                roll = free - _speed_change(g_lead, other, before, i, j, end, first_i, first_j, k)
            deeper = 0.5 * (dh * (speed_before - speed) + h * free) + row[DAMPING_TIME] * roll
            if clipped:
                first = _speed_change(g, change, velocity[START], i, j, errors.begin, first_i, first_j, k)
                deeper += dh * recovery + h * (roll - 0.5 * (first + free))
            else:
                deeper -= change.gap
            push += dh * square + stiff * deeper
        elif closing != 0.0 or weakening > 0.0:
            faster = _speed_change(g, change, before, i, j, end, first_i, first_j, k)
            if closing != 0.0:
                push += give * closing * faster
                graze += faster * faster
        answer = _answer(slip, n, (0.0, 0.0, 0.0), along, 0.0, hold)
        push -= give * dot(n, known)
        b = plus(times(push, pushed), answer)
        b = plus(b, times(own[0], dn))
        if slides and weakening > 0.0:
            b = minus(b, times(weakening * faster, along))
        # the rest of the friction force rotates with the normal
        tilted = dot(f_t, dn)
        if slides:
            b = plus(b, times(hold, minus(times(lift, dn), times(dot(along, dn) * lift, along))))
            b = plus(b, times(hold * dot(dn, u_t), n))
        else:
            b = minus(b, times(tilted, n))
            b = plus(b, times(hold * lift, dn))
        extra = twist_change(twist, n, dn, push, turned) if torsion_rows else (0.0, 0.0, 0.0)
        moment = plus(plus(cross(push_arm, b), cross(push_change, f)), extra)
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
    """Return ``B u``: the change of the impulse with the relative velocity."""
    s = dot(n, u)
    across = minus(u, times(s, n))
    across = minus(across, times(dot(along, across), along))
    return minus(times(-give * s, pushed), times(hold, across))
