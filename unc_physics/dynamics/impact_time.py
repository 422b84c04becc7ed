"""Times of impacts: contacts that close faster than a threshold."""

import math

from ..collision.contact_row import DIRECTION, FALL, GAP, RESTITUTION, ROLL_RADIUS
from ..collision.contact_simd import contact_speeds
from ..collision.face_outlines import FACING
from ..collision.faces import FACES_OF_A_SPHERE
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner
from ..spatial.rotation import cross, rotate, rotate_back
from ..spatial.vectors import dot, minus, plus, three, times, triple

#: Gap below which bodies touch, and target gap of the time of an impact [m].
TOUCHING, _AIM = 2e-5, 1e-5
_ALMOST = 0.9  # share of the impact speed above which a closing contact may have been an impact
#: Contacts with at least this restitution lose too little speed to come to rest soon. Each closing of theirs
#: above a speed [m/s] is an impact, independent of the step.
LIVELY, _SLOWEST_LIVELY = 0.7, 1e-3
#: Way that an edge that lands closes in a step, above which it has an impact [m]: about the depth at which
#: contacts rest. Then its least lever arm about contacts that carry load, relative to the body's radius.
#: Bumps of a rolling body have shorter ones. Corners of a face with few corners, on which no body rolls,
#: land at shorter ones, too.
_LANDING, _APART, _CORNERS_APART, _FEW_CORNERS = 8e-5, 0.3, 0.2, 8
_DEEP = 0.01  # depth that contacts may reach without an impact, relative to the smaller body's radius


@inner(forceinline=True)
def impact_speed(restitution, threshold):
    """Return the closing speed above which a contact with this restitution has an impact [m/s]."""
    return min(threshold, _SLOWEST_LIVELY) if restitution >= LIVELY else threshold


@inner(forceinline=True)
def landing_speed(dt, threshold):
    """Return the closing speed above which an edge that lands has an impact [m/s]."""
    return min(threshold, _LANDING / dt)


@inner(forceinline=True)
def may_land(i, work):
    """Return whether edges of body ``i`` may land: it is alone in its group and carried load."""
    return work.head[i] >= 0 and work.group[i] == i and work.next_member[i] < 0


@inner
def _is_corner(s, faces):
    """Return whether sphere ``s`` belongs to a solid face whose outline has few corners."""
    for k in range(FACES_OF_A_SPHERE):
        f = faces.of_sphere[s, k]
        if f >= 0 and 0 < faces.corners[f] <= _FEW_CORNERS:
            return True
    return False


@inner(noinline=True)
def _lands(c, world, work):
    """Return whether contact ``c`` lands on an element, as the body turns about all contacts that carry load.

    These are the last step's contacts with the same element. Surfaces of packings are uneven, so bodies land
    on each other without such impacts. In groups of bodies, as in piles, they would cost much time.
    """
    i, j, s = work.ids[c, 0], work.ids[c, 1], work.ids[c, 2]
    if j >= 0 or not may_land(i, work):
        return False
    row, centers, stands = work.rows[c], world.tree.centers, False
    level = cross(triple(row, DIRECTION), triple(work.velocity[START, i], 3))  # as long as the level turn
    apart = _CORNERS_APART if _is_corner(s, world.implicit.faces) else _APART
    least = apart * row[ROLL_RADIUS] * math.sqrt(dot(level, level))
    across = rotate_back(work.R[i], level[0], level[1], level[2])
    entry = work.head[i]
    while entry >= 0:
        if work.old_contact[entry, 1] == j:
            t = work.old_contact[entry, 2]
            if dot(across, minus(three(centers, t, 0), three(centers, s, 0))) < least:
                return False
            stands = True
        entry = work.link[entry]
    return stands


@inner
def speed_before(c, which, h, threshold, world, work):
    """Return the normal speed that decides on an impact of contact ``c``, ``h`` seconds before now [m/s].

    Its velocities now are ``which``, and it moved freely. Spheres of a tilted face that slides over an edge
    of an element approach the element's side, but pass the edge before they touch. Of such spheres it is at
    most the speed along the face's normal.
    """
    i, j = work.ids[c, 0], work.ids[c, 1]
    speed = contact_speeds(work.rows[c], work.velocity[which], i, j)[0] - h * work.rows[c, FALL]
    if j < 0 and work.ids[c, 3] == 0 and work.head[i] >= 0 and speed < -landing_speed(world.dt, threshold):
        return max(speed, _speed_along_face(c, which, world, work) - h * work.rows[c, FALL])
    return speed


@inner(noinline=True)
def _speed_along_face(c, which, world, work):
    """Return the speed of a contact's sphere against the normal of a face that slides over an edge [m/s].

    Contacts of the last step with the element's edges have a sphere at a corner of the face. Without such a
    face, the speed is infinitely negative.
    """
    i, j, s = work.ids[c, 0], work.ids[c, 1], work.ids[c, 2]
    faces, R, centers = world.implicit.faces, work.R[i], world.tree.centers
    n, best = triple(work.rows[c], DIRECTION), -math.inf
    arm = minus(rotate(R, centers[s, 0], centers[s, 1], centers[s, 2]), times(world.tree.radii[s], n))
    v = plus(triple(work.velocity[which, i], 0), cross(triple(work.velocity[which, i], 3), arm))
    entry = work.head[i]
    while entry >= 0:
        if work.old_contact[entry, 1] == j and work.old_contact[entry, 3] > 0:
            for k in range(FACES_OF_A_SPHERE):
                f = faces.of_sphere[work.old_contact[entry, 2], k]
                if f >= 0 and faces.corners[f] > 0:
                    p = rotate(R, faces.normal[f, 0], faces.normal[f, 1], faces.normal[f, 2])
                    if dot(p, n) < -FACING:
                        best = max(best, -dot(p, v))
        entry = work.link[entry]
    return best


