"""Derivative of free motion with wrenches (`implicit_step.travel_freely`).

Half of their impulses come before the motion, half after it.
"""

from ..compiler import inner
from ..dynamics.actions import acting_for
from ..spatial.layout import ER, ERROR, EV, EW
from ..spatial.rotation import cross, rotate, write_matrix
from ..spatial.vectors import minus, plus, put, three, times, vector
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
    inverse = bodies.inverse_inertia[i]
    for u in range(len(actions.wrench_body)):
        time = 0.5 * acting_for(u, begin, end, actions)
        if actions.wrench_body[u] != i or time <= 0.0:
            continue
        local = actions.wrench_local[u]
        force, torque = three(actions.wrench, u, 0), three(actions.wrench, u, 3)
        if local:
            force = rotate(errors.R[0], force[0], force[1], force[2])
            torque = rotate(errors.R[0], torque[0], torque[1], torque[2])
        push, spin = times(bodies.inverse_mass[i], force), in_world(errors.R[0], inverse, torque)
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
