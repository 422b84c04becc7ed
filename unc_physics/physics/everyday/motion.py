"""Poses and motion of one body; what moves freely keeps its angular momentum."""

from ...compiler import inner
from ...spatial.rotation import cross, exp, multiply, normalized
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ARM,
    AXIS,
    CENTRE,
    FRAME,
    FREE_W,
    IBODY,
    IMASS,
    INERTIA,
    IWORLD,
    MOVED,
    OFFSET,
    QUAT,
    ROLLS,
    ROT,
    SPIN,
    STEADY,
    TILTED,
    TURNED,
)

_SLOW_TURN = 5e-8  # squared angle of a move below which one term of the Magnus series is exact to round-off


@inner(forceinline=True)
def write(A, i, j, a):
    """Write a vector into row i from column j on."""
    A[i, j], A[i, j + 1], A[i, j + 2] = a[0], a[1], a[2]


@inner(forceinline=True)
def turn(Y, i, j, a):
    """Multiply by the matrix in columns j to j + 8 of row i; with `ROT` from body to world axes."""
    return dot(three(Y, i, j), a), dot(three(Y, i, j + 3), a), dot(three(Y, i, j + 6), a)


@inner(forceinline=True)
def back(Y, i, a):
    """Turn a vector from world axes to those of body i."""
    return plus(
        plus(times(a[0], three(Y, i, ROT)), times(a[1], three(Y, i, ROT + 3))),
        times(a[2], three(Y, i, ROT + 6)),
    )


@inner(forceinline=True)
def symmetric_times(Y, i, j, a):
    """Multiply by the symmetric matrix in columns j to j + 5 of row i."""
    xx, yy, zz, xy, xz, yz = Y[i, j], Y[i, j + 1], Y[i, j + 2], Y[i, j + 3], Y[i, j + 4], Y[i, j + 5]
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


@inner(forceinline=True)
def quaternion(Y, i):
    """Return the orientation of body i."""
    return Y[i, QUAT], Y[i, QUAT + 1], Y[i, QUAT + 2], Y[i, QUAT + 3]


@inner(forceinline=True)
def momentum(Y, i, w):
    """Return the angular momentum of body i at the angular velocity w, world axes."""
    return turn(Y, i, ROT, symmetric_times(Y, i, INERTIA, back(Y, i, w)))


@inner
def roll_axis(Y, i):
    """Return the axis of the lathes of body i in the world."""
    return turn(Y, i, ROT, three(Y, i, AXIS))


@inner
def roll_arm(Y, i):
    """Return the point of that axis nearest to the centre of mass, from there, world axes."""
    return turn(Y, i, ROT, three(Y, i, ARM))


@inner
def pose(Y, i):
    """Fill rotation matrix, frame of the pieces and inverse inertia in world axes from the state."""
    x, y, z, w = quaternion(Y, i)
    a = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
    b = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
    c = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)
    write(Y, i, ROT, a)
    write(Y, i, ROT + 3, b)
    write(Y, i, ROT + 6, c)
    write(Y, i, FRAME, minus(three(Y, i, CENTRE), turn(Y, i, ROT, three(Y, i, OFFSET))))
    if Y[i, IMASS] > 0.0:
        ma, mb = symmetric_times(Y, i, IBODY, a), symmetric_times(Y, i, IBODY, b)
        mc = symmetric_times(Y, i, IBODY, c)
        write(Y, i, IWORLD, (dot(ma, a), dot(mb, b), dot(mc, c)))
        write(Y, i, IWORLD + 3, (dot(ma, b), dot(ma, c), dot(mb, c)))


@inner
def rotate(Y, i, q, d):
    """Set the pose to the quaternion q turned by the rotation vector d in world axes."""
    q = normalized(multiply(exp(d[0], d[1], d[2]), q))
    Y[i, QUAT], Y[i, QUAT + 1], Y[i, QUAT + 2], Y[i, QUAT + 3] = q
    pose(Y, i)


@inner(forceinline=True)
def turned(r, d):
    """Turn r by the small rotation d, to third order."""
    e = cross(d, r)
    f = cross(d, e)
    return plus(plus(r, e), plus(times(0.5, f), times(1.0 / 6.0, cross(d, f))))


@inner
def _rates(w, L, Y, i):
    """Return first and second derivative of the angular velocity w whose angular momentum L stays."""
    e = cross(w, L)
    w1 = times(-1.0, symmetric_times(Y, i, IWORLD, e))
    w2 = plus(cross(w, w1), symmetric_times(Y, i, IWORLD, minus(cross(w, e), cross(w1, L))))
    return w1, w2


@inner
def free_turn(Y, i):
    """Fill the change of the angular velocity with time without torque."""
    if Y[i, STEADY] > 0.0:
        write(Y, i, FREE_W, (0.0, 0.0, 0.0))
        return
    w = three(Y, i, SPIN)
    write(Y, i, FREE_W, times(-1.0, symmetric_times(Y, i, IWORLD, cross(w, momentum(Y, i, w)))))


@inner(noinline=True)
def move(Y, i, h, vx, vy, vz, wx, wy, wz):
    """Move body i for h with velocities v and w, which a push out of depth may change.

    Its angular momentum stays. Where its inertia turns with it, w is corrected to the mean of the angular
    velocity within h by the Magnus series, for long turns about the middle of the step.
    """
    v, w = (vx, vy, vz), (wx, wy, wz)
    write(Y, i, CENTRE, plus(three(Y, i, CENTRE), times(h, v)))
    write(Y, i, MOVED, plus(three(Y, i, MOVED), times(h, v)))
    spin, q = three(Y, i, SPIN), quaternion(Y, i)
    L = momentum(Y, i, spin)
    if Y[i, STEADY] == 0.0:
        w1, w2 = _rates(spin, L, Y, i)
        twice = plus(w2, times(0.5, cross(w1, spin)))
        if dot(spin, spin) * h * h < _SLOW_TURN:
            w = plus(w, plus(times(0.5 * h, w1), times(h * h / 6.0, twice)))
        else:
            middle = plus(plus(spin, times(0.25 * h, w1)), times(h * h / 24.0, twice))
            rotate(Y, i, q, times(0.5 * h, middle))
            wm = symmetric_times(Y, i, IWORLD, L)
            w1, w2 = _rates(wm, L, Y, i)
            mean = plus(wm, times(h * h / 24.0, plus(w2, times(2.0, cross(w1, wm)))))
            w = plus(w, minus(mean, spin))
    d = times(h, w)
    rotate(Y, i, q, d)
    if Y[i, STEADY] == 0.0:
        write(Y, i, SPIN, symmetric_times(Y, i, IWORLD, L))
    write(Y, i, TURNED, plus(three(Y, i, TURNED), d))
    if Y[i, ROLLS] > 0.0:
        a = roll_axis(Y, i)
        d = minus(d, times(dot(a, d), a))
    write(Y, i, TILTED, plus(three(Y, i, TILTED), d))
