"""Linearized transition between contacts: drift and damping of one body's error state.

A matrix with the bodies' error states ``[dp, dv, dtheta, domega]`` as rows is multiplied from the left by the
paper's A_t (Eq. 14), or by its exact counterpart. Its columns are arbitrary. Bodies are indexed, as a slice
for each would cost more than the arithmetic.
"""

import math

from ...compiler import inner
from ...spatial.layout import EP, ER, EV, EW, Q, W
from ...spatial.rotation import cross, exp, multiply, renormalized, rotate, rotate_back, write_matrix
from ...spatial.vectors import minus
from .drift_derivative_simd import four_columns, two_columns
from .free_motion import ROUNDS, turns_of


@inner(forceinline=True)
def write_printed_rotation(R, i, dt, out):
    """Write ``dt R_t^T`` of body i, Eq. 14's block from angular velocity to rotation, into ``out`` (3, 3)."""
    for a in range(3):
        for b in range(3):
            out[a, b] = dt * R[i, b, a]


@inner(forceinline=True)
def write_exact_rotation(R, x, i, dt, out):
    """Write ``dt R_t^T J^T`` of body i, the exact derivative of the drift, into ``out`` (3, 3).

    J is the left Jacobian of SO(3) at ``dt omega``; ``x`` (B, 13) and ``R`` (B, 3, 3) precede the drift.
    """
    a, b, c = dt * x[i, W], dt * x[i, W + 1], dt * x[i, W + 2]
    angle2 = a * a + b * b + c * c
    if angle2 < 0.01:  # as in most time steps: the series is exact to round-off
        square = angle2 * angle2
        first = (
            0.5
            - angle2 * (1.0 / 24.0)
            + square * (1.0 / 720.0 - angle2 * (1.0 / 40320.0) + square * (1.0 / 3628800.0))
        )
        second = 1.0 / 6.0 - angle2 * (1.0 / 120.0) + square * (1.0 / 5040.0 - angle2 * (1.0 / 362880.0))
    else:
        angle = math.sqrt(angle2)
        first, second = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    # transposed: I - first [phi]x + second (phi phi^T - angle^2 I); its rows, times dt
    first, second = dt * first, dt * second
    diagonal = dt - second * angle2
    xx, yy, zz = diagonal + second * a * a, diagonal + second * b * b, diagonal + second * c * c
    xy, xz, yz = second * a * b, second * a * c, second * b * c
    x_, y_, z_ = first * a, first * b, first * c
    for k in range(3):
        u, v, w = R[i, 0, k], R[i, 1, k], R[i, 2, k]
        out[k, 0] = u * xx + v * (xy - z_) + w * (xz + y_)
        out[k, 1] = u * (xy + z_) + v * yy + w * (yz - x_)
        out[k, 2] = u * (xz - y_) + v * (yz + x_) + w * zz


