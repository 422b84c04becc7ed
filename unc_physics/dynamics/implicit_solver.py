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
back to the cone. Where patches oppose spin, a moment about the normal follows, up to a length times the
normal impulse. Surfaces that move count with their velocities.
"""

import math

import numpy as np

from ..collision.contact_model import FAST, balance, balanced_impulse, shallow_depth
from ..collision.contact_row import (
    AXIS,
    COMPLIANCE,
    COUPLING,
    DAMPING_TIME,
    DEPTH,
    DRIFT,
    FIRST,
    FORCE,
    GAP,
    GROWTH,
    LEAD,
    MOMENT_I,
    MOMENT_J,
    RADIUS,
    REACH,
    RESTITUTION,
    ROLL_DEPTH,
    ROLL_REACH,
    SLIP_COMPLIANCE,
    SPIN_COMPLIANCE,
    SPIN_I,
    SPIN_J,
    STRENGTH,
    TARGET,
    TURN_I,
    TURN_J,
    WAY,
)
from ..collision.contact_simd import apply_impulses, contact_speeds, copy_eight, go_on
from ..collision.implicit_workspace import (
    ALONG,
    BEFORE,
    BEST,
    CONTACTS,
    ELASTIC,
    FREE,
    LASTING,
    NOW,
    PLASTIC,
    PREVIOUS,
    SEARCH,
    START,
)
from ..compiler import inner
from .friction import slip_limit, spin_limit, within_slip_limit, within_spin_limit
from .impact_time import impact_speed

#: A solution is found when a sweep changes no impulse by more than this share of the largest normal one, and
#: no contact's velocity by more than the second share of the fastest contact's, and the third of what that is
#: above the slowest impact's: light bodies under heavy ones lie still too, and what flies needs no such care.
TOLERANCE, _STILL, _MOVING = 1e-3, 2e-4, 1e-3
_PLAIN_SWEEPS, _SWEEPS = 4, 200
#: Sweeps after which a contact's velocity may change by more, in proportion to them: what lies still is found
#: in few, and what goes to and fro for long is in motion.
_PATIENCE = 20.0
#: Share of the contacts whose velocity or impulse may change by more, and how many times more at most. Fewer
#: than 1 / `_SLOW_SHARE` contacts have no such exception.
_SLOW_SHARE, _SLOW_VELOCITY, _SLOW_IMPULSE = 0.01, 16.0, 4.0
#: Among that many contacts, only one in so many later sweeps visits those without an impulse.
_OPEN_EVERY = 5
#: Contacts that are solved one after the other are so many parts of the list apart: mostly of other bodies,
#: so that the processor need not wait for one to begin the next.
_APART = 4
#: Overlap that contacts always push out [m], and how fast they push out what the load does not explain [m/s].
_SLACK, RECOVERY = 2e-5, 0.05
#: Damping time of a contact, in steps: with half of one, what is stiff comes to rest in two.
_DAMPING = 0.5
_ROLLED = 1e-4  # how far points of a body turn in an interval of which other spheres touch at its end [m]
#: Growth of the square of a sweep's change: from one to the next, up to which the direction of search stays,
#: and over the least so far, at which the solver goes back.
_ALIKE, _DIVERGED = 1.1, 100.0
_GAIN = 1e-9  # of an impact's work, relative to its terms: round-off


@inner(forceinline=True, fastmath=FAST)
def contact_speed(row, d, v, i, j):
    """Velocity of body i relative to its partner at a contact, along direction ``d`` of its row [m/s]."""
    speed = contact_speeds(row, v, i, j)[d]
    return speed - row[DRIFT + d - 1] if d > 0 else speed


@inner(forceinline=True, fastmath=FAST)
def contact_spin(row, v, i, j):
    """Angular velocity of body i relative to its partner about a contact's normal [rad/s]."""
    s = row[0] * v[i, 3] + row[1] * v[i, 4] + row[2] * v[i, 5]
    if j >= 0:
        s -= row[0] * v[j, 3] + row[1] * v[j, 4] + row[2] * v[j, 5]
    return s


