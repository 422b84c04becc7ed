"""The surrogate's contacts on the explicit step: tilted normals feed the roots of velocity covariances."""

import math
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import booleans, empty, zeros
from ..physics.paper.drift_derivative import apply_drift_jacobian, write_printed_rotation
from ..physics.paper.explicit_step import after_pair, before_drift, integrate, on_contacts
from ..physics.paper.narrow_phase import DISTANCE, NORMAL, VOLUME
from ..physics.paper.workspace import workspace
from ..spatial.layout import EP, ER, ERROR, EV, EW
from ..spatial.rotation import cross, rotate, rotate_back, tangents


class Spread(NamedTuple):
    """State of the surrogate in one step: uncertainty of poses, and sums over a pair's contacts."""

    roots: np.ndarray  # (M, 12, 12) float64: of the moving bodies' covariances
    rows: np.ndarray  # (12 M, 12) float64: the same numbers
    error_block: np.ndarray  # (B,) int64: which of the roots is each body's; -1 for a fixed body
    transition: np.ndarray  # (3, 3) float64: room for a block of it
    k_sigma: float
    #: position, rotation: (B, 3, 3) float64: covariance of position [m^2] and rotation [rad^2] in world axes;
    #: zero for a fixed body
    position: np.ndarray
    rotation: np.ndarray
    known: np.ndarray  # (B,) bool: whether the two are computed for this step
    #: (3, 3) float64: sum of Eq. 21's V over the contacts of the pair of bodies at hand, in units of the
    #: stiffness [m^3]
    tilt: np.ndarray
    torque: np.ndarray  # (2, 3, 3) float64: sums of [r]x V for its two bodies [m^4]


@kernel(noinline=True)
def spread_of(roots, moving, k_sigma):
    """Return the state of the surrogate for roots (M, 12, 12) of ``moving`` bodies (B,)."""
    count = len(moving)
    return Spread(
        roots,
        roots.reshape(-1, ERROR),
        np.where(moving, np.cumsum(moving) - 1, -1),
        empty((3, 3)),
        k_sigma,
        zeros((count, 3, 3)),
        zeros((count, 3, 3)),
        booleans(count),
        empty((3, 3)),
        empty((2, 3, 3)),
    )


@kernel
def advance_roots(mean, roots, first_time, world, environment, begin, steps, k_sigma):
    """Advance the nominal state and the roots in place."""
    spread = spread_of(roots, world.bodies.moving, k_sigma)
    integrate(mean, first_time, world, environment, spread, begin, steps, workspace(mean, world))


@before_drift.of(Spread)
def _begin_step(spread, x, step, world, work):
    """Begin a step with the drift."""
    drift_roots(spread, x, step, world, work)


@inner(forceinline=True)
def drift_roots(spread, x, step, world, work):
    """Multiply all roots by the transition of the drift (Eq. 14)."""
    for i in range(len(x)):
        if world.bodies.moving[i]:
            write_printed_rotation(work.R, i, world.dt, spread.transition)
            apply_drift_jacobian(
                spread.rows,
                ERROR * spread.error_block[i],
                x,
                i,
                work.R,
                world,
                world.environment,
                spread.transition,
            )
        spread.known[i] = False


@on_contacts.of(Spread)
def _tilt_normals(spread, x, i, j, count, first, world, work):
    """Add the increments by tilted normals of ``count`` contacts of bodies i and j."""
    if first:
        spread.tilt[:] = 0.0
        spread.torque[:] = 0.0
        for body in (i, j):
            if world.bodies.moving[body] and not spread.known[body]:
                cache_pose_covariance(spread.roots[spread.error_block[body]], work.R[body], body, spread)
    add_tilts((i, j), count, spread.k_sigma, world.tree, work, spread)


@after_pair.of(Spread)
def _kick_roots(spread, x, i, j, world, work):
    """Let the tilts of a pair's normals act on the roots of both bodies."""
    for side, body in ((0, i), (1, j)):
        if world.bodies.moving[body]:
            kick_root(spread.roots[spread.error_block[body]], world, work.R[body], body, spread, side)


