"""Twin of the implicit step's stages: brute force over all spheres, dense matrices, general solvers.

A state is (B, 13); velocities of all bodies are one vector (6 B,), a linear and an angular one for each body.
Fixed bodies have no inverse mass.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation

from .states import P, Q, V, W

ACTIVE, IMPACT, TOUCHING, AIM = (
    5e-4,
    2e-4,
    2e-5,
    1e-5,
)  # m: gaps of what takes part in a step, in an impact; of touch
SAME_PATCH, TILT, BONUS = 0.9, 0.02, 1e-4  # of the reduction: a cosine, an angle, and a depth [m]


class Contact(NamedTuple):
    """Spheres ``a`` of body ``i`` and ``b`` of body ``j``, or element ``-1 - j``; world frame.

    ``point`` is on the first sphere's surface, ``normal`` points towards its body, ``center_j`` is the middle
    of the second sphere, ``predicted`` the gap after the horizon.
    """

    i: int
    j: int
    a: int
    b: int
    normal: np.ndarray
    point: np.ndarray
    gap: float
    predicted: float
    center_i: np.ndarray
    center_j: np.ndarray
    radius: float


def centers(body, s):
    return s[P] + body.model.centers @ Rotation.from_quat(s[Q]).as_matrix().T


def _speed_at(s, points, gravity, horizon, fixed=False):
    """Mean velocity over the horizon of a body's points in free fall."""
    return s[V] + (0.0 if fixed else 0.5 * horizon) * np.asarray(gravity) + np.cross(s[W], points - s[P])


def candidates(scene, x, i, j, horizon):
    """All contacts of body i with body j, or element ``-1 - j``, now or within ``horizon`` seconds."""
    limit = ACTIVE if horizon > 0.0 else IMPACT
    ci, ri = centers(scene.bodies[i], x[i]), scene.bodies[i].model.radii
    vi = _speed_at(x[i], ci, scene.gravity, horizon)
    found = []
    if j < 0:
        distances, normals = scene.environment[-1 - j].surface(ci)
        for a, (distance, n) in enumerate(zip(distances, normals, strict=True)):
            gap = distance - ri[a]
            predicted = gap + horizon * n @ vi[a]
            if min(gap, predicted) < limit:
                found.append(Contact(i, j, a, 0, n, ci[a] - ri[a] * n, gap, predicted, ci[a], None, ri[a]))
        return found
    cj, rj = centers(scene.bodies[j], x[j]), scene.bodies[j].model.radii
    vj = _speed_at(x[j], cj, scene.gravity, horizon, scene.bodies[j].fixed)
    away = ci[:, None] - cj[None]
    distance = np.linalg.norm(away, axis=2)
    normal = away / distance[..., None]
    gaps = distance - ri[:, None] - rj
    predictions = gaps + horizon * np.sum(normal * (vi[:, None] - vj), axis=2)
    for a, b in np.argwhere(np.minimum(gaps, predictions) < limit):
        n = normal[a, b]
        radius = ri[a] * rj[b] / (ri[a] + rj[b])
        found.append(
            Contact(i, j, a, b, n, ci[a] - ri[a] * n, gaps[a, b], predictions[a, b], ci[a], cj[b], radius)
        )
    return found


def reduced(found, s, loaded=()):
    """Those that stand for all: of each patch the deepest, and the deepest as seen when it is tilted in eight
    directions.

    ``s`` is body i's state; ``loaded`` has pairs of spheres that carried load in the last step, which count
    as deeper.
    """
    R = Rotation.from_quat(s[Q]).as_matrix()
    score = {(c.a, c.b): c.predicted - (BONUS if (c.a, c.b) in loaded else 0.0) for c in found}
    left, kept = list(found), set()
    while left:
        deepest = min(left, key=lambda c: score[c.a, c.b])
        patch = [c for c in left if c.normal @ deepest.normal >= SAME_PATCH]
        kept.add((deepest.a, deepest.b))
        n = R.T @ deepest.normal
        first, second = frame(n)
        for angle in 0.25 * np.pi * np.arange(8):
            tilt = TILT * (np.cos(angle) * first + np.sin(angle) * second)
            lowest = min(patch, key=lambda c: score[c.a, c.b] + tilt @ (R.T @ (c.point - s[P])))
            kept.add((lowest.a, lowest.b))
        left = [c for c in left if c.normal @ deepest.normal < SAME_PATCH]
    return kept


