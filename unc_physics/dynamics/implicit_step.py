"""The implicit step, group by group: search, impacts at their own times, lasting contacts, motion.

A group is a set of bodies that may touch in the step. It moves to its first impact, where impulses change
velocities instantaneously, then to the next. There are at most `_IMPACTS`, or `_MOST_IMPACTS` of contacts
that would become deep or are elastic. The remaining interval is one solution of the lasting contacts. Groups
are computed independently.
"""

import math

import numpy as np

from ..collision.contact_model import shallow_factor
from ..collision.contact_parts import find_parts, mark_part, move_contact
from ..collision.contact_patch import (
    IMPACT_GAP,
    add_contacts,
    element_candidates,
    pair_candidates,
    patch_tilt,
)
from ..collision.contact_row import AXIS, GAP, RESTITUTION
from ..collision.contact_search import (
    ACTIVE_GAP,
    clearance,
    find_groups,
    forget_lists,
    list_members,
    pair_of,
    update_pace,
)
from ..collision.contact_simd import contact_speeds
from ..collision.element_contacts import in_element
from ..collision.implicit_workspace import (
    CONTACTS,
    ELASTIC,
    FREE,
    FREE_POSITION,
    FREE_QUATERNION,
    LASTING,
    NO_OVERFLOW,
    NOW,
    OVERFLOW,
    PACE,
    REMEMBERED,
    REMEMBERED_CONTACTS,
    START,
    START_POSITION,
    START_QUATERNION,
    TOO_LONG_LISTS,
    TRAVEL,
)
from ..collision.shapes import surface
from ..compiler import inner, kernel
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import rotate, write_matrix
from .actions import push
from .free_motion import integrate_gyroscopic, integrate_rotation
from .friction import holds, weaken_with_speed
from .impact_error import disturb, is_drawn
from .impact_time import (
    LIVELY,
    TOUCHING,
    closes_fast,
    impact_before,
    impact_now,
    impact_speed,
    landing_speed,
    may_land,
    settle,
    speed_before,
    time_to_impact,
)
from .implicit_solver import find_leads, solve_impact, solve_lasting
from .implicit_stages import after_impact, after_travel, before_step, on_sleep, undo_step
from .implicit_world import Rollout
from .kinematic_bodies import (
    begin_kinematic,
    drive,
    end_kinematic,
    is_kinematic,
    place_kinematic,
    read_kinematic,
)
from .middle_arms import push_in_the_middle

#: Impact speed: the largest of a speed [m/s], the speed after a fall from a height [m], and gravity's change
#: of speed in a number of steps. Without gravity nothing needs to come to rest, so that even the slowest
#: approach is an impact.
_SLOWEST_IMPACT, _LOWEST_FALL, _IMPACT_STEPS = 1e-5, 5e-4, 2.5
#: Limits per step of a group: impacts, and searches for them. Beyond these, only contacts that `must_collide`
#: have impacts, up to the second limits. A light body between heavy ones has many. The rest become lasting
#: contacts.
_IMPACTS, _CUTS = 4, 16
_MOST_IMPACTS, _MOST_CUTS = 64, 256
#: Share of an interval to which it is shortened before contacts that close all the time are `settled`.
_SETTLED = 0.2
#: Distance within which no contact can begin and end undetected [m].
_SHORT_WAY = 4e-3
# sleep: speed [m/s], number of contacts
_QUIET_SPEED, _QUIET_CONTACTS = 2e-3, 3
# share of the friction limit; a body does not fall asleep if all contacts exceed it and creep
_HOLDING = 0.99


