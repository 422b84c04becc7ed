"""The contact problem of a group of bodies: lasting contacts implicit in velocity, impacts as rigid impulses.

Lasting contact, over an interval h (`solve_lasting`): the paper's penalty force to leading order in depth, at the depth of
the interval's end, plus the damping time tau times the closing speed::

    lambda_n = h kappa pi R d^2,   d = max(0, -g - h (v_n + v_n') / 2 - tau v_n')
    |lambda_t| <= mu lambda_n, opposite to slip; no slip inside
    M (v' - v*) = J^T lambda

with v at the start, v' at the end, v* what the end would be without contacts. Bodies travel by the mean of v and v', so that
the depth is the end's, sliding loses the energy that friction takes, and the contact never gives energy.

Impact (`solve_impact`): impulses to ``v_n' = -e v_n`` where a contact closes, in Coulomb's cone.

Both by block Gauss-Seidel: each contact's normal impulse in closed form, then both tangential ones, scaled back to the cone.
"""

import math

from .compiled import inner
from .implicit_workspace import (
    BEND,
    COMPLIANCE,
    CONTACTS,
    DAMPING_TIME,
    FORCE,
    FREE,
    FRICTION,
    GAP,
    INVERSE_MASS_I,
    INVERSE_MASS_J,
    LASTING,
    MOMENT_I,
    MOMENT_J,
    NOW,
    PREVIOUS,
    RADIUS,
    RESTITUTION,
    SEARCH,
    SLIP_COMPLIANCE,
    START,
    START_SPEED,
    TARGET,
    TURN_I,
    TURN_J,
)

#: Largest residual at which a solution counts as found, relative to the largest normal impulse.
TOLERANCE = 1e-4
_PLAIN_SWEEPS, _SWEEPS, _IMPACT_SWEEPS = 8, 200, 400
_GAIN = 1e-12  # of an impact's work, relative to what the impulses' sizes would do: round-off

_FAST = {"contract", "nsz"}


@inner(forceinline=True, fastmath=_FAST)
def contact_speed(row, d, v, i, j):
    """Velocity of body i relative to its partner at a contact, along direction ``d`` of its row [m/s]."""
    k = 3 * d
    s = (
        row[k] * v[i, 0] + row[k + 1] * v[i, 1] + row[k + 2] * v[i, 2]
        + row[MOMENT_I + k] * v[i, 3] + row[MOMENT_I + k + 1] * v[i, 4] + row[MOMENT_I + k + 2] * v[i, 5]
    )
    if j >= 0:
        s -= (
            row[k] * v[j, 0] + row[k + 1] * v[j, 1] + row[k + 2] * v[j, 2]
            + row[MOMENT_J + k] * v[j, 3] + row[MOMENT_J + k + 1] * v[j, 4] + row[MOMENT_J + k + 2] * v[j, 5]
        )
    return s


@inner(forceinline=True, fastmath=_FAST)
def apply_impulse(row, d, impulse, v, i, j):
    """Change the bodies' velocities by an impulse along direction ``d`` of a contact's row [N s]."""
    k = 3 * d
    a = impulse * row[INVERSE_MASS_I]
    for c in range(3):
        v[i, c] += a * row[k + c]
        v[i, 3 + c] += impulse * row[TURN_I + k + c]
    if j >= 0:
        a = impulse * row[INVERSE_MASS_J]
        for c in range(3):
            v[j, c] -= a * row[k + c]
            v[j, 3 + c] -= impulse * row[TURN_J + k + c]


@inner(forceinline=True, fastmath=_FAST)
def _solve_friction(row, own, limit, v, i, j):
    """Bring both tangential impulses among a contact's ``own`` to no slip or to the cone; returns the largest change."""
    slip, old1, old2 = row[SLIP_COMPLIANCE], own[1], own[2]
    if limit <= 0.0:
        if old1 == 0.0 and old2 == 0.0:
            return 0.0
        new1 = new2 = 0.0
    else:
        new1 = old1 - contact_speed(row, 1, v, i, j) / slip
        new2 = old2 - contact_speed(row, 2, v, i, j) / slip
        size = math.sqrt(new1 * new1 + new2 * new2)
        if size > limit:
            new1, new2 = new1 * limit / size, new2 * limit / size
    own[1], own[2] = new1, new2
    apply_impulse(row, 1, new1 - old1, v, i, j)
    apply_impulse(row, 2, new2 - old2, v, i, j)
    return max(abs(new1 - old1), abs(new2 - old2))


