"""Initial states of rollouts: drawn from a belief, moved out of overlap, and settled where bodies rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import LimitExceededError
from ..compiler.threads import in_threads
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory, InitialAdjustment
from ..physics.everyday import start as start_of_steps
from ..scene.belief import Belief
from ..scene.contact_world import everyday_world, fresh_history, settled_contacts
from ..scene.kinematic_states import held_at_start, kinematic_belief, with_certain_velocities
from ..scene.scene import Scene
from ..spatial.layout import (
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
from ..spatial.rotation import conjugate, log, multiply, rotate_vectors, rotation_matrices, rotation_matrix

#: Overlap that is tolerated, about that of a loaded contact [m].
OVERLAP_TOLERANCE = 5e-5
#: Uncertain parameters that move the centre of mass over its support, so that what has settled may fall.
_OF_BALANCE = {"center_of_mass", "gravity_direction", "surface_tilt"}
_DRAWN_AT_ONCE, _ACCEPTANCE = 400, 0.05  # samples, and the smallest share of them without overlap
#: Least standard deviations of the height [m] and tilt [rad] of bodies at rest, which contact determines.
_LEAST_STD, _LEAST_TILT = 5e-3, 0.03
_STOOD = 1e-3  # way of a body's points up to which it comes to rest where it was lowered [m]
_SINGULAR = 1e-10  # share of the largest variance that counts as zero
_HONEST_STD = 3e-3  # least standard deviation of the height of a body at rest, when its shift is judged [m]


def constrain_belief(scene: Scene, belief: Belief) -> Belief:
    """Return the belief under the scene's constraints.

    Bodies at rest have velocity zero with certainty. Prescribed bodies are at the beginning of their paths,
    and held bodies move with their holders.
    """
    if scene.acts:
        belief = kinematic_belief(scene, belief)
    resting = _resting(scene)
    if not resting.any():
        return belief
    mean = belief.mean.copy()
    mean[resting, VELOCITY] = mean[resting, ANGULAR_VELOCITY] = 0.0
    return with_certain_velocities(belief, mean, resting)


def draw(scene: Scene, belief: Belief, count: int, seed: int) -> np.ndarray:
    """Return states (count, B, 13) drawn from a belief, without overlap if the scene rejects it.

    The first k of them are the same for every larger count.
    """
    rng = np.random.default_rng(seed)
    if scene.overlap != "reject":
        return belief.sample(count, rng)
    accepted, found, drawn = [], 0, 0
    while found < count:
        if drawn >= max(count, _DRAWN_AT_ONCE) and found < _ACCEPTANCE * drawn:
            raise LimitExceededError(
                f"finds no overlap in only {found} of {drawn} samples, fewer than {_ACCEPTANCE:.0%}; take"
                " 'project'",
                field="overlap",
                value=scene.overlap,
            )
        states = belief.sample(max(count, _DRAWN_AT_ONCE), rng)
        overlap = _Resolution(scene, belief, states).adjustment().overlap
        free = states[(overlap <= OVERLAP_TOLERANCE).all(axis=1)]
        accepted.append(free)
        found, drawn = found + len(free), drawn + len(states)
    return np.concatenate(accepted)[:count]


def resolve_initial_overlap(
    scene: Scene, belief: Belief, states: np.ndarray
) -> tuple[np.ndarray, ContactHistory]:
    """Move states (N, B, 13) drawn from a belief out of overlap, and let bodies at rest settle.

    Overlap is projected away (`physics.everyday.start`) unless the scene's ``overlap`` is ``keep``. Bodies
    that are ``at_rest`` then settle on their supports. The belief is as `constrain_belief` returns it. The
    history, returned with the states, holds the remaining overlap, and in ``start`` the changes made.
    """
    resting = _resting(scene)
    if scene.integrator == "explicit":
        return states, histories.fresh(len(states), scene.world)
    if scene.overlap == "keep" and not resting.any():
        resolution = _Resolution(scene, belief, states)
        return states, fresh_history(scene, len(states))._replace(start=resolution.adjustment())
    drawn, states = states, states.copy()
    resolution = _Resolution(scene, belief, states)
    mean = resolution.of_mean()
    if not resting.any() and mean.is_unchanged(states):  # a single nominal rollout, without overlap
        return states, mean.history
    if scene.overlap != "keep":
        resolution.project(mean.origin)
    if resting.any():
        resolution.settle(drawn, resting)
    return states, resolution.history


def move_out_of_overlap(
    scene: Scene, belief: Belief, states: np.ndarray, bodies: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Move some ``bodies`` of states (N, B, 13) out of overlap, at any time; the other bodies do not move.

    The scene has the implicit integrator. The belief's covariance is the metric of the nearest pose without
    overlap. Returns the states, and the remaining overlap (N, B, B + E) [m].
    """
    states = states.copy()
    held = np.ones(len(scene.bodies), bool)
    held[list(bodies)] = False
    resolution = _Resolution(scene, belief, states)
    resolution.project(resolution.of_mean().origin, held)
    return states, resolution.kept