@inner
def travel_freely(x, i, h, end, decay, world, R):
    """Move body i for ``h`` seconds, until ``end``, without contacts; its angular momentum is conserved.

    The path is a parabola. Updates ``R`` (B, 3, 3). Half of the wrenches' impulses come before the motion,
    half after it.
    """
    gravity, pushed = world.gravity, len(world.environment.actions.wrench_body) > 0
    if pushed:
        push(x, i, end - h, end, 0.5, world.bodies, R, world.environment.actions)
    for k in range(3):
        v = decay * x[i, V + k] + h * gravity[k]
        x[i, P + k] += 0.5 * h * (x[i, V + k] + v)
        x[i, V + k] = v
    if world.environment.gyroscopic:
        integrate_gyroscopic(x, i, h, world.bodies, R)
    else:
        integrate_rotation(x, i, h, world.bodies.radius, R)
    for k in range(3):
        x[i, W + k] *= decay
    if pushed:
        push(x, i, end - h, end, 0.5, world.bodies, R, world.environment.actions)


@inner(noinline=True)
def find_contacts(x, count, since, horizon, limit, speeds_only, world, work):
    """Find the contacts of the current group, of ``count`` members.

    Their gaps are below ``limit`` [m], now or within ``horizon`` seconds. ``since`` is the time that members
    have moved since the last update of `TRAVEL` [s]. ``speeds_only`` is as in `contact_patch.write_contact`.
    """
    work.counts[CONTACTS] = 0
    members, numbers, moving = work.members, work.numbers, work.moving
    radius = world.bodies.radius
    for a in range(count):
        i = members[a]
        tilt = patch_tilt(x, i, -1, since)
        need = max(limit, ACTIVE_GAP) + (since + horizon) * numbers[i, PACE]
        if len(world.environment.kind) > 0 and clearance(x, i, world, work) < need:
            for e in range(len(world.environment.kind)):
                px, py, pz = in_element(
                    world.environment.position, world.environment.R, e, x[i, P], x[i, P + 1], x[i, P + 2]
                )
                if (
                    surface(world.environment.kind, world.environment.size, e, px, py, pz)[0]
                    < radius[i] + need
                ):
                    found = element_candidates(x, i, e, limit, horizon, world, work)
                    if found > 0:
                        add_contacts(x, i, -1 - e, found, tilt, speeds_only, world, work)
        for k in range(work.neighbor_count[i]):
            j = np.int64(work.neighbor[i, k])
            if j > i or not moving[j]:  # each pair of moving bodies once
                found = pair_candidates(x, i, j, limit, horizon, world, work)
                if found > 0:
                    add_contacts(x, i, j, found, patch_tilt(x, i, j, since), speeds_only, world, work)


@inner(forceinline=True)
def prepare_members(x, count, world, work):
    """Write the inverse inertias of the group's members, in world axes."""
    members, R, bodies = work.members, work.R, world.bodies
    for a in range(count):
        i = members[a]
        Ri, out = R[i], work.inverse_inertia[i]
        for k in range(3):
            u, v, w = rotate(bodies.inverse_inertia[i], Ri[k, 0], Ri[k, 1], Ri[k, 2])
            out[0, k], out[1, k], out[2, k] = rotate(Ri, u, v, w)


@inner
def _read_velocities(x, count, members, velocity):
    """Write the members' velocities as `START` and `NOW`."""
    for a in range(count):
        i = members[a]
        for k in range(3):
            velocity[START, i, k] = velocity[NOW, i, k] = x[i, V + k]
            velocity[START, i, 3 + k] = velocity[NOW, i, 3 + k] = x[i, W + k]


@inner(forceinline=True)
def _takes_part(row, i, j, threshold, v):
    """Return whether a contact takes part in a neighbouring impact.

    Elastic contacts act in sequence: one that does not touch and close yet has a separate impact later.
    """
    if row[RESTITUTION] < LIVELY:
        return row[GAP] <= IMPACT_GAP
    speed = contact_speeds(row, v, i, j)[0]
    return row[GAP] <= TOUCHING and speed < -impact_speed(row[RESTITUTION], threshold)


