"""The linearized transition between contacts: drift and damping act on the error state of one body.

A matrix whose rows are the error state ``[dp, dv, dtheta, domega]`` of one body, columns whatever is carried, is
multiplied from the left by the paper's A_t (Eq. 14), or by its exact counterpart.
"""

import math

from numba import njit

from ..layout import EP, ER, EV, EW, W


@njit(cache=True, nogil=True, forceinline=True)
def write_printed_rotation(R, dt, out):
    """``dt R_t^T``, the block of Eq. 14 that turns angular velocity into rotation, into ``out`` (3, 3)."""
    for a in range(3):
        for b in range(3):
            out[a, b] = dt * R[b, a]


@njit(cache=True, nogil=True, forceinline=True)
def write_exact_rotation(R, x, dt, out):
    """``dt R_t^T J^T``, the exact derivative of the drift, into ``out`` (3, 3).

    J is the left Jacobian of SO(3) at ``dt omega``; ``x`` (13,) is the body's state before the drift.
    """
    a, b, c = dt * x[W], dt * x[W + 1], dt * x[W + 2]
    angle2 = a * a + b * b + c * c
    if angle2 < 1e-6:
        first, second = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = math.sqrt(angle2)
        first, second = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    # transposed: I - first [phi]x + second (phi phi^T - angle^2 I)
    diagonal = 1.0 - second * angle2
    for k in range(3):
        x0, x1, x2 = R[0, k], R[1, k], R[2, k]
        dot = second * (x0 * a + x1 * b + x2 * c)
        # row k of R^T times the transposed Jacobian: r J^T = diagonal r + second (r . phi) phi - first (r x phi)
        out[k, 0] = dt * (diagonal * x0 + dot * a - first * (x1 * c - x2 * b))
        out[k, 1] = dt * (diagonal * x1 + dot * b - first * (x2 * a - x0 * c))
        out[k, 2] = dt * (diagonal * x2 + dot * c - first * (x0 * b - x1 * a))


@njit(cache=True, nogil=True, forceinline=True)
def apply_transition(rows, dt, decay, rotation):
    """Multiply ``rows`` (12, columns) by the transition, in place; ``rotation`` is its block from domega to dtheta."""
    for c in range(rows.shape[1]):
        x, y, z = rows[EW, c], rows[EW + 1, c], rows[EW + 2, c]
        for k in range(3):
            v = rows[EV + k, c]
            rows[EP + k, c] += dt * v
            rows[EV + k, c] = decay * v
            rows[ER + k, c] += rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
        rows[EW, c], rows[EW + 1, c], rows[EW + 2, c] = decay * x, decay * y, decay * z
