"""When contacts close faster than a threshold: impacts, at present and to come."""

import math

from .compiled import inner
from .contact_row import FALL, GAP, RESTITUTION
from .contact_simd import contact_speeds
from .implicit_workspace import CONTACTS, START

#: Gap up to which bodies touch, and at which an impact is aimed [m].
_TOUCHING, _AIM = 2e-5, 1e-5


@inner(error_model="numpy", forceinline=True)
def time_to_close(row, speed, threshold):
    """Time until an open contact of that normal speed closes faster than a threshold; infinite if never.

    The gap is a parabola, with gravity and the centripetal acceleration of the sphere's centre.
    """
    way = row[GAP] - _AIM
    square = speed * speed - 2.0 * row[FALL] * way
    if way <= 0.0 or square <= threshold * threshold:
        return math.inf
    root = math.sqrt(square)
    return 2.0 * way / (root - speed) if root - speed > 0.0 else math.inf


@inner
def impact_now(threshold, rebound, work):
    """Whether a contact at hand that touches closes fast, with a restitution of at least ``rebound``."""
    rows, ids = work.rows, work.ids
    for c in range(work.counts[CONTACTS]):
        row = rows[c]
        if row[GAP] <= _TOUCHING and row[RESTITUTION] >= rebound:
            if contact_speeds(row, work.velocity[START], ids[c, 0], ids[c, 1])[0] < -threshold:
                return True
    return False


@inner(error_model="numpy")
def time_to_impact(left, threshold, rebound, work):
    """Time until the first impact of contacts at hand, with a restitution of at least ``rebound``, within
    ``left`` seconds; ``left`` without one.
    """
    rows, ids, first = work.rows, work.ids, left
    for c in range(work.counts[CONTACTS]):
        if rows[c, RESTITUTION] >= rebound:
            speed = contact_speeds(rows[c], work.velocity[START], ids[c, 0], ids[c, 1])[0]
            first = min(first, time_to_close(rows[c], speed, threshold))
    return first
