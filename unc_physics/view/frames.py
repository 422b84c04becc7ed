"""Animation frames of a prediction, as plain arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..prediction.prediction import Prediction
from ..propagators.modes import only_mode
from ..spatial.layout import ERR_POSITION, ERROR, POSITION, QUATERNION
from ..spatial.moments import spread_states, symmetric_root
from .meshes import quaternion_of

#: Half axes of ellipsoids, in standard deviations.
SIGMAS = 2.0
_THIN = 2e-4  # m, least half axis of an ellipsoid; thinner ones are invisible
_MOST_JOINT = 8  # most bodies whose samples keep correlations; eigenvalues of larger matrices are slow
_LIKELY = 0.01  # least probability of a mode that is shown


class Ellipsoid(NamedTuple):
    """Ellipsoid of a body's position, with `SIGMAS` standard deviations, in one mode."""

    position: np.ndarray  # (3,): position of the centre of mass [m]
    orientation: np.ndarray  # (4,): quaternion (w, x, y, z), as viser expects
    half_axes: np.ndarray  # (3,) [m]


class AnimationFrames(NamedTuple):
    """Animation frames of a prediction; the first frame is the start."""

    times: np.ndarray  # (T,) [s]
    positions: np.ndarray  # (T, B, 3): means of the bodies' centres of mass, world frame [m]
    orientations: np.ndarray  # (T, B, 4): quaternions (w, x, y, z), as viser expects
    #: ghost_positions, ghost_orientations: (T, N, B, 3) and (T, N, B, 4): states of samples: the
    #: propagator's own, or drawn from its Gaussian with the same numbers in all frames
    ghost_positions: np.ndarray
    ghost_orientations: np.ndarray
    ellipsoids: list[list[tuple[Ellipsoid, ...]]]  # ellipsoids of each frame and body; none for fixed bodies


def frames_of(prediction: Prediction, ghosts: int) -> AnimationFrames:
    """Return the frames of a prediction, with at most ``ghosts`` samples."""
    beliefs = [prediction.start, *prediction.beliefs]
    means = np.array([belief.mean for belief in beliefs])
    z = np.random.default_rng(0).standard_normal((ghosts, ERROR * len(beliefs[0].moving)))
    drawn = [_drawn(belief, z) for belief in beliefs]
    own = [snapshot.samples[:ghosts] for snapshot in prediction.snapshots if snapshot.samples is not None]
    if own:
        drawn = [drawn[0][: len(own[0])], *own]
    states = np.array(drawn).reshape(len(beliefs), -1, *means.shape[1:])
    bodies = prediction.scene.bodies
    last = [prediction[body.name].modes if body.free else () for body in bodies]
    shown: list[list[tuple[Ellipsoid, ...]]] = [
        [(_ellipsoid(only_mode(belief, k)),) if body.free else () for k, body in enumerate(bodies)]
        for belief in beliefs
    ]
    shown[-1] = [tuple(_ellipsoid(mode) for mode in modes if mode.weight > _LIKELY) for modes in last]
    return AnimationFrames(
        np.array([0.0, *prediction.times]),
        means[..., POSITION],
        np.roll(means[..., QUATERNION], 1, axis=-1),
        states[..., POSITION],
        np.roll(states[..., QUATERNION], 1, axis=-1),
        shown,
    )


def _drawn(belief, z):
    """Return states (N, B, 13) that vary smoothly over time for the same standard normal numbers ``z``.

    Symmetric roots are used, since Cholesky factors jump between times.
    """
    if belief.independent or len(belief.moving) > _MOST_JOINT:
        roots = [symmetric_root(block) for block in belief.blocks]
        parts = [z[:, ERROR * k : ERROR * (k + 1)] @ root for k, root in enumerate(roots)]
        errors = np.concatenate(parts, axis=1) if parts else z
    else:
        errors = z @ symmetric_root(belief.joint)
    return spread_states(belief.mean.copy(), belief.moving.copy(), np.ascontiguousarray(errors))


def _ellipsoid(mode):
    values, axes = np.linalg.eigh(mode.covariance[ERR_POSITION, ERR_POSITION])
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    half_axes = np.maximum(SIGMAS * np.sqrt(np.maximum(values, 0.0)), _THIN)
    return Ellipsoid(mode.mean[POSITION], quaternion_of(axes), half_axes)
