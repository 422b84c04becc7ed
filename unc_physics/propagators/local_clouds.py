"""Local sampling's clouds on the explicit step: perturbed contacts feed velocity covariances."""

import math
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import booleans, empty, zeros
from ..physics.paper.drift_derivative import apply_drift_jacobian, write_printed_rotation
from ..physics.paper.explicit_step import (
    after_element,
    after_pair,
    before_drift,
    integrate,
    on_contacts,
    on_element_contacts,
)
from ..physics.paper.narrow_phase import NORMAL, VOLUME
from ..physics.paper.solids import surface
from ..physics.paper.workspace import workspace
from ..spatial.layout import EP, ER, ERROR, EV, EW
from ..spatial.random import RUN, combine, places
from ..spatial.rotation import cross, exp, rotate, rotate_back, rotate_by_quaternion
from .sampled_contacts import frobenius_norm, sample_contacts

_ROUND_OFF = 1e-6  # of a spread's trace: what single precision may lose
_ALL_AROUND = 1e4  # rad; more spread than that changes nothing, and single precision still holds it


class ContactCloud(NamedTuple):
    """State of local sampling in one step: uncertainty of poses, and of the forces between two bodies."""

    covariance: np.ndarray  # (M, 12, 12) float64: of the moving bodies
    rows: np.ndarray  # (12 M, 12) float64: the same numbers
    error_block: np.ndarray  # (B,) int64: which of the covariances is each body's; -1 for a fixed body
    transition: np.ndarray  # (3, 3) float64: room for a block of it
    #: (B, 3, 3) float64: factors that turn normal numbers into rotations about world axes [rad]
    rotation: np.ndarray
    known: np.ndarray  # (B,) bool: whether that is computed for this step
    #: relative, position: (3, 3) float64: covariance of body j's position relative to body i [m^2], and its
    #: factor, which turns normal numbers into displacements
    relative: np.ndarray
    position: np.ndarray
    inverse: np.ndarray  # (3, 3) float64: room for an inverse inertia in world axes
    table: np.ndarray  # normal numbers (`spatial.random.normal_table`)
    samples: int  # perturbed copies of each contact
    seed: int
    key: np.ndarray  # (1,) uint64: from which this step's draws are made
    #: (3, 6) float64: second moments of force, torque on body i and torque on body j about the nominal ones,
    #: each by its entries xx, yy, zz, xy, xz, yz, summed over the contacts of a pair
    spread: np.ndarray


@kernel(noinline=True)
def cloud_of(covariance, moving, draws):
    """Return the state of local sampling for covariances (M, 12, 12) of ``moving`` bodies (B,)."""
    count = len(moving)
    table, samples, seed = draws
    return ContactCloud(
        covariance,
        covariance.reshape(-1, ERROR),
        np.where(moving, np.cumsum(moving) - 1, -1),
        empty((3, 3)),
        zeros((count, 3, 3)),
        booleans(count),
        empty((3, 3)),
        empty((3, 3)),
        empty((3, 3)),
        table,
        samples,
        seed,
        np.empty(1, np.uint64),
        empty((3, 6)),
    )


@kernel
def advance_covariances(mean, covariance, first_time, world, environment, begin, steps, draws):
    """Advance state and covariances in place; ``draws`` are the table, the samples and the seed."""
    cloud = cloud_of(covariance, world.bodies.moving, draws)
    integrate(mean, first_time, world, environment, cloud, begin, steps, workspace(mean, world))


@before_drift.of(ContactCloud)
def _begin_step(cloud, x, step, world, work):
    """Begin a step with the drift."""
    drift_covariances(cloud, x, step, world, work)


@inner(forceinline=True)
def drift_covariances(cloud, x, step, world, work):
    """Take all covariances through the transition of the drift (Eq. 30)."""
    cloud.key[0] = combine(combine(np.uint64(0), cloud.seed), step)
    for i in range(len(x)):
        cloud.known[i] = False
        if world.bodies.moving[i]:
            write_printed_rotation(work.R, i, world.dt, cloud.transition)
            transform(cloud.rows, ERROR * cloud.error_block[i], x, i, work.R, world, cloud.transition)


