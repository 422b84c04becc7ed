"""Which bodies of a scene may touch."""

import numpy as np

from ..compiler import inner
from ..spatial.layout import P
from ..spatial.rotation import rotate_back
from .sphere_tree import candidates

# of lengths, as of two radii: bounds, with a margin, what single precision loses in a change of frame
SINGLE_PRECISION = 4e-6
FIRST_STEPS, _MOST_STEPS = 4.0, 64.0  # for which two bodies that are apart are asked to stay so
# height of a search's first stack; typed, since a literal would compile every caller twice
ROOTS_ALONE = np.int64(1)


@inner(forceinline=True)
def near_pairs(x, reach, max_travel, moving, work):
    """Find the pairs of bodies that may touch.

    One of them moves, balls of radii ``reach`` (B,) about them overlap, and their separation bound does not
    keep them apart while each travels ``max_travel`` (B,) further.

    Sweeps along x over the bodies, which `work.order` keeps sorted from step to step. Fills ``work.near``
    with pairs (i, j), i < j, in an order that depends on the state alone, and returns their number.
    """
    order, low, bound = work.order, work.low, work.separation_bound
    for i in range(len(x)):
        low[i] = x[i, P] - reach[i]
    for k in range(1, len(x)):  # insertion sort: next to no work on what was sorted a step ago
        body, place = order[k], k
        while place > 0:
            before = order[place - 1]
            if low[before] < low[body] or (low[before] == low[body] and before < body):
                break
            order[place] = before
            place -= 1
        order[place] = body
    count = 0
    for k in range(len(x)):
        a = order[k]
        high = x[a, P] + reach[a]
        for m in range(k + 1, len(x)):
            b = order[m]
            if low[b] >= high:
                break
            dx, dy, dz = x[b, P] - x[a, P], x[b, P + 1] - x[a, P + 1], x[b, P + 2] - x[a, P + 2]
            both = reach[a] + reach[b]
            if dx * dx + dy * dy + dz * dz < both * both and (moving[a] or moving[b]):
                i, j = min(a, b), max(a, b)
                if work.travel[i] + max_travel[i] + work.travel[j] + max_travel[j] >= bound[i, j, 0]:
                    work.near[count, 0], work.near[count, 1] = i, j
                    count += 1
    return count


@inner(forceinline=True)
def relative_pose(x, i, j, work):
    """Pose of body j in body i's frame: writes ``work.R_ij`` and returns the position [m]."""
    Ri, Rj = work.R[i], work.R[j]
    for a in range(3):
        for b in range(3):
            work.R_ij[a, b] = Ri[0, a] * Rj[0, b] + Ri[1, a] * Rj[1, b] + Ri[2, a] * Rj[2, b]
    return rotate_back(Ri, x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])


@inner
def may_touch(x, i, j, world, work):
    """Whether two bodies' trees, grown by ``work.max_travel``, overlap.

    Where they cannot, their separation bound is raised. So a later call of `near_pairs` may leave them out,
    but only where the answer here would be no again.
    """
    t_ij = relative_pose(x, i, j, work)
    slack = SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j])
    travel = work.max_travel[i] + work.max_travel[j]
    if update_separation_bound(i, j, t_ij, slack, travel, world, work):
        return False
    return overlap_query(i, j, t_ij, slack + travel, world, work)


@inner
def update_separation_bound(i, j, t_ij, slack, pace, world, work):
    """Leave two bodies out of searches while they cannot cross the gap between them, if there is one.

    Asks the trees whether the bodies stay apart when each sphere grows by what they may travel in some steps,
    at ``pace`` [m] a step; the number of steps adapts. This only leaves out searches that would find nothing,
    so no result depends on it.
    """
    bound = work.separation_bound
    steps = bound[i, j, 1]
    if not overlap_query(i, j, t_ij, 2.0 * slack + steps * pace, world, work):
        bound[i, j, 0] = work.travel[i] + work.travel[j] + steps * pace
        bound[i, j, 1] = min(2.0 * steps, _MOST_STEPS)
        return True
    bound[i, j, 1] = max(0.5 * steps, 1.0)
    return False


@inner
def overlap_query(i, j, t_ij, margin, world, work):
    """Whether two bodies' trees overlap when grown, together by ``margin`` [m], at ``work.R_ij``."""
    query = work.overlap_query
    query.stack[0, 0], query.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    found, _ = candidates(world.tree, work.R_ij, t_ij, margin, query, ROOTS_ALONE, 1)
    return found > 0
