"""Data of a status: diagnostics of the start, which all times share, and of one snapshot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..physics.contact_history import ContactHistory
from ..propagators.base import PointPairs, Propagator, Samples, rollout_count
from ..propagators.free_flight import course_of
from ..propagators.overlap_depths import overlaps, pair_overlaps
from ..propagators.point_pairs import opposite_points
from ..propagators.start import OVERLAP_TOLERANCE
from ..scene.belief import Belief
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
from ..spatial.moments import mean_and_errors, pose_spreads
from ..spatial.rotation import left_jacobian, rotation_matrix
from .conservation_checks import conserves_energy
from .prediction_data import PredictionData
from .probability import is_deterministic
from .rare_outcomes import tail_factors
from .snapshot import Snapshot

#: Rotation in one step from which on covariances of first order in it are compared with rollouts [rad]: the
#: spread across the axis is then too large by 19 %, at 3.8 by a factor of 2.
_MOST_FLIGHT_TURN = 2.0
_MOST_DIRECTIONS = 30  # from which on points lie far out
_SYMMETRIC = 1.05  # asymmetry of sigma points up to which they move oppositely
_SAME_PLACE = 0.02  # distance of two centres of mass, over the smaller radius, that says no direction
_DRAWN = 40  # states of a belief whose overlaps are computed
_SEED = 0  # of their draws; fixed, so that statuses are reproducible
#: Least spread that is compared, over the body's radius and in rad: the accuracy of contacts, which are
#: explicit or leave a depth.
_SPREAD_FLOORS = {"explicit": 1e-4, "implicit": 1e-3}
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
    #: both allow for the sampling error of the mean
    energy: np.ndarray
    least_energy: np.ndarray
    #: number of samples that a belief is the mean of; infinite for chosen points, None for a single rollout
    samples: float | None
    #: (M,): number of directions along which points are spread; None without points
    directions: np.ndarray | None
    found: Any  # adjustments of points or samples at time 0; None for the explicit integrator
    kept_overlaps: np.ndarray  # (B, B + E): deepest overlap of each pair that could not be removed [m]
    coincident: np.ndarray  # (B,) bool: bodies that overlap another one in the same place, as given
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
    #: (B,): spread of points in opposite pairs over the spread of the odd part of their errors, of position
    #: or rotation, whichever is larger; None without such points
    asymmetry: np.ndarray | None
    #: (R, B, 13): states of rollouts that the answer is compared with; None without them
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
        states, asymmetry = snapshot.rollout_states, None
        if snapshot.points is not None:
            states = snapshot.points
            asymmetry = _sigma_point_asymmetry(scene, start, opposite_points(snapshot.points, scene.moving))
        elif propagator.traits.mean_update == "nominal" or len(history.first_time) == 1:
            states = snapshot.belief.mean[None]
        wide, missing = snapshot.wide, prediction.left_out
        return cls(
            scene, propagator, start, snapshot, history, states, asymmetry, wide=wide, left_out=missing
        )

    @cached_property
    def predicted_spreads(self) -> np.ndarray:
        """(M, 2): predicted standard deviations of position [m] and rotation [rad]."""
        return pose_spreads(self.snapshot.belief.blocks)

    @cached_property
    def compared_moments(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean (B, 13) of the compared rollouts, and standard deviations (M, 2) of position [m] and rotation
        [rad] about it; None without rollouts.
        """
        if self.compared is None:
            return None
        mean, errors = mean_and_errors(np.ascontiguousarray(self.compared), self.scene.moving.copy())
        return mean, pose_spreads(Belief.of_errors(mean, errors, self.scene.moving).blocks)

    @cached_property
    def spread_factors(self) -> np.ndarray | None:
        """(B, 2): factors between predicted and compared standard deviations of position and rotation; None
        without rollouts.
        """
        if self.compared_moments is None:
            return None
        scene, spreads = self.scene, self.compared_moments[1]
        floors = spread_floors(self.start, scene.moving)
        predicted = np.maximum(self.predicted_spreads, floors)
        found = np.where(np.isfinite(spreads), np.maximum(spreads, floors), math.inf)
        result = np.ones((len(scene.bodies), 2))
        result[scene.moving] = np.maximum(predicted / found, found / predicted)
        return result

    @cached_property
    def mean_distances(self) -> np.ndarray | None:
        """(B, 2): distances of the predicted mean position and rotation from those of the compared rollouts,
        over their standard deviations; None without rollouts.
        """
        if self.compared_moments is None:
            return None
        scene, predicted, (mean, spreads) = self.scene, self.snapshot.belief.mean, self.compared_moments
        result = np.zeros((len(scene.bodies), 2))
        for place, k in enumerate(scene.moving.tolist()):
            cosine = abs(float(predicted[k, QUATERNION] @ mean[k, QUATERNION]))
            apart = (
                np.linalg.norm(predicted[k, POSITION] - mean[k, POSITION]),
                2.0 * math.acos(min(cosine, 1.0)),
            )
            result[k] = apart / np.maximum(spreads[place], spread_floors(self.start, k))
        return result

    @cached_property
    def doubts(self) -> list[list[str]]:
        """Reasons for which each body's spread should be compared with that of rollouts, in words."""
        traits, start, count = self.propagator.traits, self.start, len(self.scene.bodies)
        touched = np.isfinite(self.history.first_time)
        nominal = self.touches & (traits.mean_update == "nominal")
        reasons: dict[str, np.ndarray] = {"it is that of one nominal rollout": nominal}
        if self.left_out:
            reasons[f"it leaves out {', '.join(self.left_out)}"] = self.touches
        if traits.separate_collisions:
            reasons["it is of first order in the rotation of a step"] = self.step_turn > _MOST_FLIGHT_TURN
        if isinstance(self.propagator, PointPairs):
            uneven = np.ones(count) if self.asymmetry is None else self.asymmetry
            moves = np.logical_or(self.touches, self.scene.gyroscopic)
            reasons["opposite points do not move oppositely"] = moves & (uneven > _SYMMETRIC)
            differ = touched.max(axis=0) & ~touched.min(axis=0)
            differ = np.concatenate([differ, differ[:, :count].T], axis=1).max(axis=1)
            reasons["its points touch different things"] = differ
            if start.directions is None or start.directions.sum() > _MOST_DIRECTIONS:
                reasons["its points lie far out"] = self.touches
            reasons["its points may turn by half a turn"] = self._points_wrap()
        return [[words for words, of in reasons.items() if of[k]] for k in range(count)]

    def _points_wrap(self):
        """Return of which bodies (B,) the farthest points may have turned by half a turn from the mean.

        Rotations repeat there: the points' spread is too small, and they still look opposite. The number of
        directions says how far out the points are. Before a contact a body flies as it began; since then, it
        spins as in the final belief.
        """
        scene, start, found = self.scene, self.start, np.zeros(len(self.scene.bodies), bool)
        if start.directions is None:
            return found
        far = math.sqrt(start.directions.sum() + len(scene.uncertain) + 0.5)
        turn = course_of(scene, self.snapshot.time / scene.dt).turn
        first = self.history.first_time.min(axis=0)
        since = self.snapshot.time - np.minimum(first.min(axis=1), first[:, : len(found)].min(axis=0))
        for k, body in enumerate(scene.moving.tolist()):
            P, x = start.blocks[k], start.mean[body]
            if self.touches[body]:
                spin = self.snapshot.belief.blocks[k, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY]
                std = math.sqrt(max(spin.trace(), 0.0)) * max(since[body], 0.0)
            else:
                back = left_jacobian(-turn * x[ANGULAR_VELOCITY])  # to the axes at the start
                J = np.hstack([np.eye(3), turn * rotation_matrix(x[QUATERNION]).T @ back])
                std = math.sqrt(max(np.linalg.eigvalsh(J @ P[_SPUN, _SPUN] @ J.T)[-1], 0.0))
            begun = math.sqrt(max(np.linalg.eigvalsh(P[ERR_ROTATION, ERR_ROTATION])[-1], 0.0))
            found[body] = far * max(std, begun) > math.pi
        return found

    @cached_property
    def step_turn(self) -> np.ndarray:
        """(B,): rotation of each body in one step, by its start and its end [rad]."""
        both = (x[:, ANGULAR_VELOCITY] for x in (self.start.mean, self.snapshot.belief.mean))
        return self.scene.dt * np.max([np.linalg.norm(omega, axis=1) for omega in both], axis=0)

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
        _coincident(scene, prediction.initial.mean, shapes[:, 3]),
        is_deterministic(scene, prediction.initial),
        _narrowed(prediction, samples),
    )
    energy, noise = kinetic_moments(scene, start, initial, 1)
    least, _ = kinetic_moments(scene, start, initial, 0)
    if samples is not None and math.isfinite(samples):
        fall = np.einsum(  # variances of positions along gravity, times its square
            "i,mij,j->m", scene.gravity, initial.blocks[:, ERR_POSITION, ERR_POSITION], scene.gravity
        )
        noise[scene.moving] += mass[scene.moving] * np.sqrt(np.maximum(fall, 0.0))
        energy += _NOISE * noise / math.sqrt(samples)
        least -= _NOISE * noise / math.sqrt(samples)
    return start._replace(energy=held + energy, least_energy=least)


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