@inner(forceinline=True, fastmath=FAST)
def apply_moment(twist, moment, v, i, j):
    """Change the bodies' angular velocities by a moment about a contact's normal [N m s]."""
    for k in range(3):
        v[i, 3 + k] += moment * twist[SPIN_I + k]
    if j >= 0:
        for k in range(3):
            v[j, 3 + k] -= moment * twist[SPIN_J + k]


@inner(fastmath=FAST, error_model="numpy")
def _solve_twist(row, twist, own, v, i, j):
    """Give a contact the moment that stops its spin, or the most that its normal impulse allows.

    Returns the change, and that of the spin, as impulse [N s] and velocity [m/s] at the moment's reach.
    """
    reach = twist[REACH]
    limit = spin_limit(twist, own[0])
    if limit == 0.0 and own[3] == 0.0:
        return 0.0, 0.0
    new = own[3] - contact_spin(row, v, i, j) / twist[SPIN_COMPLIANCE]
    new = within_spin_limit(new, limit)
    more = new - own[3]
    own[3] = new
    apply_moment(twist, more, v, i, j)
    return abs(more) / reach, abs(more) * twist[SPIN_COMPLIANCE] * reach


@inner(forceinline=True, error_model="numpy")
def _couple(row, j):
    """Write what a normal impulse asks of both tangential ones; only turning couples them."""
    for d in range(2):
        k = AXIS * (d + 1)
        own = row[k + MOMENT_I] * row[TURN_I] + row[k + MOMENT_I + 1] * row[TURN_I + 1]
        own += row[k + MOMENT_I + 2] * row[TURN_I + 2]
        if j >= 0:
            own += row[k + MOMENT_J] * row[TURN_J] + row[k + MOMENT_J + 1] * row[TURN_J + 1]
            own += row[k + MOMENT_J + 2] * row[TURN_J + 2]
        row[COUPLING + d] = own / row[SLIP_COMPLIANCE]


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def _solve_contact(row, own, law, v, i, j):
    """Give a contact the impulses that obey its law, all others held: the normal one, then both tangential
    ones, to no slip or to the cone.

    Returns
    -------
    normal : float
        Its normal impulse [N s].
    change, jump : float
        Largest change of an impulse [N s], and of the contact's velocity [m/s].
    square : float
        Of all changes [N^2 s^2].
    """
    old, old1, old2 = own[0], own[1], own[2]
    speed, across, along = contact_speeds(row, v, i, j)
    new = 0.0
    if law == LASTING:
        depth = row[DEPTH] - row[WAY] * (speed - row[COMPLIANCE] * old)
        if depth > 0.0:
            new = balanced_impulse(depth, row[GROWTH], row[STRENGTH])
    else:
        new = max(0.0, old + ((row[TARGET] if law == ELASTIC else 0.0) - speed) / row[COMPLIANCE])
    limit = slip_limit(row, new)
    if new == 0.0 and old == 0.0 and old1 == 0.0 and old2 == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    more = new - old
    more1, more2 = -old1, -old2
    slip = row[SLIP_COMPLIANCE]
    if limit > 0.0:
        new1 = (old1 - (across - row[DRIFT]) / slip) - more * row[COUPLING]
        new2 = (old2 - (along - row[DRIFT + 1]) / slip) - more * row[COUPLING + 1]
        new1, new2 = within_slip_limit(new1, new2, limit)
        more1, more2 = new1 - old1, new2 - old2
    own[0], own[1], own[2] = new, old1 + more1, old2 + more2
    apply_impulses(row, more, more1, more2, v, i, j)
    across = max(abs(more1), abs(more2))
    square = more * more + more1 * more1 + more2 * more2
    return new, max(abs(more), across), max(abs(more) * row[COMPLIANCE], across * slip), square


@inner(forceinline=True)
def _is_open(impulses):
    """Whether a contact has no impulse."""
    return impulses[0] == 0.0 and impulses[1] == 0.0 and impulses[2] == 0.0 and impulses[3] == 0.0