def frame(n):
    """Two unit vectors across ``n``, continuous but at one pole (Duff et al. 2017)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return np.array([1.0 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]]), np.array(
        [b, sign + n[1] ** 2 * a, -n[1]]
    )


def inverse_mass(scene, x):
    """(6 B, 6 B)"""
    out = np.zeros((6 * len(x), 6 * len(x)))
    for k in scene.moving:
        body, R = scene.bodies[k], Rotation.from_quat(x[k, Q]).as_matrix()
        out[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = np.eye(3) / body.mass
        out[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = (
            R @ np.linalg.inv(body.mass * body.model.inertia) @ R.T
        )
    return out


def velocities(x):
    """(6 B,)"""
    return np.concatenate([x[:, V], x[:, W]], axis=1).ravel()


def jacobian(contacts, x):
    """(3 m, 6 B): velocities at the middles of the gaps along each contact's normal and two directions
    across.
    """
    J = np.zeros((3 * len(contacts), 6 * len(x)))
    for k, c in enumerate(contacts):
        middle = c.point - 0.5 * c.gap * c.normal
        for d, axis in enumerate((c.normal, *frame(c.normal))):
            for body, sign in ((c.i, 1.0), (c.j, -1.0)):
                if body >= 0:
                    J[3 * k + d, 6 * body : 6 * body + 3] = sign * axis
                    J[3 * k + d, 6 * body + 3 : 6 * body + 6] = sign * np.cross(middle - x[body, P], axis)
    return J


def bend(c, x):
    """Second derivative of a gap at constant velocities, as the spheres' centres go round [m/s^2]."""
    total = c.normal @ np.cross(x[c.i, W], np.cross(x[c.i, W], c.center_i - x[c.i, P]))
    if c.j >= 0:
        total -= c.normal @ np.cross(x[c.j, W], np.cross(x[c.j, W], c.center_j - x[c.j, P]))
    return total


def fall(scene, c, x):
    """The same with gravity, where it does not pull at both [m/s^2]."""
    both = c.j >= 0 and not scene.bodies[c.j].fixed
    return bend(c, x) + (0.0 if both else c.normal @ scene.gravity)


def mean_of(values, c, bodies):
    """Geometric mean of a material's value of a contact's partners; bodies come before elements."""
    return np.sqrt(values[c.i] * values[c.j if c.j >= 0 else bodies - 1 - c.j])


class Lasting(NamedTuple):
    """The law of lasting contacts: depths at an interval's end give normal impulses; impulses change ``free``
    (6 B,).
    """

    J: np.ndarray
    inverse_mass: np.ndarray
    free: np.ndarray
    start: np.ndarray  # normal speeds (m,)
    gap: np.ndarray
    bend: np.ndarray
    stiffness: np.ndarray  # kappa pi R
    friction: np.ndarray
    h: float
    damping_time: np.ndarray

    def speeds(self, impulses):
        """(m, 3) at the interval's end."""
        return (self.J @ (self.free + self.inverse_mass @ self.J.T @ impulses.ravel())).reshape(-1, 3)

    def normal_impulses(self, speeds):
        mean = 0.5 * (self.start + speeds[:, 0] + self.h * self.bend)
        depth = np.maximum(0.0, -self.gap - self.h * mean - self.damping_time * speeds[:, 0])
        return self.h * self.stiffness * depth**2

    def residual(self, impulses):
        """(m, 3) [N s]: 0 where the law holds."""
        speeds = self.speeds(impulses)
        return np.column_stack(
            [impulses[:, 0] - self.normal_impulses(speeds), slip_residual(self, impulses, speeds)]
        )

    def own_residual(self, impulses):
        """(m, 3) [N s]: by how much each impulse would have to change for its law to hold, the
        others held.
        """
        wanted, speeds, own = impulses.copy(), self.speeds(impulses), compliance(self)
        for k in range(len(impulses)):

            def miss(impulse, k=k):
                v = speeds.copy()
                v[k, 0] += own[k, 0] * (impulse - impulses[k, 0])
                return impulse - self.normal_impulses(v)[k]

            wanted[k, 0] = brentq(miss, 0.0, impulses[:, 0].sum() + miss(0.0) * -2.0 + 1.0, xtol=1e-15)
        return np.column_stack([impulses[:, 0] - wanted[:, 0], slip_residual(self, impulses, speeds)])


