"""Search of an implicit step for spheres that may touch: near bodies first, then lists of their spheres.

A list holds all spheres, or pairs of spheres, of two objects that are nearer than a margin. It is valid until
their relative motion exceeds the margin. It only excludes spheres that cannot touch, so no result depends on
when it was built.
"""

import math

import numpy as np

from ..compiler import inner
from ..spatial.layout import P, V, W
from ..spatial.rotation import cross, rotate, rotate_back
from ..spatial.vectors import times
from .broad_phase import SINGLE_PRECISION
from .element_contacts import element_distance, in_element, spheres_near
from .implicit_workspace import CLEARANCE, OVERFLOW, PACE, POOL_USED, SURGE, TOO_LONG_LISTS, TRAVEL
from .shapes import flat_side
from .sphere_tree import AT_ONCE, candidates

#: Largest gap of contacts in a step [m].
ACTIVE_GAP = 5e-4
#: Bodies are near if they may come closer than this in a step [m].
NEAR = 1e-3
#: Margin of lists of an element: a distance [m], plus a number of steps at the current speed.
LIST_MARGIN, LIST_STEPS = 5e-4, 2.0
#: Relative motion of two bodies after which their list is rebuilt [m].
PAIR_MARGIN = 5e-4
_MARGIN = 12  # column of `list_pose`, after rotation and position: the margin [m]


@inner
def update_pace(x, i, radius, gravity, dt, numbers):
    """Write `PACE`, a bound on the speed of body i's points in the next ``dt`` seconds."""
    v = math.sqrt(x[i, V] ** 2 + x[i, V + 1] ** 2 + x[i, V + 2] ** 2)
    w = math.sqrt(x[i, W] ** 2 + x[i, W + 1] ** 2 + x[i, W + 2] ** 2)
    fall = dt * math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
    numbers[i, PACE] = v + radius * w + fall + numbers[i, SURGE]


@inner
def closing_bound(x, i, j, world, work):
    """Bound the speed at which points of bodies i and j approach each other in this step [m/s]."""
    radius = world.bodies.radius
    v = w = u = 0.0
    for k in range(3):
        v += (x[i, V + k] - x[j, V + k]) ** 2
        w += x[i, W + k] ** 2
        u += x[j, W + k] ** 2
    return math.sqrt(v) + radius[i] * math.sqrt(w) + radius[j] * math.sqrt(u) + _gain(i, j, world, work)


@inner(forceinline=True)
def half_way(x, i, j, horizon, world, work):
    """Find a relative pose of two bodies at which spheres that may touch within ``horizon`` seconds are near.

    It is either the current pose, or the pose at half the horizon at current velocities, whichever has the
    smaller bound. At half the horizon, spheres that touch at the end are at most half their relative path
    apart. In the current pose they are at most their approach apart. The bounds account for the curvature of
    rigid motion.

    Returns
    -------
    t : tuple of 3 floats
        Body j's centre of mass in i's frame [m]; ``work.R_ij`` has the rotation from its axes.
    reach : float
        Bound on the additional gap of such spheres at this pose [m].
    """
    radius, R_ij = world.bodies.radius, work.R_ij
    turn = near_i = near_j = apart = 0.0
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        da, db = x[j, P + a] - x[i, P + a], x[j, P + b] - x[i, P + b]
        v = x[i, V + k] - x[j, V + k]
        apart += da * da
        turn += (x[i, W + k] - x[j, W + k]) ** 2
        near_j += (v + x[i, W + a] * db - x[i, W + b] * da) ** 2
        near_i += (v + x[j, W + a] * db - x[j, W + b] * da) ** 2
    spin, near_i, near_j = math.sqrt(turn), math.sqrt(near_i), math.sqrt(near_j)
    fast_i, fast_j = near_i + radius[i] * spin, near_j + radius[j] * spin
    gain = _gain(i, j, world, work)
    now = horizon * min(min(fast_i, fast_j) + gain, closing_bound(x, i, j, world, work))
    half = 0.5 * horizon
    angle = half * spin
    bend = _bend(angle)
    way_j = half * fast_j + radius[j] * bend
    way_i = half * fast_i + (math.sqrt(apart) + radius[i]) * bend + angle * half * near_j
    reach = min(way_i, way_j) + horizon * gain
    t = relative_pose(x, i, j, work.R, R_ij)
    if now <= reach:
        return t, now
    d = (x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])
    c = cross((x[i, W], x[i, W + 1], x[i, W + 2]), d)
    Ri = work.R[i]
    ux, uy, uz = rotate_back(
        Ri, x[j, V] - x[i, V] - c[0], x[j, V + 1] - x[i, V + 1] - c[1], x[j, V + 2] - x[i, V + 2] - c[2]
    )
    q = rotate_back(Ri, x[j, W] - x[i, W], x[j, W + 1] - x[i, W + 1], x[j, W + 2] - x[i, W + 2])
    q = times(0.5 * half, q)
    _turn(R_ij, q)
    return (t[0] + half * ux, t[1] + half * uy, t[2] + half * uz), reach