class _Metric(NamedTuple):
    """Metric of possible motions: what is known well gives way least.

    Attributes
    ----------
    first, second : (n,) int64
        Pairs of bodies: each moving body with itself, and with others if they are not independent.
    covariance : (n, 12, 12) float64
        Covariance of the error states of these pairs.
    """

    first: np.ndarray
    second: np.ndarray
    covariance: np.ndarray


class _Resolution:
    """Removal of overlap from states (N, B, 13), in place, and settling of bodies at rest.

    Attributes
    ----------
    history : ContactHistory
        Of the states; ``start`` holds the changes made.
    kept : (N, B, B + E) array
        Remaining overlap [m].
    """

    def __init__(self, scene: Scene, belief: Belief, states: np.ndarray, like: _Resolution | None = None):
        self._scene, self._belief, self._states = scene, belief, states
        self._metric: _Metric = _metric(scene, belief) if like is None else like._metric
        #: by which bodies are held; shared with ``like``, which is about the same scene and belief
        self._mobilities: dict[bytes, Any] = {} if like is None else like._mobilities
        self.history: Any = fresh_history(scene, len(states))
        self.kept = np.zeros(self.history.first_time.shape, np.float32)

    def adjustment(self) -> InitialAdjustment:
        """Return the overlap of the states, which do not change."""
        self.project(self._nowhere(), look_only=True)
        return self.history.start

    def of_mean(self) -> _Resolution:
        """Return the resolution of the belief's mean, which is moved out of overlap."""
        mean = _Resolution(self._scene, self._belief, self._belief.mean[None].copy(), self)
        mean.project(self._nowhere())
        return mean

    def _nowhere(self):
        """Return no poses to come from."""
        return np.empty((0, *self._states.shape[2:]))

    @property
    def origin(self) -> np.ndarray:
        """The first state (B, 13), out of overlap, from which others come."""
        return self._states[0].copy()

    def is_unchanged(self, states: np.ndarray) -> bool:
        """Return whether ``states`` are these states, which have no overlap."""
        return np.array_equal(states, self._states) and not self.history.start.overlap.any()

    def project(self, origin: np.ndarray, held: np.ndarray | None = None, look_only: bool = False) -> None:
        """Move the states, which come from ``origin`` (B, 13), to the nearest poses without overlap.

        Bodies that are ``held`` (B,) do not move.
        """
        own = held_at_start(self._scene)
        held = own if held is None else held | own
        metric, world = self._mobility(held), everyday_world(self._scene)
        drawn, start, first = self._states.copy(), self.history.start, self.history.first_time

        def run(part):
            found = start_of_steps.Separation(
                *(values[part] for values in (start.overlap, start.kept, start.partner, first))
            )
            start_of_steps.separate(self._states[part], origin, metric, world, look_only, found)

        in_threads(len(self._states), run)
        if look_only:
            first[:] = np.inf
        sample, body = np.nonzero(start.partner)
        self.kept[sample, body, start.partner[sample, body].astype(int) - 1] = start.kept[sample, body]
        for k in np.flatnonzero(metric.moves & (drawn != self._states).any(axis=(0, 2))):
            moved = _mahalanobis(drawn[:, k], self._states[:, k], metric.covariance[k, k])
            start.moved[:, k] = np.maximum(start.moved[:, k], moved)

    def settle(self, drawn: np.ndarray, resting: np.ndarray) -> None:
        """Let the bodies ``resting`` (B,) come to rest; the other bodies do not move.

        First they are lowered onto their supports, which keeps the spread of their horizontal positions. Time
        steps from rest then show which of them are stable. ``drawn`` (N, B, 13) are the states before overlap
        was removed.
        """
        scene, states, start = self._scene, self._states, self.history.start
        down, flat = _down(scene)
        metric = self._mobility(~resting)
        metric = metric._replace(covariance=np.zeros_like(metric.covariance))
        for k, body in enumerate(scene.bodies):
            if resting[k]:
                metric.covariance[k, k, :3, :3] = np.outer(down, down)
                metric.covariance[k, k, 3:, 3:] = (2.0 / body.model.bounding_radius) ** 2 * flat
        world, unsettled = everyday_world(scene), np.zeros(len(states), bool)
        states[:, resting, VELOCITY] = states[:, resting, ANGULAR_VELOCITY] = 0.0
        still = states.copy()

        def run(part):
            start_of_steps.lower(still[part], down, metric._replace(joint=False), world, unsettled[part])

        in_threads(len(states), run)
        held = np.flatnonzero(~unsettled)
        settled = still[held]
        asleep, history = settled_contacts(scene, settled, resting)
        asleep &= _ways(scene, still[held], settled) < _STOOD  # not asleep on the floor, after a fall
        start.unsettled[:, resting] = 1.0
        start.unsettled[np.ix_(held, np.flatnonzero(resting))] = ~asleep[:, resting]
        fine = held[asleep[:, resting].all(axis=1)]
        states[fine] = still[fine]
        self._note_settling(drawn, resting)
        is_balanced = not any(parameter.name in _OF_BALANCE for parameter in scene.uncertain)
        if resting[scene.moving].all() and len(fine) == len(states) and is_balanced:
            first = np.minimum(self.history.first_time, history.first_time)
            self.history = self.history._replace(first_time=first, solver=history.solver)

    def _note_settling(self, drawn, resting):
        """Record in the history how far settling moved and tilted the bodies."""
        belief, states, start = self._belief, self._states, self.history.start
        down, flat = _down(self._scene)
        bodies = np.flatnonzero(resting)
        # the direction of gravity in the bodies' frames
        before, after = (
            rotate_vectors(x[:, bodies, QUATERNION] * [-1.0, -1.0, -1.0, 1.0], down) for x in (drawn, states)
        )
        cross = np.linalg.norm(np.cross(before, after), axis=-1)
        start.tilted[:, bodies] = np.arctan2(cross, (before * after).sum(axis=-1))
        blocks = belief.blocks[np.searchsorted(belief.moving, bodies)]
        vertical = np.einsum("i,bij,j->b", down, blocks[:, ERR_POSITION, ERR_POSITION], down)
        std = np.sqrt(np.maximum(vertical, 0.0))
        sunk = np.abs((states[:, bodies, POSITION] - drawn[:, bodies, POSITION]) @ down)
        frames = [rotation_matrix(belief.mean[k, QUATERNION]) for k in bodies]
        spreads = [R @ P[ERR_ROTATION, ERR_ROTATION] @ R.T for R, P in zip(frames, blocks, strict=True)]
        tilts = np.sqrt([np.trace(flat @ spread @ flat) / 2.0 for spread in spreads])
        far = sunk / np.maximum(std, _HONEST_STD), start.tilted[:, bodies] / np.maximum(tilts, _LEAST_TILT)
        start.moved[:, bodies] = np.maximum.reduce([start.moved[:, bodies], *far])

    def _mobility(self, held):
        """Return the metric of `physics.everyday.start`, with some bodies ``held`` (B,)."""
        known = self._mobilities.get(held.tobytes())
        if known is not None:
            return known
        count, given = len(self._scene.bodies), self._metric
        covariance, velocity = np.zeros((2, count, count, 6, 6))
        moves = np.array([body.free for body in self._scene.bodies]) & ~held
        some = moves[given.first] & moves[given.second]
        i, j, both = given.first[some], given.second[some], given.covariance[some]
        pose, speeds = np.r_[ERR_POSITION, ERR_ROTATION], np.r_[ERR_VELOCITY, ERR_ANGULAR_VELOCITY]
        velocity[i, j] = both[:, speeds[:, None], speeds]
        R = rotation_matrices(self._belief.mean[:, QUATERNION])
        block = both[:, pose[:, None], pose]
        block[:, 3:] = R[i] @ block[:, 3:]
        block[:, :, 3:] = block[:, :, 3:] @ R[j].transpose(0, 2, 1)
        covariance[i, j] = block
        joint = bool(block[i != j].any())
        mean = np.concatenate(
            [self._belief.mean[:, VELOCITY], self._belief.mean[:, ANGULAR_VELOCITY]], axis=1
        )
        found = start_of_steps.Mobility(covariance, velocity, mean, moves, joint)
        self._mobilities[held.tobytes()] = found
        return found


