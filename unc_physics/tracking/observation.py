"""Kernels: residuals of measurements for a state, and the Kalman update."""

import math

from ..compiler import inner, kernel
from ..compiler.arrays import empty, zeros
from ..spatial.layout import EP, ER, ERROR, EV, EW, P, Q, V, W
from ..spatial.moments import boxplus
from ..spatial.rotation import conjugate, exp, log, multiply, normalized, rotate_by_quaternion

#: Kinds of measurements.
POSE, POSITION, RELATIVE_POSE = 0, 1, 2
_LOG_TWO_PI = math.log(2.0 * math.pi)


@inner
def _pose_after(x, delay):
    """Return position and quaternion of a state (13,) after ``delay`` seconds at its velocities."""
    turn = exp(x[W] * delay, x[W + 1] * delay, x[W + 2] * delay)
    q = normalized(multiply(turn, (x[Q], x[Q + 1], x[Q + 2], x[Q + 3])))
    return x[P] + delay * x[V], x[P + 1] + delay * x[V + 1], x[P + 2] + delay * x[V + 2], q


@inner
def write_residual(x, reference, kind, value, point, delay, out):
    """Write the residual (m,) of a measurement to ``out``: expected from a state (13,), less measured.

    ``reference`` (13,) is the other body's state for `RELATIVE_POSE`; ``delay`` is how much later than the
    states the measurement was taken [s].
    """
    px, py, pz, q = _pose_after(x, delay)
    if kind == POSITION:
        a, b, c = rotate_by_quaternion(q, point)
        out[0], out[1], out[2] = px + a - value[0], py + b - value[1], pz + c - value[2]
        return
    if kind == RELATIVE_POSE:
        rx, ry, rz, r = _pose_after(reference, delay)
        back = conjugate(r)
        px, py, pz = rotate_by_quaternion(back, (px - rx, py - ry, pz - rz))
        q = multiply(back, q)
    out[0], out[1], out[2] = px - value[0], py - value[1], pz - value[2]
    out[3], out[4], out[5] = log(multiply(conjugate((value[3], value[4], value[5], value[6])), q))


@inner
def factor(S, m, L):
    """Write the lower Cholesky factor of ``S`` (m, m); pivots that are not positive become zero."""
    for i in range(m):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = math.sqrt(total) if total > 0.0 else 0.0
            else:
                L[i, j] = total / L[j, j] if L[j, j] > 0.0 else 0.0


@inner
def solve_lower(L, m, b, out):
    """Write the solution of ``L out = b``, with 0 where the pivot is 0."""
    for i in range(m):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * out[k]
        out[i] = total / L[i, i] if L[i, i] > 0.0 else 0.0


@inner
def solve_upper(L, m, b, out):
    """Write the solution of ``L^T out = b``, with 0 where the pivot is 0."""
    for i in range(m - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, m):
            total -= L[k, i] * out[k]
        out[i] = total / L[i, i] if L[i, i] > 0.0 else 0.0


@inner
def log_density(L, m, square):
    """Return the logarithm of a normal density, from the factor of its covariance and the squared distance.

    Directions without variance are left out.
    """
    total = square + m * _LOG_TWO_PI
    for i in range(m):
        total += 2.0 * math.log(L[i, i]) if L[i, i] > 0.0 else 0.0
    return -0.5 * total


@kernel(noinline=True)
def expectation(x, reference, kind, value, point, rows):
    """Return the innovation (m,) of a measurement, and its derivative (m, 12) by the error state.

    It is a central difference: steps of 1e-6 leave errors of 1e-9.
    """
    y, H = empty(rows), zeros((rows, ERROR))
    write_residual(x, reference, kind, value, point, 0.0, y)
    d, moved, plus, minus = zeros(ERROR), empty(len(x)), empty(rows), empty(rows)
    step = 1e-6
    for c in range(ERROR):
        d[c] = step
        boxplus(x, d, moved)
        write_residual(moved, reference, kind, value, point, 0.0, plus)
        d[c] = -step
        boxplus(x, d, moved)
        write_residual(moved, reference, kind, value, point, 0.0, minus)
        d[c] = 0.0
        for r in range(rows):
            H[r, c] = (plus[r] - minus[r]) / (2.0 * step)
    for r in range(rows):
        y[r] = -y[r]
    return y, H


