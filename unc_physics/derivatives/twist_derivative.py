"""Derivative of what else acts at a contact: the moment that opposes its spin, and a surface that moves.

With tau the moment about the normal, and sigma the spin ``n . (w_i - w_j)`` after the solution:

    where it turns:      d tau = (tau / lambda_n) d lambda_n
    where it does not:   d sigma = 0, a constraint
"""

from typing import NamedTuple

from ..collision.contact_row import SPIN_COMPLIANCE
from ..compiler import inner
from ..dynamics.friction import spin_limit, spins
from ..spatial.rotation import cross
from ..spatial.vectors import dot, plus, times


class Twist(NamedTuple):
    """What opposes the spin of a contact.

    Attributes
    ----------
    moment : float
        As solved [N m s].
    share : float
        Of its change in that of the normal impulse [m]; 0 where nothing turns.
    hold : float
        Of its change in that of the spin [N m s^2]; 0 where it turns.
    spinning : tuple
        The relative angular velocity.
    """

    moment: float
    share: float
    hold: float
    spinning: tuple


@inner(forceinline=True)
def no_twist():
    """The one of a contact that has none."""
    return Twist(0.0, 0.0, 0.0, (0.0, 0.0, 0.0))


@inner(error_model="numpy")
def twist_of(twist, own, n, w, yielding):
    """The `Twist` of a contact with impulses ``own`` whose bodies turn by ``w`` against each other.

    ``yielding`` is the share by which a constraint gives way.
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
    """Add what both bodies' velocities change of the moment to the linear system; ``give`` is what a normal
    speed takes from the normal impulse.
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
    """Change of the moment (world axes), but for what the system's unknowns do of it.

    The normal changes by ``dn``, its impulse by ``push``, and the partner's angular velocity by ``turned``.
    """
    size = twist.share * push - twist.hold * (dot(dn, twist.spinning) - dot(n, turned))
    return plus(times(size, n), times(twist.moment, dn))


@inner(forceinline=True)
def surface_velocity(surface, position, arm):
    """Velocity of a moving surface at a point of it [m/s]."""
    turning = (surface[3], surface[4], surface[5])
    return plus((surface[0], surface[1], surface[2]), cross(turning, plus(position, arm)))


@inner(forceinline=True)
def surface_change(surface, moved):
    """How that velocity changes when the point moves."""
    return cross((surface[3], surface[4], surface[5]), moved)