@inner
def cache_pose_covariance(S, R, body, spread):
    """Write the covariances of position, and of rotation in world axes, from the root ``S`` (12, 12)."""
    spread.known[body] = True
    position, rotation = spread.position[body], spread.rotation[body]
    for a in range(3):
        for b in range(a + 1):
            p = t = 0.0
            for c in range(ERROR):
                p += S[EP + a, c] * S[EP + b, c]
                t += S[ER + a, c] * S[ER + b, c]
            position[a, b] = position[b, a] = p
            rotation[a, b] = rotation[b, a] = t
    for _ in range(2):  # the rows, then those of the transpose
        for b in range(3):
            rotation[0, b], rotation[1, b], rotation[2, b] = rotate(
                R, rotation[0, b], rotation[1, b], rotation[2, b]
            )
        rotation[0, 1], rotation[1, 0] = rotation[1, 0], rotation[0, 1]
        rotation[0, 2], rotation[2, 0] = rotation[2, 0], rotation[0, 2]
        rotation[1, 2], rotation[2, 1] = rotation[2, 1], rotation[1, 2]


@inner(forceinline=True)
def _symmetric(A):
    """Return a symmetric matrix as the tuple of its entries xx, yy, zz, xy, xz, yz."""
    return A[0, 0], A[1, 1], A[2, 2], A[0, 1], A[0, 2], A[1, 2]


@inner(forceinline=True)
def _forms(A, u, w):
    """Return ``u^T A u``, ``u^T A w`` and ``w^T A w`` of a symmetric matrix, as `_symmetric` returns it."""
    x, y = A[0] * u[0] + A[3] * u[1] + A[4] * u[2], A[3] * u[0] + A[1] * u[1] + A[5] * u[2]
    z = A[4] * u[0] + A[5] * u[1] + A[2] * u[2]
    uu, uw = u[0] * x + u[1] * y + u[2] * z, w[0] * x + w[1] * y + w[2] * z
    x, y = A[0] * w[0] + A[3] * w[1] + A[4] * w[2], A[3] * w[0] + A[1] * w[1] + A[5] * w[2]
    z = A[4] * w[0] + A[5] * w[1] + A[2] * w[2]
    return uu, uw, w[0] * x + w[1] * y + w[2] * z


@inner(error_model="numpy")
def _sine_of_tilt(variance, d, k_sigma):
    """Return the sine of Eq. 20's angle ``atan(k_sigma sqrt(variance) / d)``."""
    reach = k_sigma * math.sqrt(max(variance, 0.0))
    return reach / math.sqrt(d * d + reach * reach)


