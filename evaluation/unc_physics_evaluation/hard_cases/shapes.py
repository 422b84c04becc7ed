"""Bodies of the hard cases that the model library has not: a ball, and a rod with an inertia ratio of 1000.

``python -m unc_physics_evaluation.hard_cases.shapes`` writes their ``.npz`` files again.
"""

from __future__ import annotations

import numpy as np

from unc_physics.shapes.packing_file import SpherePacking, save_packing

from . import FOLDER

ROD_SPHERES = 35  # touching in a row: inertia about an axis across is 1021 times that about the row


def ball() -> SpherePacking:
    """One sphere of radius 1 m, a homogeneous solid."""
    return _spheres("ball", np.zeros((1, 3)), 1.0)


def rod() -> SpherePacking:
    """Spheres in a row along z, 1 m long."""
    radius = 0.5 / ROD_SPHERES
    centers = np.zeros((ROD_SPHERES, 3))
    centers[:, 2] = radius * (2.0 * np.arange(ROD_SPHERES) - ROD_SPHERES + 1.0)
    return _spheres("rod", centers, radius)


def _spheres(name, centers, radius):
    """Equal spheres, homogeneous and disjoint, about their centre of mass."""
    count = len(centers)
    inertia = (
        0.4 * radius**2 * np.eye(3) + np.mean(np.sum(centers**2, 1)) * np.eye(3) - centers.T @ centers / count
    )
    return SpherePacking(
        name=name,
        centers=centers,
        radii=np.full(count, radius),
        inertia=inertia,
        volume=count * 4.0 / 3.0 * np.pi * radius**3,
        origin=np.zeros(3),
        bounding_radius=float(np.linalg.norm(centers, axis=1).max()) + radius,
    )


SHAPES = (ball, rod)

if __name__ == "__main__":
    for make in SHAPES:
        save_packing(FOLDER / f"{make.__name__}.npz", make())