@inner(fastmath=_FAST, error_model="numpy")
def _begin_sweep(m, own, previous):
    for c in range(m):
        for d in range(3):
            previous[c, d] = own[c, d]


@inner(fastmath=_FAST, error_model="numpy")
def _accelerate(rows, ids, m, own, previous, search, v, last):
    """Go on along what the last sweeps changed, as conjugate gradients do (Silcowitz, Niebe and Erleben 2010).

    ``previous`` has the impulses before the last sweep, ``search`` the direction so far, and ``last`` the square of the change in
    the sweep before. Returns that of the last one. Plain sweeps take as many as the mass ratio, these its root.
    """
    square = 0.0
    for c in range(m):
        for d in range(3):
            previous[c, d] = own[c, d] - previous[c, d]
            square += previous[c, d] * previous[c, d]
    share = square / last if last > 0.0 else 2.0
    for c in range(m):
        i, j = ids[c, 0], ids[c, 1]
        for d in range(3):
            if share > 1.0:
                search[c, d] = 0.0 if last > 0.0 else previous[c, d]
                continue
            more = share * search[c, d]
            search[c, d] = more + previous[c, d]
            if more != 0.0:
                own[c, d] += more
                apply_impulse(rows[c], d, more, v, i, j)
    return square


@inner(fastmath=_FAST, error_model="numpy")
def solve_lasting(rows, ids, counts, all_impulses, velocity, kappa, h, dt, threshold):
    """Find the impulses of all contacts at hand over an interval ``h`` [s], and the velocities ``NOW`` at its end.

    ``kappa`` is pi times the stiffness; contacts that close faster than ``threshold`` [m/s] and stay open are not damped.

    Returns
    -------
    residual : float
        Largest change of an impulse in the last sweep, relative to the largest normal impulse.
    """
    m, start, free, v = counts[CONTACTS], velocity[START], velocity[FREE], velocity[NOW]
    impulses, previous, search = all_impulses[LASTING], all_impulses[PREVIOUS], all_impulses[SEARCH]
    for c in range(m):
        row, i, j = rows[c], ids[c, 0], ids[c, 1]
        speed, end = contact_speed(row, 0, start, i, j), contact_speed(row, 0, free, i, j)
        row[START_SPEED] = speed
        predicted = row[GAP] + 0.5 * h * (speed + end + h * row[BEND])
        fast = row[GAP] > 2e-5 and -end > threshold and predicted > 0.0
        row[DAMPING_TIME] = 0.0 if fast else dt
        for d in range(3):
            impulses[c, d] = h * row[FORCE + d]
            if impulses[c, d] != 0.0:
                apply_impulse(row, d, impulses[c, d], v, i, j)
    residual = last = 0.0
    for sweep in range(_SWEEPS):
        change = load = 0.0
        if sweep >= _PLAIN_SWEEPS:
            _begin_sweep(m, impulses, previous)
        for c in range(m):
            row, i, j = rows[c], ids[c, 0], ids[c, 1]
            old, w = impulses[c, 0], row[COMPLIANCE]
            way = 0.5 * h + row[DAMPING_TIME]
            others = contact_speed(row, 0, v, i, j) - w * old
            depth = -row[GAP] - 0.5 * h * (row[START_SPEED] + h * row[BEND]) - way * others
            new = 0.0
            if depth > 0.0:
                q = h * way * w * kappa * row[RADIUS]
                new = (depth - 2.0 * depth / (1.0 + math.sqrt(1.0 + 4.0 * q * depth))) / (way * w)
            if new != old:
                impulses[c, 0] = new
                apply_impulse(row, 0, new - old, v, i, j)
                change = max(change, abs(new - old))
            load = max(load, new)
            if row[FRICTION] > 0.0:
                change = max(change, _solve_friction(row, impulses[c], row[FRICTION] * new, v, i, j))
        residual = change / load if load > 0.0 else (0.0 if change == 0.0 else 1.0)
        if residual <= TOLERANCE:
            break
        if sweep >= _PLAIN_SWEEPS and sweep < _SWEEPS - 1:
            last = _accelerate(rows, ids, m, impulses, previous, search, v, last)
    return residual


