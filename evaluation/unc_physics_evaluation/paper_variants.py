"""Switches of the paper's methods: what it left out, and the constants that it leaves open.

Each class is a method of the package with one more choice. Contacts come from the package's step; everything
else is computed here from the equations, in NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.compiler import kernel
from unc_physics.physics import contact_history as histories
from unc_physics.physics.paper.explicit_step import integrate, on_contacts
from unc_physics.physics.paper.workspace import workspace
from unc_physics.propagators.linearization import Linearization
from unc_physics.propagators.local_sampling import LocalSampling
from unc_physics.propagators.options import option
from unc_physics.propagators.point_pairs import errors_about_first
from unc_physics.propagators.sigma_points import SigmaPoints
from unc_physics.propagators.surrogate import Surrogate
from unc_physics.scene.belief import Belief
from unc_physics.spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from unc_physics.spatial.moments import spread_states

_STEP = 1e-6  # of the central differences: errors of 1e-10 in F_t
_ERRORS = np.arange(2 * ERROR).reshape(2, 4, 3)  # of two bodies: position, velocity, rotation, spin
_POSES, _KICKS = _ERRORS[:, 0::2].ravel(), _ERRORS[:, 1::2].ravel()


class ContactList(NamedTuple):
    """The pairs of spheres that touch in one step of two bodies, as indices into the scene's trees."""

    count: np.ndarray  # (1,) int64: may exceed the room
    pairs: np.ndarray  # (n, 2) int64


@on_contacts.of(ContactList)
def _list_contacts(found, x, i, j, count, first, world, work):
    for k in range(count):
        if found.count[0] < len(found.pairs):
            found.pairs[found.count[0], 0] = work.search.pairs[k, 0]
            found.pairs[found.count[0], 1] = work.search.pairs[k, 1]
        found.count[0] += 1


@kernel
def _integrate(x, first_time, world, found):
    integrate(x, first_time, world, world.environment, found, 0, 1, workspace(x, world))


class Contacts(NamedTuple):
    """Contacts of two bodies, in N states at once; lengths in m, world axes."""

    R: np.ndarray  # (N, 2, 3, 3)
    arms: np.ndarray  # (N, 2, K, 3): the spheres' centres from their bodies' centres of mass
    D: np.ndarray  # (N, K, 3): from body 0's sphere to body 1's
    d: np.ndarray  # (N, K, 1)
    radii: np.ndarray  # (2, K, 1)

    @classmethod
    def of(cls, states, world, pairs):
        """Return the geometry of pairs of spheres in states (N, 2, 13)."""
        R = Rotation.from_quat(states[..., QUATERNION].reshape(-1, 4)).as_matrix().reshape(-1, 2, 3, 3)
        arms = np.einsum("nbrc,kbc->nbkr", R, world.tree.centers[pairs])
        D = states[:, 1, None, POSITION] + arms[:, 1] - states[:, 0, None, POSITION] - arms[:, 0]
        return cls(
            R, arms, D, np.linalg.norm(D, axis=-1, keepdims=True), world.tree.radii[pairs].T[..., None]
        )

    @property
    def volume(self):
        """(N, K, 1): volumes of the lenses [m^3]; zero without overlap."""
        (ri, rj), d = self.radii, self.d
        s = np.maximum(ri + rj - d, 0.0)
        lens = np.pi * s**2 * (d**2 + 2.0 * d * (ri + rj) - 3.0 * (ri - rj) ** 2) / (12.0 * d)
        return np.where(d <= abs(ri - rj), 4.0 / 3.0 * np.pi * np.minimum(ri, rj) ** 3, lens)

    def kicks(self, force, world):
        """(N, K, 2, 6): changes of velocity and angular velocity of both bodies by forces (N, K, 3)."""
        (ri, rj), d = self.radii, self.d
        lever = 0.5 * (np.maximum(d - rj, -ri) + np.minimum(ri, d + rj)) * self.D / d
        both = np.stack([-force, force], axis=2)
        levers = np.stack([self.arms[:, 0] + lever, self.arms[:, 1] + lever - self.D], axis=2)
        turns = np.einsum("nbrc,nkbc->nkbr", self.inverse_inertia(world), np.cross(levers, both))
        return world.dt * np.concatenate([both * world.bodies.inverse_mass[:, None], turns], axis=-1)

    def inverse_inertia(self, world):
        """(N, 2, 3, 3): inverse inertias in world axes [1/(kg m^2)]."""
        return self.R @ world.bodies.inverse_inertia @ np.swapaxes(self.R, -1, -2)