@inner(noinline=True)
def collide(x, count, time, impact, rollout, world, method, work):
    """Apply the impulses of an impact to the contacts that it reaches.

    ``impact`` is its number among the impacts of the group in the step.
    """
    members, ids, counts, part, velocity = work.members, work.ids, work.counts, work.part, work.velocity
    rows, threshold, kept = work.rows, rollout.threshold, 0
    for c in range(counts[CONTACTS]):
        if _takes_part(rows[c], ids[c, 0], ids[c, 1], threshold, velocity[START]):
            move_contact(c, kept, work)
            kept += 1
    counts[CONTACTS], kept = kept, 0
    find_parts(IMPACT_GAP, work)
    for c in range(counts[CONTACTS]):
        if part[ids[c, 0]] < 0:
            speed = speed_before(c, START, 0.0, threshold, world, work)
            if closes_fast(c, speed, threshold, world, work):
                mark_part(ids[c, 0], part)
    for c in range(counts[CONTACTS]):  # keep the contacts that the impact reaches
        if part[ids[c, 0]] > 0:
            move_contact(c, kept, work)
            kept += 1
    counts[CONTACTS] = kept
    if world.implicit.impact_slipperiness > 0.0:
        weaken_with_speed(world.implicit.impact_slipperiness, work)
    if is_drawn(world.implicit.impact_error):
        step = round((time - world.start) / world.dt)
        disturb(step, impact, len(x), rollout.key, world.implicit.impact_error, work)
    worst = solve_impact(count, threshold, work)
    after_impact(method, world, work)
    for c in range(kept):
        if work.impulses[ELASTIC, c, 0] > 0.0:
            note_contact(rollout.first_time, ids[c, 0], ids[c, 1], time)
    for a in range(count):
        i = members[a]
        if part[i] > 0:
            rollout.residual[i] = max(rollout.residual[i], worst)
            for k in range(3):
                x[i, V + k], x[i, W + k] = velocity[NOW, i, k], velocity[NOW, i, 3 + k]
            update_pace(x, i, world.bodies.radius[i], world.gravity, world.dt, work.numbers)


@inner(forceinline=True)
def note_contact(first_time, i, j, time):
    """Record that body i touches body j, or element ``-1 - j``."""
    low, high = pair_of(i, j, len(first_time))
    first_time[low, high] = min(first_time[low, high], time)


@inner(noinline=True)
def travel_to_contacts(x, count, h, end, touching, world, work):
    """Move the current group freely for ``h`` seconds, until ``end``, and find its lasting contacts there.

    All contact geometry is at the interval's end, as it would be without contacts. A contact is included if
    its gap is at most the change from holding a body against gravity. Without ``touching`` no contacts are
    searched.
    """
    members, velocity, numbers, loaded = work.members, work.velocity, work.numbers, work.loaded
    decay = world.decay if h == world.dt else world.decay ** (h / world.dt)
    for a in range(count):
        i = members[a]
        loaded[i] = 0
        work.holds[i] = False
        for k in range(3):
            numbers[i, START_POSITION + k] = x[i, P + k]
            velocity[START, i, k], velocity[START, i, 3 + k] = x[i, V + k], x[i, W + k]
        for k in range(4):
            numbers[i, START_QUATERNION + k] = x[i, Q + k]
        travel_freely(x, i, h, end, decay, world, work.R)
        for k in range(3):
            velocity[FREE, i, k] = velocity[NOW, i, k] = x[i, V + k]
            velocity[FREE, i, 3 + k] = velocity[NOW, i, 3 + k] = x[i, W + k]
            numbers[i, FREE_POSITION + k] = x[i, P + k]
        for k in range(4):
            numbers[i, FREE_QUATERNION + k] = x[i, Q + k]
    work.counts[CONTACTS] = 0
    if len(world.environment.actions.kinematic) > 0:
        drive(x, count, end, h, world, work)
    if touching:
        prepare_members(x, count, world, work)
        g = world.gravity
        limit = max(IMPACT_GAP, h * h * math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]))
        find_contacts(x, count, h, 0.0, limit, False, world, work)


