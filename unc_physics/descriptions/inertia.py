"""Inertia of a description's link: whether mass inside the link's shape can have it."""

from __future__ import annotations

import numpy as np

from ..checks.errors import InvalidModelError
from ..shapes.distance import even_directions
from ..shapes.packing_file import check_inertia

_NAMES = "ixx", "iyy", "izz"
_SLACK = 0.02  # share of the largest moment: files have few digits
_SPREAD = 1.5  # times the largest mean square along a direction: shapes for collisions are simplified
_OUTSIDE = 0.01  # of the extent, by which the centre of mass may lie outside the shape
_DIRECTIONS = 200  # in which the spread of mass is compared with the shape
#: Shares of the shape's moments at uniform density beyond which a file's moments get a note.
_LOW, _HIGH = 0.1, 3.0


def combined(masses, centers, inertias) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre of mass (3,) of bodies with masses (n,), and their inertia (3, 3) about it.

    ``inertias`` (n, 3, 3) are about the bodies' own ``centers`` (n, 3) of mass [m].
    """
    center = np.asarray(masses) @ centers / np.sum(masses)
    arms = np.asarray(centers) - center
    squares = (arms.T * masses) @ arms
    return center, np.sum(inertias, axis=0) + np.trace(squares) * np.eye(3) - squares


def check_moments(inertia: np.ndarray) -> None:
    """Raise `InvalidModelError` if a matrix (3, 3) is no inertia tensor; the message names the moment.

    Parameters
    ----------
    inertia : (3, 3) array
        As in the file [kg m^2].
    """
    moments = np.diag(inertia)
    for k, name in enumerate(_NAMES):
        if not moments[k] > 0.0:
            raise InvalidModelError(f"{name} must be positive (got {moments[k]:g})", field="inertia")
    for k, name in enumerate(_NAMES):
        i, j = (n for n in range(3) if n != k)
        if moments[k] > (moments[i] + moments[j]) * (1.0 + 1e-6):
            raise InvalidModelError(
                f"{name}, {moments[k]:g} kg m^2, is more than {_NAMES[i]} + {_NAMES[j]},"
                f" {moments[i] + moments[j]:g} kg m^2, so it belongs to no solid",
                field="inertia",
            )
    try:
        check_inertia(inertia)
    except InvalidModelError as error:
        values = ", ".join(f"{moment:.4g}" for moment in np.linalg.eigvalsh(inertia))
        raise InvalidModelError(
            f"its principal moments are {values} kg m^2 with ixy, ixz and iyz, and it {error.problem}",
            field="inertia",
        ) from None


def check_inside(inertia: np.ndarray, mass: float, points: np.ndarray) -> None:
    """Raise `InvalidModelError` if no distribution of mass inside a shape has an inertia.

    Parameters
    ----------
    inertia : (3, 3) array
        About the centre of mass, axes of ``points`` [kg m^2].
    mass : float
        [kg]
    points : (n, 3) array
        Points whose convex hull contains the shape, from the centre of mass [m].

    Notes
    -----
    Mass within a reach R of the centre has moments of at most m R^2. Along a direction in which the shape
    extends from -a to b, the mean square of the distance from the centre is at most a b (Bhatia and Davis
    2000).
    """
    extent = float(np.ptp(points, axis=0).max())
    _, axes = np.linalg.eigh(inertia)
    directions = np.concatenate([np.eye(3), axes.T, even_directions(_DIRECTIONS)])
    heights = points @ directions.T
    high, low = heights.max(axis=0), -heights.min(axis=0)
    outside = float(np.maximum(-high, -low).max())
    if outside > _OUTSIDE * extent:
        raise InvalidModelError(f"the centre of mass lies {outside:.3g} m outside the shape", field="inertia")
    reach = float(np.linalg.norm(points, axis=1).max())
    most = mass * reach**2
    worst = int(np.diag(inertia).argmax())
    largest = float(np.linalg.eigvalsh(inertia)[-1])
    if largest > most * (1.0 + _SLACK):
        raise InvalidModelError(
            f"{_NAMES[worst]} is {inertia[worst, worst]:g} kg m^2, and the largest moment {largest:.3g}"
            f" kg m^2; {mass:g} kg inside the shape, within {reach:.3g} m of the centre of mass, have at most"
            f" {most:.3g} kg m^2",
            field="inertia",
        )
    spread = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    squares = np.einsum("ki,ij,kj->k", directions, spread, directions) / mass
    limits = np.maximum(high, 0.0) * np.maximum(low, 0.0)
    excess = squares - _SPREAD * limits - 1e-6 * reach**2
    if excess.max() > 0.0:
        k = int(excess.argmax())
        u = ", ".join(f"{x:.2g}" for x in directions[k] + 0.0)
        raise InvalidModelError(
            f"ixx, iyy and izz ({', '.join(f'{x:g}' for x in np.diag(inertia))} kg m^2) need mass"
            f" {np.sqrt(squares[k]):.3g} m off the centre along ({u}); inside the shape it is at most"
            f" {np.sqrt(limits[k]):.3g} m off (root mean square)",
            field="inertia",
        )


def unusual_inertia(inertia: np.ndarray, uniform: np.ndarray) -> str:
    """Return a note about moments far from those at uniform density; empty where there is none to make.

    Both matrices (3, 3) are about the centre of mass.
    """
    ratios = np.linalg.eigvals(np.linalg.solve(uniform, inertia)).real
    low, high = float(ratios.min()), float(ratios.max())
    if low >= _LOW and high <= _HIGH:
        return ""
    times = f"{low:.2g}" if high < 1.01 * low else f"{low:.2g} to {high:.2g}"
    return f"its moments of inertia are {times} times those of its shape at uniform density"
