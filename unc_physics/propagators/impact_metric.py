"""Metric of a response surface: weights of uncertain directions by their effect on contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..compiler import kernel
from ..scene.scene import Scene
from ..spatial.layout import EP, ER, ERROR, EV, EW, Q, V, W
from ..spatial.rotation import exp, multiply, normalized, rotate_back, write_matrix
from .free_flight import course_of

_ALONG_FLIGHT = 0.1  # weight of displacements along the flight, which only change the time of a contact
_SOON = 0.1  # s, after which the effect of a change of velocity counts
_LEAST = 0.1  # least scale of a direction, as a share of the largest
_PARAMETER = 0.5  # scale of uncertain parameters, which displace nothing before, as a share of the largest
_SLOW = 1e-3  # m/s, below which there is no direction of flight


def impact_metric(
    scene: Scene,
    mean: np.ndarray,
    root: np.ndarray,
    bodies: np.ndarray,
    meetings: Sequence[tuple[int, int, float, float]],
    parameters: int,
) -> np.ndarray:
    """Return the map (d, d) from standard normal numbers to coordinates in which all directions matter alike.

    ``mean`` (B, 13) are states at time 0, and ``root`` (12 m, d - parameters) the errors of the moving
    ``bodies`` (m,) per number. The last of the d numbers are uncertain ``parameters``. Each of the
    ``meetings`` has an index into ``bodies``, another index or -1 for fixed things, the time of the first
    contact [s], and its share of the rollouts.

    Notes
    -----
    Two errors matter alike if they displace two bodies alike just before their contact, across the flight.
    Displacements along the flight only change the time of the contact, and the rotation of the bodies until
    then. Rotations count by half a radius.
    """
    size = root.shape[1]
    errors = root.reshape(len(bodies), ERROR, size)
    G = np.zeros((size + parameters, size + parameters))
    states, radii = mean[bodies], scene.radii[bodies]
    for i, j, time, share in meetings:
        along = course_of(scene, round(time / scene.dt))
        who = [i] if j < 0 else [i, j]
        course = along.decay, along.fall, along.reach, along.turn
        _add_meeting(G, share, states[who], radii[who], errors[who], scene.gravity, course)
    if parameters:
        largest = np.linalg.eigvalsh(G)[-1]
        G[np.arange(size, size + parameters), np.arange(size, size + parameters)] = _PARAMETER**2 * largest
    if not G.any():
        return np.eye(size + parameters)
    values, vectors = np.linalg.eigh(G)
    scales = np.sqrt(np.maximum(values[::-1] / values[-1], 0.0))
    return vectors[:, ::-1] * np.maximum(scales, _LEAST)


@kernel
def _add_meeting(G, share, states, radii, errors, gravity, course):
    """Add to ``G`` the effects of errors (n, 12, r) on a meeting of two bodies, or of one with a fixed thing.

    The bodies have ``states`` (n, 13) at time 0. ``course`` has decay, fall, reach and turn of a `Course`.
    """
    decay, fall, reach, turn = course
    count, size = len(states), errors.shape[2]
    A = np.zeros((3 + 9 * count, size))
    ahead, v, R = np.zeros(size), np.zeros(3), np.empty((1, 3, 3))
    for s in range(count):
        sign = 1.0 if s == 0 else -1.0
        for k in range(3):
            v[k] += sign * (decay * states[s, V + k] + fall * gravity[k])
            for c in range(size):
                A[k, c] += sign * (errors[s, EP + k, c] + reach * errors[s, EV + k, c])
    speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if speed > _SLOW:
        for c in range(size):
            ahead[c] = (v[0] * A[0, c] + v[1] * A[1, c] + v[2] * A[2, c]) / speed
            for k in range(3):
                A[k, c] -= (1.0 - _ALONG_FLIGHT) * v[k] / speed * ahead[c]
    for s in range(count):
        arm, w, first = 0.5 * radii[s], states[s, W : W + 3], 3 + 9 * s
        turned = exp(turn * w[0], turn * w[1], turn * w[2])
        q = states[s, Q], states[s, Q + 1], states[s, Q + 2], states[s, Q + 3]
        write_matrix(normalized(multiply(turned, q)), R, 0)
        spin = rotate_back(R[0], decay * w[0], decay * w[1], decay * w[2])
        for c in range(size):
            e = errors[s, :, c]
            more = rotate_back(R[0], turn * e[EW], turn * e[EW + 1], turn * e[EW + 2])
            delay = -ahead[c] / speed if speed > _SLOW else 0.0
            for k in range(3):
                A[first + k, c] = arm * (e[ER + k] + more[k] + spin[k] * delay)
                A[first + 3 + k, c] = _SOON * e[EV + k]
                A[first + 6 + k, c] = _SOON * arm * e[EW + k]
    for a in range(size):
        for b in range(size):
            total = 0.0
            for k in range(len(A)):
                total += A[k, a] * A[k, b]
            G[a, b] += share * total
