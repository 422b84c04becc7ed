"""Model errors of a tracked body in contact."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..checks.validation import non_negative
from ..physics.contact_history import asleep
from ..propagators.rollouts import RolloutCarry
from ..scene.action_arrays import AIR_DENSITY
from ..scene.scene import Scene
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, STATE, VELOCITY
from ..spatial.moments import spread_states
from ..spatial.quaternions import product
from ..spatial.rotation import exp_vectors

#: Share of its weight's impulse above which a body counts as in contact; without gravity, speed [m/s].
_LEAST_SHARE, _LEAST_IMPULSE = 0.05, 1e-6
_WITHIN = 0.55  # of the bounding radius: about the radius of gyration of compact bodies


@dataclass(frozen=True)
class ContactNoise:
    """Standard deviations of model errors in contact; free flight has none.

    Attributes
    ----------
    velocity : float
        Of the velocity, for an impulse per mass of 1 m/s [m/s]; it grows with the impulse's root.
    rotation : float
        Factor of the angular velocity, relative to the velocity over 0.55 bounding radii.
    lasting : float
        Factor of the part of each impulse that carries the weight: lasting contacts have smaller errors than
        impacts.
    slow : float
        Speed of the surface below which both decrease in proportion [m/s], so that bodies can fall asleep.
    drift, turn : float
        Of the random walk of a sleeping body, across gravity [m/s^0.5], and about it [rad/s^0.5].
    shape_position, shape_rotation : float
        Of a pose in contact, due to errors of shapes [m], [rad]; part of every answer.

    Raises
    ------
    InvalidRequestError, NotFiniteError
        For negative values, NaN and infinity.
    """

    velocity: float = 0.034
    rotation: float = 1.2
    lasting: float = 0.35
    slow: float = 0.1
    drift: float = 5e-4
    turn: float = 2e-3
    shape_position: float = 3.5e-4
    shape_rotation: float = 4e-3

    def __post_init__(self):
        for field in fields(self):
            value = non_negative(getattr(self, field.name), field.name)
            object.__setattr__(self, field.name, value)

    def shape_variance(self, share: float) -> np.ndarray:
        """Return variances (6,) of a pose's error due to shapes, for a share of members in contact."""
        return share * np.repeat([self.shape_position**2, self.shape_rotation**2], 3)


def add_contact_noise(
    before: np.ndarray, carry: RolloutCarry, scene: Scene, steps: int, noise: ContactNoise, seed: int
) -> tuple[RolloutCarry, np.ndarray]:
    """Add the contact noise of the last ``steps`` steps.

    Parameters
    ----------
    before : (N, B, 13) array
        States at their beginning.
    carry : RolloutCarry
        At their end; its states are changed in place.
    scene : Scene
    steps : int
    noise : ContactNoise
    seed : int
        The same numbers for the same seed and step.

    Returns
    -------
    carry : RolloutCarry
    share : (B,) array
        Share of the members in which each body was in contact.
    """
    if not len(scene.moving):
        return carry, np.zeros(carry.states.shape[1])
    resting = asleep(carry.contact_history)
    rng = np.random.default_rng((seed, carry.step))
    return carry, disturb_contacts(before, carry.states, resting, scene, steps, noise, rng)


def disturb_contacts(
    before: np.ndarray,
    states: np.ndarray,
    resting: np.ndarray,
    scene: Scene,
    steps: int,
    noise: ContactNoise,
    rng: np.random.Generator,
) -> np.ndarray:
    """Add contact noise in place to states (N, B, 13) that were ``before`` so many steps ago.

    Parameters
    ----------
    before, states : (N, B, 13) arrays
    resting : (N, B) bool array
        Bodies that have the random walk instead.
    scene : Scene
    steps : int
    noise : ContactNoise
    rng : numpy.random.Generator

    Returns
    -------
    (B,) array
        Share of the members in which each body was in contact.
    """
    moving, decay = scene.moving, scene.decay
    h = steps * scene.dt
    share = np.zeros(states.shape[1])
    kept = decay**steps
    fall = h if decay == 1.0 else scene.dt * (1.0 - kept) / (1.0 - decay)
    velocity = states[:, moving, VELOCITY]
    gained = velocity - kept * before[:, moving, VELOCITY] - fall * scene.gravity
    drag = np.array([0.5 * AIR_DENSITY * scene.bodies[k].drag / scene.bodies[k].mass for k in moving])
    if drag.any():
        for v in (velocity, before[:, moving, VELOCITY]):  # the air's impulse, by the trapezoidal rule
            gained += 0.5 * h * drag[:, None] * np.linalg.norm(v, axis=2, keepdims=True) * v
    impulse = np.sqrt(np.einsum("nbk,nbk->nb", gained, gained))
    weight = float(np.linalg.norm(scene.gravity)) * h
    touching = impulse > max(_LEAST_SHARE * weight, _LEAST_IMPULSE)
    share[moving] = touching.mean(axis=0)
    if not touching.any():
        return share
    radius = scene.radii[moving]
    omega = states[:, moving, ANGULAR_VELOCITY]
    speed = np.linalg.norm(velocity, axis=2) + radius * np.linalg.norm(omega, axis=2)
    slip = np.minimum(1.0, (speed / noise.slow) ** 2) if noise.slow > 0.0 else 1.0
    impulse = impulse - (1.0 - noise.lasting) * np.minimum(impulse, weight)
    std = noise.velocity * np.sqrt(np.where(touching, impulse * slip, 0.0))
    resting = resting[:, moving]
    draws = rng.standard_normal((len(states), len(moving), 6))
    std = np.where(resting, 0.0, std)[..., None]
    kick, spin = std * draws[..., :3], std * noise.rotation / (_WITHIN * radius[:, None]) * draws[..., 3:]
    states[:, moving, VELOCITY] = velocity + kick
    states[:, moving, ANGULAR_VELOCITY] = omega + spin
    shift, turn = 0.5 * h * kick, 0.5 * h * spin
    if resting.any() and weight > 0.0:
        down = scene.gravity / np.linalg.norm(scene.gravity)
        across = draws[..., :3] - (draws[..., :3] @ down)[..., None] * down
        about = (draws[..., 3:] @ down)[..., None] * down
        root = np.sqrt(h)
        shift = np.where(resting[..., None], noise.drift * root * across, shift)
        turn = np.where(resting[..., None], noise.turn * root * about, turn)
    states[:, moving, POSITION] += shift
    turned = product(exp_vectors(turn), states[:, moving, QUATERNION])
    states[:, moving, QUATERNION] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return share


def whitened_draws(mean: np.ndarray, root: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return states (count, 1, 13) of one body with the given moments, as exactly as ``count`` allows.

    Parameters
    ----------
    mean : (13,) array
    root : (12, r) array
        Of the covariance, ``root @ root.T``.
    count : int
    rng : numpy.random.Generator
    """
    z = whitened(rng.standard_normal((count, root.shape[1])))
    return spread_states(mean.reshape(1, STATE).copy(), np.zeros(1, np.int64), z @ root.T)


def whitened(z: np.ndarray) -> np.ndarray:
    """Return draws (N, r) with mean zero and, if N > r, unit covariance with weights 1 / (N - 1)."""
    count, size = z.shape
    z = z - z.mean(axis=0)
    if count <= size:
        return z
    return z @ np.linalg.inv(np.linalg.cholesky(z.T @ z / (count - 1))).T
