"""Contact model: overlap volume of two shapes, and the penalty force.

The force is ``kappa V``, where V is the overlap volume (the paper's Eq. 4). The explicit step takes V from
`lens` and `cap`. A shallow overlap of depth d has a volume of about ``pi R d^2``. R is the reduced radius
``ri rj / (ri + rj)`` of two spheres, or a sphere's radius at a flat surface. The choice of stiffness uses
this law.
"""

import math

from ...compiler import inner, kernel


@kernel(arrays=False, error_model="numpy")
def lens(d, ri, rj):
    """Compute the overlap of two spheres of radii ``ri``, ``rj`` [m] with centres ``d`` apart.

    Returns
    -------
    volume : float
        Volume of the lens [m^3]; the whole smaller sphere if it lies inside the other; 0 without overlap.
    lever : float
        Distance of the contact point from the first centre on the line of centres [m]: the middle of the
        interval in which the spheres overlap.
    """
    if d >= ri + rj:
        return 0.0, 0.0
    if d <= abs(ri - rj):
        volume = 4.0 / 3.0 * math.pi * min(ri, rj) ** 3
    else:
        s = ri + rj - d
        volume = math.pi * s * s * (d * d + 2.0 * d * (ri + rj) - 3.0 * (ri - rj) ** 2) / (12.0 * d)
    return volume, 0.5 * (max(d - rj, -ri) + min(ri, d + rj))


@inner
def lens_lever(d, ri, rj):
    """Return the lever of `lens` [m] and its derivative with respect to the distance."""
    low, high = max(d - rj, -ri), min(ri, d + rj)
    return 0.5 * (low + high), 0.5 * ((d - rj > -ri) + (d + rj < ri))


@kernel(arrays=False, error_model="numpy")
def cap(distance, r):
    """Compute the overlap of a sphere of radius ``r`` [m] with a flat solid at a signed distance.

    Returns
    -------
    volume : float
        Volume of the spherical cap [m^3]; the whole sphere if it is below the surface.
    depth : float
        Height of the cap [m], 0 to 2 r.
    """
    depth = min(max(r - distance, 0.0), 2.0 * r)
    return math.pi * depth * depth * (3.0 * r - depth) / 3.0, depth


def shallow_volume(R, d):
    """Return the volume of a shallow overlap [m^3]; the force is this times the stiffness."""
    return math.pi * R * d**2


def carrying_stiffness(force, R, d):
    """Return the stiffness at which a contact carries a force at depth ``d`` [N/m^3]."""
    return force / shallow_volume(R, d)


def stopping_stiffness(mass, v2, R, d):
    """Return the stiffness at which a contact absorbs ``mass v2 / 2`` until depth ``d`` [N/m^3]."""
    return 1.5 * mass * v2 / (math.pi * R * d**3)


def capacity(r, stiffness):
    """Estimate the energy that two spheres of radius ``r`` [m] absorb before one passes the other [J]."""
    return math.pi * stiffness * r**4
