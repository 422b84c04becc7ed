"""Twin of the contact of two spheres."""

import numpy as np


def lens_volume(d, ri, rj):
    """Volume that two balls of radii ri, rj share, their centres d apart: two spherical caps on one plane."""
    d, ri, rj = np.broadcast_arrays(*(np.asarray(a, float) for a in (d, ri, rj)))
    inside = d <= np.abs(ri - rj)
    safe = np.where(inside, 1.0, d)
    plane = (safe**2 + ri**2 - rj**2) / (2.0 * safe)  # of the circle of intersection, from centre i
    caps = cap_volume(ri, ri - plane) + cap_volume(rj, rj - (safe - plane))
    volume = np.where(inside, 4.0 / 3.0 * np.pi * np.minimum(ri, rj) ** 3, caps)
    return np.where(d < ri + rj, volume, 0.0)


def cap_volume(r, height):
    """Volume of a ball's cap."""
    return np.pi * height**2 * (3.0 * r - height) / 3.0


def lever(d, ri, rj):
    """Contact point from centre i towards centre j: the middle of what both balls cover of the line."""
    return 0.5 * (np.maximum(d - rj, -ri) + np.minimum(ri, d + rj))


def sphere_contacts(ci, ri, cj, rj):
    """All pairs of two sets of spheres, centres (..., n, 3) and (..., m, 3) in one frame.

    Returns V n (..., n, m, 3), n from i to j, and the contact points (..., n, m, 3).
    """
    D = cj[..., None, :, :] - ci[..., :, None, :]
    d = np.linalg.norm(D, axis=-1)
    ri, rj = ri[:, None], rj[None, :]
    normal = np.divide(D, d[..., None], out=np.zeros_like(D), where=d[..., None] > 0.0)
    force = lens_volume(d, ri, rj)[..., None] * normal
    point = ci[..., :, None, :] + lever(d, ri, rj)[..., None] * normal
    return force, point
