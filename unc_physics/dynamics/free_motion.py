"""How a body that nothing touches moves: what both time steps share."""

import math

from ..compiler import inner
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import exp, multiply, renormalized, rotate, rotate_back, write_matrix

# angle that a body turns at a time with the gyroscopic term [rad], the most parts of a step, and how often
# each part finds its middle: fewer times, and the error would not fall with the step
_TURN, _MOST_TURNS, ROUNDS = 0.25, 1000, 3


@inner(forceinline=True)
def integrate_position(x, i, dt):
    """Move body i's centre of mass by its velocity for a time; returns a bound of its speed [m/s]."""
    for k in range(3):
        x[i, P + k] += dt * x[i, V + k]
    return abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2])


@inner(forceinline=True)
def integrate_rotation(x, i, dt, radius, R):
    """Turn body i by its angular velocity for a time; returns a bound of its points' speed by that [m/s].

    ``R`` (B, 3, 3) follows.
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
    """As `integrate_rotation`, with the angular momentum kept instead of the angular velocity.

    The angular velocity in the middle of a turn is found from the momentum, with the inertia half turned
    along; long turns are divided, since this keeps the energy to the third order of their angle only.
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
    """In how many parts a turn for ``dt`` seconds is made."""
    angle = dt * math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    return max(min(math.ceil(angle / _TURN), _MOST_TURNS), 1)


@inner(forceinline=True)
def _write_velocity(x, i, momentum, inverse_inertia, R):
    """Write the angular velocity that a momentum (world axes) gives body i at a rotation into the state."""
    a, b, c = rotate_back(R, momentum[0], momentum[1], momentum[2])
    a, b, c = rotate(inverse_inertia, a, b, c)
    x[i, W], x[i, W + 1], x[i, W + 2] = rotate(R, a, b, c)