@inner(fastmath=FAST, error_model="numpy")
def solve(rows, twists, ids, m, law, all_impulses, members, count, velocity, still):
    """Find the impulses of ``m`` contacts by `LASTING`, `ELASTIC` or `PLASTIC`, from those on record, and the
    velocities ``NOW`` with them, of ``count`` members.

    A sweep shall change no contact's velocity by more than ``still`` [m/s]. Among many contacts a share of
    `_SLOW_SHARE` may change by more: the more contacts, the slower the slowest converges.

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
    best, v, before, along = all_impulses[BEST], velocity[NOW], velocity[BEFORE], velocity[ALONG]
    residual = found = last = load = 0.0
    least = math.inf
    end, apart, torsional = np.uint64(m), np.uint64(max(m // _APART, 1)), len(twists) > 0
    allowed, visit_all = int(_SLOW_SHARE * m), False
    for sweep in range(_SWEEPS):
        if sweep == _PLAIN_SWEEPS:
            _copy_all(m, own, previous, members, count, v, before)
        goal, most, missed = still * max(1.0, sweep / _PATIENCE), TOLERANCE * load, 0
        change = load = jump = square = 0.0
        if allowed == 0 or sweep < _PATIENCE or sweep % _OPEN_EVERY == 0:
            visit_all = True
        for first in range(apart):
            c = np.uint64(first)
            while c < end:
                if not visit_all and _is_open(own[c]):
                    c += apart
                    continue
                i, j = ids[c, 0], ids[c, 1]
                normal, changed, moved, squared = _solve_contact(rows[c], own[c], law, v, i, j)
                load, change, jump = max(load, normal), max(change, changed), max(jump, moved)
                square += squared
                missed += moved > goal or changed > most
                if torsional:
                    changed, moved = _solve_twist(rows[c], twists[c], own[c], v, i, j)
                    change, jump = max(change, changed), max(jump, moved)
                    missed += moved > goal or changed > most
                c += apart
        residual = change / load if load > 0.0 else (0.0 if change == 0.0 else 1.0)
        if allowed == 0:
            converged = residual <= TOLERANCE and jump <= goal
        else:
            converged = residual <= _SLOW_IMPULSE * TOLERANCE and jump <= _SLOW_VELOCITY * goal
            converged = converged and missed <= allowed
        if converged and visit_all:
            return residual
        visit_all = converged  # the last sweep visits all contacts
        if sweep < _PLAIN_SWEEPS:
            continue
        if square < least:
            least, found = square, residual
            _copy_impulses(m, own, best)
        elif square > _DIVERGED * least or sweep == _SWEEPS - 1:  # back to the best so far
            _change_impulses(rows, twists, ids, m, own, best, v)
            _copy_all(m, own, previous, members, count, v, before)
            last = 0.0
            continue
        share = square / last if last > 0.0 else math.inf
        # what changes alike in each sweep goes on, whichever way round-off tips it; what grows begins anew
        share = min(share, 1.0) if share <= _ALIKE else 0.0
        for c in range(0, m, 2):
            go_on(own, previous, search, share, c)
        for a in range(count):
            go_on(v, before, along, share, members[a])
        last = square
    return found


@inner(forceinline=True)
def _copy_impulses(m, impulses, to):
    """Copy the impulses of ``m`` contacts, two at once."""
    for c in range(0, m, 2):
        copy_eight(impulses, to, c)


@inner(forceinline=True)
def _copy_all(m, impulses, to, members, count, v, before):
    """Copy the impulses of ``m`` contacts and the velocities of ``count`` members."""
    _copy_impulses(m, impulses, to)
    for a in range(count):
        copy_eight(v, before, members[a])


@inner(fastmath=FAST, error_model="numpy")
def _change_impulses(rows, twists, ids, m, own, new, v):
    """Put ``new`` impulses in place of ``own``; the velocities follow."""
    for c in range(m):
        more, more1, more2 = new[c, 0] - own[c, 0], new[c, 1] - own[c, 1], new[c, 2] - own[c, 2]
        apply_impulses(rows[c], more, more1, more2, v, ids[c, 0], ids[c, 1])
        for d in range(3):
            own[c, d] = new[c, d]
        if len(twists) > 0:
            apply_moment(twists[c], new[c, 3] - own[c, 3], v, ids[c, 0], ids[c, 1])
            own[c, 3] = new[c, 3]


@inner(forceinline=True)
def next_patch(rows, first, m):
    """Where the patch of contacts that begins at ``first`` ends, and its deepest contact, of ``m``."""
    last, deepest = first + 1, first
    while last < m and rows[last, FIRST] == 0.0:
        if rows[last, GAP] < rows[deepest, GAP]:
            deepest = last
        last += 1
    return last, deepest


@inner(fastmath=FAST, error_model="numpy")
def find_leads(rows, ids, m, h, v):
    """Find for each contact the one of its patch with whose normal speed it is damped.

    ``v`` are the velocities at the end of an interval of ``h`` seconds.

    That is the deepest, if the contact is so near to it that a round body would touch with both: when such a
    body rolls, its spheres ahead come down and those behind go up, which changes no depth. Others are damped
    with their own speed.
    """
    first = 0
    while first < m:
        last, lead = next_patch(rows, first, m)
        i, j = ids[lead, 0], ids[lead, 1]
        w = 0.0
        for k in range(3, 6):
            w += (v[i, k] - v[j, k]) ** 2 if j >= 0 else v[i, k] ** 2
        near, w = rows[lead, ROLL_REACH], math.sqrt(w)
        near = near * w if h * w * near * near > _ROLLED * 2.0 * ROLL_DEPTH else 0.0
        speed = contact_speeds(rows[lead], v, i, j)[0] if near > 0.0 else 0.0
        for c in range(first, last):
            rows[c, LEAD] = c
            if near > 0.0 and abs(contact_speeds(rows[c], v, i, j)[0] - speed) < near:
                rows[c, LEAD] = lead
        first = last


@inner(fastmath=FAST, error_model="numpy")
def solve_lasting(
    rows, twists, ids, counts, all_impulses, members, count, velocity, factor, h, dt, threshold
):
    """Find all contacts' impulses over an interval ``h`` [s], and the velocities ``NOW`` at its end.

    ``factor`` is the stiffness's (`contact_model.shallow_factor`). `find_leads` says by which speeds contacts
    are damped; those that stay open are not. What is faster than ``threshold`` [m/s] need be known less well.
    Returns the residual (`solve`).
    """
    m, start, free, v = counts[CONTACTS], velocity[START], velocity[FREE], velocity[NOW]
    impulses = all_impulses[LASTING]
    fastest = 0.0
    for c in range(m):
        row, i, j = rows[c], ids[c, 0], ids[c, 1]
        before, _, _ = contact_speeds(row, start, i, j)
        end, across, along = contact_speeds(row, free, i, j)
        lead = int(row[LEAD])
        rolling = 0.0
        if lead != c:
            rolling = end - contact_speeds(rows[lead], free, i, j)[0]
        slip = max(abs(across - row[DRIFT]), abs(along - row[DRIFT + 1]))
        fastest = max(fastest, max(abs(before), abs(end)), slip)
        # overlap beyond what the last force explains has no energy to give back: it goes slowly
        loaded = row[FORCE] > 0.0
        explained = shallow_depth(row[FORCE], row[RADIUS], factor) if loaded and factor > 0.0 else 0.0
        begun = row[GAP] - h * (0.5 * (before + end) - rolling)
        row[GAP] += max(-explained - _SLACK - RECOVERY * h - begun, 0.0)
        # damping pushes at nothing that stays open
        row[DAMPING_TIME] = 0.0 if row[GAP] > 0.0 else _DAMPING * dt
        _couple(row, j)
        row[WAY] = 0.5 * h + row[DAMPING_TIME]
        row[DEPTH] = -row[GAP] + 0.5 * h * end + row[DAMPING_TIME] * rolling
        row[GROWTH], row[STRENGTH] = balance(h, row[WAY] * row[COMPLIANCE], row[RADIUS], factor)
        for d in range(3):
            impulses[c, d] = h * row[FORCE + d]
        impulses[c, 3] = 0.0
        if loaded:
            apply_impulses(row, impulses[c, 0], impulses[c, 1], impulses[c, 2], v, i, j)
    still = _STILL * fastest + _MOVING * max(fastest - threshold, 0.0)
    return solve(rows, twists, ids, m, LASTING, all_impulses, members, count, velocity, still)


@inner
def work_done(rows, twists, ids, m, impulses, before, after):
    """Kinetic energy that impulses add [J], and the sum of its terms' sizes: impulses times mean speeds."""
    total = size = 0.0
    for c in range(m):
        for d in range(3):
            if impulses[c, d] != 0.0:
                i, j = ids[c, 0], ids[c, 1]
                speed = contact_speed(rows[c], d, before, i, j) + contact_speed(rows[c], d, after, i, j)
                total += 0.5 * impulses[c, d] * speed
                size += abs(impulses[c, d] * speed)
        if len(twists) > 0 and impulses[c, 3] != 0.0:
            i, j = ids[c, 0], ids[c, 1]
            spin = contact_spin(rows[c], before, i, j) + contact_spin(rows[c], after, i, j)
            total += 0.5 * impulses[c, 3] * spin
            size += abs(impulses[c, 3] * spin)
    return total, size


