"""Covariance of contact forces and torques between two bodies, from perturbed copies (Eqs. 31 to 33).

Each contact is copied at perturbed poses. Its copies are computed as vectors, in single precision.
"""

import math

import numpy as np

from ..compiler import inner, kernel
from ..physics.paper.narrow_phase import DISTANCE, NORMAL, VOLUME
from ..spatial.random import RUN, combine, normal_table, places
from ..spatial.rotation import rotate


def _series(terms, first):
    """Return coefficients of sin(a) / a (``first`` 1) or (1 - cos(a)) / a^2 (2) in -a^2, last order first."""
    return tuple(np.float32(1.0 / math.factorial(2 * k + first)) for k in reversed(range(terms)))


_SHORT = 5  # terms, which are exact in single precision up to an angle of
_SMALL = 1.0  # rad; as many as 11 are so up to pi
_SMALL_SERIES = _series(_SHORT, 1), _series(_SHORT, 2)
_SERIES = _series(11, 1), _series(11, 2)
_ALL_OVER = 1e6  # spread so large that more of it changes nothing, in units of the contact's size
_ZERO, _HALF, _ONE, _TURN = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0 * math.pi)
_TINY = np.float32(1e-30)
#: Centres that a copy brings nearer, relative to their distance, count as so near.
_CLOSEST = np.float32(1e-4)
#: Normal numbers, from which the copies are drawn.
TABLE = normal_table()
_LARGEST = math.sqrt(3.0) * float(TABLE.max())  # length of three normal numbers from the table


