"""The step: read `take_step`, which shows it from begin to end, then `_advance`, which moves one group."""

import math
from typing import NamedTuple

import numpy as np

from ...compiler import inner
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ACCEL,
    ARM_BEFORE,
    ASLEEP,
    BELT_U,
    BELT_W,
    BEND,
    BODY_A,
    BODY_B,
    CONTACTS,
    CUT,
    CUTS,
    DIRECT_MOST,
    DIRECTS,
    DRIVEN,
    GAP,
    GAP0,
    GROUP,
    HELD,
    IMASS,
    IMPULSE,
    LN,
    LONG,
    LONGEST,
    MEMBERS,
    MODE,
    MOVED,
    MU,
    NORMAL,
    OPPOSITE,
    PUSH_V,
    PUSH_W,
    QUIET,
    RADIUS,
    RATIO,
    REACH,
    ROLLS,
    SETTLED,
    SLEEP,
    SLEEP_AFTER,
    SLOP,
    SPIN,
    SQUEEZED,
    STANDS,
    START,
    SUBSTEPS,
    SURFACE_A,
    SWEEPS,
    TILTED,
    TOLERANCE,
    TRAVEL,
    TURN,
    TURNED,
    VEL,
    VISITS,
    WARM,
    WARM_MOMENT,
    WAY,
    WENT,
)
from .contacts import approach, complete, find, forget, most_elastic, note, remember, spread
from .direct import solve_directly
from .drives import accelerate, begin_drives, drive, end_drives, plan_forces
from .groups import group_contacts, members_of
from .impacts import impacts, landing
from .motion import free_turn, move, roll_arm, write
from .search import FULL, Search, Solids
from .solve import HOLDS, WAITS, bear, keep_warm, push_out, slides, solve, start_warm

_END = 1e-9  # share of a step that is no step
_WITHIN = 1.0 + 1e-9  # share of a cone of friction that is within it: round-off
_AT_ONCE = 1e-6  # share of a step within which an impact is now


class Own(NamedTuple):
    """What belongs to one rollout alone."""

    par: np.ndarray  # (SETTINGS,)
    materials: np.ndarray  # (MATERIALS, S + P)
    held: np.ndarray  # (B, 2): times of attachment and release [s]
    shift: np.ndarray  # (B, 7): displacement and rotation of paths
    hold: np.ndarray  # (B, 7): poses of attached bodies in those of their carriers
    key: int  # for random errors
    squeezed: np.ndarray  # (B, 3): as in `rollouts.ContactMemory`


class Work(NamedTuple):
    """Arrays that a rollout works with; `columns` names their columns."""

    Y: np.ndarray  # (nb, BODY)
    found: np.ndarray  # (rooms, REMEMBERED): contacts as the search finds them
    C: np.ndarray  # (rooms, COLS): contacts by groups; after a step those of the step
    groups: np.ndarray  # (GROUPS, nb + 2) int64
    matrix: np.ndarray  # (UNKNOWNS + 1, UNKNOWNS + 1): scratch of the direct solution
    states: np.ndarray  # (4, 13): scratch of the drives
    solids: Solids
    search: Search
    count: np.ndarray  # (COUNTS,) int64


@inner
def take_step(before, bodies, begin, end, actions, own, work):
    """Take one step from begin to end.

    Parameters
    ----------
    before : int
        Number of contacts remembered in ``work.C``.
    bodies : int
        Number of the scene's bodies; the rows after them are fixed.
    begin, end : float
        [s].
    actions : Actions
    own : Own
    work : Work

    Returns
    -------
    int
        Number of contacts, now in ``work.C``, or `search.FULL`: then more room is needed, and nothing has
        changed.
    """
    Y, C, groups, solids = work.Y, work.C, work.groups, work.solids
    if _all_stay(bodies, end - begin, Y, actions):
        _bear(0, before, C, end - begin)
        return before
    begin_drives(begin, end, Y, actions, own, work.states)
    plan_forces(bodies, begin, end, Y, own.par, actions)
    dt, e = end - begin, most_elastic(own.materials)
    n = find(bodies, dt, before, e, Y, solids, work.found, C, work.search, work.count)
    if n == FULL:
        return FULL
    work.count[CONTACTS] += n
    forget(before, C, work.search)
    _start(bodies, Y)
    number = group_contacts(bodies, n, work.found, C, Y, groups)
    complete(n, C, Y, solids, actions.surface, own.materials)
    for j in range(number):
        members = groups[MEMBERS, : members_of(bodies, j, groups)]
        first, last = groups[START, j], groups[START, j + 1]
        if _rests(first, last, members, C, Y, end - begin) or _asleep(first, last, members, C, Y, own.par):
            _stop(members, Y)
            _bear(first, last, C, end - begin)
        else:
            _advance(first, last, members, begin, end, actions, own, work)
    _fly(bodies, begin, end, Y, groups, actions, own)
    end_drives(end, Y, actions, own, work.states)
    _count_ways(bodies, end - begin, Y, groups)
    remember(n, C, Y, work.search)
    return n