@inner(forceinline=True)
def _travel_back(x, count, begin, world, work):
    """Undo `travel_to_contacts`, which began at time ``begin``."""
    numbers, velocity = work.numbers, work.velocity
    for a in range(count):
        i = work.members[a]
        for k in range(3):
            x[i, P + k] = numbers[i, START_POSITION + k]
            x[i, V + k], x[i, W + k] = velocity[START, i, k], velocity[START, i, 3 + k]
        for k in range(4):
            x[i, Q + k] = numbers[i, START_QUATERNION + k]
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
    if len(world.environment.actions.kinematic) > 0:
        place_kinematic(x, count, begin, world, work)


@inner(noinline=True)
def push_apart(x, count, h, time, rollout, world, method, work):
    """Apply the lasting contacts to the group, over the ``h`` seconds that it moved to them."""
    members, velocity, numbers, loaded = work.members, work.velocity, work.numbers, work.loaded
    m, residual = work.counts[CONTACTS], rollout.residual
    if m > 0:
        impulses = work.impulses[LASTING]
        g = world.gravity
        fall = world.dt * world.dt * math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
        find_leads(work.rows, work.ids, m, world.dt, fall, velocity[FREE])
        push_in_the_middle(h, fall, world, work)
        worst = solve_lasting(count, shallow_factor(world.stiffness), h, world.dt, rollout.threshold, work)
        for c in range(m):
            i, j = work.ids[c, 0], work.ids[c, 1]
            if impulses[c, 0] > 0.0:
                note_contact(rollout.first_time, i, j, time)
                held = holds(work.rows[c], impulses[c], _HOLDING)
                loaded[i] += 1
                residual[i] = max(residual[i], worst)
                work.holds[i] = work.holds[i] or held
                if j >= 0 and work.moving[j]:
                    loaded[j] += 1
                    residual[j] = max(residual[j], worst)
                    work.holds[j] = work.holds[j] or held
    for a in range(count):
        i = members[a]
        if loaded[i] > 0:
            for k in range(3):
                x[i, P + k] = numbers[i, START_POSITION + k] + 0.5 * h * (
                    velocity[START, i, k] + velocity[NOW, i, k]
                )
                x[i, V + k] = velocity[NOW, i, k]
                x[i, W + k] = 0.5 * (velocity[START, i, 3 + k] + velocity[NOW, i, 3 + k])
            for k in range(4):
                x[i, Q + k] = numbers[i, START_QUATERNION + k]
            integrate_rotation(x, i, h, world.bodies.radius, work.R)
            for k in range(3):
                x[i, W + k] = velocity[NOW, i, 3 + k]
        _add_travel(x, i, h, velocity[START], numbers, world.bodies.radius[i])
    after_travel(method, world, work)


@inner(forceinline=True)
def _add_travel(x, i, h, start, numbers, radius):
    """Update the travel of body i's points in an interval, and their current speed."""
    v = w = u = o = 0.0
    for k in range(3):
        v += x[i, V + k] ** 2
        w += x[i, W + k] ** 2
        u += start[i, k] ** 2
        o += start[i, 3 + k] ** 2
    now, then = math.sqrt(v) + radius * math.sqrt(w), math.sqrt(u) + radius * math.sqrt(o)
    numbers[i, TRAVEL] += h * max(now, then)


@inner(forceinline=True)
def fastest_closing(x, count, world, work):
    """Return an upper bound on closing speeds in the current group in this step [m/s]."""
    if len(world.environment.actions.kinematic) > 0:
        return math.inf
    numbers, first, second = work.numbers, 0.0, 0.0
    for a in range(count):
        pace = numbers[work.members[a], PACE]
        if pace > first:
            first, second = pace, first
        elif pace > second:
            second = pace
    return first + second