@on_contacts.of(ContactCloud)
def _sample_pair(cloud, x, i, j, count, first, world, work):
    """Add the spread of the forces of ``count`` contacts of bodies i and j."""
    if first:
        cloud.spread[:] = 0.0
        factor_pose_covariance((i, j), work, cloud)
    sample_contacts((i, j), count, combine(combine(cloud.key[0], i), j), world.tree, work, cloud)


@after_pair.of(ContactCloud)
def _kick_pair(cloud, x, i, j, world, work):
    """Let the spread of a pair's forces act on both covariances."""
    for side, body in ((1, i), (2, j)):
        if world.bodies.moving[body]:
            kick_covariance(body, side, world, work.R[body], cloud)


@on_element_contacts.of(ContactCloud)
def _sample_element(cloud, x, i, e, t, count, first, world, work):
    """Add the spread of the forces of ``count`` contacts of body i and element e."""
    if first:
        cloud.spread[:] = 0.0
        factor_pose_covariance((i, i), work, cloud)
    key = combine(combine(cloud.key[0], i), -1 - e)
    sample_element_contacts(i, e, count, key, t, world.tree, world.environment, work, cloud)


@after_element.of(ContactCloud)
def _kick_body(cloud, x, i, e, world, work):
    """Let the spread of an element's forces act on the covariance of body i."""
    kick_covariance(i, 1, world, work.R[i], cloud)


@inner
def sample_element_contacts(i, e, found, pair_key, t, tree, environment, work, cloud):
    """Add the spread of force and torque of body i's first ``found`` contacts with element e.

    The normal is that of the element's surface at the perturbed centre of the sphere; a plane's has none.
    """
    L, T, R, R_e = cloud.position, cloud.rotation[i], work.R[i], environment.R[e]
    records, table = work.search.records, cloud.table
    half = 1.0 / math.sqrt(2.0)  # the factor at hand is that of twice the body's own variance
    for k in range(found):
        sphere = work.search.pairs[k, 0]
        arm = rotate(R, tree.centers[sphere, 0], tree.centers[sphere, 1], tree.centers[sphere, 2])
        n = rotate(R, -records[k, NORMAL], -records[k, NORMAL + 1], -records[k, NORMAL + 2])
        ux, uy, uz = cross(arm, n)
        weight = records[k, VOLUME] ** 2 / cloud.samples
        for first in range(0, cloud.samples, RUN):
            o = places(combine(combine(pair_key, sphere), first))
            for s in range(np.uint64(min(RUN, cloud.samples - first))):
                z0, z1, z2 = table[o[0] + s], table[o[1] + s], table[o[2] + s]
                p = (
                    half * L[0, 0] * z0,
                    half * (L[1, 0] * z0 + L[1, 1] * z1),
                    half * (L[2, 0] * z0 + L[2, 1] * z1 + L[2, 2] * z2),
                )
                z0, z1, z2 = table[o[3] + s], table[o[4] + s], table[o[5] + s]
                turn = rotate(T, float(z0), float(z1), float(z2))
                a = rotate_by_quaternion(exp(turn[0], turn[1], turn[2]), arm)
                c = rotate_back(R_e, p[0] + a[0], p[1] + a[1], p[2] + a[2])
                m = surface(environment.kind, environment.size, e, t[0] + c[0], t[1] + c[1], t[2] + c[2])[1]
                m = rotate(R_e, m[0], m[1], m[2])
                b = cross(a, m)
                add_moments(cloud.spread[0], weight, (m[0] - n[0], m[1] - n[1], m[2] - n[2]))
                add_moments(cloud.spread[1], weight, (b[0] - ux, b[1] - uy, b[2] - uz))


@inner
def add_moments(out, weight, a):
    """Add a vector's second moments to the six entries xx, yy, zz, xy, xz, yz."""
    out[0] += weight * a[0] * a[0]
    out[1] += weight * a[1] * a[1]
    out[2] += weight * a[2] * a[2]
    out[3] += weight * a[0] * a[1]
    out[4] += weight * a[0] * a[2]
    out[5] += weight * a[1] * a[2]