@kernel(noinline=True)
def kalman_update(covariance, H, y, noise):
    """Return the Kalman update of an error state with covariance (n, n) by an innovation (m,).

    Returns
    -------
    change : (n,) array
        Of the mean.
    corrected : (n, n) array
        Covariance after the update, symmetric.
    square : float
        Squared Mahalanobis distance of the innovation.
    density : float
        Logarithm of its density.
    """
    n, m = len(covariance), len(y)
    C, S, L = zeros((n, m)), empty((m, m)), zeros((m, m))
    for i in range(n):
        for r in range(m):
            total = 0.0
            for k in range(n):
                total += covariance[i, k] * H[r, k]
            C[i, r] = total
    for r in range(m):
        for c in range(m):
            total = noise[r, c]
            for k in range(n):
                total += H[r, k] * C[k, c]
            S[r, c] = total
    factor(S, m, L)
    white, change, corrected, G = empty(m), empty(n), empty((n, n)), empty((n, m))
    solve_lower(L, m, y, white)
    square = 0.0
    for r in range(m):
        square += white[r] ** 2
    for i in range(n):
        solve_lower(L, m, C[i], G[i])  # G = C L^-T
        total = 0.0
        for r in range(m):
            total += G[i, r] * white[r]
        change[i] = total
    for i in range(n):
        for j in range(i + 1):
            total = covariance[i, j]
            for r in range(m):
                total -= G[i, r] * G[j, r]
            corrected[i, j] = corrected[j, i] = total
    for i in range(n):
        corrected[i, i] = max(corrected[i, i], 0.0)
    return change, corrected, square, log_density(L, m, square)


@kernel(noinline=True)
def constant_velocity(x, covariance, h, acceleration, angular_acceleration):
    """Return state (13,) and covariance (12, 12) of a body after ``h`` seconds at constant velocity.

    The noise is white acceleration, of intensities [m^2/s^3] and [rad^2/s^3].
    """
    out, F = x.copy(), zeros((ERROR, ERROR))
    px, py, pz, q = _pose_after(x, h)
    out[P], out[P + 1], out[P + 2] = px, py, pz
    out[Q], out[Q + 1], out[Q + 2], out[Q + 3] = q
    back = conjugate(q)
    for k in range(ERROR):
        F[k, k] = 1.0  # rotations turn on the world's side, so that errors keep their axes in the body
    turns = empty((3, 3))
    for k in range(3):
        F[EP + k, EV + k] = h
        turns[0, k], turns[1, k], turns[2, k] = rotate_by_quaternion(
            back, (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        )
    for r in range(3):
        for k in range(3):
            F[ER + r, EW + k] = h * turns[r, k]
    n = ERROR
    half, result = zeros((n, n)), empty((n, n))
    for i in range(n):
        for k in range(n):
            if F[i, k] != 0.0:
                for j in range(n):
                    half[i, j] += F[i, k] * covariance[k, j]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += half[i, k] * F[j, k]
            result[i, j] = result[j, i] = total
    for k in range(3):
        _add_noise(result, EP + k, EV + k, h, acceleration)
        result[ER + k, ER + k] += angular_acceleration * h**3 / 3.0
        result[EW + k, EW + k] += angular_acceleration * h
        for r in range(3):
            shared = 0.5 * angular_acceleration * h * h * turns[r, k]
            result[ER + r, EW + k] += shared
            result[EW + k, ER + r] += shared
    return out, result


@inner
def _add_noise(result, p, v, h, intensity):
    result[p, p] += intensity * h**3 / 3.0
    result[v, v] += intensity * h
    result[p, v] += 0.5 * intensity * h * h
    result[v, p] += 0.5 * intensity * h * h
