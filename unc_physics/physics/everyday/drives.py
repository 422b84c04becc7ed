"""What moves bodies from outside: paths, attachments, wrenches, gravity, drag and damping."""

import math

from ...compiler import inner
from ...spatial.layout import P, Q, V, W
from ...spatial.rotation import conjugate, log, multiply, normalized, rotate_by_quaternion
from ...spatial.vectors import dot, minus, plus, three, times
from ..actions import ROUND_OFF, acting_for, bound_pace, follows, write_carried, write_hold, write_on_path
from .columns import (
    ACCEL,
    CENTRE,
    DECAY,
    DRIVEN,
    GRAVITY,
    IBODY,
    IMASS,
    IWORLD,
    MOVED,
    OWN_IMASS,
    QUIET,
    RADIUS,
    REACH,
    ROT,
    SPIN,
    STATE,
    SURGE,
    TILTED,
    TURNED,
    VEL,
)
from .motion import pose, quaternion, symmetric_times, turn, write


@inner
def is_held(j, begin, actions, held):
    """Return whether body j is attached to another one from a time on."""
    early = ROUND_OFF * max(abs(begin), 1.0)
    return actions.carrier[j] >= 0 and held[j, 0] - early <= begin < held[j, 1] - early


@inner
def next_change(begin, end, actions, held):
    """Return when next a body is attached or released, or a path begins or ends; at most ``end``."""
    first = end
    early = ROUND_OFF * max(abs(end), 1.0)
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        for k in range(2):
            if follows(j, actions):
                t = actions.time[actions.path[j, 0]] if k == 0 else actions.time[actions.path[j, 1] - 1]
            else:
                t = held[j, k]
            if begin + early < t < end - early:
                first = min(first, t)
    return first


@inner
def _on_own_path(out, row, j, t, actions, shift):
    """Write the state of body j on its path, which may be shifted, at a time into a row of ``out``."""
    write_on_path(out, row, j, t, actions)
    if shift[j, 6] == 1.0 and shift[j, 0] == 0.0 and shift[j, 1] == 0.0 and shift[j, 2] == 0.0:
        return
    q = shift[j, 3], shift[j, 4], shift[j, 5], shift[j, 6]
    p = rotate_by_quaternion(q, three(out, row, P))
    v, w = rotate_by_quaternion(q, three(out, row, V)), rotate_by_quaternion(q, three(out, row, W))
    r = normalized(multiply(q, (out[row, Q], out[row, Q + 1], out[row, Q + 2], out[row, Q + 3])))
    for k in range(3):
        out[row, P + k], out[row, V + k], out[row, W + k] = p[k] + shift[j, k], v[k], w[k]
    for k in range(4):
        out[row, Q + k] = r[k]


@inner
def _state_at(out, row, j, t, Y, actions, own):
    """Write the state of a driven body at a time into a row of ``out`` (4, 13); row 3 is scratch."""
    if follows(j, actions):
        _on_own_path(out, row, j, t, actions, own.shift)
        return
    carrier = actions.carrier[j]
    if follows(carrier, actions):
        _on_own_path(out, 3, carrier, t, actions, own.shift)
    else:
        for k in range(13):
            out[3, k] = Y[carrier, STATE + k]
    write_carried(out, row, out, 3, own.hold[j])


@inner(noinline=True)
def begin_drives(begin, end, Y, actions, own, states):
    """Note which bodies are driven in a step, and put them where they begin; ``states`` is scratch."""
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        path = follows(j, actions)
        if not path and not is_held(j, begin, actions, own.held):
            if Y[j, DRIVEN] > 0.0:
                Y[j, DRIVEN], Y[j, IMASS] = 0.0, Y[j, OWN_IMASS]
                pose(Y, j)
            continue
        k = j if path else actions.carrier[j]
        if not path:
            for x in range(13):
                states[0, x], states[3, x] = Y[j, STATE + x], Y[k, STATE + x]
            if follows(k, actions):
                _on_own_path(states, 3, k, begin, actions, own.shift)
            write_hold(states, 0, states, 3, own.hold[j])
        Y[j, DRIVEN], Y[j, IMASS], Y[j, SURGE], Y[j, REACH] = 1.0, 0.0, 0.0, 0.0
        if follows(k, actions):
            arm = 0.0
            if not path:
                hold = own.hold[j]
                arm = math.sqrt(hold[0] * hold[0] + hold[1] * hold[1] + hold[2] * hold[2])
            pace, Y[j, SURGE] = bound_pace(k, begin, end, arm + Y[j, RADIUS], actions)
            Y[j, REACH] = (end - begin) * pace
        _state_at(states, 0, j, begin + ROUND_OFF * (end - begin), Y, actions, own)
        for x in range(13):
            Y[j, STATE + x] = states[0, x]
        pose(Y, j)


