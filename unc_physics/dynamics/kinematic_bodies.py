"""Kinematic bodies in the implicit step: on paths, or attached to another body.

Contacts treat them as infinitely heavy, with the velocity of their motion. The set of kinematic bodies may
change between steps and differ between rollouts. So the workspace stores which bodies move freely.
"""

import numpy as np

from ..collision.implicit_workspace import CLEARANCE, FREE, NOW, PACE, START, SURGE
from ..compiler import inner
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import conjugate, exp, log, multiply, normalized, write_matrix
from .actions import ROUND_OFF, bound_pace, bound_push, follows, write_carried, write_hold, write_on_path

_INSTANT = 1e-9  # s: too short to compute velocities from displacements


@inner(noinline=True)
def begin_kinematic(x, begin, rest_steps, world, work):
    """Place kinematic bodies at the beginning of a step, and determine which bodies move freely in it."""
    actions, bodies, dt = world.environment.actions, world.bodies, world.dt
    numbers, moving = work.numbers, work.moving
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if follows(j, actions):
            write_on_path(x, j, j, begin, actions)
            pace = bound_pace(j, begin, begin + dt, bodies.radius[j], actions)
            numbers[j, PACE], numbers[j, SURGE] = pace
        else:
            carrier, early = actions.carrier[j], ROUND_OFF * dt
            start, stop = actions.held[j, 0], actions.held[j, 1]
            if begin < start - early or begin >= stop - early:
                _set_free(j, bodies, work)
            else:
                hold = work.hold[j]
                write_hold(x, j, x, carrier, hold)
                rest_steps[j] = 0
                numbers[j, CLEARANCE] = -np.inf  # clearances from before the attachment are invalid
                if stop < begin + dt:
                    _set_free(j, bodies, work)
                    _release(x, j, stop - begin, begin, world, work)
                else:
                    moving[j] = False
                    work.inverse_mass[j] = 0.0
                    for a in range(3):
                        for b in range(3):
                            work.inverse_inertia[j, a, b] = 0.0
                    write_carried(x, j, x, carrier, hold)
                    arm = np.sqrt(hold[0] * hold[0] + hold[1] * hold[1] + hold[2] * hold[2])
                    if follows(carrier, actions):
                        pace = bound_pace(carrier, begin, begin + dt, arm + bodies.radius[j], actions)
                    else:
                        pace = 0.0, 0.0
                    numbers[j, PACE], numbers[j, SURGE] = pace
        write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), work.R, j)
    for i in range(len(x)):
        if moving[i]:
            numbers[i, SURGE] = bound_push(i, begin, begin + dt, bodies, actions)


@inner(forceinline=True)
def _set_free(j, bodies, work):
    work.moving[j], work.inverse_mass[j] = True, bodies.inverse_mass[j]


@inner
def _release(x, j, left, begin, world, work):
    """Give body j, released ``left`` seconds into the step, an equivalent state at the step's beginning.

    Free flight from there leads to the state at the time of release.
    """
    actions, dt, at_release = world.environment.actions, world.dt, work.carried
    write_kinematic(at_release, 0, x, j, begin + left, actions, work)
    whole, rest = world.decay, world.decay ** ((dt - left) / dt)
    spin = rest / whole
    q = (at_release[0, Q], at_release[0, Q + 1], at_release[0, Q + 2], at_release[0, Q + 3])
    back = exp(-left * at_release[0, W], -left * at_release[0, W + 1], -left * at_release[0, W + 2])
    q = normalized(multiply(back, q))
    for k in range(4):
        x[j, Q + k] = q[k]
    for k in range(3):
        v, g = at_release[0, V + k], world.gravity[k]
        last = rest * v + (dt - left) * g
        end = at_release[0, P + k] + 0.5 * (dt - left) * (v + last)
        first = (last - dt * g) / whole
        x[j, P + k], x[j, V + k] = end - 0.5 * dt * (first + last), first
        x[j, W + k] = spin * at_release[0, W + k]


@inner
def write_kinematic(out, row, x, j, time, actions, work):
    """Write the state of kinematic body j at a time into a row of ``out``, other than its row of ``x``."""
    if follows(j, actions):
        write_on_path(out, row, j, time, actions)
    else:
        carrier = actions.carrier[j]
        if follows(carrier, actions):
            write_on_path(work.carried, 1, carrier, time, actions)
            write_carried(out, row, work.carried, 1, work.hold[j])
        else:
            write_carried(out, row, x, carrier, work.hold[j])


@inner
def place_kinematic(x, count, time, world, work):
    """Move kinematic bodies that may touch the current group to their states at a time."""
    actions = world.environment.actions
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if not work.moving[j] and near_group(j, count, work):
            write_kinematic(x, j, x, j, time, actions, work)
            write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), work.R, j)


@inner(forceinline=True)
def near_group(j, count, work):
    """Return whether body j may touch the current group, of ``count`` members."""
    found = False
    for a in range(count):
        found = found or work.near[work.members[a], j]
    return found


@inner
def read_kinematic(x, count, world, work):
    """Write the velocities of kinematic bodies that may touch the current group as `START` and `NOW`."""
    actions, velocity = world.environment.actions, work.velocity
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if not work.moving[j]:
            for k in range(3):
                velocity[START, j, k] = velocity[NOW, j, k] = x[j, V + k]
                velocity[START, j, 3 + k] = velocity[NOW, j, 3 + k] = x[j, W + k]


@inner
def drive(x, count, end, h, world, work):
    """Move kinematic bodies that may touch the current group for ``h`` seconds, until ``end``.

    Contacts use the mean of the velocities at both ends. The start velocity is chosen so that this mean
    equals the displacement over ``h``.
    """
    actions, velocity, before = world.environment.actions, work.velocity, work.carried
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if work.moving[j] or not near_group(j, count, work):
            continue
        for k in range(13):
            before[2, k] = x[j, k]
        write_kinematic(x, j, x, j, end, actions, work)
        write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), work.R, j)
        turn = log(
            multiply(
                (x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]),
                conjugate((before[2, Q], before[2, Q + 1], before[2, Q + 2], before[2, Q + 3])),
            )
        )
        for k in range(3):
            v, w = x[j, V + k], x[j, W + k]
            velocity[FREE, j, k] = velocity[NOW, j, k] = v
            velocity[FREE, j, 3 + k] = velocity[NOW, j, 3 + k] = w
            if h > _INSTANT:
                velocity[START, j, k] = 2.0 * (x[j, P + k] - before[2, P + k]) / h - v
                velocity[START, j, 3 + k] = 2.0 * turn[k] / h - w
            else:
                velocity[START, j, k], velocity[START, j, 3 + k] = v, w


@inner
def end_kinematic(x, end, world, work):
    """Place kinematic bodies at the end of a step."""
    actions = world.environment.actions
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if not work.moving[j]:
            write_kinematic(x, j, x, j, end, actions, work)
            write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), work.R, j)


@inner
def is_kinematic(i, world, work):
    """Return whether a moving kinematic body, a wrench, or a moving surface may act on body i."""
    found = work.numbers[i, SURGE] > 0.0
    actions = world.environment.actions
    if len(actions.surface) > 0:
        entry = work.head[i]
        while entry >= 0:
            e = -1 - work.old_contact[entry, 1]
            if e >= 0:
                for k in range(6):
                    found = found or actions.surface[e, k] != 0.0
            entry = work.link[entry]
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        found = found or (work.near[i, j] and not work.moving[j] and work.numbers[j, PACE] > 0.0)
    return found
