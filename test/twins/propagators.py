"""Twins of the propagators that treat contacts in their own ways, from the equations: one step.

States are (B, 13); a covariance is joint for linearization, one block for each moving body for the others.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from .contact import lens_volume, lever, sphere_contacts
from .states import DOMEGA, DP, DTHETA, DV, P, Q, V, W, boxminus, boxplus
from .step import rotation_matrices, step, world_centers


def moving_of(bodies):
    return [b for b, body in enumerate(bodies) if not body.fixed]


def drifted(x, bodies, physics):
    """The state after drift, damping and gravity, without contacts."""
    return step(x[None], bodies, physics._replace(stiffness=0.0))[0]


def sphere_pair(x, bodies, i, j, a, b):
    """World centres of sphere a of body i and sphere b of body j."""
    return world_centers(x[None], i, bodies[i])[0, a], world_centers(x[None], j, bodies[j])[0, b]


def all_contacts(x, bodies):
    """(i, j, a, b) of all touching spheres at a pose."""
    for i in range(len(bodies)):
        for j in range(i + 1, len(bodies)):
            if bodies[i].fixed and bodies[j].fixed:
                continue
            force, _ = sphere_contacts(
                world_centers(x[None], i, bodies[i])[0],
                bodies[i].radii,
                world_centers(x[None], j, bodies[j])[0],
                bodies[j].radii,
            )
            for a, b in np.argwhere(np.linalg.norm(force, axis=-1) > 0.0):
                yield i, j, a, b


def inverse_inertia_world(x, bodies, b):
    R = rotation_matrices(x[None], b)[0]
    return R @ np.linalg.inv(bodies[b].inertia) @ R.T


# -- linearization ---------------------------------------------------------------------------------


def dominant_contacts(x, bodies):
    """{(i, j): (volume, a, b)}: the pair of spheres with the largest overlap of each pair of bodies."""
    best = {}
    for i, j, a, b in all_contacts(x, bodies):
        ci, cj = sphere_pair(x, bodies, i, j, a, b)
        volume = float(lens_volume(np.linalg.norm(cj - ci), bodies[i].radii[a], bodies[j].radii[b]))
        if (i, j) not in best or volume > best[i, j][
            0
        ]:  # pairs come in ascending order, so ties keep the first
            best[i, j] = volume, a, b
    return best


def regularized_step(x, bodies, physics, dominant):
    """The step that F_t differentiates: held volumes, Eq. 10's normal, the dominant contacts alone."""
    x = drifted(x, bodies, physics)
    out = x.copy()
    for (i, j), (volume, a, b) in dominant.items():
        ri, rj = bodies[i].radii[a], bodies[j].radii[b]
        ci, cj = sphere_pair(x, bodies, i, j, a, b)
        D = cj - ci
        d = np.linalg.norm(D)
        force = physics.stiffness * volume * D / (d + ri + rj)
        point = ci + float(lever(d, ri, rj)) * D / d
        for body, f in ((i, -force), (j, force)):
            if not bodies[body].fixed:
                out[body, V] += physics.dt * f / bodies[body].mass
                torque = np.cross(point - x[body, P], f)
                out[body, W] += physics.dt * inverse_inertia_world(x, bodies, body) @ torque
    return out


