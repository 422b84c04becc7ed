"""When contacts close faster than a threshold: impacts, at present and to come."""

import math

from ..collision.contact_row import FALL, GAP, RESTITUTION
from ..collision.contact_simd import contact_speeds
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner

#: Gap up to which bodies touch, and at which an impact is aimed [m].
TOUCHING, _AIM = 2e-5, 1e-5
_ALMOST = 0.9  # of the speed above which closing is an impact: what may have been one
#: Contacts that give back at least this share of their speed lose too little of it to come to rest soon: each
#: closing of theirs that is faster than a speed [m/s] is an impact, whatever the step.
LIVELY, _SLOWEST_LIVELY = 0.7, 1e-3


@inner(forceinline=True)
def impact_speed(restitution, threshold):
    """Closing speed above which a contact of that restitution has an impact [m/s]."""
    return min(threshold, _SLOWEST_LIVELY) if restitution >= LIVELY else threshold


@inner(error_model="numpy", forceinline=True)
def time_to_close(row, speed, threshold):
    """Time until an open contact of that normal speed closes faster than a threshold; infinite if never.

    The gap is a parabola, with gravity and the centripetal acceleration of the sphere's centre.
    """
    return time_after(row, row[GAP], speed, threshold)


@inner(error_model="numpy", forceinline=True)
def time_after(row, gap, speed, threshold):
    """As `time_to_close`, of a contact whose gap was another [m] when it had that speed."""
    way = gap - _AIM
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
        if row[GAP] <= TOUCHING and row[RESTITUTION] >= rebound:
            speed = contact_speeds(row, work.velocity[START], ids[c, 0], ids[c, 1])[0]
            if speed < -impact_speed(row[RESTITUTION], threshold):
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
            first = min(first, time_to_close(rows[c], speed, impact_speed(rows[c, RESTITUTION], threshold)))
    return first


@inner
def impact_before(h, threshold, work):
    """Time until a contact at hand may first have closed faster than a threshold, in ``h`` seconds of free
    motion that led to it; ``h`` without one, and 0 if one had closed when they began that is not open now.
    """
    first = h
    for c in range(work.counts[CONTACTS]):
        first = min(first, time_before(c, h, threshold, work))
    return first


@inner(error_model="numpy", forceinline=True)
def time_before(c, h, threshold, work):
    """The same time of contact ``c`` alone; infinite without one."""
    row = work.rows[c]
    fast = impact_speed(row[RESTITUTION], threshold)
    end = contact_speeds(row, work.velocity[FREE], work.ids[c, 0], work.ids[c, 1])[0]
    begin = end - h * row[FALL]
    gap = row[GAP] - 0.5 * h * (begin + end)
    if gap > 2.0 * TOUCHING:
        return time_after(row, gap, begin, _ALMOST * fast)
    return 0.0 if begin < -fast and row[GAP] <= 0.0 else math.inf