@inner(noinline=True)
def solve_impact(rows, twists, ids, counts, all_impulses, members, count, velocity, threshold):
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
        _couple(row, ids[c, 1])
        speed, _, _ = contact_speeds(row, start, ids[c, 0], ids[c, 1])
        fastest = max(fastest, abs(speed))
        closes = -speed > impact_speed(row[RESTITUTION], threshold)
        row[TARGET] = -row[RESTITUTION] * speed if closes else 0.0
        for d in range(4):
            elastic[c, d] = plastic[c, d] = 0.0
    still = _STILL * fastest + _MOVING * max(fastest - threshold, 0.0)
    residual = solve(rows, twists, ids, m, ELASTIC, all_impulses, members, count, velocity, still)
    gain, size = work_done(rows, twists, ids, m, elastic, start, v)
    if gain <= _GAIN * size:
        return residual
    for a in range(count):
        for k in range(6):
            v[members[a], k] = start[members[a], k]
    plain = solve(rows, twists, ids, m, PLASTIC, all_impulses, members, count, velocity, still)
    residual = max(residual, plain)
    base, _ = work_done(rows, twists, ids, m, plastic, start, v)
    slope = 0.0
    for c in range(m):
        for d in range(3):
            slope += (elastic[c, d] - plastic[c, d]) * contact_speed(rows[c], d, v, ids[c, 0], ids[c, 1])
        if len(twists) > 0:
            slope += (elastic[c, 3] - plastic[c, 3]) * contact_spin(rows[c], v, ids[c, 0], ids[c, 1])
    share = 0.0
    if base < 0.0:
        curve = gain - base - slope  # energy is base + slope s + curve s^2 of the share s
        share = 2.0 * -base / (slope + math.sqrt(max(slope * slope - 4.0 * curve * base, 0.0)))
        share = min(max(share, 0.0), 1.0)
    for c in range(m):
        normal = share * (elastic[c, 0] - plastic[c, 0])
        first, second = share * (elastic[c, 1] - plastic[c, 1]), share * (elastic[c, 2] - plastic[c, 2])
        apply_impulses(rows[c], normal, first, second, v, ids[c, 0], ids[c, 1])
        elastic[c, 0], elastic[c, 1] = plastic[c, 0] + normal, plastic[c, 1] + first
        elastic[c, 2] = plastic[c, 2] + second
        if len(twists) > 0:
            moment = share * (elastic[c, 3] - plastic[c, 3])
            apply_moment(twists[c], moment, v, ids[c, 0], ids[c, 1])
            elastic[c, 3] = plastic[c, 3] + moment
    return residual