def linearization_step(x, covariance, bodies, physics, h=1e-6):
    """Nominal state and joint covariance one step later, F_t by central differences."""
    moving = moving_of(bodies)
    dominant = dominant_contacts(drifted(x, bodies, physics), bodies)
    columns = []
    for k in range(12 * len(moving)):
        ends = []
        for sign in (1.0, -1.0):
            d = np.zeros((len(bodies), 12))
            d[moving[k // 12], k % 12] = sign * h
            ends.append(regularized_step(boxplus(x, d), bodies, physics, dominant))
        columns.append(boxminus(*ends)[moving].ravel() / (2.0 * h))
    F = np.array(columns).T
    return step(x[None], bodies, physics)[0], F @ covariance @ F.T


# -- what surrogate and local sampling share -------------------------------------------------------


def printed_transition(x, b, physics):
    """(12, 12): A_t of Eq. 14, with the orientation before the drift."""
    decay, dt = np.exp(-physics.damping * physics.dt), physics.dt
    A = np.eye(12)
    A[DP, DV] = dt * np.eye(3)
    A[DV, DV] = A[DOMEGA, DOMEGA] = decay * np.eye(3)
    A[DTHETA, DOMEGA] = dt * rotation_matrices(x[None], b)[0].T
    return A


def skew(r):
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


# -- surrogate -------------------------------------------------------------------------------------


def surrogate_step(x, roots, bodies, physics, k_sigma):
    """Nominal state and the root of each moving body's covariance one step later (Eqs. 11 to 24)."""
    moving = moving_of(bodies)
    roots = {b: printed_transition(x, b, physics) @ S for b, S in zip(moving, roots, strict=True)}  # Eq. 15
    covariances = {b: S @ S.T for b, S in roots.items()}
    y = drifted(x, bodies, physics)
    for i, j, a, b in all_contacts(y, bodies):
        mu_i, mu_j = sphere_pair(y, bodies, i, j, a, b)
        relative = np.zeros((3, 3))
        for body, sphere in ((i, a), (j, b)):
            if not bodies[body].fixed:  # Eqs. 16 and 17
                C = covariances[body]
                J = -rotation_matrices(y[None], body)[0] @ skew(bodies[body].centers[sphere])
                relative += C[DP, DP] + J @ C[DTHETA, DTHETA] @ J.T
        d = np.linalg.norm(mu_j - mu_i)  # Eq. 18
        n = (mu_j - mu_i) / d
        U = np.linalg.svd(n[None])[2][1:].T
        eigenvalues, directions = np.linalg.eigh(U.T @ relative @ U)  # Eq. 19
        alpha = np.arctan(k_sigma * np.sqrt(np.maximum(eigenvalues, 0.0)) / d)  # Eq. 20
        volume = float(lens_volume(d, bodies[i].radii[a], bodies[j].radii[b]))
        sigma = physics.stiffness * volume * np.sin(alpha) / 3.0
        increment = (U @ directions) @ np.diag(sigma) @ (U @ directions).T  # Eq. 21
        for body, mu in ((i, mu_i), (j, mu_j)):
            if not bodies[body].fixed:
                S = roots[body]
                S[DV, DV] += physics.dt / bodies[body].mass * increment  # Eq. 22
                arm = skew(mu - y[body, P])
                inverse = inverse_inertia_world(y, bodies, body)
                S[DOMEGA, DOMEGA] += physics.dt * inverse @ arm @ increment / 3.0  # Eq. 23
    return step(x[None], bodies, physics)[0], np.array([roots[b] for b in moving])


# -- local sampling --------------------------------------------------------------------------------


def local_sampling_step(x, covariances, bodies, physics, samples, rng):
    """Nominal state and each moving body's covariance one step later (Eqs. 30 to 35), by its own draws."""
    moving = moving_of(bodies)
    before = {}
    for b, C in zip(moving, covariances, strict=True):
        A = printed_transition(x, b, physics)
        before[b] = A @ C @ A.T  # Eq. 30
    after = {b: C.copy() for b, C in before.items()}
    y = drifted(x, bodies, physics)
    for i, j, a, b in all_contacts(y, bodies):
        ri, rj = bodies[i].radii[a], bodies[j].radii[b]
        volume = float(lens_volume(np.linalg.norm(np.subtract(*sphere_pair(y, bodies, i, j, a, b))), ri, rj))
        responses = []
        for count in (1, samples):
            coms, centers = {}, {}
            for body, sphere in ((i, a), (j, b)):
                dp, dtheta = np.zeros((2, count, 3))
                if count > 1 and not bodies[body].fixed:  # Eq. 31
                    C = before[body]
                    dp = rng.multivariate_normal(np.zeros(3), C[DP, DP], count)
                    dtheta = rng.multivariate_normal(np.zeros(3), C[DTHETA, DTHETA], count)
                turned = Rotation.from_quat(y[body, Q]) * Rotation.from_rotvec(dtheta)
                coms[body] = y[body, P] + dp
                centers[body] = coms[body] + turned.apply(bodies[body].centers[sphere].copy())
            D = centers[j] - centers[i]
            d = np.linalg.norm(D, axis=1)[:, None]
            force = physics.stiffness * volume * D / d
            point = centers[i] + lever(d, ri, rj) * D / d
            responses.append((force, np.cross(point - coms[i], -force), np.cross(point - coms[j], force)))
        deviations = [sampled - nominal for nominal, sampled in zip(*responses, strict=True)]
        second = [e.T @ e / samples for e in deviations]  # Eqs. 32 and 33
        for body, torque in ((i, second[1]), (j, second[2])):
            if not bodies[body].fixed:
                after[body][DV, DV] += (physics.dt / bodies[body].mass) ** 2 * second[0]  # Eq. 34
                inverse = physics.dt * inverse_inertia_world(y, bodies, body)
                after[body][DOMEGA, DOMEGA] += inverse @ torque @ inverse.T  # Eq. 35
    return step(x[None], bodies, physics)[0], np.array([after[b] for b in moving])
