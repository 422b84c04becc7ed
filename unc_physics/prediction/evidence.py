"""Data of a status: diagnostics of the start, which all times share, and of one snapshot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..physics.contact_history import ContactHistory
from ..propagators.base import PointPairs, Propagator, Samples, TwoSidedSlopes, rollout_count
from ..propagators.free_flight import course_of
from ..propagators.overlap_depths import overlaps, pair_overlaps
from ..propagators.point_pairs import opposite_points
from ..scene.kinematic_states import held_at_start
from ..scene.scene import Scene
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.moments import pose_spreads
from ..spatial.rotation import left_jacobian, rotation_matrix
from .conservation_checks import conserves_energy
from .prediction_data import PredictionData
from .probability import is_deterministic
from .rare_outcomes import tail_factors
from .snapshot import Snapshot

#: Rotation in one step from which on covariances of first order in it are compared with rollouts [rad].
MOST_FLIGHT_TURN = 2.0
_DRAWN = 40  # states of a belief whose overlaps are computed
_SEED = 0  # of their draws; fixed, so that statuses are reproducible
#: Least spread that is compared, over the body's radius and in rad: the accuracy of contacts.
_SPREAD_FLOOR = 1e-4
_NOISE = 4.0  # standard deviations of a sample's mean energy that do not count as a gain
_SAMPLES_OF_SPREAD = 30  # of which standard deviations are within 13 %
_USUAL = 0.95  # quantile of the overlaps of a belief's states
_SPUN = slice(ERR_ROTATION.start, ERR_ANGULAR_VELOCITY.stop)


class InitialDiagnostics(NamedTuple):
    """Diagnostics of the start, which all times share."""

    mean: np.ndarray  # (B, 13)
    blocks: np.ndarray  # (M, 12, 12): covariance of each moving body
    mass: np.ndarray  # (B,): 0 of a fixed body [kg]
    #: (B, 4): least and largest inertia over mass [m^2], radius of the largest sphere, and bounding
    #: radius [m]
    shapes: np.ndarray
    overlap: np.ndarray  # (B,) [m]
    #: energy, least_energy: (B,): upper bound of the energy, and lower bound of the kinetic energy [J];
    #: the latter allows for the sampling error of the mean
    energy: np.ndarray
    least_energy: np.ndarray
    #: number of samples that a belief is the mean of; infinite for chosen points, None for a single rollout
    samples: float | None
    #: (M,): number of directions along which points are spread; None without points
    directions: np.ndarray | None
    found: Any  # adjustments of points or samples at time 0; None for the explicit integrator
    kept_overlaps: np.ndarray  # (B, B + E): deepest overlap of each pair that could not be removed [m]
    #: (B,): 1 less the distance between the given centres of mass of two bodies that overlap, over the
    #: smaller body's radius; 0 without such a pair
    coincidence: np.ndarray
    deterministic: bool  # whether there is only one outcome, which a single sample is
    #: (B, 2, 2): standard deviations of position [m] and rotation [rad], as given and without overlap, along
    #: the principal axis along which most of it went; equal where nothing went
    narrowed: np.ndarray


@dataclass(frozen=True, eq=False)
class Evidence:
    """Data by which one snapshot is judged."""

    scene: Scene
    propagator: Propagator
    start: InitialDiagnostics
    snapshot: Snapshot
    history: ContactHistory  # of the propagator's rollouts, up to the snapshot's time
    #: (N, B, 13): those of simulated rollouts; None where they are not equally probable
    states: np.ndarray | None
    #: (B, 2): spread of points in opposite pairs over the spread of the odd part of their errors, of position
    #: and rotation; None without such points
    asymmetries: np.ndarray | None
    #: (M, 2): standard deviations of position [m] and rotation [rad] of compared rollouts; None without them
    spreads: np.ndarray | None = None
    #: (R, B, 13): states of those rollouts
    compared: np.ndarray | None = None
    #: (R, B, 13): states of rollouts of a belief that is twice as wide; None without them
    wide: np.ndarray | None = None
    left_out: tuple[str, ...] = ()  # as `Prediction.left_out`
    step_motion: np.ndarray | None = None  # (B, 2): as `step_motion.motion_in_meetings`

    @classmethod
    def of(cls, prediction: PredictionData, start: InitialDiagnostics, snapshot: Snapshot) -> Evidence:
        """Return the evidence of a snapshot of a prediction."""
        scene, propagator, carry = prediction.scene, prediction.propagator, snapshot.carry
        history = carry.contact_history
        states, asymmetries = snapshot.rollout_states, None
        if snapshot.points is not None:
            states = snapshot.points
            asymmetries = _sigma_point_asymmetries(
                scene, start, opposite_points(snapshot.points, scene.moving)
            )
        elif propagator.traits.mean_update == "nominal" or len(history.first_time) == 1:
            states = snapshot.belief.mean[None]
        wide, missing = snapshot.wide, prediction.left_out
        return cls(
            scene, propagator, start, snapshot, history, states, asymmetries, wide=wide, left_out=missing
        )

    @cached_property
    def slope_changes(self) -> np.ndarray | None:
        """(B, 2): difference of the slopes of position and rotation on both sides over their mean; None
        without such slopes.
        """
        scene, slopes = self.scene, None
        if isinstance(self.propagator, TwoSidedSlopes):
            slopes = self.propagator.slopes(self.snapshot.carry, scene)
        if slopes is None:
            return None
        *sides, reach = slopes
        result = np.zeros((len(scene.bodies), 2))
        for k, body in enumerate(scene.moving):
            # the accuracy of an outcome, as a slope
            floors = spread_floors(self.start, body) / reach.min(initial=1.0)
            for c, (block, floor) in enumerate(zip((ERR_POSITION, ERR_ROTATION), floors, strict=True)):
                forth, back = (side[:, k, block] for side in sides)
                mean = np.hypot(np.linalg.norm(0.5 * (forth + back)), floor)
                result[body, c] = np.linalg.norm(forth - back) / mean
        return result

    @cached_property
    def predicted_spreads(self) -> np.ndarray:
        """(M, 2): predicted standard deviations of position [m] and rotation [rad]."""
        return pose_spreads(self.snapshot.belief.blocks)

    @cached_property
    def flown_rotations(self) -> np.ndarray:
        """(M, 3, 3): covariances of rotations at the start; of bodies that touched nothing, after the flight
        since then, as if rotations did not wrap around.
        """
        scene, blocks = self.scene, self.start.blocks
        turn = course_of(scene, self.snapshot.time / scene.dt).turn
        found = blocks[:, ERR_ROTATION, ERR_ROTATION].copy()
        for k, body in enumerate(scene.moving):
            if not self.touches[body]:
                x = self.start.mean[body]
                back = left_jacobian(-turn * x[ANGULAR_VELOCITY])  # to the axes at the start
                J = np.hstack([np.eye(3), turn * rotation_matrix(x[QUATERNION]).T @ back])
                found[k] = J @ blocks[k, _SPUN, _SPUN] @ J.T
        return found

    @cached_property
    def step_turn(self) -> np.ndarray:
        """(B,): rotation of each body in one step, by its start and its end [rad]."""
        both = (x[:, ANGULAR_VELOCITY] for x in (self.start.mean, self.snapshot.belief.mean))
        return self.scene.dt * np.max([np.linalg.norm(omega, axis=1) for omega in both], axis=0)

    @cached_property
    def spread_factors(self) -> np.ndarray | None:
        """(B, 2): factors between predicted and compared standard deviations of position and rotation; None
        without rollouts.
        """
        scene, spreads = self.scene, self.spreads
        if spreads is None:
            return None
        floors = spread_floors(self.start, scene.moving)
        predicted = np.maximum(self.predicted_spreads, floors)
        found = np.where(np.isfinite(spreads), np.maximum(spreads, floors), math.inf)
        result = np.ones((len(scene.bodies), 2))
        result[scene.moving] = np.maximum(predicted / found, found / predicted)
        return result

    @cached_property
    def widening(self) -> np.ndarray | None:
        """(B, 2): factors by which rare outcomes widen the standard deviations of position and rotation; None
        without rollouts of a wider belief.
        """
        return None if self.wide is None else tail_factors(self.scene, self.snapshot.belief, self.wide)

    @cached_property
    def touched(self) -> np.ndarray:
        """(B, B + E) bool: which bodies touched each other, or elements, in any rollout."""
        return np.isfinite(self.history.first_time.min(axis=0))

    @cached_property
    def touches(self) -> np.ndarray:
        """(B,) bool: which bodies touched anything."""
        both = self.touched, self.touched[:, : len(self.scene.bodies)].T
        return np.concatenate(both, axis=1).max(axis=1)

    @cached_property
    def group(self) -> np.ndarray:
        """(B,) int: the same number for bodies that touched, directly or through others."""
        count = len(self.scene.bodies)
        joined = self.touched[:, :count] | self.touched[:, :count].T | np.eye(count, dtype=bool)
        group, before = np.arange(count), None
        while before is None or (group != before).any():  # the lowest number spreads along contacts
            group, before = np.where(joined, group, count).min(axis=1), group
        return group

    @cached_property
    def own_measures(self) -> dict[str, np.ndarray]:
        """As `Samples.measures`."""
        if isinstance(self.propagator, Samples):
            return self.propagator.measures(self.snapshot.carry, self.scene)
        return {}

    @cached_property
    def conserving(self) -> np.ndarray:
        """(B,) bool: bodies whose energy is conserved by all laws."""
        return conserves_energy(self.scene, self.start, self.touched, self.group)

    @cached_property
    def asymmetry(self) -> np.ndarray | None:
        """(B,): the larger of the `asymmetries`."""
        return None if self.asymmetries is None else self.asymmetries.max(axis=1)

    @cached_property
    def highest_speed(self) -> np.ndarray:
        """(B,): highest speed of each body by its start, its end and gravity [m/s]."""
        scene, before, after = self.scene, self.start.mean, self.snapshot.belief.mean
        way = after[:, POSITION] - before[:, POSITION]
        squares = np.maximum(*((state[:, VELOCITY] ** 2).sum(axis=1) for state in (before, after)))
        gravity = math.sqrt(scene.gravity @ scene.gravity)
        return np.sqrt(squares + 2.0 * gravity * np.abs(way).max(axis=1))


def initial_diagnostics(prediction: PredictionData) -> InitialDiagnostics:
    """Return the diagnostics of the start, which all times of a prediction share."""
    scene, initial, propagator = prediction.scene, prediction.initial, prediction.propagator
    samples = None
    if propagator.traits.mean_update != "nominal":
        samples = rollout_count(prediction.carry) if isinstance(propagator, Samples) else math.inf
    if scene.integrator != "explicit":
        initial = prediction.start
    mass = np.array([body.mass if body.free else 0.0 for body in scene.bodies])
    shapes = np.array([_shape(scene, body) for body in scene.bodies])
    states = initial.mean[None]
    if scene.overlap == "keep" and len(scene.moving):
        states = np.concatenate([states, initial.sample(_DRAWN, np.random.default_rng(_SEED))])
    depths, (held, *_) = overlaps(scene, states)
    overlap, drawn = depths[0], depths[1:]
    if drawn.any():
        overlap = np.maximum(overlap, np.quantile(drawn, _USUAL, axis=0))
    start = InitialDiagnostics(
        initial.mean,
        initial.blocks,
        mass,
        shapes,
        overlap,
        held,
        np.zeros(len(mass)),
        samples,
        propagator.directions(initial) if isinstance(propagator, PointPairs) else None,
        *_found(prediction),
        _coincidences(scene, prediction.initial.mean, shapes[:, 3]),
        is_deterministic(scene, prediction.initial),
        _narrowed(prediction, samples),
    )
    energy, noise = kinetic_moments(scene, start, initial, 1)
    least, _ = kinetic_moments(scene, start, initial, 0)
    if samples is not None and math.isfinite(samples):
        noise[scene.moving] += mass[scene.moving] * _fall_stds(scene, initial)
        energy += _NOISE * noise / math.sqrt(samples)
        least -= _NOISE * noise / math.sqrt(samples)
    return start._replace(energy=held + energy, least_energy=least)


def _fall_stds(scene, belief):
    """Return the standard deviations of positions along gravity, times gravity: (M,) [m^2/s^2]."""
    variance = np.einsum(
        "i,mij,j->m", scene.gravity, belief.blocks[:, ERR_POSITION, ERR_POSITION], scene.gravity
    )
    return np.sqrt(np.maximum(variance, 0.0))


def _found(prediction):
    """Return the adjustments of the rollouts at time 0, and the overlaps that they keep.

    For a single nominal rollout they are those of sigma points, which cover the belief.
    """
    history = prediction.carry.contact_history
    if prediction.points_history is not None:
        history = prediction.points_history
    kept = np.zeros(history.first_time.shape[1:])
    if history.start is not None:
        sample, body = np.nonzero(history.start.partner)
        partner = history.start.partner[sample, body].astype(int) - 1
        np.maximum.at(kept, (body, partner), history.start.kept[sample, body])
    return history.start, kept


def _narrowed(prediction, samples):
    """Return `InitialDiagnostics.narrowed`, of bodies that are not at rest and enough ``samples``."""
    scene, given, begun = prediction.scene, prediction.initial, prediction.start
    found = np.zeros((len(scene.bodies), 2, 2))
    few = samples is not None and samples < _SAMPLES_OF_SPREAD
    if scene.integrator == "explicit" or few:
        return found
    for place, body in enumerate(given.moving):
        if scene.bodies[body].at_rest:
            continue
        for k, own in enumerate((ERR_POSITION, ERR_ROTATION)):
            square, axes = np.linalg.eigh(given.blocks[place][own, own])
            before = np.sqrt(np.maximum(square, 0.0))
            after = np.sqrt(np.einsum("ik,ij,jk->k", axes, begun.blocks[place][own, own], axes).clip(0.0))
            least = int(np.argmin(after / np.where(before > 0.0, before, math.inf) + (before == 0.0)))
            found[body, k] = before[least], after[least]
    return found


def _coincidences(scene, mean, radii):
    """Return `InitialDiagnostics.coincidence` of states (B, 13) of bodies with bounding ``radii`` (B,)."""
    apart = np.linalg.norm(mean[:, None, POSITION] - mean[None, :, POSITION], axis=2)
    closeness = np.maximum(1.0 - apart / np.minimum(radii[:, None], radii), 0.0)
    held = held_at_start(scene)  # where its holder may be
    closeness[held] = closeness[:, held] = 0.0
    np.fill_diagonal(closeness, 0.0)
    if closeness.any():
        closeness[pair_overlaps(scene, mean[None])[0, :, : len(mean)] == 0.0] = 0.0
    return closeness.max(axis=1)


def _shape(scene, body):
    """Return a body's row of `InitialDiagnostics.shapes`."""
    principal = np.linalg.eigvalsh(body.unit_inertia)
    largest = float(body.model.radii.max()) if scene.integrator == "explicit" else 0.0
    return principal[0], principal[-1], largest, body.model.bounding_radius


