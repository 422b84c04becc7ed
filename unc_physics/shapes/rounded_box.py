"""A box with rounded edges and corners: spheres in its corners, on its edges and on its faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidModelError
from ..checks.validation import array
from .packing_file import SpherePacking
from .pieces import box

_BALL, _SINK = 0.010, 0.002  # m: a ball of this radius sinks so far in between spheres, at most
_MOST = 2000  # spheres, about
_CORE = 1e-6  # share of the shortest half side that the core of the piece keeps, as a hull needs a volume
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def rounded_box(
    size: ArrayLike, radius: float, name: str = "rounded_box", mass: float | None = None
) -> SpherePacking:
    """Return the packing of a solid box with rounded edges and corners; the corners are its first spheres.

    The hull of the first eight spheres is the rounded box, so on planes, on sides of boxes, and on flat faces
    of convex bodies, ``rounded_box(...).prefix(8)`` lies, tips and rolls over its edges as the solid does.
    The others lie along the edges and faces, and carry bodies of other shapes: a ball of 10 mm sinks in by at
    most 2 mm between them, if the edges' radius is at most 5 mm and the sides at most 20 cm. Elsewhere the
    gaps are larger: pack `household_meshes.rounded_box` there.

    Parameters
    ----------
    size : (3,) array_like or float
        Sides [m]; one number stands for a cube's.
    radius : float
        Of edges and corners [m].
    name : str
    mass : float, optional
        [kg]

    Raises
    ------
    InvalidModelError
        If a side is not positive, or the radius is not between 0 and half the shortest side.
    """
    sides = array(np.broadcast_to(size, (3,)) if np.ndim(size) == 0 else size, (3,), "size")
    if not np.all(sides > 0.0):
        raise InvalidModelError("must be positive", field="size", value=sides.tolist())
    if not 0.0 < radius <= 0.5 * sides.min():
        raise InvalidModelError(
            f"must be above 0 and at most half the shortest side, {0.5 * sides.min():.6g}",
            field="radius",
            value=radius,
        )
    half = 0.5 * sides
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    volume, squares = _moments(half - radius, radius)
    rounding = min(radius, (1.0 - _CORE) * float(half.min()))
    centers = np.concatenate([(half - radius) * corners, _between(half - radius, radius)])
    return SpherePacking(
        name,
        centers,
        np.full(len(centers), float(radius)),
        inertia=np.diag(squares.sum() - squares),
        volume=volume,
        origin=np.zeros(3),
        bounding_radius=float(np.linalg.norm(half - radius) + radius) * (1.0 + 1e-12),
        mass=mass,
        bounds=corners[[0, -1]] * half,
        measured_spheres=np.unique([8, len(centers)]),
        extent_losses=np.zeros(len({8, len(centers)})),
        pieces=(box(2.0 * (half - rounding), rounding=rounding),),
    )


def _between(core, radius):
    """Return centres (n, 3) on a grid over a box's surface, of half sides ``core``, without its corners."""
    reach = _BALL + radius
    wanted = np.sqrt(2.0 * _SINK * (2.0 * reach - _SINK))  # between spheres of a square
    area = 8.0 * (core[0] * core[1] + core[1] * core[2] + core[2] * core[0])
    wanted = max(wanted, np.sqrt(area / _MOST))
    counts = np.minimum(np.ceil(2.0 * core / wanted), np.floor(core / radius * (1.0 + 1e-9))).astype(int)
    axes = [np.linspace(-c, c, max(1, n) + 1) for c, n in zip(core, counts, strict=True)]
    ends = [np.isin(np.arange(len(axis)), (0, len(axis) - 1)) for axis in axes]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    outer = np.sum(np.meshgrid(*ends, indexing="ij"), axis=0).reshape(-1)
    return points[(outer == 1) | (outer == 2)] if (core >= radius).all() else np.empty((0, 3))


def _moments(core, radius):
    """Return volume and mean squared coordinates (3,) of a box of half sides ``core`` grown by a radius."""
    # slices across an axis: whole over the core, smaller beyond; with s = r sin(phi) all is smooth
    phi = 0.25 * np.pi * (1.0 + _NODES)
    beyond, small = radius * np.sin(phi), radius * np.cos(phi)
    steps = 0.25 * np.pi * _WEIGHTS * small
    volume, squares = 0.0, np.zeros(3)
    for axis in range(3):
        a, (b, c) = core[axis], np.delete(core, axis)

        def slice_area(r, b=b, c=c):
            return 4.0 * b * c + 4.0 * (b + c) * r + np.pi * r**2

        volume = 2.0 * a * slice_area(radius) + 2.0 * steps @ slice_area(small)
        squares[axis] = 2.0 / 3.0 * a**3 * slice_area(radius)
        squares[axis] += 2.0 * steps @ ((a + beyond) ** 2 * slice_area(small))
    return float(volume), squares / volume
