"""Contact solver for a group of bodies: lasting contacts implicit in velocity, impacts as rigid impulses.

Lasting contact over an interval h (`solve_lasting`) has two terms. The first is the paper's penalty force to
leading order in depth (`contact_model.shallow_volume`), at the depth at the interval's end. The second is the
damping time tau times the closing speed, without the normal speed r that comes from rolling::

    lambda_n = h kappa pi R d^2,   d = max(0, -g - h (v_n' - v_n*) / 2 - tau (v_n' - r))
    |lambda_t| <= mu lambda_n, opposite to slip; no slip inside
    M (v' - v*) = J^T lambda

Here v* and v' are the velocities at the end without and with contacts, and g is the gap at the end without
contacts. Bodies move by the mean of old and new velocity, so d is the depth at the end pose. Sliding
dissipates the work of friction, and contacts never add energy.

Impact (`solve_impact`): impulses with ``v_n' = -e v_n`` for closing contacts, within Coulomb's cone.

Both use block Gauss-Seidel: for each contact the normal impulse in closed form, then both tangential
impulses, projected onto the cone. For patches with torsional friction, a moment about the normal follows, up
to a length times the normal impulse. Surface velocities are included.
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
    EFFECTIVE_TIME,
    FIRST,
    FORCE,
    GAP,
    IMPULSE_SCALE,
    IN_MIDDLE,
    LEAD,
    MOMENT_I,
    MOMENT_J,
    QUADRATIC_GAIN,
    RADIUS,
    REACH,
    RESTITUTION,
    ROLL_RADIUS,
    ROLLING,
    SLIP_COMPLIANCE,
    SPIN_COMPLIANCE,
    SPIN_I,
    SPIN_J,
    TARGET,
    TURN_I,
    TURN_J,
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

#: Convergence tolerances of a sweep.
#: TOLERANCE: change of an impulse, relative to the largest normal one.
#: _STILL: change of a contact velocity, relative to the fastest contact's speed.
#: _MOVING: additional tolerance, relative to the part of that speed above the slowest impact's.
#: The tight _STILL holds light bodies under heavy ones still; fast contacts need less accuracy.
TOLERANCE, _STILL, _MOVING = 1e-3, 2e-4, 1e-3
_PLAIN_SWEEPS, _SWEEPS = 4, 200
#: Among few contacts sweeps are cheap, and light bodies under heavy ones need more of them.
_FEW, _SWEEPS_OF_FEW = 64, 2000
#: Sweeps after which the velocity tolerance grows in proportion to their number. Resting contacts converge in
#: a few sweeps; only moving ones need many.
_PATIENCE = 20.0
#: Share of the contacts whose velocity or impulse may change by more, and the largest factors. With fewer
#: than 1 / `_SLOW_SHARE` contacts there are no exceptions.
_SLOW_SHARE, _SLOW_VELOCITY, _SLOW_IMPULSE = 0.01, 16.0, 4.0
#: Among that many contacts, only one in this number of later sweeps visits contacts without an impulse.
_OPEN_EVERY = 5
#: Successive contacts of a sweep are 1 / `_APART` of the list apart. They mostly belong to different bodies,
#: so that the processor can overlap their computations.
_APART = 4
#: Overlap that contacts always push out [m], and speed at which they push out unexplained overlap [m/s].
_SLACK, RECOVERY = 2e-5, 0.05
#: Damping time of a contact, in steps; with half a step, stiff contacts come to rest in two.
_DAMPING = 0.5
#: Least depth at which spheres of a rolling body touch [m], and its limit relative to the body's radius.
_ROLL_DEPTH, _ROLL_SHARE = 2e-4, 0.01
_ROLLED = 1e-4  # rotation of a body's points in a step that changes the touching spheres [m]
#: Growth of the squared change of a sweep: up to the first value, the search direction is kept. Above the
#: second value, relative to the smallest change so far, the solver restores its best solution.
_ALIKE, _DIVERGED = 1.1, 100.0
_GAIN = 1e-9  # relative round-off of the work of an impact


@inner(forceinline=True, fastmath=FAST)
def contact_speed(row, d, v, i, j):
    """Return the velocity of body i relative to its partner along direction ``d`` of a contact [m/s]."""
    speed = contact_speeds(row, v, i, j)[d]
    return speed - row[DRIFT + d - 1] if d > 0 else speed


@inner(forceinline=True, fastmath=FAST)
def contact_spin(row, v, i, j):
    """Return the angular velocity of body i relative to its partner about a contact's normal [rad/s]."""
    s = row[0] * v[i, 3] + row[1] * v[i, 4] + row[2] * v[i, 5]
    if j >= 0:
        s -= row[0] * v[j, 3] + row[1] * v[j, 4] + row[2] * v[j, 5]
    return s


