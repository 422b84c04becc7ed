"""Times of impacts: contacts that close faster than a threshold."""

import math

from ..collision.contact_row import FALL, GAP, RESTITUTION
from ..collision.contact_simd import contact_speeds
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner

#: Gap below which bodies touch, and target gap of the time of an impact [m].
TOUCHING, _AIM = 2e-5, 1e-5
_ALMOST = 0.9  # share of the impact speed above which a closing contact may have been an impact
#: Contacts with at least this restitution lose too little speed to come to rest soon. Each closing of theirs
#: above a speed [m/s] is an impact, independent of the step.
LIVELY, _SLOWEST_LIVELY = 0.7, 1e-3


@inner(forceinline=True)
def impact_speed(restitution, threshold):
    """Return the closing speed above which a contact with this restitution has an impact [m/s]."""
    return min(threshold, _SLOWEST_LIVELY) if restitution >= LIVELY else threshold


@inner(error_model="numpy", forceinline=True)
def time_to_close(row, speed, threshold):
    """Return the time until an open contact closes faster than a threshold; infinite if never.

    The gap is a parabola in time, from gravity and the centripetal acceleration of the sphere's centre.
    """
    return time_after(row, row[GAP], speed, threshold)


@inner(error_model="numpy", forceinline=True)
def time_after(row, gap, speed, threshold):
    """Return `time_to_close` for a contact that had this ``gap`` [m] at this speed."""
    way = gap - _AIM
    square = speed * speed - 2.0 * row[FALL] * way
    if way <= 0.0 or square <= threshold * threshold:
        return math.inf
    root = math.sqrt(square)
    return 2.0 * way / (root - speed) if root - speed > 0.0 else math.inf


@inner
def impact_now(threshold, rebound, work):
    """Return whether a touching contact closes fast, with a restitution of at least ``rebound``."""
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
    """Return the time until the first impact of a current contact with a restitution of at least ``rebound``.

    Without an impact within ``left`` seconds, return ``left``.
    """
    rows, ids, first = work.rows, work.ids, left
    for c in range(work.counts[CONTACTS]):
        if rows[c, RESTITUTION] >= rebound:
            speed = contact_speeds(rows[c], work.velocity[START], ids[c, 0], ids[c, 1])[0]
            first = min(first, time_to_close(rows[c], speed, impact_speed(rows[c, RESTITUTION], threshold)))
    return first


@inner
def impact_before(h, threshold, work):
    """Return the time of the first possible impact of a current contact in the past ``h`` seconds.

    The motion was free. Without an impact, return ``h``. Return 0 if a contact was already closing at the
    beginning and is closed now.
    """
    first = h
    for c in range(work.counts[CONTACTS]):
        first = min(first, time_before(c, h, threshold, work))
    return first


@inner(error_model="numpy", forceinline=True)
def time_before(c, h, threshold, work):
    """Return `impact_before` for contact ``c`` alone; infinite without an impact."""
    row = work.rows[c]
    fast = impact_speed(row[RESTITUTION], threshold)
    end = contact_speeds(row, work.velocity[FREE], work.ids[c, 0], work.ids[c, 1])[0]
    begin = end - h * row[FALL]
    gap = row[GAP] - 0.5 * h * (begin + end)
    if gap > 2.0 * TOUCHING:
        return time_after(row, gap, begin, _ALMOST * fast)
    return 0.0 if begin < -fast and row[GAP] <= 0.0 else math.inf
