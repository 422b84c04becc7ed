"""Which bodies of a scene may touch (the broad phase)."""

from ..layout import P
from .compiled import inner


@inner(forceinline=True)
def near_pairs(x, reach, coming, moving, work):
    """Find the pairs of bodies that may touch: at least one moves, balls of radii ``reach`` (B,) overlap, and they do not
    rest while each travels on by ``coming`` (B,).

    Sweeps along x over the bodies, which `work.order` keeps sorted from step to step. Fills ``work.near`` with
    pairs (i, j), i < j, in an order that depends on the state alone, and returns their number.
    """
    order, low = work.order, work.low
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
                if work.travel[i] + coming[i] + work.travel[j] + coming[j] >= work.rest[i, j, 0]:
                    work.near[count, 0], work.near[count, 1] = i, j
                    count += 1
    return count
