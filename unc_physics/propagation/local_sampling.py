"""Local sampling: each contact is perturbed by the bodies' pose uncertainty, its force's spread feeds P (section 4.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from ..belief import Belief
from ..errors import InvalidOptionError
from ..kernels.contact import DISTANCE, NORMAL, VOLUME, next_contacts
from ..kernels.random import combine, normal_table, normals
from ..kernels.so3 import rotate, rotate_back
from ..kernels.step import add_wrench, drift, kick, near_pairs, open_pair, part, workspace
from ..kernels.transition import apply_transition, write_printed_rotation
from ..layout import EP, ER, ERROR, EV, EW
from ..validation import integer
from .base import Propagator, Traits

_SAMPLES_LIMIT = 100_000
# series of sin(a) / a and (1 - cos(a)) / a^2 in -a^2
_SINE = tuple(1.0 / math.factorial(2 * k + 1) for k in range(14))
_COSINE = tuple(1.0 / math.factorial(2 * k + 2) for k in range(14))
_DRAWS = 9  # normal numbers for each sample: relative position, and rotation of both bodies


class LocalSamplingCarry(NamedTuple):
    """Persistent state: the nominal ``mean`` (B, 13) and each moving body's ``covariance`` (M, 12, 12).

    ``step`` counts the steps done, from which the draws are keyed.
    """

    mean: np.ndarray
    covariance: np.ndarray
    step: int


@dataclass(frozen=True)
class LocalSampling(Propagator):
    """Local sampling, one body at a time (Eqs. 30 to 35).

    Attributes
    ----------
    samples : int
        Perturbed copies of each contact.
    seed : int
        The draws depend on it, the step, the contact and the sample, and on nothing else.

    Notes
    -----
    The mean is a rollout with the full physics. A perturbed contact keeps the nominal volume; its direction and
    its lever arms are those of the perturbed spheres, the inertia is the nominal one. Positions and rotations are
    drawn independently, as in Eq. 31.
    """

    name = "local_sampling"
    traits = Traits("nominal", "covariance, per body", False, True, "sampled")

    samples: int = 32
    seed: int = 0

    def __post_init__(self):
        self._check_count("samples", high=_SAMPLES_LIMIT)
        integer(self.seed, "seed", low=0, error=InvalidOptionError)

    def init(self, scene, belief):
        return LocalSamplingCarry(belief.mean.copy(), belief.blocks.copy(), 0)

    def advance(self, carry, scene, steps):
        mean, covariance = carry.mean.copy(), carry.covariance.copy()
        _advance(mean, covariance, scene.world, (carry.step, steps), self.seed % 2**63, make_cloud(len(mean), self.samples))
        return LocalSamplingCarry(mean, covariance, carry.step + steps)

    def belief(self, carry, scene):
        P = 0.5 * (carry.covariance + carry.covariance.transpose(0, 2, 1))
        return Belief.trusted(carry.mean.copy(), P, scene.moving)


class Cloud(NamedTuple):
    """Pose uncertainty of the bodies in one step, and the spread of the forces between two of them.

    Attributes
    ----------
    rotation : (B, 3, 3) float64
        Factors that turn normal numbers into rotations about world axes [rad].
    known : (B,) bool
        Whether that is computed for this step.
    position : (3, 3) float64
        Factor that turns normal numbers into displacements of body j relative to body i [m].
    draws : (9, N) float64
        Normal numbers of the contact at hand.
    hashes, indices, table
        What `kernels.random.normals` takes.
    spread : (3, 6) float64
        Second moments of force, torque on body i and torque on body j about the nominal ones, each by its
        entries xx, yy, zz, xy, xz, yz, summed over the contacts of a pair.
    """

    rotation: np.ndarray
    known: np.ndarray
    position: np.ndarray
    draws: np.ndarray
    hashes: np.ndarray
    indices: np.ndarray
    table: np.ndarray
    spread: np.ndarray


_TABLE = normal_table()


def make_cloud(count, samples):
    """Room for the uncertainty of ``count`` bodies and ``samples`` perturbed copies of a contact."""
    hashes = np.empty(-(-3 * samples // 4), np.uint64)
    return Cloud(
        rotation=np.zeros((count, 3, 3)),
        known=np.zeros(count, bool),
        position=np.empty((3, 3)),
        draws=np.empty((_DRAWS, samples)),
        hashes=hashes,
        indices=hashes.view(np.uint16),
        table=_TABLE,
        spread=np.empty((3, 6)),
    )


@njit(cache=True, nogil=True)
def _advance(mean, covariance, world, span, seed, cloud):
    """Advance the nominal state and the covariances in place over ``span`` = (first step, number of steps)."""
    work = workspace(mean, world)
    count = len(mean)
    place = np.where(world.bodies.moving, np.cumsum(world.bodies.moving) - 1, -1)  # of each body's covariance
    rows, rotation = covariance.reshape(-1, ERROR), np.empty((3, 3))
    moving, R, dt, decay = world.bodies.moving, work.R, world.dt, world.decay
    for step in range(span[0], span[0] + span[1]):
        for i in range(count):
            if moving[i]:
                write_printed_rotation(R, i, dt, rotation)
                transform(rows, ERROR * place[i], dt, decay, rotation)
        drift(mean, world, work)
        cloud.known[:] = False
        step_key = combine(combine(np.uint64(0), seed), step)
        for k in range(near_pairs(mean, world, work)):
            i, j = work.near[k, 0], work.near[k, 1]
            pair_key = combine(combine(step_key, i), j)
            t_ij, slack, top = open_pair(mean, i, j, world, work)
            cloud.spread[:] = 0.0
            touching = False
            while top > 0:
                found, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                if found > 0:
                    add_wrench(mean, i, j, found, world.stiffness, work)
                    if not touching:
                        touching = True
                        know_cloud((i, j), covariance, place, work, cloud)
                    sample_contacts((i, j), found, pair_key, world.tree, work, cloud)
            if not touching:
                part(i, j, t_ij, slack, world, work)
                continue
            for side, body in ((1, i), (2, j)):
                if moving[body]:
                    kick_covariance(covariance[place[body]], world, R[body], body, cloud.spread, side)
        kick(mean, world, work)


@njit(cache=True, nogil=True, forceinline=True)
def transform(rows, first, dt, decay, rotation):
    """``A P A^T`` in place of the P in 12 ``rows`` from ``first`` on: its rows, then its columns by way of the transpose."""
    for _ in range(2):
        apply_transition(rows, first, dt, decay, rotation)
        for a in range(ERROR):
            for b in range(a):
                rows[first + a, b], rows[first + b, a] = rows[first + b, a], rows[first + a, b]


@njit(cache=True, nogil=True)
def know_cloud(bodies, covariance, place, work, cloud):
    """Factors of the covariances of two bodies' relative position, and of their rotations in world axes."""
    relative = np.zeros((3, 3))
    for body in bodies:
        if place[body] < 0:
            continue
        P = covariance[place[body]]
        relative += P[EP : EP + 3, EP : EP + 3]
        if not cloud.known[body]:
            cloud.known[body] = True
            L = cloud.rotation[body]
            write_cholesky(P, ER, L)
            for c in range(3):
                L[0, c], L[1, c], L[2, c] = rotate(work.R[body], L[0, c], L[1, c], L[2, c])
    write_cholesky(relative, 0, cloud.position)