@inner
def apply_gyroscopic_jacobian(rows, first, x, i, R, world, rotation):
    """Multiply the rows of rotation and angular velocity by the derivative of `integrate_gyroscopic`.

    The angular momentum L is conserved, so that errors (t, dL) with the rotation error t in body axes follow
    ``dt/dt = A t + I^-1 R^T dL``, ``A t = t x w - I^-1 (t x R^T L)``, with w in body axes. Each substep takes
    the midpoint rule with A at its middle. ``rotation`` (3, 3) becomes zero: nothing is left for it to do.
    """
    inertia, inverse, R_i = world.bodies.inertia[i], world.bodies.inverse_inertia[i], R[i]
    start = q = (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3])
    omega = (x[i, W], x[i, W + 1], x[i, W + 2])
    L = _in_world(R_i, inertia, omega)
    for c in range(rows.shape[1]):  # dL in place of dw
        t = rotate(R_i, rows[first + ER, c], rows[first + ER + 1, c], rows[first + ER + 2, c])
        dw = (rows[first + EW, c], rows[first + EW + 1, c], rows[first + EW + 2, c])
        a, b = _in_world(R_i, inertia, minus(dw, cross(t, omega))), cross(t, L)
        for k in range(3):
            rows[first + EW + k, c] = a[k] + b[k]
    count = turns_of(world.dt, omega)
    dt = world.dt / count
    for _ in range(count):
        for _ in range(ROUNDS):
            half = exp(0.5 * dt * omega[0], 0.5 * dt * omega[1], 0.5 * dt * omega[2])
            write_matrix(multiply(half, q), R, i)
            omega = _in_world(R_i, inverse, L)
        momentum, w = rotate_back(R_i, L[0], L[1], L[2]), rotate_back(R_i, omega[0], omega[1], omega[2])
        h = 0.5 * dt
        a = _rate((h, 0.0, 0.0), inverse, w, momentum)
        b = _rate((0.0, h, 0.0), inverse, w, momentum)
        d = _rate((0.0, 0.0, h), inverse, w, momentum)
        # columns of 1 - dt A / 2, and rows of its inverse
        a, b, d = (1.0 - a[0], -a[1], -a[2]), (-b[0], 1.0 - b[1], -b[2]), (-d[0], -d[1], 1.0 - d[2])
        u, v, z = cross(b, d), cross(d, a), cross(a, b)
        scale = 1.0 / (a[0] * u[0] + a[1] * u[1] + a[2] * u[2])
        for c in range(rows.shape[1]):
            t = (rows[first + ER, c], rows[first + ER + 1, c], rows[first + ER + 2, c])
            m = rotate_back(R_i, rows[first + EW, c], rows[first + EW + 1, c], rows[first + EW + 2, c])
            m, r = rotate(inverse, m[0], m[1], m[2]), _rate(t, inverse, w, momentum)
            m = (t[0] + h * r[0] + dt * m[0], t[1] + h * r[1] + dt * m[1], t[2] + h * r[2] + dt * m[2])
            rows[first + ER, c] = scale * (u[0] * m[0] + u[1] * m[1] + u[2] * m[2])
            rows[first + ER + 1, c] = scale * (v[0] * m[0] + v[1] * m[1] + v[2] * m[2])
            rows[first + ER + 2, c] = scale * (z[0] * m[0] + z[1] * m[1] + z[2] * m[2])
        q = renormalized(multiply(exp(dt * omega[0], dt * omega[1], dt * omega[2]), q))
        write_matrix(q, R, i)
        omega = _in_world(R_i, inverse, L)
    for c in range(rows.shape[1]):  # dw again
        t = rotate(R_i, rows[first + ER, c], rows[first + ER + 1, c], rows[first + ER + 2, c])
        dL = (rows[first + EW, c], rows[first + EW + 1, c], rows[first + EW + 2, c])
        a, b = _in_world(R_i, inverse, minus(dL, cross(t, L))), cross(t, omega)
        for k in range(3):
            rows[first + EW + k, c] = a[k] + b[k]
    write_matrix(start, R, i)
    rotation[:] = 0.0


@inner(forceinline=True)
def _rate(t, inverse, w, momentum):
    """Return A t of `apply_gyroscopic_jacobian`, for angular velocity w and a momentum in body axes."""
    a, b = cross(t, w), cross(t, momentum)
    return minus(a, rotate(inverse, b[0], b[1], b[2]))


@inner
def _in_world(R, A, v):
    """Return ``R A R^T v`` for a body-frame matrix A."""
    x, y, z = rotate_back(R, v[0], v[1], v[2])
    x, y, z = rotate(A, x, y, z)
    return rotate(R, x, y, z)


@inner(forceinline=True)
def apply_drift_jacobian(rows, first, x, i, R, world, environment, rotation):
    """Multiply body i's 12 rows, from ``first`` on, by the derivative of drift and damping, in place.

    ``x`` and ``R`` precede the drift; ``rotation`` (3, 3) is the block from domega to dtheta, and may change.
    """
    if environment is not None:
        if environment.gyroscopic:
            apply_gyroscopic_jacobian(rows, first, x, i, R, world, rotation)
    apply_transition(rows, first, world.dt, world.decay, rotation)


@inner(forceinline=True)
def apply_transition(rows, first, dt, decay, rotation):
    """Multiply the 12 rows of one body, from row ``first`` on, by its transition, in place.

    ``rotation`` (3, 3) is the transition's block from domega to dtheta.
    """
    p, v, r, w = first + EP, first + EV, first + ER, first + EW
    width, c = rows.shape[1], 0
    while c + 4 <= width:
        four_columns(rows, first, c, dt, decay, rotation)
        c += 4
    if c + 2 <= width:
        two_columns(rows, first, c, dt, decay, rotation)
        c += 2
    if c < width:
        x, y, z = rows[w, c], rows[w + 1, c], rows[w + 2, c]
        for k in range(3):
            velocity = rows[v + k, c]
            rows[p + k, c] += dt * velocity
            rows[v + k, c] = decay * velocity
            rows[r + k, c] += rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
        rows[w, c], rows[w + 1, c], rows[w + 2, c] = decay * x, decay * y, decay * z
