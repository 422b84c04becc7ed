"""Coulomb's law of friction at a contact, tangential and about the normal, and which of its cases holds.

    tangential impulse:  |lambda_t| <= mu lambda_n, opposite to slip; no slip inside the cone
    moment:              |tau| <= r lambda_n, opposite to spin; no spin inside

The solver projects onto these sets, sleeping needs a reserve in them, and derivatives ask which case holds.
The coefficients mu and r of two partners are written with the contact (`collision.contact_patch`).
"""

import math

from ..collision.contact_model import FAST
from ..collision.contact_row import FRICTION, REACH
from ..collision.contact_simd import foreseen
from ..compiler import inner
from ..spatial.vectors import dot, minus, times

_AT_LIMIT = 1.0 - 1e-9  # share of the limit from which on a contact slides or spins
_NO_SLIP = 1e-12  # slower slip has no direction [m/s]


@inner(forceinline=True, fastmath=FAST)
def slip_limit(row, normal):
    """Return the largest tangential impulse with a ``normal`` one [N s]."""
    return row[FRICTION] * normal


@inner(forceinline=True, fastmath=FAST)
def spin_limit(twist, normal):
    """Return the largest moment about the normal with a ``normal`` impulse [N m s]."""
    return twist[REACH] * normal


@inner(forceinline=True, fastmath=FAST, error_model="numpy")
def within_slip_limit(first, second, limit):
    """Return the nearest tangential impulse that is at most ``limit`` [N s]."""
    square = first * first + second * second
    if square > limit * limit:
        foreseen()  # a root and a division, for which what sticks shall not wait
        share = limit / math.sqrt(square)
        first, second = first * share, second * share
    return first, second


@inner(forceinline=True, fastmath=FAST)
def within_spin_limit(moment, limit):
    """Return the nearest moment that is at most ``limit`` [N m s]."""
    return min(max(moment, -limit), limit)


@inner(forceinline=True)
def holds(row, impulse, share):
    """Return whether a contact's tangential impulse is below a share of its limit."""
    limit = share * row[FRICTION] * impulse[0]
    return impulse[1] * impulse[1] + impulse[2] * impulse[2] < limit * limit


@inner(forceinline=True)
def sticks(row, impulse):
    """Return whether a contact does not slide."""
    return holds(row, impulse, _AT_LIMIT)


@inner(forceinline=True, error_model="numpy")
def slip_derivative(row, normal, f_t, u_t, n, yielding):
    """Return the derivative of a contact's whole impulse.

    Parameters
    ----------
    row : array
        Of the contact.
    normal : float
        Its normal impulse [N s].
    f_t, u_t : tuple
        Its tangential impulse [N s], and the velocity of slip [m/s].
    n : tuple
        Its normal.
    yielding : float
        Velocity per impulse by which sticking gives way [m/(s N s)].

    Returns
    -------
    slides : bool
    pushed : tuple
        Derivative by the normal impulse.
    along : tuple
        Direction of slip; 0 where it does not slide.
    hold : float
        Impulse per velocity of slip, across ``along`` [N s s/m].
    """
    mu, limit = row[FRICTION], row[FRICTION] * normal
    size_t = math.sqrt(dot(f_t, f_t))
    if mu > 0.0 and size_t >= _AT_LIMIT * limit and dot(u_t, u_t) > _NO_SLIP * _NO_SLIP:
        along = times(-1.0 / size_t, f_t)
        return True, minus(n, times(mu, along)), along, limit / math.sqrt(dot(u_t, u_t))
    return False, n, (0.0, 0.0, 0.0), 1.0 / yielding if mu > 0.0 else 0.0


@inner(forceinline=True)
def spins(twist, normal, moment, spin):
    """Return whether a contact with a moment [N m s] and a spin [rad/s] about the normal spins."""
    return abs(moment) >= _AT_LIMIT * (twist[REACH] * normal) and abs(spin) * twist[REACH] > _NO_SLIP