@inner
def _advance(first, last, members, begin, end, actions, own, work):
    """Move one group through the step, with the contacts found at its start.

    A substep ends early at the first impact; the next one begins with it. Then: half a move, impulses with
    the points and masses of the middle, half a move.
    """
    Y, C, par, states, dt = work.Y, work.C, own.par, work.states, end - begin
    now, longest, cuts, driven = begin, dt, max(CUTS // len(members), 1), len(actions.kinematic) > 0
    if dt > LONGEST or _turns(members, Y, dt):
        longest = dt / SUBSTEPS
    while end - now > _END * dt:
        h = min(longest, end - now)
        if driven:
            drive(now, now + _AT_ONCE * dt, Y, actions, own, states)
        soon, deep = _refresh(first, last, C, Y, h, True)
        if soon <= _AT_ONCE * dt or (soon <= h and cuts == 0):
            impacts(first, last, C, Y, par, own.key, work.count)
            soon, deep = _refresh(first, last, C, Y, h, False)
        if _AT_ONCE * dt < soon <= h and cuts > 0:
            h, cuts = soon, cuts - 1
            work.count[CUT] += 1
        else:
            _let_all_hold(first, last, C)
        if end - now - h < _END * dt:
            h = end - now
        _drift(members, Y, 0.5 * h, False)
        if driven:
            drive(now + 0.5 * h, now + h - _END * dt, Y, actions, own, states)
        _prepare(first, last, members, C, Y, 0.5 * h)
        for i in members:
            accelerate(i, Y, now, h, par, actions)
        start_warm(first, last, C, Y, h)
        _hold(first, last, members, C, Y, h, work.matrix, work.count)
        note(first, last, C)
        if deep:
            push_out(first, last, members, C, Y, h)
        _drift(members, Y, 0.5 * h, deep)
        if h > LONG * longest:
            keep_warm(first, last, C, h)
        now += h
    if par[SLEEP] > 0.0:
        _keep_awake(first, last, C, Y)


@inner
def _turns(members, Y, dt):
    """Return whether a body of a group turns so far within a step that levers change."""
    for i in members:
        w = three(Y, i, SPIN)
        if dot(w, w) * dt * dt > TURN * TURN:
            return True
    return False


@inner
def _start(bodies, Y):
    """Count displacements from here, after a search."""
    for i in range(bodies):
        for at in (MOVED, TURNED, TILTED):
            write(Y, i, at, (0.0, 0.0, 0.0))
        if Y[i, ROLLS] > 0.0:
            write(Y, i, ARM_BEFORE, roll_arm(Y, i))


@inner(error_model="numpy")
def _meets(C, k, u, acc, h):
    """Return when within h a contact's gap closes faster than contacts land; infinite if it does not."""
    s, slow = C[k, GAP], landing(C, k)
    if s <= 0.0:
        return 0.0 if u < -slow else math.inf
    root = u * u - 2.0 * acc * s
    if root <= slow * slow:
        return math.inf
    t = 2.0 * s / (math.sqrt(root) - u)
    return t if 0.0 < t <= h else math.inf


@inner(noinline=True)
def _refresh(first, last, C, Y, h, moved):
    """Bring the gaps of a group's contacts up to date; return when an impact is, and whether any is deep.

    Contacts that have an impact within h wait. Unless bodies have ``moved`` only their velocities are new.
    """
    soon, deep = math.inf, False
    for k in range(first, last):
        a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
        u, gap = approach(C, k, Y, h, moved)
        acc = three(Y, b, ACCEL)
        if Y[a, IMASS] > 0.0:
            acc = minus(acc, three(Y, a, ACCEL))
        t = _meets(C, k, u, dot(acc, three(C, k, NORMAL)) + C[k, BEND], h)
        if C[k, GAP] < math.inf:
            # what falls and does not get here, or leaves, goes by the mean of its velocities now and then
            C[k, GAP] = max(gap, 2.0 * gap + h * u) if t > h and abs(u) > landing(C, k) else gap
        C[k, MODE] = WAITS if t <= h else HOLDS
        soon = min(soon, t)
        deep = deep or gap < -SLOP
    return soon, deep


@inner
def _let_all_hold(first, last, C):
    """Let contacts that waited for an impact take part: no substep ends there."""
    for k in range(first, last):
        C[k, MODE] = HOLDS


@inner
def _drift(members, Y, h, pushed):
    """Move a group's bodies for h, half a substep; all that takes out depth in the substep comes at once."""
    for i in members:
        v, w = three(Y, i, VEL), three(Y, i, SPIN)
        if pushed:
            v, w = plus(v, times(2.0, three(Y, i, PUSH_V))), plus(w, times(2.0, three(Y, i, PUSH_W)))
        move(Y, i, h, v[0], v[1], v[2], w[0], w[1], w[2])


@inner
def _prepare(first, last, members, C, Y, t):
    """Fill moments and masses of contacts for the present poses, to stop their points at t from now."""
    for i in members:
        free_turn(Y, i)
    for k in range(first, last):
        spread(C, k, Y, t)


@inner
def _hold(first, last, members, C, Y, h, matrix, count):
    """Find contact impulses: by sweeps, and where these run out and masses differ much, directly."""
    r = solve(SWEEPS, first, last, C, Y, h, TOLERANCE)
    count[VISITS] += r * (last - first)
    if r == SWEEPS and 1 < last - first <= DIRECT_MOST:
        light, heavy = 0.0, math.inf  # inverse masses
        for i in members:
            light, heavy = max(light, Y[i, IMASS]), min(heavy, Y[i, IMASS])
        if light > RATIO * heavy:
            count[DIRECTS] += 1
            count[SETTLED] += solve_directly(first, last, C, Y, h, matrix)


@inner(noinline=True)
def _rests(first, last, members, C, Y, dt):
    """Return whether a group stays where it is: all is slow, and the forces of its contacts hold its bodies.

    To compute it would give the same up to the tolerance of the sweeps.
    """
    for i in members:
        if Y[i, QUIET] == 0.0 or _pace(Y, i, VEL, SPIN) > STANDS:
            return False
        write(Y, i, PUSH_V, three(Y, i, ACCEL))
        write(Y, i, PUSH_W, (0.0, 0.0, 0.0))
    for k in range(first, last):
        a = int(C[k, BODY_A])
        if C[k, WENT] > STANDS * dt or (Y[a, DRIVEN] > 0.0 and Y[a, REACH] > 0.0) or _on_belt(C, k):
            return False
        if C[k, WARM + 1] ** 2 + C[k, WARM + 2] ** 2 > (_WITHIN * C[k, MU] * C[k, WARM]) ** 2:
            return False
        approach(C, k, Y, dt, True)
        bear(Y, C, k, three(C, k, WARM), three(C, k, WARM_MOMENT), PUSH_V, PUSH_W)
    for i in members:
        if _pace(Y, i, PUSH_V, PUSH_W) > HELD:
            return False
    return True


@inner
def _on_belt(C, k):
    """Return whether the surface of a contact's first body moves along itself, or turns, under the second."""
    w = three(C, k, BELT_W)
    return C[k, BELT_U + 1] != 0.0 or C[k, BELT_U + 2] != 0.0 or dot(w, w) > 0.0


@inner
def _pace(Y, i, v, w):
    """Return a bound of the speed of body i's points, from the velocities in columns v and w."""
    a, b = three(Y, i, v), three(Y, i, w)
    return math.sqrt(dot(a, a)) + Y[i, RADIUS] * math.sqrt(dot(b, b))


@inner
def _asleep(first, last, members, C, Y, par):
    """Return whether a group sleeps. What drives or carries on keeps it awake."""
    if par[SLEEP] == 0.0:
        return False
    for i in members:
        if Y[i, QUIET] <= SLEEP_AFTER:
            return False
    bears = False
    for k in range(first, last):
        a = int(C[k, BODY_A])
        bears = bears or C[k, WARM] > 0.0
        if Y[a, REACH] > 0.0 and Y[a, DRIVEN] > 0.0:
            return False
        if _on_belt(C, k):
            return False
    return bears  # not so after the search of what was moved from outside


@inner
def _keep_awake(first, last, C, Y):
    """Let bodies that slide on something begin their time at rest anew, however slowly they do."""
    for k in range(first, last):
        if slides(Y, C, k):
            Y[int(C[k, BODY_A]), QUIET] = Y[int(C[k, BODY_B]), QUIET] = 0.0


@inner
def _stop(members, Y):
    """Take what is left of the velocities of a group that stays where it is."""
    for i in members:
        write(Y, i, VEL, (0.0, 0.0, 0.0))
        write(Y, i, SPIN, (0.0, 0.0, 0.0))


@inner
def _all_stay(bodies, dt, Y, actions):
    """Return whether no body moves or did in the last step, so that all stay; count their time at rest."""
    if len(actions.kinematic) + len(actions.wrench_body) + len(actions.surface) > 0:
        return False
    for i in range(bodies):
        v, w = three(Y, i, VEL), three(Y, i, SPIN)
        if Y[i, WAY] > 0.0 or dot(v, v) + dot(w, w) > 0.0:
            return False
    for i in range(bodies):
        Y[i, QUIET] += dt if Y[i, IMASS] > 0.0 else 0.0
    return True


@inner
def _bear(first, last, C, dt):
    """Note the impulses of contacts that stay as they were."""
    for k in range(first, last):
        write(C, k, IMPULSE, (0.0, 0.0, 0.0))
        write(C, k, LN, times(dt, three(C, k, WARM)))
    note(first, last, C)


@inner
def _fly(bodies, begin, end, Y, groups, actions, own):
    """Move the bodies without contact."""
    for i in range(bodies):
        if Y[i, IMASS] > 0.0 and groups[GROUP, i] < 0:
            v, w = three(Y, i, VEL), three(Y, i, SPIN)
            accelerate(i, Y, begin, end - begin, own.par, actions)
            v = times(0.5, plus(v, three(Y, i, VEL)))
            w = times(0.5, plus(w, three(Y, i, SPIN)))
            move(Y, i, end - begin, v[0], v[1], v[2], w[0], w[1], w[2])


@inner
def _count_ways(bodies, dt, Y, groups):
    """Note the ways travelled and times at rest."""
    for i in range(bodies):
        Y[i, WAY] = 0.0
        if Y[i, DRIVEN] > 0.0:
            Y[i, WAY], Y[i, QUIET] = Y[i, REACH], 0.0
        elif Y[i, IMASS] > 0.0:
            d, e, v, w = three(Y, i, MOVED), three(Y, i, TURNED), three(Y, i, VEL), three(Y, i, SPIN)
            Y[i, WAY] = math.sqrt(dot(d, d)) + Y[i, RADIUS] * math.sqrt(dot(e, e))
            if groups[GROUP, i] < 0:
                Y[i, WAY] = Y[i, REACH]
            pace = dot(v, v) + Y[i, RADIUS] ** 2 * dot(w, w)
            still = groups[GROUP, i] >= 0 and pace < ASLEEP * ASLEEP
            Y[i, QUIET] = Y[i, QUIET] + dt if still else 0.0
        Y[i, TRAVEL] += Y[i, WAY]


@inner
def note_contacts(n, bodies, time, C, first_time):
    """Note a time as that of the first contact of pairs that have none yet and that touch."""
    for k in range(n):
        if dot(three(C, k, IMPULSE), three(C, k, NORMAL)) > 0.0:
            i, j = int(C[k, BODY_B]), int(C[k, SURFACE_A])
            low, high = min(i, j), max(i, j)
            first_time[low, high] = min(first_time[low, high], time)


@inner(noinline=True)
def note_squeezes(n, C, Y, squeezed):
    """Note the most by which bodies were squeezed between two that do not give way, one of them driven.

    The depths of opposite contacts add up: nothing else can hold both. The two are noted by their surfaces.
    """
    for k in range(n):
        a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
        if C[k, GAP0] > -SQUEEZED or Y[a, IMASS] > 0.0:
            continue
        for m in range(n):
            other = int(C[m, BODY_A])
            same = C[m, BODY_B] == b and Y[other, IMASS] == 0.0 and C[m, GAP0] < 0.0
            driven = Y[a, DRIVEN] > 0.0 or Y[other, DRIVEN] > 0.0
            if same and driven and dot(three(C, k, NORMAL), three(C, m, NORMAL)) < -OPPOSITE:
                depth = -C[k, GAP0] - C[m, GAP0]
                if depth > squeezed[b, 0]:
                    write(squeezed, b, 0, (depth, C[k, SURFACE_A], C[m, SURFACE_A]))