@inner
def frobenius_norm(A):
    """Return the Frobenius norm of a 3 x 3 matrix, the RMS length of its product with normal numbers."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += A[a, b] * A[a, b]
    return math.sqrt(total)


@inner(error_model="numpy")
def sample_contacts(bodies, found, pair_key, tree, work, cloud):
    """Add the spread of forces and torques of the first ``found`` contacts on record (Eqs. 31 to 33)."""
    i, j = bodies
    pairs, records, centers, R_i = work.search.pairs, work.search.records, tree.centers, work.R[i]
    R_j = work.R[j]
    position, table, samples, spread = cloud.position, cloud.table, cloud.samples, cloud.spread
    apart = frobenius_norm(position)
    turning = max(frobenius_norm(cloud.rotation[i]), frobenius_norm(cloud.rotation[j]))
    if apart == 0.0 and turning == 0.0:
        return
    turn_i, turn_j = _single(cloud.rotation[i], 1.0), _single(cloud.rotation[j], 1.0)
    for k in range(found):
        a, b = pairs[k, 0], pairs[k, 1]
        key = combine(combine(pair_key, a), b)
        n = rotate(R_i, records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2])
        arm_i = rotate(R_i, centers[a, 0], centers[a, 1], centers[a, 2])
        arm_j = rotate(R_j, centers[b, 0], centers[b, 1], centers[b, 2])
        # lengths in units of the contact's own size stay within the range of single precision
        size = (
            records[k, DISTANCE]
            + abs(arm_i[0])
            + abs(arm_i[1])
            + abs(arm_i[2])
            + abs(arm_j[0])
            + abs(arm_j[1])
            + abs(arm_j[2])
        )
        factors = _single(position, min(1.0 / size, _ALL_OVER / max(apart, 1e-300))), turn_i, turn_j
        shape = (
            _short(n, 1.0),
            _short(arm_i, 1.0 / size),
            _short(arm_j, 1.0 / size),
            np.float32(records[k, DISTANCE] / size),
        )
        force = records[k, VOLUME] ** 2 / samples
        weights = force, force * size * size
        for first in range(0, samples, RUN):
            starts, count = places(combine(key, first)), np.uint64(min(RUN, samples - first))
            if turning * _LARGEST < _SMALL:
                add_spread(table, starts, count, factors, shape, _SMALL_SERIES, weights, spread)
            else:
                add_spread(table, starts, count, factors, shape, _SERIES, weights, spread)


@inner(forceinline=True)
def _single(A, scale):
    """Return the entries of a 3 x 3 matrix, times ``scale``, in single precision."""
    f = np.float32
    return (
        f(scale * A[0, 0]),
        f(scale * A[0, 1]),
        f(scale * A[0, 2]),
        f(scale * A[1, 0]),
        f(scale * A[1, 1]),
        f(scale * A[1, 2]),
        f(scale * A[2, 0]),
        f(scale * A[2, 1]),
        f(scale * A[2, 2]),
    )


@inner(forceinline=True)
def _short(a, scale):
    """Return a vector times ``scale`` in single precision."""
    return np.float32(scale * a[0]), np.float32(scale * a[1]), np.float32(scale * a[2])


@kernel(noinline=True, arrays=False, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def add_spread(table, starts, count, factors, shape, series, weights, spread):
    """Add second moments of force and torques over samples of one contact, per squared stiffness.

    All lengths are in units of a size of the contact. All numbers except ``weights`` and ``spread`` have
    single precision.

    Parameters
    ----------
    table : (n,) array
    starts : tuple of 9 uint64
        Where the samples' normal numbers begin in ``table``: three of the relative displacement, three of the
        rotation of body i, three of the rotation of body j.
    count : uint64
        Number of samples.
    factors : tuple of 3 tuples of 9
        Factors from normal numbers to displacements and to rotations about world axes [rad].
    shape : tuple
        Nominal normal from body i to body j, sphere centres from their bodies' centres of mass, distance of
        the centres.
    series : tuple of 2 tuples
    weights : tuple of 2 floats
        Of the force's and the torques' moments.
    spread : (3, 6) array
    """
    o = starts
    n, arm_i, arm_j, d = shape
    D = d * n[0], d * n[1], d * n[2]
    f00 = f11 = f22 = f01 = f02 = f12 = _ZERO
    i00 = i11 = i22 = i01 = i02 = i12 = _ZERO
    j00 = j11 = j22 = j01 = j02 = j12 = _ZERO
    for s in range(count):
        px, py, pz = _times(factors[0], table[o[0] + s], table[o[1] + s], table[o[2] + s])
        ai = _shift(arm_i, _times(factors[1], table[o[3] + s], table[o[4] + s], table[o[5] + s]), series)
        aj = _shift(arm_j, _times(factors[2], table[o[6] + s], table[o[7] + s], table[o[8] + s]), series)
        px, py, pz = px + aj[0] - ai[0], py + aj[1] - ai[1], pz + aj[2] - ai[2]
        # change of the normal from one small quantity to the next: a difference of two normals would lose
        # digits
        qx, qy, qz = D[0] + px, D[1] + py, D[2] + pz
        q = max(math.sqrt(qx * qx + qy * qy + qz * qz), _CLOSEST * d)
        both = q + d
        inverse = _ONE / (q * both)
        stretch = px * (D[0] + qx) + py * (D[1] + qy) + pz * (D[2] + qz)
        ex, ey = (both * px - stretch * n[0]) * inverse, (both * py - stretch * n[1]) * inverse
        ez = (both * pz - stretch * n[2]) * inverse
        nx, ny, nz = n[0] + ex, n[1] + ey, n[2] + ez
        # the contact point lies on the line of centres, so each sphere's centre serves for its lever arm
        tix = ai[1] * nz - ai[2] * ny + arm_i[1] * ez - arm_i[2] * ey
        tiy = ai[2] * nx - ai[0] * nz + arm_i[2] * ex - arm_i[0] * ez
        tiz = ai[0] * ny - ai[1] * nx + arm_i[0] * ey - arm_i[1] * ex
        tjx = aj[1] * nz - aj[2] * ny + arm_j[1] * ez - arm_j[2] * ey
        tjy = aj[2] * nx - aj[0] * nz + arm_j[2] * ex - arm_j[0] * ez
        tjz = aj[0] * ny - aj[1] * nx + arm_j[0] * ey - arm_j[1] * ex
        f00 += ex * ex
        f11 += ey * ey
        f22 += ez * ez
        f01 += ex * ey
        f02 += ex * ez
        f12 += ey * ez
        i00 += tix * tix
        i11 += tiy * tiy
        i22 += tiz * tiz
        i01 += tix * tiy
        i02 += tix * tiz
        i12 += tiy * tiz
        j00 += tjx * tjx
        j11 += tjy * tjy
        j22 += tjz * tjz
        j01 += tjx * tjy
        j02 += tjx * tjz
        j12 += tjy * tjz
    for row, weight, moments in (
        (0, weights[0], (f00, f11, f22, f01, f02, f12)),
        (1, weights[1], (i00, i11, i22, i01, i02, i12)),
        (2, weights[1], (j00, j11, j22, j01, j02, j12)),
    ):
        for c in range(6):
            spread[row, c] += weight * moments[c]


@inner(error_model="numpy", forceinline=True)
def _shift(arm, turn, series):
    """Return the change of ``arm`` by a rotation vector (Rodrigues' formula), without branches on samples.

    Long series are for any angle, which is first brought into [-pi, pi]; short ones are for small angles.
    """
    x, y, z = turn
    t = x * x + y * y + z * z
    sine, cosine = series
    if len(sine) > _SHORT:
        angle = math.sqrt(t)
        whole = angle - _TURN * np.floor(angle / _TURN + _HALF)
        t = whole * whole
        whole /= max(angle, _TINY)
        x, y, z = whole * x, whole * y, whole * z
    s, c = sine[0], cosine[0]
    for k in range(1, len(sine)):
        s, c = sine[k] - t * s, cosine[k] - t * c
    ax, ay, az = y * arm[2] - z * arm[1], z * arm[0] - x * arm[2], x * arm[1] - y * arm[0]
    return (s * ax + c * (y * az - z * ay), s * ay + c * (z * ax - x * az), s * az + c * (x * ay - y * ax))


@inner(forceinline=True)
def _times(A, x, y, z):
    """Return the product of a matrix, as the tuple of its entries, with a vector."""
    return A[0] * x + A[1] * y + A[2] * z, A[3] * x + A[4] * y + A[5] * z, A[6] * x + A[7] * y + A[8] * z
