"""What becomes of samples whose belief reaches into things: rise, energy, what falls over, and spreads."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unc_physics.physics.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION
from unc_physics.physics.rotation import rotation_matrix
from unc_physics.prediction.overlap_depths import overlaps as deepest_overlaps
from unc_physics.prediction.predict import predict
from unc_physics.prediction.prediction import Prediction
from unc_physics.propagators.monte_carlo import MonteCarlo
from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene
from unc_physics.scene.stiffness import with_stiffness

from .energy import height_energy, kinetic_energy

LOOK = 0.01  # s, between looks at the samples
NOTHING = np.array([1e-4, 1e-3, 1e-3])  # m, rad, rad: spreads below are nothing
OVERLAP = 5e-5  # m, below which samples count as apart
LEANING = np.cos(np.radians(45.0))


class Watched(NamedTuple):
    """Samples that were looked at every few milliseconds.

    Attributes
    ----------
    start, end : (N, B, 13) array
        As they really began, and at the end.
    rise : (N,) array
        Highest of any body's centre of mass above where it began [m], less what the sample's kinetic energy
        at the start, and the fall of its other bodies, could lift that body by.
    gain : (N,) array
        Most energy above that at the start [J].
    prediction : Prediction
    """

    start: np.ndarray
    end: np.ndarray
    rise: np.ndarray
    gain: np.ndarray
    prediction: Prediction


@dataclass(frozen=True)
class _WatchedMonteCarlo(MonteCarlo):
    """Monte Carlo that shows its samples every few steps; they may begin at given ``states`` instead."""

    look: Callable[[np.ndarray], None] = None
    states_at_start: np.ndarray | None = None

    def init(self, scene, belief):
        carry = super().init(scene, belief)
        if self.states_at_start is not None:
            carry = carry._replace(states=self.states_at_start)
        self.look(carry.states)
        return carry

    def advance(self, carry, scene, steps):
        end, piece = carry.step + steps, max(1, round(LOOK / scene.dt))
        while carry.step < end:
            carry = super().advance(carry, scene, min(piece, end - carry.step))
            self.look(carry.states)
        return carry


def watch(
    scene: Scene, belief: Belief, samples: int, seed: int, horizon: float, states: np.ndarray | None = None
) -> Watched:
    """Predict by Monte Carlo and look at its samples on the way.

    They may begin at ``states`` (N, B, 13) instead of the belief's.
    """
    weight = np.linalg.norm(scene.gravity) * np.array([scene.bodies[k].mass for k in scene.moving])
    seen = []

    def look(states):
        kinetic = kinetic_energy(scene, states)
        seen.append(
            (
                states.copy() if not seen else None,
                _heights(scene, states),
                kinetic,
                height_energy(scene, states),
            )
        )

    prediction = predict(
        scene, belief, _WatchedMonteCarlo(samples, seed, look=look, states_at_start=states), horizon
    )
    _, heights, kinetic, potential = (np.array(values) for values in zip(*seen[1:], strict=True))
    start, height, moving, above = seen[0]
    fallen = weight * np.maximum(height - heights, 0.0)
    others = fallen.sum(axis=-1, keepdims=True) - fallen
    rise = (heights - height - (moving[:, None] + others) / weight).max(axis=(0, 2))
    gain = (kinetic + potential - moving - above).max(axis=0)
    return Watched(start, prediction.carry.states, np.maximum(rise, 0.0), np.maximum(gain, 0.0), prediction)


def toppled(scene: Scene, belief: Belief, states: np.ndarray) -> np.ndarray:
    """(N,): whether any body's upright axis is more than 45 degrees from that of the belief's mean."""
    fallen = np.zeros(len(states), bool)
    for k in scene.moving:
        axis = rotation_matrix(belief.mean[k, QUATERNION])[2]  # of the body, that points up at the mean
        fallen |= [rotation_matrix(q)[2] @ axis < LEANING for q in states[:, k, QUATERNION]]
    return fallen


def fallen_through(states: np.ndarray) -> np.ndarray:
    """(N,): whether any body's centre is below the table, whose top is at height 0."""
    return (states[..., 2] < 0.0).any(axis=1)


def off_by(ratios) -> float:
    """The ratio that is farthest from 1, in either direction."""
    ratios = np.ravel(ratios)
    return float(ratios[np.argmax(np.abs(np.log(np.maximum(ratios, 1e-12))))])


def spread_ratio(states: np.ndarray, drawn: np.ndarray) -> float:
    """Standard deviation of x or y over that as drawn, of the body and axis farthest from 1."""
    return off_by(states[..., :2].std(axis=0) / drawn[..., :2].std(axis=0))


def spreads(belief: Belief) -> np.ndarray:
    """(M, 3): standard deviations of position, tilt and yaw [m, rad, rad], over all axes of each."""
    P = belief.blocks
    R = np.array([rotation_matrix(belief.mean[k, QUATERNION]) for k in belief.moving])
    world = np.einsum("mij,mjk,mlk->mil", R, P[:, ERR_ROTATION, ERR_ROTATION], R)
    position = np.trace(P[:, ERR_POSITION, ERR_POSITION], axis1=1, axis2=2)
    return np.sqrt(
        np.maximum(np.column_stack([position, world[:, 0, 0] + world[:, 1, 1], world[:, 2, 2]]), 0.0)
    )


def spread_ratios(predicted: Belief, truth: Belief) -> np.ndarray:
    """(3,): predicted spreads over true ones, of the body farthest from 1; 1 where both are nothing."""
    a, b = (np.maximum(spreads(belief), NOTHING) for belief in (predicted, truth))
    return np.array([off_by(column) for column in (a / b).T])


def without_overlap(
    scene: Scene, belief: Belief, wanted: int, seed: int, most: int
) -> tuple[np.ndarray, int]:
    """Samples of a belief whose bodies do not overlap, by rejection, and of how many draws they are the rest.

    Parameters
    ----------
    wanted, most : int
        It ends with so many samples, or after so many draws.
    """
    scene = with_stiffness(scene, belief.mean)
    rng, kept, drawn = np.random.default_rng(seed), [], 0
    while len(kept) < wanted and drawn < most:
        states = belief.sample(min(wanted, most - drawn), rng)
        for state, depths in zip(states, deepest_overlaps(scene, states)[0], strict=True):
            drawn += 1
            if depths.max() <= OVERLAP:
                kept.append(state)
                if len(kept) == wanted:
                    break
    return np.array(kept).reshape(-1, *belief.mean.shape), drawn


def start_time(scene: Scene, belief: Belief, samples: int, rounds: int) -> float:
    """CPU time of a sample's start beyond its draw [s], median of some rounds."""
    scene = with_stiffness(scene, belief.mean)
    taken = []
    for k in range(rounds + 1):  # the first compiles
        begun = time.process_time()
        MonteCarlo(samples, k).init(scene, belief)
        middle = time.process_time()
        belief.sample(samples, np.random.default_rng(k))
        taken.append(2.0 * middle - begun - time.process_time())
    return float(np.median(taken[1:])) / samples


def _heights(scene, states):
    """(N, M): of the centres of mass against gravity [m]."""
    up = -scene.gravity / np.linalg.norm(scene.gravity)
    return states[:, scene.moving, POSITION] @ up
