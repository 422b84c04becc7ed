"""Errors of kinematic bodies (`kinematic_bodies`): on paths, or attached to another body.

A path's only error is its offset, which moves the whole path and attached bodies rigidly. An attached body
also has the errors of its pose in the carrier's frame. The time of an impact depends on the state, and
kinematic bodies move with time. Until the step ends, their errors therefore include their motion and
acceleration over the change of time. A released body has the errors of its pose and velocity at release; an
uncertain release time is a change of time, too.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.implicit_workspace import NOW, START
from ..compiler import inner, kernel
from ..dynamics.actions import ROUND_OFF, follows
from ..dynamics.kinematic_bodies import near_group, write_kinematic
from ..spatial.layout import EP, ER, ERROR, EV, EW, P, Q, V, W
from ..spatial.rotation import cross, rotate, rotate_back, write_matrix
from ..spatial.vectors import dot, minus, plus, put, three, times, vector
from .flight_derivative import mean_spin, turn_coefficients, turned_on

_REACH = 1e-5  # s, step of finite differences of accelerations on a path
_INSTANT = 1e-9  # s: too short to compute velocities from displacements


class KinematicErrors(NamedTuple):
    """Changes of the B bodies' motions for r columns of errors; arrays are empty without kinematic bodies.

    Attributes
    ----------
    offset : (B, 6, r) float64
        Offset of each body's path: a translation [m] and a rotation about `center` [rad], world axes.
    center : (B, 3) float64
        Start of each body's path [m].
    late : (B, r) float64
        Change of its release time [s].
    held : (B, 6, r) float64
        Change of an attached body's position and rotation in the carrier's frame, along its own axes.
    """

    offset: np.ndarray
    center: np.ndarray
    late: np.ndarray
    held: np.ndarray


@inner(forceinline=True)
def _offset(kinematic, k, point, c):
    """Return the displacement of a point by the offset of body k's path, and the rotation."""
    own, center = kinematic.offset[k], three(kinematic.center, k, 0)
    turn = vector(own, 3, c)
    return plus(vector(own, 0, c), cross(turn, minus(point, center))), turn


@inner(forceinline=True)
def _mover(j, actions):
    """Return the body whose path moves kinematic body j."""
    return j if follows(j, actions) else actions.carrier[j]


@inner(forceinline=True)
def _is_held(j, begin, world):
    """Return whether kinematic body j is attached in the step that begins then, or in a part of it."""
    actions, early = world.environment.actions, ROUND_OFF * world.dt
    return not follows(j, actions) and actions.held[j, 0] - early <= begin < actions.held[j, 1] - early


@inner(noinline=True, error_model="numpy")
def _acceleration(x, j, time, world, work):
    """Return the linear and angular acceleration of kinematic body j at a time."""
    actions, found = world.environment.actions, work.carried
    k, zero = _mover(j, actions), (0.0, 0.0, 0.0)
    if not follows(k, actions):
        return zero, zero
    first, last = actions.time[actions.path[k, 0]], actions.time[actions.path[k, 1] - 1]
    if time <= first or time >= last:
        return zero, zero
    early, later = max(time - _REACH, first), min(time + _REACH, last)
    write_kinematic(found, 0, x, j, early, actions, work)
    v, w = three(found, 0, V), three(found, 0, W)
    write_kinematic(found, 0, x, j, later, actions, work)
    share = 1.0 / (later - early)
    return times(share, minus(three(found, 0, V), v)), times(share, minus(three(found, 0, W), w))


@inner(forceinline=True)
def _write_errors(rows, j, states, row, c, later, acceleration, world, errors, kinematic):
    """Write column ``c`` of kinematic body j's errors, world axes, at its state in a row of ``states``.

    The current time is ``later`` by this amount [s]. ``errors.R`` is its rotation.
    """
    point, v, w = three(states, row, P), three(states, row, V), three(states, row, W)
    moved, turn = _offset(kinematic, _mover(j, world.environment.actions), point, c)
    own, tilt = vector(kinematic.held[j], 0, c), vector(kinematic.held[j], 3, c)
    own = rotate(errors.R[0], own[0], own[1], own[2])
    tilt = rotate(errors.R[0], tilt[0], tilt[1], tilt[2])
    first, (linear, angular) = ERROR * errors.block[j], acceleration
    put(rows, first + EP, c, plus(plus(own, moved), times(later, v)))
    put(rows, first + ER, c, plus(plus(tilt, turn), times(later, w)))
    put(rows, first + EV, c, plus(plus(cross(w, own), cross(turn, v)), times(later, linear)))
    put(rows, first + EW, c, plus(cross(turn, w), times(later, angular)))


@inner(forceinline=True)
def _turn_back(rows, first, R):
    """Convert a body's rotation errors from world axes to body axes."""
    for c in range(rows.shape[1]):
        t = vector(rows, first + ER, c)
        put(rows, first + ER, c, rotate_back(R, t[0], t[1], t[2]))


@kernel(noinline=True, arrays=False)
def begin_held_errors(root, begin, world, work, errors, kinematic):
    """Store the pose errors of attached bodies at a step's beginning, and release bodies within the step.

    ``work.state`` is the state at the step's beginning, ``root`` the errors there.
    """
    actions, x, R = world.environment.actions, work.state, errors.R
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if not _is_held(j, begin, world):
            continue
        first, k = ERROR * errors.block[j], actions.carrier[j]
        write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), R, 0)
        for c in range(root.shape[1]):
            moved, turn = _offset(kinematic, k, three(x, j, P), c)
            own = minus(vector(root, first + EP, c), moved)
            put(kinematic.held[j], 0, c, rotate_back(R[0], own[0], own[1], own[2]))
            turn = rotate_back(R[0], turn[0], turn[1], turn[2])
            put(kinematic.held[j], 3, c, minus(vector(root, first + ER, c), turn))
        if work.moving[j]:
            _release_errors(root, j, actions.held[j, 1] - begin, begin, world, work, errors, kinematic)