@inner(noinline=True)
def transform(rows, first, x, i, R, world, rotation):
    """Replace body i's symmetric P, in 12 ``rows`` from ``first`` on, by ``A P A^T``, as ``A (A P)^T``."""
    for turn in range(2):
        apply_drift_jacobian(rows, first, x, i, R, world, world.environment, rotation)
        if turn == 0:
            transpose(rows, first)


@inner(forceinline=True)
def transpose(rows, first):
    """Transpose the matrix in 12 ``rows`` from ``first`` on."""
    for a in range(ERROR):
        for b in range(a):
            rows[first + a, b], rows[first + b, a] = rows[first + b, a], rows[first + a, b]


@inner
def factor_pose_covariance(bodies, work, cloud):
    """Write factors of the covariances of two bodies' relative position and rotations, world axes."""
    cloud.relative[:] = 0.0
    for body in bodies:
        if cloud.error_block[body] < 0:
            continue
        P = cloud.covariance[cloud.error_block[body]]
        for r in range(3):
            for c in range(3):
                cloud.relative[r, c] += P[EP + r, EP + c]
        if not cloud.known[body]:
            cloud.known[body] = True
            L = cloud.rotation[body]
            write_cholesky(P, ER, L)
            within = min(1.0, _ALL_AROUND / max(frobenius_norm(L), 1e-300))
            for c in range(3):
                L[0, c], L[1, c], L[2, c] = rotate(
                    work.R[body], within * L[0, c], within * L[1, c], within * L[2, c]
                )
    write_cholesky(cloud.relative, 0, cloud.position)


@inner
def write_cholesky(P, first, L):
    """Write the lower factor of the 3 x 3 block of ``P`` at ``first``; it is zero without variance."""
    L[:] = 0.0
    scale = P[first, first] + P[first + 1, first + 1] + P[first + 2, first + 2]
    for c in range(3):
        pivot = P[first + c, first + c]
        for m in range(c):
            pivot -= L[c, m] * L[c, m]
        if pivot <= 1e-15 * max(scale, 0.0):
            continue
        L[c, c] = math.sqrt(pivot)
        for r in range(c + 1, 3):
            entry = P[first + r, first + c]
            for m in range(c):
                entry -= L[r, m] * L[c, m]
            L[r, c] = entry / L[c, c]


@inner
def kick_covariance(body, side, world, R, cloud):
    """Add the kick's spread to the velocities' diagonal blocks (Eqs. 34 and 35); ``side`` 1 is body i."""
    P, spread, inverse = cloud.covariance[cloud.error_block[body]], cloud.spread, cloud.inverse
    a = (world.dt * world.stiffness) ** 2
    f = spread[0]
    # sums in single precision may have lost what keeps them semidefinite
    force_lift = _ROUND_OFF * (f[0] + f[1] + f[2])
    torque_lift = _ROUND_OFF * (spread[side, 0] + spread[side, 1] + spread[side, 2])
    mass = a * world.bodies.inverse_mass[body] ** 2
    for c in range(3):  # of the inertia in world axes, column by column
        x, y, z = rotate_back(R, 1.0 * (c == 0), 1.0 * (c == 1), 1.0 * (c == 2))
        x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
        inverse[0, c], inverse[1, c], inverse[2, c] = rotate(R, x, y, z)
    for r in range(3):
        for c in range(3):
            P[EV + r, EV + c] += mass * (f[_entry(r, c)] + force_lift * (r == c))
            total = 0.0
            for m in range(3):
                for k in range(3):
                    total += (
                        inverse[r, m] * (spread[side, _entry(m, k)] + torque_lift * (m == k)) * inverse[c, k]
                    )
            P[EW + r, EW + c] += a * total


@inner
def _entry(r, c):
    """Return the place of a symmetric 3 x 3 matrix's entry among xx, yy, zz, xy, xz, yz."""
    return r if r == c else r + c + 2