def _stepped(mean, world):
    """Return the state (2, 13) one step later, and the pairs of spheres (K, 2) that touched."""
    room = 1024
    while True:
        found = ContactList(np.zeros(1, np.int64), np.empty((room, 2), np.int64))
        x = mean.copy()
        _integrate(x, histories.fresh(1, world).first_time[0], world, found)
        if found.count[0] <= room:
            return x, found.pairs[: found.count[0]]
        room = int(found.count[0])


def _drifted(states, world):
    """Return states (N, 2, 13) after drift and damping."""
    states = states.copy()
    states[..., POSITION] += world.dt * states[..., VELOCITY]
    turn = Rotation.from_rotvec(world.dt * states[..., ANGULAR_VELOCITY].reshape(-1, 3))
    turned = turn * Rotation.from_quat(states[..., QUATERNION].reshape(-1, 4))
    states[..., QUATERNION] = turned.as_quat().reshape(-1, 2, 4)
    states[..., VELOCITY] *= world.decay
    states[..., ANGULAR_VELOCITY] *= world.decay
    return states


def _transition(mean, world):
    """(2, 12, 12): A_t of Eq. 14, with the orientation before the drift."""
    A = np.tile(np.eye(ERROR), (2, 1, 1))
    A[:, ERR_POSITION, ERR_VELOCITY] = world.dt * np.eye(3)
    A[:, ERR_VELOCITY, ERR_VELOCITY] = A[:, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] = (
        world.decay * np.eye(3)
    )
    R = Rotation.from_quat(mean[:, QUATERNION]).as_matrix()
    A[:, ERR_ROTATION, ERR_ANGULAR_VELOCITY] = world.dt * np.swapaxes(R, -1, -2)
    return A


@dataclass(frozen=True)
class NumericalLinearization(Linearization):
    """Linearization with F_t by central differences, of two bodies (Eqs. 7 to 10)."""

    name = "numerical_linearization"

    contacts: str = option("dominant", "contacts in F_t", choices=("dominant", "all"))
    regularisation: float = option(1.0, "radii in Eq. 10's denominator; 0 is the plain normal", low=0.0)
    force: str = option("constant", "size of the force in F_t", choices=("constant", "whole"))

    def advance(self, carry, scene, steps):
        mean, root, world = carry.mean, carry.root, scene.world
        for _ in range(steps):
            after, pairs = _stepped(mean, world)
            mean, root = after, self._derivative(mean, world, pairs) @ root
        return carry._replace(mean=mean, root=root, step=carry.step + steps)

    def _derivative(self, mean, world, pairs):
        """(24, 24): F_t of Eq. 8."""
        errors = np.concatenate([np.zeros((1, 2 * ERROR)), *(s * _STEP * np.eye(2 * ERROR) for s in (1, -1))])
        states = _drifted(spread_states(mean.copy(), np.arange(2), errors), world)
        if len(pairs):
            nominal = Contacts.of(states[:1], world, pairs).volume
            if self.contacts == "dominant":
                strongest = [int(np.argmax(nominal))]
                pairs, nominal = pairs[strongest], nominal[:, strongest]
            at = Contacts.of(states, world, pairs)
            volume = nominal if self.force == "constant" else at.volume
            force = world.stiffness * volume * at.D / (at.d + self.regularisation * sum(at.radii))
            kicks = at.kicks(force, world).sum(axis=1)
            states[..., VELOCITY] += kicks[..., :3]
            states[..., ANGULAR_VELOCITY] += kicks[..., 3:]
        plus, minus = errors_about_first(states)[1:].reshape(2, 2 * ERROR, 2 * ERROR)
        return (plus - minus).T / (2.0 * _STEP)


