"""Derivative of other contact effects: torsional friction, and moving surfaces.

With the moment tau about the normal, and the spin sigma = ``n . (w_i - w_j)`` after the solution:

    spinning:      d tau = (tau / lambda_n) d lambda_n
    not spinning:  d sigma = 0, a constraint
"""

from typing import NamedTuple

from ..collision.contact_row import SPIN_COMPLIANCE
from ..compiler import inner
from ..dynamics.friction import spin_limit, spins
from ..spatial.rotation import cross
from ..spatial.vectors import dot, plus, times


class Twist(NamedTuple):
    """Torsional friction of a contact.

    Attributes
    ----------
    moment : float
        Moment of the solution [N m s].
    share : float
        Change of the moment per change of normal impulse [m]; 0 if the contact does not spin.
    hold : float
        Change of the moment per change of spin [N m s^2]; 0 if the contact spins.
    spinning : tuple
        Relative angular velocity.
    """

    moment: float
    share: float
    hold: float
    spinning: tuple


@inner(forceinline=True)
def no_twist():
    """Return the `Twist` of a contact without torsional friction."""
    return Twist(0.0, 0.0, 0.0, (0.0, 0.0, 0.0))


@inner(error_model="numpy")
def twist_of(twist, own, n, w, yielding):
    """Return the `Twist` of a contact with impulses ``own`` and relative angular velocity ``w``.

    ``yielding`` is the relative compliance of a constraint.
    """
    share = hold = 0.0
    if spin_limit(twist, own[0]) > 0.0:
        if spins(twist, own[0], own[3], dot(n, w)):
            share = own[3] / own[0]
        else:
            hold = 1.0 / (yielding * twist[SPIN_COMPLIANCE])
    return Twist(own[3], share, hold, w)


@inner
def add_twist(twist, n, give, arm_i, arm_j, slot_i, slot_j, A):
    """Add the change of the moment with both bodies' velocities to the linear system.

    ``give`` is the reduction of the normal impulse per normal speed.
    """
    turn_i, turn_j = cross(arm_i, n), cross(arm_j, n)
    pushed = twist.share * give
    for side in range(2):
        place, sign = (slot_i, 1.0) if side == 0 else (slot_j, -1.0)
        if place < 0:
            continue
        for r in range(3):
            for m in range(3):
                along, hold = sign * pushed * n[r], sign * twist.hold * n[r] * n[m]
                A[place + 3 + r, slot_i + m] += along * n[m]
                A[place + 3 + r, slot_i + 3 + m] += along * turn_i[m] + hold
                if slot_j >= 0:
                    A[place + 3 + r, slot_j + m] -= along * n[m]
                    A[place + 3 + r, slot_j + 3 + m] -= along * turn_j[m] + hold


@inner(forceinline=True)
def twist_change(twist, n, dn, push, turned):
    """Return the change of the moment (world axes) except for the part of the system's unknowns.

    The normal changes by ``dn``, its impulse by ``push``, and the partner's angular velocity by ``turned``.
    """
    size = twist.share * push - twist.hold * (dot(dn, twist.spinning) - dot(n, turned))
    return plus(times(size, n), times(twist.moment, dn))


@inner(forceinline=True)
def surface_velocity(surface, position, arm):
    """Return the velocity of a moving surface at a point on it [m/s]."""
    turning = (surface[3], surface[4], surface[5])
    return plus((surface[0], surface[1], surface[2]), cross(turning, plus(position, arm)))


@inner(forceinline=True)
def surface_change(surface, moved):
    """Return the change of the surface velocity when the point moves."""
    return cross((surface[3], surface[4], surface[5]), moved)