@inner(fastmath=_FAST, error_model="numpy")
def solve_impact(rows, ids, counts, part, impulses, velocity, elastic):
    """Find the impulses of the contacts that take part in an impact, from none, and the velocities ``NOW`` after it.

    A contact takes part where ``part`` of its body i is positive; ``impulses`` (C, 3) has what it ends with. With
    ``elastic`` false no contact rebounds.
    """
    m, v = counts[CONTACTS], velocity[NOW]
    for c in range(m):
        for d in range(3):
            impulses[c, d] = 0.0
    residual = 0.0
    for _ in range(_IMPACT_SWEEPS):
        change = load = 0.0
        for c in range(m):
            row, i, j = rows[c], ids[c, 0], ids[c, 1]
            if part[i] <= 0:
                continue
            old = impulses[c, 0]
            target = row[TARGET] if elastic else 0.0
            new = max(0.0, old + (target - contact_speed(row, 0, v, i, j)) / row[COMPLIANCE])
            if new != old:
                impulses[c, 0] = new
                apply_impulse(row, 0, new - old, v, i, j)
                change = max(change, abs(new - old))
            load = max(load, new)
            if row[FRICTION] > 0.0:
                change = max(change, _solve_friction(row, impulses[c], row[FRICTION] * new, v, i, j))
        residual = change / load if load > 0.0 else 0.0
        if change <= 1e-8 * load:
            break
    return residual


@inner
def work_done(rows, ids, counts, part, impulses, before, after):
    """Kinetic energy that an impact adds [J], and the size of its terms: impulses times the mean velocities of contacts."""
    total = size = 0.0
    for c in range(counts[CONTACTS]):
        i, j = ids[c, 0], ids[c, 1]
        if part[i] > 0:
            for d in range(3):
                if impulses[c, d] != 0.0:
                    speed = contact_speed(rows[c], d, before, i, j) + contact_speed(rows[c], d, after, i, j)
                    total += 0.5 * impulses[c, d] * speed
                    size += abs(impulses[c, d] * speed)
    return total, size


@inner
def impact(rows, ids, counts, part, elastic, plastic, members, count, velocity, threshold):
    """Solve an impact; its velocities before are ``START``, those after ``NOW``.

    Newton's restitution with friction can add energy: then the solution is blended with the one without rebound, as
    far as none is added. Both obey Coulomb's law and do not penetrate, so their blend does.
    """
    start, v = velocity[START], velocity[NOW]
    for c in range(counts[CONTACTS]):
        row = rows[c]
        speed = contact_speed(row, 0, start, ids[c, 0], ids[c, 1])
        row[TARGET] = -row[RESTITUTION] * speed if -speed > threshold else 0.0
    residual = solve_impact(rows, ids, counts, part, elastic, velocity, True)
    gain, size = work_done(rows, ids, counts, part, elastic, start, v)
    if gain <= _GAIN * size:
        return residual
    for a in range(count):
        for k in range(6):
            v[members[a], k] = start[members[a], k]
    residual = max(residual, solve_impact(rows, ids, counts, part, plastic, velocity, False))
    base, _ = work_done(rows, ids, counts, part, plastic, start, v)
    slope = 0.0
    for c in range(counts[CONTACTS]):
        i, j = ids[c, 0], ids[c, 1]
        if part[i] > 0:
            for d in range(3):
                slope += (elastic[c, d] - plastic[c, d]) * contact_speed(rows[c], d, v, i, j)
    share = 0.0
    if base < 0.0:
        curve = gain - base - slope  # energy is base + slope s + curve s^2 of the share s
        share = 2.0 * -base / (slope + math.sqrt(max(slope * slope - 4.0 * curve * base, 0.0)))
        share = min(max(share, 0.0), 1.0)
    for c in range(counts[CONTACTS]):
        i, j = ids[c, 0], ids[c, 1]
        if part[i] > 0:
            for d in range(3):
                more = share * (elastic[c, d] - plastic[c, d])
                elastic[c, d] = plastic[c, d] + more
                apply_impulse(rows[c], d, more, v, i, j)
    return residual
