"""The contact model: how much two shapes overlap at a depth, and what the penalty force makes of it.

The force is ``kappa V``, V being the volume of the overlap (the paper's Eq. 4): the explicit step's law is
what `lens` and `cap` return. Two spheres that overlap little, of reduced radius ``R = ri rj / (ri + rj)``, or
a sphere and a flat surface, R being the sphere's radius, share a volume of about ``pi R d^2`` at depth d.
That is the law of lasting contacts and of the chosen stiffness; all that follows from it is here.
"""

import math

from ..compiler import inner, kernel

#: What the implicit solver's arithmetic may do.
FAST = {"contract", "nsz"}


@kernel(arrays=False, error_model="numpy")
def lens(d, ri, rj):
    """Overlap of two spheres of radii ``ri``, ``rj`` [m] whose centres are ``d`` apart.

    Returns
    -------
    volume : float
        Of the lens [m^3]; the whole smaller sphere when it lies inside the other; 0 without overlap.
    lever : float
        Contact point on the line of centres, measured from the first centre towards the second [m]: the
        middle of the interval in which the spheres overlap.
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
    """The lever of `lens` [m], and its derivative by the distance."""
    low, high = max(d - rj, -ri), min(ri, d + rj)
    return 0.5 * (low + high), 0.5 * ((d - rj > -ri) + (d + rj < ri))


@kernel(arrays=False, error_model="numpy")
def cap(distance, r):
    """What a sphere of radius ``r`` [m] at a signed distance from a flat surface shares with the solid.

    Returns
    -------
    volume : float
        Of the spherical cap [m^3]; the whole sphere when it is under the surface.
    depth : float
        Height of the cap [m], 0 to 2 r.
    """
    depth = min(max(r - distance, 0.0), 2.0 * r)
    return math.pi * depth * depth * (3.0 * r - depth) / 3.0, depth


def shallow_volume(R, d):
    """Volume of a shallow overlap [m^3]: times the stiffness, the force."""
    return math.pi * R * d**2


@kernel(arrays=False)
def shallow_slope(R, d):
    """Growth of a shallow overlap's volume with depth [m^2]: times the stiffness, that of the contact."""
    return 2.0 * math.pi * R * d


@kernel(arrays=False)
def shallow_energy(R, d):
    """A shallow overlap's volume, integrated over depth [m^4]: times the stiffness, its energy."""
    return math.pi * R * d**3 / 3.0


@inner(forceinline=True, error_model="numpy")
def reduced_radius(ri, rj):
    """Radius of the sphere that overlaps a flat surface as two spheres overlap each other [m]."""
    return ri * rj / (ri + rj)


@inner(forceinline=True)
def shallow_factor(stiffness):
    """What the functions below take for the stiffness: what is the same for all contacts, once."""
    return math.pi * stiffness


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def shallow_depth(force, R, factor):
    """Depth at which a contact pushes with a force [m]."""
    return math.sqrt(force / (factor * R))


@inner(forceinline=True)
def balance(h, way, R, factor):
    """What `balanced_impulse` takes, of a contact that an impulse of 1 N s pushes back ``way`` metres, over
    an interval ``h`` [s].
    """
    strength = 4.0 * h * factor * R
    return way * strength, strength


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def balanced_impulse(free, growth, strength):
    """Impulse of a contact whose depth would be ``free`` > 0 without it: ``lambda = h force(d)`` at depth
    ``d = free - way lambda`` [N s].
    """
    share = free / (1.0 + math.sqrt(1.0 + growth * free))
    return strength * share * share


def carrying_stiffness(force, R, d):
    """Stiffness at which a contact carries a force at depth ``d`` [N/m^3]."""
    return force / shallow_volume(R, d)


def stopping_stiffness(mass, v2, R, d):
    """Stiffness at which a contact takes up ``mass v2 / 2`` until depth ``d`` [N/m^3] (`shallow_energy`)."""
    return 1.5 * mass * v2 / (math.pi * R * d**3)


@kernel(arrays=False)
def impact_depth(v, inverse_mass, R, stiffness):
    """Depth at which a contact has taken up the whole energy of an impact at speed ``v`` [m].

    ``inverse_mass`` [1/kg] is the sum of both bodies'.
    """
    if v == 0.0 or stiffness == 0.0:
        return 0.0
    return (0.5 * v * v / (inverse_mass * stiffness * shallow_energy(R, 1.0))) ** (1.0 / 3.0)


@kernel(arrays=False)
def impact_frequency(v, inverse_mass, R, stiffness):
    """Highest frequency of a contact in an impact at speed ``v`` [1/s]: that at `impact_depth`."""
    return math.sqrt(stiffness * shallow_slope(R, impact_depth(v, inverse_mass, R, stiffness)) * inverse_mass)


def capacity(r, stiffness):
    """About the energy that two spheres of radius ``r`` [m] take up before one passes the other [J]."""
    return math.pi * stiffness * r**4
