"""Derivative of free motion in the implicit step: a parabola, and a rotation with constant momentum.

Errors are columns of an array with 12 rows per body in the order of the error state, but with rotations about
world axes. The duration may depend on the state, as the time until an impact does; each column then changes
it.
"""

import math
from typing import NamedTuple

import numpy as np

from ..collision.implicit_workspace import NOW, START
from ..compiler import inner
from ..dynamics.free_motion import ROUNDS, turns_of
from ..spatial.layout import EP, ER, ERROR, EV, EW
from ..spatial.rotation import cross, exp, multiply, renormalized, rotate, rotate_back, write_matrix
from ..spatial.vectors import dot, plus, put, three, times, vector


class Errors(NamedTuple):
    """Errors of a rollout's state in an interval of a step, with r columns.

    Attributes
    ----------
    begin : (12 M + 12 P + 12, r) float64
        Errors at the interval's beginning, world axes: of M free bodies, then of P bodies on a path. The last
        block is zero and stands for all fixed bodies.
    end : (12 M + 12 P + 12, r) float64
        Errors at its end without contacts.
    block : (B,) int64
        Index of each body's block of 12 rows.
    length : (r,) float64
        Change of the interval's length [s].
    left : (r,) float64
        Change of the remaining time of the step, for the current group [s].
    momentum : (3, r) float64
        Temporary changes of an angular momentum.
    kept : (6, r) float64
        Temporary changes of a body's velocities.
    R : (1, 3, 3) float64
        Temporary rotation matrix.
    """

    begin: np.ndarray
    end: np.ndarray
    block: np.ndarray
    length: np.ndarray
    left: np.ndarray
    momentum: np.ndarray
    kept: np.ndarray
    R: np.ndarray


@inner
def turn_coefficients(phi):
    """Return ``sin(a) / a``, ``(1 - cos(a)) / a^2``, ``(a - sin(a)) / a^3`` for the angle of ``phi``."""
    angle2 = dot(phi, phi)
    if angle2 < 0.01:
        square = angle2 * angle2
        second = 0.5 - angle2 / 24.0 + square / 720.0 - angle2 * square / 40320.0
        third = 1.0 / 6.0 - angle2 / 120.0 + square / 5040.0 - angle2 * square / 362880.0
        return 1.0 - angle2 * third, second, third
    angle = math.sqrt(angle2)
    sine = math.sin(angle) / angle
    return sine, (1.0 - math.cos(angle)) / angle2, (1.0 - sine) / angle2


@inner(forceinline=True)
def mean_spin(i, velocity):
    """Return body i's mean angular velocity at the beginning and the end of a solved interval [rad/s]."""
    return times(0.5, plus(three(velocity[START], i, 3), three(velocity[NOW], i, 3)))


@inner(forceinline=True)
def turned_on(turn, delta, phi, coefficients):
    """Return the world-axes error of ``Exp(phi) R``, with error ``turn`` of R and ``delta`` of phi."""
    first, second, third = coefficients
    a, b = cross(phi, turn), cross(phi, delta)
    c, d = cross(phi, a), cross(phi, b)
    return (
        turn[0] + first * a[0] + second * c[0] + delta[0] + second * b[0] + third * d[0],
        turn[1] + first * a[1] + second * c[1] + delta[1] + second * b[1] + third * d[1],
        turn[2] + first * a[2] + second * c[2] + delta[2] + second * b[2] + third * d[2],
    )


@inner(forceinline=True)
def in_world(R, A, v):
    """Return ``R A R^T v`` for a body-frame matrix A."""
    x, y, z = rotate_back(R, v[0], v[1], v[2])
    x, y, z = rotate(A, x, y, z)
    return rotate(R, x, y, z)


@inner(noinline=True)
def fly_errors(v, w, q, i, h, decay, world, errors):
    """Propagate body i's errors over an interval of ``h`` seconds without contact.

    ``v``, ``w`` and ``q`` are velocities and orientation at the beginning; ``decay`` is the factor on
    velocities over ``h``. Returns the orientation at the end.
    """
    begin, end, length = errors.begin, errors.end, errors.length
    first, g = ERROR * errors.block[i], world.gravity
    rate = math.log(world.decay) / world.dt
    u = (decay * v[0] + h * g[0], decay * v[1] + h * g[1], decay * v[2] + h * g[2])
    for c in range(begin.shape[1]):
        dh = length[c]
        dv = vector(begin, first + EV, c)
        for k in range(3):
            change = decay * dv[k] + dh * (rate * decay * v[k] + g[k])
            end[first + EV + k, c] = change
            end[first + EP + k, c] = (
                begin[first + EP + k, c] + 0.5 * h * (dv[k] + change) + 0.5 * dh * (v[k] + u[k])
            )
    if world.environment.gyroscopic:
        w, q = _turn_gyroscopically(w, q, i, first, h, world.bodies, errors)
    else:
        phi = times(h, w)
        q = renormalized(multiply(exp(phi[0], phi[1], phi[2]), q))
        coefficients = turn_coefficients(phi)
        for c in range(begin.shape[1]):
            dw = vector(begin, first + EW, c)
            delta = plus(times(h, dw), times(length[c], w))
            put(end, first + ER, c, turned_on(vector(begin, first + ER, c), delta, phi, coefficients))
            put(end, first + EW, c, dw)
    for c in range(begin.shape[1]):
        for k in range(3):
            end[first + EW + k, c] = decay * (end[first + EW + k, c] + length[c] * rate * w[k])
    return q


@inner
def _turn_gyroscopically(w, q, i, first, h, bodies, errors):
    """Propagate errors as in `integrate_gyroscopic`; return final angular velocity and orientation."""
    begin, end, dL, length, R = errors.begin, errors.end, errors.momentum, errors.length, errors.R
    inertia, inverse = bodies.inertia[i], bodies.inverse_inertia[i]
    write_matrix(q, R, 0)
    L = in_world(R[0], inertia, w)
    for c in range(begin.shape[1]):
        t, dw = vector(begin, first + ER, c), vector(begin, first + EW, c)
        a = cross(t, w)
        b = in_world(R[0], inertia, (dw[0] - a[0], dw[1] - a[1], dw[2] - a[2]))
        put(dL, 0, c, plus(cross(t, L), b))
        put(end, first + ER, c, t)
        put(end, first + EW, c, dw)
    count = turns_of(h, w)
    h = h / count
    for _ in range(count):
        for stage in range(ROUNDS + 1):
            share = 0.5 if stage < ROUNDS else 1.0
            phi = times(share * h, w)
            coefficients = turn_coefficients(phi)
            turned = renormalized(multiply(exp(phi[0], phi[1], phi[2]), q))
            write_matrix(turned, R, 0)
            new = in_world(R[0], inverse, L)
            for c in range(begin.shape[1]):
                dw = vector(end, first + EW, c)
                delta = plus(times(share * h, dw), times(share * length[c] / count, w))
                t = turned_on(vector(end, first + ER, c), delta, phi, coefficients)
                a, d = cross(t, L), vector(dL, 0, c)
                b = in_world(R[0], inverse, (d[0] - a[0], d[1] - a[1], d[2] - a[2]))
                put(end, first + EW, c, plus(cross(t, new), b))
                if stage == ROUNDS:
                    put(end, first + ER, c, t)
            w = new
            if stage == ROUNDS:
                q = turned
    return w, q