def overlap_shares(prediction: PredictionData) -> np.ndarray:
    """Return the share of samples or points in which each body overlapped something at the start, and was
    moved unless the scene keeps overlap: (B,); zeros with the explicit integrator.
    """
    found, _ = _found(prediction)
    if found is None:
        return np.zeros(len(prediction.scene.bodies))
    return (found.overlap > OVERLAP_TOLERANCE).mean(axis=0)


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


def _coincident(scene, mean, radii):
    """Return `InitialDiagnostics.coincident` of states (B, 13) of bodies with bounding ``radii`` (B,)."""
    apart = np.linalg.norm(mean[:, None, POSITION] - mean[None, :, POSITION], axis=2)
    same = apart < _SAME_PLACE * np.minimum(radii[:, None], radii)
    held = held_at_start(scene)  # where its holder may be
    same[held] = same[:, held] = False
    np.fill_diagonal(same, False)
    if same.any():
        same &= pair_overlaps(scene, mean[None])[0, :, : len(mean)] > 0.0
    return same.any(axis=1)


def _shape(scene, body):
    """Return a body's row of `InitialDiagnostics.shapes`."""
    principal = np.linalg.eigvalsh(body.unit_inertia)
    largest = float(body.model.radii.max()) if scene.integrator == "explicit" else 0.0
    return principal[0], principal[-1], largest, body.model.bounding_radius


