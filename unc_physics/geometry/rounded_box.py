"""A box with rounded edges and corners by the few spheres that touch what is flat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidModelError
from ..checks.validation import array
from .packing_file import SpherePacking

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def rounded_box(
    size: ArrayLike, radius: float, name: str = "rounded_box", mass: float | None = None
) -> SpherePacking:
    """A solid box whose edges and corners are rounded: eight spheres, one in each corner.

    Their hull is the rounded box, so on planes, and on the flat sides of larger boxes, it lies, tips and
    rolls over its edges as the solid does. What is smaller than it, such as another body, can pass between
    the spheres: pack `shapes.rounded_box` for that.

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
    return SpherePacking(
        name,
        (half - radius) * corners,
        np.full(8, float(radius)),
        inertia=np.diag(squares.sum() - squares),
        volume=volume,
        origin=np.zeros(3),
        bounding_radius=float(np.linalg.norm(half - radius) + radius) * (1.0 + 1e-12),
        mass=mass,
        bounds=corners[[0, -1]] * half,
    )


def _moments(core, radius):
    """Volume and mean squares (3,) of coordinates, of a box of half sides ``core`` grown by a radius."""
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
