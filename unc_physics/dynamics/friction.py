"""Coulomb friction at a contact, tangential and about the normal, and its sticking and sliding cases.

    tangential impulse:  |lambda_t| <= mu lambda_n, opposite to slip; no slip inside the cone
    moment:              |tau| <= r lambda_n, opposite to spin; no spin inside

In an impact, mu falls with the closing speed v of the contact::

    mu(v) = mu / (1 + v / v0)

v0 is the speed of `Scene.impact_friction_speed`. Lasting contacts have mu itself, at any slip speed.

The solver projects onto these sets. Each contact stores mu and r of its two partners
(`collision.contact_patch`).

`holds`, `sticks`, `spins` and `slip_derivative` assume that a contact below its limit does not slip, as the
solver's complementarity implies. They do not look for slip. Sleep detection (`implicit_step`), the surrogate
and local sampling (`solved_contacts`), and `implicit_derivative` and `twist_derivative` rely on it.
"""

import math

from ..collision.contact_model import FAST
from ..collision.contact_row import FRICTION, REACH
from ..collision.contact_simd import contact_speeds, foreseen
from ..collision.implicit_workspace import CONTACTS, START
from ..compiler import inner
from ..spatial.vectors import dot, minus, times

_AT_LIMIT = 1.0 - 1e-9  # share of the limit above which a contact slides or spins
_NO_SLIP = 1e-12  # below this speed, slip has no direction [m/s]


@inner
def weaken_with_speed(slipperiness, work):
    """Reduce friction of the current impact's contacts to that of their closing speeds.

    ``slipperiness`` is 1 / v0 [s/m].
    """
    for c in range(work.counts[CONTACTS]):
        row = work.rows[c]
        speed = contact_speeds(row, work.velocity[START], work.ids[c, 0], work.ids[c, 1])[0]
        row[FRICTION] /= 1.0 + slipperiness * max(-speed, 0.0)


@inner(forceinline=True, fastmath=FAST)
def slip_limit(row, normal):
    """Return the largest tangential impulse for a normal impulse ``normal`` [N s]."""
    return row[FRICTION] * normal


@inner(forceinline=True)
def slip_limit_per_impulse(row, normal):
    """Return the derivative of `slip_limit` with respect to the normal impulse."""
    return row[FRICTION]


@inner(forceinline=True)
def slip_limit_per_speed(row, normal, speed, slipperiness):
    """Return the derivative of an impact's `slip_limit` with respect to the contact's normal speed [kg].

    ``row`` has the friction of this normal ``speed`` [m/s], which is negative for a closing contact.
    """
    if speed >= 0.0:
        return 0.0
    return normal * (row[FRICTION] * slipperiness / (1.0 - slipperiness * speed))


@inner(forceinline=True, fastmath=FAST)
def spin_limit(torsion, normal):
    """Return the largest moment about the normal for a normal impulse ``normal`` [N m s]."""
    return torsion[REACH] * normal


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def within_slip_limit(first, second, limit):
    """Project a tangential impulse onto the disc of radius ``limit`` [N s]."""
    square = first * first + second * second
    if square > limit * limit:
        foreseen()  # skips a square root and a division for sticking contacts
        share = limit / math.sqrt(square)
        first, second = first * share, second * share
    return first, second


@inner(forceinline=True, fastmath=FAST)
def within_spin_limit(moment, limit):
    """Clamp a moment to ``limit`` [N m s]."""
    return min(max(moment, -limit), limit)


@inner(forceinline=True)
def holds(row, impulse, share):
    """Return whether a contact's tangential impulse is below a share of its limit."""
    limit = share * slip_limit(row, impulse[0])
    return impulse[1] * impulse[1] + impulse[2] * impulse[2] < limit * limit


@inner(forceinline=True)
def sticks(row, impulse):
    """Return whether a contact does not slide."""
    return holds(row, impulse, _AT_LIMIT)


@inner(forceinline=True, error_model="numpy")
def slip_derivative(row, normal, f_t, u_t, n, yielding):
    """Return the derivative of a contact's impulse vector.

    Parameters
    ----------
    row : array
        Row of the contact.
    normal : float
        Normal impulse [N s].
    f_t, u_t : tuple
        Tangential impulse [N s] and slip velocity [m/s].
    n : tuple
        Contact normal.
    yielding : float
        Slip velocity per tangential impulse of a sticking contact [m/(s N s)].

    Returns
    -------
    slides : bool
    pushed : tuple
        Derivative with respect to the normal impulse.
    along : tuple
        Direction of the friction impulse; 0 for a sticking contact.
    hold : float
        Impulse per slip velocity, across ``along`` [N s s/m].
    """
    limit = slip_limit(row, normal)
    has_friction = row[FRICTION] > 0.0
    size_t = math.sqrt(dot(f_t, f_t))
    if has_friction and size_t >= _AT_LIMIT * limit and dot(u_t, u_t) > _NO_SLIP * _NO_SLIP:
        along = times(-1.0 / size_t, f_t)
        pushed = minus(n, times(slip_limit_per_impulse(row, normal), along))
        return True, pushed, along, limit / math.sqrt(dot(u_t, u_t))
    return False, n, (0.0, 0.0, 0.0), 1.0 / yielding if has_friction else 0.0


@inner(forceinline=True)
def spins(torsion, normal, moment, spin):
    """Return whether a contact spins, given its moment [N m s] and spin [rad/s] about the normal."""
    return abs(moment) >= _AT_LIMIT * spin_limit(torsion, normal) and abs(spin) * torsion[REACH] > _NO_SLIP