class Impact(NamedTuple):
    """The law of an impact: normal speeds reach their targets, or there is no impulse."""

    J: np.ndarray
    inverse_mass: np.ndarray
    free: np.ndarray
    target: np.ndarray
    friction: np.ndarray

    speeds = Lasting.speeds

    def residual(self, impulses):
        speeds = self.speeds(impulses)
        normal = impulses[:, 0] - np.maximum(
            0.0, impulses[:, 0] - (speeds[:, 0] - self.target) / compliance(self)[:, 0]
        )
        return np.column_stack([normal, slip_residual(self, impulses, speeds)])


def compliance(law):
    """(m, 3): each direction's own."""
    return np.einsum("ij,jk,ik->i", law.J, law.inverse_mass, law.J).reshape(-1, 3)


def slip_residual(law, impulses, speeds):
    """Coulomb: an impulse that goes on against the slip and back into the cone stays where it is."""
    wanted = impulses[:, 1:] - speeds[:, 1:] / compliance(law)[:, 1:].max(axis=1)[:, None]
    limit = law.friction * np.maximum(impulses[:, 0], 0.0)
    size = np.linalg.norm(wanted, axis=1)
    share = np.where(size > limit, limit / np.maximum(size, 1e-300), 1.0)
    return impulses[:, 1:] - share[:, None] * wanted


def solution(law, scale):
    """Impulses (m, 3) that obey a law, by least squares of its residual; ``scale`` [N s] is a typical
    impulse.
    """

    def residual(y):
        return law.residual(scale * y.reshape(-1, 3)).ravel() / scale

    best = None
    for start in (0.0, 0.3, 1.0, 0.1, 3.0):  # from some it ends in a hollow
        y = np.zeros((len(law.friction), 3))
        y[:, 0] = start
        found = least_squares(
            residual, y.ravel(), method="trf", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=2000
        )
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < 1e-20:
            break
    return scale * best.x.reshape(-1, 3), np.sqrt(2.0 * best.cost)


def kinetic_energy(scene, x, v):
    """[J], of velocities (6 B,)."""
    total = 0.0
    for k in scene.moving:
        body, R = scene.bodies[k], Rotation.from_quat(x[k, Q]).as_matrix()
        u, w = v[6 * k : 6 * k + 3], R.T @ v[6 * k + 3 : 6 * k + 6]
        total += 0.5 * body.mass * (u @ u + w @ body.model.inertia @ w)
    return total


def blended(scene, x, before, elastic, plastic):
    """Velocities after an impact: as elastic as no energy is gained."""

    def gain(share):
        return kinetic_energy(scene, x, plastic + share * (elastic - plastic)) - kinetic_energy(
            scene, x, before
        )

    if gain(1.0) <= 0.0:
        return elastic
    return plastic + brentq(gain, 0.0, 1.0, xtol=1e-14) * (elastic - plastic)


def time_to_impact(gaps, speeds, accelerations, left, threshold):
    """When the first gap, a parabola, reaches the aim faster than the threshold; ``left`` [s] if none does
    before.
    """
    first = left
    for gap, speed, acceleration in zip(gaps, speeds, accelerations, strict=True):
        if gap <= AIM:
            continue
        for time in np.roots([0.5 * acceleration, speed, gap - AIM]):
            if (
                abs(time.imag) == 0.0
                and 0.0 < time.real < first
                and speed + acceleration * time.real < -threshold
            ):
                first = time.real
    return first


def travelled(s, end, h):
    """Pose (7,) of a body in contact, by the mean of its velocities at the interval's start and end (6,)."""
    mean = 0.5 * (np.concatenate([s[V], s[W]]) + end)
    turn = Rotation.from_rotvec(h * mean[3:]) * Rotation.from_quat(s[Q])
    return np.concatenate([s[P] + h * mean[:3], turn.as_quat()])
