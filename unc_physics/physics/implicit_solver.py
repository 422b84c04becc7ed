"""The contact problem of a group of bodies: lasting contacts implicit in velocity, impacts as rigid impulses.

Lasting contact, over an interval h (`solve_lasting`): the paper's penalty force to leading order in depth
(`contact_model.shallow_volume`), at the depth of the interval's end, plus the damping time tau times the
closing speed::

    lambda_n = h kappa pi R d^2,   d = max(0, -g - h (v_n + v_n') / 2 - tau v_n')
    |lambda_t| <= mu lambda_n, opposite to slip; no slip inside
    M (v' - v*) = J^T lambda

with v at the start, v' at the end, v* what the end would be without contacts. Bodies travel by the mean of v
and v', so that the depth is the end's, sliding loses the energy that friction takes, and the contact never
gives energy.

Impact (`solve_impact`): impulses to ``v_n' = -e v_n`` where a contact closes, in Coulomb's cone.

Both by block Gauss-Seidel: each contact's normal impulse in closed form, then both tangential ones, scaled
back to the cone.
"""

import math

from .compiled import inner
from .contact_model import FAST, balanced_depth, shallow_depth
from .implicit_workspace import (
    BEND,
    BEST,
    COMPLIANCE,
    CONTACTS,
    DAMPING_TIME,
    ELASTIC,
    FALL,
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
    PLASTIC,
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

#: A solution is found when a sweep changes no impulse by more than this share of the largest normal one, and
#: no contact's velocity by more than the other share of the fastest contact's: light bodies under heavy ones
#: lie still too.
TOLERANCE, _STILL = 1e-3, 1e-4
_PLAIN_SWEEPS, _SWEEPS = 8, 200
#: Overlap that contacts always push out [m], and how fast they push out what the load does not explain [m/s].
_SLACK, _RECOVERY = 2e-5, 0.05
_DIVERGED = 100.0  # growth of the square of a sweep's change, at which the solver goes back
_GAIN = 1e-9  # of an impact's work, relative to its terms: round-off


@inner(forceinline=True, fastmath=FAST)
def contact_speed(row, d, v, i, j):
    """Velocity of body i relative to its partner at a contact, along direction ``d`` of its row [m/s]."""
    k = 3 * d
    s = (
        row[k] * v[i, 0]
        + row[k + 1] * v[i, 1]
        + row[k + 2] * v[i, 2]
        + row[MOMENT_I + k] * v[i, 3]
        + row[MOMENT_I + k + 1] * v[i, 4]
        + row[MOMENT_I + k + 2] * v[i, 5]
    )
    if j >= 0:
        s -= (
            row[k] * v[j, 0]
            + row[k + 1] * v[j, 1]
            + row[k + 2] * v[j, 2]
            + row[MOMENT_J + k] * v[j, 3]
            + row[MOMENT_J + k + 1] * v[j, 4]
            + row[MOMENT_J + k + 2] * v[j, 5]
        )
    return s


@inner(forceinline=True, fastmath=FAST)
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


@inner(forceinline=True, fastmath=FAST)
def _solve_friction(row, own, limit, v, i, j):
    """Change both tangential impulses of a contact to no slip, or to the cone; returns the largest change."""
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


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def _normal_impulse(row, old, speed, law, h, factor):
    """Impulse that obeys a contact's law, all others held; with ``old``, its normal speed is ``speed``."""
    w = row[COMPLIANCE]
    others = speed - w * old
    if law == LASTING:
        way = 0.5 * h + row[DAMPING_TIME]
        depth = -row[GAP] - 0.5 * h * (row[START_SPEED] + h * row[BEND]) - way * others
        if depth <= 0.0:
            return 0.0
        return (depth - balanced_depth(depth, h * way * w, row[RADIUS], factor)) / (way * w)
    return max(0.0, ((row[TARGET] if law == ELASTIC else 0.0) - others) / w)


@inner(fastmath=FAST, error_model="numpy")
def solve(rows, ids, m, law, all_impulses, v, h, factor, fastest):
    """Find the impulses of ``m`` contacts by `LASTING`, `ELASTIC` or `PLASTIC`, from those on record.

    After some plain sweeps each is followed by a step along what the sweeps have changed so far, as in
    conjugate gradients (Silcowitz, Niebe and Erleben 2010): sweeps alone take as many as the mass ratio,
    these its root.

    Returns
    -------
    residual : float
        Largest change of an impulse in the last sweep, which is by how much the law was missed, relative to
        the largest normal impulse.
    """
    own, previous, search = all_impulses[law], all_impulses[PREVIOUS], all_impulses[SEARCH]
    best = all_impulses[BEST]
    residual = found = last = 0.0
    least = math.inf
    for sweep in range(_SWEEPS):
        accelerated = sweep >= _PLAIN_SWEEPS
        change = load = jump = 0.0
        for c in range(m):
            row, i, j = rows[c], ids[c, 0], ids[c, 1]
            old = own[c, 0]
            if accelerated:
                for d in range(3):
                    previous[c, d] = own[c, d]
            new = _normal_impulse(row, old, contact_speed(row, 0, v, i, j), law, h, factor)
            if new != old:
                own[c, 0] = new
                apply_impulse(row, 0, new - old, v, i, j)
                change = max(change, abs(new - old))
                jump = max(jump, abs(new - old) * row[COMPLIANCE])
            load = max(load, new)
            if row[FRICTION] > 0.0:
                slip = _solve_friction(row, own[c], row[FRICTION] * new, v, i, j)
                change, jump = max(change, slip), max(jump, slip * row[SLIP_COMPLIANCE])
        residual = change / load if load > 0.0 else (0.0 if change == 0.0 else 1.0)
        if residual <= TOLERANCE and jump <= _STILL * fastest:
            return residual
        if not accelerated:
            continue
        square = 0.0
        for c in range(m):
            for d in range(3):
                square += (own[c, d] - previous[c, d]) ** 2
        if square < least:
            least, found = square, residual
            for c in range(m):
                for d in range(3):
                    best[c, d] = own[c, d]
        elif square > _DIVERGED * least or sweep == _SWEEPS - 1:  # back to the best so far
            _change_impulses(rows, ids, m, own, best, v)
            last = 0.0
            continue
        share = square / last if last > 0.0 else math.inf
        for c in range(m):
            for d in range(3):
                changed = own[c, d] - previous[c, d]
                if share > 1.0:  # begin anew
                    search[c, d] = changed
                    continue
                more = share * search[c, d]
                search[c, d] = changed + more
                if more != 0.0:
                    own[c, d] += more
                    apply_impulse(rows[c], d, more, v, ids[c, 0], ids[c, 1])
        last = square
    return found


@inner(fastmath=FAST, error_model="numpy")
def _change_impulses(rows, ids, m, own, new, v):
    """Put ``new`` impulses in place of ``own``; the velocities follow."""
    for c in range(m):
        for d in range(3):
            apply_impulse(rows[c], d, new[c, d] - own[c, d], v, ids[c, 0], ids[c, 1])
            own[c, d] = new[c, d]


@inner(fastmath=FAST, error_model="numpy")
def solve_lasting(rows, ids, counts, all_impulses, velocity, factor, h, dt, threshold):
    """Find all contacts' impulses over an interval ``h`` [s], and the velocities ``NOW`` at its end.

    ``factor`` is the stiffness's (`contact_model.shallow_factor`). Contacts that close faster than
    ``threshold`` [m/s] and stay open are not damped. Returns the residual (`solve`).
    """
    m, start, free, v = counts[CONTACTS], velocity[START], velocity[FREE], velocity[NOW]
    impulses = all_impulses[LASTING]
    fastest = 0.0
    for c in range(m):
        row, i, j = rows[c], ids[c, 0], ids[c, 1]
        # overlap beyond what the last force explains has no energy to give back: it goes slowly
        loaded = row[FORCE] > 0.0 and factor > 0.0
        explained = shallow_depth(row[FORCE], row[RADIUS], factor) if loaded else 0.0
        row[GAP] = max(row[GAP], -explained - _SLACK - _RECOVERY * h)
        speed, end = contact_speed(row, 0, start, i, j), contact_speed(row, 0, free, i, j)
        row[START_SPEED] = speed
        fastest = max(fastest, max(abs(speed), abs(end)))
        for d in range(1, 3):
            fastest = max(fastest, abs(contact_speed(row, d, free, i, j)))
        fast = row[GAP] > 2e-5 and -end > threshold and row[GAP] + h * (speed + 0.5 * h * row[FALL]) > 0.0
        row[DAMPING_TIME] = 0.0 if fast else dt
        if fast and row[GAP] + 0.5 * h * (speed + end + h * row[BEND]) <= 0.0:
            # an impact to come, which the gyroscopic term brings nearer than a fall: no lasting contact
            row[RADIUS] = 0.0
        for d in range(3):
            impulses[c, d] = h * row[FORCE + d]
            if impulses[c, d] != 0.0:
                apply_impulse(row, d, impulses[c, d], v, i, j)
    return solve(rows, ids, m, LASTING, all_impulses, v, h, factor, fastest)


@inner
def work_done(rows, ids, m, impulses, before, after):
    """Kinetic energy that impulses add [J], and the sum of its terms' sizes: impulses times mean speeds."""
    total = size = 0.0
    for c in range(m):
        for d in range(3):
            if impulses[c, d] != 0.0:
                i, j = ids[c, 0], ids[c, 1]
                speed = contact_speed(rows[c], d, before, i, j) + contact_speed(rows[c], d, after, i, j)
                total += 0.5 * impulses[c, d] * speed
                size += abs(impulses[c, d] * speed)
    return total, size


@inner
def solve_impact(rows, ids, counts, all_impulses, members, count, velocity, threshold):
    """Find the impulses `ELASTIC` of an impact of all contacts at hand, and the velocities ``NOW`` after it.

    Newton's restitution with friction can add energy: then the solution is blended with the one without
    rebound, as far as none is added. Both obey Coulomb's law and do not penetrate, so their blend does.
    Returns the residual (`solve`).
    """
    m, start, v = counts[CONTACTS], velocity[START], velocity[NOW]
    elastic, plastic = all_impulses[ELASTIC], all_impulses[PLASTIC]
    fastest = 0.0
    for c in range(m):
        row = rows[c]
        speed = contact_speed(row, 0, start, ids[c, 0], ids[c, 1])
        fastest = max(fastest, abs(speed))
        row[TARGET] = -row[RESTITUTION] * speed if -speed > threshold else 0.0
        for d in range(3):
            elastic[c, d] = plastic[c, d] = 0.0
    residual = solve(rows, ids, m, ELASTIC, all_impulses, v, 0.0, 0.0, fastest)
    gain, size = work_done(rows, ids, m, elastic, start, v)
    if gain <= _GAIN * size:
        return residual
    for a in range(count):
        for k in range(6):
            v[members[a], k] = start[members[a], k]
    residual = max(residual, solve(rows, ids, m, PLASTIC, all_impulses, v, 0.0, 0.0, fastest))
    base, _ = work_done(rows, ids, m, plastic, start, v)
    slope = 0.0
    for c in range(m):
        for d in range(3):
            slope += (elastic[c, d] - plastic[c, d]) * contact_speed(rows[c], d, v, ids[c, 0], ids[c, 1])
    share = 0.0
    if base < 0.0:
        curve = gain - base - slope  # energy is base + slope s + curve s^2 of the share s
        share = 2.0 * -base / (slope + math.sqrt(max(slope * slope - 4.0 * curve * base, 0.0)))
        share = min(max(share, 0.0), 1.0)
    for c in range(m):
        for d in range(3):
            more = share * (elastic[c, d] - plastic[c, d])
            elastic[c, d] = plastic[c, d] + more
            apply_impulse(rows[c], d, more, v, ids[c, 0], ids[c, 1])
    return residual