def _sigma_point_asymmetries(scene, start, points):
    """Return `Evidence.asymmetries` (B, 2) from the errors of points and of the opposite points."""
    result = np.ones((len(scene.bodies), 2))
    forth, back = points
    for k, body in enumerate(scene.moving):
        floors = spread_floors(start, body)
        for c, (block, floor) in enumerate(zip((ERR_POSITION, ERR_ROTATION), floors, strict=True)):
            odd = 0.5 * (forth[:, k, block] - back[:, k, block])
            even = 0.5 * (forth[:, k, block] + back[:, k, block])
            shift = even.sum(axis=0) / (len(even) + 0.5)
            straight = np.sum(odd**2) / (len(odd) + 0.5)
            bent = np.sum(even**2) / (len(even) + 0.5) - shift @ shift
            ratio = math.sqrt((straight + max(bent, 0.0) + floor**2) / (straight + floor**2))
            result[body, c] = max(1.0, ratio)
    return result


def spread_floors(start: InitialDiagnostics, body) -> np.ndarray:
    """Return the spreads of position [m] and rotation [rad] below which they count as equal: (..., 2)."""
    radius = start.shapes[body, 3]
    return np.stack([_SPREAD_FLOOR * radius, np.full(np.shape(radius), _SPREAD_FLOOR)], axis=-1)