@inner(forceinline=True, fastmath=FAST)
def apply_moment(torsion, moment, v, i, j):
    """Add a moment about a contact's normal [N m s] to the bodies' angular velocities."""
    for k in range(3):
        v[i, 3 + k] += moment * torsion[SPIN_I + k]
    if j >= 0:
        for k in range(3):
            v[j, 3 + k] -= moment * torsion[SPIN_J + k]


@inner(fastmath=FAST, error_model="numpy")
def _solve_torsion(row, torsion, own, v, i, j):
    """Compute the moment that stops a contact's spin, limited by its normal impulse.

    Returns its change as an impulse [N s], and the change of spin as a velocity [m/s], both at the moment's
    reach.
    """
    reach = torsion[REACH]
    limit = spin_limit(torsion, own[0])
    if limit == 0.0 and own[3] == 0.0:
        return 0.0, 0.0
    new = own[3] - contact_spin(row, v, i, j) / torsion[SPIN_COMPLIANCE]
    new = within_spin_limit(new, limit)
    more = new - own[3]
    own[3] = new
    apply_moment(torsion, more, v, i, j)
    return abs(more) / reach, abs(more) * torsion[SPIN_COMPLIANCE] * reach


@inner(forceinline=True, error_model="numpy")
def _couple(row, j):
    """Write the coupling of a normal impulse with both tangential ones, which comes from rotation only."""
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
    """Compute a contact's impulses with all others held: the normal one, then both tangential ones.

    The tangential impulses stop slip, or are projected onto the cone.

    Returns
    -------
    normal : float
        Normal impulse [N s].
    change, jump : float
        Largest change of an impulse [N s] and of the contact's velocity [m/s].
    square : float
        Sum of squares of all changes [N^2 s^2].
    """
    old, old1, old2 = own[0], own[1], own[2]
    speed, across, along = contact_speeds(row, v, i, j)
    new = 0.0
    if law == LASTING:
        depth = row[DEPTH] - row[EFFECTIVE_TIME] * (speed - row[COMPLIANCE] * old)
        if depth > 0.0:
            new = balanced_impulse(depth, row[QUADRATIC_GAIN], row[IMPULSE_SCALE])
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
    """Return whether a contact has no impulse."""
    return impulses[0] == 0.0 and impulses[1] == 0.0 and impulses[2] == 0.0 and impulses[3] == 0.0


