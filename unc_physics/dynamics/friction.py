"""Coulomb friction at a contact, tangential and about the normal, and its sticking and sliding cases.

    tangential impulse:  |lambda_t| <= mu lambda_n, opposite to slip; no slip inside the cone
    moment:              |tau| <= r lambda_n, opposite to spin; no spin inside

In an impact, mu falls with the closing speed v of the contact::

    mu(v) = mu / (1 + v / v0)

v0 is the speed of `Scene.impact_friction_speed`. Lasting contacts have mu itself, at any slip speed.

The solver projects onto these sets. Each contact stores mu and r of its two partners
(`collision.contact_patch`).

`holds` and `sticks` assume that a contact below its limit does not slip, as the solver's complementarity
implies. They do not look for slip. Sleep detection (`implicit_step`), and the surrogate and local sampling
(`solved_contacts`) rely on it.
"""

import math

from ..collision.contact_model import FAST
from ..collision.contact_row import FRICTION, REACH
from ..collision.contact_simd import contact_speeds, foreseen
from ..collision.implicit_workspace import CONTACTS, START
from ..compiler import inner

_AT_LIMIT = 1.0 - 1e-9  # share of the limit above which a contact slides


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