@inner(noinline=True)
def advance_group(x, count, time, rollout, world, method, work):
    """Advance the current group by one step: from impact to impact, then to the step's end.

    With ``horizon`` 0 contacts are selected by their gaps alone, for an impact.
    """
    left = horizon = world.dt
    threshold, slowest = rollout.threshold, rollout.slowest
    impacts = cuts = 0
    kinematic = len(world.environment.actions.kinematic) > 0
    if kinematic:  # another group may have moved them
        place_kinematic(x, count, time - left, world, work)
    for a in range(count):
        work.settled[work.members[a]] = False
    # ``looked``: contacts of this pose were selected by their gaps alone, and none was an impact. ``near``:
    # the time of the first impact among them.
    looked, near = False, left
    # search for impacts before a group moves, not only among the contacts at its new pose
    careful = method is not None
    if count == 1 and may_land(work.members[0], work):
        slowest = min(slowest, landing_speed(world.dt, threshold))
    while left > 0.0 and world.implicit.stop[0] == 0:
        until = left
        touching = True
        work.counts[CONTACTS] = 0
        closing = fastest_closing(x, count, world, work)
        collides = closing > slowest
        # then few contacts have impacts, and all of these are searched
        careful = careful or cuts >= _CUTS
        searched = horizon == 0.0 or (collides and (careful or closing * left > _SHORT_WAY))
        if searched:
            speeds_only = method is None and horizon > 0.0 and not looked
            if not speeds_only:
                prepare_members(x, count, world, work)
            limit = IMPACT_GAP if horizon == 0.0 else ACTIVE_GAP
            find_contacts(x, count, 0.0, horizon, limit, speeds_only, world, work)
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                break
            touching = work.counts[CONTACTS] > 0
        limited = impacts >= _IMPACTS or cuts >= _CUTS
        may_collide = impacts < _MOST_IMPACTS and cuts < _MOST_CUTS
        if work.counts[CONTACTS] > 0 and may_collide:
            _read_velocities(x, count, work.members, work.velocity)
            if kinematic:
                read_kinematic(x, count, world, work)
            now = impact_now(left, threshold, limited, world, work)
            if now and (horizon == 0.0 or looked):  # a deeper opening contact can hide a closing one
                collide(x, count, time, impacts, rollout, world, method, work)
                impacts += 1
                for a in range(count):
                    work.settled[work.members[a]] = False
                looked = False
                horizon = left
                continue
            if horizon == 0.0:
                looked = True
                near = time_to_impact(left, threshold, limited, world, work)
                horizon = left
                continue
            if now:
                horizon = 0.0
                cuts += 1
                continue
            until = time_to_impact(left, threshold, limited, world, work)
            if looked:  # contacts that become deeper may hide those that touch first
                until = min(until, near)
        elif horizon == 0.0:
            looked, near = True, left
            horizon = left
            continue
        end = time - left + until
        travel_to_contacts(x, count, until, end, touching, world, work)
        if work.counts[OVERFLOW] != NO_OVERFLOW:
            break
        if collides and may_collide:
            first, whole = impact_before(until, threshold, limited, world, work), until
            if first < until and not searched:
                _travel_back(x, count, time - left, world, work)
                careful = True
                continue
            if first == 0.0 and not looked:  # contact from the beginning
                _travel_back(x, count, time - left, world, work)
                horizon = 0.0
                cuts += 1
                continue
            while first < until:  # the path to the impact was not straight
                again = first == 0.0  # no contact touched at the beginning: the time is unknown
                first = 0.5 * until if again else first
                _travel_back(x, count, time - left, world, work)
                until = first
                end = time - left + until
                travel_to_contacts(x, count, until, end, True, world, work)
                if work.counts[OVERFLOW] != NO_OVERFLOW or not again:
                    break
                cuts += 1
                first = impact_before(until, threshold, limited, world, work)
                if first == 0.0 and until < _SETTLED * whole:
                    settle(until, threshold, world, work)
                    break
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                break
        push_apart(x, count, until, time, rollout, world, method, work)
        if until >= left:
            _remember(left, work)
            break
        left -= until
        horizon = 0.0
        looked = False
        cuts += 1


