"""Contacts of a body's spheres with elements of the environment."""

import numpy as np

from ...compiler import inner
from ...compiler.simd import box_mask, lowest_bit
from ...spatial.rotation import rotate, rotate_back
from ...spatial.vectors import single
from .broad_phase import SINGLE_PRECISION
from .contact_model import cap
from .narrow_phase import DISTANCE, NORMAL, POINT, VOLUME
from .solids import bounds, surface
from .sphere_tree import EMPTY, WIDTH


@inner(forceinline=True)
def in_element(position, R, e, x, y, z):
    """Transform a point from the world frame to the frame of element e."""
    x, y, z = x - position[e, 0], y - position[e, 1], z - position[e, 2]
    return (
        R[e, 0, 0] * x + R[e, 1, 0] * y + R[e, 2, 0] * z,
        R[e, 0, 1] * x + R[e, 1, 1] * y + R[e, 2, 1] * z,
        R[e, 0, 2] * x + R[e, 1, 2] * y + R[e, 2, 2] * z,
    )


@inner(forceinline=True)
def element_distance(environment, e, x, y, z):
    """Return the signed distance of a point, world frame, from element e [m]."""
    px, py, pz = in_element(environment.position, environment.R, e, x, y, z)
    return surface(environment.kind, environment.size, e, px, py, pz)[0]


@inner
def write_element_rotation(R_i, R_e, out):
    """Write the rotation from body to element axes into ``out`` (3, 3)."""
    for a in range(3):
        for b in range(3):
            out[a, b] = R_e[0, a] * R_i[0, b] + R_e[1, a] * R_i[1, b] + R_e[2, a] * R_i[2, b]


@inner(error_model="numpy", forceinline=True)
def spheres_near(tree, environment, e, R, t, radius, margin, search, top):
    """Continue the search for spheres of a body that are nearer to element e than a margin [m].

    Parameters
    ----------
    tree : Tree
    environment : Environment
    e : int
    R : (3, 3) array
        Rotation from body to element axes.
    t : tuple of 3 floats
        The body's centre of mass in the element's frame [m].
    radius : float
        Radius of the body [m].
    margin : float
    search : Scratch
        Its ``stack`` holds the remaining nodes in its first column; a search begins with the body's root. Its
        ``pairs`` are filled with (sphere, e).
    top : int
        Height of the stack.

    Returns
    -------
    count : int
        Number of spheres found in this call.
    top : int
        Height of the stack; call again while it is positive, after using the spheres.
    """
    kind, size = environment.kind, environment.size
    child, centers, radii = tree.child, tree.centers, tree.radii
    stack, pairs = search.stack, search.pairs
    low, high = bounds(kind, size, e)
    low, high, at = single(low), single(high), single(t)
    rows = (single(R[0]), single(R[1]), single(R[2]))
    reach = np.float32(margin + SINGLE_PRECISION * (abs(t[0]) + abs(t[1]) + abs(t[2]) + radius))
    count = 0
    while top > 0 and count + WIDTH <= len(pairs):
        top -= 1
        node = stack[top, 0]
        mask = box_mask(tree.bounds, node, rows, at, low, high, reach)
        while mask != 0:
            k = lowest_bit(mask)
            mask &= mask - np.uint64(1)
            c = child[node, k]
            if c == EMPTY:
                break
            if c >= 0:
                stack[top, 0] = c
                top += 1
                continue
            s = ~c
            x, y, z = rotate(R, centers[s, 0], centers[s, 1], centers[s, 2])
            if surface(kind, size, e, x + t[0], y + t[1], z + t[2])[0] < radii[s] + margin:
                pairs[count, 0], pairs[count, 1] = s, e
                count += 1
    return count, top


@inner(error_model="numpy", forceinline=True)
def next_element_contacts(tree, environment, e, R, t, radius, search, top):
    """Continue the search for contacts of a body with element e, as `spheres_near` without a margin.

    Fills ``search.records`` as `narrow_phase.next_contacts`, with the body as body i and the element as body
    j. The normal points into the solid. The distance is the signed distance of the sphere's centre from the
    surface.
    """
    centers, radii, records = tree.centers, tree.radii, search.records
    count, top = spheres_near(tree, environment, e, R, t, radius, 0.0, search, top)
    for m in range(count):
        s = search.pairs[m, 0]
        x, y, z = rotate(R, centers[s, 0], centers[s, 1], centers[s, 2])
        distance, normal = surface(environment.kind, environment.size, e, x + t[0], y + t[1], z + t[2])
        volume, depth = cap(distance, radii[s])
        nx, ny, nz = rotate_back(R, normal[0], normal[1], normal[2])
        lever = radii[s] - 0.5 * depth
        records[m, NORMAL], records[m, NORMAL + 1], records[m, NORMAL + 2] = -nx, -ny, -nz
        records[m, DISTANCE], records[m, VOLUME] = distance, volume
        records[m, POINT] = centers[s, 0] - lever * nx
        records[m, POINT + 1] = centers[s, 1] - lever * ny
        records[m, POINT + 2] = centers[s, 2] - lever * nz
    return count, top


@inner(forceinline=True)
def open_element(x, i, e, world, environment, work):
    """Begin the search for contacts of body i with element e.

    Returns
    -------
    t : tuple of 3 floats
        Body i's centre of mass in the element's frame [m]; ``work.R_ij`` has the rotation.
    top : int
        0 if the body is out of reach.
    """
    t = in_element(environment.position, environment.R, e, x[i, 0], x[i, 1], x[i, 2])
    if surface(environment.kind, environment.size, e, t[0], t[1], t[2])[0] >= world.bodies.radius[i]:
        return t, np.int64(0)
    write_element_rotation(work.R[i], environment.R[e], work.R_ij)
    work.search.stack[0, 0] = world.bodies.root[i]
    return t, np.int64(1)