@inner(noinline=True, error_model="numpy")
def _release_errors(root, j, left, begin, world, work, errors, kinematic):
    """Give body j, released ``left`` seconds into the step, equivalent errors at the step's beginning.

    Free flight from there leads to the errors at release (as for the state in `kinematic_bodies`).
    """
    dt, first, state = world.dt, ERROR * errors.block[j], work.carried
    acceleration = _acceleration(work.state, j, begin + left, world, work)
    write_kinematic(state, 0, work.state, j, begin + left, world.environment.actions, work)
    write_matrix((state[0, Q], state[0, Q + 1], state[0, Q + 2], state[0, Q + 3]), errors.R, 0)
    v, w = three(state, 0, V), three(state, 0, W)
    rate, whole, rest = math.log(world.decay) / dt, world.decay, world.decay ** ((dt - left) / dt)
    back, g = times(-left, w), world.gravity
    coefficients = turn_coefficients(back)
    for c in range(root.shape[1]):
        later = kinematic.late[j, c]
        _write_errors(root, j, state, 0, c, later, acceleration, world, errors, kinematic)
        turn, dv, dw = vector(root, first + ER, c), vector(root, first + EV, c), vector(root, first + EW, c)
        delta = minus(times(-left, dw), times(later, w))
        put(root, first + ER, c, turned_on(turn, delta, back, coefficients))
        for k in range(3):
            last = rest * v[k] + (dt - left) * g[k]
            at_end = rest * dv[k] - later * (rest * rate * v[k] + g[k])
            at_begin = at_end / whole
            moved = (dt - left) * (dv[k] + at_end) - later * (v[k] + last) - dt * (at_begin + at_end)
            root[first + EP + k, c] += 0.5 * moved
            root[first + EV + k, c] = at_begin
            root[first + EW + k, c] = rest / whole * (dw[k] - later * rate * w[k])
    _turn_back(root, first, work.R[j])


@kernel(noinline=True, arrays=False)
def end_held_errors(root, x, end, world, work, errors, kinematic):
    """Write the errors of attached bodies at a step's end, including effects of a later release."""
    actions, begin, g = world.environment.actions, end - world.dt, world.gravity
    rate = math.log(world.decay) / world.dt
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if work.moving[j] or not _is_held(j, begin, world):
            continue
        first = ERROR * errors.block[j]
        linear, angular = acceleration = _acceleration(x, j, end, world, work)
        write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), errors.R, 0)
        for c in range(root.shape[1]):
            _write_errors(root, j, x, j, c, 0.0, acceleration, world, errors, kinematic)
            if not _is_held(j, end, world):  # a body that is released later is not falling yet
                later = kinematic.late[j, c]
                for k in range(3):
                    root[first + EV + k, c] += later * (linear[k] - g[k] - rate * x[j, V + k])
                    root[first + EW + k, c] += later * (angular[k] - rate * x[j, W + k])
        _turn_back(root, first, work.R[j])


@kernel(noinline=True, arrays=False)
def place_kinematic_errors(rows, x, count, time, world, work, errors, kinematic):
    """Write the errors of kinematic bodies that may touch the current group, at a time."""
    actions = world.environment.actions
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if work.moving[j] or not near_group(j, count, work):
            continue
        acceleration = _acceleration(x, j, time, world, work)
        write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), errors.R, 0)
        for c in range(rows.shape[1]):
            _write_errors(rows, j, x, j, c, -errors.left[c], acceleration, world, errors, kinematic)


@kernel(noinline=True, arrays=False, error_model="numpy")
def travel_kinematic_errors(count, h, world, work, errors):
    """Update the errors of kinematic bodies after an interval of ``h`` seconds, given those at both ends.

    The start velocities that contacts use (`kinematic_bodies.drive`) change with these.
    """
    actions, begin, end, velocity = world.environment.actions, errors.begin, errors.end, work.velocity
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if work.moving[j] or not near_group(j, count, work):
            continue
        first = ERROR * errors.block[j]
        middle = mean_spin(j, velocity)
        phi = times(h, middle)
        third = _third_of_inverse(phi)
        for c in range(begin.shape[1]):
            dv, dw = vector(end, first + EV, c), vector(end, first + EW, c)
            if h > _INSTANT:
                share, dh = 2.0 / h, errors.length[c]
                for k in range(3):
                    moved = end[first + EP + k, c] - begin[first + EP + k, c]
                    moved -= 0.5 * dh * (velocity[START, j, k] + velocity[NOW, j, k])
                    begin[first + EV + k, c] = share * moved - dv[k]
                before, after = vector(begin, first + ER, c), vector(end, first + ER, c)
                # of the rotation vector between them, by the inverse left Jacobian, and the right one
                turned, mean = minus(after, before), times(0.5, cross(phi, plus(after, before)))
                turned = minus(plus(turned, times(third, cross(phi, cross(phi, turned)))), mean)
                dw = minus(times(share, minus(turned, times(dh, middle))), dw)
            else:
                put(begin, first + EV, c, dv)
            put(begin, first + EW, c, dw)


@inner(forceinline=True, error_model="numpy")
def _third_of_inverse(phi):
    """Return the third coefficient of the inverse left Jacobian at a rotation vector."""
    square = dot(phi, phi)
    if square < 0.01:
        return 1.0 / 12.0 + square / 720.0 + square * square / 30240.0
    first, second, _ = turn_coefficients(phi)
    return (1.0 - 0.5 * first / second) / square