@inner
def closes_fast(c, speed, threshold, world, work):
    """Return whether contact ``c`` closes fast enough for an impact, or lands on another edge."""
    fast = impact_speed(work.rows[c, RESTITUTION], threshold)
    return speed < -fast or (speed < -landing_speed(world.dt, threshold) and _lands(c, world, work))


@inner
def _time_of_impact(c, gap, speed, share, threshold, world, work):
    """Return `time_after` for contact ``c`` at ``share`` of the speed that it needs for an impact."""
    row = work.rows[c]
    fast = impact_speed(row[RESTITUTION], threshold)
    time = time_after(row, gap, speed, share * min(fast, landing_speed(world.dt, threshold)))
    if time < math.inf and speed + time * row[FALL] > -share * fast and not _lands(c, world, work):
        return math.inf
    return time


@inner(error_model="numpy", forceinline=True)
def time_after(row, gap, speed, threshold):
    """Return the time until an open contact closes faster than a threshold; infinite if never.

    It had this ``gap`` [m] at this speed. The gap is a parabola in time, from gravity and the centripetal
    acceleration of the sphere's centre.
    """
    way = gap - _AIM
    square = speed * speed - 2.0 * row[FALL] * way
    if way <= 0.0 or square <= threshold * threshold:
        return math.inf
    root = math.sqrt(square)
    return 2.0 * way / (root - speed) if root - speed > 0.0 else math.inf


@inner(forceinline=True)
def must_collide(row, depth):
    """Return whether a contact that becomes so deep [m] has an impact even after many in the same step."""
    return row[RESTITUTION] >= LIVELY or depth > _DEEP * row[ROLL_RADIUS]


@inner(forceinline=True)
def depth_after(row, speed, h):
    """Return the depth of a contact after free motion of ``h`` seconds [m]."""
    return -row[GAP] - h * (speed + 0.5 * h * row[FALL])


@inner
def impact_now(left, threshold, limited, world, work):
    """Return whether a touching contact closes fast.

    With ``limited``, only contacts count that `must_collide`, if they closed for ``left`` seconds.
    """
    rows = work.rows
    for c in range(work.counts[CONTACTS]):
        row = rows[c]
        if row[GAP] <= TOUCHING:
            speed = speed_before(c, START, 0.0, threshold, world, work)
            if closes_fast(c, speed, threshold, world, work):
                if not limited or must_collide(row, depth_after(row, speed, left)):
                    return True
    return False


@inner(error_model="numpy")
def time_to_impact(left, threshold, limited, world, work):
    """Return the time until the first impact of a current contact.

    Without an impact within ``left`` seconds, return ``left``. ``limited`` is as in `impact_now`.
    """
    rows, first = work.rows, left
    for c in range(work.counts[CONTACTS]):
        row = rows[c]
        speed = speed_before(c, START, 0.0, threshold, world, work)
        if not limited or must_collide(row, depth_after(row, speed, left)):
            first = min(first, _time_of_impact(c, row[GAP], speed, 1.0, threshold, world, work))
    return first


@inner
def impact_before(h, threshold, limited, world, work):
    """Return the time of the first possible impact of a current contact in the past ``h`` seconds.

    The motion was free. Without an impact, return ``h``. Return 0 if a contact was already closing at the
    beginning and is closed now, unless both bodies are `settled`. With ``limited``, only contacts count that
    `must_collide`.
    """
    first = h
    for c in range(work.counts[CONTACTS]):
        if not limited or must_collide(work.rows[c], -work.rows[c, GAP]):
            time = time_before(c, h, threshold, world, work)
            if time > 0.0 or not are_settled(c, work):
                first = min(first, time)
    return first


@inner(forceinline=True)
def are_settled(c, work):
    """Return whether contact ``c`` has touched since the beginning without an impact."""
    i, j = work.ids[c, 0], work.ids[c, 1]
    return work.settled[i] and (j < 0 or work.settled[j] or not work.moving[j])


@inner
def settle(h, threshold, world, work):
    """Mark the bodies of contacts that were closing at the beginning of the past ``h`` seconds as settled."""
    for c in range(work.counts[CONTACTS]):
        if time_before(c, h, threshold, world, work) == 0.0:
            work.settled[work.ids[c, 0]] = True
            if work.ids[c, 1] >= 0:
                work.settled[work.ids[c, 1]] = True


@inner(error_model="numpy", forceinline=True)
def time_before(c, h, threshold, world, work):
    """Return `impact_before` for contact ``c`` alone; infinite without an impact."""
    row = work.rows[c]
    begin = speed_before(c, FREE, h, threshold, world, work)
    gap = row[GAP] - h * (begin + 0.5 * h * row[FALL])
    if gap > 2.0 * TOUCHING:
        return _time_of_impact(c, gap, begin, _ALMOST, threshold, world, work)
    return 0.0 if row[GAP] <= 0.0 and closes_fast(c, begin, threshold, world, work) else math.inf