def _mahalanobis(before, after, covariance):
    """Return how far states (N, 13) were moved, in standard deviations of a covariance (6, 6), world axes."""
    error = np.empty((len(before), 6))
    error[:, :3] = after[:, POSITION] - before[:, POSITION]
    turned = (before[:, QUATERNION] != after[:, QUATERNION]).any(axis=1)
    error[:, 3:] = 0.0
    for n in np.flatnonzero(turned):
        q = multiply(tuple(after[n, QUATERNION]), conjugate(tuple(before[n, QUATERNION])))
        error[n, 3:] = log(q)
    square = np.einsum(
        "ni,ij,nj->n", error, np.linalg.pinv(covariance, rcond=_SINGULAR, hermitian=True), error
    )
    return np.sqrt(np.maximum(square, 0.0))


def _ways(scene, before, after):
    """Return how far the farthest points of bodies went between two sets of states (N, B, 13): (N, B) [m]."""
    cosine = np.abs((before[..., QUATERNION] * after[..., QUATERNION]).sum(axis=-1))
    turned = 2.0 * np.arccos(np.minimum(cosine, 1.0)) * [body.model.bounding_radius for body in scene.bodies]
    return np.linalg.norm(after[..., POSITION] - before[..., POSITION], axis=-1) + turned


def _resting(scene):
    """Return which bodies (B,) are at rest at time 0."""
    return np.array([body.at_rest for body in scene.bodies])