@inner(noinline=True)
def drive(at, until, Y, actions, own, states):
    """Fill where driven bodies are at one time, since the step's start, and their velocities at another."""
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if Y[j, DRIVEN] == 0.0:
            continue
        _state_at(states, 0, j, at, Y, actions, own)
        _state_at(states, 1, j, until, Y, actions, own)
        q = states[0, Q], states[0, Q + 1], states[0, Q + 2], states[0, Q + 3]
        way = log(multiply(q, conjugate(quaternion(Y, j))))
        write(Y, j, MOVED, minus(three(states, 0, P), three(Y, j, CENTRE)))
        write(Y, j, TURNED, way)
        write(Y, j, TILTED, way)
        write(Y, j, VEL, three(states, 1, V))
        write(Y, j, SPIN, three(states, 1, W))


@inner(noinline=True)
def end_drives(end, Y, actions, own, states):
    """Put driven bodies where they end the step."""
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if Y[j, DRIVEN] > 0.0:
            _state_at(states, 0, j, end, Y, actions, own)
            for x in range(13):
                Y[j, STATE + x] = states[0, x]
            pose(Y, j)


@inner
def _slowed(v, i, begin, h, Y, actions):
    """Return a velocity of body i after half of the drag within h from a time on; exact for any time."""
    for u in range(len(actions.wrench_body)):
        if actions.wrench_body[u] == i and actions.wrench_drag[u] > 0.0:
            time = max(0.5 * acting_for(u, begin, begin + h, actions), 0.0)
            v = times(1.0 / (1.0 + time * Y[i, IMASS] * actions.wrench_drag[u] * math.sqrt(dot(v, v))), v)
    return v


@inner(noinline=True, error_model="numpy")
def accelerate(i, Y, begin, h, par, actions):
    """Change the velocities of body i by gravity, wrenches, drag and damping within h from a time on.

    Half of the drag comes before the rest, half after it, so that errors are of second order.
    """
    kept, gain = 1.0, h
    if par[DECAY] > 0.0:
        kept = math.exp(-par[DECAY] * h)
        gain = (1.0 - kept) / par[DECAY]
    v = _slowed(three(Y, i, VEL), i, begin, h, Y, actions)
    v = plus(times(kept, v), times(gain, _gravity(par)))
    w = times(kept, three(Y, i, SPIN))
    for u in range(len(actions.wrench_body)):
        time = acting_for(u, begin, begin + h, actions) if actions.wrench_body[u] == i else 0.0
        if time <= 0.0 or actions.wrench_drag[u] > 0.0:
            continue
        force, torque = three(actions.wrench, u, 0), three(actions.wrench, u, 3)
        if actions.wrench_local[u]:
            force, torque = turn(Y, i, ROT, force), turn(Y, i, ROT, torque)
        v = plus(v, times(time * Y[i, IMASS], force))
        w = plus(w, times(time, symmetric_times(Y, i, IWORLD, torque)))
    write(Y, i, VEL, _slowed(v, i, begin, h, Y, actions))
    write(Y, i, SPIN, w)


@inner
def _gravity(par):
    """Return gravity in the world [m/s^2]."""
    return par[GRAVITY], par[GRAVITY + 1], par[GRAVITY + 2]


@inner(noinline=True, error_model="numpy")
def plan_forces(bodies, begin, end, Y, par, actions):
    """Fill accelerations by gravity and forces, and bound the change of velocity without contacts.

    A body on which a force acts is awake.
    """
    dt, g = end - begin, _gravity(par)
    pace = math.sqrt(dot(g, g))
    for i in range(bodies):
        if Y[i, IMASS] > 0.0:
            write(Y, i, ACCEL, g)
            Y[i, SURGE] = pace * dt
    for u in range(len(actions.wrench_body)):
        i, time = actions.wrench_body[u], acting_for(u, begin, end, actions)
        if time <= 0.0 or Y[i, IMASS] == 0.0 or actions.wrench_drag[u] > 0.0:
            continue
        Y[i, QUIET] = 0.0
        force, torque = three(actions.wrench, u, 0), three(actions.wrench, u, 3)
        spin = 0.0
        for k in range(6):  # the norm of the inverse inertia
            spin += (1.0 if k < 3 else 2.0) * Y[i, IBODY + k] * Y[i, IBODY + k]
        turn_rate = Y[i, RADIUS] * math.sqrt(spin * dot(torque, torque))
        Y[i, SURGE] += time * (Y[i, IMASS] * math.sqrt(dot(force, force)) + turn_rate)
        if actions.wrench_local[u]:
            force = turn(Y, i, ROT, force)
        write(Y, i, ACCEL, plus(three(Y, i, ACCEL), times(Y[i, IMASS] * time / dt, force)))