@inner(forceinline=True)
def _turn(R, q):
    """Rotate a frame's axes, the columns of ``R``, by about twice the small vector ``q`` [rad].

    Cayley's map yields an exact rotation.
    """
    scale = 2.0 / (1.0 + q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    for k in range(3):
        once = cross(q, (R[0, k], R[1, k], R[2, k]))
        twice = cross(q, once)
        for r in range(3):
            R[r, k] += scale * (once[r] + twice[r])


@inner(forceinline=True)
def _bend(angle):
    """Return a bound on the deviation of `_turn` from a straight path [m], at 1 m from the axis."""
    return 0.5 * angle * angle * (1.0 + 0.5 * angle)


@inner
def _gain(i, j, world, work):
    """Return a bound on the speed that a step without contacts adds to the approach of two bodies [m/s]."""
    surge = work.numbers[i, SURGE] + work.numbers[j, SURGE]
    if work.moving[i] and work.moving[j]:
        return surge
    return surge + world.dt * math.sqrt(world.gravity[0] ** 2 + world.gravity[1] ** 2 + world.gravity[2] ** 2)


@inner(forceinline=True)
def find_groups(x, world, work):
    """Find pairs of near bodies, and join moving ones to groups.

    An impact may accelerate a body to the highest speed in its group. Pairs that this could bring together in
    the step are therefore near, too.
    """
    numbers, order, near, group = work.numbers, work.order, work.near, work.group
    radius, moving, dt = world.bodies.radius, work.moving, world.dt
    count, found, fastest = len(x), False, 0.0
    for i in range(count):
        fastest = max(fastest, numbers[i, PACE])
        group[i] = i
        for k in range(work.neighbor_count[i]):
            near[i, work.neighbor[i, k]] = False
        work.neighbor_count[i] = 0
    thrown = dt * fastest
    for k in range(1, count):  # insertion sort: fast, as the order rarely changes between steps
        body, place = order[k], k
        low = x[body, P] - radius[body] - dt * numbers[body, PACE]
        while place > 0:
            before = order[place - 1]
            if x[before, P] - radius[before] - dt * numbers[before, PACE] <= low:
                break
            order[place] = before
            place -= 1
        order[place] = body
    for k in range(count):
        a = order[k]
        reach = radius[a] + dt * numbers[a, PACE] + NEAR + thrown
        high = x[a, P] + reach
        for m in range(k + 1, count):
            b = order[m]
            far = radius[b] + dt * numbers[b, PACE]
            if x[b, P] - far >= high:
                break
            if not (moving[a] or moving[b]):
                continue
            dx, dy, dz = x[b, P] - x[a, P], x[b, P + 1] - x[a, P + 1], x[b, P + 2] - x[a, P + 2]
            square = dx * dx + dy * dy + dz * dz
            if square < (reach + far) ** 2:
                # bodies in common free fall do not approach each other
                reached = radius[a] + radius[b] + NEAR + dt * closing_bound(x, a, b, world, work) + thrown
                if square < reached * reached:
                    found = True
                    _add_neighbor(a, b, work)
                    _add_neighbor(b, a, work)
    if found:
        _join_near(x, world, work)
    for i in range(count):
        group[i] = lowest(group, i)


@inner(forceinline=True)
def _add_neighbor(i, j, work):
    """Insert body j into the ascending list of body i's neighbors."""
    neighbor, place = work.neighbor[i], work.neighbor_count[i]
    while place > 0 and neighbor[place - 1] > j:
        neighbor[place] = neighbor[place - 1]
        place -= 1
    neighbor[place] = j
    work.neighbor_count[i] += 1


@inner(forceinline=True)
def list_members(work):
    """Write each body's successor in its group into ``work.next_member``."""
    group, moving, following = work.group, work.moving, work.next_member
    for i in range(len(group)):
        following[i] = -1
    for j in range(len(group) - 1, -1, -1):
        i = group[j]
        if moving[j] and i != j:
            following[j] = following[i]
            following[i] = j


@inner
def _join_near(x, world, work):
    """Keep neighbors whose boxes and balls are near, and join moving ones to groups.

    The test depends on the speeds of groups, which only grow. So the result depends neither on the order of
    bodies nor on bodies of other groups.
    """
    near, group, numbers, throw = work.near, work.group, work.numbers, work.throw_pace
    count, moving, box = len(x), work.moving, world.implicit.box
    neighbor, neighbor_count = work.neighbor, work.neighbor_count
    for i in range(count):
        throw[i] = 0.0
    grown = True
    while grown:
        grown = False
        for i in range(count):
            for k in range(neighbor_count[i]):
                j = neighbor[i, k]
                if j < i or near[i, j]:
                    continue
                a, b = lowest(group, i), lowest(group, j)
                pace = max(throw[a], throw[b])
                reach = NEAR + world.dt * (closing_bound(x, i, j, world, work) + pace)
                t = relative_pose(x, i, j, work.R, work.R_ij)
                apart = box_gap(box[i], box[j], work.R_ij, t)
                if apart >= reach or not balls_within(x, i, j, reach, world.bodies.radius):
                    continue
                near[i, j] = near[j, i] = True
                most = max(pace, max(numbers[i, PACE], numbers[j, PACE]))
                if moving[i] and moving[j]:
                    join(group, a, b)
                    a = b = min(a, b)
                elif not moving[i]:
                    a = b
                grown = grown or most > throw[a]
                throw[a] = most
    for i in range(count):
        kept = 0
        for k in range(neighbor_count[i]):
            j = neighbor[i, k]
            if near[i, j]:
                neighbor[i, kept] = j
                kept += 1
        neighbor_count[i] = kept


@inner
def box_gap(a, b, R, t):
    """Return a lower bound on the distance of two bodies' boxes [m]; negative if none is found.

    The boxes' axes are tested. ``a`` and ``b`` are the rows of `Implicit.box`. ``R`` and ``t`` transform the
    second frame into the first.
    """
    ux, uy, uz = rotate(R, b[0], b[1], b[2])
    d = t[0] + ux - a[0], t[1] + uy - a[1], t[2] + uz - a[2]
    best = -np.inf
    for k in range(3):
        own = abs(d[k]) - a[3 + k]
        other = abs(R[0, k] * d[0] + R[1, k] * d[1] + R[2, k] * d[2]) - b[3 + k]
        for m in range(3):
            own -= b[3 + m] * abs(R[k, m])
            other -= a[3 + m] * abs(R[m, k])
        best = max(best, max(own, other))
    return best


@inner(forceinline=True)
def balls_within(x, i, j, gap, radius):
    """Return whether the bounding balls of bodies i and j are nearer to each other than a gap [m]."""
    square, near = 0.0, radius[i] + radius[j] + gap
    for k in range(3):
        square += (x[i, P + k] - x[j, P + k]) ** 2
    return square < near * near


@inner(forceinline=True)
def column_of(j, bodies):
    """Return a partner's column in an array (B, B + E): of body j, or of element ``-1 - j``."""
    if j < 0:
        return bodies - 1 - j
    return j


@inner(forceinline=True)
def pair_of(i, j, bodies):
    """Return row and column of bodies i and j, or of body i and element ``-1 - j``."""
    if j < 0:
        return i, column_of(j, bodies)
    return min(i, j), max(i, j)


@inner(forceinline=True)
def lowest(group, i):
    """Return the lowest member of the group of ``i``."""
    while group[i] != i:
        i = group[i]
    return i


@inner(forceinline=True)
def join(group, a, b):
    """Merge two groups."""
    a, b = lowest(group, a), lowest(group, b)
    if a != b:
        group[max(a, b)] = min(a, b)


@inner
def clearance(x, i, world, work):
    """Return a lower bound on body i's distance from the environment [m], cached for motions below it."""
    numbers, radius = work.numbers, world.bodies.radius
    if numbers[i, CLEARANCE] > numbers[i, TRAVEL]:
        return numbers[i, CLEARANCE] - numbers[i, TRAVEL]
    least = np.inf
    for e in range(len(world.environment.kind)):
        least = min(
            least, element_distance(world.environment, e, x[i, P], x[i, P + 1], x[i, P + 2]) - radius[i]
        )
    numbers[i, CLEARANCE] = numbers[i, TRAVEL] + max(least, 0.0)
    return least


@inner(forceinline=True)
def side_of(kind, size, e, t, R_e, R, extent):
    """Find the flat side of element e that is below all sphere centres of a body (`shapes.flat_side`).

    ``t`` is the body's centre of mass in the element's frame. ``extent`` (6,) is the centre and half the
    sides of the bounding box of its sphere centres, body frame [m].
    """
    m0, m1, m2 = t
    r0 = r1 = r2 = 0.0
    for b in range(3):
        x = R_e[0, 0] * R[0, b] + R_e[1, 0] * R[1, b] + R_e[2, 0] * R[2, b]
        y = R_e[0, 1] * R[0, b] + R_e[1, 1] * R[1, b] + R_e[2, 1] * R[2, b]
        z = R_e[0, 2] * R[0, b] + R_e[1, 2] * R[1, b] + R_e[2, 2] * R[2, b]
        m0, m1, m2 = m0 + x * extent[b], m1 + y * extent[b], m2 + z * extent[b]
        r0, r1, r2 = r0 + abs(x) * extent[3 + b], r1 + abs(y) * extent[3 + b], r2 + abs(z) * extent[3 + b]
    return flat_side(kind, size, e, m0, m1, m2, r0, r1, r2)


@inner(forceinline=True)
def half_way_by(x, i, e, v, horizon, world, R):
    """Find a pose as `half_way`, for body i with velocity ``v`` relative to element e.

    ``R`` is the rotation from body to element axes, and is updated.
    """
    environment, radius, half = world.environment, world.bodies.radius[i], 0.5 * horizon
    w = x[i, W], x[i, W + 1], x[i, W + 2]
    spin = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    reach = half * (math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + radius * spin)
    _turn(R, times(0.5 * half, rotate_back(environment.R[e], w[0], w[1], w[2])))
    t = in_element(
        environment.position,
        environment.R,
        e,
        x[i, P] + half * v[0],
        x[i, P + 1] + half * v[1],
        x[i, P + 2] + half * v[2],
    )
    return t, reach + radius * _bend(half * spin)


@inner(forceinline=True)
def element_list(i, e, t, need, spare, world, work):
    """Update the list of body i's spheres near element e.

    ``need`` [m] is the distance within which spheres are listed, ``spare`` [m] the motion until the list is
    rebuilt. The body's centre of mass is at ``t`` in the element's frame [m], and ``work.R_ij`` is the
    rotation from body axes.
    """
    environment, search, pool, R = world.environment, work.search, work.pool, work.R_ij
    column = len(work.moving) + e
    place, radius = work.list_pose[i, column], world.bodies.radius[i]
    if need + _moved(place, R, t, radius) <= place[_MARGIN]:
        return
    margin = need + spare
    start = work.counts[POOL_USED]
    used = start
    search.stack[0, 0] = world.bodies.root[i]
    top = np.int64(1)
    while top > 0:
        found, top = spheres_near(world.tree, environment, e, R, t, radius, margin, search, top)
        if used + found > len(pool):
            work.counts[OVERFLOW] = TOO_LONG_LISTS
            return
        for k in range(found):
            s = search.pairs[k, 0]
            pool[used, 0], pool[used, 1] = s, 0
            for c in range(3):
                work.pool_spheres[c, used] = world.tree.centers[s, c]
            work.pool_spheres[3, used] = world.tree.radii[s]
            used += 1
    _keep_list(i, column, start, used, R, t, margin, work)


@inner(forceinline=True)
def pair_list(i, j, t_ij, need, world, work):
    """Update the list of near pairs of spheres of bodies i and j.

    ``need`` [m] is the distance within which pairs are listed. Body j's centre of mass is at ``t_ij`` in i's
    frame [m], and ``work.R_ij`` is the rotation from j's axes.
    """
    tree, search, pool, R_ij = world.tree, work.search, work.pool, work.R_ij
    place = work.list_pose[i, j]
    if need + _moved(place, R_ij, t_ij, world.bodies.radius[j]) <= place[_MARGIN]:
        return
    margin = need + PAIR_MARGIN
    slack = SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j]) + margin
    start = work.counts[POOL_USED]
    used = start
    search.stack[0, 0], search.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    top = np.int64(1)
    while top > 0:
        found, top = candidates(tree, R_ij, t_ij, slack, search, top, AT_ONCE)
        if used + found > len(pool):
            work.counts[OVERFLOW] = TOO_LONG_LISTS
            return
        _copy_spheres(found, search.pairs, tree.centers, tree.radii, used, pool, work.pool_spheres)
        used += found
    _keep_list(i, j, start, used, R_ij, t_ij, margin, work)