@inner(forceinline=True)
def _remember(h, work):
    """Add the loaded contacts to this step's memory; the entries of each body i are contiguous."""
    contact, force, counts = work.new_contact, work.new_force, work.counts
    impulses = work.impulses[LASTING]
    body, own = -1, 0
    for c in range(counts[CONTACTS]):
        if work.ids[c, 0] != body:
            body, own = work.ids[c, 0], 0
        if impulses[c, 0] <= 0.0 or own == REMEMBERED_CONTACTS:
            continue
        own += 1
        n = counts[REMEMBERED]
        counts[REMEMBERED] = n + 1
        row = work.rows[c]
        for k in range(4):
            contact[n, k] = work.ids[c, k]
        force[n, 0] = impulses[c, 0] / h
        for k in range(3):
            force[n, 1 + k] = (impulses[c, 1] * row[AXIS + k] + impulses[c, 2] * row[2 * AXIS + k]) / h


@inner
def _keep_memory(i, work):
    """Keep the remembered contacts of the sleeping body i."""
    entry, counts = work.head[i], work.counts
    while entry >= 0:
        n = counts[REMEMBERED]
        counts[REMEMBERED] = n + 1
        for k in range(4):
            work.new_contact[n, k] = work.old_contact[entry, k]
            work.new_force[n, k] = work.old_force[entry, k]
        entry = work.link[entry]


@inner
def _all_sleep(rest_steps, world, work):
    """Return whether all moving bodies sleep, and nothing can wake them."""
    actions = world.environment.actions
    if world.implicit.rest_steps == 0 or len(actions.kinematic) + len(actions.wrench_body) > 0:
        return False
    if len(actions.surface) > 0:
        return False
    for i in range(len(rest_steps)):
        if work.moving[i] and rest_steps[i] < world.implicit.rest_steps:
            return False
    return True


@inner(noinline=True)
def advance_step(x, time, rollout, world, method, work):
    """Advance all groups by one step; return early if room overflows (`OVERFLOW`)."""
    rest_steps = rollout.rest_steps
    numbers, group, members = work.numbers, work.group, work.members
    moving, bodies, dt = work.moving, world.bodies, world.dt
    actions = world.environment.actions
    acted = len(actions.kinematic) + len(actions.wrench_body) + len(actions.surface) > 0
    if acted:
        begin_kinematic(x, time - dt, rest_steps, world, work)
    for i in range(len(x)):
        if moving[i]:
            if world.decay == 0.0:  # damping removes all velocity in each step
                for k in range(3):
                    x[i, V + k] = x[i, W + k] = 0.0
            update_pace(x, i, bodies.radius[i], world.gravity, dt, numbers)
    find_groups(x, world, work)
    list_members(work)
    work.counts[REMEMBERED] = 0
    for i in range(len(x)):
        if not moving[i] or group[i] != i:
            continue
        count, asleep, j = 0, world.implicit.rest_steps > 0, i
        while j >= 0:
            members[count] = j
            count += 1
            asleep = asleep and rest_steps[j] >= world.implicit.rest_steps
            if acted and asleep:
                asleep = not is_kinematic(j, world, work)
            j = work.next_member[j]
        if asleep:
            for a in range(count):
                _keep_memory(members[a], work)
                on_sleep(method, members[a], work)
                for k in range(3):
                    x[members[a], V + k] = x[members[a], W + k] = 0.0
            continue
        if count == 1:
            alone = (
                len(world.environment.kind) == 0
                or clearance(x, i, world, work) >= dt * numbers[i, PACE] + ACTIVE_GAP
            )
            if alone and work.neighbor_count[i] == 0:
                numbers[i, TRAVEL] += dt * numbers[i, PACE]
                rest_steps[i] = 0
                travel_freely(x, i, dt, time, world.decay, world, work.R)
                continue
        advance_group(x, count, time, rollout, world, method, work)
        if work.counts[OVERFLOW] != NO_OVERFLOW:
            return
        if world.implicit.rest_steps > 0:
            for a in range(count):
                j = members[a]
                update_pace(x, j, bodies.radius[j], world.gravity, 0.0, numbers)
                rests = (
                    numbers[j, PACE] < _QUIET_SPEED and work.loaded[j] >= _QUIET_CONTACTS and work.holds[j]
                )
                rest_steps[j] = rest_steps[j] + 1 if rests else 0
    if acted:
        end_kinematic(x, time, world, work)