@njit(cache=True, nogil=True)
def write_cholesky(P, first, L):
    """Lower factor of the 3 x 3 block of ``P`` that begins at ``first``; directions without variance stay zero."""
    L[:] = 0.0
    scale = P[first, first] + P[first + 1, first + 1] + P[first + 2, first + 2]
    for c in range(3):
        pivot = P[first + c, first + c]
        for m in range(c):
            pivot -= L[c, m] * L[c, m]
        if pivot <= 1e-15 * scale:
            continue
        L[c, c] = math.sqrt(pivot)
        for r in range(c + 1, 3):
            entry = P[first + r, first + c]
            for m in range(c):
                entry -= L[r, m] * L[c, m]
            L[r, c] = entry / L[c, c]


@njit(cache=True, nogil=True)
def _is_zero(A):
    for a in range(3):
        for b in range(3):
            if A[a, b] != 0.0:
                return False
    return True


@njit(cache=True, nogil=True)
def sample_contacts(bodies, found, pair_key, tree, work, cloud):
    """Add the spread of forces and torques of the first ``found`` contacts on record (Eqs. 31 to 33)."""
    i, j = bodies
    pairs, records = work.search.pairs, work.search.records
    factors = (cloud.position, cloud.rotation[i], cloud.rotation[j])
    uncertain = (not _is_zero(factors[0]), not _is_zero(factors[1]), not _is_zero(factors[2]))
    flat = cloud.draws.reshape(3, -1)
    for k in range(found):
        a, b = pairs[k, 0], pairs[k, 1]
        key = combine(combine(pair_key, a), b)
        for block in range(3):
            if uncertain[block]:
                normals(combine(key, block), flat[block], cloud.hashes, cloud.indices, cloud.table)
            else:  # what is certain draws nothing
                flat[block] = 0.0
        n = rotate(work.R[i], records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2])
        arm_i = rotate(work.R[i], tree.centers[a, 0], tree.centers[a, 1], tree.centers[a, 2])
        arm_j = rotate(work.R[j], tree.centers[b, 0], tree.centers[b, 1], tree.centers[b, 2])
        shape = (n, records[k, DISTANCE])
        add_spread(cloud.draws, factors, (arm_i, arm_j), shape, records[k, VOLUME], cloud.spread)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turned(arm, turn):
    """A vector turned by a rotation vector, without a branch, so that a loop over samples runs as vectors.

    Rodrigues' formula; the angle is first brought into [-pi, pi], where both series end within round-off.
    """
    x, y, z = turn
    angle = math.sqrt(x * x + y * y + z * z)
    whole = 1.0 - 2.0 * math.pi * np.floor(angle / (2.0 * math.pi) + 0.5) / max(angle, 1e-300)
    x, y, z = whole * x, whole * y, whole * z
    t = x * x + y * y + z * z
    s, c = _SINE[13], _COSINE[13]
    s, c = _SINE[12] - t * s, _COSINE[12] - t * c
    s, c = _SINE[11] - t * s, _COSINE[11] - t * c
    s, c = _SINE[10] - t * s, _COSINE[10] - t * c
    s, c = _SINE[9] - t * s, _COSINE[9] - t * c
    s, c = _SINE[8] - t * s, _COSINE[8] - t * c
    s, c = _SINE[7] - t * s, _COSINE[7] - t * c
    s, c = _SINE[6] - t * s, _COSINE[6] - t * c
    s, c = _SINE[5] - t * s, _COSINE[5] - t * c
    s, c = _SINE[4] - t * s, _COSINE[4] - t * c
    s, c = _SINE[3] - t * s, _COSINE[3] - t * c
    s, c = _SINE[2] - t * s, _COSINE[2] - t * c
    s, c = _SINE[1] - t * s, _COSINE[1] - t * c
    s, c = _SINE[0] - t * s, _COSINE[0] - t * c
    ax, ay, az = y * arm[2] - z * arm[1], z * arm[0] - x * arm[2], x * arm[1] - y * arm[0]
    return (
        arm[0] + s * ax + c * (y * az - z * ay),
        arm[1] + s * ay + c * (z * ax - x * az),
        arm[2] + s * az + c * (x * ay - y * ax),
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def add_spread(draws, factors, arms, shape, volume, spread):
    """Add one contact's second moments of force and torques, in units of the stiffness, to ``spread`` (3, 6).

    Parameters
    ----------
    draws : (9, N) array
        Standard normal numbers: relative displacement, rotation of body i, rotation of body j.
    factors : tuple of 3 arrays (3, 3)
        What turns them into displacements [m] and rotations about world axes [rad].
    arms : tuple of 2 tuples
        Sphere centres from their bodies' centres of mass [m].
    shape : tuple
        Nominal normal from body i to body j, and distance of the centres [m].
    volume : float
        [m^3]
    """
    L, Ti, Tj = factors
    arm_i, arm_j = arms
    n, d = shape
    D = (d * n[0], d * n[1], d * n[2])
    # nominal torques per unit of force: lever arms crossed with the normal (along which the lever adds nothing)
    ui = (arm_i[1] * n[2] - arm_i[2] * n[1], arm_i[2] * n[0] - arm_i[0] * n[2], arm_i[0] * n[1] - arm_i[1] * n[0])
    uj = (arm_j[1] * n[2] - arm_j[2] * n[1], arm_j[2] * n[0] - arm_j[0] * n[2], arm_j[0] * n[1] - arm_j[1] * n[0])
    f00 = f11 = f22 = f01 = f02 = f12 = 0.0
    i00 = i11 = i22 = i01 = i02 = i12 = 0.0
    j00 = j11 = j22 = j01 = j02 = j12 = 0.0
    for s in range(draws.shape[1]):
        x, y, z = draws[0, s], draws[1, s], draws[2, s]
        px = L[0, 0] * x
        py = L[1, 0] * x + L[1, 1] * y
        pz = L[2, 0] * x + L[2, 1] * y + L[2, 2] * z
        x, y, z = draws[3, s], draws[4, s], draws[5, s]
        ai = _turned(arm_i, (
            Ti[0, 0] * x + Ti[0, 1] * y + Ti[0, 2] * z,
            Ti[1, 0] * x + Ti[1, 1] * y + Ti[1, 2] * z,
            Ti[2, 0] * x + Ti[2, 1] * y + Ti[2, 2] * z,
        ))
        x, y, z = draws[6, s], draws[7, s], draws[8, s]
        aj = _turned(arm_j, (
            Tj[0, 0] * x + Tj[0, 1] * y + Tj[0, 2] * z,
            Tj[1, 0] * x + Tj[1, 1] * y + Tj[1, 2] * z,
            Tj[2, 0] * x + Tj[2, 1] * y + Tj[2, 2] * z,
        ))
        nx = D[0] + px + (aj[0] - arm_j[0]) - (ai[0] - arm_i[0])
        ny = D[1] + py + (aj[1] - arm_j[1]) - (ai[1] - arm_i[1])
        nz = D[2] + pz + (aj[2] - arm_j[2]) - (ai[2] - arm_i[2])
        # coincident centres have no direction: their force is zero, as a vanishing normal makes it
        scale = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        nx, ny, nz = scale * nx, scale * ny, scale * nz
        ex, ey, ez = nx - n[0], ny - n[1], nz - n[2]
        # the contact point lies on the line of centres, so each sphere's centre serves for its lever arm
        tix = ai[1] * nz - ai[2] * ny - ui[0]
        tiy = ai[2] * nx - ai[0] * nz - ui[1]
        tiz = ai[0] * ny - ai[1] * nx - ui[2]
        tjx = aj[1] * nz - aj[2] * ny - uj[0]
        tjy = aj[2] * nx - aj[0] * nz - uj[1]
        tjz = aj[0] * ny - aj[1] * nx - uj[2]
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
    weight = volume * volume / draws.shape[1]
    for row, moments in (
        (0, (f00, f11, f22, f01, f02, f12)), (1, (i00, i11, i22, i01, i02, i12)), (2, (j00, j11, j22, j01, j02, j12)),
    ):
        for c in range(6):
            spread[row, c] += weight * moments[c]


@njit(cache=True, nogil=True)
def kick_covariance(P, world, R, body, spread, side):
    """Add the spread of the kick to the diagonal blocks of the velocities (Eqs. 34 and 35); ``side`` 1 is body i."""
    a = (world.dt * world.stiffness) ** 2
    f = spread[0]
    mass = a * world.bodies.inverse_mass[body] ** 2
    inverse = np.empty((3, 3))  # of the inertia in world axes, column by column
    for c in range(3):
        x, y, z = rotate_back(R, 1.0 * (c == 0), 1.0 * (c == 1), 1.0 * (c == 2))
        x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
        inverse[0, c], inverse[1, c], inverse[2, c] = rotate(R, x, y, z)
    for r in range(3):
        for c in range(3):
            P[EV + r, EV + c] += mass * f[_entry(r, c)]
            total = 0.0
            for m in range(3):
                for k in range(3):
                    total += inverse[r, m] * spread[side, _entry(m, k)] * inverse[c, k]
            P[EW + r, EW + c] += a * total


@njit(cache=True, nogil=True)
def _entry(r, c):
    """Place of a symmetric 3 x 3 matrix's entry among xx, yy, zz, xy, xz, yz."""
    return r if r == c else r + c + 2