@inner
def _copy_spheres(count, pairs, centers, radii, used, pool, spheres):
    """Append pairs of spheres with their centres and radii to the pool."""
    for k in range(count):
        a, b, at = np.uint64(pairs[k, 0]), np.uint64(pairs[k, 1]), np.uint64(used + k)
        pool[at, 0], pool[at, 1] = pairs[k, 0], pairs[k, 1]
        spheres[0, at], spheres[1, at], spheres[2, at] = centers[a, 0], centers[a, 1], centers[a, 2]
        spheres[4, at], spheres[5, at], spheres[6, at] = centers[b, 0], centers[b, 1], centers[b, 2]
        spheres[3, at], spheres[7, at] = radii[a], radii[b]


@inner(forceinline=True)
def _moved(place, R, t, radius):
    """Bound the motion of a body's points [m] from the pose ``place`` to the pose ``R``, ``t``."""
    way = turn = 0.0
    for a in range(3):
        way += (t[a] - place[9 + a]) ** 2
        for b in range(3):
            turn += (R[a, b] - place[3 * a + b]) ** 2
    return math.sqrt(way) + radius * math.sqrt(0.5 * turn)


@inner(forceinline=True)
def _keep_list(i, column, start, used, R, t, margin, work):
    """Store the range of a list in the pool and the relative pose for which it was built."""
    place = work.list_pose[i, column]
    for a in range(3):
        place[9 + a] = t[a]
        for b in range(3):
            place[3 * a + b] = R[a, b]
    place[_MARGIN] = margin
    work.lists[i, column, 0], work.lists[i, column, 1] = start, used - start
    work.counts[POOL_USED] = used


@inner(forceinline=True)
def relative_pose(x, i, j, R, R_ij):
    """Write the rotation from body j's to i's frame into ``R_ij``; return j's position in it [m]."""
    for a in range(3):
        for b in range(3):
            R_ij[a, b] = R[i, 0, a] * R[j, 0, b] + R[i, 1, a] * R[j, 1, b] + R[i, 2, a] * R[j, 2, b]
    return rotate_back(R[i], x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])


@inner
def forget_lists(work):
    """Mark all lists for rebuilding."""
    work.counts[POOL_USED] = 0
    for i in range(work.list_pose.shape[0]):
        for j in range(work.list_pose.shape[1]):
            work.list_pose[i, j, _MARGIN] = -np.inf