@kernel
def rollout_of(first_time, memory, n, world):
    """Return the memory of rollout ``n`` of a `SolverMemory`, with the speeds of impacts in this world."""
    gravity = math.sqrt(world.gravity[0] ** 2 + world.gravity[1] ** 2 + world.gravity[2] ** 2)
    threshold = max(
        _SLOWEST_IMPACT, math.sqrt(2.0 * gravity * _LOWEST_FALL), _IMPACT_STEPS * gravity * world.dt
    )
    slowest = threshold
    for e in range(len(world.implicit.restitution)):
        slowest = min(slowest, impact_speed(world.implicit.restitution[e], threshold))
    return Rollout(
        first_time,
        memory.contact[n],
        memory.force[n],
        memory.count[n : n + 1],
        memory.rest_steps[n],
        memory.residual[n],
        memory.key[n],
        threshold,
        slowest,
    )


@inner
def integrate(x, rollout, world, method, begin, steps, work):
    """Advance one rollout's state ``x`` (B, 13) until room overflows; return the number of steps done.

    ``method`` is the data of a propagator for the stages, or None.
    """
    contact, force, remembered = rollout.contact, rollout.force, rollout.count
    rest_steps = rollout.rest_steps
    counts, old_contact, old_force, head = work.counts, work.old_contact, work.old_force, work.head
    link, state = work.link, work.state
    for n in range(remembered[0]):
        for k in range(4):
            old_contact[n, k], old_force[n, k] = contact[n, k], force[n, k]
    for step in range(begin, begin + steps):
        if world.implicit.stop[0] != 0:
            return steps
        if method is None and _all_sleep(rest_steps, world, work):
            for i in range(len(x)):
                if work.moving[i]:
                    for k in range(3):
                        x[i, V + k] = x[i, W + k] = 0.0
            return steps
        for i in range(len(x)):
            head[i] = -1
            work.rest_steps[i] = rest_steps[i]
            for k in range(13):
                state[i, k] = x[i, k]
        for n in range(remembered[0] - 1, -1, -1):
            link[n] = head[old_contact[n, 0]]
            head[old_contact[n, 0]] = n
        for attempt in range(2):
            counts[OVERFLOW] = NO_OVERFLOW
            before_step(method, x, step, world, work)
            time = world.start + (step + 1) * world.dt
            advance_step(x, time, rollout, world, method, work)
            if counts[OVERFLOW] == NO_OVERFLOW:
                break
            undo_step(method, work)
            for i in range(len(x)):
                rest_steps[i] = work.rest_steps[i]
                for k in range(13):
                    x[i, k] = state[i, k]
                write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
            if counts[OVERFLOW] != TOO_LONG_LISTS or attempt == 1:
                return step - begin
            forget_lists(work)  # outgrown lists may have filled the room
        remembered[0] = counts[REMEMBERED]
        for n in range(remembered[0]):
            for k in range(4):
                old_contact[n, k] = contact[n, k] = work.new_contact[n, k]
                old_force[n, k] = force[n, k] = work.new_force[n, k]
    return steps
