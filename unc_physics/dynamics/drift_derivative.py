"""Linearized transition between contacts: drift and damping of one body's error state.

A matrix with the bodies' error states ``[dp, dv, dtheta, domega]`` as rows is multiplied from the left by the
paper's A_t (Eq. 14), or by its exact counterpart. Its columns are arbitrary. Bodies are indexed, as a slice
for each would cost more than the arithmetic.
"""

import math

from ..compiler import inner
from ..spatial.layout import EP, ER, EV, EW, W
from ..spatial.rotation import cross, rotate, rotate_back
from .drift_derivative_simd import four_columns, two_columns


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
def apply_gyroscopic_jacobian(rows, first, x, i, R, world):
    """Add the first-order effect of the gyroscopic term on errors to one body's 12 rows.

    With ``L = I omega``, ``domega/dt = I^-1 (L x omega)``. A rotation error t in world axes rotates I and its
    inverse.
    """
    dt, inertia, inverse, R_i = world.dt, world.bodies.inertia[i], world.bodies.inverse_inertia[i], R[i]
    omega = (x[i, W], x[i, W + 1], x[i, W + 2])
    L = _in_world(R_i, inertia, omega)
    torque = cross(L, omega)
    rate = _in_world(R_i, inverse, torque)
    for c in range(rows.shape[1]):
        dw = (rows[first + EW, c], rows[first + EW + 1, c], rows[first + EW + 2, c])
        t = rotate(R_i, rows[first + ER, c], rows[first + ER + 1, c], rows[first + ER + 2, c])
        a, b, d = cross(t, omega), cross(t, L), cross(t, torque)
        dL = _in_world(R_i, inertia, (dw[0] - a[0], dw[1] - a[1], dw[2] - a[2]))
        dL = (dL[0] + b[0], dL[1] + b[1], dL[2] + b[2])
        a, b = cross(dL, omega), cross(L, dw)
        a = _in_world(R_i, inverse, (a[0] + b[0] - d[0], a[1] + b[1] - d[1], a[2] + b[2] - d[2]))
        b = cross(t, rate)
        for k in range(3):
            rows[first + EW + k, c] += dt * (a[k] + b[k])


@inner
def _in_world(R, A, v):
    """Return ``R A R^T v`` for a body-frame matrix A."""
    x, y, z = rotate_back(R, v[0], v[1], v[2])
    x, y, z = rotate(A, x, y, z)
    return rotate(R, x, y, z)


@inner(forceinline=True)
def apply_drift_jacobian(rows, first, x, i, R, world, environment, rotation):
    """Multiply body i's 12 rows, from ``first`` on, by the derivative of drift and damping, in place.

    ``x`` and ``R`` precede the drift; ``rotation`` (3, 3) is the block from domega to dtheta.
    """
    if environment is not None:
        if environment.gyroscopic:
            apply_gyroscopic_jacobian(rows, first, x, i, R, world)
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
