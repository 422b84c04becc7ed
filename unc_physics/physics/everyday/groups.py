"""Groups of bodies that touch, by union-find."""

from ...compiler import inner
from .columns import BODY_A, BODY_B, GROUP, IMASS, MEMBERS, NEXT, PARENT, START


@inner
def _root(parent, i):
    """Return the body that stands for i's group; ways to it are shortened."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner(noinline=True)
def group_contacts(bodies, n, found, C, Y, groups):
    """Copy contacts into ``C``, sorted by groups of bodies that touch; return the number of groups.

    A body without contacts has group -1.
    """
    parent, group, after, start = groups[PARENT], groups[GROUP], groups[NEXT], groups[START]
    for i in range(bodies):
        parent[i], group[i] = i, -1
    for k in range(n):
        a = int(found[k, BODY_A])
        if Y[a, IMASS] > 0.0:
            parent[_root(parent, a)] = _root(parent, int(found[k, BODY_B]))
    m = 0
    for k in range(n):
        r = _root(parent, int(found[k, BODY_B]))
        if group[r] < 0:
            group[r], after[m] = m, 0
            m += 1
        after[group[r]] += 1
    total = 0
    for j in range(m):
        start[j], total = total, total + after[j]
        after[j] = start[j]
    start[m] = total
    for i in range(bodies):
        group[i] = group[_root(parent, i)]
    for k in range(n):
        j = group[int(found[k, BODY_B])]
        for x in range(found.shape[1]):
            C[after[j], x] = found[k, x]
        after[j] += 1
    return m


@inner
def members_of(bodies, j, groups):
    """Write the bodies of group j to the row `columns.MEMBERS`; return their number."""
    m = 0
    for i in range(bodies):
        if groups[GROUP, i] == j:
            groups[MEMBERS, m] = i
            m += 1
    return m
