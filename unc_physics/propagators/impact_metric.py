"""Which uncertain directions matter for a contact: the metric that a response surface measures by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..physics.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    QUATERNION,
    VELOCITY,
)
from ..physics.rotation import rotation_matrix
from ..scene.scene import Scene
from .free_flight import Flight, course_of, flown

_ALONG_FLIGHT = 0.1  # weight of displacements along the flight: they make a contact earlier or later
_SOON = 0.1  # s, in which a change of velocity shows
_LEAST = 0.1  # of the largest scale, which no direction falls below
_PARAMETER = 0.5  # of the largest scale: that of uncertain parameters, which displace nothing before
_SLOW = 1e-3  # m/s, below which there is no direction of flight


def impact_metric(
    scene: Scene,
    mean: np.ndarray,
    root: np.ndarray,
    bodies: np.ndarray,
    meetings: Sequence[tuple[int, int, float, float]],
    parameters: int,
) -> np.ndarray:
    """(d, d): the map from standard normal numbers to coordinates in which all directions matter alike.

    Parameters
    ----------
    scene : Scene
    mean : (B, 13) array
        States at time 0.
    root : (12 m, d - parameters) array
        Errors that the numbers make, of the moving ``bodies`` (m,).
    meetings : sequence of (int, int, float, float)
        Who meets at first: a place in ``bodies`` and another, or -1 for what is fixed; when [s]; and in what
        share of the rollouts.
    parameters : int
        How many of the d numbers are uncertain parameters.

    Notes
    -----
    Two errors matter alike that displace two bodies alike just before their contact, across the flight. Along
    it they only make the contact earlier or later, while which the bodies turn. Rotations count by half a
    radius.
    """
    size = root.shape[1]
    errors = root.reshape(len(bodies), ERROR, size)
    G = np.zeros((size + parameters, size + parameters))
    world = scene.world
    for i, j, time, share in meetings:
        along = course_of(world, round(time / world.dt))
        flight = Flight(world.gravity, along, 0)
        J, v, turns = np.zeros((3, size)), np.zeros(3), []
        for k, side in ((i, 1.0), (j, -1.0)):
            if k < 0:
                continue
            state, e = flown(mean[bodies[k]], flight), errors[k]
            J += side * (e[ERR_POSITION] + along.reach * e[ERR_VELOCITY])
            v += side * state[VELOCITY]
            R = rotation_matrix(state[QUATERNION])
            turned = e[ERR_ROTATION] + along.turn * R.T @ e[ERR_ANGULAR_VELOCITY]
            turns.append((turned, R.T @ state[ANGULAR_VELOCITY], 0.5 * world.bodies.radius[bodies[k]], e))
        speed = float(np.linalg.norm(v))
        ahead = (v / speed) @ J if speed > _SLOW else np.zeros(size)
        delay = -ahead / speed if speed > _SLOW else ahead
        parts = [J - (1.0 - _ALONG_FLIGHT) * np.outer(v / max(speed, _SLOW), ahead)]
        for turned, spin, arm, e in turns:
            parts += [arm * (turned + np.outer(spin, delay))]
            parts += [_SOON * e[ERR_VELOCITY], _SOON * arm * e[ERR_ANGULAR_VELOCITY]]
        A = np.concatenate(parts)
        G[:size, :size] += share * (A.T @ A)
    largest = np.linalg.eigvalsh(G)[-1] if size else 0.0
    if not largest > 0.0:
        return np.eye(size + parameters)
    G[np.arange(size, size + parameters), np.arange(size, size + parameters)] = _PARAMETER**2 * largest
    values, vectors = np.linalg.eigh(G)
    scales = np.sqrt(np.maximum(values[::-1] / values[-1], 0.0))
    return vectors[:, ::-1] * np.maximum(scales, _LEAST)