@inner(fastmath=FAST, error_model="numpy")
def solve(m, law, count, still, work):
    """Solve for the impulses of ``m`` contacts and the velocities ``NOW`` of the ``count`` bodies of a group.

    ``law`` is `LASTING`, `ELASTIC` or `PLASTIC`. The recorded impulses are the initial guess. A sweep must
    change no contact's velocity by more than ``still`` [m/s]. Among many contacts, a share of `_SLOW_SHARE`
    may change by more, as the slowest contact converges more slowly.

    After some plain sweeps, a step along the accumulated changes follows each sweep, as in conjugate
    gradients (Silcowitz, Niebe and Erleben 2010). The number of sweeps then grows with the root of the mass
    ratio, instead of the ratio.

    Returns
    -------
    jump : float
        Largest change of a contact's velocity in the last sweep [m/s].
    """
    rows, torsion_rows, ids, members = work.rows, work.torsion_rows, work.ids, work.members
    impulses = work.impulses
    own, previous, search, best = impulses[law], impulses[PREVIOUS], impulses[SEARCH], impulses[BEST]
    v, before, along = work.velocity[NOW], work.velocity[BEFORE], work.velocity[ALONG]
    found = last = load = 0.0
    least = math.inf
    end, apart, torsional = np.uint64(m), np.uint64(max(m // _APART, 1)), len(torsion_rows) > 0
    allowed, visit_all = int(_SLOW_SHARE * m), False
    sweeps = _SWEEPS if m > _FEW else _SWEEPS_OF_FEW
    for sweep in range(sweeps):
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
                    changed, moved = _solve_torsion(rows[c], torsion_rows[c], own[c], v, i, j)
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
            return jump
        visit_all = converged  # the last sweep visits all contacts
        if sweep < _PLAIN_SWEEPS:
            continue
        if square < least:
            least, found = square, jump
            _copy_impulses(m, own, best)
        elif square > _DIVERGED * least or sweep == sweeps - 1:  # back to the best so far
            _change_impulses(rows, torsion_rows, ids, m, own, best, v)
            _copy_all(m, own, previous, members, count, v, before)
            last = 0.0
            continue
        share = square / last if last > 0.0 else math.inf
        # keep the direction while changes stay nearly constant despite round-off; restart when they grow
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
def _change_impulses(rows, torsion_rows, ids, m, own, new, v):
    """Replace the impulses ``own`` by ``new``, and update the velocities."""
    for c in range(m):
        more, more1, more2 = new[c, 0] - own[c, 0], new[c, 1] - own[c, 1], new[c, 2] - own[c, 2]
        apply_impulses(rows[c], more, more1, more2, v, ids[c, 0], ids[c, 1])
        for d in range(3):
            own[c, d] = new[c, d]
        if len(torsion_rows) > 0:
            apply_moment(torsion_rows[c], new[c, 3] - own[c, 3], v, ids[c, 0], ids[c, 1])
            own[c, 3] = new[c, 3]


@inner(forceinline=True)
def next_patch(rows, first, m):
    """Return the end of the patch that begins at contact ``first``, and its deepest contact."""
    last, deepest = first + 1, first
    while last < m and rows[last, FIRST] == 0.0:
        if rows[last, GAP] < rows[deepest, GAP]:
            deepest = last
        last += 1
    return last, deepest


@inner(forceinline=True)
def rolling_depth(fall, radius):
    """Return the depth at which spheres of a rolling body of this ``radius`` [m] may touch [m].

    Free motion in a step makes it deeper, by ``fall``.
    """
    return max(_ROLL_DEPTH, min(fall, _ROLL_SHARE * radius))


@inner(fastmath=FAST, error_model="numpy")
def find_leads(rows, ids, m, dt, fall, v):
    """Find for each contact the contact of its patch whose normal speed determines its damping.

    ``v`` are the velocities at an interval's end, ``dt`` is the time step [s]. The lead is the deepest
    contact, if it is so near that a round body would touch at both (`rolling_depth`). When such a body
    rolls, its spheres ahead move down and those behind move up, without a change of depth. Other contacts are
    damped by their own speed.
    """
    first = 0
    while first < m:
        last, lead = next_patch(rows, first, m)
        i, j = ids[lead, 0], ids[lead, 1]
        w = 0.0
        for k in range(3, 6):
            w += (v[i, k] - v[j, k]) ** 2 if j >= 0 else v[i, k] ** 2
        radius, w = rows[lead, ROLL_RADIUS], math.sqrt(w)
        near = w * math.sqrt(2.0 * rolling_depth(fall, radius) * radius) if dt * w * radius > _ROLLED else 0.0
        speed = contact_speeds(rows[lead], v, i, j)[0] if near > 0.0 else 0.0
        for c in range(first, last):
            rows[c, LEAD] = c
            if near > 0.0 and abs(contact_speeds(rows[c], v, i, j)[0] - speed) < near:
                rows[c, LEAD] = lead
        first = last


@inner(forceinline=True)
def residual_of(jump, fastest):
    """Residual of a solution: what its last sweep changed of a contact's velocity, over the speed of the
    fastest contact without impulses.
    """
    return jump / fastest if fastest > 0.0 else 0.0


@inner(fastmath=FAST, error_model="numpy")
def solve_lasting(count, factor, h, dt, threshold, work):
    """Find all contacts' impulses over an interval ``h`` [s], and the group's velocities ``NOW`` at its end.

    ``factor`` is the stiffness factor (`contact_model.shallow_factor`). `find_leads` determines the speeds
    for damping; open contacts are not damped. Contacts faster than ``threshold`` [m/s] have a larger
    tolerance. Returns the residual (`residual_of`).
    """
    m, rows, ids, impulses = work.counts[CONTACTS], work.rows, work.ids, work.impulses[LASTING]
    start, free, v = work.velocity[START], work.velocity[FREE], work.velocity[NOW]
    fastest = 0.0
    for c in range(m):
        row, i, j = rows[c], ids[c, 0], ids[c, 1]
        before, _, _ = contact_speeds(row, start, i, j)
        end, across, along = contact_speeds(row, free, i, j)
        lead = int(row[LEAD])
        rolling = 0.0
        if row[IN_MIDDLE] > 0.0:
            rolling = row[ROLLING]
        elif lead != c:
            rolling = end - contact_speeds(rows[lead], free, i, j)[0]
        slip = max(abs(across - row[DRIFT]), abs(along - row[DRIFT + 1]))
        fastest = max(fastest, max(abs(before), abs(end)), slip)
        # overlap not explained by the last force holds no elastic energy, so it is removed slowly
        loaded = row[FORCE] > 0.0
        explained = shallow_depth(row[FORCE], row[RADIUS], factor) if loaded and factor > 0.0 else 0.0
        begun = row[GAP] - h * (0.5 * (before + end) - rolling)
        row[GAP] += max(-explained - _SLACK - RECOVERY * h - begun, 0.0)
        # contacts that stay open are not damped
        row[DAMPING_TIME] = 0.0 if row[GAP] > 0.0 else _DAMPING * dt
        _couple(row, j)
        row[EFFECTIVE_TIME] = 0.5 * h + row[DAMPING_TIME]
        row[DEPTH] = -row[GAP] + 0.5 * h * end + row[DAMPING_TIME] * rolling
        row[QUADRATIC_GAIN], row[IMPULSE_SCALE] = balance(
            h, row[EFFECTIVE_TIME] * row[COMPLIANCE], row[RADIUS], factor
        )
        for d in range(3):
            impulses[c, d] = h * row[FORCE + d]
        impulses[c, 3] = 0.0
        if loaded:
            apply_impulses(row, impulses[c, 0], impulses[c, 1], impulses[c, 2], v, i, j)
    still = _STILL * fastest + _MOVING * max(fastest - threshold, 0.0)
    jump = solve(m, LASTING, count, still, work)
    return residual_of(jump, fastest)


@inner
def work_done(rows, torsion_rows, ids, m, impulses, before, after):
    """Return the kinetic energy that impulses add [J], and the sum of the magnitudes of its terms."""
    total = size = 0.0
    for c in range(m):
        for d in range(3):
            if impulses[c, d] != 0.0:
                i, j = ids[c, 0], ids[c, 1]
                speed = contact_speed(rows[c], d, before, i, j) + contact_speed(rows[c], d, after, i, j)
                total += 0.5 * impulses[c, d] * speed
                size += abs(impulses[c, d] * speed)
        if len(torsion_rows) > 0 and impulses[c, 3] != 0.0:
            i, j = ids[c, 0], ids[c, 1]
            spin = contact_spin(rows[c], before, i, j) + contact_spin(rows[c], after, i, j)
            total += 0.5 * impulses[c, 3] * spin
            size += abs(impulses[c, 3] * spin)
    return total, size


@inner(noinline=True)
def solve_impact(count, threshold, work):
    """Compute the impulses `ELASTIC` of an impact of all current contacts, and the velocities ``NOW``.

    Newton's restitution with friction can add energy. The solution is then blended with the one without
    rebound, so that no energy is added. Both obey Coulomb's law and do not penetrate, and so does their
    blend. Returns the residual (`residual_of`).
    """
    rows, torsion_rows, ids, members = work.rows, work.torsion_rows, work.ids, work.members
    m, start, v = work.counts[CONTACTS], work.velocity[START], work.velocity[NOW]
    elastic, plastic = work.impulses[ELASTIC], work.impulses[PLASTIC]
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
    jump = solve(m, ELASTIC, count, still, work)
    residual = residual_of(jump, fastest)
    gain, size = work_done(rows, torsion_rows, ids, m, elastic, start, v)
    if gain <= _GAIN * size:
        return residual
    for a in range(count):
        for k in range(6):
            v[members[a], k] = start[members[a], k]
    jump = solve(m, PLASTIC, count, still, work)
    residual = max(residual, residual_of(jump, fastest))
    base, _ = work_done(rows, torsion_rows, ids, m, plastic, start, v)
    slope = 0.0
    for c in range(m):
        for d in range(3):
            slope += (elastic[c, d] - plastic[c, d]) * contact_speed(rows[c], d, v, ids[c, 0], ids[c, 1])
        if len(torsion_rows) > 0:
            slope += (elastic[c, 3] - plastic[c, 3]) * contact_spin(rows[c], v, ids[c, 0], ids[c, 1])
    share = 0.0
    if base < 0.0:
        curve = gain - base - slope  # energy is base + slope s + curve s^2 for a share s
        share = 2.0 * -base / (slope + math.sqrt(max(slope * slope - 4.0 * curve * base, 0.0)))
        share = min(max(share, 0.0), 1.0)
    for c in range(m):
        normal = share * (elastic[c, 0] - plastic[c, 0])
        first, second = share * (elastic[c, 1] - plastic[c, 1]), share * (elastic[c, 2] - plastic[c, 2])
        apply_impulses(rows[c], normal, first, second, v, ids[c, 0], ids[c, 1])
        elastic[c, 0], elastic[c, 1] = plastic[c, 0] + normal, plastic[c, 1] + first
        elastic[c, 2] = plastic[c, 2] + second
        if len(torsion_rows) > 0:
            moment = share * (elastic[c, 3] - plastic[c, 3])
            apply_moment(torsion_rows[c], moment, v, ids[c, 0], ids[c, 1])
            elastic[c, 3] = plastic[c, 3] + moment
    return residual