@dataclass(frozen=True)
class TunedSurrogate(Surrogate):
    """Surrogate with the factors of Eqs. 21 and 23 as options, of two bodies (Eqs. 11 to 24)."""

    name = "tuned_surrogate"

    velocity_share: float = option(1.0 / 3.0, "factor of Eq. 21", positive=True)
    spin_share: float = option(1.0 / 3.0, "factor of Eq. 23", positive=True)

    def advance(self, carry, scene, steps):
        mean, roots, world = carry.mean, carry.blocks, scene.world
        for _ in range(steps):
            after, pairs = _stepped(mean, world)
            roots = _transition(mean, world) @ roots
            if len(pairs):
                at = Contacts.of(_drifted(mean[None], world), world, pairs)
                roots = self._kicked(roots, at, world)
            mean = after
        return carry._replace(mean=mean, blocks=roots, step=carry.step + steps)

    def _kicked(self, roots, at, world):
        """Return the roots after the increments of all contacts (Eqs. 16 to 23)."""
        P, n = roots @ np.swapaxes(roots, -1, -2), (at.D / at.d)[0]
        turned = at.R[0] @ P[:, ERR_ROTATION, ERR_ROTATION] @ np.swapaxes(at.R[0], -1, -2)
        cross = np.cross(at.arms[0][..., None, :], np.eye(3))  # (2, K, 3, 3): [r]x, transposed
        relative = P[:, ERR_POSITION, ERR_POSITION].sum(axis=0)
        relative = relative + np.einsum("bkcr,bcd,bkds->krs", cross, turned, cross)
        T = np.eye(3) - n[:, :, None] * n[:, None, :]
        values, vectors = np.linalg.eigh(T @ relative @ T)  # a third, zero one is along the normal
        reach = self.k_sigma * np.sqrt(np.maximum(values, 0.0))
        sine = reach / np.sqrt(at.d[0] ** 2 + reach**2)
        sigma = self.velocity_share * world.stiffness * at.volume[0] * sine
        V = np.einsum("krc,kc,ksc->krs", vectors, sigma, vectors)
        moments = np.einsum("bkcr,kcs->brs", cross, V)
        roots = roots.copy()
        roots[:, ERR_VELOCITY, ERR_VELOCITY] += (
            world.dt * world.bodies.inverse_mass[:, None, None] * V.sum(axis=0)
        )
        roots[:, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] += (
            world.dt * self.spin_share * at.inverse_inertia(world)[0] @ moments
        )
        return roots


@dataclass(frozen=True)
class JointLocalSampling(LocalSampling):
    """Local sampling of both bodies' poses together, with correlations between the bodies (Eqs. 30 to 35)."""

    name = "joint_local_sampling"

    joint: bool = option(True, "whether correlations between the bodies are kept")

    def init(self, scene, belief):
        return super().init(scene, belief)._replace(blocks=belief.joint.copy())

    def advance(self, carry, scene, steps):
        mean, P, world = carry.mean, carry.blocks, scene.world
        A = np.zeros_like(P)
        for k in range(carry.step, carry.step + steps):
            after, pairs = _stepped(mean, world)
            A[:ERROR, :ERROR], A[ERROR:, ERROR:] = _transition(mean, world)
            P = A @ P @ A.T
            if len(pairs):
                P = P + self._increment(P, _drifted(mean[None], world), world, pairs, k)
            mean = after
        return carry._replace(mean=mean, blocks=P, step=carry.step + steps)

    def _increment(self, P, mean, world, pairs, step):
        """(24, 24): covariance of the kicks by all contacts of perturbed poses."""
        values, vectors = np.linalg.eigh(P[np.ix_(_POSES, _POSES)])
        z = np.random.default_rng((self.seed, step)).standard_normal((self.samples, len(values)))
        errors = np.zeros((self.samples, len(P)))
        errors[:, _POSES] = z @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        nominal = Contacts.of(mean, world, pairs)
        at = Contacts.of(spread_states(mean[0].copy(), np.arange(2), errors), world, pairs)
        force = world.stiffness * nominal.volume
        change = at.kicks(force * at.D / at.d, world) - nominal.kicks(force * nominal.D / nominal.d, world)
        change = change.reshape(-1, len(_KICKS))
        increment = np.zeros_like(P)
        increment[np.ix_(_KICKS, _KICKS)] = change.T @ change / self.samples
        if not self.joint:
            increment[:ERROR, ERROR:] = increment[ERROR:, :ERROR] = 0.0
        return increment

    def belief(self, carry, scene):
        return Belief.trusted(carry.mean.copy(), 0.5 * (carry.blocks + carry.blocks.T), scene.moving)


@dataclass(frozen=True)
class RegeneratedSigmaPoints(SigmaPoints):
    """Sigma points that are generated anew after each time step."""

    name = "regenerated_sigma_points"

    def advance(self, carry, scene, steps):
        for _ in range(steps):
            after = super().advance(carry, scene, 1)
            anew = self.init(scene, self.belief(after, scene))
            carry = after._replace(states=anew.states)
        return carry