def _sigma_point_asymmetry(scene, start, points):
    """Return `Evidence.asymmetry` (B,) from the errors of points and of the opposite points."""
    result = np.ones(len(scene.bodies))
    forth, back = points
    for k, body in enumerate(scene.moving):
        floors = spread_floors(start, body)
        for block, floor in zip((ERR_POSITION, ERR_ROTATION), floors, strict=True):
            odd = 0.5 * (forth[:, k, block] - back[:, k, block])
            even = 0.5 * (forth[:, k, block] + back[:, k, block])
            shift = even.sum(axis=0) / (len(even) + 0.5)
            straight = np.sum(odd**2) / (len(odd) + 0.5)
            bent = np.sum(even**2) / (len(even) + 0.5) - shift @ shift
            ratio = math.sqrt((straight + max(bent, 0.0) + floor**2) / (straight + floor**2))
            result[body] = max(result[body], ratio)
    return result


def spread_floors(start: InitialDiagnostics, body) -> np.ndarray:
    """Return the spreads of position [m] and rotation [rad] below which they count as equal: (..., 2)."""
    radius, floor = start.shapes[body, 3], _SPREAD_FLOORS["explicit" if start.found is None else "implicit"]
    return np.stack([floor * radius, np.full(np.shape(radius), floor)], axis=-1)


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
