"""Narrow phase: contacts of two bodies' spheres (the paper's section 3.2)."""

import math

from ...compiler import inner
from ...spatial.rotation import rotate
from .broad_phase import ROOTS_ALONE, SINGLE_PRECISION, relative_pose
from .contact_model import lens
from .sphere_tree import candidates

#: Columns of a contact's record, all in body i's frame: unit normal from body i to body j, distance of the
#: centres [m], volume of the lens [m^3], contact point [m].
NORMAL, DISTANCE, VOLUME, POINT = 0, 3, 4, 5
RECORD = 8


@inner(forceinline=True)
def open_pair(x, i, j, world, work):
    """Begin the search for contacts of bodies i and j.

    Returns
    -------
    t_ij : tuple of 3 floats
        Body j's centre of mass in body i's frame [m]; ``work.R_ij`` has the rotation.
    slack : float
    top : int
        Arguments of `next_contacts`.
    """
    t_ij = relative_pose(x, i, j, work)
    work.search.stack[0, 0], work.search.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    return t_ij, SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j]), ROOTS_ALONE


@inner(error_model="numpy", forceinline=True)
def next_contacts(tree, R_ij, t_ij, slack, search, top):
    """Continue the search for two bodies' contacts; arguments are as in `sphere_tree.candidates`.

    Fills ``search.pairs`` with the touching spheres and ``search.records`` with their contacts.

    Returns
    -------
    count : int
        Number of contacts found in this call.
    top : int
        Height of the stack; call again while it is positive, after using the contacts.
    """
    found, top = candidates(tree, R_ij, t_ij, slack, search, top, 1)  # one at once: sums depend on the order
    pairs, records = search.pairs, search.records
    centers, radii = tree.centers, tree.radii
    count = 0
    for k in range(found):
        i, j = pairs[k, 0], pairs[k, 1]
        x, y, z = rotate(R_ij, centers[j, 0], centers[j, 1], centers[j, 2])
        x += t_ij[0] - centers[i, 0]
        y += t_ij[1] - centers[i, 1]
        z += t_ij[2] - centers[i, 2]
        d2 = x * x + y * y + z * z
        reach = radii[i] + radii[j]
        if d2 >= reach * reach or d2 == 0.0:  # coincident centres have no normal and give no force
            continue
        d = math.sqrt(d2)
        volume, lever = lens(d, radii[i], radii[j])
        x, y, z = x / d, y / d, z / d
        pairs[count, 0], pairs[count, 1] = i, j
        records[count, NORMAL], records[count, NORMAL + 1], records[count, NORMAL + 2] = x, y, z
        records[count, DISTANCE], records[count, VOLUME] = d, volume
        records[count, POINT] = centers[i, 0] + lever * x
        records[count, POINT + 1] = centers[i, 1] + lever * y
        records[count, POINT + 2] = centers[i, 2] + lever * z
        count += 1
    return count, top


@inner
def contact_sums(records, count):
    """Sum over the first ``count`` contacts, in body i's frame (Eqs. 4 and 5 without the stiffness).

    Returns
    -------
    force : tuple of 3 floats
        Sum of V n [m^3]; the force on body j is this times the stiffness.
    moment : tuple of 3 floats
        Sum of c x V n [m^4], where c is the contact point relative to body i's centre of mass.
    """
    fx = fy = fz = mx = my = mz = 0.0
    for k in range(count):
        volume = records[k, VOLUME]
        x, y = volume * records[k, NORMAL], volume * records[k, NORMAL + 1]
        z = volume * records[k, NORMAL + 2]
        fx += x
        fy += y
        fz += z
        mx += records[k, POINT + 1] * z - records[k, POINT + 2] * y
        my += records[k, POINT + 2] * x - records[k, POINT] * z
        mz += records[k, POINT] * y - records[k, POINT + 1] * x
    return (fx, fy, fz), (mx, my, mz)
