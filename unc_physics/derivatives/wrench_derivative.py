"""Derivative of free motion with wrenches (`implicit_step.travel_freely`).

Half of their impulses come before the motion, half after it.
"""

import math

from ..compiler import inner
from ..dynamics.actions import acting_for
from ..spatial.layout import ER, ERROR, EV, EW
from ..spatial.rotation import cross, rotate, write_matrix
from ..spatial.vectors import dot, minus, plus, put, three, times, triple, vector
from .flight_derivative import fly_errors, in_world


@inner
def fly_pushed_errors(v, w, q, i, h, end, decay, world, errors):
    """Propagate errors as `fly_errors`, with the wrenches on body i, for ``h`` seconds until ``end``."""
    pushed = len(world.environment.actions.wrench_body) > 0
    begin, kept, first = errors.begin, errors.kept, ERROR * errors.block[i]
    if pushed:
        for c in range(begin.shape[1]):
            put(kept, 0, c, vector(begin, first + EV, c))
            put(kept, 3, c, vector(begin, first + EW, c))
        write_matrix(q, errors.R, 0)
        v, w = push_errors(begin, v, w, i, end - h, end, world, errors)
    turned = fly_errors(v, w, q, i, h, decay, world, errors)
    if pushed:
        write_matrix(turned, errors.R, 0)
        v = plus(times(decay, v), times(h, triple(world.gravity, 0)))
        push_errors(errors.end, v, w, i, end - h, end, world, errors)
        for c in range(begin.shape[1]):  # lasting contacts use the velocity before the wrenches
            put(begin, first + EV, c, vector(kept, 0, c))
            put(begin, first + EW, c, vector(kept, 3, c))


@inner
def push_errors(rows, v, w, i, begin, end, world, errors):
    """Propagate body i's errors in ``rows`` through half of the wrenches' impulses (`actions.push`).

    The interval is from ``begin`` to ``end``; its length and end change with the columns. The body's rotation
    matrix is in ``errors.R``. Returns the velocities after it.
    """
    actions, bodies, first = world.environment.actions, world.bodies, ERROR * errors.block[i]
    inverse, inverse_mass = bodies.inverse_inertia[i], bodies.inverse_mass[i]
    for u in range(len(actions.wrench_body)):
        time = 0.5 * acting_for(u, begin, end, actions)
        if actions.wrench_body[u] != i or time <= 0.0:
            continue
        if actions.wrench_drag[u] > 0.0:
            v = _slow_errors(rows, v, time, inverse_mass * actions.wrench_drag[u], first, errors)
            continue
        local = actions.wrench_local[u]
        force, torque = three(actions.wrench, u, 0), three(actions.wrench, u, 3)
        if local:
            force = rotate(errors.R[0], force[0], force[1], force[2])
            torque = rotate(errors.R[0], torque[0], torque[1], torque[2])
        push, spin = times(inverse_mass, force), in_world(errors.R[0], inverse, torque)
        begins = begin > actions.wrench_time[u, 0]
        ends = end < actions.wrench_time[u, 1]
        for c in range(rows.shape[1]):
            later = 0.0
            if ends:
                later -= 0.5 * errors.left[c]
            if begins:
                later += 0.5 * (errors.left[c] + errors.length[c])
            t = vector(rows, first + ER, c)
            dv, dw = times(later, push), plus(times(later, spin), times(time, cross(t, spin)))
            if local:
                dv = plus(dv, times(time, cross(t, push)))
            else:
                dw = minus(dw, times(time, in_world(errors.R[0], inverse, cross(t, torque))))
            put(rows, first + EV, c, plus(vector(rows, first + EV, c), dv))
            put(rows, first + EW, c, plus(vector(rows, first + EW, c), dw))
        v, w = plus(v, times(time, push)), plus(w, times(time, spin))
    return v, w


@inner
def _slow_errors(rows, v, time, drag, first, errors):
    """Propagate errors in ``rows`` through drag for a time, half of an interval; return the new velocity.

    ``drag`` is that of `Actions.wrench_drag` over the mass [1/m].
    """
    pace = math.sqrt(dot(v, v))
    kept = 1.0 / (1.0 + time * drag * pace)
    for c in range(rows.shape[1]):
        dv, less = vector(rows, first + EV, c), 0.0
        if pace > 0.0:
            less = kept * kept * drag * (0.5 * errors.length[c] * pace + time * dot(v, dv) / pace)
        put(rows, first + EV, c, minus(times(kept, dv), times(less, v)))
    return times(kept, v)
