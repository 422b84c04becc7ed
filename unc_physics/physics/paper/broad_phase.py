"""Broad phase: find pairs of bodies that may touch."""

import numpy as np

from ...compiler import inner
from ...spatial.layout import P
from ...spatial.rotation import rotate_back
from .sphere_tree import candidates

# relative bound, with a margin, on single-precision round-off in a change of frame
SINGLE_PRECISION = 4e-6
FIRST_STEPS, _MOST_STEPS = 4.0, 64.0  # steps of the separation test: first and largest number
# height of a search's first stack; typed, since a literal would compile every caller twice
ROOTS_ALONE = np.int64(1)


@inner(forceinline=True)
def near_pairs(x, reach, max_travel, moving, work):
    """Find the pairs of bodies that may touch.

    At least one body of a pair moves, and balls of radii ``reach`` (B,) about both overlap. Their separation
    bound allows contact while each travels ``max_travel`` (B,) further.

    Sweeps along x over the bodies; ``work.order`` stays sorted from step to step. Fills ``work.near`` with
    pairs (i, j), i < j, in an order that depends only on the state, and returns their number.
    """
    order, low, bound = work.order, work.low, work.separation_bound
    for i in range(len(x)):
        low[i] = x[i, P] - reach[i]
    for k in range(1, len(x)):  # insertion sort: fast, as the order rarely changes between steps
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
    """Write the rotation from body j's to i's frame into ``work.R_ij``; return j's position in it [m]."""
    Ri, Rj = work.R[i], work.R[j]
    for a in range(3):
        for b in range(3):
            work.R_ij[a, b] = Ri[0, a] * Rj[0, b] + Ri[1, a] * Rj[1, b] + Ri[2, a] * Rj[2, b]
    return rotate_back(Ri, x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])


@inner
def may_touch(x, i, j, world, work):
    """Return whether two bodies' trees, inflated by ``work.max_travel``, overlap.

    If not, their separation bound is raised. Later calls of `near_pairs` may then skip the pair, but only
    while the answer here would be the same.
    """
    t_ij = relative_pose(x, i, j, work)
    slack = SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j])
    travel = work.max_travel[i] + work.max_travel[j]
    if update_separation_bound(i, j, t_ij, slack, travel, world, work):
        return False
    return overlap_query(i, j, t_ij, slack + travel, world, work)


@inner
def update_separation_bound(i, j, t_ij, slack, pace, world, work):
    """Test whether two bodies stay separated for some steps, and if so raise their separation bound.

    Each sphere is inflated by the bodies' possible travel in some steps, at ``pace`` [m] a step; the number
    of steps adapts. This only skips searches without contacts, so no result depends on it.
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
    """Return whether two bodies' trees overlap if inflated by ``margin`` [m] in total, at ``work.R_ij``."""
    query = work.overlap_query
    query.stack[0, 0], query.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    found, _ = candidates(world.tree, work.R_ij, t_ij, margin, query, ROOTS_ALONE, 1)
    return found > 0