def kinetic_moments(scene, start, belief, side):
    """Return mean and standard deviation of the kinetic energy of each body in a rollout: (B,) each [J].

    For a single rollout the deviation is 0. The mean over several rollouts includes the energy of the spread.
    Its rotational part depends on the correlation of velocities and poses, so the least (``side`` 0) or the
    largest (1) moment of inertia bounds it.
    """
    energy, noise = np.zeros(len(scene.bodies)), np.zeros(len(scene.bodies))
    some, P = scene.moving, belief.blocks
    v, w = belief.mean[some, VELOCITY], belief.mean[some, ANGULAR_VELOCITY]
    if start.samples is None:
        for k in some:
            x, inertia = belief.mean[k], scene.bodies[k].unit_inertia
            spin = x[ANGULAR_VELOCITY] @ rotation_matrix(x[QUATERNION])
            energy[k] = 0.5 * start.mass[k] * (x[VELOCITY] @ x[VELOCITY] + spin @ inertia @ spin)
        return energy, noise
    for factor, mean, block in ((1.0, v, ERR_VELOCITY), (start.shapes[some, side], w, ERR_ANGULAR_VELOCITY)):
        spread = P[:, block, block]
        share = factor * start.mass[some]
        energy[some] += 0.5 * share * ((mean**2).sum(axis=1) + np.einsum("mii->m", spread))
        along = np.einsum("mi,mij,mj->m", mean, spread, mean)
        noise[some] += share * np.sqrt(np.maximum(along + 0.5 * (spread**2).sum(axis=(1, 2)), 0.0))
    return energy, noise
