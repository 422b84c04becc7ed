"""Corrections of an ensemble of states by measurements.

The update is deterministic: a square-root filter whose members have the mean and the covariance of
the Kalman filter, without perturbed observations (Andrews 1968; Tippett et al. 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty, zeros
from ..spatial.layout import ERROR
from ..spatial.moments import boxplus, mean_and_errors, spread_states
from .measurements import Observation
from .observation import RELATIVE_POSE, factor, log_density, solve_lower, solve_upper, write_residual


class Gates(NamedTuple):
    """Squared Mahalanobis distances of innovations, for measurements of six dimensions.

    Attributes
    ----------
    soft : float
        Above it the measurement's covariance is multiplied by the ratio of the distance to this. The distance
        stays larger where the members' spread is large beside the measurement's error.
    hard : float
        Above it the measurement is rejected.
    """

    soft: float = 20.0
    hard: float = 100.0


def of_dimensions(value: float, dimensions: int) -> float:
    """Return a value for measurements of six dimensions, in proportion, for another number of them."""
    return value * dimensions / 6.0


#: Gates that let everything through.
OPEN = Gates(np.inf, np.inf)


class BodyObservation(NamedTuple):
    """An observation of one body.

    Attributes
    ----------
    body : int
        Index of the body.
    observation : Observation
    reference : int
        Index of the body that a relative pose refers to; otherwise that of the body itself.
    delay : float
        How much later than the states it was taken [s].
    """

    body: int
    observation: Observation
    reference: int
    delay: float = 0.0


class Innovation(NamedTuple):
    """Agreement of a measurement with its expectation.

    Attributes
    ----------
    square : float
        Squared Mahalanobis distance, before the soft gate.
    density : float
        Logarithm of the predicted density.
    accepted : bool
        Whether it was within the hard gate.
    """

    square: float
    density: float
    accepted: bool


class Corrected(NamedTuple):
    """Result of `corrected`.

    Attributes
    ----------
    states : (N, B, 13) array
    parameters : (N, K) array
    innovations : tuple of Innovation
        One for each measurement.
    """

    states: np.ndarray
    parameters: np.ndarray
    innovations: tuple[Innovation, ...]


def corrected(
    states: np.ndarray,
    moving: np.ndarray,
    measurements: Sequence[BodyObservation],
    groups: np.ndarray,
    *,
    parameters: np.ndarray | None = None,
    gates: Gates = OPEN,
) -> Corrected:
    """Correct an ensemble of states by measurements, one after the other.

    Parameters
    ----------
    states : (N, B, 13) array
        Equally probable states.
    moving : (M,) int64 array
        Indices of the bodies that move freely.
    measurements : sequence of BodyObservation
        Of moving bodies.
    groups : (M,) int array
        Moving bodies with the same number are correlated; a measurement corrects all bodies of its body's
        group. The correlations of the others in a small ensemble are due to chance.
    parameters : (N, K) array, optional
        Uncertain parameters of the members, which every measurement corrects.
    gates : Gates, optional
        By default all measurements are accepted.

    Returns
    -------
    Corrected
        Bodies of groups without an accepted measurement keep their states, to the last bit.
    """
    moving = np.ascontiguousarray(moving, np.int64)
    place = np.full(states.shape[1], -1)
    place[moving] = np.arange(len(moving))
    groups, own = np.array(groups), np.zeros((len(states), 0)) if parameters is None else parameters
    for one in measurements:  # a relative pose ties two bodies together
        a, b = place[one.body], place[one.reference]
        if b >= 0 and groups[a] != groups[b]:
            groups[groups == groups[b]] = groups[a]
    mean, errors = mean_and_errors(states, moving)
    middle = own.mean(axis=0)
    errors = np.concatenate([errors, own - middle], axis=1)
    change, touched, innovations = np.zeros(errors.shape[1]), np.zeros(len(moving), bool), []
    changed = False
    for one in measurements:
        k, seen = place[one.body], one.observation
        mine = np.flatnonzero(groups == groups[k])
        columns = (ERROR * mine[:, None] + np.arange(ERROR)).ravel()
        columns = np.concatenate([columns, np.arange(ERROR * len(moving), errors.shape[1])])
        bodies = _MeasuredBodies(one.body, k, one.reference, place[one.reference])
        reading = _Reading(seen.kind, seen.value, seen.point, seen.noise, one.delay)
        own_gates = Gates(*(of_dimensions(gate, len(seen.noise)) for gate in gates))
        square, density, accepted = correct_errors(mean, errors, columns, bodies, reading, own_gates, change)
        innovations.append(Innovation(square, density, accepted))
        if accepted:
            changed = True
            touched[mine] = True
            _move_mean(mean, moving[mine], change, ERROR * mine)
            middle = middle + change[ERROR * len(moving) :]
    if not changed:
        return Corrected(states, own, tuple(innovations))
    size = ERROR * len(moving)
    spread = spread_states(mean, moving, np.ascontiguousarray(errors[:, :size]))
    kept = np.ones(states.shape[1], bool)  # prescribed bodies may differ from member to member
    kept[moving[touched]] = False
    spread[:, kept] = states[:, kept]
    return Corrected(spread, middle + errors[:, size:], tuple(innovations))


def _move_mean(mean, bodies, change, rows):
    """Move the mean states (B, 13) of some bodies by a change of the error state, in place."""
    for body, row in zip(bodies, rows, strict=True):
        before = mean[body].copy()
        boxplus(before, change[row : row + ERROR], mean[body])


class _MeasuredBodies(NamedTuple):
    """The measured body and the one that it refers to, and their places among the moving bodies.

    The place of a body that does not move is -1.
    """

    body: int
    place: int
    reference: int
    reference_place: int


class _Reading(NamedTuple):
    """Fields of an `Observation` for the kernel, and its delay [s]."""

    kind: int
    value: np.ndarray
    point: np.ndarray
    noise: np.ndarray
    delay: float


@kernel(noinline=True)
def correct_errors(mean, errors, columns, bodies, reading, gates, change):
    """Correct the errors (N, n) of an ensemble about its mean (B, 13) in place, by one measurement.

    ``columns`` are those of the errors that the measurement corrects. ``gates`` are those of a measurement of
    its dimension. The change of the mean is written into ``change`` (n,).

    Returns
    -------
    square, density : float
        Squared distance of the innovation and logarithm of its density, without the gates.
    accepted : bool
    """
    count, m, k, r_k = len(errors), len(reading.noise), bodies.place, bodies.reference_place
    Z, x, other = empty((count, m)), empty(13), mean[bodies.reference].copy()
    for n in range(count):
        boxplus(mean[bodies.body], errors[n, ERROR * k : ERROR * (k + 1)], x)
        if reading.kind == RELATIVE_POSE and r_k >= 0:
            boxplus(mean[bodies.reference], errors[n, ERROR * r_k : ERROR * (r_k + 1)], other)
        write_residual(x, other, reading.kind, reading.value, reading.point, reading.delay, Z[n])
    y, S, R = empty(m), zeros((m, m)), reading.noise.copy()
    for r in range(m):
        total = 0.0
        for n in range(count):
            total += Z[n, r]
        total /= count
        y[r] = -total
        for n in range(count):
            Z[n, r] -= total
    for n in range(count):
        for r in range(m):
            for c in range(r + 1):
                S[r, c] += Z[n, r] * Z[n, c]
    for r in range(m):
        for c in range(r + 1):
            S[r, c] /= count - 1
            S[c, r] = S[r, c]
    sum_, Ls, Lr, white = empty((m, m)), zeros((m, m)), zeros((m, m)), empty(m)
    for r in range(m):
        for c in range(m):
            sum_[r, c] = S[r, c] + R[r, c]
    factor(sum_, m, Ls)
    solve_lower(Ls, m, y, white)
    square = 0.0
    for r in range(m):
        square += white[r] ** 2
    density = log_density(Ls, m, square)
    if not square <= gates.hard:
        return square, density, False
    if square > gates.soft:
        for r in range(m):
            for c in range(m):
                R[r, c] *= square / gates.soft
                sum_[r, c] = S[r, c] + R[r, c]
        factor(sum_, m, Ls)
        solve_lower(Ls, m, y, white)
    factor(R, m, Lr)
    gain, both, unit, image = empty(m), zeros((m, m)), zeros(m), empty(m)
    for r in range(m):
        for c in range(r + 1):
            both[r, c] = Ls[r, c] + Lr[r, c]
    solve_upper(Ls, m, white, gain)  # S^-1 y
    W = empty((m, m))  # Ls^-T (Ls + Lr)^-1
    for c in range(m):
        for r in range(m):
            unit[r] = 1.0 if r == c else 0.0
        solve_lower(both, m, unit, image)
        solve_upper(Ls, m, image, white)
        for r in range(m):
            W[r, c] = white[r]
    C, reduced = empty(m), empty(m)
    for column in columns:
        for r in range(m):
            C[r] = 0.0
        for n in range(count):
            e = errors[n, column]
            for r in range(m):
                C[r] += e * Z[n, r]
        total = 0.0
        for r in range(m):
            C[r] /= count - 1
            total += C[r] * gain[r]
        change[column] = total
        for c in range(m):
            total = 0.0
            for r in range(m):
                total += C[r] * W[r, c]
            reduced[c] = total
        for n in range(count):
            total = 0.0
            for r in range(m):
                total += Z[n, r] * reduced[r]
            errors[n, column] -= total
    return square, density, True
