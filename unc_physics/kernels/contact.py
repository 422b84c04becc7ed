"""Contact of two spheres, and the sum of all contacts of two bodies (the paper's Eqs. 4 and 5)."""

import math

from numba import njit

from .so3 import rotate
from .tree import candidates


@njit(cache=True, nogil=True)
def lens(d, ri, rj):
    """Overlap of two spheres of radii ``ri``, ``rj`` [m] whose centres are ``d`` apart.

    Returns
    -------
    volume : float
        Of the lens [m^3]; the whole smaller sphere when it lies inside the other; 0 without overlap.
    lever : float
        Contact point on the line of centres, measured from the first centre towards the second [m]: the middle
        of the interval in which the spheres overlap.
    """
    if d >= ri + rj:
        return 0.0, 0.0
    if d <= abs(ri - rj):
        volume = 4.0 / 3.0 * math.pi * min(ri, rj) ** 3
    else:
        s = ri + rj - d
        volume = math.pi * s * s * (d * d + 2.0 * d * (ri + rj) - 3.0 * (ri - rj) ** 2) / (12.0 * d)
    return volume, 0.5 * (max(d - rj, -ri) + min(ri, d + rj))


@njit(cache=True, nogil=True)
def pair_wrench(tree, roots, R_ij, t_ij, slack, scratch):
    """Sum over all contacts of bodies i and j of volume times normal, in body i's frame.

    Parameters
    ----------
    tree : Tree
    roots : (int, int)
        Root nodes of the two bodies.
    R_ij : (3, 3) array
        Rotation from body j's to body i's coordinates.
    t_ij : tuple of 3 floats
        Centre of mass of body j in body i's frame [m].
    slack, scratch
        As in `tree.candidates`.

    Returns
    -------
    force : tuple of 3 floats
        Sum of V n [m^3], n from body i to body j: times the stiffness, the force on body j.
    moment : tuple of 3 floats
        Sum of c x V n [m^4], c the contact point from body i's centre of mass.
    """
    fx = fy = fz = mx = my = mz = 0.0
    pairs = scratch.pairs
    scratch.stack[0, 0], scratch.stack[0, 1] = roots
    top = 1
    while top > 0:
        found, top = candidates(tree, R_ij, t_ij, slack, scratch, top)
        for k in range(found):
            i, j = pairs[k, 0], pairs[k, 1]
            x, y, z = rotate(R_ij, tree.centers[j, 0], tree.centers[j, 1], tree.centers[j, 2])
            nx = x + t_ij[0] - tree.centers[i, 0]
            ny = y + t_ij[1] - tree.centers[i, 1]
            nz = z + t_ij[2] - tree.centers[i, 2]
            d2 = nx * nx + ny * ny + nz * nz
            reach = tree.radii[i] + tree.radii[j]
            if d2 >= reach * reach or d2 == 0.0:  # coincident centres have no normal and give no force
                continue
            d = math.sqrt(d2)
            volume, lever = lens(d, tree.radii[i], tree.radii[j])
            nx, ny, nz = nx / d, ny / d, nz / d
            cx = tree.centers[i, 0] + lever * nx
            cy = tree.centers[i, 1] + lever * ny
            cz = tree.centers[i, 2] + lever * nz
            nx, ny, nz = volume * nx, volume * ny, volume * nz
            fx += nx
            fy += ny
            fz += nz
            mx += cy * nz - cz * ny
            my += cz * nx - cx * nz
            mz += cx * ny - cy * nx
    return (fx, fy, fz), (mx, my, mz)