@inner(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def add_tilts(bodies, found, k_sigma, tree, work, spread):
    """Add Eq. 21's increments, and their moments, of the first ``found`` contacts on record (Eqs. 16 to 23).

    Sums over the contacts are kept in scalars, in no fixed order, so that the loop runs as vectors.
    """
    i, j = bodies
    R_i, R_j, centers = work.R[i], work.R[j], tree.centers
    pairs, records = work.search.pairs, work.search.records
    s, t = _symmetric(spread.position[i]), _symmetric(spread.position[j])
    position = s[0] + t[0], s[1] + t[1], s[2] + t[2], s[3] + t[3], s[4] + t[4], s[5] + t[5]
    rotation_i, rotation_j = _symmetric(spread.rotation[i]), _symmetric(spread.rotation[j])
    xx = yy = zz = xy = xz = yz = 0.0
    i00 = i01 = i02 = i10 = i11 = i12 = i20 = i21 = i22 = 0.0
    j00 = j01 = j02 = j10 = j11 = j12 = j20 = j21 = j22 = 0.0
    for k in range(found):
        a, b = pairs[k, 0], pairs[k, 1]
        n = rotate(R_i, records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2])
        p = rotate(R_i, centers[a, 0], centers[a, 1], centers[a, 2])
        q = rotate(R_j, centers[b, 0], centers[b, 1], centers[b, 2])
        u, w = tangents(n)
        # J Sigma J^T with J = -R [r]x is [arm]x (R Sigma R^T) [arm]x^T in world axes
        one, two = _forms(position, u, w), _forms(rotation_i, cross(u, p), cross(w, p))
        three = _forms(rotation_j, cross(u, q), cross(w, q))
        uu, uw, ww = one[0] + two[0] + three[0], one[1] + two[1] + three[1], one[2] + two[2] + three[2]
        # Eq. 21 is a function of the 2 x 2 matrix: alpha I + beta Sigma_T takes its eigenvalues to the sigmas
        half, mean = math.sqrt(0.25 * (uu - ww) ** 2 + uw * uw), 0.5 * (uu + ww)
        d, scale = records[k, DISTANCE], records[k, VOLUME] / 3.0
        high = scale * _sine_of_tilt(mean + half, d, k_sigma)
        low = scale * _sine_of_tilt(mean - half, d, k_sigma)
        beta = 0.5 * (high - low) / half if half > 0.0 else 0.0
        alpha = 0.5 * (high + low) - beta * mean
        uu, uw, ww = alpha + beta * uu, beta * uw, alpha + beta * ww
        g = uu * u[0] + uw * w[0], uu * u[1] + uw * w[1], uu * u[2] + uw * w[2]
        h = uw * u[0] + ww * w[0], uw * u[1] + ww * w[1], uw * u[2] + ww * w[2]
        v00, v11, v22 = g[0] * u[0] + h[0] * w[0], g[1] * u[1] + h[1] * w[1], g[2] * u[2] + h[2] * w[2]
        v01, v02, v12 = g[0] * u[1] + h[0] * w[1], g[0] * u[2] + h[0] * w[2], g[1] * u[2] + h[1] * w[2]
        xx += v00
        yy += v11
        zz += v22
        xy += v01
        xz += v02
        yz += v12
        i00 += p[1] * v02 - p[2] * v01
        i01 += p[1] * v12 - p[2] * v11
        i02 += p[1] * v22 - p[2] * v12
        i10 += p[2] * v00 - p[0] * v02
        i11 += p[2] * v01 - p[0] * v12
        i12 += p[2] * v02 - p[0] * v22
        i20 += p[0] * v01 - p[1] * v00
        i21 += p[0] * v11 - p[1] * v01
        i22 += p[0] * v12 - p[1] * v02
        j00 += q[1] * v02 - q[2] * v01
        j01 += q[1] * v12 - q[2] * v11
        j02 += q[1] * v22 - q[2] * v12
        j10 += q[2] * v00 - q[0] * v02
        j11 += q[2] * v01 - q[0] * v12
        j12 += q[2] * v02 - q[0] * v22
        j20 += q[0] * v01 - q[1] * v00
        j21 += q[0] * v11 - q[1] * v01
        j22 += q[0] * v12 - q[1] * v02
    _add(spread.tilt, (xx, xy, xz, xy, yy, yz, xz, yz, zz))
    _add(spread.torque[0], (i00, i01, i02, i10, i11, i12, i20, i21, i22))
    _add(spread.torque[1], (j00, j01, j02, j10, j11, j12, j20, j21, j22))


@inner
def _add(A, entries):
    """Add nine entries to a 3 x 3 matrix, row by row."""
    for k in range(9):
        A[k // 3, k % 3] += entries[k]


@inner
def kick_root(S, world, R, body, spread, side):
    """Add the pair's increments to the diagonal blocks of the velocities in the root (Eqs. 22 and 23)."""
    a = world.dt * world.stiffness * world.bodies.inverse_mass[body]
    b = world.dt * world.stiffness / 3.0
    for c in range(3):
        x, y, z = rotate_back(
            R, spread.torque[side, 0, c], spread.torque[side, 1, c], spread.torque[side, 2, c]
        )
        x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
        x, y, z = rotate(R, x, y, z)
        S[EW, EW + c] += b * x
        S[EW + 1, EW + c] += b * y
        S[EW + 2, EW + c] += b * z
        for r in range(3):
            S[EV + r, EV + c] += a * spread.tilt[r, c]
