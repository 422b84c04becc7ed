"""The linearized transition between contacts: drift and damping act on the error state of one body.

A matrix whose rows are the error state ``[dp, dv, dtheta, domega]`` of body after body, columns whatever is
carried, is multiplied from the left by the paper's A_t (Eq. 14), or by its exact counterpart. Bodies go by index:
a slice for each would cost more than the arithmetic.
"""

import math

from numba import njit

from ..layout import EP, ER, EV, EW, W


@njit(cache=True, nogil=True, forceinline=True)
def write_printed_rotation(R, i, dt, out):
    """``dt R_t^T`` of body i, the block of Eq. 14 that turns angular velocity into rotation, into ``out`` (3, 3)."""
    for a in range(3):
        for b in range(3):
            out[a, b] = dt * R[i, b, a]


@njit(cache=True, nogil=True, forceinline=True)
def write_exact_rotation(R, x, i, dt, out):
    """``dt R_t^T J^T`` of body i, the exact derivative of the drift, into ``out`` (3, 3).

    J is the left Jacobian of SO(3) at ``dt omega``; ``x`` (B, 13) and ``R`` (B, 3, 3) are those before the drift.
    """
    a, b, c = dt * x[i, W], dt * x[i, W + 1], dt * x[i, W + 2]
    angle2 = a * a + b * b + c * c
    if angle2 < 0.01:  # as in nearly every time step: the series to round-off
        first = 0.5 - angle2 * (1.0 / 24.0 - angle2 * (1.0 / 720.0 - angle2 * (1.0 / 40320.0 - angle2 / 3628800.0)))
        second = 1.0 / 6.0 - angle2 * (1.0 / 120.0 - angle2 * (1.0 / 5040.0 - angle2 / 362880.0))
    else:
        angle = math.sqrt(angle2)
        first, second = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    # transposed: I - first [phi]x + second (phi phi^T - angle^2 I)
    diagonal = 1.0 - second * angle2
    for k in range(3):
        x0, x1, x2 = R[i, 0, k], R[i, 1, k], R[i, 2, k]
        dot = second * (x0 * a + x1 * b + x2 * c)
        # row k of R^T times the transposed Jacobian: r J^T = diagonal r + second (r . phi) phi - first (r x phi)
        out[k, 0] = dt * (diagonal * x0 + dot * a - first * (x1 * c - x2 * b))
        out[k, 1] = dt * (diagonal * x1 + dot * b - first * (x2 * a - x0 * c))
        out[k, 2] = dt * (diagonal * x2 + dot * c - first * (x0 * b - x1 * a))


@njit(cache=True, nogil=True, forceinline=True)
def apply_transition(rows, first, dt, decay, rotation):
    """Multiply the 12 rows of one body, from row ``first`` on, by its transition, in place.

    ``rotation`` (3, 3) is the transition's block from domega to dtheta.
    """
    p, v, r, w = first + EP, first + EV, first + ER, first + EW
    for c in range(rows.shape[1]):
        x, y, z = rows[w, c], rows[w + 1, c], rows[w + 2, c]
        for k in range(3):
            velocity = rows[v + k, c]
            rows[p + k, c] += dt * velocity
            rows[v + k, c] = decay * velocity
            rows[r + k, c] += rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
        rows[w, c], rows[w + 1, c], rows[w + 2, c] = decay * x, decay * y, decay * z