def _metric(scene, belief):
    """Return the covariance of possible poses: the belief's, with bodies at rest set free."""
    count = len(belief.moving)
    own = np.arange(count)
    if belief.independent:
        first, second, P = own, own, belief.covariance.copy()
    else:
        first, second = (places.ravel() for places in np.indices((count, count)))
        P = belief.joint.reshape(count, ERROR, count, ERROR)[first, :, second]
        own = own * (count + 1)
    _free_resting(scene, belief, P, own)
    return _Metric(belief.moving[first], belief.moving[second], P)


def _free_resting(scene, belief, P, own):
    """Add variances by which bodies at rest can move up and tilt; bodies' blocks of ``P`` are at ``own``."""
    for k, body in zip(own, belief.moving, strict=True):
        if scene.bodies[body].at_rest:
            down, flat = _down(scene)
            up = np.outer(down, down)
            R = rotation_matrix(belief.mean[body, QUATERNION])
            P[k, ERR_POSITION, ERR_POSITION] += _LEAST_STD**2 * up
            P[k, ERR_ROTATION, ERR_ROTATION] += _LEAST_TILT**2 * R.T @ flat @ R


def _down(scene):
    """Return the direction of gravity (3,), and the projection (3, 3) onto the horizontal plane."""
    down = scene.gravity / np.linalg.norm(scene.gravity)
    return down, np.eye(3) - np.outer(down, down)
