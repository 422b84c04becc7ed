"""Motion of bodies without contact, common to both time steps."""

import math

from ...compiler import inner
from ...spatial.layout import P, Q, V, W
from ...spatial.rotation import exp, multiply, renormalized, rotate, rotate_back, write_matrix

# Largest rotation of a substep with the gyroscopic term [rad], largest number of substeps, and fixed-point
# iterations for the midpoint of each. With fewer iterations, the error would not decrease with the step.
_TURN, _MOST_TURNS, ROUNDS = 0.25, 1000, 3


@inner(forceinline=True)
def integrate_position(x, i, dt):
    """Move body i's centre of mass by its velocity; return a bound on its speed [m/s]."""
    for k in range(3):
        x[i, P + k] += dt * x[i, V + k]
    return abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2])


@inner(forceinline=True)
def integrate_rotation(x, i, dt, radius, R):
    """Rotate body i by its angular velocity; return a bound on the speed of its points from rotation [m/s].

    Updates ``R`` (B, 3, 3).
    """
    q = multiply(
        exp(dt * x[i, W], dt * x[i, W + 1], dt * x[i, W + 2]),
        (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]),
    )
    q = renormalized(q)
    x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3] = q
    write_matrix(q, R, i)
    return radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))


@inner
def integrate_gyroscopic(x, i, dt, bodies, R):
    """Rotate body i as `integrate_rotation` does, but conserve the angular momentum.

    The midpoint angular velocity is computed from the momentum, with the inertia at half the rotation. The
    energy error is of third order in the angle, so large rotations are divided into substeps.
    """
    Ri = R[i]
    a, b, c = rotate_back(Ri, x[i, W], x[i, W + 1], x[i, W + 2])
    a, b, c = rotate(bodies.inertia[i], a, b, c)
    momentum = rotate(Ri, a, b, c)
    count = turns_of(dt, (x[i, W], x[i, W + 1], x[i, W + 2]))
    dt, pace = dt / count, 0.0
    for _ in range(count):
        q = (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3])
        for _ in range(ROUNDS):
            half = exp(0.5 * dt * x[i, W], 0.5 * dt * x[i, W + 1], 0.5 * dt * x[i, W + 2])
            write_matrix(multiply(half, q), R, i)
            _write_velocity(x, i, momentum, bodies.inverse_inertia[i], Ri)
        pace = max(pace, integrate_rotation(x, i, dt, bodies.radius, R))
        _write_velocity(x, i, momentum, bodies.inverse_inertia[i], Ri)
    return pace


@inner(forceinline=True)
def turns_of(dt, w):
    """Return the number of substeps of a rotation over ``dt`` seconds."""
    angle = dt * math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    return max(min(math.ceil(angle / _TURN), _MOST_TURNS), 1)


@inner(forceinline=True)
def _write_velocity(x, i, momentum, inverse_inertia, R):
    """Write body i's angular velocity for an angular momentum (world axes) at a rotation into the state."""
    a, b, c = rotate_back(R, momentum[0], momentum[1], momentum[2])
    a, b, c = rotate(inverse_inertia, a, b, c)
    x[i, W], x[i, W + 1], x[i, W + 2] = rotate(R, a, b, c)
